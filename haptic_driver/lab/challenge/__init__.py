"""A benchmark of names for what a model lacks, which anybody can enter.

`sets.py` writes sets of measured data in which something may be hidden, and later makes again what
was. `answers.py` reads what somebody answers, `scores.py` scores it, `own.py` answers by this
program.

One rule holds: sets are made by the test tree, which shares no code with the model.
"""

__all__ = ["answers", "own", "scores", "sets"]
