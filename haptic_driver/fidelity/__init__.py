"""Fidelity measures how well the friction at the finger (felt) matches the friction requested
(asked).

In go strokes, which have both over time; out come the lag, the errors of level and of each
frequency band, and their uncertainty. `measure.py` brings them together, and docs/fidelity.md
defines each number. The daemon, recordings and experiments use the same measure.

One rule holds: a number that the data cannot support is None, with the reason where there is room
for one.
"""

__all__ = [
    "average",
    "edge",
    "lag",
    "measure",
    "perception",
    "said",
    "samples",
    "sliding",
    "strokes",
]
