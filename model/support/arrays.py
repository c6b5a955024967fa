"""What arrays are called in annotations; shapes stand in docstrings, as [n]."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
Mask = NDArray[np.bool_]
Values = Any  # float or array, real or complex, that broadcasts against the conditions
