"""The model predicts friction and current of a finger on an electroadhesive touch screen.

In go the numbers of a finger and a screen (`parameters.py`, `description.py`), and conditions:
frequency, voltage, load, speed, time. Out come electrostatic force, coefficient of friction,
currents and the voltage at the electrode, for many touches at once (`touch_model.py`).

The chain is drive, electrical layers, contact, closed loop, friction. The loop couples the stages:
electrostatic pressure closes the gaps, and narrower gaps raise the pressure (`solver.py`).

Two rules hold. The model knows neither devices nor the driver. Every formula names its paper and
equation, and every number its source.
"""
