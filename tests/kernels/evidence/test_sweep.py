"""The point functions of a search against quadrature by SciPy, shapely and NumPy, in float64."""

import numpy as np
import pytest
import shapely
import taichi as ti
from scipy import integrate

from geo import sphere
from kernels.evidence import sweep
from kernels.planning import allocate
from kernels.step.coast import Ints, Reals

RNG = np.random.default_rng(17)
EPS = 2.0**-24
f32x2 = ti.types.vector(2, ti.f32)


@ti.kernel
def _pieces(a: Reals, b: Reals, radius: ti.f32, ring: Reals, out: Reals):
    for i in range(a.shape[0] // 2):
        p, q = f32x2(a[2 * i], a[2 * i + 1]), f32x2(b[2 * i], b[2 * i + 1])
        out[3 * i] = sweep.hazard(
            p, q, ti.sqrt(p[0] * p[0] + p[1] * p[1]), ti.sqrt(q[0] * q[0] + q[1] * q[1])
        )
        out[3 * i + 1] = sweep.within(p, q, radius)
        out[3 * i + 2] = sweep.inside(p, q, ring)


def test_what_a_piece_of_a_relative_track_adds_up_to() -> None:
    """The integral of ds / 2 r^3 by quadrature; the shares within a circle and a concave ring by
    shapely.
    """
    n, radius = 800, 700.0
    a, b = RNG.normal(0, 900, (2, n, 2)).astype(np.float32)
    ring = np.array([[-500, -400], [900, -600], [1100, 300], [200, 50], [-100, 800]], np.float32)
    out = np.zeros(3 * n, np.float32)
    _pieces(a.reshape(-1), b.reshape(-1), radius, ring.reshape(-1), out)
    for p, q, (hazard, within, inside) in zip(
        a.astype(float), b.astype(float), out.reshape(-1, 3), strict=True
    ):
        way = shapely.LineString([p, q])
        closest = way.distance(shapely.Point(0, 0))
        if closest > 5:
            nearest = way.project(shapely.Point(0, 0)) / way.length
            exact, _ = integrate.quad(
                lambda s, p=p, q=q: 0.5 / np.hypot(*(p + s * (q - p))) ** 3,
                0,
                1,
                points=[nearest],
                epsabs=0,
                epsrel=1e-9,
                limit=200,
            )
            # Coordinates of some 3000 m leave the closest approach right to eps of them, and its
            # square in the result.
            assert hazard == pytest.approx(exact * way.length, rel=64 * EPS * 3000 / closest)
        along = way.intersection(shapely.Polygon(ring)).length / way.length
        assert inside == pytest.approx(along, abs=64 * EPS * 3000 / way.length * 20)
        root = np.roots([(q - p) @ (q - p), 2 * p @ (q - p), p @ p - radius**2])
        low, high = np.sort(root.real) if np.isreal(root).all() else (0.0, 0.0)
        share = max(min(high, 1) - max(low, 0), 0)
        if not np.isreal(root).all() or high - low > 0.05:
            assert within == pytest.approx(share, abs=1e-4)


@ti.kernel
def _lateral(a: Reals, b: Reals, along_a: Reals, along_b: Reals, out: Reals):
    for i in range(along_a.shape[0]):
        out[i] = sweep.lateral(
            f32x2(a[2 * i], a[2 * i + 1]), f32x2(b[2 * i], b[2 * i + 1]), along_a[i], along_b[i]
        )


def test_a_lateral_range_is_that_of_the_straight_relative_track_where_it_comes_abeam() -> None:
    """Distance of the origin from the line through both ends; -1 where the particle stays ahead or
    astern.
    """
    n = 2000
    a, b = RNG.normal(0, 900, (2, n, 2)).astype(np.float32)
    ahead = RNG.normal(0, 1, (2, n)).astype(np.float32)
    ahead[0, ::9] = 0  # on a joint it counts on one side only
    out = np.zeros(n, np.float32)
    _lateral(a.reshape(-1), b.reshape(-1), *ahead, out)
    p, d = a.astype(float), (b - a).astype(float)
    exact = np.abs(p[:, 0] * d[:, 1] - p[:, 1] * d[:, 0]) / np.hypot(*d.T)
    abeam = (ahead[0] < 0) != (ahead[1] < 0)
    assert (out[~abeam] == -1).all()
    bound = 16 * EPS * np.hypot(*p.T) * (1 + 3000 / np.hypot(*d.T))
    assert (np.abs(out - exact) <= bound)[abeam].all()
    assert 0.3 < abeam.mean() < 0.7


@ti.kernel
def _tables(curve: Reals, value: Reals, at: Reals, steps: Reals, out: Reals):
    for i in range(at.shape[0]):
        out[2 * i] = sweep.chance(curve, at[i])
        out[2 * i + 1] = allocate.look(value, steps[i])


def test_tabulated_curves_are_straight_in_between() -> None:
    """NumPy's interp; of a lateral range curve nothing beyond the last range, of a curve of
    coverage the last value.
    """
    x, y = (
        np.array([0, 120, 400, 900, 1500], np.float32),
        np.array([0.98, 0.9, 0.35, 0.2, 0.05], np.float32),
    )
    value = np.array([0, 0.4, 0.7, 0.85, 0.9], np.float32)
    at, steps = (
        RNG.uniform(0, 1900, 3000).astype(np.float32),
        RNG.uniform(0, 7, 3000).astype(np.float32),
    )
    out = np.zeros(6000, np.float32)
    _tables(np.stack([x, y], axis=1).reshape(-1), value, at, steps, out)
    np.testing.assert_allclose(out[::2], np.interp(at, x, y, right=0), atol=16 * EPS * 4)
    np.testing.assert_allclose(out[1::2], np.interp(steps, np.arange(5), value), atol=16 * EPS)


@ti.kernel
def _relative(
    x: Ints, y: Ints, at_lon: ti.i32, at_lat: ti.i32, c: ti.f32, bend: ti.f32, out: Reals
):
    for i in range(x.shape[0]):
        r = sweep.relative(x[i], y[i], at_lon, at_lat, c, bend)
        out[2 * i], out[2 * i + 1] = r[0], r[1]


@pytest.mark.parametrize("degrees", [-58.3, 21.0, 70.2])
def test_the_plane_of_a_particle_holds_great_circles(degrees: float) -> None:
    """From a sensor across the antimeridian: the way in the particle's tangent plane, by unit
    vectors; a term of third order is left.
    """
    n = 2000
    lon0, lat0 = int(sphere.to_binary(179.99)), int(sphere.to_binary(degrees))
    length, bearing = RNG.uniform(50, 20_000, n), RNG.uniform(0, 2 * np.pi, n)
    phi, here = (
        np.radians(degrees),
        (np.full(n, lon0 * sphere.UNIT), np.full(n, lat0 * sphere.UNIT)),
    )
    lon, lat = sphere.destination(*here, length * np.sin(bearing), length * np.cos(bearing))
    x, y = (
        sphere.to_binary(np.degrees(lon)).astype(np.int32),
        sphere.to_binary(np.degrees(lat)).astype(np.int32),
    )
    out = np.zeros(2 * n, np.float32)
    _relative(x, y, lon0, lat0, np.cos(phi), 0.5 * np.sin(phi) * np.cos(phi) * sphere.UNIT, out)
    turn = lon - here[0]
    east = sphere.RADIUS * np.cos(phi) * np.sin(turn)
    north = sphere.RADIUS * (np.sin(lat) * np.cos(phi) * np.cos(turn) - np.cos(lat) * np.sin(phi))
    order = length**3 / sphere.RADIUS**2 * (1 + np.abs(np.tan(phi))) ** 2
    assert (np.hypot(out[::2] - east, out[1::2] - north) <= order + 0.02).all()
    assert (np.abs(np.hypot(out[::2], out[1::2]) - length) <= order + 0.02).all()
