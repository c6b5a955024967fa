"""Measure a finger and fit its own numbers.

The finger is simulated, so that it can be compared with what it really is: its skin is a fifth
thinner than the model's and its friction without voltage higher. With a finger of your own, begin
at `read_measurements`.
"""

import csv
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from haptic_driver.surface.models import load_model
from model.analysis.calibration import calibrate
from model.conditions import Conditions
from model.diagnosis.data import read_measurements
from model.touch_model import TouchModel

reference = load_model("reference")
truth = {"skin_thickness_m": 160e-6, "cof_off": 0.55}
changed = {name: replace(reference.parameters[name], value=value) for name, value in truth.items()}
finger = TouchModel(replace(reference, parameters=reference.parameters | changed))

levels = np.meshgrid(np.geomspace(30.0, 3e3, 6), [0.0, 40.0, 80.0], [0.3, 0.6])
frequency_hz, voltage_v, normal_force_n = (np.repeat(axis.ravel(), 2) for axis in levels)
noise = np.exp(0.005 * np.random.default_rng(1).standard_normal(frequency_hz.size))
cof = finger.predict(Conditions(frequency_hz, voltage_v, normal_force_n)).cof * noise

with TemporaryDirectory() as folder:
    data = Path(folder) / "data.csv"
    with data.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["frequency_hz", "voltage_v", "normal_force_n", "cof"])
        writer.writerows(zip(frequency_hz, voltage_v, normal_force_n, cof, strict=True))
    found = calibrate(reference, read_measurements(data))

for parameter in found.parameters:
    low, high = parameter.interval_95
    print(
        f"{parameter.name:20} {parameter.value:.4g} {parameter.unit}, 95 % within {low:.4g} to"
        f" {high:.4g}"
    )
print(f"chi-square per point {found.chi2_per_point:.2f}")
