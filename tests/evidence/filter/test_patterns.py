"""Search patterns: lengths, turns and cover against IAMSAR's definitions, measured by pyproj's
geodesics on the sphere.

Patterns are laid out in a tangent plane: 30 km from its middle the sphere shortens cross distances
by (30/6371)^2 / 6, 4e-6, so lengths are held to 1e-5.
"""

import itertools
import math

import numpy as np
import pyproj
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from drift.evidence.filter import patterns
from geo import polyline, sphere
from geo.polyline import Area, Legs

NMI = 1852.0
GLOBE = pyproj.Geod(a=sphere.RADIUS, b=sphere.RADIUS)
PLACES = [(-88.3, 27.6), (179.95, -41.0), (12.0, 79.0)]
START, SPEED = 1.8e9, 46.3


def measured(legs: Legs) -> tuple[np.ndarray, np.ndarray]:
    """Return lengths [m] and turns [deg], to starboard positive, of legs."""
    lon, lat = np.array(legs.lon), np.array(legs.lat)
    out, into, length = GLOBE.inv(lon[:-1], lat[:-1], lon[1:], lat[1:])
    arriving = np.asarray(into) + 180.0
    return np.asarray(length), (np.asarray(out)[1:] - arriving[:-1] + 180.0) % 360.0 - 180.0


def flat(place: tuple[float, float], lon: object, lat: object) -> np.ndarray:
    """Return (x, y) [m] about a place, by pyproj's azimuthal equidistant projection."""
    plane = pyproj.Proj(proj="aeqd", lon_0=place[0], lat_0=place[1], R=sphere.RADIUS)
    return np.column_stack(plane(np.asarray(lon), np.asarray(lat)))


def polygon(place: tuple[float, float], area: Area) -> shapely.Polygon:
    return shapely.Polygon(flat(place, area.lon, area.lat))


def line(place: tuple[float, float], legs: Legs) -> shapely.LineString:
    return shapely.LineString(flat(place, legs.lon, legs.lat))


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("orientation", [0.0, 30.0, 200.0])
def test_a_parallel_sweep(place: tuple[float, float], orientation: float) -> None:
    """20 by 6 nmi at 1 nmi: six legs of 19 nmi half a spacing inside all sides, cross legs of 1
    nmi.
    """
    made = patterns.parallel(place, 20 * NMI, 6 * NMI, math.radians(orientation), NMI, START, SPEED)
    length, turn = measured(made.legs)
    assert length / NMI == pytest.approx([19.0, 1.0] * 5 + [19.0], rel=1e-5)
    assert np.abs(turn) == pytest.approx(90.0, abs=0.1)
    # creeps to the right of its orientation
    assert np.sign(turn).tolist() == [1, 1, -1, -1, 1, 1, -1, -1, 1, 1]
    first = GLOBE.inv(made.legs.lon[0], made.legs.lat[0], made.legs.lon[1], made.legs.lat[1])[0]
    assert (first - orientation + 180) % 360 - 180 == pytest.approx(
        0, abs=1.5 if place[1] > 70 else 0.2
    )
    assert np.diff(made.legs.time) == pytest.approx(length / SPEED, abs=1e-6)  # float64 of 1.8e9 s
    assert made.legs.time[0] == START
    assert all(made.legs.searching)
    assert np.abs(np.diff(made.legs.lon)).max() < 90  # no jump at the antimeridian
    shape, flown = polygon(place, made.area), line(place, made.legs)
    assert shape.area == pytest.approx(120 * NMI**2, rel=1e-5)
    assert shape.contains(flown)
    assert shape.exterior.distance(flown) == pytest.approx(NMI / 2, rel=1e-4)
    # Within half a spacing of the legs lies all of it but (1 - pi/4) (S/2)^2 outside each of ten
    # turns, twice at both ends.
    missed = shape.difference(flown.buffer(NMI / 2, quad_segs=64)).area / NMI**2
    assert missed == pytest.approx(14 * (1 - math.pi / 4) / 4, abs=0.01)


@pytest.mark.parametrize(("width", "number"), [(0.3, 1), (1.4, 1), (1.6, 2), (5.4, 5), (6.0, 6)])
def test_as_many_legs_as_fit(width: float, number: int) -> None:
    made = patterns.parallel(PLACES[0], 20 * NMI, width * NMI, 0.5, NMI, START, SPEED)
    assert len(made.legs.lon) == 2 * number
    spots = flat(PLACES[0], made.legs.lon, made.legs.lat)
    assert np.abs(spots.mean(axis=0)).max() < 1  # centred in it


def test_a_creeping_line_search_has_its_legs_across() -> None:
    """20 by 6 nmi at 1 nmi: twenty legs of 5 nmi that creep along the length."""
    made = patterns.creeping(PLACES[1], 20 * NMI, 6 * NMI, math.radians(30), NMI, START, SPEED)
    length, turn = measured(made.legs)
    assert length / NMI == pytest.approx([5.0, 1.0] * 19 + [5.0], rel=1e-5)
    assert np.abs(turn) == pytest.approx(90.0, abs=0.1)
    assert polygon(PLACES[1], made.area).contains(line(PLACES[1], made.legs))
    begin, finish = flat(PLACES[1], *np.array([made.legs.lon, made.legs.lat])[:, [0, -1]])
    creep = finish - begin
    along = creep @ [math.sin(math.radians(30)), math.cos(math.radians(30))]
    assert along / NMI == pytest.approx(19.0, rel=1e-4)


@pytest.mark.parametrize("flown", [patterns.parallel, patterns.creeping])
@pytest.mark.parametrize("corner", list(itertools.product((-1, 1), (-1, 1))))
def test_they_commence_at_the_corner_asked_for(flown: object, corner: tuple[int, int]) -> None:
    made = flown(PLACES[0], 20 * NMI, 6 * NMI, 0.0, NMI, START, SPEED, corner)  # type: ignore[operator]
    x, y = flat(PLACES[0], made.legs.lon[0], made.legs.lat[0])[0] / NMI
    assert (y, x) == pytest.approx((9.5 * corner[0], 2.5 * corner[1]), rel=1e-4)


@pytest.mark.parametrize("place", PLACES)
def test_an_expanding_square(place: tuple[float, float]) -> None:
    made = patterns.square(place, NMI, math.radians(40), 9, START, SPEED)
    length, turn = measured(made.legs)
    assert length / NMI == pytest.approx([1, 1, 2, 2, 3, 3, 4, 4, 5], rel=1e-5)
    assert turn == pytest.approx(90.0, abs=0.2)  # to starboard, all
    assert (made.legs.lon[0], made.legs.lat[0]) == pytest.approx(place)
    shape, path = polygon(place, made.area), line(place, made.legs)
    # 25 nmi of track at 1 nmi, half a one at both ends
    assert shape.area == pytest.approx((25 + 1) * NMI**2, rel=1e-3)
    assert shape.contains(path)
    assert shape.difference(path.buffer(NMI * 0.75)).area == 0


def test_as_many_legs_of_a_square_as_a_distance_begins() -> None:
    lengths = np.cumsum(np.arange(200) // 2 + 1.0)
    for distance in np.linspace(0.2, 5000, 700):
        assert (
            patterns.square_legs(1.0, distance)
            == np.searchsorted(lengths, distance * (1 - 1e-12)) + 1
        )


@pytest.mark.parametrize("place", PLACES)
def test_a_sector_search(place: tuple[float, float]) -> None:
    """Nine legs of the radius; all turns 120 degrees to starboard, but straight on over the datum."""
    made = patterns.sector(place, 5 * NMI, 3, math.radians(70), START, SPEED)
    length, turn = measured(made.legs)
    assert length / NMI == pytest.approx(5.0, rel=1e-5)
    assert turn == pytest.approx([120, 120, 0, 120, 120, 0, 120, 120], abs=0.3)
    spots = flat(place, made.legs.lon, made.legs.lat)
    assert np.hypot(*spots[::3].T) == pytest.approx(0, abs=1)  # over the datum between the sectors
    shape = polygon(place, made.area)
    # a circle's outline in 36 corners
    assert shape.area == pytest.approx(math.pi * (5 * NMI) ** 2, rel=6e-3)
    courses = np.degrees(np.arctan2(*spots[[1, 2, 4, 5, 7, 8]].T)) % 360
    assert np.sort(courses) == pytest.approx([10, 70, 130, 190, 250, 310], abs=0.1)


def test_a_second_sector_search_lies_between_the_radii_of_the_first() -> None:
    made = patterns.sector(PLACES[0], 5 * NMI, 6, 0.0, START, SPEED)
    spots = flat(PLACES[0], made.legs.lon, made.legs.lat)
    courses = np.degrees(np.arctan2(*spots[[1, 2, 4, 5, 7, 8, 10, 11, 13, 14, 16, 17]].T)) % 360
    assert np.sort(courses + 0.5) % 360 == pytest.approx(np.arange(12) * 30 + 0.5, abs=0.1)


def test_a_trackline_lies_beside_its_route_and_comes_back_on_the_other_side() -> None:
    route = [(5.0, 50.0), (5.6, 50.3), (6.2, 50.0)]
    place = route[1]
    there = patterns.trackline(route, 2 * NMI, False, START, SPEED)
    spots, path = flat(place, *zip(*route, strict=True)), line(place, there.legs)
    assert (
        path.hausdorff_distance(
            shapely.LineString(spots).parallel_offset(2 * NMI, "right", join_style="mitre")
        )
        < 60
    )
    both = patterns.trackline(route, 2 * NMI, True, START, SPEED)
    home = shapely.LineString(flat(place, both.legs.lon[3:], both.legs.lat[3:]))
    left = shapely.LineString(spots).parallel_offset(2 * NMI, "left", join_style="mitre")
    assert home.hausdorff_distance(left) < 60
    assert measured(both.legs)[0][2] / NMI == pytest.approx(4.0, rel=1e-3)  # the way over
    plain = patterns.trackline(route, 0.0, True, START, SPEED)
    assert plain.legs.lon == pytest.approx([5.0, 5.6, 6.2, 5.6, 5.0])
    assert plain.area is None


def test_a_trackline_goes_round_sharp_corners() -> None:
    """Turning back by 150 degrees, a mitre would lie 2 / cos(75 deg) = 7.7 nmi off; nowhere may it
    be farther than 2.
    """
    route = [(5.0, 50.0), (5.6, 50.0), (5.1, 50.2)]
    made = patterns.trackline(route, 2 * NMI, False, START, SPEED)
    path = shapely.LineString(flat(route[1], *zip(*route, strict=True)))
    spots = shapely.points(flat(route[1], made.legs.lon, made.legs.lat))
    assert shapely.distance(spots, path).max() < 2.01 * NMI


@settings(max_examples=40, deadline=None)
@given(share=st.floats(0.01, 0.999), place=st.sampled_from(PLACES))
def test_a_cut_keeps_its_share_of_the_track_s_length(
    share: float, place: tuple[float, float]
) -> None:
    whole = patterns.parallel(place, 15 * NMI, 5 * NMI, 1.0, NMI, START, SPEED).legs
    part = polyline.cut_legs(whole, share)
    assert polyline.lengths(part).sum() == pytest.approx(
        share * polyline.lengths(whole).sum(), rel=1e-6
    )
    assert part.lon[:-1] == whole.lon[: len(part.lon) - 1]
    assert part.time[-1] - START == pytest.approx(share * (whole.time[-1] - START), rel=1e-6)
    assert len(part.searching) == len(part.lon) - 1
    assert polyline.cut_legs(whole, 1.0) is whole


def test_what_lies_between_two_times() -> None:
    legs = polyline.legs_through(
        [0, 10, 20, 30], [179.9, -179.9, -179.7, -179.7], [0, 0, 0, 0.1], [True, False, True]
    )
    assert legs.lon == pytest.approx([179.9, 180.1, 180.3, 180.3])
    part = polyline.legs_between(legs, 5, 25)
    assert part.time == (5, 10, 20, 25)
    assert part.lon == pytest.approx([180.0, 180.1, 180.3, 180.3])
    assert part.lat == pytest.approx([0, 0, 0, 0.05])
    assert part.searching == (True, False, True)
    assert polyline.legs_between(legs, 10, 20).searching == (False,)
    assert polyline.legs_between(legs, -5, 99) is legs
    with pytest.raises(ValueError, match="between these times"):
        polyline.legs_between(legs, 30, 40)


def test_a_thinned_track_is_never_far_from_where_it_was() -> None:
    """A noisy track of 4,000 points, thinned to 25 m: at each of their times within 25 m of it, by
    shapely's interpolation.
    """
    generator = np.random.default_rng(3)
    swept = patterns.parallel(PLACES[1], 10 * NMI, 4 * NMI, 0.3, NMI, START, SPEED).legs
    times = np.linspace(swept.time[0], swept.time[-1], 4000)
    lon, lat = np.array([polyline.position_at(swept, time) for time in times]).T
    noisy = polyline.legs_through(
        times, lon + generator.normal(0, 5e-5, 4000), lat + generator.normal(0, 5e-5, 4000)
    )
    thin = polyline.thin_legs(noisy, 25.0)
    assert 8 <= len(thin.lon) < 60
    away = [
        GLOBE.inv(*polyline.position_at(thin, time), x, y)[2]
        for time, x, y in zip(times, noisy.lon, noisy.lat, strict=True)
    ]  # fmt: skip
    assert max(away) < 25.1
    assert polyline.thin_legs(swept, 1.0) == swept


def test_legs_of_search_are_not_joined_to_others() -> None:
    straight = polyline.legs_through(
        np.arange(6.0), np.arange(6) * 1e-3, np.zeros(6), [True, True, False, False, True]
    )
    thin = polyline.thin_legs(straight, 10.0)
    assert thin.time == (0, 2, 4, 5)
    assert thin.searching == (True, False, True)


def test_the_outline_of_what_was_searched() -> None:
    """A straight leg of 10 nmi and 1 nmi to each side: 20 nmi2 and a circle, in 16 corners, of 1
    nmi.
    """
    legs = polyline.legs_at_speed([179.95, 180.15], [0.0, 0.0], 0.0, 10.0)
    area = polyline.search_strip(legs, NMI)
    length = polyline.lengths(legs).sum() / NMI
    size = patterns.square_metres(area) / NMI**2
    assert size == pytest.approx(2 * length + 3.06, rel=0.01)
    assert max(area.lon) - min(area.lon) < 1


def test_square_metres_of_an_octant() -> None:
    assert patterns.square_metres(Area((0, 90, 0), (0, 0, 90))) == pytest.approx(
        math.pi / 2 * sphere.RADIUS**2
    )


def test_a_track_without_length() -> None:
    with pytest.raises(ValueError, match="no length"):
        polyline.legs_at_speed([5, 5], [50, 50], 0.0, 10.0)
    assert polyline.legs_at_speed([5, 5, 6], [50, 50, 50], 0.0, 10.0, [True, False]).searching == (
        False,
    )
