"""Measure a finger that does not follow the model, and let the diagnosis say why.

The simulated rig's finger has an effect that the model does not know: a series resistance in the electrode's lead. The
experiment goes through check, safety gate and instruments row by row; the diagnosis sees only the file.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

from haptic_driver.experiments.bench import SimulatedBench
from haptic_driver.experiments.data_file import DataFile
from haptic_driver.experiments.plan import load_plan
from haptic_driver.experiments.run import prepare, run
from haptic_driver.rig.config import load_rig
from haptic_driver.surface.models import load_model
from model.diagnosis.data import read_measurements
from model.diagnosis.report import report
from model.diagnosis.workflow import diagnose
from model.touch_model import TouchModel

rig, reference = load_rig("simulated"), load_model("reference")
hidden = rig.simulation.model_copy(update={"hide": {"series_resistance": {"resistance_ohm": 300e3}}})
rig = rig.model_copy(update={"simulation": hidden})
touch = TouchModel(reference)
experiment = prepare(rig, touch, load_plan("voltage_frequency"), seed=1)

with TemporaryDirectory() as folder:
    path = Path(folder) / "data.csv"
    with (
        DataFile.create(path, experiment.identity("")) as data,
        SimulatedBench(rig, touch, seed=experiment.seed, first_row=0, friction=None) as bench,
    ):
        run(experiment, bench, data, lambda rows: None)
    diagnosis = diagnose(reference, read_measurements(path), seed=1)

found = report(diagnosis, reference, "model.toml")
print(f"verdict: {found['verdict']}")
for candidate in found["alternatives"][:3]:
    print(f"  {candidate['name']}: probability {candidate['probability']:.3f}")
