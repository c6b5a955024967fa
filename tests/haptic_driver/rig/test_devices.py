"""A rig's file becomes devices: every driver of a real rig, on instruments served over their own
wires.
"""

import dataclasses
import datetime
import hashlib
import threading
import time
from contextlib import suppress
from typing import ClassVar

import numpy as np
import pytest

from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.rig.config import load_rig
from haptic_driver.rig.devices import calibration_ids, connect_devices
from haptic_driver.rig.parts.finger_trackers import EvdevFingerConfig
from haptic_driver.rig.parts.interlocks import InterlockBox
from haptic_driver.rig.states import RigState
from haptic_driver.signals import DriveCommand
from hw.errors import DeviceError, DeviceTimeout
from hw.transport import resource
from tests.haptic_driver import stand_ins
from tests.haptic_driver.config_texts import as_real_rig, changed
from tests.haptic_driver.stand_ins import living_rig
from tests.waiting import until

pytestmark = pytest.mark.process

ON = DriveCommand(250.0, 80.0, True)


@pytest.fixture
def served(rig_config, touch):
    with living_rig(rig_config, touch) as rig:
        yield rig


def drive_until(devices, condition):
    def driven():
        devices.rig.command(time.monotonic(), ON)
        return condition()

    until(driven)


def touching(devices):
    """Whether the finger touches; not known while a busy machine brings positions too late to be
    used.
    """
    with suppress(DeviceTimeout):
        return devices.tracker.read().touching
    return False


def test_a_whole_rig_comes_on_is_felt_and_goes_off(rig_config, served):
    config = served.config
    devices = connect_devices(config)
    with devices:
        assert devices.rig.state is RigState.OFF
        assert served.amplifier.max_voltage_v == 0.0
        assert not devices.tracker.read().touching  # the stage is not homed
        devices.stage.home()
        until(lambda: touching(devices))
        drive_until(devices, lambda: served.amplifier.voltage_v == pytest.approx(80.0, rel=1e-3))
        assert served.interlock.closed
        assert devices.rig.state is RigState.ON
        finger = devices.tracker.read()
        assert finger.position_x_m == pytest.approx(0.0, abs=1e-4)  # home
        assert finger.position_y_m == 0.03
        force_n = devices.force_sensor.read().normal_force_n
        assert force_n == pytest.approx(0.5, abs=0.05)  # ServedRig's finger, its noise 3 mN
        watchdog = devices.watchdog.pid
        assert watchdog is not None
    assert served.amplifier.voltage_v == 0.0
    assert not served.interlock.closed
    assert not served.generator.output().on
    assert devices.watchdog.pid is None


def test_without_a_force_sensor_the_load_is_held_and_friction_unknown(tmp_path):
    path = tmp_path / "without.toml"
    said = '\n[force_sensor]\nkind = "none"\nload_n = 0.4\n[watchdog]\ngenerator = "none"\n'
    path.write_text(as_real_rig("TCPIP::127.0.0.1::1::SOCKET") + said)
    config = load_rig(str(path))
    reading = connect_devices(config).force_sensor.read()
    assert (reading.normal_force_n, reading.saturated) == (0.4, False)
    assert np.isnan(reading.lateral_force_n)
    assert not config.friction_from_current


def test_the_amplifier_that_is_opened_is_the_one_that_is_switched(tmp_path, monkeypatch):
    """A second one had been made, whose fault line nobody opened or closed."""
    made = []

    class Line:
        def __init__(self, name):
            made.append(name)

        def open(self):
            pass

        close = open

    monkeypatch.setattr("hw.analog.ni_daq.NiDigitalInput", Line)
    path = tmp_path / "fault.toml"
    said = '\n[force_sensor]\nkind = "none"\n[watchdog]\ngenerator = "none"\n'
    text = as_real_rig("TCPIP::127.0.0.1::1::SOCKET") + said
    path.write_text(changed(text, ("[amplifier]", '[amplifier]\nfault_line = "Dev1/port0/line3"')))
    connect_devices(load_rig(str(path)))
    assert made == ["Dev1/port0/line3"]


def test_what_fails_on_the_way_closes_what_was_opened(rig_config, served):
    config = served.config
    config = config.model_copy(
        update={"force_sensor": config.force_sensor.model_copy(update={"port": 1})}
    )
    devices = connect_devices(config)
    with pytest.raises(DeviceError), devices:
        pytest.fail("opened without a force sensor")
    assert devices.watchdog.pid is None
    with connect_devices(served.config):  # every port is free again
        pass


def test_a_box_that_answers_late_at_the_start_is_asked_again(rig_config, served, monkeypatch):
    handle, unheard = served.interlock.handle, [b"ID?\n"] * 2

    def late(data):
        if data in unheard:
            unheard.remove(data)
            return b""
        return handle(data)

    monkeypatch.setattr(served.interlock, "handle", late)
    monkeypatch.setattr(stand_ins, "PATIENCE_S", 1.0)
    config = served.config
    patient = InterlockBox.model_construct(
        kind="box", resource=config.interlock.resource, reply_timeout_s=0.1
    )
    with connect_devices(config.model_copy(update={"interlock": patient})) as devices:
        assert devices.rig.state is RigState.OFF
    assert unheard == []


def fails():
    raise RuntimeError("driver gone")


def exits():
    raise SystemExit(3)


def hangs():
    threading.Event().wait()


@pytest.mark.parametrize("closing", [fails, exits, hangs])
def test_a_close_that_fails_exits_or_hangs_skips_no_other(rig_config, served, monkeypatch, closing):
    closed = []
    if closing is hangs:
        monkeypatch.setattr("haptic_driver.rig.devices.CLOSE_S", 2.0)  # enough for the others
    devices = connect_devices(served.config)
    devices = dataclasses.replace(
        devices, closing=[closing, lambda: closed.append("last"), *devices.closing]
    )
    with devices:
        pass
    assert closed == ["last"]
    assert devices.watchdog.pid is None


def test_an_unverified_rig_connects_and_refuses_to_come_on(rig_config, served):
    config = served.config
    config = config.model_copy(
        update={"limits": config.limits.model_copy(update={"measured_by": ""})}
    )
    with connect_devices(config) as devices:
        with pytest.raises(HapticError) as error:
            devices.rig.command(time.monotonic(), ON)
        assert error.value.code == "unverified"
        assert "limits.measured_by" in error.value.message
    assert served.amplifier.max_voltage_v == 0.0


def test_a_rig_that_is_simulated_or_feels_nothing_has_no_devices(rig_config):
    with pytest.raises(BadInputError, match="simulated"):
        connect_devices(rig_config)
    without = load_rig("template").model_copy(update={"force_sensor": None, "analog_inputs": None})
    with pytest.raises(BadInputError, match="force sensor"):
        connect_devices(without)


# --- a card for gauges and monitors
# ------------------------------------------------------------------------------

AXES = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
CARD = """
[analog_inputs]
sample_rate_hz = 10e3
monitor_window_s = 0.02
[force_sensor]
kind = "ni"
gauges = ["Dev1/ai0", "Dev1/ai1", "Dev1/ai2", "Dev1/ai3", "Dev1/ai4", "Dev1/ai5"]
calibration_file = "unity.cal"
samples_per_reading = 10
samples_per_bias = 100
normal_axis = "-z"
lateral_axis = "x"
[[electrode_monitors]]
kind = "card"
conversion_interval_s = 5e-6
[watchdog]
generator = "none"
"""


class Card:
    """Stands in for `NiAnalogInputs`: sines on its channels, 1 N per V on the gauges once
    `loaded`.
    """

    made: ClassVar[list["Card"]] = []
    loaded = False

    def __init__(self, channels, *, sample_rate_hz, **rest):
        self.channels, self.sample_rate_hz, self.buffer_s = (
            tuple(channels),
            sample_rate_hz,
            rest["buffer_s"],
        )
        self.opened = self.closed = 0
        Card.made.append(self)

    def open(self):
        self.opened += 1

    def close(self):
        self.closed += 1

    resource = "the card"

    def held(self):
        return []

    def columns(self, names, conversion_interval_s=0.0):
        return _Columns(self, self.places(names), conversion_interval_s)

    def places(self, names):
        return [self.channels.index(name) for name in names]

    def latest_v(self, count):
        time_s = np.arange(count) / self.sample_rate_hz
        gauges_v = np.tile([0.3, 0.0, -0.5, 0.0, 0.0, 0.0], (count, 1)) * self.loaded + 0.1
        monitors_v = np.outer(np.sin(2.0 * np.pi * 250.0 * time_s), [0.8, 0.02])
        return np.hstack([monitors_v, gauges_v])


class _Columns:
    def __init__(self, card, columns, interval_s):
        self.card, self.columns = card, columns
        self.sample_rate_hz, self.buffer_s = card.sample_rate_hz, card.buffer_s
        self.lags_s = [interval_s * column for column in columns]

    def latest_v(self, count):
        return self.card.latest_v(count)[:, self.columns]


def test_gauges_and_monitors_share_one_task_and_monitors_tell_the_peak(
    tmp_path, monkeypatch, served
):
    rows = "".join(
        f'<UserAxis Name="{name}" values="{" ".join(str(float(i == j)) for j in range(6))}"'
        ' max="50"/>'
        for i, name in enumerate(AXES)
    )
    (tmp_path / "unity.cal").write_text(
        '<FTSensor Serial="FT1" NumGages="6"><Calibration PartNumber="SI" CalDate="1/1/2024"'
        ' ForceUnits="N" TorqueUnits="N-m" DistUnits="m"'
        f' OutputRange="20">{rows}</Calibration></FTSensor>'
    )
    lines = 'voltage_monitor = "Dev1/ai6"\ncurrent_monitor = "Dev1/ai7"\n'
    real = as_real_rig(served.endpoints["waveform_generator"])
    band = ("frequency_hz = [1.0, 1e6]", "frequency_hz = [1.0, 4e3]")  # what the card's rate tells
    text = (
        changed(real, ("voltage_monitor_v_per_v", lines + "voltage_monitor_v_per_v"), band) + CARD
    )
    (tmp_path / "card.toml").write_text(text, encoding="utf-8")
    monkeypatch.setattr("hw.analog.ni_daq.NiAnalogInputs", Card)
    monkeypatch.setattr(Card, "made", [])
    config = load_rig(str(tmp_path / "card.toml"))
    devices = connect_devices(config)
    (card,) = Card.made
    assert card.channels == tuple(f"Dev1/ai{i}" for i in (6, 7, 0, 1, 2, 3, 4, 5))
    assert devices.watchdog is None
    # 0.8 V peak at 0.01 V/V: 80 V at the electrode, whose mean would be 0; the rig does not take
    # that for off
    with pytest.raises(HapticError, match="monitor reads 80 V"), devices:
        pytest.fail("connected under voltage")
    assert card.closed == 1
    monkeypatch.setattr(Card, "loaded", True)
    (monitor,) = devices.electrode_monitors
    electrode = monitor.read(250.0, 80.0)
    assert not electrode.referenced  # the generator is on no channel
    assert electrode.voltage_v == pytest.approx(80.0, rel=1e-4)  # its bandwidth of 1 MHz taken out
    # 20 mV at 500 V/A; a channel later by 5 us, so the same phase on both lines is an earlier
    # current
    assert electrode.current_a == pytest.approx(4e-5 * np.exp(-2j * np.pi * 250.0 * 5e-6), rel=1e-4)
    devices.force_sensor.take_bias()
    monkeypatch.setattr(Card, "loaded", False)
    reading = devices.force_sensor.read()
    assert (reading.normal_force_n, reading.lateral_force_n) == pytest.approx((-0.5, -0.3))
    content = hashlib.sha256((tmp_path / "unity.cal").read_bytes()).hexdigest()
    assert calibration_ids(config)["force_sensor"] == f"FT1, calibrated 1/1/2024, SHA-256 {content}"


def test_a_recording_says_what_each_figure_rests_on(rig_config, served):
    real = served.config
    signed = {"limits": "simulation, 2024-01-01", "amplifier": "simulation, 2024-01-01"}
    assert calibration_ids(real) == signed | {"force_sensor": "1e+06 counts per N, 1e+06 per N m"}
    screen = EvdevFingerConfig(
        kind="evdev",
        device="/dev/input/event0",
        matrix_m=[[1e-5, 0.0, 0.0], [0.0, 1e-5, 0.0]],
        measured_at=datetime.date(2026, 3, 1),
        placeholder=True,
    )
    touched = real.model_copy(update={"finger_tracker": screen})
    assert calibration_ids(touched)["touch_screen"] == "2026-03-01, placeholder"
    unsigned = real.model_copy(
        update={"amplifier": real.amplifier.model_copy(update={"measured_by": " "})}
    )
    assert "amplifier" not in calibration_ids(unsigned)


def test_the_stage_asks_for_flow_control(rig_config, served, monkeypatch):
    """Its protocol is with RTS and CTS."""
    asked, make = {}, resource.make_transport

    def recorded(name, **given):
        asked[name] = given
        return make(name, **given)

    monkeypatch.setattr(resource, "make_transport", recorded)
    config = served.config
    connect_devices(config)
    assert asked[config.stage.resource] == {"rtscts": True}
