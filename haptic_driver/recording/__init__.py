"""A recording keeps the runs of the daemon on disk, with one sample per tick and all events.

In go samples from shared memory and events from control. While a run goes on, the recorder adds
records to a file (`records.py`). At the end of the run it makes HDF5 of them (`finish.py`), one
group per run, which MATLAB reads too. Out come arrays (`read.py`).

Two rules hold. A crash or a full disk costs at most the records that were not yet forced to the
disk. A run says itself whether it is complete, and if not, why.
"""

__all__ = [
    "clock",
    "event",
    "finish",
    "process",
    "read",
    "records",
    "scenes",
    "structure",
    "writer",
]
