"""What control holds of a rig: its output, its sensors, and the watchdog that switches off when
control dies.
"""

from __future__ import annotations

from collections.abc import Callable

from haptic_driver.daemon.readings import Readings, touch_estimate, with_electrode, with_monitors
from haptic_driver.errors import BadInputError
from haptic_driver.live.current_sensor import Carried, ElectrodeWatch, ReadElectrode
from haptic_driver.processes.shared_memory import Sensed
from haptic_driver.rig.actuator import make_actuator
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.devices import Devices, connect_devices
from haptic_driver.rig.evidence import KnownOutput
from haptic_driver.rig.load_loop import LoadSensor
from haptic_driver.rig.states import RigEvent
from hw.finger.tracker import FingerTracker
from hw.monitor.contract import ElectrodeReading

SENSOR_PERIOD_S = 0.001


class Instruments:
    """The open devices of a rig as control uses them, real or simulated; `sensor_period_s`: how
    often to `read`.
    """

    def __init__(
        self, config: RigConfig, devices: Devices, tracker: FingerTracker, electrode: ReadElectrode
    ) -> None:
        self.devices = devices
        self._config, self._electrode = config, electrode
        self._watch: ElectrodeWatch | None = None
        self.rig = devices.rig
        self.actuator = make_actuator(config, devices.rig)
        self.sensor_period_s = SENSOR_PERIOD_S
        self._readings = Readings(
            config, tracker.read, devices.force_sensor.read, disown=devices.disown
        )

    def read(self) -> Sensed:
        """What the sensors say now. Raises DeviceError; NotBelieved for what cannot be true."""
        sensed = with_monitors(self._readings.read(), self.rig.seen_monitors)
        return sensed if self._watch is None else with_electrode(sensed, self._watch.newest())

    def watch_electrode(
        self, carrier: Callable[[], Carried | None], model: Callable[[], str]
    ) -> None:
        """Read the electrode while something is driven; and estimate load and friction from its
        current, where there is no force sensor.
        """
        if any(not monitor.drives for monitor in self._config.electrode_monitors):
            estimate = touch_estimate(self._config, model)
            self._watch = ElectrodeWatch(self._electrode, carrier, estimate)
            self._watch.start()

    def check_watchdog(self) -> None:
        """Raise DeviceError when there should be a watchdog and is none; not to be asked while the
        output is on.
        """
        if self.devices.watchdog is not None:
            self.devices.watchdog.beat()
            self.devices.watchdog.rest()

    def restart_watchdog(self) -> None:
        """Let go of one that has ended, and start another. Raises DeviceError."""
        if self.devices.watchdog is not None:
            self.devices.watchdog.close()
            self.devices.watchdog.start()

    @property
    def watchdog_pid(self) -> int | None:
        """Its process id; None without one."""
        return None if self.devices.watchdog is None else self.devices.watchdog.pid

    def close(self) -> KnownOutput:
        """Switch off and hang up; what was known of the output then. Never raises."""
        self.devices.rig.off()
        if self._watch is not None:
            self._watch.close()
        return self.devices.close()


def connect(
    config: RigConfig, on_event: Callable[[RigEvent], None], before: LoadSensor | None = None
) -> Instruments:
    """The devices that a rig's file names, open. Raises HapticError and DeviceError.

    A real force sensor takes its bias: leave it unloaded. It keeps that of the one `before`, where
    there was one.
    """
    devices = connect_devices(
        config, on_event=on_event, before=before, envelope=False, load_stage=True
    )
    if devices.tracker is None:
        raise BadInputError(
            "no_finger_tracker",
            f"rig {config.name} names no finger tracker: nobody tells where the finger is",
            'add a section [finger_tracker], with kind "stage", "evdev" or "recorded"',
        )

    def electrode(frequency_hz: float) -> ElectrodeReading | None:
        i = config.electrode_monitor(frequency_hz)
        return (
            None
            if i is None
            else devices.electrode_monitors[i].read(frequency_hz, config.limits.voltage_v)
        )

    instruments = Instruments(config, devices, devices.tracker, electrode)
    devices.open()
    return instruments
