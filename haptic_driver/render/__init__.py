"""Render computes a drive command from a finger sample, once per tick.

A stage is a pure function: (settings, state, input) -> (state, output). In go the finger's position
and force, and the surface, which is a table of friction over frequency, load and voltage. The
texture or scene gives the friction to be made. Out comes a command: carrier frequency and voltage.

The stages run in this order: finger, texture, controller (with feedback), safety, drive. `tick.py`
shows the order and is the place to start reading.

Two rules hold. A stage does no I/O and reads no clock, and only the controller reads the surface.
The last gate (`safety.py`) turns every operating point outside a limit into zero volts.
"""

__all__ = [
    "compiled",
    "controller",
    "correction",
    "drive",
    "envelope",
    "feedback",
    "finger",
    "policies",
    "safety",
    "scene",
    "surface",
    "texture",
    "tick",
]
