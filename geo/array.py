"""Arrays in signatures: docstrings say what they hold, and in which unit and shape."""

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
Real = npt.NDArray[np.float64]
