"""Overlay: what another topic adds to a chart (layers, places, legend rows)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes

from drift.products.maps.chart import Frame
from geo.array import Array


@dataclass(frozen=True)
class Overlay:
    """Layers of a topic on a chart that has no knowledge of the topic."""

    draw: Callable[[Axes, Frame], None]
    # Shapes by name, each (n, 2) [deg]; the frame should show them, else the chart says so.
    places: Mapping[str, Sequence[Array]]
    key: Sequence[tuple[Any, str]]  # symbols and texts
    # names of shapes (n, 2) [deg], written at their shapes if there is space; areas are closed
    names: Sequence[tuple[Array, str]] = ()


AtTime = Callable[[Any], Overlay]  # returns the overlay at a time, np.datetime64
