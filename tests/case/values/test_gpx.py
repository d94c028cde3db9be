"""GPX tracks: what receivers write, and what they should not; GDAL's reader is the oracle."""

from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely

from drift.case.values import gpx
from geo.errors import UserError

HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n<gpx version="1.1" creator="t" xmlns="http://www.topografix.com/GPX/1/1">'


def point(lon: object, lat: object, time: str | None = None, name: str = "trkpt") -> str:
    return (
        f'<{name} lon="{lon}" lat="{lat}">{"" if time is None else f"<time>{time}</time>"}</{name}>'
    )


def track(*segments: str) -> str:
    return f"{HEAD}<trk>{''.join(f'<trkseg>{points}</trkseg>' for points in segments)}</trk></gpx>"


def noon(minute: int, second: str = "00") -> str:
    return f"2026-11-21T12:{minute:02d}:{second}Z"


TWO = point(179.9, -20, noon(0)) + point(-179.9, -20.5, noon(30))


def read(tmp_path: Path, text: str | bytes) -> gpx.Track:
    path = tmp_path / "t.gpx"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return gpx.read_gpx(path)


def refusal(tmp_path: Path, text: str | bytes) -> str:
    with pytest.raises(UserError) as caught:
        read(tmp_path, text)
    line = str(caught.value)
    assert "\n" not in line
    assert line.startswith('"t.gpx" ')
    return line


def seconds(time: str) -> float:
    return float(np.datetime64(time, "ms").astype(np.int64)) / 1000


def test_a_track_as_gdal_reads_it(tmp_path: Path) -> None:
    points = "".join(point(-88 + k / 100, 27 + k / 300, noon(k)) for k in range(40))
    found = read(tmp_path, track(points))
    layer = pyogrio.raw.read(tmp_path / "t.gpx", layer="track_points", columns=["time"])
    places = shapely.get_coordinates(shapely.from_wkb(layer[2]))
    assert np.column_stack([found.lon, found.lat]) == pytest.approx(places)
    assert found.time == tuple(layer[3][0].astype("datetime64[s]").astype(float))
    assert found.joined == (True,) * 39


def test_times_in_all_their_spellings(tmp_path: Path) -> None:
    """An offset, no zone (UTC, as GPX says), decimals of any length."""
    times = [
        "2026-11-21T14:00:00+02:00",
        "2026-11-21T12:00:01",
        "2026-11-21T12:00:02.5Z",
        "2026-11-21T12:00:03.1234567Z",
    ]
    found = read(tmp_path, track("".join(point(k, k, time) for k, time in enumerate(times))))
    assert np.array(found.time) - seconds("2026-11-21T12:00") == pytest.approx(
        [0, 1, 2.5, 3.123456], abs=1e-5
    )


def test_segments_follow_each_other_with_gaps(tmp_path: Path) -> None:
    """The receiver lists its later segment first; what lies between was not searched."""
    late = point(3, 3, noon(20)) + point(4, 4, noon(30))
    early = point(1, 1, noon(0)) + point(2, 2, noon(10))
    found = read(tmp_path, track(late, early, ""))
    assert found.lon == (1, 2, 3, 4)
    assert found.joined == (True, False, True)


def test_points_of_the_same_second_are_one(tmp_path: Path) -> None:
    points = point(1, 1, noon(0)) + point(1, 1, noon(0)) + point(2, 2, noon(1))
    found = read(tmp_path, track(points))
    assert (found.lon, found.joined) == ((1, 2), (True,))


def test_routes_and_waypoints_have_no_times(tmp_path: Path) -> None:
    route = "".join(point(k, 2 * k, name="rtept") for k in range(3))
    found = read(tmp_path, f"{HEAD}<rte>{route}</rte>{point(9, 9, name='wpt')}</gpx>")
    assert (found.time, found.lon, found.lat) == ((), (0, 1, 2), (0, 2, 4))
    found = read(
        tmp_path, f"{HEAD}{point(9, 9, noon(0), name='wpt')}{point(8, 9, name='wpt')}</gpx>"
    )
    assert (found.time, found.lon) == ((), (9, 8))


def test_any_namespace_encoding_and_a_mark(tmp_path: Path) -> None:
    plain = f"<gpx><trk><trkseg>{TWO}</trkseg></trk></gpx>"
    assert read(tmp_path, plain).lon == pytest.approx((179.9, -179.9))
    assert read(tmp_path, plain.encode("utf-8-sig")).lat == (-20, -20.5)
    wide = '<?xml version="1.0" encoding="UTF-16"?>' + plain
    assert read(tmp_path, wide.encode("utf-16")).lat == (-20, -20.5)


BAD = {
    "no XML": ("hello", "not valid XML"),
    "nothing": ("", "not valid XML"),
    "cut off": (track(TWO)[:-20], "not valid XML"),
    "another format": ("<kml></kml>", "outermost element is <kml>"),
    "no points": (HEAD + "</gpx>", "no track, no route and no waypoints"),
    "one point": (track(point(1, 1, noon(0))), "only one point"),
    "one moment": (track(point(1, 1, noon(0)) * 2), "only one point"),
    "off Earth": (track(point(1, 91, noon(0)) + TWO), "lat 91, which is not on Earth"),
    "nan": (track(point("nan", 1, noon(0)) + TWO), "not on Earth"),
    "words": (track(point("east", 1, noon(0)) + TWO), "without proper lon and lat"),
    "no longitude": (track('<trkpt lat="3"/>' + TWO), "without proper lon and lat"),
    "half of the times": (track(TWO + point(1, 1)), "times for 2 of its 3 points"),
    "a word for a time": (track(point(1, 1, "noon") + TWO), 'invalid time: "noon"'),
    "an empty time": (track(point(1, 1, "") + TWO), "invalid time"),
    "back in time": (
        track(TWO + point(1, 1, noon(10))),
        "goes back in time at 2026-11-21T12:10:00Z",
    ),
    "two receivers": (
        track(TWO, point(1, 1, noon(10)) + point(1, 2, noon(40))),
        "two segments at the same time",
    ),
    "entities": (
        '<!DOCTYPE gpx [<!ENTITY a SYSTEM "file:///etc/passwd">]><gpx>&a;</gpx>',
        "document type",
    ),
    "an unknown encoding": ('<?xml version="1.0" encoding="klingon"?><gpx/>', "not valid XML"),
}


@pytest.mark.parametrize("kind", BAD)
def test_what_is_no_track(kind: str, tmp_path: Path) -> None:
    text, word = BAD[kind]
    assert word in refusal(tmp_path, text)


def test_a_document_type_in_wide_letters(tmp_path: Path) -> None:
    text = '<?xml version="1.0" encoding="UTF-16"?><!DOCTYPE gpx [<!ENTITY a "b">]><gpx>&a;</gpx>'
    assert "document type" in refusal(tmp_path, text.encode("utf-16"))


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="cannot be read"):
        gpx.read_gpx(tmp_path / "none.gpx")
