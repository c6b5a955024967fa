"""A plan on a rig whose load stage presses, by a stepped clock."""

from __future__ import annotations

import numpy as np
import pytest

from haptic_driver.errors import BadInputError
from haptic_driver.lab.measuring.bench import Scatter, SimulatedBench
from haptic_driver.lab.measuring.benches import bench_for
from haptic_driver.lab.measuring.plan import Setting
from haptic_driver.lab.measuring.run import prepare
from haptic_driver.lab.measuring.simulated_stages import SimulatedStageBench
from haptic_driver.rig.config import load_rig
from haptic_driver.rig.part import NoPart
from model.conditions import Conditions
from tests.haptic_driver.commands import rows_of
from tests.haptic_driver.lab.measuring.test_run import measured
from tests.haptic_driver.lab.measuring.test_stage_bench import SPEED_M_S, plan

pytestmark = pytest.mark.timeout(300)


def test_a_simulated_rig_with_stages_measures_at_the_loads_of_a_plan(model, tmp_path):
    """The same bench in simulated time: strokes by the stage, loads by the loop."""
    config = load_rig("simulated-paper").model_copy(update={"camera": NoPart()})
    rows = [Setting(250.0, 75.0, load_n, SPEED_M_S) for load_n in (0.3, 0.6)]
    experiment = prepare(config, model, plan(*rows, average_s=0.5, voltage_off_every=0))
    bench = bench_for(experiment, 0, None, lambda what: None)
    measured(experiment, tmp_path / "data.csv", bench=bench)
    assert isinstance(bench, SimulatedStageBench)
    assert bench.world.simulated.world.load_n == 0.0
    found = rows_of(tmp_path / "data.csv")
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
