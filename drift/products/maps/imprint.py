"""What the pictures of a run share: title, footer and caution, and the content of every chart."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from drift.products.maps.marks import Line, Mark
from geo.box import Box


@dataclass(frozen=True)
class Imprint:
    """Text on every picture: title, footer, and a caution about its limits."""

    title: str
    footer: str = ""  # a line on the source: errors, version, seed
    attributes: Mapping[str, str] = field(default_factory=dict)  # metadata of the file
    caution: str = ""  # text of a banner


@dataclass(frozen=True)
class Setting:
    """What every chart of a run shows: imprint, land, starting positions and overlays."""

    imprint: Imprint
    # returns the land polygons (Shapely) [deg] in a box
    polygons: Callable[[Box], Iterable[Any]] = lambda box: ()
    marks: Sequence[Mark] = ()  # starting positions, as points
    lines: Sequence[Line] = ()  # starting areas and tracklines
    # starting positions without a mark of their own, if there are many [deg]
    others: Sequence[tuple[float, float]] = ()
    known_as: str = "Last known position"  # what the legend calls the marks
    particles: int | None = None  # particles in the run
    # the output that the map and the report show first; None: the last
    opens: np.datetime64 | None = None
    # further layers of maps, such as itineraries: maps.overlay.AtTime
    overlays: Sequence[Callable[[Any], Any]] = ()
