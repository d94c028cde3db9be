"""Read GPX tracks of GPS receivers (topografix.com/GPX/1/1), with or without times.

Reads track points; if there are none, route points; if there are none, waypoints. Between two
segments of a track is a gap that was not searched. Element names count in any namespace. Files with
a document type are rejected, because it could include other files.

The library gpxpy (1.6.2) is not used: it reads only UTF-8, ignores invalid times, and silently
finds no points in files with namespace prefixes or in files that are not GPX.
"""

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from geo import sphere
from geo.errors import UserError
from geo.files import small

LARGEST = 100 * 2**20  # [bytes]


@dataclass(frozen=True)
class Track:
    """The points of one file; `time` is empty if the points have no times."""

    time: tuple[float, ...]  # [s since 1970], ascending
    lon: tuple[float, ...]  # [deg]
    lat: tuple[float, ...]
    joined: tuple[bool, ...]  # whether a point and the next are in the same segment


def track_names(path: Path | str) -> list[str]:
    """Return the names of the tracks of a GPX file, "" for one without; raise UserError as
    `read_gpx`.
    """
    path = Path(path)
    try:
        root = _root(path)
    except ValueError as error:
        raise UserError(f'"{path.name}" {error}') from None
    except OSError as error:
        raise UserError(f'"{path.name}" cannot be read: {error.strerror}') from None
    return [_title(track) for track in _inside(root, "trk")]


def _title(track: ET.Element) -> str:
    """Return the name of a track; "" if it has none."""
    return next(((name.text or "").strip() for name in _inside(track, "name")), "")


def read_gpx(path: Path | str, name: str | None = None) -> Track:
    """Return the track of a GPX file; raise UserError if the file holds no valid track.

    Args:
        path: of the file.
        name: of the one of its tracks that is read; None: all of them as one.
    """
    path = Path(path)
    try:
        root = _root(path)
        for track in _inside(root, "trk"):
            if name is not None and _title(track) != name:
                root.remove(track)
        return _track(root)
    except ValueError as error:
        raise UserError(f'"{path.name}" {error}') from None
    except OSError as error:
        raise UserError(f'"{path.name}" cannot be read: {error.strerror}') from None


def _root(path: Path) -> ET.Element:
    data = small.read_small_file(path, LARGEST)
    plain = data.replace(b"\0", b"")  # finds the text in UTF-16, too
    if b"<!DOCTYPE" in plain or b"<!ENTITY" in plain:
        raise ValueError(
            "has a document type (<!DOCTYPE ..>), which no GPX file needs; save it again without"
        )
    try:
        root = ET.fromstring(data)
    except (ET.ParseError, ValueError, LookupError) as error:
        # LookupError: an unknown encoding
        raise ValueError(f"is not a GPX file: not valid XML ({error})") from None
    if _name(root) != "gpx":
        raise ValueError(
            f"is not a GPX file: its outermost element is <{_name(root)[:40]}>, not <gpx>"
        )
    return root


def _name(element: ET.Element) -> str:
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


def _inside(element: ET.Element, name: str) -> list[ET.Element]:
    return [child for child in element if _name(child) == name]


def _track(root: ET.Element) -> Track:
    segments = [
        _inside(part, "trkpt")
        for track in _inside(root, "trk")
        for part in _inside(track, "trkseg")
    ]
    segments = [segment for segment in segments if segment]
    if not segments:
        segments = [points for route in _inside(root, "rte") if (points := _inside(route, "rtept"))]
    if not segments and (points := _inside(root, "wpt")):
        segments = [points]
    if not segments:
        raise ValueError("holds no points: no track, no route and no waypoints")
    rows_by_segment = [
        [(_time(point), *_place(point)) for point in segment] for segment in segments
    ]
    timed = [time for segment in rows_by_segment for time, _, _ in segment if time is not None]
    total = sum(map(len, rows_by_segment))
    if not timed or (len(timed) < total and _name(segments[0][0]) != "trkpt"):
        rows = [(math.nan, lon, lat) for segment in rows_by_segment for _, lon, lat in segment]
        joined = [k < len(segment) - 1 for segment in rows_by_segment for k in range(len(segment))][
            :-1
        ]
    elif len(timed) < total:
        raise ValueError(
            f"has times for {len(timed):,} of its {total:,} points; give all a time, or none"
        )
    else:
        timed_segments = [
            [(time, lon, lat) for time, lon, lat in segment if time is not None]
            for segment in rows_by_segment
        ]
        rows, joined = _ordered(sorted(timed_segments, key=lambda segment: segment[0][0]))
    if len(rows) < 2:
        raise ValueError("holds only one point; a track needs two")
    time, lon, lat = (tuple(column) for column in zip(*rows, strict=True))
    return Track(time if timed and not math.isnan(time[0]) else (), lon, lat, tuple(joined))


def _ordered(
    segments: list[list[tuple[float, float, float]]],
) -> tuple[list[tuple[float, float, float]], list[bool]]:
    """Join segments in order of time; drop a point with the same time as the one before.

    Return the points, and for each pair of neighbours whether they are in the same segment.
    """
    points: list[tuple[float, float, float]] = []
    joined: list[bool] = []
    for segment in segments:
        for k, point in enumerate(segment):
            if points and point[0] < points[-1][0]:
                what = "goes back in time" if k else "has two segments at the same time,"
                raise ValueError(
                    f"{what} at {_format_time(point[0])}, after {_format_time(points[-1][0])}; put its points in order"
                )
            if points and point[0] == points[-1][0]:
                continue
            if points:
                joined.append(k > 0)
            points.append(point)
    return points, joined


def _format_time(time: float) -> str:
    return f"{datetime.fromtimestamp(time, UTC):%Y-%m-%dT%H:%M:%SZ}"


def _place(point: ET.Element) -> tuple[float, float]:
    try:
        lon, lat = float(point.attrib["lon"]), float(point.attrib["lat"])
    except (KeyError, ValueError):
        raise ValueError(f"has a point without proper lon and lat: {dict(point.attrib)}") from None
    if not (-180 <= lon <= 360 and -90 <= lat <= 90):
        raise ValueError(f"has a point at lon {lon:g}, lat {lat:g}, which is not on Earth")
    return sphere.wrap_degrees(lon), lat


def _time(point: ET.Element) -> float | None:
    """Return a point's time [s since 1970]; without a zone it is UTC, as GPX specifies."""
    for element in _inside(point, "time"):
        text = (element.text or "").strip()
        try:
            moment = datetime.fromisoformat(text.upper())
        except ValueError:
            raise ValueError(
                f'has an invalid time: "{text[:40]}"; it must be like 2026-11-21T18:30:00Z'
            ) from None
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    return None
