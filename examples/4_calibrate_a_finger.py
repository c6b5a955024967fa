"""Measure a finger and fit its own numbers.

The finger is simulated, so that the fit can be compared with what it really is. Its skin is a fifth
thinner than the model's, and its friction without voltage is higher. With a finger of your own,
begin at `hd.calibrate`.
"""

import csv
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import haptic_driver as hd

finger = hd.load_model("reference").with_values(skin_thickness_m=160e-6, cof_off=0.55)

levels = np.meshgrid(np.geomspace(30.0, 3e3, 6), [0.0, 40.0, 80.0], [0.3, 0.6])
frequency_hz, voltage_v, normal_force_n = (np.repeat(axis.ravel(), 2) for axis in levels)
noise = np.exp(0.005 * np.random.default_rng(1).standard_normal(frequency_hz.size))
answer = hd.predict(
    finger, frequency_hz=frequency_hz, voltage_v=voltage_v, normal_force_n=normal_force_n
)

with TemporaryDirectory() as folder:
    data = Path(folder) / "data.csv"
    with data.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["frequency_hz", "voltage_v", "normal_force_n", "cof"])
        writer.writerows(
            zip(frequency_hz, voltage_v, normal_force_n, answer.cof * noise, strict=True)
        )
    found = hd.calibrate(data, "reference")

for parameter in found.parameters:
    low, high = parameter.interval_95
    print(
        f"{parameter.name:20} {parameter.value:.4g} {parameter.unit}, 95 % within {low:.4g} to"
        f" {high:.4g}"
    )
print(f"chi-square per point {found.chi2_per_point:.2f}")
