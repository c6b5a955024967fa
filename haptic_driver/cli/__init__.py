"""The `haptic` command line, one module per command group."""

import os

# Small matrices: several BLAS threads cost more than they bring, and fight over the cores. Set
# before numpy loads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
