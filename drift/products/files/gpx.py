"""GPX 1.1 (topografix.com/GPX/1/1): a document, its points and its tracks, in the order of elements
of its schema.

Longitudes of the schema end below 180. A track is cut there, and the end of a segment that comes
from the west is written LAST_EAST, 1 cm short of it, so that no segment jumps by 360 degrees.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from drift.products.files import markup
from geo import notation

SPACE = "http://www.topografix.com/GPX/1/1"
LAST_EAST = 180 - 10.0**-markup.DIGITS  # [deg] the last longitude that the schema allows

Fix = tuple[float, float, Any]  # lon, lat [deg], time or None


def document(title: str, words: str) -> ET.Element:
    """Return an empty document; waypoints come first, then routes, then tracks."""
    root = ET.Element("gpx", {"xmlns": SPACE, "version": "1.1", "creator": "casp-drift"})
    about = ET.SubElement(root, "metadata")
    markup.leaf(about, "name", title)
    if words:
        markup.leaf(about, "desc", words)
    return root


def point(
    parent: ET.Element,
    tag: str,
    lon: float,
    lat: float,
    *,
    time: Any = None,
    name: str = "",
    words: str = "",
    kind: str = "",
) -> None:
    """Append a point [deg]: wpt, rtept or trkpt; time: np.datetime64, UTC."""
    element = ET.SubElement(parent, tag, markup.position(lon, lat))
    told = {
        "time": "" if time is None else notation.iso(time),
        "name": name,
        "desc": words,
        "type": kind,
    }
    for key, value in told.items():
        if value:
            markup.leaf(element, key, value)


def segments(
    track: ET.Element,
    lon: Sequence[float],
    lat: Sequence[float],
    times: Sequence[Any] | None = None,
) -> None:
    """Append a line [deg] to a track, a segment on each side of the antimeridian.

    It goes from point to point the short way round; where it is cut, time is linear in longitude.
    """
    points = list(
        zip(
            np.unwrap(np.asarray(lon, float), period=360).tolist(),
            lat,
            times or [None] * len(lat),
            strict=True,
        )
    )
    for turn, part in _parts(points):
        segment = ET.SubElement(track, "trkseg")
        for x, y, time in part:
            east = round(x - 360 * turn, markup.DIGITS)
            point(segment, "trkpt", min(max(east, -180.0), LAST_EAST), y, time=time)


def _parts(points: Sequence[Fix]) -> Iterator[tuple[int, list[Fix]]]:
    """Yield the parts of a line between two antimeridians, and how many turns each is from -180 to
    180.
    """
    if len(points) == 1:
        yield _turn(points[0][0]), list(points)
        return
    last, part = 0, list[Fix]()
    for a, b in pairwise(points):
        for begin, end in _halves(a, b):
            turn = _turn((begin[0] + end[0]) / 2)
            if part and turn != last:
                yield last, part
                part = []
            part = [*part, end] if part else [begin, end]
            last = turn
    if part:
        yield last, part


def _halves(a: Fix, b: Fix) -> list[tuple[Fix, Fix]]:
    """Return the piece from one point to another, or the two into which the antimeridian cuts it."""
    seam = 360.0 * max(_turn(a[0]), _turn(b[0])) - 180
    if not min(a[0], b[0]) < seam < max(a[0], b[0]):
        return [(a, b)]
    share = (seam - a[0]) / (b[0] - a[0])
    time = None if a[2] is None or b[2] is None else a[2] + (b[2] - a[2]) * share
    middle = (seam, a[1] + share * (b[1] - a[1]), time)
    return [(a, middle), (middle, b)]


def _turn(lon: float) -> int:
    return int(np.floor((lon + 180) / 360))
