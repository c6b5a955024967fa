"""The doctor asks only questions, and says what it could not verify."""

import datetime
import itertools
import json
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from haptic_driver.rig.check import CheckStatus, Examination
from haptic_driver.rig.claims import Claims
from haptic_driver.rig.config import load_rig
from haptic_driver.rig.doctor import examinations, examine
from haptic_driver.rig.parts.analog_inputs import NiAnalogInputsConfig
from haptic_driver.rig.parts.electrode_monitors import InfiniiVisionConfig
from haptic_driver.rig.parts.finger_trackers import TouchAreaConfig
from haptic_driver.rig.parts.interlocks import NoInterlock
from haptic_driver.simulation.served import ServedRig
from haptic_driver.simulation.twin import as_real
from hw.errors import DeviceError
from hw.force.sensor import ForceReading
from hw.generator.agilent_33220a.simulator import Simulated33220A
from hw.health import FORCE
from hw.monitor.lines import MonitorLines
from hw.monitor.simulated import SimulatedLines
from hw.serving.tcp import TcpServer
from tests.haptic_driver.stand_ins import Heard
from tests.hw.testing.simulated_oscilloscope import SimulatedInfiniiVision

pytestmark = pytest.mark.process

PAPER = Path(__file__).parents[3] / "configs" / "rigs" / "paper.toml"
TODAY = datetime.date(2024, 6, 1)
SETTINGS = b"FUNC?;FREQ?;VOLT?;VOLT:OFFS?;VOLT:UNIT?;OUTP?;OUTP:LOAD?;AM:STAT?;SYST:ERR?\n"


@pytest.fixture
def served(rig_config, touch):
    with ServedRig(as_real(rig_config), touch) as rig:
        yield rig


def found(checks, name):
    (check,) = [check for check in checks if check.name == name]
    return check


def statuses(checks):
    return {(check.name, check.status) for check in checks}


def with_generator(config, resource):
    generator = config.waveform_generator.model_copy(
        update={"resource": resource, "reply_timeout_s": 0.2}
    )
    watchdog = config.watchdog.model_copy(update={"generator": resource})
    return config.model_copy(update={"waveform_generator": generator, "watchdog": watchdog})


def test_nothing_is_set_and_nothing_comes_on(rig_config, served):
    """Whatever is programmed stays; not one message to the generator is anything but a question."""
    served.generator.handle(b"FUNC SQU;FREQ 777;VOLT 3.3;VOLT:OFFS 0.5;BOGUS\n")
    generator = Heard(served.generator)
    before = Simulated33220A()  # the same, to compare with
    before.handle(b"FUNC SQU;FREQ 777;VOLT 3.3;VOLT:OFFS 0.5;BOGUS\n")
    with TcpServer(generator) as server:
        checks = examine(with_generator(served.config, server.resource), TODAY)
    assert generator.messages
    assert all(
        m.strip().endswith("?") and ";" not in m and " " not in m.strip()
        for m in generator.messages
    )
    assert served.generator.handle(SETTINGS) == before.handle(SETTINGS)  # the error queue too
    assert not served.generator.output().on
    assert served.amplifier.max_voltage_v == 0.0
    assert not served.interlock.closed
    assert not served.stage.moving
    assert found(checks, "output").status is CheckStatus.OK
    assert "SQU, 3.3 VPP, offset 0.5 V" in found(checks, "output").message


def test_a_sound_rig(rig_config, served):
    checks = examine(served.config, TODAY)
    assert {
        ("waveform generator", CheckStatus.OK),
        ("watchdog", CheckStatus.OK),
        ("interlock", CheckStatus.OK),
        ("force sensor", CheckStatus.OK),
        ("stage", CheckStatus.OK),
        ("amplifier", CheckStatus.NOT_VERIFIED),
        ("voltage monitor", CheckStatus.NOT_VERIFIED),
        ("limits figures", CheckStatus.OK),
        ("load setting", CheckStatus.WARNING),
        ("firmware", CheckStatus.NOT_VERIFIED),
    } <= statuses(checks)
    assert CheckStatus.FAILED not in {check.status for check in checks}
    assert "2.02-2.02-22-2" in found(checks, "firmware").message


def test_what_stays_on_without_an_interlock_is_told(rig_config, served):
    without = served.config.model_copy(update={"interlock": NoInterlock()})
    check = found(examine(without, TODAY), "interlock")
    assert check.status is CheckStatus.WARNING
    assert (
        "where the computer stops, or driver and watchdog do, the output stays on" in check.message
    )


def test_what_somebody_left_on_is_told(rig_config, served):
    served.generator.handle(b"OUTP:LOAD INF;:OUTP 1\n")
    checks = examine(served.config, TODAY)
    assert found(checks, "output").status is CheckStatus.WARNING
    assert found(checks, "load setting").status is CheckStatus.OK
    assert served.generator.handle(b"OUTP?\n") == b"1\n"  # it is somebody else's


@pytest.mark.parametrize(
    ("answers", "status"), [(True, CheckStatus.OK), (False, CheckStatus.FAILED)]
)
def test_the_electrodes_monitors_are_asked_who_they_are(rig_config, served, answers, status):
    scope = SimulatedInfiniiVision(
        SimulatedLines(lambda: None, MonitorLines(0.01, 500.0), (0.0, 0.0), 1)
    )
    with TcpServer(scope if answers else Stranger()) as server:
        section = InfiniiVisionConfig(kind="infiniivision", resource=server.resource)
        real = served.config.model_copy(update={"electrode_monitors": [section]})
        check = found(examine(real, TODAY), "electrode monitor, infiniivision")
    assert check.status is status
    assert ("DSO-X" if answers else "4711") in check.message
    assert scope.handle(b":CHAN1:RANG?\n") == b"4.000000E+01\n"  # nothing was set
    told = {one.name: (one.asked, one.got) for one in check.held}
    assert told.get(":TRIG:EDGE:SOUR") == (("EXT", "CHAN1") if answers else None)


class Stranger:
    def handle(self, data):
        return b"ACME,4711,1,1\n"


@pytest.mark.parametrize(
    ("today", "status"),
    [
        (datetime.date(2024, 1, 1), CheckStatus.OK),
        (datetime.date(2024, 12, 31), CheckStatus.OK),
        (datetime.date(2025, 1, 2), CheckStatus.WARNING),
        (datetime.date(2023, 12, 31), CheckStatus.WARNING),
    ],
)
def test_figures_age_in_a_year_and_are_not_of_the_future(rig_config, today, status):
    checks = examine(rig_config, today)  # measured 2024-01-01
    figures = [check.status for check in checks if check.name.endswith("figures")]
    assert figures == [status, status]


def test_the_monitor_is_read_in_the_range_of_the_rigs_file(monkeypatch):
    """It was once read in the card's widest range, whatever the file said."""
    asked = []

    class Absent:
        def __init__(self, channels, **how):
            asked.append((channels, how))

        resource = "Dev1/ai6"

        def places(self, channels):
            return [0]

        def open(self):
            raise DeviceError("no such card", "look at it")

        def close(self):
            asked.append("closed")

    monkeypatch.setattr("hw.analog.ni_daq.NiAnalogInputs", Absent)
    config = load_rig("paper")
    card = NiAnalogInputsConfig(sample_rate_hz=20e3, range_v=5.0, terminal="RSE", timeout_s=0.3)
    amplifier = config.amplifier.model_copy(update={"voltage_monitor": "Dev1/ai6"})
    read = config.model_copy(update={"analog_inputs": card, "amplifier": amplifier})
    checks = amplifier.examine(Examination("amplifier", read, TODAY))
    check = found(checks, "voltage monitor")
    assert check == ("voltage monitor", CheckStatus.FAILED, "no such card", "look at it", ())
    (channels, how), *closed = asked
    assert channels == ["Dev1/ai6"]
    assert (how["range_v"], how["terminal"]) == (5.0, {"Dev1/ai6": "RSE"})
    assert how["timeout_s"] == 0.3
    assert set(closed) == {"closed"}


@pytest.mark.parametrize(
    ("changed", "status", "said"),
    [
        ({}, CheckStatus.WARNING, "a placeholder"),
        ({"placeholder": False}, CheckStatus.OK, "measured on"),
        (
            {"placeholder": False, "measured_at": datetime.date(2020, 1, 1)},
            CheckStatus.WARNING,
            "days ago",
        ),
        ({"matrix_m": [[0.0] * 3] * 2}, CheckStatus.FAILED, "finger_tracker.matrix_m"),
    ],
)
def test_a_touch_screen_that_is_not_calibrated_names_the_command_that_does_it(
    changed, status, said
):
    """A matrix of zeros once ended the doctor with a traceback."""
    config = load_rig("template")
    screen = config.finger_tracker.model_copy(
        update={"measured_at": TODAY, "device": "/dev/null"} | changed
    )
    checks = list(screen.examine(Examination("finger tracker", config, TODAY)))
    check = found(checks, "touch calibration")
    assert check.status is status
    assert said in check.message
    assert ("haptic calibrate-touch" in check.hint) == (status is not CheckStatus.OK)
    assert found(checks, "touch screen").status is CheckStatus.FAILED  # /dev/null is none


@pytest.mark.parametrize("said", ["", "\n[output]\nlatency_s = 0.0\n"])
def test_a_latency_that_is_left_out_is_none_without_a_word(said, tmp_path):
    text = PAPER.read_text(encoding="utf-8")
    before, _, after = text.partition("[output]")
    after = after.partition("\n\n")[2]
    (tmp_path / "own.toml").write_text(f"{before}{said}\n{after}", encoding="utf-8")
    rig = load_rig(str(tmp_path / "own.toml"))
    name, figures = next(examinations(rig))
    checks = Examination(name, rig, TODAY).told(figures)
    told = [check for check in checks if check.name == "output"]
    assert [check.status for check in told] == ([] if said else [CheckStatus.WARNING])


AREA = TouchAreaConfig(m2_per_raw2=1e-8, log_std=0.1, measured_at=TODAY)


@pytest.mark.parametrize(
    ("tells", "area", "status"),
    [
        (True, AREA, CheckStatus.OK),
        (False, AREA, CheckStatus.FAILED),
        (None, AREA, CheckStatus.OK),
        (True, None, CheckStatus.NOT_VERIFIED),
        (False, None, None),
    ],
)
def test_a_file_that_expects_an_area_which_the_screen_does_not_tell(
    tells, area, status, monkeypatch
):
    """It was called in order, and no tick ever had an area."""
    opened = SimpleNamespace(close=lambda: None, tells_area=tells)
    monkeypatch.setattr("hw.finger.touch_screen.open_touch_reports", lambda path: opened)
    config = load_rig("template")
    screen = config.finger_tracker.model_copy(update={"area": area})
    checks = list(screen.examine(Examination("finger tracker", config, TODAY)))
    told = [check.status for check in checks if check.name == "contact area"]
    assert told == ([] if status is None else [status])


def test_asked_and_got_of_every_setting_in_one_table(haptic):
    done = haptic("doctor", "--rig", "simulated", "--json")
    assert (done.status, done.said["simulated"], done.said["ok"]) == (0, True, True)
    said = done.said["settings"]
    told = {(one["device"], one["name"]): (one["asked"], one["got"]) for one in said}
    # a 33220A as it is switched on: LOAD 50, ranging by itself
    assert told["waveform generator", "OUTP:LOAD"] == ("INF", "50")
    assert told["waveform generator", "VOLT:RANG:AUTO"] == ("0", "1")
    assert told["waveform generator", "OUTP:SYNC"] == ("1", "1")
    assert told["stage", "velocity_m_s"][1] == pytest.approx(0.02, rel=1e-6)
    assert told["amplifier", "gain_v_per_v"] == (100.0, None)  # it has no dialogue
    assert {one["as_asked"] for one in said} == {True, False, None}
    shown = haptic("doctor", "--rig", "simulated").out
    assert "asked of each device" in shown
    assert "OUTP:LOAD" in shown


def test_instruments_that_another_program_has_are_not_asked(haptic):
    """Beside a daemon the question for the force sensor put it into fault, and nobody said so."""
    daemon = Claims(load_rig("template").addresses)
    daemon.take()
    try:
        done = haptic("doctor", "--rig", "template", "--json")
    finally:
        daemon.release()
    assert done.said["error"]["code"] == "in_use"


def test_the_command_on_a_rig_that_is_not_there(haptic, tmp_path):
    """The paper's rig with addresses of this machine where nothing listens."""
    text = PAPER.read_text(encoding="utf-8").replace("192.168.0.5::5025", "127.0.0.1::9")
    (tmp_path / "away.toml").write_text(text, encoding="utf-8")
    done = haptic("doctor", "--rig", tmp_path / "away.toml", "--json")
    assert done.status == 1
    said = json.loads(done.out)
    assert said["ok"] is False
    failed = [check for check in said["checks"] if check["status"] == "failed"]
    assert any("limits.measured_by" in check["message"] for check in failed)
    assert {"waveform generator", "force sensor", "stage"} <= {check["name"] for check in failed}


@pytest.mark.parametrize(("noise_n", "status"), [(0.0, "failed"), (1e-3, "ok")])
def test_a_force_that_its_noise_does_not_move_is_told(rig_config, noise_n, status):
    count = itertools.count()
    sensor = SimpleNamespace(
        read=lambda: ForceReading(time.monotonic(), 0.5 + noise_n * next(count), 0.0, False)
    )
    check = Examination("force readings", rig_config, TODAY).heard(sensor, FORCE)
    assert (check.status.value, "frozen" in check.message) == (status, status == "failed")
