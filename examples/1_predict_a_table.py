"""Predict a table of conditions.

Arrays go in, arrays come out: electrostatic force, friction and finger current by the model.
Voltages are peak amplitudes at the electrode.
"""

import numpy as np

from haptic_driver.surface.models import load_model
from model.conditions import Conditions
from model.touch_model import TouchModel

touch = TouchModel(load_model("reference"))
frequency_hz = np.array([10.0, 100.0, 1e3, 10e3])
answer = touch.predict(
    Conditions(frequency_hz, voltage_v=np.full(4, 75.0), normal_force_n=np.full(4, 0.5))
)

print("frequency_hz  force_n  friction  current_a")
for row in zip(
    frequency_hz, answer.electrostatic_force_n, answer.cof, answer.current_rms_a, strict=True
):
    print("{:12.0f}  {:7.4f}  {:8.4f}  {:9.2e}".format(*row))
