"""Where a label stands: beside its point, or at its area, clear of what else is on the chart.

Positions and sizes are pixels; a box is (left, bottom, right, top).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from geo.array import Array

ANGLES = np.radians([0, 180, 45, -45, 135, -135, 90, -90])
DIRECTIONS = np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])
# On which side of the end of its offset a label lies: -1, 0 (around it) or 1, across and up.
SIDES = np.sign(DIRECTIONS.round(3)).astype(int)
# Distances of a label from its point or outline [typographic points], tried in this order.
FROM_POINT = (9, 18, 30, 45)
FROM_OUTLINE = (1, 9, 18, 30, 45, 64, 90, 120)
LED = 18  # distance from which a line leads to a label
ANCHORS = 16  # places of an outline at which its label may stand
OUTSIDE = 100  # boxes that it is worth covering to stay on the chart
AMBIGUOUS = 1000  # doubts about a label without a line that touches another area, or not its own


@dataclass(frozen=True)
class Spot:
    """A place for a label."""

    clashes: int  # boxes in use that the label covers
    doubts: int  # 1 for a line that leads to it; other areas and boxes that line and label touch
    anchor: Array  # the place that it labels
    offset: Array  # of the label from there
    side: Array  # one of SIDES
    box: Array
    led: bool  # whether a line leads from the label to the anchor

    @property
    def fits(self) -> bool:
        """Whether a label there covers nothing and does not mislead."""
        return self.badness[0] == 0

    @property
    def badness(self) -> tuple[int, int]:
        """How bad the place is; one that misleads is worse than one that covers something."""
        return self.clashes + OUTSIDE * (self.doubts >= AMBIGUOUS), self.doubts


def best_spot(
    chart: Array,
    anchors: Array,
    size: Array,
    used: Array,
    scale: float,
    own: Any = None,
    others: Sequence[Any] = (),
) -> Spot:
    """Return the best place for a label.

    Args:
        chart: box that the label must not leave.
        anchors: the label's point, then places on its outline, (n, 2).
        size: width and height of the label.
        used: boxes in use, (m, 4).
        scale: pixels of a typographic point.
        own: the area that it labels, of `area`; None: it labels a point.
        others: areas of other labels.
    """
    found = []
    for away in FROM_POINT if own is None else FROM_OUTLINE:
        spot = _best_at(away, chart, anchors, size, used, scale, own, others)
        found.append(spot)
        if spot.badness <= (0, int(away >= LED)):
            break
    return min(found, key=lambda spot: spot.badness)


def _best_at(
    away: float,
    chart: Array,
    anchors: Array,
    size: Array,
    used: Array,
    scale: float,
    own: Any,
    others: Sequence[Any],
) -> Spot:
    """Return the best place at a distance [typographic points] from the anchors."""
    offsets = away * scale * DIRECTIONS
    ends = (anchors[:, None] + offsets).reshape(-1, 2)
    low = ends - np.tile(size * (1 - SIDES) / 2, (len(anchors), 1))
    boxes = np.concatenate([low, low + size], axis=1)
    inside = ((boxes[:, :2] >= chart[:2]) & (boxes[:, 2:] <= chart[2:])).all(axis=1)
    above = (boxes[:, None, :2] < used[:, 2:]) & (boxes[:, None, 2:] > used[:, :2])
    clashes = above.all(axis=2).sum(axis=1) + np.where(inside, 0, OUTSIDE)
    free = np.flatnonzero(clashes == clashes.min())
    starts, led = np.repeat(anchors, len(DIRECTIONS), axis=0), away >= LED
    doubts = np.zeros(len(free), int)
    if own is not None:
        label = shapely.box(*boxes[free].T)
        touched = sum((shapely.intersects(other, label).astype(int) for other in others), doubts)
        if led:
            doubts = 1 + touched + _crossed(starts[free], ends[free], used, others)
        else:
            doubts = np.where(shapely.intersects(own, label) & (touched == 0), 0, AMBIGUOUS)
    best = int(np.argmin(doubts))
    k = free[best]
    which = k % len(DIRECTIONS)
    return Spot(
        int(clashes[k]), int(doubts[best]), starts[k], offsets[which], SIDES[which], boxes[k], led
    )


def _crossed(starts: Array, ends: Array, used: Array, others: Sequence[Any]) -> Array:
    """Return how many boxes and areas lines cross, int (n,)."""
    lines = shapely.linestrings(np.stack([starts, ends], axis=1))
    areas = [shapely.intersects(other, lines) for other in others]
    # not at the start, which may have a mark
    on_lines = starts[:, None] + np.linspace(0.3, 1, 8)[:, None] * (ends - starts)[:, None]
    across = on_lines[:, :, None]
    boxes = ((across > used[:, :2]) & (across < used[:, 2:])).all(axis=3).any(axis=1)
    return np.asarray(boxes.sum(axis=1) + np.sum(areas, axis=0, initial=0), int)


def area(outline: Array) -> Any:
    """Return the area inside a closed outline (n, 2), or an open line, for `best_spot`."""
    closed = len(outline) > 3 and np.allclose(outline[0], outline[-1])
    shape = shapely.Polygon(outline) if closed else shapely.LineString(outline)
    found = shapely.make_valid(shapely.simplify(shape, 1.0))
    shapely.prepare(found)
    return found


def along(outline: Array, chart: Array) -> Array:
    """Return up to ANCHORS places (n, 2) on an outline that are on the chart."""
    line = shapely.LineString(outline)
    places = shapely.line_interpolate_point(
        line, np.linspace(0, 1, 8 * ANCHORS, endpoint=False), normalized=True
    )
    xy = shapely.get_coordinates(places)
    xy = xy[((xy >= chart[:2]) & (xy <= chart[2:])).all(axis=1)]
    return np.asarray(xy[:: max(-(-len(xy) // ANCHORS), 1)])
