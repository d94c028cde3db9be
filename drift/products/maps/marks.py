"""Named points and lines that are drawn on charts."""

from collections.abc import Sequence
from dataclasses import dataclass


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
