"""The voltage at the electrode is not what the settings say, by one factor."""

from __future__ import annotations

from dataclasses import dataclass, replace

from model.effects.base import Effect, log_parameter
from model.touch import Drive


@dataclass(frozen=True)
class DriveGainError(Effect):
    """V -> k V; a 50 ohm load setting into a high-impedance input is k = 2."""

    name = "drive_gain_error"
    stage = "drive"
    physics = "the drive chain has another gain than configured"
    signature = (
        "force scales by one factor at every frequency; friction without voltage is right; the"
        " electrode's voltage and the current scale by it too, without a phase"
    )
    check = "measure the electrode at 100 Hz with a high-impedance probe; read OUTP:LOAD?"
    removed_by = ("other_amplifier",)

    gain: float = log_parameter("1", 1.0, 1.35, (0.1, 10.0), off=1.0)

    @classmethod
    def bends_with(cls) -> tuple[str, ...]:
        """On the amplitude as well, as amplifiers' gains do."""
        return ("frequency_hz", "voltage_v")

    def drive(self, drive: Drive) -> Drive:
        return replace(
            drive,
            voltage_v=self.gain * drive.voltage_v,
            voltage_offset_v=self.gain * drive.voltage_offset_v,
        )
