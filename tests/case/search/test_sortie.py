"""Sorties, contacts, units and plans as a case gives them: the records made of them, and one line
for what is wrong.
"""

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drift.apps.check import check
from drift.case import file as case_file
from drift.case.record import Case
from drift.evidence.filter import patterns
from drift.evidence.filter.records import Contact, Law, Sortie, Unit
from geo import polyline
from geo.errors import UserError
from geo.polyline import Legs

NMI, KNOT, FOOT = 1852.0, 1852.0 / 3600.0, 0.3048
HEAD = """
title = "trial"
start = "2026-11-21T00:00Z"
duration = "24 h"
output.every = "12 h"
[[current]]
name = "sea"
constant = { speed = "0.5 kn", toward = 90 }
[[wind]]
name = "air"
constant = { speed = "10 kn", from = 270 }
"""
SCENARIOS = """
[[scenario]]
name = "raft"
object = "PIW-1"
search_object = "raft 4 person"
position = { at = "27 30N 088 00W", std = "1 nmi" }
[[scenario]]
name = "swimmer"
object = "PIW-1"
search_object = "Person in Water"
position = { at = "27 30N 088 00W", std = "1 nmi" }
"""
SORTIE = '[[sortie]]\nname = "first"\n'
WHEN = 'start = "+6 h"\nend = "+8 h"\n'
WIDTH = 'sweep_width = "1.2 nmi"\n'
BOX = (
    'area = { centre = "27 30N 088 00W", length = "20 nmi", width = "10 nmi", orientation = 30 }\n'
)
FAST = 'speed = "90 kn"\n'
POINTS = 'waypoints = ["27 30N 088 00W", "27 45N 088 00W"]\n'  # 15.01 nmi: 10 minutes at 90 kn
TIMED = 'waypoints = [["+6 h", "27 30N 088 00W"], ["+7 h", "27 45N 088 00W"]]\n'
SWEEP = 'pattern = { kind = "parallel", centre = "27 30N 088 00W", length = "20 nmi", width = "6 nmi", spacing = "1 nmi" }\n'
SWEPT = 119 * NMI  # six legs of 19 nmi and five of 1
SQUARE = 'pattern = { kind = "square", datum = "27 30N 088 00W", spacing = "1 nmi", legs = 6 }\n'
WATCH = 'watch = { at = "27 30N 088 00W", zones = [["28 nmi", "32 nmi", 0.6], ["0 nmi", "5 nmi", 0.8]] }\n'
CONTACT = '[[contact]]\nname = "flare"\ntime = "+9 h"\n'
SEEN = 'position = { at = "27 30N 088 00W", error = "1 nmi" }\n'
UNIT = (
    '[[unit]]\nname = "H60"\nbase = "28 30N 088 00W"\nsearch_speed = "90 kn"\nendurance = "3 h"\n'
)


def written(tmp_path: Path, *more: str, scenarios: str = SCENARIOS, head: str = HEAD) -> Path:
    path = tmp_path / "trial.toml"
    path.write_text(head + scenarios + "".join(more), encoding="utf-8")
    return path


def load(tmp_path: Path, *more: str, **given: str) -> Case:
    return case_file.load(written(tmp_path, *more, **given))


def one(tmp_path: Path, *more: str) -> Sortie:
    (sortie,) = load(tmp_path, SORTIE, *more).sorties
    return sortie


def contact(tmp_path: Path, *more: str) -> Contact:
    (found,) = load(tmp_path, CONTACT, *more).contacts
    return found


def unit(tmp_path: Path, *more: str) -> Unit:
    (found,) = load(tmp_path, UNIT, *more).units
    return found


def refusal(tmp_path: Path, *more: str, **given: str) -> str:
    """Return the one line with which a case file is refused."""
    with pytest.raises(UserError) as caught:
        load(tmp_path, *more, **given)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 400
    assert message.startswith("trial.toml: ")
    return message


def legs(sortie: Sortie) -> Legs:
    assert sortie.legs is not None
    return sortie.legs


def hour(number: float) -> np.datetime64:
    return np.datetime64("2026-11-21T00:00") + np.timedelta64(round(3600 * number), "s")


def gpx(tmp_path: Path, *points: tuple[float, float, float | None], name: str = "t.gpx") -> str:
    """Write a track of (longitude, latitude, hour of the run); return its key's value."""
    rows = "".join(
        f'<trkpt lon="{lon}" lat="{lat}">'
        + ("" if when is None else f"<time>{hour(when)}Z</time>")
        + "</trkpt>"
        for lon, lat, when in points
    )
    (tmp_path / name).write_text(f"<gpx><trk><trkseg>{rows}</trkseg></trk></gpx>")
    return f'"{name}"'


# --- sorties ----------------------------------------------------------------------------------------------------------


def test_an_area_searched_for_some_hours(tmp_path: Path) -> None:
    """C = W v t / A = 1.2 nmi * 90 kn * 2 h / 200 nmi2."""
    sortie = one(tmp_path, WHEN, WIDTH, BOX, FAST, 'altitude = "500 ft"\nunit = "aircraft"\n')
    assert sortie.coverage == pytest.approx([1.2 * 90 * 2 / 200] * 2, rel=1e-5)
    assert (sortie.name, sortie.kind, sortie.group) == ("first", "Aircraft", "Aircraft visual")
    assert (sortie.start, sortie.end) == (hour(6), hour(8))
    assert sortie.law == Law("inverse_cube")
    assert sortie.sweep_width == pytest.approx([1.2 * NMI] * 2)
    assert (sortie.legs, sortie.watch, sortie.frame, sortie.completed) == (
        None,
        None,
        "ground",
        1.0,
    )
    assert (sortie.speed, sortie.altitude) == pytest.approx((90 * KNOT, 500 * FOOT))
    assert math.isinf(sortie.shape)


def test_an_area_at_a_track_spacing(tmp_path: Path) -> None:
    sortie = one(
        tmp_path, WHEN, BOX, 'spacing = "2 nmi"\nsweep_width = { raft = "1 nmi", swimmer = 0 }\n'
    )
    assert sortie.coverage == pytest.approx((0.5, 0.0))
    assert sortie.sweep_width == (NMI, 0)
    assert math.isnan(sortie.speed)


def test_an_area_with_a_pod(tmp_path: Path) -> None:
    """Random search: C = -ln(1 - POD)."""
    sortie = one(
        tmp_path,
        WHEN,
        BOX,
        'law = "random"\npod = { swimmer = 0.3, raft = "60 %" }\ncompleted = "70 %"\n',
    )
    assert sortie.coverage == pytest.approx((-math.log(0.4), -math.log(0.7)))
    assert sortie.completed == pytest.approx(0.7)
    assert np.isnan(sortie.sweep_width).all()  # not told, not needed
    sortie = one(tmp_path, WHEN, BOX, WIDTH, "pod = 0.8427008\n")
    # erf(1) under inverse cube
    assert sortie.coverage == pytest.approx([2 / math.sqrt(math.pi)] * 2, rel=1e-6)


def test_a_polygon(tmp_path: Path) -> None:
    sortie = one(
        tmp_path,
        WHEN,
        WIDTH,
        'area = { polygon = [[179, 1], [-179, 1], [180, 2]] }\nspacing = "1 nmi"\n',
    )
    assert sortie.area is not None
    assert sortie.area.lon == pytest.approx((179, 181, 180))


@pytest.mark.parametrize(
    ("written_", "law"),
    [
        ('"random"', Law("random")),
        ('"definite_range"', Law("definite_range")),
        ("{ m_beta = 0.8 }", Law("m_beta", beta=0.8)),
        (
            '{ curve = [["0 nmi", 0.9], ["1 nmi", "40 %"], ["2 nmi", 0]] }',
            Law("curve", ranges=(0, NMI, 2 * NMI), chances=(0.9, 0.4, 0)),
        ),
    ],
)
def test_laws(written_: str, law: Law, tmp_path: Path) -> None:
    width = "" if law.kind == "curve" else WIDTH
    sortie = one(tmp_path, WHEN, width, BOX, FAST, f"law = {written_}\n")
    assert sortie.law == law
    if law.kind == "curve":  # twice the integral: 2 (0.65 + 0.2) nmi
        assert sortie.sweep_width == pytest.approx([1.7 * NMI] * 2)


def test_what_is_not_known_of_a_sweep_width(tmp_path: Path) -> None:
    """A gamma factor of mean 1 and shape k has a standard deviation of 1/sqrt(k)."""
    sortie = one(
        tmp_path, WHEN, WIDTH, BOX, FAST, 'sweep_width_uncertainty = "50 %"\nsweep_group = "mine"\n'
    )
    assert (sortie.shape, sortie.group) == (pytest.approx(4.0), "mine")


def test_sweep_widths_from_the_tables(tmp_path: Path) -> None:
    """500 ft, 10 nmi: raft 1.8, swimmer 0.1 nmi; 165 kn: 1.05 and 1.1; 15 kn of wind: 0.5; fatigue
    0.9.
    """
    given = 'sweep_width = { visibility = "10 nmi", wind = "20 kn", fatigue = true }\nunit = "Aircraft"\nspeed = "165 kn"\n'
    sortie = one(tmp_path, WHEN, BOX, given, 'altitude = "500 ft"\n')
    expected = (1.8 * 1.05 * 0.5 * 0.9 * NMI, 0.1 * 1.1 * 0.5 * 0.9 * NMI)
    assert sortie.sweep_width == pytest.approx(expected)
    boat = 'sweep_width = { visibility = "5 nmi", seas = "1 ft" }\nunit = "boat"\n'
    assert one(tmp_path, WHEN, BOX, boat, 'spacing = "1 nmi"\n').sweep_width == pytest.approx(
        (2.2 * NMI, 0.3 * NMI)
    )


def test_a_pattern_ends_when_its_legs_do(tmp_path: Path) -> None:
    sortie = one(tmp_path, 'start = "+6 h"\n', WIDTH, FAST, SWEEP)
    seconds = SWEPT / (90 * KNOT)
    assert float((sortie.end - hour(6)).astype(float)) == pytest.approx(seconds, abs=1)
    assert sortie.end >= hour(6) + np.timedelta64(int(seconds), "s")
    assert legs(sortie).time[0] == hour(6).astype("datetime64[s]").astype(float)
    assert (sortie.coverage, sortie.spacing, sortie.frame) == ((), NMI, "ground")
    assert sortie.area == patterns.rectangle((-88.0, 27.5), 20 * NMI, 6 * NMI, 0.0)


def test_percent_completed_cuts_the_legs(tmp_path: Path) -> None:
    """Planned for 79 minutes, half of it is flown by 7:00."""
    sortie = one(tmp_path, 'start = "+6 h"\nend = "+7 h"\ncompleted = 0.5\n', WIDTH, FAST, SWEEP)
    assert polyline.lengths(legs(sortie)).sum() == pytest.approx(SWEPT / 2, rel=1e-4)
    assert sortie.end == hour(7)
    assert sortie.area == patterns.rectangle((-88.0, 27.5), 20 * NMI, 6 * NMI, 0.0)


def test_cross_legs_are_not_counted(tmp_path: Path) -> None:
    """Crews are told of 6 legs by the plan; `drift check` told them of 11."""
    legs_of = 'start = "+6 h"\n' + WIDTH + FAST
    assert one(tmp_path, legs_of, SWEEP).search_legs == 6
    assert check._sortie(one(tmp_path, legs_of, SWEEP)).startswith("6 legs, ")
    assert one(tmp_path, legs_of, SWEEP.replace("parallel", "creeping")).search_legs == 20
    assert one(tmp_path, legs_of, SWEEP, "completed = 0.5\n").search_legs == 3
    assert one(tmp_path, legs_of, SQUARE).search_legs == 6
    single = one(tmp_path, legs_of, SWEEP.replace("6 nmi", "1 nmi"))
    assert check._sortie(single).startswith("1 leg, ")
    assert one(tmp_path, WHEN, WIDTH, FAST, BOX).search_legs == 0


def test_the_corner_at_which_it_commences(tmp_path: Path) -> None:
    for corner, lon, lat in (('"NE"', 1, 1), ('"SE"', 1, -1), ("[-88.2, 27.7]", -1, 1)):
        sortie = one(tmp_path, WHEN, WIDTH, FAST, SWEEP.replace(" }", f", corner = {corner} }}"))
        assert (legs(sortie).lon[0] > -88.0) == (lon > 0)
        assert (legs(sortie).lat[0] > 27.5) == (lat > 0)
    turned = SWEEP.replace(" }", ', orientation = 45, corner = "N" }')
    assert legs(one(tmp_path, WHEN, WIDTH, FAST, turned)).lat[0] > 27.6


def test_squares_and_sectors_drift_with_their_datum(tmp_path: Path) -> None:
    sortie = one(tmp_path, 'start = "+6 h"\n', WIDTH, FAST, SQUARE)
    assert (sortie.frame, sortie.datum, sortie.marker) == ("datum", (-88.0, 27.5), None)
    assert polyline.lengths(legs(sortie)).sum() / NMI == pytest.approx(12, rel=1e-5)
    sector = 'pattern = { kind = "sector", datum = "27 30N 088 00W", radius = "3 nmi" }\nframe = "ground"\n'
    sortie = one(tmp_path, 'start = "+6 h"\n', WIDTH, FAST, sector)
    assert (sortie.frame, sortie.datum) == ("ground", None)
    assert polyline.lengths(legs(sortie)).sum() / NMI == pytest.approx(27, rel=1e-5)


def test_a_square_without_a_number_of_legs_goes_on_until_the_end(tmp_path: Path) -> None:
    sortie = one(tmp_path, WHEN, WIDTH, FAST, SQUARE.replace(", legs = 6", ""))
    assert legs(sortie).time[-1] - legs(sortie).time[0] == pytest.approx(7200)
    assert polyline.lengths(legs(sortie)).sum() / NMI == pytest.approx(180, rel=1e-4)


def test_a_marker_s_track(tmp_path: Path) -> None:
    positions = 'marker = { positions = [["+5 h", [-88.0, 27.5]], ["+9 h", [-87.9, 27.5]]] }\n'
    sortie = one(tmp_path, WHEN, WIDTH, FAST, SQUARE, positions)
    assert sortie.marker is not None
    assert sortie.marker.lon == (-88.0, -87.9)
    file = gpx(tmp_path, (-88.0, 27.5, 5), (-87.9, 27.5, 9))
    assert (
        one(tmp_path, WHEN, WIDTH, FAST, SQUARE, f"marker = {{ track = {file} }}\n").marker
        == sortie.marker
    )
    drifting = one(tmp_path, WHEN, WIDTH, FAST, BOX, 'frame = "datum"\n', positions)
    assert (drifting.frame, drifting.datum) == ("datum", (-88.0, 27.5))


def test_a_trackline_and_back(tmp_path: Path) -> None:
    given = 'pattern = { kind = "trackline", waypoints = ["27 30N 088 00W", "27 45N 088 00W"], offset = "1 nmi", return = true }\n'
    sortie = one(tmp_path, 'start = "+6 h"\n', WIDTH, FAST, given)
    assert polyline.lengths(legs(sortie)).sum() / NMI == pytest.approx(2 * 15.01 + 2, rel=1e-3)
    assert sortie.area is not None


def test_waypoints_with_times_and_without(tmp_path: Path) -> None:
    timed = one(tmp_path, TIMED, WIDTH)
    assert (timed.start, timed.end) == (hour(6), hour(7))
    assert timed.speed == pytest.approx(15.01 * KNOT, rel=1e-3)
    assert legs(timed).lat == (27.5, 27.75)
    plain = one(tmp_path, WHEN, POINTS, FAST, WIDTH)
    assert legs(plain).time[-1] - legs(plain).time[0] == pytest.approx(15.01 / 90 * 3600, rel=1e-3)
    assert plain.end == hour(8)  # as told
    # within a sweep width of the legs: a strip 2.4 nmi wide, round at its ends
    assert plain.area is not None
    assert patterns.square_metres(plain.area) / NMI**2 == pytest.approx(
        15.01 * 2.4 + math.pi * 1.44, rel=0.01
    )
    rows = 'waypoints = [["088 00W", "27 30N"], [-88, 27.75], { lon = -88, lat = 28 }]\n'
    assert legs(one(tmp_path, WHEN, rows, FAST, WIDTH)).lat == (27.5, 27.75, 28)


def test_a_gpx_track_as_far_as_it_is_of_the_sortie(tmp_path: Path) -> None:
    """A receiver that ran from 5:00 to 9:00, a quarter of a degree an hour."""
    points = [(-88.0, 27 + (k / 60 - 5) / 4, k / 60) for k in range(300, 541)]
    file = gpx(tmp_path, *points)
    sortie = one(tmp_path, WHEN, WIDTH, f"track = {file}\n")
    assert legs(sortie).lat == pytest.approx((27.25, 27.75))
    assert (sortie.start, sortie.end) == (hour(6), hour(8))
    whole = one(tmp_path, WIDTH, f"track = {file}\n")
    assert (whole.start, whole.end) == (hour(5), hour(9))
    plain = gpx(tmp_path, (-88, 27.5, None), (-88, 27.75, None))
    followed = one(tmp_path, WHEN, FAST, WIDTH, f"track = {plain}\n")
    assert legs(followed).time == legs(one(tmp_path, WHEN, FAST, WIDTH, POINTS)).time


@pytest.mark.parametrize("planned", [BOX, SQUARE, POINTS, SWEEP])
def test_the_actual_track_replaces_the_plan(planned: str, tmp_path: Path) -> None:
    positions = (
        'actual = [["+6 h", [-88.0, 27.5]], ["+7 h", [-87.8, 27.5]], ["+8 h", [-87.8, 27.7]]]\n'
    )
    sortie = one(tmp_path, WHEN, WIDTH, FAST, planned, positions)
    assert legs(sortie).lon == (-88.0, -87.8, -87.8)
    assert (sortie.frame, sortie.coverage) == ("ground", ())  # a track made good is over the ground
    assert sortie.area is not None
    file = gpx(tmp_path, (-88.0, 27.5, 6), (-87.8, 27.5, 7), (-87.8, 27.7, 8))
    assert repr(one(tmp_path, WHEN, WIDTH, FAST, planned, f"actual = {file}\n")) == repr(
        sortie
    )  # NaN is no equal of NaN


def test_a_watch(tmp_path: Path) -> None:
    sortie = one(tmp_path, WHEN, WATCH)
    assert sortie.watch is not None
    assert sortie.watch.inner == pytest.approx((0, 28 * NMI))
    assert sortie.watch.outer == pytest.approx((5 * NMI, 32 * NMI))
    assert sortie.watch.pod == (0.8, 0.6)
    assert legs(sortie).lon == (-88.0, -88.0)
    assert legs(sortie).time == tuple(
        t.astype("datetime64[s]").astype(float) for t in (hour(6), hour(8))
    )
    assert np.isnan(sortie.sweep_width).all()  # its zones say how it sees
    moving = one(tmp_path, TIMED, WATCH.replace('at = "27 30N 088 00W", ', ""))
    assert legs(moving).lat == (27.5, 27.75)


def test_outputs_show_each_sortie_and_contact(tmp_path: Path) -> None:
    loaded = load(tmp_path, SORTIE, WHEN, WIDTH, BOX, FAST, CONTACT, SEEN)
    expected = [hour(h) for h in (0, 6, 7, 8, 9, 12, 24)]
    assert loaded.outputs.tolist() == [time.astype("datetime64[s]").item() for time in expected]


def test_sorties_stand_in_order_of_time_and_have_names(tmp_path: Path) -> None:
    late = '[[sortie]]\nstart = "+9 h"\nend = "+10 h"\n'
    loaded = load(tmp_path, late, WIDTH, BOX, FAST, SORTIE, WHEN, WIDTH, BOX, FAST)
    assert [sortie.name for sortie in loaded.sorties] == ["first", "sortie 1"]


def test_a_case_without_a_search_has_none(tmp_path: Path) -> None:
    loaded = load(tmp_path)
    assert (loaded.sorties, loaded.contacts, loaded.units) == ((), (), ())
    assert loaded.outputs.size == 3
    assert loaded.resampling.below == 0


FULL = WHEN + WIDTH + BOX + FAST  # a sortie in order
SORTIES = {
    "before the run": (FULL.replace('"+6 h"', '"-1 h"'), "202300ZNOV26 to 210800ZNOV26 is outside the run"),
    "after the run": (FULL.replace('"+8 h"', '"+25 h"'), "220100ZNOV26 is outside the run, 210000ZNOV26 to 220000ZNOV26"),
    "backward": (FULL.replace('"+8 h"', '"+5 h"'), "end 210500ZNOV26 is not after start 210600ZNOV26"),
    "no time at all": (FULL.replace('"+8 h"', '"+6 h"'), "is not after start"),
    "no start": (WIDTH + BOX + FAST + 'end = "+8 h"\n', "start is missing"),
    "no end": (WIDTH + BOX + FAST + 'start = "+6 h"\n', "end is missing"),
    "no place": (WHEN + WIDTH + FAST, "exactly one of area, pattern, waypoints, track, watch"),
    "area and pattern": (FULL + SWEEP, "found area and pattern"),
    "area and legs": (FULL + POINTS, "found area and waypoints"),
    "area and watch": (FULL + WATCH, "watch and area"),
    "two corners": (WHEN + WIDTH + FAST + "area = { polygon = [[-88, 27], [-87, 27]] }\n", "has 2 corners; at least 3"),
    "a bow tie": (WHEN + WIDTH + FAST + "area = { polygon = [[0, 0], [1, 1], [1, 0], [0, 1]] }\n", "crosses itself"),
    "polygon and centre": (FULL.replace("{ centre", "{ polygon = [[0, 0], [1, 1], [1, 0]], centre"), "polygon and centre"),
    "a rectangle without a width": (FULL.replace(', width = "10 nmi"', ""), "width is missing"),
    "a flat rectangle": (FULL.replace('"10 nmi"', '"0 nmi"'), "greater than 0"),
    "spacing zero": (WHEN + WIDTH + BOX + "spacing = 0\n", "spacing 0 must be 10 m to"),
    "negative spacing": (WHEN + WIDTH + BOX + 'spacing = "-1 nmi"\n', "spacing '-1 nmi' must be 10 m to"),
    "spacing in no unit": (WHEN + WIDTH + BOX + "spacing = 1\n", 'write its unit, like "1 nmi"'),
    "a pattern's spacing zero": (WHEN + WIDTH + FAST + SWEEP.replace('"1 nmi"', "0"), 'sortie "first".pattern.spacing: spacing 0'),
    "a spacing as wide as the area": (WHEN + WIDTH + FAST + SWEEP.replace('"1 nmi"', '"20 nmi"'), "leaves no legs"),
    "POD above 1": (WHEN + BOX + "pod = 1.2\n", "POD 1.2 must be a probability, 0 to 1"),
    "POD of 120 %": (WHEN + BOX + 'pod = "120 %"\n', "POD '120 %' must be a probability"),
    "negative POD": (WHEN + BOX + "pod = -0.1\n", "must be a probability"),
    "POD nan": (WHEN + BOX + "pod = nan\n", "not finite"),
    "a certain POD": (WHEN + BOX + "pod = 1\n", "needs endless effort"),
    "POD for no scenario": (WHEN + BOX + "pod = { raft = 0.5, swimer = 0.5 }\n", 'no scenario "swimer"; did you mean "swimmer"?'),
    "POD for one scenario": (WHEN + BOX + "pod = { raft = 0.5 }\n", 'pod lacks scenario "swimmer"'),
    "POD and spacing": (FULL + 'pod = 0.5\nspacing = "1 nmi"\n', "give pod or spacing, not both"),
    "POD of legs": (WHEN + WIDTH + FAST + SWEEP + "pod = 0.5\n", "pod belongs with area"),
    "spacing beside a pattern": (WHEN + WIDTH + FAST + SWEEP + 'spacing = "1 nmi"\n', "spacing belongs inside pattern"),
    "an area without effort": (WHEN + WIDTH + BOX, "how well was the area searched?"),
    "an area that cannot be flown": (FULL + 'spacing = "0.5 nmi"\n', "200 nmi2 at a spacing of 0.5 nmi take 4.4 h at 90 kn"),
    "no sweep width": (WHEN + BOX + FAST, "sweep_width is missing"),
    "sweep width zero": (FULL.replace('"1.2 nmi"', "0"), "sweep width 0 must be 10 m to"),
    "sweep width in no unit": (FULL.replace('"1.2 nmi"', "1.2"), 'write its unit, like "1.2 nmi"'),
    "sweep width in a unit misread": (FULL.replace('"1.2 nmi"', '"1.2 nm"'), "can be misread"),
    "negative sweep width": (FULL.replace('"1.2 nmi"', '"-1 nmi"'), "must be 10 m to"),
    "sweep width of no scenario": (FULL.replace('"1.2 nmi"', '{ raft = "1 nmi", boat = "1 nmi" }'), 'no scenario "boat"'),
    "sweep width of one scenario": (FULL.replace('"1.2 nmi"', '{ raft = "1 nmi" }'), 'lacks scenario "swimmer"'),
    "an empty table": (FULL.replace('"1.2 nmi"', "{}"), "is empty"),
    "tables without visibility": (FULL.replace('"1.2 nmi"', '{ wind = "5 kn" }'), "visibility: is missing"),
    "tables without weather": (FULL.replace('"1.2 nmi"', '{ visibility = "5 nmi" }'), "wind or seas is missing"),
    "tables misspelled": (FULL.replace('"1.2 nmi"', '{ visibility = "5 nmi", wimd = "5 kn" }') + 'unit = "Aircraft"\naltitude = "500 ft"\n', 'did you mean "wind"?'),
    "an unlikely uncertainty": (FULL + "sweep_width_uncertainty = 30\n", "standard deviation as a share"),
    "a group of nothing": (FULL + 'sweep_group = ""\n', "one line of letters"),
    "unknown law": (FULL + 'law = "inverse cube"\n', 'did you mean "inverse_cube"?'),
    "a law that is a number": (FULL + "law = 0.8\n", "no detection function 0.8"),
    "a beta above 1": (FULL + "law = { m_beta = 1.8 }\n", "m_beta 1.8 must be a probability"),
    "a beta of nothing": (FULL + "law = { m_beta = 0 }\n", "never detects"),
    "a curve of one row": (FULL + 'law = { curve = [["0 nmi", 0.9]] }\n', "two or more rows"),
    "a curve that begins far": (FULL + 'law = { curve = [["1 nmi", 0.9], ["2 nmi", 0.4]] }\n', "must be 0"),
    "a curve that goes back": (FULL + 'law = { curve = [[0, 0.9], ["2 nmi", 0.4], ["1 nmi", 0]] }\n', "does not come after"),
    "a curve above 1": (FULL + 'law = { curve = [[0, 9], ["2 nmi", 0.4]] }\n', "must be a probability"),
    "a curve of nothing": (FULL + 'law = { curve = [[0, 0], ["2 nmi", 0]] }\n', "detects nothing"),
    "a curve and another width": (FULL + 'law = { curve = [[0, 1], ["1 nmi", 1]] }\n', "the curve sweeps 2 nmi"),
    "random legs": (WHEN + WIDTH + FAST + SWEEP + 'law = "random"\n', "applies to an area without legs"),
    "unknown unit": (FULL + 'unit = "Zeppelin"\n', 'no kind of unit "Zeppelin"; allowed: "Aircraft", "Helicopter", "Boat"'),
    "unknown key": (FULL + 'spede = "90 kn"\n', 'did you mean "speed"?'),
    "unknown frame": (FULL + 'frame = "sea"\n', "'ground' or 'datum'"),
    "standing still": (FULL.replace('"90 kn"', '"0 kn"'), "must be above 0"),
    "completed nothing": (FULL + "completed = 0\n", "must be a share above 0"),
    "completed too much": (FULL + "completed = 60\n", 'like 0.6 or "60 %"'),
    "unknown pattern": (WHEN + WIDTH + FAST + SWEEP.replace("parallel", "zigzag"), "'zigzag' is not allowed"),
    "a pattern without a speed": (WHEN + WIDTH + SWEEP, "speed is missing"),
    "a pattern without a length": (WHEN + WIDTH + FAST + SWEEP.replace('length = "20 nmi", ', ""), "length is missing; a parallel"),
    "a square with a width": (WHEN + WIDTH + FAST + SQUARE.replace("legs = 6", 'width = "1 nmi"'), "width does not belong here"),
    "a square without an end": (
        'start = "+6 h"\n' + WIDTH + FAST + SQUARE.replace(", legs = 6", ""),
        "needs legs = their number, or the sortie's end",
    ),
    "no corner": (WHEN + WIDTH + FAST + SWEEP.replace(" }", ', corner = "left" }'), "'left' is not a corner"),
    "half a corner": (WHEN + WIDTH + FAST + SWEEP.replace(" }", ', corner = "N" }'), "two corners are equally far in that direction"),
    "a pattern that takes too long": (
        WHEN.replace("+8", "+7") + WIDTH + FAST + SWEEP,
        "119 nmi of legs take 79 min, but start to end is 60 min",
    ),
    "a share that takes too long": (
        'start = "+6 h"\nend = "+6.5 h"\ncompleted = 0.5\n' + WIDTH + FAST + SWEEP,
        "59.5 nmi of legs take 40 min",
    ),
    "one waypoint": (WHEN + WIDTH + FAST + 'waypoints = ["27 30N 088 00W"]\n', "two or more waypoints"),
    "waypoints in one place": (WHEN + WIDTH + FAST + "waypoints = [[-88, 27], [-88, 27]]\n", "has no length"),
    "waypoints without a speed": (WHEN + WIDTH + POINTS, "speed is missing"),
    "half of the times": (
        WHEN + WIDTH + FAST + 'waypoints = [["+6 h", [-88, 27]], [-88, 27.5]]\n',
        "1 of 2 waypoints have a time",
    ),
    "times that go back": (WIDTH + TIMED.replace("+7 h", "+5 h"), "210500ZNOV26 does not come after 210600ZNOV26"),
    "legs before the start": (WIDTH + TIMED + 'start = "+6.5 h"\n', "begin at 210600ZNOV26, before its start, 210630ZNOV26"),
    "legs after the end": (WIDTH + TIMED + 'end = "+6.5 h"\n', "15 nmi of legs take 60 min"),
    "legs faster than the unit": (WIDTH + TIMED + 'speed = "12 kn"\n', "is made at 15 kn; its speed is 12 kn"),
    "legs faster than any": (WIDTH + TIMED.replace("27 45N", "37 45N"), "is made at 615 kn; at most 292 kn is allowed"),
    "no track": (WHEN + WIDTH + 'track = "none.gpx"\n', 'track: no file "none.gpx"'),
    "a watch without zones": (WHEN + 'watch = { at = "27 30N 088 00W" }\n', "watch: give exactly one of zones and sensor"),
    "a watch in two places": (WHEN + WATCH + TIMED, "exactly one place"),
    "a watch nowhere": (WHEN + WATCH.replace('at = "27 30N 088 00W", ', ""), "exactly one place"),
    "a watch with a law": (WHEN + WATCH + 'law = "random"\n', "law does not belong to a watch"),
    "a watch in part": (WHEN + WATCH + "completed = 0.5\n", "completed does not belong to a watch"),
    "overlapping zones": (WHEN + WATCH.replace('"5 nmi"', '"29 nmi"'), "two zones overlap between 28 and 29 nmi"),
    "a zone from far to near": (WHEN + WATCH.replace('"28 nmi", "32 nmi"', '"32 nmi", "28 nmi"'), "from its inner to its outer"),
    "a zone with a POD of 6": (WHEN + WATCH.replace("0.6", "6"), "POD 6 must be a probability"),
    "a zone of two": (WHEN + WATCH.replace(", 0.6", ""), "is not a zone"),
    "unknown in a watch": (WHEN + WATCH.replace("zones", "zone"), 'did you mean "zones"?'),
    "actual and completed": (FULL + "completed = 0.5\n" + 'actual = [["+6 h", [0, 0]], ["+7 h", [0, 0.1]]]\n', "not both"),
    "actual without times": (FULL + "actual = [[-88, 27], [-88, 27.1]]\n", "with their times"),
    "actual too fast": (FULL + 'actual = [["+6 h", [-88, 27]], ["+7 h", [-88, 29]]]\n', "is made at 120 kn; its speed is 90 kn"),
    "a marker on the ground": (
        FULL + 'marker = { positions = [["+6 h", [0, 0]], ["+8 h", [0, 1]]] }\n',
        'marker belongs to frame = "datum"',
    ),
    "a marker that comes late": (
        WHEN + WIDTH + FAST + SQUARE + 'marker = { positions = [["+7 h", [0, 0]], ["+8 h", [0, 1]]] }\n',
        "known from 210700ZNOV26 to 210800ZNOV26, not for the whole sortie",
    ),
    "a marker without times": (
        WHEN + WIDTH + FAST + SQUARE + "marker = { positions = [[0, 0], [0, 1]] }\n",
        "positions of a marker need their times",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", SORTIES)
def test_what_is_wrong_with_a_sortie(kind: str, tmp_path: Path) -> None:
    given, word = SORTIES[kind]
    line = refusal(tmp_path, SORTIE, given)
    assert "sortie" in line or "TOML" in line
    assert word in line


def test_tables_ask_for_what_they_need(tmp_path: Path) -> None:
    looked = (
        WHEN + BOX + 'spacing = "1 nmi"\nsweep_width = { visibility = "5 nmi", wind = "5 kn" }\n'
    )
    plane = 'unit = "Aircraft"\n'
    high = 'altitude = "500 ft"\n'
    assert "need the kind of unit" in refusal(tmp_path, SORTIE, looked)
    assert "need altitude" in refusal(tmp_path, SORTIE, looked, plane, FAST)
    assert "need its speed" in refusal(tmp_path, SORTIE, looked, plane, high)
    fast = 'speed = "150 kn"\n'
    assert one(tmp_path, looked, plane, high, fast).sweep_width[0] == pytest.approx(1.3 * 1.1 * NMI)
    assert 'not to sensor "radar"' in refusal(
        tmp_path, SORTIE, looked, plane, high, fast, 'sensor = "radar"\n'
    )
    line = refusal(
        tmp_path,
        SORTIE,
        looked,
        plane,
        high,
        fast,
        scenarios=SCENARIOS.replace('search_object = "raft', '#"'),
    )
    assert 'need search_object in scenario "raft"' in line
    line = refusal(tmp_path, SORTIE, looked, plane, 'altitude = "9000 ft"\n', fast)
    assert "300 to 3000 ft" in line


def test_an_unknown_search_object(tmp_path: Path) -> None:
    line = refusal(tmp_path, scenarios=SCENARIOS.replace("raft 4 person", "raft 5 person"))
    assert 'scenario "raft".search_object: no search object "raft 5 person"' in line
    assert 'nearest by size are "Raft 4 person" or "Raft 6 person"' in line


def test_a_name_of_nothing(tmp_path: Path) -> None:
    assert "must be one line of letters" in refusal(tmp_path, SORTIE.replace("first", ""), FULL)


def test_names_that_come_twice(tmp_path: Path) -> None:
    assert 'sortie "first": two sorties have this name' in refusal(tmp_path, (SORTIE + FULL) * 2)
    assert 'sortie "sortie 2": two' in refusal(
        tmp_path, SORTIE.replace("first", "sortie 2"), FULL, "[[sortie]]\n", FULL
    )
    assert 'contact "flare": two contacts' in refusal(tmp_path, (CONTACT + SEEN) * 2)
    assert 'unit "H60": two units' in refusal(tmp_path, (UNIT + WIDTH) * 2)


def test_one_group_has_one_uncertainty(tmp_path: Path) -> None:
    second = "[[sortie]]\n" + FULL + 'sweep_width_uncertainty = "30 %"\n'
    line = refusal(tmp_path, SORTIE, FULL, 'sweep_group = "b"\n', second, 'sweep_group = "b"\n')
    for word in ('sortie "sortie 2"', "is 30 %, but 0", 'sortie "first"', 'sweep_group "b"'):
        assert word in line
    # by default what is known differently is apart
    assert len(load(tmp_path, SORTIE, FULL, second).sorties) == 2
    # a watch has no sweep width
    assert len(load(tmp_path, SORTIE, WHEN, WATCH, second).sorties) == 2


def test_tracks_that_do_not_fit(tmp_path: Path) -> None:
    early = gpx(tmp_path, (-88, 27.5, 1), (-88, 27.6, 2))
    assert "covers 210100ZNOV26 to 210200ZNOV26" in refusal(
        tmp_path, SORTIE, WHEN, WIDTH, f"track = {early}\n"
    )
    plain = gpx(tmp_path, (-88, 27.5, None), (-88, 27.6, None), name="plain.gpx")
    line = refusal(tmp_path, SORTIE, WHEN, WIDTH, f"track = {plain}\n")
    assert 'track: "plain.gpx": its points have no times; give the speed and the start' in line
    fast = gpx(tmp_path, (-88, 27.0, 6), (-88, 29, 7))
    assert "is made at 120 kn; its speed is 90 kn" in refusal(
        tmp_path, SORTIE, WHEN, WIDTH, FAST, f"track = {fast}\n"
    )
    (tmp_path / "t.gpx").write_text("hello")
    assert '"t.gpx" is not a GPX file' in refusal(
        tmp_path, SORTIE, WHEN, WIDTH, 'track = "t.gpx"\n'
    )
    assert 'marker.track: "plain.gpx" has no times' in refusal(
        tmp_path, SORTIE, WHEN, WIDTH, FAST, SQUARE, 'marker = { track = "plain.gpx" }\n'
    )


# --- contacts ---------------------------------------------------------------------------------------------------------


def test_a_position_with_its_error(tmp_path: Path) -> None:
    """Half of a circular normal lies within sqrt(2 ln 2) standard deviations."""
    seen = contact(tmp_path, SEEN, 'belief = "70 %"\n')
    assert (seen.name, seen.kind, seen.time, seen.belief) == (
        "flare",
        "position",
        hour(9),
        pytest.approx(0.7),
    )
    assert (seen.major, seen.minor) == pytest.approx([NMI / math.sqrt(2 * math.log(2))] * 2)
    assert [(fix.lon, fix.lat, fix.share) for fix in seen.fixes] == [(-88.0, 27.5, 1.0)]
    assert seen.drifter is None


def test_rival_fixes_and_debris(tmp_path: Path) -> None:
    given = 'position = { fixes = [["27 30N 088 00W", 0.7], [[-88.5, 27.2], "30 %"]], std = ["1 nmi", "3 nmi"], orientation = 20 }\n'
    seen = contact(tmp_path, given, 'of = "PIW-2"\nfalse_density = "0.001 /nmi2"\n')
    assert [fix.share for fix in seen.fixes] == pytest.approx([0.7, 0.3])
    assert (seen.major, seen.minor) == pytest.approx((3 * NMI, NMI))
    assert math.degrees(seen.orientation) == pytest.approx(110)
    assert seen.false_density == pytest.approx(0.001 / NMI**2)
    assert seen.belief == 1
    assert seen.drifter is not None
    assert seen.drifter.name == "PIW-2"


def test_bearings_ranges_and_areas(tmp_path: Path) -> None:
    at = 'from = "27 30N 088 00W"'
    seen = contact(
        tmp_path,
        f'bearing = {{ {at}, bearing = 230, std = "5 deg", far = "12 nmi", zones = [[0, "3 nmi", 0.5]] }}\n',
        'false_density = "0.01 /deg"\n',
    )
    assert (seen.kind, seen.sensor, seen.near, seen.far) == (
        "bearing",
        (-88.0, 27.5),
        0,
        pytest.approx(12 * NMI),
    )
    assert (seen.bearing, seen.bearing_std) == pytest.approx((math.radians(230), math.radians(5)))
    assert seen.false_density == pytest.approx(0.01 * 180 / math.pi)
    assert seen.zones is not None
    seen = contact(
        tmp_path,
        f'range = {{ {at}, range = "12 nmi", std = "0.5 nmi" }}\nfalse_density = "0.02 /nmi"\n',
    )
    assert (seen.kind, seen.range, seen.range_std) == (
        "range",
        pytest.approx(12 * NMI),
        pytest.approx(0.5 * NMI),
    )
    assert seen.false_density == pytest.approx(0.02 / NMI)
    seen = contact(tmp_path, BOX)
    assert seen.area == patterns.rectangle((-88.0, 27.5), 20 * NMI, 10 * NMI, math.radians(30))


FROM = '{ from = "27 30N 088 00W", '
CONTACTS = {
    "nothing seen": ("", "exactly one of position, bearing, range, area"),
    "two things seen": (SEEN + BOX, "found position and area"),
    "belief above 1": (SEEN + "belief = 70\n", "belief 70 must be a probability, 0 to 1"),
    "negative belief": (SEEN + "belief = -0.1\n", "must be a probability"),
    "no belief": (SEEN + "belief = 0\n", "has no effect; remove it"),
    "belief and density": (
        SEEN + 'belief = 0.5\nfalse_density = "0.01 /nmi2"\n',
        "give belief or false_density",
    ),
    "density without a unit": (
        SEEN + "false_density = 0.01\n",
        'needs a unit here, like "0.001 /nmi2"',
    ),
    "density in another unit": (SEEN + 'false_density = "0.01 /nmi"\n', "0.01 /nmi"),
    "negative density": (SEEN + 'false_density = "-0.01 /nmi2"\n', "at least 0"),
    "no error": (SEEN.replace(', error = "1 nmi"', ""), "exactly one of std, ellipse, error"),
    "an error of 0": (SEEN.replace('"1 nmi"', "0"), "an error above 0"),
    "no place": ('position = { error = "1 nmi" }\n', "exactly one of at, fixes"),
    "shares of less": (
        'position = { error = "1 nmi", fixes = [[[0, 0], 0.5], [[0, 1], 0.3]] }\n',
        "add up to 0.8; they must add up to 1",
    ),
    "a fix without a share": (
        'position = { error = "1 nmi", fixes = [[0, 0]] }\n',
        "0 is not a position",
    ),
    "a bearing without error": (f"bearing = {FROM}bearing = 230, std = 0 }}\n", "must be above 0"),
    "a bearing of 400": (f'bearing = {FROM}bearing = 400, std = "5 deg" }}\n', "0 to 360 degrees"),
    "a bearing back": (
        f'bearing = {FROM}bearing = 20, std = "5 deg", near = "5 nmi", far = "2 nmi" }}\n',
        "far must be farther than near",
    ),
    "a range of nothing": (f'range = {FROM}range = 0, std = "1 nmi" }}\n', "greater than 0"),
    "a range without error": (f'range = {FROM}range = "5 nmi", std = 0 }}\n', "greater than 0"),
    "of nothing known": (SEEN + 'of = "WINDSRUFER"\n', "no leeway class"),
    "two corners": ("area = { polygon = [[-88, 27], [-87, 27]] }\n", "has 2 corners"),
}


@pytest.mark.parametrize("kind", CONTACTS)
def test_what_is_wrong_with_a_contact(kind: str, tmp_path: Path) -> None:
    given, word = CONTACTS[kind]
    line = refusal(tmp_path, CONTACT, given)
    assert 'contact "flare"' in line
    assert word in line


def test_a_contact_outside_the_run(tmp_path: Path) -> None:
    line = refusal(tmp_path, CONTACT.replace("+9 h", "+30 h"), SEEN)
    assert 'contact "flare": 220600ZNOV26 is outside the run, 210000ZNOV26 to 220000ZNOV26' in line


# --- units, plan, survival, resampling --------------------------------------------------------------------------------


def test_a_unit_and_its_defaults(tmp_path: Path) -> None:
    found = unit(tmp_path, WIDTH, 'kind = "helicopter"\n')
    assert (found.name, found.kind, found.group) == ("H60", "Helicopter", "Helicopter visual")
    assert (found.base, found.return_to) == ((-88.0, 28.5), (-88.0, 28.5))
    assert (found.search_speed, found.transit_speed) == pytest.approx((90 * KNOT, 90 * KNOT))
    assert (found.endurance, found.turnaround, found.ready, found.daylight) == (
        10_800,
        7200,
        hour(0),
        True,
    )
    more = 'sensor = "sonar"\ntransit_speed = "140 kn"\nready = "+3 h"\nturnaround = 0\nlaw = "random"\n'
    found = unit(tmp_path, WIDTH, more)
    assert (found.group, found.daylight, found.ready, found.turnaround) == (
        "sonar",
        False,
        hour(3),
        0,
    )
    assert found.transit_speed == pytest.approx(140 * KNOT)


def test_a_plan_begins_after_what_is_known(tmp_path: Path) -> None:
    loaded = load(tmp_path, SORTIE, FULL, CONTACT, SEEN, UNIT, WIDTH)
    assert (loaded.plan.begin, loaded.plan.until) == (hour(9), hour(24))
    assert loaded.units[0].ready == hour(9)
    given = '[plan]\nbegin = "+10 h"\nuntil = "+20 h"\nseparation = "2 nmi"\nrounds = 2\nparticles = 20_000\n'
    loaded = load(tmp_path, SORTIE, FULL, UNIT, WIDTH, given)
    assert (loaded.plan.begin, loaded.plan.until, loaded.plan.rounds) == (hour(10), hour(20), 2)
    assert loaded.plan.separation == pytest.approx(2 * NMI)


def test_survival_and_resampling(tmp_path: Path) -> None:
    """Half are alive at the median, and one standard deviation of a normal later 15.9 % of them."""
    told = SCENARIOS.replace(
        'search_object = "raft', 'survival = { median = "18 h", spread = 2 }\nsearch_object = "raft'
    )
    more = '[plan]\nobjective = "alive"\n[resampling]\nmethod = "kahn"\nbelow = "10 %"\n'
    loaded = load(tmp_path, more, scenarios=told)
    alive = loaded.scenarios[0].survival
    assert alive is not None
    assert alive.alive(np.array([0.0, 18.0, 36.0]) * 3600) == pytest.approx(
        [1, 0.5, 0.158655], abs=1e-6
    )
    assert loaded.scenarios[1].survival is None
    assert [scenario.search_object for scenario in loaded.scenarios] == [
        "Raft 4 person",
        "Person in Water",
    ]
    assert (loaded.resampling.method, loaded.resampling.below) == ("kahn", 0.1)


UNITS = {
    "negative endurance": (
        UNIT.replace('"3 h"', '"-3 h"') + WIDTH,
        "endurance '-3 h' must be above 0",
    ),
    "no endurance": (UNIT.replace('endurance = "3 h"\n', "") + WIDTH, "endurance: is missing"),
    "standing still": (UNIT.replace('"90 kn"', "0") + WIDTH, "must be above 0"),
    "no sweep width": (UNIT, "sweep_width is missing"),
    "no base": (UNIT.replace('base = "28 30N 088 00W"\n', "") + WIDTH, "base: is missing"),
    "ready too late": (
        UNIT + WIDTH + 'ready = "+24 h"\n',
        "not before the plan's end, 220000ZNOV26",
    ),
    "unknown kind": (UNIT + WIDTH + 'kind = "Helo"\n', 'no kind of unit "Helo"'),
    "unknown law": (UNIT + WIDTH + 'law = "cube"\n', "no detection function"),
    "no turnaround": (UNIT + WIDTH + 'turnaround = "-1 h"\n', "0 to 30 days"),
    "a plan that ends first": (
        UNIT + WIDTH + '[plan]\nbegin = "+5 h"\nuntil = "+4 h"\n',
        "not before its end, 210400ZNOV26",
    ),
    "a plan outside the run": (
        UNIT + WIDTH + '[plan]\nuntil = "+40 h"\n',
        "plan.until: 221600ZNOV26 is outside the run",
    ),
    "nobody to find alive": (
        UNIT + WIDTH + '[plan]\nobjective = "alive"\n',
        '"alive" needs survival',
    ),
    "another objective": (UNIT + WIDTH + '[plan]\nobjective = "cost"\n', "'cost' is not allowed"),
    "no rounds": (UNIT + WIDTH + "[plan]\nrounds = 0\n", "plan.rounds"),
    "few particles": (UNIT + WIDTH + "[plan]\nparticles = 10\n", "1,000 to 1,000,000"),
    "always resampling": ("[resampling]\nbelow = 1\n", "must be below 1"),
    "slots that float and change hands": (
        '[resampling]\nmethod = "kahn"\nbelow = 0.5\nacross_scenarios = true\n',
        'across_scenarios = true needs method = "systematic"',
    ),
    "copies that would change hands": (
        '[resampling]\nmethod = "duplicates"\nbelow = 0.5\nacross_scenarios = true\n',
        "the survivors of a scenario keep their slots",
    ),
    "what is placed anew at no speed": (
        '[resampling]\nmethod = "combined"\nbelow = 0.5\n',
        "needs fastest",
    ),
    "what is placed anew and never duplicated": (
        '[resampling]\nmethod = "position"\nfastest = "9 kn"\n',
        "needs 0 < bulk <= below, and bulk is 0.1, below 0",
    ),
    "a bulk of duplicates": (
        '[resampling]\nmethod = "duplicates"\nbulk = 0.1\n',
        "bulk: only for method",
    ),
    "slots that never change hands": (
        "[resampling]\nacross_scenarios = true\n",
        "needs below, such as 0.5",
    ),
    "another resampling": ('[resampling]\nmethod = "residual"\n', "'residual' is not allowed"),
}


@pytest.mark.parametrize("kind", UNITS)
def test_what_is_wrong_with_units_and_plans(kind: str, tmp_path: Path) -> None:
    given, word = UNITS[kind]
    assert word in refusal(tmp_path, given)


@pytest.mark.parametrize(
    "value", ["{ median = 0 }", '{ median = "18 h", spread = 1 }', '{ median = "18 h", spred = 2 }']
)
def test_what_is_wrong_with_survival(value: str, tmp_path: Path) -> None:
    line = refusal(
        tmp_path,
        scenarios=SCENARIOS.replace("search_object", f"survival = {value}\nsearch_object", 1),
    )
    assert 'scenario "raft".survival' in line


@pytest.mark.parametrize(
    ("more", "hours"),
    [
        ((), None),
        ((SORTIE, WHEN, WIDTH, BOX, FAST), 8),
        ((SORTIE, WHEN, WIDTH, BOX, FAST, UNIT, WIDTH), 8),
        ((SORTIE, WHEN, WIDTH, BOX, FAST, UNIT, WIDTH, '[plan]\nbegin = "+11 h"\n'), 11),
        ((UNIT, WIDTH), None),  # it plans from the start on, where nothing is known yet
        ((SORTIE, WHEN, WIDTH, BOX, FAST, UNIT, WIDTH, '[output]\ndatum = "+7 h"\n'), 7),
    ],
)
def test_maps_open_at_the_time_that_matters(
    tmp_path: Path, more: tuple[str, ...], hours: int | None
) -> None:
    """The datum asked for, the begin of the plan, the end of the last sortie, the end: and it is an
    output.
    """
    case = load(tmp_path, *more, head=HEAD.replace('output.every = "12 h"\n', ""))
    assert case.opens == (None if hours is None else hour(hours))
    assert case.opens is None or case.opens in case.outputs


def test_a_datum_outside_the_run_is_refused(tmp_path: Path) -> None:
    head = HEAD.replace('output.every = "12 h"', 'output.datum = "+25 h"')
    assert "output.datum: 220100ZNOV26 is outside the run" in refusal(tmp_path, head=head)


SEARCHES = [SORTIE + FULL, CONTACT + SEEN, UNIT + WIDTH, "[plan]\n", "[resampling]\n"]


@pytest.mark.parametrize("given", SEARCHES)
def test_backward_runs_and_spills_have_no_search(given: str, tmp_path: Path) -> None:
    table = given.splitlines()[0]
    backward = HEAD.replace('duration = "24 h"', 'duration = "24 h"\ndirection = "backward"')
    assert f"{table} belongs to a forward run" in refusal(tmp_path, given, head=backward)
    spill = '[spill]\nobjects = 5\nposition = { at = [-88, 27.5], std = "1 nmi" }\n[[spill.class]]\nname = "drum"\nobject = "PIW-1"\n'
    assert f"{table} belongs to a search with [[scenario]]" in refusal(
        tmp_path, given, scenarios=spill
    )


def test_every_kind_of_table_is_told_by_name(tmp_path: Path) -> None:
    """Whatever of a search is misspelled is refused with its place."""
    for given, place in (
        (SORTIE + FULL, 'sortie "first"'),
        (CONTACT + SEEN, 'contact "flare"'),
        (UNIT + WIDTH, 'unit "H60"'),
    ):
        assert f'{place}: unknown key "colour"' in refusal(tmp_path, given, 'colour = "red"\n')


def test_any_mix_of_kinds_of_search_is_refused(tmp_path: Path) -> None:
    kinds: dict[str, Any] = {
        "area": BOX,
        "pattern": SWEEP,
        "waypoints": POINTS,
        "track": 'track = "t.gpx"\n',
    }
    for first, second in itertools.combinations(kinds, 2):
        assert f"found {first} and {second}" in refusal(
            tmp_path, SORTIE, WHEN, WIDTH, FAST, kinds[first], kinds[second]
        )
