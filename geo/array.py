"""Array types for signatures; docstrings state contents, unit and shape."""

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
Real = npt.NDArray[np.float64]
