"""The area of a boat whose legs are cut at the coast, by pyproj's plane and a POD by brute force."""

import itertools
import math
from dataclasses import replace

import numpy as np
import plans
import pyproj
import pytest
import shapely
from plans import BEGIN, NMI, PLACE
from scipy import special

from drift.evidence.filter import patterns
from drift.evidence.filter.records import Law
from drift.planning.search import candidates, optimiser, planning_tracks, rectangle
from drift.planning.search.boats import availability, courses, swept
from drift.planning.search.boats.courses import Sailed
from drift.planning.search.products import subareas
from drift.planning.search.products import text as plan_text
from drift.planning.search.records import Plan, Tasking
from geo import sphere
from geo.array import Array
from kernels.planning import rectangles

LENGTH, SPACING, LEGS, TURN = 20_000.0, 2_000.0, 3, 0.4
FLAT = pyproj.Proj(proj="aeqd", lon_0=PLACE[0], lat_0=PLACE[1], R=sphere.RADIUS)
GEOD = pyproj.Geod(a=sphere.RADIUS, b=sphere.RADIUS)


def laid(corner: tuple[int, int] = (-1, -1)) -> rectangle.Laid:
    """Return a rectangle of three legs."""
    pattern = patterns.parallel(PLACE, LENGTH, LEGS * SPACING, TURN, SPACING, 0.0, 5.0, corner)
    return rectangle.Laid(PLACE, TURN, corner, pattern)


def sailed(whole: rectangle.Laid, nodes: slice, short: float) -> Sailed:
    """Return some of its legs, the last of which ends after a length [m]."""
    lon, lat = (np.array(v)[nodes] for v in (whole.pattern.legs.lon, whole.pattern.legs.lat))
    away, _, _ = GEOD.inv(lon[-2], lat[-2], lon[-1], lat[-1])
    end = GEOD.fwd(lon[-2], lat[-2], away, short)
    lon[-1], lat[-1] = lon[-2] + (end[0] - lon[-2] + 180) % 360 - 180, end[1]
    return Sailed(lon, lat, np.ones(len(lon) - 1, bool), np.arange(len(lon)) * 1.0, (), 0.0, 0.0)


def all_sea(lon: Array, lat: Array) -> Array:
    return np.ones(len(lon))


def test_legs_that_are_not_sailed_are_in_no_area() -> None:
    """One whole leg, 4 km of the next, none of the third; begun at either side."""
    for corner in ((-1, -1), (1, 1)):
        made = swept.area(
            laid(corner), sailed(laid(corner), slice(0, 4), 4_000.0), LENGTH, SPACING, all_sea
        )
        assert (made.legs, made.first) == (2, 0)
        assert (made.length, made.width) == pytest.approx((LENGTH, 2 * SPACING), abs=0.01)
        assert made.share == pytest.approx(
            (18_000 + 2_000 + 4_000) / (2 * LENGTH - SPACING), rel=1e-6
        )
        # half a spacing from the middle, on the side of the first leg
        east, north = FLAT(*made.centre)
        assert east * math.cos(TURN) - north * math.sin(TURN) == pytest.approx(
            corner[1] * SPACING / 2, abs=0.01
        )
        assert east * math.sin(TURN) + north * math.cos(TURN) == pytest.approx(0, abs=0.01)
    last = swept.area(laid(), sailed(laid(), slice(4, 6), 4_000.0), LENGTH, SPACING, all_sea)
    assert (last.legs, last.first, last.share) == (1, 2, pytest.approx(1, abs=1e-6))
    assert (last.length, last.width) == pytest.approx((4_000 + SPACING, SPACING), abs=0.01)


def told(made: swept.Swept, law: Law, width: float) -> Tasking:
    """Return a tasking of that area."""
    one = plans.unit(5.0, 8.0, width, law)
    when = np.datetime64("2024-03-20T06:00:00")
    sortie = candidates.Sortie(
        name="A", kind="", start=when, end=when, law=law, sweep_width=(width,), shape=math.inf, spacing=SPACING,
        area=patterns.rectangle(made.centre, made.length, made.width, made.orientation),
    )  # fmt: skip
    return Tasking(
        one, 1, sortie, when, when, when, when, made.centre, made.length, made.width, made.orientation, 0.0, SPACING,
        made.legs, 0.0, swept=made.share,
    )  # fmt: skip


def by_brute_force(made: swept.Swept, some: Sailed, width: float) -> float:
    """Return the POD of still objects, even over the area: the hazard W^2 / (4 pi) ds / (2 r^3) in
    steps of 20 m.
    """
    rng = np.random.default_rng(11)
    along, across = (rng.random((2, 20_000)) - 0.5) * np.array([[made.length], [made.width]])
    x, y = np.array(FLAT(*patterns.points_along(made.centre, made.orientation, along, across)))
    ends = np.array(FLAT(some.lon, some.lat)).T
    hazard = np.zeros(len(x))
    for a, b in itertools.pairwise(ends):
        count = math.ceil(np.hypot(*(b - a)) / 20)
        for place in a + (b - a) * ((np.arange(count) + 0.5) / count)[:, None]:
            hazard += (
                np.hypot(*(b - a))
                / count
                / (2 * np.maximum(np.hypot(x - place[0], y - place[1]), 20.0) ** 3)
            )
    return float(-np.expm1(-hazard * width**2 / (4 * math.pi)).mean())


@pytest.mark.thorough
def test_the_pod_of_cut_legs_is_off_by_no_more_than_that_of_whole_ones() -> None:
    """erf(sqrt(pi)/2 W/S) is of endless legs: of two whole ones it is too high by what is seen
    beyond the area's edges.

    W / S told 0.79 of the cut ones too, of which 0.46 is found. Two standard errors of 20,000
    objects are 0.007.
    """
    width = SPACING
    whole, some = (sailed(laid(), slice(0, 4), short) for short in (LENGTH - SPACING, 4_000.0))
    textbook = special.erf(math.sqrt(math.pi) / 2)
    errors = []
    for sailing in (whole, some):
        made = swept.area(laid(), sailing, LENGTH, SPACING, all_sea)
        (pod,) = subareas.pods(told(made, Law(), width))
        assert pod == pytest.approx(made.share * textbook)
        errors.append(pod - by_brute_force(made, sailing, width))
    assert -0.007 < errors[1] < errors[0] + 0.007
    (coverage,) = subareas.coverages(told(made, Law(), width))
    track = float(GEOD.line_length(some.lon, some.lat))
    # W times the track over the area, but that a whole pattern has half a spacing at its ends
    assert coverage == pytest.approx(
        width * track / (made.length * made.width - SPACING**2), rel=1e-6
    )


SHORE = PLACE[0] + 0.03


def boat_off_a_coast() -> rectangle.Crew:
    """Return a boat west of land that begins at a meridian."""
    land = np.array([shapely.box(SHORE, -43.0, SHORE + 2.0, -39.0)])
    base = (PLACE[0] - 0.2, PLACE[1])
    boat = plans.unit(
        5.0,
        4.0,
        NMI,
        Law(),
        kind="Boat",
        base=base,
        return_to=base,
        transit_speed=8.0,
        name="boat",
        ready=BEGIN,
    )
    course, _ = courses.prepare(
        boat, lambda box: land, np.array([PLACE, (PLACE[0] - 0.5, PLACE[1] + 0.3)])
    )
    assert course is not None
    place = planning_tracks.Plane(*np.radians(PLACE))
    available = replace(
        availability.of_unit(boat, plans.spec(), (place.lon, place.lat)), way=course.arrival
    )
    return rectangle.crew(boat, available, place, float(BEGIN.astype(int)), np.ones(1), course)


def stage_of(x: Array, y: Array) -> candidates.Stage:
    """Return particles that stand still at x, y [m]."""
    m = len(x)
    swarm = rectangles.swarm(
        np.array([0.0, 4 * 3600]),
        x + np.zeros((2, 1)),
        y + np.zeros((2, 1)),
        np.ones((2, m)),
        np.zeros(m),
    )
    return candidates.Stage(m, swarm, np.full(m, 1 / m), np.ones(1), True, 0.0)


@pytest.mark.thorough
def test_a_boat_whose_legs_end_ashore_with_time_left_is_tasked_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A yacht search of one leg, up to where it met the coast, POS 2 %, with 4.5 h left."""
    monkeypatch.setattr(optimiser, "DRAWN", 192)
    monkeypatch.setattr(optimiser, "CHILDREN", 32)
    crew = boat_off_a_coast()
    x, y = np.random.default_rng(12).normal(0, 5_000, (2, 800)) + np.array([[-12_000], [3_000]])
    stage = stage_of(x, y)
    # two legs, less than half of them at sea
    inland = candidates.choose(
        crew, np.array([5_000.0, -12_000, 1.5, math.log(NMI), 2.0, 0, -1, -1]), stage
    )
    assert inland.flown.possible[0]
    assert optimiser._filled(inland) < 0.5
    (made,) = optimiser._as_flown([inland], [crew], stage, np.random.default_rng(13))
    assert made is not None
    assert optimiser._filled(made) > 0.9
    assert candidates.value([made], stage) > 0.4 > 10 * candidates.value([inland], stage)


def test_a_box_that_is_half_land_is_handed_out_as_what_is_sailed() -> None:
    """Land from a meridian on to the east: legs end there, and the area with them."""
    shore, crew = SHORE, boat_off_a_coast()
    stage = stage_of(np.zeros(8), np.zeros(8))
    row = np.array([0.0, 0.0, math.radians(80), math.log(NMI), math.log(4.0), 0.0, -1.0, -1.0])
    choice = candidates.choose(crew, row, stage)
    assert choice.flown.possible[0]
    (task,) = candidates.taskings([choice], stage)
    assert task.cut
    assert task.length < 0.8 * float(choice.flown.length[0])
    corners = np.array(subareas.corners(task))
    # nothing of it lies more than what a slanting end of a strip takes, and half a spacing, beyond
    # the shore
    beyond = max(GEOD.inv(shore, y, x, y)[2] for x, y in corners if (x - shore) % 360 < 180)
    assert beyond < task.width * math.tan(math.radians(10)) + NMI
    plane = np.array(FLAT(corners[:, 0], corners[:, 1])).T
    assert (task.length, task.width) == pytest.approx(
        sorted((float(np.hypot(*(plane[k + 1] - plane[k]))) for k in (0, 1)), reverse=True),
        rel=1e-3,
    )
    legs = task.sortie.legs
    assert legs is not None
    box = shapely.Polygon(plane)
    sailing = shapely.LineString(np.array(FLAT(legs.lon, legs.lat)).T)
    assert box.buffer(5.0).contains(sailing)
    meridian = np.array(FLAT(np.full(200, shore), np.linspace(-42, -40, 200))).T
    sea = shapely.Polygon([*meridian, (-1e6, 1e5), (-1e6, -1e5)])
    at_sea = box.intersection(sea).area
    track = sum(
        GEOD.inv(*a, *b)[2]
        for a, b, seeks in zip(
            *(list(zip(legs.lon, legs.lat, strict=True))[k:] for k in (0, 1)),
            legs.searching,
            strict=False,
        )
        if seeks
    )
    # on a grid of 41 x 41 positions: an edge across it is off by half a cell along one side at most
    want = track * task.spacing / (at_sea - task.spacing**2)
    assert task.swept == pytest.approx(min(want, 1), abs=1 / 41 + 0.01)
    words = " ".join(plan_text.plan_text(_plan(task), "t", "run").split())
    assert f"{task.length / NMI:.1f} x {task.width / NMI:.1f}" in words
    assert "of the sea in the area" in words


def _plan(task: Tasking) -> Plan:
    return Plan(plans.spec(), (task,), 0.1, 0.1, np.array([0.1]), 0.1, None, 0.0, (), ("one",))
