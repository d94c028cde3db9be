"""Sorties as a case gives them: the records made of them."""

import math
from pathlib import Path

import numpy as np
import pytest
from search_tables import (
    BOX,
    CONTACT,
    FAST,
    FOOT,
    KNOT,
    NMI,
    POINTS,
    SEEN,
    SORTIE,
    SQUARE,
    SWEEP,
    SWEPT,
    TIMED,
    WATCH,
    WHEN,
    WIDTH,
    gpx,
    hour,
    legs,
    load,
    one,
)

from drift.apps.check import check
from drift.evidence.filter import patterns
from drift.evidence.filter.records import Law
from geo import polyline


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
