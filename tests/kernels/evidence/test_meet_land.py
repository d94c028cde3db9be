"""Where straight and bent steps meet the land or slide along it: against shapely and plane
geometry.
"""

import numpy as np
import pytest
import shapely
import taichi as ti
from plane_shores import ANGLE, COS, EPS, LAT, METRE, binary, built, straight, wavy

from geo import sphere
from geo.coast import edges as shoreline
from kernels.step import coast as device_coast
from kernels.step import curve, shore
from kernels.step.coast import Coast, Ints, Reals

RNG = np.random.default_rng(31)


@ti.kernel
def _meet(
    slides: ti.template(), lon: Ints, lat: Ints, dlon: Ints, dlat: Ints, bend: Reals, c: ti.f32, coast: Coast,
    met: Ints, x: Ints, y: Ints, part: Reals, number: Ints,
):  # fmt: skip
    for i in range(lon.shape[0]):
        own = curve.f32x4([bend[4 * i + k] for k in ti.static(range(4))])
        met[i], x[i], y[i], part[i], number[i] = shore.meet(
            False,
            slides,
            lon[i],
            lat[i],
            dlon[i],
            dlat[i],
            own,
            c,
            0.0,
            ti.u32(0),
            ti.u32(0),
            i,
            0,
            coast,
        )


def test_a_bent_way_meets_the_land_where_its_curve_does() -> None:
    """Shapely on the curve itself, finely cut: only ways within a chord's tolerance of the shore
    may differ.
    """
    n = 800
    coast = built(wavy(RNG))
    land = shapely.polygonize(
        shapely.linestrings(shoreline.shoreline_edges(coast).reshape(-1, 2, 2))
    )
    lon, lat = binary(RNG.uniform(-2500, -600, n), RNG.uniform(-6000, 6000, n))
    dlon, dlat = (np.round(RNG.normal(0, 800, (2, n)) / METRE)).astype(np.int32)
    bend = (RNG.normal(0, 9000, (n, 4)) / METRE).astype(np.float32)  # bulges of some 2 km
    met, x, y, number = (np.zeros(n, np.int32) for _ in range(4))
    part = np.zeros(n, np.float32)
    _meet(
        False,
        lon,
        lat,
        dlon,
        dlat,
        bend.reshape(-1),
        COS,
        device_coast.upload(coast).pack,
        met,
        x,
        y,
        part,
        number,
    )
    s = np.linspace(0, 1, 401)[:, None]
    off = [s * (1 - s) ** 2 * bend[:, k] - s**2 * (1 - s) * bend[:, 2 + k] for k in range(2)]
    places = np.stack([lon + s * dlon + off[0], lat + s * dlat + off[1]], axis=-1).transpose(
        1, 0, 2
    )
    # In metres, so that a tolerance is one: the land and the ways are squeezed alike.
    scale = np.array([METRE * COS, METRE])
    shore_m = shapely.transform(shapely.boundary(land), lambda p: (p - [lon[0], lat[0]]) * scale)
    land_m = shapely.transform(land, lambda p: (p - [lon[0], lat[0]]) * scale)
    ways = shapely.linestrings((places - [lon[0], lat[0]]) * scale)
    hit = shapely.intersects(ways, land_m)
    chord = shapely.linestrings((places[:, [0, -1]] - [lon[0], lat[0]]) * scale)
    assert (hit != shapely.intersects(chord, land_m)).mean() > 0.1  # the chord would be wrong here
    deep = shapely.length(shapely.intersection(ways, land_m)) > 200.0
    clear = shapely.distance(ways, shore_m) > curve.CHORD
    assert met[deep & hit].all()
    assert not met[clear & ~hit].any()
    assert (met == hit).mean() > 0.97
    # Where both meet it, the share of the way is that of the first crossing, to a chord's tolerance
    # along it.
    both = (met == 1) & deep
    inside = shapely.contains_xy(
        land_m, *((places[both] - [lon[0], lat[0]]) * scale).transpose(2, 0, 1)
    )
    first = np.argmax(inside, axis=1) / 400
    assert np.percentile(np.abs(part[both] - first), 90) < 0.02


@pytest.mark.parametrize("slides", [False, True])
def test_a_straight_step_ends_where_it_meets_the_land_or_slides_along_it(slides: bool) -> None:
    """Shapely says which steps meet the land, where, and that all end in the water."""
    coast = built(wavy(RNG))
    land = shapely.transform(
        shapely.polygonize(shapely.linestrings(shoreline.shoreline_edges(coast).reshape(-1, 2, 2))),
        lambda p: p,
    )
    lon, lat = binary(RNG.uniform(-2500, -600, 800), RNG.uniform(-6000, 6000, 800))
    dlon, dlat = (np.round(RNG.normal(0, 1500, (2, 800)) / METRE)).astype(np.int32)
    met, x, y, number = (np.zeros(800, np.int32) for _ in range(4))
    part = np.zeros(800, np.float32)
    _meet(
        slides,
        lon,
        lat,
        dlon,
        dlat,
        np.zeros(4 * 800, np.float32),
        COS,
        device_coast.upload(coast).pack,
        met,
        x,
        y,
        part,
        number,
    )
    ways = shapely.linestrings(
        np.stack([[lon, lon + dlon], [lat, lat + dlat]], axis=-1).transpose(1, 0, 2).astype(float)
    )
    hit = shapely.intersects(ways, land)
    assert 0.1 < hit.mean() < 0.9
    assert not shapely.intersects(land, shapely.points(x.astype(float), y.astype(float))).any()
    assert ((x == lon + dlon) & (y == lat + dlat))[~hit].all()
    if slides:
        assert (met == 0).all()
        assert (
            shapely.distance(land, shapely.points(x[hit].astype(float), y[hit].astype(float))).max()
            * METRE
            < 1500
        )
        assert ((x != lon + dlon) | (y != lat + dlat))[hit].all()
        return
    assert ((met == 1) == hit).all()
    touch = shapely.distance(
        shapely.intersection(ways[hit], land),
        shapely.points(lon[hit].astype(float), lat[hit].astype(float)),
    )
    np.testing.assert_allclose(part[hit], touch / shapely.length(ways[hit]), atol=4 * EPS)
    struck = shapely.linestrings(
        shoreline.shoreline_edges(coast)[number[hit]].reshape(-1, 2, 2).astype(float)
    )
    # units
    assert (
        shapely.distance(struck, shapely.points(x[hit].astype(float), y[hit].astype(float))).max()
        < 3
    )


def test_a_step_slides_along_a_straight_shore_as_far_as_it_would_have_gone_along_it() -> None:
    """Its end is the projection of the step's onto the shore, but for OFF, two roundings and the
    first way's stop before it.
    """
    n = 500
    off, run = -np.array([np.cos(ANGLE), -np.sin(ANGLE)]), np.array([np.sin(ANGLE), np.cos(ANGLE)])
    away, start, inward, way = RNG.uniform([10, -3000, 50, -2000], [600, 3000, 900, 2000], (n, 4)).T
    lon, lat = binary(*(away[:, None] * off + start[:, None] * run).T)
    to_lon, to_lat = binary(*(-inward[:, None] * off + (start + way)[:, None] * run).T)
    met, x, y, number = (np.zeros(n, np.int32) for _ in range(4))
    part = np.zeros(n, np.float32)
    device = device_coast.upload(built(straight()))
    _meet(
        True,
        lon,
        lat,
        to_lon - lon,
        to_lat - lat,
        np.zeros(4 * n, np.float32),
        COS,
        device.pack,
        met,
        x,
        y,
        part,
        number,
    )
    end = np.stack([x * METRE * COS, (y - int(sphere.to_binary(LAT))) * METRE], axis=-1)
    assert np.abs(end @ off - shore.OFF).max() < 0.1
    # What slides goes in up to 64 pieces, each rounded to half a unit.
    assert np.abs(end @ run - start - way).max() < shore.MOST_PIECES * 0.5 * METRE
