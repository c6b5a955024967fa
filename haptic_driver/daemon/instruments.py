"""What control holds of a rig: its output, its sensors, and the watchdog that switches off when control dies."""

from __future__ import annotations

import socket
from collections.abc import Callable, Mapping

from haptic_driver.config import RigConfig
from haptic_driver.daemon.shared_state import Sensed
from haptic_driver.daemon.simulated_lines import SCALE, SCREEN, Lines
from haptic_driver.rig import Rig, RigEvent, build_rig
from hw.finger_tracker import FingerTracker, TouchEvents, TouchScreen
from hw.force_sensor import ForceAxes, ForceSensor
from hw.net_ft import NetFt, NetFtSettings
from hw.transport.tcp import TcpTransport
from hw.watchdog import Watchdog, WatchdogSettings

SENSOR_PERIOD_S = 0.001
WATCHDOG_GIVE_UP_S = 1.0  # a simulated generator that is gone will not come back at the same address


class Instruments:
    """A connected rig with its sensors and its watchdog; `sensor_period_s` is how often the sensors have news."""

    def __init__(
        self, rig: Rig, tracker: FingerTracker, force_sensor: ForceSensor, watchdog: Watchdog,
        close: Callable[[], object], sensor_period_s: float = SENSOR_PERIOD_S,
    ) -> None:  # fmt: skip
        self.rig = rig
        self.sensor_period_s = sensor_period_s
        self._tracker = tracker
        self._force_sensor = force_sensor
        self._watchdog = watchdog
        self._close = close

    def read(self) -> Sensed:
        """What the sensors say now. Raises DeviceError."""
        finger, force = self._tracker.read(), self._force_sensor.read()
        return Sensed(
            finger.time_s, finger.position_x_m, finger.position_y_m, finger.touching,
            force.time_s, force.normal_force_n, force.lateral_force_n, force.saturated,
        )  # fmt: skip

    def check_watchdog(self) -> None:
        """Raise DeviceError when the watchdog is not there; not to be asked while the output is on."""
        self._watchdog.beat()
        self._watchdog.rest()

    def restart_watchdog(self) -> None:
        """Let go of one that has ended, and start another. Raises DeviceError."""
        self._watchdog.close()
        self._watchdog.start()

    @property
    def watchdog_pid(self) -> int | None:
        """Its process id."""
        return self._watchdog.pid

    def close(self) -> bool | None:
        """Switch off and hang up; whether the output is on (None: unknown). Never raises."""
        evidence = self.rig.close()
        self._watchdog.close()
        self._close()
        return evidence.output_on


def connect_simulated(
    config: RigConfig, endpoints: Mapping[str, str], on_event: Callable[[RigEvent], None]
) -> Instruments:
    """The real drivers on the simulated instruments at `endpoints`. Raises HapticError and DeviceError."""
    watchdog = Watchdog(WatchdogSettings(endpoints["waveform_generator"], give_up_s=WATCHDOG_GIVE_UP_S))
    lines = Lines(TcpTransport.from_resource(endpoints["amplifier_lines"]))
    host, port = endpoints["force_sensor"].split(":")
    force_sensor = NetFt(NetFtSettings(host, SCALE, ForceAxes("-z", "x"), port=int(port)))
    host, port = endpoints["touch_screen"].split(":")
    connection = socket.create_connection((host, int(port)))
    screen = TouchScreen(
        connection.fileno(), TouchEvents(None), SCREEN, name="simulated touch screen", close=connection.close
    )
    transport = TcpTransport.from_resource(endpoints["waveform_generator"])
    rig = build_rig(config, transport, force_sensor, lines, lines, heartbeats=[watchdog], on_event=on_event)

    def close() -> None:
        force_sensor.close()
        screen.close()
        lines.close()

    instruments = Instruments(rig, screen, force_sensor, watchdog, close)
    try:
        rig.connect()
        force_sensor.open()
        watchdog.start()
    except BaseException:
        instruments.close()
        raise
    return instruments
