"""Detections of a user's own: every mistake is a line that says what is wrong, what was given and
what is allowed.
"""

from pathlib import Path as File

import numpy as np
import pytest

from drift.case.tracking import tracking
from drift.tracking.tracker import path
from drift.tracking.tracker.detections import Detections
from geo.errors import UserError

CASE = """
title = "t"
start = "2026-03-05T00:00Z"
duration = "1 h"
detections = "d.csv"
[[sensor]]
name = "radar"
reach = "18 nmi"
range_ambiguity = 0.1
bearing_ambiguity = 1.5
[[sensor]]
name = "ears"
reach = "60 nmi"
range_ambiguity = 0.8
bearing_ambiguity = 5
hears = true
[[method]]
name = "m"
fastest = "32 kn"
"""
ROWS = """time, sensor, bearing, range, lat, lon
2026-03-05T00:01Z, radar, 41.5, 9.2, 14 00.0N, 077 00.0W
+10 min, ears, 350, , 14 03.1N, 076 58.0W
+0.5 h,,,,14 06N,-76.93
2026-03-05T00:40:30Z, radar, , 7 km, 14.15, -76.9
"""
PLAIN = "time,sensor,bearing,range\n+1 min,radar,41.5,9.2\n+9 min,radar,43,9.6\n"
STANDS = '[tracker]\nat = "14N 077W"\n'


def load(folder: File, case: str = CASE, rows: str = ROWS) -> tracking.Study:
    (folder / "c.toml").write_text(case, encoding="utf-8")
    (folder / "d.csv").write_text(rows, encoding="utf-8")
    return tracking.load(folder / "c.toml")


def test_detections_are_read_in_their_units(tmp_path: File) -> None:
    asked = load(tmp_path, rows=ROWS)
    found = asked.target
    assert isinstance(found, Detections)
    np.testing.assert_allclose(found.time, [60, 600, 2430])
    np.testing.assert_array_equal(found.sensor, [0, 1, 0])
    np.testing.assert_allclose(np.degrees(found.bearing), [41.5, 350, np.nan])
    np.testing.assert_allclose(found.range, [9.2 * 1852, np.nan, 7000])
    np.testing.assert_allclose(asked.tracker.time, [60, 600, 1800, 2430])
    lon, lat = path.degrees(asked.tracker.place)
    np.testing.assert_allclose(lon, [-77, -76 - 58 / 60, -76.93, -76.9])
    np.testing.assert_allclose(lat, [14, 14 + 3.1 / 60, 14.1, 14.15])


@pytest.mark.parametrize(
    ("delimiter", "point", "coding"),
    [(";", ",", "utf-8-sig"), ("\t", ",", "utf-16"), ("\t", ".", "utf-16-be"), (",", ".", "utf-8")],
)
def test_spreadsheets_write_tables_in_many_ways(
    tmp_path: File, delimiter: str, point: str, coding: str
) -> None:
    """Semicolons or tabs and decimal commas, "Unicode text", lines and columns without values,
    names in capitals, a line for Excel, a comment.
    """
    one = load(tmp_path)
    cells = [
        [cell.strip().replace(".", point) for cell in line.split(",")] for line in ROWS.splitlines()
    ]
    cells[0] = [name.upper() for name in cells[0]]
    rows = [
        f"sep={delimiter}",
        "# our log",
        *(delimiter.join([*row, "", ""]) for row in [*cells, [""] * 6]),
    ]
    text = "\r\n".join(rows) + "\r\n"
    mark = b"\xfe\xff" if coding == "utf-16-be" else b""
    (tmp_path / "d.csv").write_bytes(mark + text.encode(coding))
    two = tracking.load(tmp_path / "c.toml")
    for name in ("time", "sensor", "bearing", "range"):
        np.testing.assert_array_equal(getattr(one.target, name), getattr(two.target, name))
    np.testing.assert_array_equal(one.tracker.place, two.tracker.place)


TABLES = """
[[detection]]
time = "2026-03-05T00:01Z"
sensor = "radar"
bearing = 41.5
range = "9.2 nmi"
lat = "14 00.0N"
lon = "077 00.0W"
[[detection]]
time = "+10 min"
sensor = "ears"
bearing = 350
lat = "14 03.1N"
lon = "076 58.0W"
[[detection]]
time = "+0.5 h"
lat = 14.1
lon = -76.93
[[detection]]
time = "2026-03-05T00:40:30Z"
sensor = "radar"
range = "7 km"
lat = 14.15
lon = -76.9
"""


def test_detections_in_the_case_are_those_of_a_file(tmp_path: File) -> None:
    one = load(tmp_path)
    two = load(tmp_path, CASE.replace('detections = "d.csv"\n', "") + TABLES)
    for name in ("time", "sensor", "bearing", "range"):
        np.testing.assert_allclose(getattr(one.target, name), getattr(two.target, name), rtol=1e-12)
    np.testing.assert_allclose(one.tracker.place, two.tracker.place, rtol=1e-12)
    assert tracking.is_tracking_case(tmp_path / "c.toml")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"+10 min"', '"+30 s"', "detection 2: time 2026-03-05T00:00:30Z is before that of the line above"),
        ('"ears"', '"nose"', 'detection 2: no [[sensor]] "nose"; there are radar, ears'),
        ('"9.2 nmi"', '"-9.2 nmi"', "detection 1.range: range -9.2 nmi must be above 0"),
        ('"9.2 nmi"', "9.2", 'detection 1.range: range 9.2 has no unit; write it like "9.2 nmi"'),
        ('"9.2 nmi"', '"9.2"', 'detection 1.range: range 9.2 has no unit; write it like "9.2 nmi"'),
        ('"9.2 nmi"', '"49.676 nmi"', "detection 1: range 49.68 nmi is beyond the reach of radar, 18 nmi"),
        ("bearing = 350", "course = 350", 'detection 2: unknown key "course"'),
        ('lat = "14 00.0N"\nlon = "077 00.0W"\n', "", "detection: the tracker has no position at the first"),
    ],
)  # fmt: skip
def test_mistakes_of_detections_in_the_case_are_lines(
    tmp_path: File, old: str, new: str, words: str
) -> None:
    tables = TABLES.replace(old, new)
    assert tables != TABLES
    with pytest.raises(UserError) as refusal:
        load(tmp_path, CASE.replace('detections = "d.csv"\n', "") + tables)
    assert any(words in line for line in refusal.value.lines), refusal.value.lines


def test_detections_are_given_once(tmp_path: File) -> None:
    with pytest.raises(
        UserError, match=r"detections and \[\[detection\]\] are both given; give one"
    ):
        load(tmp_path, CASE + TABLES)


def test_a_tracker_stays_where_its_legs_end(tmp_path: File) -> None:
    legs = 'legs = [{ course = 90, speed = "12 kn", lasting = "10 min" }]\n'
    asked = load(tmp_path, CASE + STANDS + legs, PLAIN)
    there = asked.tracker.at([600.0, 3600.0])[0]
    np.testing.assert_array_equal(there[0], there[1])
    assert asked.tracker.time[-1] == 3600
    assert load(tmp_path, CASE + STANDS, PLAIN).tracker.time[-1] == 3600


def test_a_tracker_goes_by_a_track(tmp_path: File) -> None:
    points = "".join(
        f'<trkpt lat="{14 + k / 100}" lon="-77.0"><time>2026-03-05T00:{10 * k:02d}:00Z</time></trkpt>'
        for k in range(4)
    )
    gpx = f'<gpx xmlns="http://www.topografix.com/GPX/1/1" version="1.1" creator="x"><trk><trkseg>{points}</trkseg></trk></gpx>'
    (tmp_path / "own.gpx").write_text(gpx, encoding="utf-8")
    way = load(tmp_path, CASE + '[tracker]\ntrack = "own.gpx"\n', PLAIN).tracker
    np.testing.assert_allclose(way.time, [0, 600, 1200, 1800])
    np.testing.assert_allclose(path.degrees(way.at([900.0])[0])[1], 14.015)
    pursuit = '[tracker]\ntrack = "own.gpx"\n[pursuit]\nspeed = "25 kn"\nreach = "5 nmi"\nstep = "2 min"\n'
    chase = load(tmp_path, CASE + pursuit, PLAIN).pursuit
    assert chase is not None
    assert chase.begin == 1800  # until when the track has it
    with pytest.raises(
        UserError,
        match="begins 050030ZMAR26, and the case ends 050030ZMAR26: no step of 2 min fits between; give begin",
    ):
        load(tmp_path, CASE.replace('"1 h"', '"30 min"') + pursuit, PLAIN)
    (tmp_path / "own.gpx").write_text(
        gpx.replace("<time>2026-03-05T00:", "<!--").replace("Z</time>", "-->"), encoding="utf-8"
    )
    with pytest.raises(UserError, match=r"tracker.*without times"):
        load(tmp_path, CASE + '[tracker]\ntrack = "own.gpx"\n', PLAIN)


@pytest.mark.parametrize(
    ("case", "rows", "words"),
    [
        (CASE + STANDS, PLAIN.replace("+9", "+0.5"), "line 3: time 2026-03-05T00:00:30Z is before that of the line above; order the lines"),
        (CASE, PLAIN, "tracker: it has no position; give at with legs, track (a GPX file), or lat and lon"),
        (CASE + STANDS, PLAIN.replace("43,9.6", "43,9.6,1"), "line 3: as many values as names are needed"),
        (CASE + STANDS, PLAIN.replace("radar,43", "sonar,43"), 'line 3: no [[sensor]] "sonar"; there are radar, ears'),
        (CASE + STANDS, PLAIN.replace("9.6", "25"), "line 3: range 25 nmi is beyond the reach of radar, 18 nmi"),
        (CASE + STANDS, PLAIN.replace("43,", "430,"), "line 3: bearing: "),
        (CASE + STANDS, PLAIN.replace("9.6", "-9.6"), "line 3: range: range -9.6 nmi must be above 0"),
        (CASE + STANDS, PLAIN.replace("9.6", "0"), "line 3: range: range 0.0 nmi must be above 0"),
        (CASE + STANDS, PLAIN.replace("radar,43", ",43"), "line 3: a bearing or a range without a sensor; there are radar, ears"),
        (CASE + STANDS, PLAIN.replace("43,9.6", ","), "line 3: neither a bearing nor a range: a line with a sensor is a detection"),
        (CASE, ROWS + "+50 min, radar, 12, 8, ,\n", "the tracker has no position at the detection of 050050ZMAR26"),
        (CASE, ROWS + "2026-03-05T00:40:30Z, , , , 14.16, -76.9\n", "line 6: the tracker has two positions at 2026-03-05T00:40:30Z; the other is above"),
        (CASE + STANDS, PLAIN.replace("+9", "+99"), "line 3: time 2026-03-05T01:39:00Z is not within the case, 2026-03-05T00:00:00Z to 2026-03-05T01:00:00Z: change start or duration"),
        (CASE + STANDS, PLAIN.replace("bearing", "baering"), "unknown column baering (did you mean bearing?); allowed"),
        (CASE + STANDS, PLAIN.replace("bearing", "course"), "unknown column course; allowed are time, sensor, bearing, range, lat, lon"),
        (CASE + STANDS, PLAIN.replace("bearing", "bearing_mag"), "; bearings are true: add the variation to magnetic ones"),
        (CASE + STANDS, PLAIN.replace("43,", "43M,"), 'line 3: bearing: "43M" is magnetic; directions are true: add the variation'),
        (CASE + STANDS, PLAIN + '+9 min,"radar,43,9.6\n' + "+9 min,radar,43,9.6\n" * 9000, "is a quotation mark open above?"),
        (CASE.replace("[[sensor]]", 'every = "0.1 s"\n[[sensor]]', 1) + STANDS, PLAIN, "every: gives more than 5,000 figures; the case lasts 60 min"),
        (CASE.replace("[[sensor]]", f"show = {['+1 min'] * 51}\n[[sensor]]", 1) + STANDS, PLAIN, "show: 51 times; at most 50"),
        (CASE + STANDS.replace("14N", "90S") + 'legs = [{ course = 220, speed = "8 kn" }]\n', PLAIN, "tracker: legs: at a pole a course has no meaning"),
        (CASE + STANDS, PLAIN.replace("time,sensor", "when,sensor"), "no column time"),
        (CASE + STANDS, "time,sensor,bearing,range\n", "no detection; a track begins with one"),
        (CASE + STANDS, "", "no column time, sensor"),
        (CASE + STANDS, PLAIN.replace("range", "bearing"), "there are two columns bearing"),
        (CASE + STANDS, PLAIN.replace("9.6", "9,6"), "4: time, sensor, bearing, range; write decimals with points, or separate columns by semicolons"),
        (CASE + STANDS, "PK\x03\x04 and more", "d.csv: is a spreadsheet; save it as CSV"),
        (CASE + STANDS, PLAIN.replace("9.6", "far"), "line 3: range: "),
        (CASE, ROWS.replace("14 00.0N, 077 00.0W", ","), "the tracker has no position at the first"),
        (CASE, ROWS.replace("14 03.1N", "17 03.1N"), "from 2026-03-05T00:01:00Z to 2026-03-05T00:10:00Z the tracker would make 1,222 kn; at most 292"),
        (CASE, ROWS.replace("-76.93", ""), "line 4: lat and lon go together"),
        (CASE + STANDS, ROWS, "the detections give its positions (lat, lon); leave at"),
        (CASE.replace('detections = "d.csv"', 'detections = "e.csv"') + STANDS, PLAIN, "detections: "),
        (CASE + STANDS + '[target]\nat = "14N 077W"\n', PLAIN, "[target] and detections are both given; give one"),
        (CASE.replace('detections = "d.csv"', "") + STANDS, PLAIN, '[target] is missing: give it, or detections = "file.csv", or [[detection]]'),
        (CASE.replace("[[sensor]]", 'show = ["2 h"]\n[[sensor]]', 1) + STANDS, PLAIN, "show: 050200ZMAR26 is not within the case, 050000ZMAR26 to 050100ZMAR26"),
        (CASE + '[tracker]\nlegs = [{ course = 1, speed = "1 kn" }]\n', PLAIN, "tracker: at: is missing; legs begin there"),
    ],
)  # fmt: skip
def test_every_mistake_is_a_line(tmp_path: File, case: str, rows: str, words: str) -> None:
    with pytest.raises(UserError) as refusal:
        load(tmp_path, case, rows)
    assert any(words in line for line in refusal.value.lines), refusal.value.lines
    assert all("\n" not in line for line in refusal.value.lines)


def test_remarks_are_read_over_and_directions_may_say_that_they_are_true(tmp_path: File) -> None:
    plain = load(tmp_path, CASE + STANDS, PLAIN).target
    noted = "".join(
        f"{line},{'remarks' if k == 0 else 'faint; 9.6?'}\n"
        for k, line in enumerate(PLAIN.strip().splitlines())
    )
    other = load(tmp_path, CASE + STANDS, noted.replace("43,", "043T,")).target
    for name in ("time", "sensor", "bearing", "range"):
        np.testing.assert_array_equal(getattr(other, name), getattr(plain, name))


def test_a_pursuit_begins_where_the_log_last_has_the_vessel(tmp_path: File) -> None:
    """Else what its sensors did not see after the last detection would not count, and the track
    would be another one with a pursuit.
    """
    pursuit = '[pursuit]\nspeed = "25 kn"\nreach = "5 nmi"\nstep = "2 min"\n'
    rows = ROWS + "+45 min,,,,14.2N,-76.9\n"
    asked = load(tmp_path, CASE + pursuit, rows)
    assert asked.pursuit is not None
    assert asked.pursuit.begin == 45 * 60
    by_legs = load(tmp_path, CASE + STANDS + pursuit, PLAIN)
    assert by_legs.pursuit is not None
    assert by_legs.pursuit.begin == 9 * 60
