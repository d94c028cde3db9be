"""Named points and lines that are drawn on charts."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geo.array import Array


@dataclass(frozen=True)
class Mark:
    """A named point, such as the last known position [deg]."""

    lon: float
    lat: float
    label: str = "LKP"


@dataclass(frozen=True)
class Line:
    """A named line, such as a prior's area (closed) or a trackline.

    lon, lat: [deg], unwrapped, shape (n,).
    """

    lon: Sequence[float]
    lat: Sequence[float]
    label: str
    closed: bool = False

    def shape(self) -> Array:
        """Return its points, (n, 2) [deg]; those of an area begin and end with the same one."""
        points = np.column_stack([self.lon, self.lat]).astype(float)
        return np.concatenate([points, points[:1]]) if self.closed else points
