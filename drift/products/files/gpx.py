"""GPX 1.1 (topografix.com/GPX/1/1): documents, points and tracks, in the schema's element order.

The schema's longitudes end below 180. A track is split there, and a segment that reaches the
antimeridian from the west ends at LAST_EAST, 1 cm short of it, so that no segment jumps by 360
degrees.
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
    """Return an empty document; append waypoints first, then routes, then tracks."""
    root = ET.Element("gpx", {"xmlns": SPACE, "version": "1.1", "creator": "casp-drift"})
    metadata = ET.SubElement(root, "metadata")
    markup.leaf(metadata, "name", title)
    if words:
        markup.leaf(metadata, "desc", words)
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
    """Append a point (wpt, rtept or trkpt) to an element.

    Args:
        parent: the element.
        tag: "wpt", "rtept" or "trkpt".
        lon, lat: position [deg].
        time: np.datetime64, UTC.
        name: name of the point.
        words: its description.
        kind: its type.
    """
    element = ET.SubElement(parent, tag, markup.position(lon, lat))
    children = {
        "time": "" if time is None else notation.iso(time),
        "name": name,
        "desc": words,
        "type": kind,
    }
    for key, value in children.items():
        if value:
            markup.leaf(element, key, value)


def segments(
    track: ET.Element,
    lon: Sequence[float],
    lat: Sequence[float],
    times: Sequence[Any] | None = None,
) -> None:
    """Append a line to a track, with a segment on each side of the antimeridian.

    Args:
        track: the track element.
        lon, lat: points [deg], shape (n,); each step takes the shorter way round.
        times: times of the points; where the line is split, time is linear in longitude.
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
    """Yield the parts of a line between antimeridians, each with its turns from [-180, 180]."""
    if len(points) == 1:
        yield _turn(points[0][0]), list(points)
        return
    last, part = 0, list[Fix]()
    for a, b in pairwise(points):
        for begin, end in _split_at_seam(a, b):
            turn = _turn((begin[0] + end[0]) / 2)
            if part and turn != last:
                yield last, part
                part = []
            part = [*part, end] if part else [begin, end]
            last = turn
    if part:
        yield last, part


def _split_at_seam(a: Fix, b: Fix) -> list[tuple[Fix, Fix]]:
    """Return the step between two points as one piece, or two if the antimeridian splits it."""
    seam = 360.0 * max(_turn(a[0]), _turn(b[0])) - 180
    if not min(a[0], b[0]) < seam < max(a[0], b[0]):
        return [(a, b)]
    share = (seam - a[0]) / (b[0] - a[0])
    time = None if a[2] is None or b[2] is None else a[2] + (b[2] - a[2]) * share
    middle = (seam, a[1] + share * (b[1] - a[1]), time)
    return [(a, middle), (middle, b)]


def _turn(lon: float) -> int:
    return int(np.floor((lon + 180) / 360))
