"""Points and lines that are drawn on charts with their names."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Mark:
    """A point to mark, such as the last known position [deg]."""

    lon: float
    lat: float
    label: str = "LKP"


@dataclass(frozen=True)
class Line:
    """A line to draw, such as a prior's area (closed) or a trackline [deg]; longitudes without
    jumps, (n,).
    """

    lon: Sequence[float]
    lat: Sequence[float]
    label: str
    closed: bool = False
