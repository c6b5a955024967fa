"""The process that writes envelopes to an analog output: no other Python thread can keep it
waiting.

    python -m haptic_driver.daemon.envelope_process DESCRIPTOR PARENT < settings

takes pickled `EnvelopeSettings` from standard input and says when its output is open, at zero. From
then on it runs until its parent is gone, which leaves zero. What its output cannot do it says in
`played`, and ends.
"""

from __future__ import annotations

import math
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

from haptic_driver.daemon.output_pump import may_go_out
from haptic_driver.errors import HapticError, message_of
from haptic_driver.processes import parent, real_time
from haptic_driver.processes.compilation import compilation_said
from haptic_driver.processes.real_time import BEFORE_RENDER, Metronome
from haptic_driver.processes.shared_memory import Played, SharedState
from haptic_driver.render.compiled import refuse_to_compile
from haptic_driver.rig.envelope_writer import EnvelopeWriter, Lead, warm_up
from haptic_driver.rig.part import Wiring
from haptic_driver.rig.parts.analog_outputs import SomeAnalogOutput
from haptic_driver.signals import NO_COURSE, TICK_S, Course
from hw.analog.output import AnalogOutput
from hw.generator.settings import ModulationInput

BEHIND_S = 0.0003  # of a tick: by then render has said what it wants
BEAT_S = 0.05  # at most so long nothing is said


@dataclass(frozen=True)
class EnvelopeSettings:
    """The section of a rig's file that names the output, and what Modulation In does.

    `rise_v_per_s`: no faster after a gap.
    """

    section: SomeAnalogOutput
    modulation: ModulationInput
    rise_v_per_s: float

    def output(self) -> tuple[AnalogOutput, Callable[[], object]]:
        """The output, which nobody but its writer looks at, and what opens it."""
        part = self.section.make(Wiring())
        assert part is not None  # its section is not that of none
        return _unwatched(part.device), lambda: [step() for step in part.opening]


def _unwatched(output: AnalogOutput) -> AnalogOutput:
    output.watched = False
    return output


class EnvelopeLoop:
    """What the process does every millisecond, without the waiting."""

    def __init__(
        self, shared: SharedState, writer: EnvelopeWriter, lead: Lead, earlier_underruns: int = 0
    ) -> None:
        self._shared = shared
        self._writer = writer
        self._lead = lead
        self._earlier = earlier_underruns
        self._place = shared.courses.position
        self._whole_s = -math.inf
        self._said_s = -math.inf
        self._said: Played | None = None
        self.writing = False

    def turn(self, now_s: float, late_s: float = 0.0, missed: int = 0) -> None:
        """Go on with what render wants, if it may go out.

        `late_s`: how long after this turn was due; `missed`: how many before it were left out.
        Raises DeviceError and HapticError, said in `played`.
        """
        try:
            waited_s = late_s + missed * TICK_S
            self._lead.notice(now_s, max(waited_s, self._writer.drained_s - TICK_S))
            driven, output = self._shared.driven.read(), self._shared.output.read()
            course = self._course(driven.gate)
            self.writing = may_go_out(driven.gate, output, now_s)
            if not self.writing:
                self._writer.rest()
                self._lead.choose()
            elif math.isfinite(driven.carrier_hz):
                out = driven.carrier_hz, driven.full_scale_v
                may_rise = out == (output.frequency_hz, output.full_scale_v)
                # where the course ends is counted from when the turn was due
                lead_s = self._lead.lead_s - late_s
                if not self._writer.go_on(course, driven.full_scale_v, lead_s, may_rise):
                    self._whole_s = now_s + lead_s  # until what bridges the gap has been played
        except HapticError as error:
            self._say(now_s, message_of(error))
            raise
        self._say(now_s)

    def _course(self, gate: int) -> Course:
        """What render wants of an envelope since the last time, for orders that are let out."""
        taken = self._shared.courses.read(self._place)
        self._place = taken.position
        courses = taken.samples[taken.samples["order"] >= gate]["powers_v2"]
        return Course(courses.ravel(), len(courses) * TICK_S) if courses.size else NO_COURSE

    def _say(self, now_s: float, failure: str = "") -> None:
        underruns = self._earlier + self._writer.underruns
        lead_s = self._lead.lead_s + self._writer.latency_s
        played = Played(now_s, underruns, self._whole_s, lead_s, failure)
        is_news = self._said is None or played[1:] != self._said[1:]
        if is_news or now_s - self._said_s >= BEAT_S:
            self._said, self._said_s = played, now_s
            self._shared.played.write(played)


def main() -> None:
    """Run the process until its parent is gone."""
    descriptor, started_by = int(sys.argv[1]), int(sys.argv[2])
    settings: EnvelopeSettings = parent.given()
    shared = SharedState(descriptor)
    output, open_output = settings.output()
    section = settings.section
    with compilation_said("envelope process", parent.still):
        warm_up()
    refuse_to_compile()
    open_output()
    rate_hz = output.plays_at(section.envelope_rate_hz)
    writer = EnvelopeWriter(output, settings.modulation, rate_hz, settings.rise_v_per_s)
    granted = real_time.enter(BEFORE_RENDER)
    real_time.never_collect()
    lead = Lead(section.lead_s, section.buffer_s)
    loop = EnvelopeLoop(shared, writer, lead, shared.played.read().underruns)
    loop.turn(time.monotonic())
    parent.tell(granted._asdict())
    beat, followed = Metronome(TICK_S), False
    try:
        while os.getppid() == started_by:
            due = beat.wait()
            loop.turn(time.monotonic(), due.lateness_s, due.missed)
            if loop.writing and not followed:  # from here on right behind render's ticks
                beat = Metronome(TICK_S, began_s=shared.output.read().time_s + BEHIND_S)
            followed = loop.writing
    finally:
        output.close()


if __name__ == "__main__":
    main()
