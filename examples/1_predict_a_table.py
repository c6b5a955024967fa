"""Predict a table of conditions.

Numbers and arrays go in, arrays come out: electrostatic force, friction and finger current by the
model. Voltages are peak amplitudes at the electrode. `to_frame()` makes a pandas table of it.
"""

import haptic_driver as hd

answer = hd.predict(
    "reference", frequency_hz=[10.0, 100.0, 1e3, 10e3], voltage_v=75.0, normal_force_n=0.5
)
print(answer)
print(f"highest friction {answer.cof.max():.3f}")
