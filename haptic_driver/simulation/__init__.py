"""Simulation replaces the instruments of a rig, and leaves its drivers as they are.

Simulated instruments answer in the instruments' own protocols, as bytes, so the real drivers talk
to them. Behind them is a finger: a model, optionally with effects that the driver does not know, or
any function. In go commands and a slide; out come readings, as a real rig would give them.

Time passes in steps (`rig.py`) or by the clock of a process (`process.py`, `served.py`).

Two rules hold. Safety checks stay on in simulation. A recording says whether its rig was simulated.
"""

__all__ = ["finger_function", "finger_model", "rig", "served", "slide", "twin"]
