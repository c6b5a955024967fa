"""What is known about the output after switching it off, and how one finds out."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from hw.amplifier.analog import AmplifierState, AnalogAmplifier
from hw.errors import DeviceError
from hw.generator.contract import Generator

MONITOR_QUIET_V = 5.0  # at the electrode; what a monitor may read without anything being on
MONITOR_POLL_S = 0.01

Found = TypeVar("Found")

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class OffEvidence:
    """What is known about the output after switching it off; None where nothing could be learnt."""

    generator_off: bool | None
    amplifier: AmplifierState
    monitor_v: float | None

    @property
    def output_on(self) -> bool | None:
        """False only with evidence: generator or enable line say off, and the monitor does not see
        a voltage.
        """
        if self.monitor_v is not None and abs(self.monitor_v) > MONITOR_QUIET_V:
            return True
        if self.generator_off or self.amplifier is AmplifierState.DISABLED:
            return False
        return None if self.generator_off is None else True

    def __str__(self) -> str:
        generator = {
            True: "generator says off",
            False: "generator says ON",
            None: "generator does not answer",
        }
        monitor = (
            "no monitor" if self.monitor_v is None else f"monitor reads {self.monitor_v:.3g} V"
        )
        return f"{generator[self.generator_off]}, amplifier {self.amplifier.value}, {monitor}"


NOTHING_KNOWN = OffEvidence(None, AmplifierState.UNKNOWN, None)


def tried(step: Callable[[], Found], otherwise: Found) -> Found:
    """One step on the way off; whatever fails in it is logged, and keeps nobody from the next."""
    try:
        return step()
    except (Exception, SystemExit) as error:
        _log.warning("on the way off: %s", error, exc_info=not isinstance(error, DeviceError))
        return otherwise


def switch_off(
    generator: Generator,
    amplifier: AnalogAmplifier,
    settle_s: float,
    sleep: Callable[[float], None],
) -> OffEvidence:
    """Off, and a look at what came of it: no lock, no check. Never raises: what fails in any way is
    unknown.

    The enable line goes first, since it is fast, and once more last, for those who raised it
    meanwhile. A real electrode takes time to discharge: the monitor has `settle_s` to become quiet.
    """
    tried(amplifier.disable, AmplifierState.UNKNOWN)
    generator_off = tried(generator.off, None)
    state = tried(amplifier.disable, AmplifierState.UNKNOWN)
    voltage_v = tried(amplifier.monitor_voltage_v, None)
    for _ in range(round(settle_s / MONITOR_POLL_S)):
        if voltage_v is None or abs(voltage_v) <= MONITOR_QUIET_V:
            break
        sleep(MONITOR_POLL_S)
        voltage_v = tried(amplifier.monitor_voltage_v, None)
    return OffEvidence(generator_off, state, voltage_v)
