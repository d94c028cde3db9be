"""What the pictures of a run share: the words on each, and what every chart shows."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from drift.products.maps.marks import Line, Mark
from geo.box import Box


@dataclass(frozen=True)
class Imprint:
    """Words on every picture: its title, where it comes from, and a caution about what not to
    believe.
    """

    title: str
    footer: str = ""  # a line of where it comes from: errors, version, seed
    attributes: Mapping[str, str] = field(default_factory=dict)  # the same in full, into the file
    caution: str = ""  # text of a banner


@dataclass(frozen=True)
class Setting:
    """What every chart of a run shows, and what stands on it."""

    imprint: Imprint
    # returns those of land in a box, by Shapely [deg]
    polygons: Callable[[Box], Iterable[Any]] = lambda box: ()
    marks: Sequence[Mark] = ()  # where the run began, as points
    lines: Sequence[Line] = ()  # the same, as areas and tracklines
    # positions of those of many that have no mark of their own [deg]
    others: Sequence[tuple[float, float]] = ()
    known_as: str = "Last known position"  # what the legend calls the marks
    particles: int | None = None  # particles in the run
    # the output that the map and the report show first; None: the last
    opens: np.datetime64 | None = None
    # what else stands on maps, such as itineraries: maps.overlay.AtTime
    overlays: Sequence[Callable[[Any], Any]] = ()
