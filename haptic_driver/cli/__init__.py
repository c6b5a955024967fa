"""The `haptic` command line has one module per group of commands.

A command reads its arguments and files, calls the other rooms, and prints the result. `main.py`
puts the groups together. `output.py` holds what all share: one JSON object or text goes to stdout,
errors go to stderr. Commands of the daemon follow from `daemon/verbs.py`.

One rule holds: every failure becomes a message and an exit status (`main.py`).
"""

import os

# Small matrices: several BLAS threads cost more than they bring, and fight over the cores. Set
# before numpy loads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
