"""Voltage spreads water bridges, which pull."""

from __future__ import annotations

from dataclasses import dataclass, replace

from model.effects.base import Effect, log_parameter
from model.parameters import TouchParameters
from model.support.arrays import Values
from model.touch import Contact, Drive


@dataclass(frozen=True)
class Electrowetting(Effect):
    """Extra pressure c V^2/(1 + (V/V_sat)^2), low-passed at f_c in power."""

    name = "electrowetting"
    stage = "load"
    physics = "electrowetting of moisture adds to the load"
    signature = (
        "extra force at low frequency that saturates with voltage; more current there, as under"
        " more load"
    )
    check = "wipe the finger dry; compare 10 Hz with 10 kHz"

    coefficient_pa_per_v2: float = log_parameter("Pa/V^2", 0.05, 4.0, (1e-9, 1e4), off=0.0)
    saturation_v: float = log_parameter("V", 80.0, 2.0, (0.1, 1e5), off=1.0)
    cutoff_hz: float = log_parameter("Hz", 200.0, 6.0, (1e-3, 1e9), off=1.0)

    def contact(self, contact: Contact, parameters: TouchParameters, drive: Drive) -> Contact:
        low_pass = 1.0 / (1.0 + (drive.frequency_hz / self.cutoff_hz) ** 2)
        square = self._saturating(drive.voltage_v) * low_pass + self._saturating(
            drive.voltage_offset_v
        )
        extra_pa = self.coefficient_pa_per_v2 * square
        return replace(contact, added_pressure_pa=contact.added_pressure_pa + extra_pa)

    def _saturating(self, voltage_v: Values) -> Values:
        return voltage_v**2 / (1.0 + (voltage_v / self.saturation_v) ** 2)
