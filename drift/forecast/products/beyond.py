"""Texts about what a picture's frame leaves out: probability, contacts and positions."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import shapely
from scipy import ndimage

from drift.forecast.products.words import TELLING
from drift.products.maps.chart import Frame
from geo import notation, sphere
from geo.array import Array

POINTS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")
NEARLY = 0.9  # share of the probability outside that counts as all of it
NAMED = 3  # places listed by name; the rest are counted


def outside_frame_sentence(
    frame: Frame, at: Any, places: Mapping[str, Sequence[Array]] | None = None
) -> str:
    """Return a sentence on what a frame leaves out of the map at a time; "" if that is negligible.

    A place is reported if no point of it is inside the frame; probability if more than TELLING is
    outside.

    Args:
        frame: of the picture.
        at: a forecast's data (drift.forecast.products.dataset) at one time.
        places: shapes (n, 2) [deg] by name.
    """
    parts = [_probability(frame, at), named(frame, places or {})]
    return "; ".join(part for part in parts if part)


def aside(frame: Frame, at: Any) -> str:
    """Return a short note for a small map on the probability outside its frame; "" if
    negligible.
    """
    mass = _outside(frame, at)
    total = float(mass.sum())
    if total <= TELLING:
        return ""
    lon, lat, _ = _main_cluster(mass, at)
    inside = _within(frame, np.array([[lon, lat]]))[0]
    return f"{notation.percent(total)} outside the frame{'' if inside else f', {_compass_point(frame, lon, lat)}'}"


def _within(frame: Frame, points: Array) -> Array:
    """Return which of points (n, 2) [deg] are in a frame, bool (n,)."""
    return frame.holds(*frame.project(points[:, 0], points[:, 1]))


def is_outside_frame(frame: Frame, shapes: Sequence[Array]) -> bool:
    """Return True if shapes are all outside a frame: no line crosses it and no closed shape
    surrounds it.
    """
    box = shapely.box(frame.x[0], frame.y[0], frame.x[1], frame.y[1])
    for points in shapes:
        xy = np.column_stack(frame.project(points[:, 0], points[:, 1]))
        xy = xy[np.isfinite(xy).all(axis=1)]
        if len(xy) == 0:
            continue
        closed = len(xy) > 3 and np.allclose(xy[0], xy[-1])
        shape = (
            shapely.Polygon(xy)
            if closed
            else shapely.LineString(xy)
            if len(xy) > 1
            else shapely.Point(xy[0])
        )
        if shapely.intersects(shapely.make_valid(shape), box):
            return False
    return bool(len(shapes))


def _outside(frame: Frame, at: Any) -> Array:
    """Return the probability of the cells outside a frame, 0 for cells inside, (nlat, nlon)."""
    mass = at["probability"].values.astype(np.float64)
    mass[frame.holds(*frame.net(at["lon"].values, at["lat"].values))] = 0.0
    return np.asarray(mass)


def _probability(frame: Frame, at: Any) -> str:
    mass = _outside(frame, at)
    total = float(mass.sum())
    if total <= TELLING:
        return ""
    lon, lat, alone = _main_cluster(mass, at)
    words = f"{notation.percent(total)} of the probability lies outside this frame"
    if _within(frame, np.array([[lon, lat]]))[
        0
    ]:  # the mean is inside, so the probability surrounds the frame
        return f"{words}, on several sides"
    return f"{words}, {'' if alone else 'most of it '}{_direction_and_position(frame, lon, lat)}"


def _main_cluster(mass: Array, at: Any) -> tuple[float, float, bool]:
    """Return the mean position (lon, lat) [deg] of the heaviest cluster, and whether it holds
    nearly all.

    A cluster is a set of connected cells. Only the densest cells, which together hold NEARLY all
    the probability, are used, because smoothing leaves traces everywhere.
    """
    height = (mass / at["cell_area"].values).ravel()
    order = np.argsort(-height, kind="stable")
    inside = np.cumsum(mass.ravel()[order])
    kept = np.zeros(mass.size, bool)
    kept[order[: int(np.searchsorted(inside, NEARLY * inside[-1])) + 1]] = True
    patch, many = ndimage.label(kept.reshape(mass.shape), np.ones((3, 3), int))
    each = ndimage.sum_labels(mass, patch, np.arange(1, many + 1))
    rows, columns = np.nonzero(patch == int(np.argmax(each)) + 1)
    weight = mass[rows, columns]
    lon, lat = (
        float(np.average(at[name].values[i], weights=weight))
        for name, i in (("lon", columns), ("lat", rows))
    )
    return lon, lat, bool(each.max() >= NEARLY * each.sum())


def named(frame: Frame, places: Mapping[str, Sequence[Array]]) -> str:
    """Return a text on the places outside a frame and their direction; "" if there are none."""
    outside = [
        f"{name}, {_direction_and_position(frame, *shapes[0].mean(axis=0))}"
        for name, shapes in places.items()
        if is_outside_frame(frame, shapes)
    ]
    if not outside:
        return ""
    more = f" and {len(outside) - NAMED} more" if len(outside) > NAMED else ""
    return f"outside this frame: {'; '.join(outside[:NAMED])}{more}"


def _direction_and_position(frame: Frame, lon: float, lat: float) -> str:
    """Return a place's direction from the middle of a frame, and its position, as text."""
    return f"to the {_compass_point(frame, lon, lat)} (around {notation.position(lon, lat)})"


def _compass_point(frame: Frame, lon: float, lat: float) -> str:
    """Return the direction from the middle of a frame to a place, as one of eight points."""
    east, north = sphere.offset(*np.radians(frame.centre), *np.radians([lon, lat]))
    return POINTS[round(float(np.degrees(np.arctan2(east, north))) / 45) % 8]
