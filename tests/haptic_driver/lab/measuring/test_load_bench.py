"""A plan on a rig whose load stage presses: real drivers in real time, nobody at the rig."""

from __future__ import annotations

import numpy as np
import pytest

from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.lab.measuring.bench import Scatter, SimulatedBench
from haptic_driver.lab.measuring.benches import bench_for
from haptic_driver.lab.measuring.data_file import DataFile
from haptic_driver.lab.measuring.plan import Setting
from haptic_driver.lab.measuring.run import prepare, run
from haptic_driver.lab.measuring.simulated_stages import SimulatedStageBench
from haptic_driver.lab.measuring.stroke import stage_of
from haptic_driver.rig.config import load_rig
from haptic_driver.rig.part import NoPart
from haptic_driver.simulation.served import ServedRig
from haptic_driver.simulation.twin import LOAD_STAGE
from hw.force.sensor import ForceReading
from model.conditions import Conditions
from tests.haptic_driver.lab.measuring.test_stage_bench import SPEED_M_S, measured, off, plan, table
from tests.haptic_driver.stand_ins import living_rig, with_load_stage

pytestmark = pytest.mark.timeout(300)


@pytest.fixture
def served(config, model):
    with living_rig(config, model) as rig:
        yield rig


@pytest.fixture
def real(config, served):
    """With strokes in the middle of a short travel, as homing and the way there take time."""
    real = with_load_stage(served.config, served.endpoints)
    quick = {"velocity_m_s": 0.05, "acceleration_m_s2": 0.05, "travel_m": [0.0, 0.07]}
    return real.model_copy(update={"stage": stage_of(real).model_copy(update=quick)})


def lifted(served: ServedRig) -> bool:
    return served.load_stage.position_mm < 1e3 * LOAD_STAGE.face_m and not served.load_stage.moving


@pytest.mark.realtime
@pytest.mark.soak  # three quarters of a minute; single rows are tried below
def test_each_rows_load_is_held_and_nobody_is_asked(served, real, model, tmp_path):
    told: list[str] = []
    rows = [Setting(250.0, 75.0, load_n, SPEED_M_S) for load_n in (0.3, 0.6)]
    measured(real, model, plan(*rows), tmp_path / "data.csv", told.append)
    assert off(served)
    assert lifted(served)
    found = table(tmp_path / "data.csv")
    assert len(found) == 4
    for row in found:
        assert float(row["measured_normal_force_n"]) == pytest.approx(
            float(row["normal_force_n"]), rel=0.1
        )


@pytest.mark.realtime
@pytest.mark.soak  # some ten seconds
def test_an_overload_in_a_row_lifts_the_finger_with_the_output_off(
    served,
    real,
    model,
    tmp_path,
    monkeypatch,
):
    """Once the voltage is there the body is three times as stiff."""
    loads: list[float] = []
    assert served.world.pressed is not None
    soft = served.world.pressed.step

    def stiff(dt_s: float, friction_n: float, attraction_n: float) -> float:
        load_n = soft(dt_s, friction_n, attraction_n)
        loads.append(load_n * (3.0 if served.instruments.voltage_v > 50.0 else 1.0))
        return loads[-1]

    monkeypatch.setattr(served.world.pressed, "step", stiff)
    given = plan(Setting(250.0, 75.0, 0.5, SPEED_M_S), voltage_off_every=0)
    with pytest.raises(HapticError, match="let go"):
        measured(real, model, given, tmp_path / "data.csv", lambda what: None)
    assert off(served)
    assert lifted(served)
    assert max(loads) < 3.0


@pytest.mark.realtime
@pytest.mark.soak  # by a stepped clock: `test_load_moments.py`
def test_a_sensor_that_falls_silent_lifts_the_finger(
    served,
    real,
    model,
    tmp_path,
    monkeypatch,
):
    from haptic_driver.rig.rig import Rig

    newest: list[ForceReading] = []
    original = Rig.read_force

    def frozen(self: Rig) -> ForceReading:
        reading = original(self)
        newest.append(newest[-1] if len(newest) > 120 else reading)
        return newest[-1]

    monkeypatch.setattr(Rig, "read_force", frozen)
    given = plan(Setting(250.0, 75.0, 0.5, SPEED_M_S), average_s=1.5)
    with pytest.raises(HapticError, match="silent"):
        measured(real, model, given, tmp_path / "data.csv", lambda what: None)
    assert off(served)
    assert lifted(served)


def test_a_simulated_rig_with_stages_measures_at_the_loads_of_a_plan(model, tmp_path):
    """The same bench in simulated time: strokes by the stage, loads by the loop."""
    config = load_rig("simulated-paper").model_copy(update={"camera": NoPart()})
    rows = [Setting(250.0, 75.0, load_n, SPEED_M_S) for load_n in (0.3, 0.6)]
    experiment = prepare(config, model, plan(*rows, average_s=0.5, voltage_off_every=0))
    bench = bench_for(experiment, 0, None, lambda what: None)
    with bench, DataFile.create(tmp_path / "data.csv", experiment.identity()) as data:
        run(experiment, bench, data)
    assert isinstance(bench, SimulatedStageBench)
    assert bench.world.simulated.world.load_n == 0.0
    found = table(tmp_path / "data.csv")
    assert len(found) == 2
    for row in found:
        load_n = float(row["normal_force_n"])
        assert float(row["measured_normal_force_n"]) == pytest.approx(load_n, rel=0.1)


def test_the_simulated_skin_is_drawn_by_the_attraction_of_the_model(model):
    """Friction is a coefficient times load and attraction together, so that the rise tells the
    latter; the lag has settled after 50 ms at 20 mm/s.
    """
    bench = SimulatedBench(
        load_rig("simulated-paper"), model, seed=1, scatter=Scatter(0.0, 0.0, 0.01, 0.0, 0.0)
    )
    instruments = bench.simulated.instruments
    with bench:
        bench.simulated.amplifier.write(True)
        for on in ("0", "1"):
            instruments.generator.handle(
                b"OUTP:LOAD INF;:FREQ 250;:VOLT 1.5;:OUTP %s\n" % on.encode()
            )
            for _ in range(100):
                bench.step(1e-3, 0.5, 0.02)
            if on == "0":
                assert instruments.attraction_n() == 0.0
        voltage_v = instruments.voltage_v
        assert voltage_v == pytest.approx(75.0, rel=1e-3)
        conditions = Conditions(*(np.array([x]) for x in (250.0, voltage_v, 0.5)))
        wanted_n = float(model.predict(conditions).electrostatic_force_n[0])
        assert wanted_n > 0.05
        assert instruments.attraction_n() == pytest.approx(wanted_n, rel=0.02)


def test_a_simulated_rig_that_slides_no_finger_measures_no_load(model):
    config = load_rig("simulated-paper").model_copy(update={"stage": None})
    with pytest.raises(BadInputError, match="has no stage"):
        prepare(config, model, plan(Setting(250.0, 75.0, 0.5, SPEED_M_S)))
