"""What is known about an output that was switched off, since when, and how one finds out."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

from hw.amplifier.analog import AmplifierState, AnalogAmplifier
from hw.errors import DeviceError
from hw.generator.contract import Generator

MONITOR_QUIET_V = 5.0  # at the electrode; what a monitor may read without anything being on
MONITOR_POLL_S = 0.01
# So long an answer counts: what was true once is no evidence for long.
FRESH_S = 1.0

Found = TypeVar("Found")

_log = logging.getLogger(__name__)


class Clock(NamedTuple):
    """How a rig tells the time, and waits."""

    now_s: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep


REAL_TIME = Clock()


class KnownOutput(NamedTuple):
    """What can be said of an output at the moment of asking; as text with who said so, and when.

    `on` is None where nobody knows. `age_s` is that of the oldest answer it rests on; None where it
    rests on none.
    """

    on: bool | None
    by: OffEvidence | str
    age_s: float | None = None

    def __str__(self) -> str:
        verdict = {True: "ON", False: "off", None: "UNKNOWN"}[self.on]
        since = "" if self.age_s is None else f", {self.age_s:.1f} s ago"
        return f"{verdict} ({self.by}{since})"


COMMANDED_ON = KnownOutput(True, "commanded")
NOBODY_ASKED = KnownOutput(None, "nobody was asked")


@dataclass(frozen=True)
class OffEvidence:
    """What instruments said of an output that was switched off; None where nothing could be learnt.

    `seen_s`: no answer is of an earlier instant, by the clock of whoever reads it.
    """

    generator_off: bool | None
    amplifier: AmplifierState
    monitor_v: float | None
    seen_s: float

    def at(self, now_s: float) -> KnownOutput:
        """What follows from it now. Once it is older than `FRESH_S` nobody knows.

        Off only where generator or enable line say off, and the monitor does not see a voltage.
        """
        if not math.isfinite(self.seen_s):
            return NOBODY_ASKED
        age_s = now_s - self.seen_s
        return KnownOutput(self._on if 0.0 <= age_s <= FRESH_S else None, self, age_s)

    def __str__(self) -> str:
        """Who said what, without a verdict."""
        generator = {
            True: "generator says off",
            False: "generator says ON",
            None: "generator does not answer",
        }
        monitor = (
            "no monitor" if self.monitor_v is None else f"monitor reads {self.monitor_v:.3g} V"
        )
        return f"{generator[self.generator_off]}, amplifier {self.amplifier.value}, {monitor}"

    @property
    def _on(self) -> bool | None:
        if self.monitor_v is not None and abs(self.monitor_v) > MONITOR_QUIET_V:
            return True
        if self.generator_off or self.amplifier is AmplifierState.DISABLED:
            return False
        return None if self.generator_off is None else True


NOTHING_KNOWN = OffEvidence(None, AmplifierState.UNKNOWN, None, -math.inf)


def tried(step: Callable[[], Found], otherwise: Found) -> Found:
    """One step on the way off, or of a look; whatever fails in it is logged, and keeps nobody from
    the next.
    """
    try:
        return step()
    except (Exception, SystemExit) as error:
        _log.warning("output: %s", error, exc_info=not isinstance(error, DeviceError))
        return otherwise


def switch_off(
    generator: Generator, amplifier: AnalogAmplifier, settle_s: float, clock: Clock
) -> OffEvidence:
    """Off, and a look at what came of it: no lock, no check. Never raises: what fails in any way is
    unknown.

    The enable line goes first, since it is fast, and once more last, for those who raised it
    meanwhile. A real electrode takes time to discharge: the monitor has `settle_s` to become quiet.
    """
    tried(amplifier.disable, AmplifierState.UNKNOWN)
    generator_off = tried(generator.off, None)
    # its answer is of now: what it was asked in vain before does not count
    seen_s = clock.now_s()
    state = tried(amplifier.disable, AmplifierState.UNKNOWN)
    voltage_v = tried(amplifier.monitor_voltage_v, None)
    for _ in range(round(settle_s / MONITOR_POLL_S)):
        if voltage_v is None or abs(voltage_v) <= MONITOR_QUIET_V:
            break
        clock.sleep(MONITOR_POLL_S)
        voltage_v = tried(amplifier.monitor_voltage_v, None)
    return OffEvidence(generator_off, state, voltage_v, seen_s)
