"""What the monitors of a simulated rig see of the electrode, whatever makes time pass."""

from __future__ import annotations

from math import pi

from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.parts.electrode_monitors import SimulatedElectrodeMonitorConfig
from haptic_driver.simulation.finger_model import ElectrodeLaw
from haptic_driver.simulation.instruments import SINE_WITHOUT_BIAS, SimulatedInstruments
from hw.monitor.contract import ElectrodeReading
from hw.monitor.lines import SampledMonitor
from hw.monitor.simulated import ElectrodeState, SimulatedInputs, SimulatedLines


class SimulatedElectrode:
    """The electrode under the finger of `instruments`, by a law; without one it shows nothing.

    `touch_gain` multiplies the current of the touch, beside that of `stray_f`, where that is known.
    """

    def __init__(
        self,
        config: RigConfig,
        instruments: SimulatedInstruments,
        law: ElectrodeLaw | None,
        stray_f: float | None = None,
    ) -> None:
        self._config, self._instruments = config, instruments
        self._law, self._stray_f = law, stray_f
        self.touch_gain = 1.0
        self._seen: ElectrodeState | None = None  # what the monitors look at
        lines, amplifier = config.amplifier.monitor_lines(), config.amplifier
        noise_v = amplifier.voltage_monitor_noise_v, amplifier.current_monitor_noise_v
        simulated = SimulatedLines(lambda: self._seen, lines, noise_v, config.simulation.seed)
        self._monitors = {
            i: SampledMonitor(_inputs(section, simulated), lines, section.sampling())
            for i, section in enumerate(config.electrode_monitors)
            if isinstance(section, SimulatedElectrodeMonitorConfig)
        }

    def read(self, frequency_hz: float, voltage_v: float) -> ElectrodeReading | None:
        """The present reading of the first monitor that measures this carrier; None where that is
        not simulated, or nothing is known.
        """
        i = self._config.electrode_monitor(frequency_hz)
        monitor = None if i is None else self._monitors.get(i)
        self._seen = None if monitor is None else self._state()
        if monitor is None or self._seen is None:
            return None
        return monitor.read(frequency_hz, voltage_v)

    def _state(self) -> ElectrodeState | None:
        if self._law is None:
            return None
        instruments, plant = self._instruments, self._instruments.plant
        frequency_hz, voltage_v, *bias = instruments.stimulus()
        told = () if tuple(bias) == SINE_WITHOUT_BIAS else bias
        load_n, speed_m_s = plant.normal_force_n, instruments.speed_m_s
        state = self._law(frequency_hz, voltage_v, load_n, speed_m_s, plant.time_s, *told)
        if state is None or self._stray_f is None:
            return state
        stray_a = 2j * pi * frequency_hz * self._stray_f * state.voltage_v
        return state._replace(current_a=stray_a + self.touch_gain * (state.current_a - stray_a))


def _inputs(section: SimulatedElectrodeMonitorConfig, lines: SimulatedLines) -> SimulatedInputs:
    return SimulatedInputs(
        lines, section.sample_rate_hz, section.range_v, section.resolution_v, section.buffer_s
    )
