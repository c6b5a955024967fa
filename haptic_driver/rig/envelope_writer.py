"""The stream of an envelope: what render asks for, written ahead of what an analog output plays."""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np

from haptic_driver.errors import HapticError
from haptic_driver.render.envelope import synthesise
from haptic_driver.signals import Array, Course
from hw.analog.output import AnalogOutput, OutputUnderrun
from hw.errors import DeviceError
from hw.generator.settings import ModulationInput

ROUNDING = 1.0 + 1e-8  # of what is at its limit, which is worked out twice
LEAST_LEAD_S = 0.003  # two ticks, and one for what the machine always is late by
MOST_LEAD_S = 0.03  # a stall that takes longer costs a gap: everything would come late for its sake
LEAD_STEP_S = 0.001  # render takes up each new lead
SPARE = 1.25  # of the lateness seen: the next may be longer
REMEMBERED_S = 600.0
PARTS = 10  # in which lateness is remembered


class Lead:
    """How far ahead to write, by how late this machine has let its writer be in the last minutes.

    `fixed_s` stands in for all of that where a rig's file has it. `most_s` is what the output's
    buffer takes.
    """

    def __init__(self, fixed_s: float | None, most_s: float) -> None:
        self._fixed_s = fixed_s
        self._most_s = most_s
        self._part = 0
        self._worst_s = [0.0] * PARTS
        self.lead_s = fixed_s or LEAST_LEAD_S

    def notice(self, now_s: float, late_s: float) -> None:
        """One turn came so late; the lead grows at once where that asks for more."""
        part = int(now_s * PARTS / REMEMBERED_S)
        for k in range(self._part + 1, min(part, self._part + PARTS) + 1):
            self._worst_s[k % PARTS] = 0.0
        self._part = part
        if late_s > self._worst_s[part % PARTS]:
            self._worst_s[part % PARTS] = late_s
            self.lead_s = max(self.lead_s, self._wanted_s())

    def choose(self) -> None:
        """Also less than before, while nothing is rendered that would feel the change."""
        self.lead_s = self._wanted_s()

    def _wanted_s(self) -> float:
        if self._fixed_s is not None:
            return self._fixed_s
        wanted_s = LEAST_LEAD_S + SPARE * max(self._worst_s)
        return min(math.ceil(wanted_s / LEAD_STEP_S) * LEAD_STEP_S, MOST_LEAD_S, self._most_s)


def warm_up() -> None:
    """Compile what a writer's turn needs."""
    synthesise(np.zeros(3), np.empty(2))


class EnvelopeWriter:
    """Brings courses of voltage to the Modulation In of a carrier that goes up to `full_scale_v`.

    `output` is open, with the level that stands for no amplitude as its zero level. Every course is
    added to the output's stream, straight in voltage squared, which force follows. The stream is
    kept about `lead_s` long: so late is its end at the electrode, and so late may a `go_on` be. The
    output's own clock paces it; courses are a sample longer or shorter when need be. Without
    anything new the last voltage is held. `underruns` counts gaps: the output holds its last
    voltage meanwhile, or zero after longer ones, and goes on from there at `rise_v_per_s` at most.
    `drained_s`: how much of the stream was played between the last two writes, in blocks on many
    devices. All methods raise DeviceError, with the output at zero if it can be.
    """

    def __init__(
        self,
        output: AnalogOutput,
        modulation: ModulationInput,
        sample_rate_hz: float,
        rise_v_per_s: float,
    ) -> None:
        self.underruns = 0
        self.drained_s = 0.0
        self._waiting_s = 0.0  # after the last write
        self._output = output
        self._modulation = modulation
        self._rate_hz = sample_rate_hz
        self._rise_v_per_s = rise_v_per_s
        self._power_v2 = 0.0  # where the stream ends
        self._resting = False
        self._catching_up = False  # after a gap

    @property
    def latency_s(self) -> float:
        """How much later than its place in the stream a voltage is there, as the device says."""
        return self._output.latency_s

    def go_on(
        self, course: Course, full_scale_v: float, lead_s: float, may_rise: bool = True
    ) -> bool:
        """Add a course; whether the stream has gone on without a gap.

        Nothing is above what it was where it may not rise. Raises HapticError for a course beyond
        full scale.
        """
        if not may_rise:  # another carrier is on its way: the course may be meant for that
            most_v2 = min(self._power_v2, full_scale_v**2)
            course = course._replace(powers_v2=np.minimum(course.powers_v2, most_v2))
        highest_v2 = float(course.powers_v2.max(initial=0.0))
        if not highest_v2 <= ROUNDING * full_scale_v**2:
            self.rest()
            raise HapticError(
                "beyond_full_scale",
                f"{highest_v2**0.5:g} V does not fit a carrier of {full_scale_v:g} V",
                "the stages before it should not have asked for that; look at the rig's limits",
            )
        gaps = self._output.gaps
        try:
            self._write(course, full_scale_v, lead_s)
        except OutputUnderrun:
            self._power_v2 = 0.0
            self.underruns += 1
            return False
        self.underruns += self._output.gaps - gaps
        return self._output.gaps == gaps

    def rest(self) -> None:
        """Zero amplitude at once, whatever is waiting."""
        self._waiting_s = self.drained_s = 0.0
        if not self._resting:
            self._power_v2 = 0.0
            # it tries again by itself, and without a carrier it does nothing
            with suppress(DeviceError):
                self._output.zero()
                self._resting = True

    def _write(self, course: Course, full_scale_v: float, lead_s: float) -> None:
        self._output.check()
        waiting_s = self._output.buffered_s
        self.drained_s = max(self._waiting_s - waiting_s, 0.0)
        self._waiting_s = waiting_s
        samples = self._length(course.span_s, waiting_s, lead_s)
        if samples < 1:
            return
        begin_v2 = self._power_v2
        ends_v2 = course.powers_v2 if course.span_s > 0.0 else np.array([begin_v2])
        if waiting_s <= 0.0 or self._catching_up:
            wanted_v2, ends_v2 = ends_v2, self._bounded(begin_v2, ends_v2, samples / self._rate_hz)
            self._catching_up = bool(ends_v2[-1] < wanted_v2[-1])
        envelope_v = np.empty(samples)
        synthesise(np.concatenate(((begin_v2,), ends_v2)), envelope_v)
        # a root of a square may be larger by rounding
        share = np.minimum(envelope_v / full_scale_v, 1.0)
        self._resting = False
        self._output.write(self._modulation.full_scale_v * (2.0 * share - 1.0), self._rate_hz)
        self._power_v2 = float(ends_v2[-1])
        self._waiting_s = waiting_s + samples / self._rate_hz

    def _bounded(self, begin_v2: float, ends_v2: Array, span_s: float) -> Array:
        """What a course may come to where nobody knows how far the finger has gone meanwhile."""
        after_s = span_s * np.arange(1, ends_v2.size + 1) / ends_v2.size
        bound_v = math.sqrt(begin_v2) + self._rise_v_per_s * after_s
        return np.asarray(np.minimum(ends_v2, bound_v**2))

    def _length(self, span_s: float, waiting_s: float, lead_s: float) -> int:
        """How many samples of the stream a course takes.

        It takes one more or less than its time where the stream is too short or too long: all at
        once would bend it.
        """
        short_s = lead_s - waiting_s - span_s
        if waiting_s <= 0.0 or abs(short_s) > 0.5 * lead_s:
            return round((lead_s - waiting_s) * self._rate_hz)
        samples = round(span_s * self._rate_hz)
        if samples and abs(short_s) * self._rate_hz >= 1.0:
            samples += 1 if short_s > 0.0 else -1
        return samples
