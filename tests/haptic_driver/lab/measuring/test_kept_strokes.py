"""Strokes that a measured plan keeps, against what the simulated sensors gave."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from haptic_driver.cli.main import main
from haptic_driver.lab.measuring.bench import SimulatedBench
from haptic_driver.lab.measuring.benches import bench_for
from haptic_driver.lab.measuring.data_file import DataFile
from haptic_driver.lab.measuring.plan import Plan, Setting
from haptic_driver.lab.measuring.run import READING_S, prepare, run
from haptic_driver.lab.measuring.stroke import stroke
from haptic_driver.lab.strokes.file import KeptStroke, StrokesFile, read_strokes, strokes_path
from haptic_driver.recording import records
from haptic_driver.rig.config import RigConfig, load_rig
from haptic_driver.rig.part import NoPart
from hw.force.sensor import ForceReading
from model.touch_model import TouchModel
from tests.haptic_driver.commands import rows_of
from tests.haptic_driver.lab.strokes.stroke_files import ABOUT
from tests.waiting import until

DRIVEN = Setting(250.0, 75.0, 0.5, 0.02)


def plan(*settings: Setting) -> Plan:
    return Plan(
        name="short",
        settings=settings,
        randomise=False,
        voltage_off_every=1,
        settle_s=0.2,
        average_s=0.5,
        pause_s=0.1,
    )


class Watched(SimulatedBench):
    """Remembers what its force sensor said, row by row."""

    def __init__(self, *arguments: object, **named: object) -> None:
        super().__init__(*arguments, **named)  # type: ignore[arg-type]
        self.said: list[list[ForceReading]] = []

    def begin_row(self, number, row):  # type: ignore[no-untyped-def]
        super().begin_row(number, row)
        self.said.append([])

    def read_force(self) -> ForceReading:
        reading = super().read_force()
        self.said[-1].append(reading)
        return reading


def kept(
    config: RigConfig, model: TouchModel, given: Plan, out: Path
) -> tuple[Watched, tuple[KeptStroke, ...]]:
    experiment = prepare(config, model, given)
    bench = Watched(config, model, seed=1)
    with (
        DataFile.create(out, experiment.identity()) as data,
        StrokesFile.create(strokes_path(out), ABOUT) as strokes,
        bench,
    ):
        run(experiment, bench, data, strokes=strokes)
    return bench, read_strokes(strokes_path(out)).strokes


@pytest.fixture(scope="module")
def slid(model, tmp_path_factory):
    """The bench, the strokes and the rows of one plan."""
    out = tmp_path_factory.mktemp("slid") / "data.csv"
    return (*kept(load_rig("simulated"), model, plan(DRIVEN), out), rows_of(out))


def test_a_stroke_is_what_the_sensor_said(slid):
    bench, found, _ = slid
    without, driven = found
    assert (without.row.voltage_v, driven.row.voltage_v) == (0.0, 75.0)
    assert (driven.row.session, driven.row.trial, driven.row.row) == (1, 1, 2)
    for one, said in zip(found, bench.said, strict=True):
        assert one.samples["time_s"].tolist() == [reading.time_s for reading in said]
        for name in ("lateral_force_n", "normal_force_n"):
            assert one.samples[name].tolist() == [getattr(reading, name) for reading in said]
        np.testing.assert_allclose(np.diff(one.samples["time_s"])[5:], READING_S, rtol=1e-6)
    assert without.samples["monitor_voltage_v"].max() == 0.0
    # the generator takes 30 ms for a new amplitude
    assert driven.samples["monitor_voltage_v"][-100:] == pytest.approx(75.0)
    assert np.isnan(driven.samples["monitor_current_a"]).all()  # nothing is wired


def test_displacement_counts_from_full_voltage_and_the_window_is_the_plans(slid):
    for one in slid[1]:
        assert one.row.steady_begin_m == pytest.approx(0.02 * 0.2)
        assert one.row.steady_end_m == pytest.approx(0.02 * 0.7)
        samples = one.samples
        assert samples["velocity_m_s"] == pytest.approx(0.02)
        np.testing.assert_allclose(
            np.diff(samples["displacement_m"]), 0.02 * np.diff(samples["time_s"]), atol=1e-12
        )
        inside = samples["displacement_m"] > one.row.steady_begin_m + 1e-9
        assert (samples["steady"] == 1).tolist() == inside.tolist()


def test_the_window_gives_the_rows_own_friction(slid):
    for one, row in zip(*slid[1:], strict=True):
        steady = one.samples[one.samples["steady"] == 1]
        cof = steady["lateral_force_n"].mean() / steady["normal_force_n"].mean()
        assert float(row["cof"]) == pytest.approx(cof, rel=1e-5)  # six digits are written
        assert float(row["time_s"]) == pytest.approx(steady["time_s"].mean(), abs=1e-6)


def test_a_resting_finger_makes_no_stroke(config, model, tmp_path):
    resting = Setting(250.0, 5.0, 0.5, 0.0, finger="resting", sweep=True)
    given = plan(DRIVEN, resting)
    found = kept(config, model, given, tmp_path / "data.csv")[1]
    assert [one.row.row for one in found] == [1, 2]


LONG = """
name = "long"
frequency_hz = [60.0, 250.0]
voltage_v = 75.0
normal_force_n = 0.5
speed_m_s = 0.02
repeats = 300
settle_s = 0.1
average_s = 0.25
pause_s = 0.0
"""


@pytest.mark.process
def test_a_killed_measure_leaves_what_was_whole_and_goes_on(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("long.toml").write_text(LONG)
    arguments = ["measure", "--plan", "long.toml", "--out", "data.csv"]
    program = f"import sys; from haptic_driver.cli.main import main; sys.exit(main({arguments!r}))"
    child = subprocess.Popen([sys.executable, "-c", program], stderr=subprocess.DEVNULL)
    data, path = Path("data.csv"), Path("data.strokes.h5")
    try:
        until(lambda: data.exists() and len(rows_of(data)) >= 4)
        child.send_signal(signal.SIGKILL)
        child.wait(30.0)
    finally:
        child.kill()
    done = len(rows_of(data))
    assert 4 <= done < 600
    found = read_strokes(path).strokes
    # a stroke is written before its row, and the last line may be cut short
    assert abs(len(found) - done) <= 1
    assert [one.row.row for one in found] == [*range(1, len(found) + 1)]
    assert all(one.samples.size > 50 for one in found)
    assert not path.exists()
    assert main(["export", str(path), "--out", "strokes.csv"]) == 0
    assert len(rows_of(Path("strokes.csv"))) == sum(one.samples.size for one in found)

    def enough(self: SimulatedBench) -> ForceReading:
        if len(rows_of(data)) >= done + 2:
            raise KeyboardInterrupt
        return read(self)

    read = SimulatedBench.read_force
    monkeypatch.setattr(SimulatedBench, "read_force", enough)
    assert main([*arguments, "--resume"]) == 1
    assert path.exists()
    assert not records.records_of(path).exists()
    assert [s.row.row for s in read_strokes(path).strokes] == [*range(1, len(rows_of(data)) + 1)]


def test_a_stage_tells_where_the_finger_is_from_rest_to_the_end(model, tmp_path):
    """The simulated paper rig: it gathers 20 mm/s at 20 mm/s^2, 10 mm, before the voltage."""
    config = load_rig("simulated-paper").model_copy(update={"camera": NoPart()})
    given = plan(DRIVEN).model_copy(update={"voltage_off_every": 0, "average_s": 1.0})
    experiment = prepare(config, model, given)
    bench = bench_for(experiment, 0, None, lambda what: None)
    path = strokes_path(tmp_path / "data.csv")
    with (
        DataFile.create(tmp_path / "data.csv", experiment.identity()) as data,
        StrokesFile.create(path, ABOUT) as strokes,
        bench,
    ):
        run(experiment, bench, data, strokes=strokes)
    (found,) = read_strokes(path).strokes
    samples, planned = found.samples, stroke(DRIVEN, given, config)
    # a look takes some ms, in which the stage goes on
    assert samples["displacement_m"][0] == pytest.approx(-0.0105, abs=1.5e-3)
    assert samples["position_m"][0] == pytest.approx(planned.start_m, abs=0.5e-3)
    assert samples["velocity_m_s"][0] < 5e-3
    sliding = samples["displacement_m"] > 0.0
    assert samples["velocity_m_s"][sliding] == pytest.approx(0.02, rel=0.01)
    # friction settles for 0.2 s; a look at sensor and stages lasts some 30 ms, 0.6 mm, at most
    assert found.row.steady_begin_m == pytest.approx(0.02 * 0.2, abs=0.7e-3)
    assert found.row.steady_end_m - found.row.steady_begin_m == pytest.approx(0.02, abs=0.7e-3)
    assert samples["monitor_voltage_v"][samples["displacement_m"] < -1e-3].max() == 0.0
    assert samples["monitor_voltage_v"][samples["steady"] == 1] == pytest.approx(75.0)
    assert samples["normal_force_n"] == pytest.approx(0.5, rel=0.25)  # tremor, single readings
    assert samples["normal_force_n"].mean() == pytest.approx(0.5, rel=0.05)
