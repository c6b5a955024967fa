"""Population studies: what is drawn, what comes out, and that neither machine nor interruption
changes a number.
"""

import json
import sys
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from haptic_driver.errors import HapticError
from haptic_driver.lab import studies as module
from haptic_driver.lab.studies import TASKS, load_study, run_study, statistics
from haptic_driver.lookup.file import read_surface
from haptic_driver.lookup.models import load_model
from model.conditions import Conditions
from model.touch_model import TouchModel
from tests.haptic_driver.commands import rows_of, said_by
from tests.haptic_driver.lab.refusal import refused

PLAN = """
name = "few"
fingers = 3
seed = 7
[spread]
roughness_rms_m = 0.1
leak_scale = 0.4
[levels]
insulator_thickness_m = [1e-6, 2e-6]
[surface]
frequency_count = 8
voltage_count = 9
normal_force_count = 4
"""
ROUNDING = 1e-9


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / "few.toml"
    path.write_text(PLAN)
    return path


@pytest.fixture
def few(plan):
    return load_study(str(plan))


@pytest.fixture
def here(monkeypatch):
    """Tasks in a thread of this process: nothing to start."""

    @contextmanager
    def executor(*_):
        with ThreadPoolExecutor(1) as pool:
            yield pool

    monkeypatch.setattr(module, "_executor", executor)


def numbers(results):
    return np.array([[r[name] for name in module.NUMBERS] + r["highest_cof"] for r in results])


@pytest.mark.usefixtures("here")
def test_every_task_is_the_model_with_that_fingers_numbers(few, tmp_path):
    results = run_study(few, tmp_path / "out")
    assert [r["task"] for r in results] == list(range(6))
    assert [r["finger"] for r in results] == [0, 0, 1, 1, 2, 2]
    assert [r["values"]["insulator_thickness_m"] for r in results] == [1e-6, 2e-6] * 3
    assert results[0]["values"]["leak_scale"] == results[1]["values"]["leak_scale"]  # one finger
    assert results[0]["values"]["leak_scale"] != results[2]["values"]["leak_scale"]
    one = np.ones(1)
    for found in results[:2]:
        reference = load_model("reference")
        given = {
            name: replace(p, value=found["values"].get(name, p.value))
            for name, p in reference.parameters.items()
        }
        description = replace(reference, parameters=given)
        answer = TouchModel(description).predict(Conditions(250.0 * one, 75.0 * one, 0.5 * one))
        assert found["cof"] == pytest.approx(answer.cof[0], rel=ROUNDING)
        assert found["reachable_low"] == pytest.approx(0.512, rel=1e-9)
        assert found["reachable_high"] > found["reachable_low"]
        assert len(found["highest_cof"]) == 8


def test_fingers_are_spread_as_the_plan_says(few):
    drawn = [few.finger(i) for i in range(2000)]
    for name, log_std in few.plan.spread.items():
        logs = np.log([d[name] for d in drawn]) - np.log(few.description.parameters[name].value)
        assert logs.std() == pytest.approx(
            log_std, rel=0.07
        )  # cut at 2.5: 0.97 of it; 2000 draws: 2 %
        assert logs.mean() == pytest.approx(0.0, abs=0.1 * log_std)
    assert (
        np.corrcoef([d["roughness_rms_m"] for d in drawn], [d["leak_scale"] for d in drawn])[0, 1]
        < 0.1
    )
    assert few.finger(5) == drawn[5]


@pytest.mark.usefixtures("here")
def test_a_study_that_was_stopped_goes_on(few, tmp_path, monkeypatch):
    whole = run_study(few, tmp_path / "whole")
    stopped = tmp_path / "stopped"
    original, ran = module.Study.run, []

    def until_the_fourth(self, task, out=None):
        if len(ran) == 3:
            raise KeyboardInterrupt
        ran.append(task)
        return original(self, task, out)

    monkeypatch.setattr(module.Study, "run", until_the_fourth)
    with pytest.raises(KeyboardInterrupt):
        run_study(few, stopped)
    assert len((stopped / TASKS).read_text().splitlines()) == 1 + 3
    with (stopped / TASKS).open("a") as file:
        file.write('{"task": 3, "fing')  # killed in the middle of a line

    def rest(self, task, out=None):
        ran.append(task)
        return original(self, task, out)

    monkeypatch.setattr(module.Study, "run", rest)
    again = run_study(few, stopped)
    assert sorted(ran) == list(range(6))  # none twice
    assert again == whole
    assert run_study(few, stopped) == whole  # and nothing left to do
    assert len(ran) == 6


@pytest.mark.usefixtures("here")
def test_another_study_does_not_mix_into_the_folder(few, plan, tmp_path):
    run_study(few, tmp_path / "out")
    plan.write_text(PLAN.replace("seed = 7", "seed = 8"))
    with refused("other_study"):
        run_study(load_study(str(plan)), tmp_path / "out")


@pytest.mark.usefixtures("here")
def test_a_damaged_file_is_refused(few, tmp_path):
    run_study(few, tmp_path / "out")
    tasks = tmp_path / "out" / TASKS
    tasks.write_text(tasks.read_text().replace('"task": 2', '"tusk": 2'))
    with refused("bad_study"):
        run_study(few, tmp_path / "out")


@pytest.mark.usefixtures("here")
def test_surfaces_are_kept_where_asked_for(plan, tmp_path):
    plan.write_text(PLAN.replace("fingers = 3", "fingers = 1\nkeep_surfaces = true"))
    run_study(load_study(str(plan)), tmp_path / "out")
    kept = sorted((tmp_path / "out" / module.SURFACES).iterdir())
    assert [p.name for p in kept] == ["000000.h5", "000001.h5"]
    assert (
        read_surface(kept[1]).provenance["model"]["parameters"]["insulator_thickness_m"]["value"]
        == 2e-6
    )


@pytest.mark.usefixtures("here")
def test_statistics_are_percentiles_per_combination(few, tmp_path):
    results = run_study(few, tmp_path / "out")
    for i, found in enumerate(statistics(few, results)):
        own = [
            r["cof"]
            for r in results
            if r["values"]["insulator_thickness_m"] == found["levels"]["insulator_thickness_m"]
        ]
        assert found["cof"]["p50"] == pytest.approx(sorted(own)[1])
        assert found["cof"]["count"] == 3
        assert found["levels"] == few.plan.combinations[i]
    without = [r | {"cof": float("nan")} for r in results]
    nothing = dict.fromkeys(("p5", "p25", "p50", "p75", "p95"))
    assert statistics(few, without)[0]["cof"] == nothing | {"count": 0}


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ("leak_scale = 0.4", "leak_scal = 0.4", "unknown_key"),
        ("[1e-6, 2e-6]", "[1e-6, 2.0]", "bad_config"),
        ("fingers = 3", "fingers = 900000", "bad_config"),
    ],
)
def test_plans_that_cannot_be_are_refused(plan, old, new, code):
    plan.write_text(PLAN.replace(old, new))
    with refused(code, str(plan)):
        load_study(str(plan))


def test_a_cluster_that_is_not_there(few, tmp_path, monkeypatch):
    pytest.importorskip("distributed")

    class Nobody:
        def __init__(self, *_, **__):
            raise OSError("Timed out trying to connect")

    monkeypatch.setattr("distributed.Client", Nobody)
    with refused("no_cluster", kind=HapticError):
        run_study(few, tmp_path / "out", cluster="tcp://127.0.0.1:1")


def test_without_dask_the_extra_is_named(few, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with refused("missing_package", hint="haptic-driver[cluster]", kind=HapticError):
        run_study(few, tmp_path / "out", cluster="tcp://127.0.0.1:1")


@pytest.mark.filterwarnings("ignore")  # of Dask's own making
@pytest.mark.process
def test_a_scheduler_without_workers_is_waited_for_and_told(few, tmp_path, monkeypatch):
    """Nothing was said for as long as it took."""
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(module, "ANSWER_S", 1.0)
    told = []
    nobody = {"n_workers": 0, "processes": False, "dashboard_address": None}
    with distributed.LocalCluster(**nobody) as cluster:
        where = cluster.scheduler_address
        with refused("no_workers", kind=HapticError):
            run_study(few, tmp_path / "out", cluster=where, tell=told.append)
    assert told == [f"waiting for a worker at {where}: dask worker {where}"]


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("kind", ["KilledWorker", "CommClosedError", "CancelledError"])
def test_a_lost_worker_is_no_traceback(few, tmp_path, monkeypatch, kind):
    distributed = pytest.importorskip("distributed")
    errors = {
        "KilledWorker": distributed.KilledWorker("task", None, 3),
        "CommClosedError": distributed.comm.CommClosedError("closed"),
        "CancelledError": CancelledError(),
    }

    def lost(*_):
        raise errors[kind]

    monkeypatch.setattr(module.Study, "run", lost)
    with refused("worker_lost", kind, kind=HapticError):
        run_study(few, tmp_path / "out")


@pytest.mark.usefixtures("here")
def test_a_full_disk_is_no_lost_worker(few, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(module.Study, "run", full)
    with pytest.raises(OSError, match="No space"):
        run_study(few, tmp_path / "out")


@pytest.fixture
def dask_cluster():
    """A scheduler and two worker processes on loopback."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
    ) as cluster:
        yield cluster.scheduler_address


@pytest.mark.filterwarnings(
    "ignore"
)  # of Dask's own making: deprecations and sockets it closes late
@pytest.mark.timeout(280)
@pytest.mark.soak
def test_a_cluster_of_two_workers_gives_the_same_numbers(few, tmp_path, dask_cluster):
    seen = []
    found = run_study(few, tmp_path / "cluster", cluster=dask_cluster, advance=seen.append)
    assert seen == [1, 2, 3, 4, 5, 6]
    alone = [few.run(task) for task in range(6)]
    np.testing.assert_allclose(numbers(found), numbers(alone), rtol=ROUNDING)
    assert [r["values"] for r in found] == [r["values"] for r in alone]


@pytest.mark.soak
def test_processes_of_this_machine_give_the_same_numbers(few, tmp_path):
    found = run_study(few, tmp_path / "processes", workers=2)
    np.testing.assert_allclose(
        numbers(found), numbers([few.run(task) for task in range(6)]), rtol=ROUNDING
    )


@pytest.mark.usefixtures("here")
def test_the_command_writes_table_statistics_and_pictures(plan, tmp_path):
    found = said_by("study", plan, "--out", tmp_path / "out")
    assert found["tasks"] == 6
    assert len(found["pictures"]) == 2
    for picture in found["pictures"]:
        assert (tmp_path / "out" / picture.rpartition("/")[2]).stat().st_size > 10_000
    rows = rows_of(tmp_path / "out" / module.TABLE)
    assert len(rows) == 6
    assert float(rows[0]["cof"]) == pytest.approx(found["statistics"][0]["cof"]["p50"], rel=0.5)
    assert json.loads((tmp_path / "out" / "statistics.json").read_text()) == found["statistics"]
