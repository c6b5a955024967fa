"""This room starts the driver's processes and threads, and carries data between them.

`started.py` lists every process and thread and is the only place that starts one. `child.py` and
`parent.py` are the two ends of a child process. `shared_memory.py` holds target and surface as
slots that are swapped as a whole, and samples in a ring. `real_time.py` keeps the period of a loop.

Two rules hold. A child ends when its parent is gone. No reader of the shared memory can make a
writer wait.
"""

__all__ = [
    "child",
    "compilation",
    "kept",
    "parent",
    "patience",
    "real_time",
    "samples",
    "shared_memory",
    "started",
]
