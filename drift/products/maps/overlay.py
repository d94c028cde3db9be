"""What another topic draws on a chart: its layers, its places, its rows of the legend.

The frame should show its places.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes

from drift.products.maps.chart import Frame
from geo.array import Array


@dataclass(frozen=True)
class Overlay:
    """Layers of a topic that the chart knows nothing of."""

    draw: Callable[[Axes, Frame], None]
    # Shapes by name, each (n, 2) [deg]; the chart says so where it cannot show one.
    places: Mapping[str, Sequence[Array]]
    key: Sequence[tuple[Any, str]]  # symbols and texts
    # written beside positions [deg] where there is room
    names: Sequence[tuple[float, float, str]] = ()


AtTime = Callable[[Any], Overlay]  # what is drawn on a chart of a time, np.datetime64
