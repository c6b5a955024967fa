"""Planning predicts which measurements separate models best.

In go two or more models with their uncertain parameters, and the settings that a rig permits. Out
comes the separation in chi^2: how far their predictions differ once every uncertain quantity has
been fitted to hide the difference.

- `resolution.py` says beforehand which effects a plan could separate;
- `next_experiment.py` proposes a few settings after a verdict;
- `design.py` chooses blocks of settings for an investigation, one after the other.

`told.py` holds the arithmetic on arrays alone.
"""

__all__ = ["design", "discrimination", "next_experiment", "resolution", "separation"]
