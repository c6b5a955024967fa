"""`haptic measure` as it is typed."""

from __future__ import annotations

import datetime
import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from haptic_driver.cli.main import main
from haptic_driver.lab.measuring.bench import SimulatedBench
from hw.amplifier.simulated import SimulatedAmplifier
from hw.errors import DeviceTimeout
from hw.force.sensor import ForceReading
from tests.haptic_driver.commands import rows_of, said_by
from tests.waiting import until

PLAN = """
name = "short"
frequency_hz = [60.0, 250.0, 1e4]
voltage_v = 75.0
normal_force_n = 0.5
speed_m_s = 0.02
voltage_off_every = 2
"""


@pytest.fixture
def plan(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "short.toml").write_text(PLAN)
    return "short.toml"


def test_json_says_what_was_measured(plan, haptic):
    words = f"measure --rig simulated --plan {plan} --out data.csv --seed 3 --json"
    done = haptic(*words.split())
    assert done.status == 0
    said = done.said
    counted = {"rows": 3, "skipped": 1, "out": "data.csv", "plan": "short", "simulated": True}
    assert said == said | counted
    assert said["duration_s"] == pytest.approx(3 * 2.75)
    assert [r["frequency_hz"] for r in said["refused"]] == [1e4]
    assert "refused: 10000 Hz, 75 V, 0.5 N, 20 mm/s: worst-case finger current" in done.err
    assert "1 rows are skipped" in done.err
    assert json.loads(Path("data.csv.meta.json").read_text())["seed"] == 3


def test_for_a_person_it_says_simulated_and_off(plan, haptic):
    out = haptic("measure", "--plan", plan, "--out", "data.csv").out
    assert "3 rows of plan 'short' on a simulated rig -> data.csv" in out
    assert "generator says off" in out


def test_strict_refuses_the_plan_and_writes_nothing(plan, refuses):
    refuses("refused", "measure", "--plan", plan, "--out", "data.csv", "--strict")
    assert not Path("data.csv").exists()


def rows() -> list[dict[str, str]]:
    return rows_of(Path("data.csv"))


def cofs() -> list[float]:
    return [float(row["cof"]) for row in rows()]


def test_effects_hide_in_a_file_or_a_rig(plan):
    command = ["measure", "--plan", plan, "--out", "data.csv", "--force"]
    said_by(*command)
    plain = cofs()
    Path("hide.toml").write_text("[series_resistance]\nresistance_ohm = 1e8\n")
    said_by(*command, "--hide", "hide.toml")
    hidden = cofs()
    assert all(a <= b for a, b in zip(hidden, plain, strict=True))
    assert min(hidden) < 0.9 * max(plain)
    rig = (Path(__file__).parents[4] / "configs" / "rigs" / "simulated.toml").read_text()
    Path("rig.toml").write_text(rig + "hide = { series_resistance = { resistance_ohm = 1e8 } }\n")
    said_by(*command, "--rig", "rig.toml")
    assert cofs() == hidden


def test_a_function_outside_the_catalogue(plan, capsys):
    Path("stranger.py").write_text(
        "def friction(f, v, load, speed, time):\n    return 2.0 * load\n"
    )
    command = ["measure", "--plan", plan, "--out", "data.csv", "--force"]
    for name in ("stranger:friction", "stranger.py:friction"):
        said_by(*command, "--finger", name)
        assert all(1.6 < cof < 2.4 for cof in cofs())
        assert {row["current_a"] + row["electrode_voltage_v"] for row in rows()} == {""}
    assert "stranger" not in Path("data.csv").read_text() + Path("data.csv.meta.json").read_text()
    Path("broken.py").write_text("def friction(f, v, load, speed, time):\n    return 1 / 0\n")
    assert main([*command, "--finger", "broken.py:friction"]) == 1
    assert "ZeroDivisionError" in capsys.readouterr().err


WITNESS = """
name = "witness"
[[points]]
frequency_hz = 250.0
voltage_v = 75.0
normal_force_n = 0.5
speed_m_s = 0.02
[[sweep]]
frequency_hz = { low = 100.0, high = 1e5, per_decade = 4 }
finger = ["none", "resting"]
"""
FINGER = """
import numpy as np

def finger(frequency_hz, voltage_v, normal_force_n, speed_m_s, time_s):
    \"\"\"47 kohm in series with 2 nF, 200 pF of leads, then 10 ohm; gain 0.9; silent.\"\"\"
    w = 2 * np.pi * frequency_hz
    touch = np.where(normal_force_n > 0.0, 1.0 / (47e3 + 1.0 / (2e-9j * w)), 0.0)
    voltage = 0.9 * voltage_v * np.ones_like(w)
    lateral = np.where(speed_m_s > 0.0, 0.7 * normal_force_n, np.nan)
    return lateral, (touch + 200e-12j * w) * voltage, voltage
"""


@pytest.mark.usefixtures("plan")
def test_a_finger_of_ones_own_has_friction_voltage_and_current():
    Path("witness.toml").write_text(WITNESS)
    Path("mine.py").write_text(FINGER)
    words = "measure --plan witness.toml --out data.csv --finger mine.py:finger"
    said = said_by(*words.split())
    assert (said["rows"], said["skipped"]) == (27, 0)
    for row in rows():
        w = 2 * np.pi * float(row["frequency_hz"])
        touch = 0.0 if row["finger"] == "none" else 1 / (47e3 + 1 / (2e-9j * w))
        voltage = 0.9 * float(row["voltage_v"])
        current = (touch + 200e-12j * w) * voltage
        for name, std, wanted in (
            ("electrode_voltage_v", "electrode_voltage_std_v", voltage),
            ("current_a", "current_std_a", abs(current)),
            ("current_phase_rad", "current_phase_std_rad", np.angle(current)),
        ):
            assert float(row[name]) == pytest.approx(wanted, rel=1e-3, abs=5 * float(row[std]))
        assert (row["cof"] != "") == (row["finger"] == "sliding")
        assert row["kramers_kronig"] == ("" if row["finger"] == "sliding" else "passes")
    stray = said["stray_capacitance"]
    assert stray["capacitance_f"] == pytest.approx(
        200e-12, abs=max(4 * stray["std_f"], 1e-3 * 200e-12)
    )
    assert json.loads(Path("data.csv.meta.json").read_text())["stray_capacitance"] == stray
    assert stray["measured_at"] == datetime.date.today().isoformat()
    # the calibration in the sidecar is no other experiment
    said_by(*words.split(), "--resume")


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        ("lateral, 1e-6", "answered 2 values"),
        ("lateral, np.nan * lateral, lateral", "a current of"),
        ("np.nan * lateral", "a lateral force of nan N"),
        ("np.concatenate([lateral, lateral])", "answered 1 values of shapes"),
        ("lateral, 'x', 1.0", "raised ValueError"),
    ],
)
def test_what_is_no_answer_of_a_finger_is_explained(plan, capsys, answer, said):
    body = f"    lateral = 0.6 * load\n    return {answer}\n"
    Path("wrong.py").write_text(f"import numpy as np\n\ndef f(f, v, load, speed, time):\n{body}")
    assert main(["measure", "--plan", plan, "--out", "data.csv", "--finger", "wrong.py:f"]) == 1
    assert said in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--hide", "short.toml"], "hide"),
        (["--finger", "nowhere:friction"], "cannot be loaded"),
        (["--finger", "json:__name__"], "not a function"),
        (["--hide", "good.toml", "--finger", "json:loads"], "Give one of them"),
    ],
)
def test_bad_options_are_named(plan, options, said, capsys):
    Path("good.toml").write_text("[series_resistance]\nresistance_ohm = 1.0\n")
    assert main(["measure", "--plan", plan, "--out", "data.csv", *options]) == 2
    assert said in capsys.readouterr().err
    assert not Path("data.csv").exists()


@pytest.mark.process
def test_interrupted_by_the_user_the_file_can_be_continued(plan):
    long = PLAN.replace("[60.0, 250.0, 1e4]", "[60.0, 250.0]") + "repeats = 1000\n"
    Path("long.toml").write_text(long)
    arguments = ["measure", "--plan", "long.toml", "--out", "data.csv", "--json"]
    begin = (  # ignored behind a nohup
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler)"
    )
    program = f"{begin}; from haptic_driver.cli.main import main; sys.exit(main({arguments!r}))"
    child = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    try:
        until(lambda: Path("data.csv").exists() and len(cofs()) >= 5)
        child.send_signal(signal.SIGINT)
        out, err = child.communicate(timeout=30.0)
    finally:
        child.kill()
    assert child.returncode == 1, err
    assert json.loads(out)["error"]["code"] == "interrupted"
    assert b"the output is off" in err
    done = len(cofs())
    assert 5 <= done < 3000
    assert any(
        f"{n} of 3000 rows".encode() in err for n in (done - 1, done)
    )  # a row may be written and not counted yet


def test_an_interrupted_measurement_says_off_only_with_evidence(plan, capsys, monkeypatch):
    """Generator and enable line fall silent as the user presses Ctrl-C."""

    def silent(self: SimulatedAmplifier) -> bool:
        raise DeviceTimeout("enable line: no answer")

    def broken(self: SimulatedBench) -> ForceReading:
        self.simulated.instruments.generator_server.close()
        monkeypatch.setattr(SimulatedAmplifier, "read", silent)
        raise KeyboardInterrupt

    monkeypatch.setattr(SimulatedBench, "read_force", broken)
    assert main(["measure", "--plan", plan, "--out", "data.csv"]) == 1
    err = " ".join(capsys.readouterr().err.split())
    assert "interrupted; 0 of 3 rows" in err
    assert "the output is UNKNOWN (generator does not answer" in err
    assert "Switch the amplifier off by hand" in err
    assert "output is off" not in err
