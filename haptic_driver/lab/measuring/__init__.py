"""An experiment takes a measurement plan to a rig and brings back a table of data.

In go a plan, which lists settings, repeats and order (`plan.py`), and a rig with a finger. Out
comes a CSV file with one row per condition and repeat, and a sidecar with its origin
(`data_file.py`). `investigate.py` repeats this: it measures, diagnoses, and chooses the next
settings. `recordings.py` makes such rows of what the daemon recorded.

Two rules hold. A plan is checked against the rig's limits before anything is energised
(`check.py`). A row is on the disk before the next one is measured.
"""

__all__ = [
    "benches",
    "check",
    "data_file",
    "investigate",
    "plan",
    "recordings",
    "resolving",
    "run",
    "spectra",
    "start_line",
    "touched_places",
]
