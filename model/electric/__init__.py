"""The electrical side gives the field in the gap, and the currents.

In go the drive and the layers between electrode and finger: insulator, air gap, skin, and the leak
beside the gap (`layers.py`, `dielectrics.py`). Out comes the circuit that a gap sees, reduced to
one complex length (`circuit.py`). Field and pressure at a gap u depend on u plus that length.
`current.py` gives the current through the finger and at the electrode; `charges.py` gives charges
over time.

Phasors are complex peak values.
"""

__all__ = ["charges", "circuit", "current", "dielectrics", "layers"]
