"""Densities of clouds, against normal distributions, SciPy's, and the sphere's own areas."""

import numpy as np
import pytest
import shapely
from pyproj import Geod
from scipy import stats

from drift.forecast import areas
from drift.tracking.tracker import density, path
from geo import sphere

EARTH = Geod(a=sphere.RADIUS, b=sphere.RADIUS)

TWICE = 2 * np.pi


def cloud(
    lon: float, lat: float, std: tuple[float, float], turn: float, n: int, seed: int
) -> np.ndarray:
    """Return unit vectors normal about a place [deg], with standard deviations [m] along an axis
    and across it.
    """
    along, across = np.random.default_rng(seed).standard_normal((2, n)) * np.array(std)[:, None]
    east, north = (
        along * np.sin(turn) + across * np.cos(turn),
        along * np.cos(turn) - across * np.sin(turn),
    )
    return path.vector(*sphere.destination(np.radians(lon), np.radians(lat), east, north))


def within(region: density.Region, place: np.ndarray) -> np.ndarray:
    """Return which places its outline holds, whichever turn its longitudes are of."""
    lon, lat = path.degrees(place)
    return np.any(
        [shapely.contains_xy(region.outline, lon + turn, lat) for turn in (-360, 0, 360)], axis=0
    )


@pytest.mark.parametrize(
    ("lon", "lat"), [(-76.3, 34.2), (179.99, 34.2), (23.0, 89.97), (-140.0, -89.96)]
)
def test_areas_of_a_normal_cloud(lon: float, lat: float) -> None:
    """2 pi a b ln(1 / (1 - p)), at 180 degrees and with a pole within too.

    The share p that 4000 particles find has the standard error sqrt(p (1 - p) / n), and so the area
    sqrt(p / (1 - p) / n) / ln(1 / (1 - p)), relative; what others are within, 20,000, have their
    own besides: four of each.
    """
    n, a, b = 4000, 9000.0, 4000.0
    fresh = cloud(lon, lat, (a, b), 0.6, 20_000, 4)
    found = density.areas(
        density.surface(cloud(lon, lat, (a, b), 0.6, n, 3), np.ones(n)), (0.5, 0.9)
    )
    for share, region in found.items():
        log = np.log(1 / (1 - share))
        assert region.area == pytest.approx(
            TWICE * a * b * log, rel=4 * np.sqrt(share / (1 - share) / n) / log
        )
        error = np.sqrt(share * (1 - share) * (1 / n + 1 / 20_000))
        assert within(region, fresh).mean() == pytest.approx(share, abs=4 * error)
        ring = np.concatenate(
            [np.array(r.coords) for r in shapely.get_rings(shapely.get_parts(region.outline))]
        )
        assert np.ptp(ring[:, 0]) < 1 or np.abs(ring[:, 1]).max() == 90  # no jump at 180


def sector(rng: np.random.Generator, n: int, half: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (east, north) [m] in a box of 6 to 54 nmi, so many degrees on either side of 37."""
    bearing, apart = np.radians(37 + half * rng.uniform(-1, 1, n)), rng.uniform(6, 54, n) * 1852
    return apart * np.sin(bearing), apart * np.cos(bearing)


def ring(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (east, north) [m] at 29 to 31 nmi all round, as ranges alone have them."""
    bearing, apart = rng.uniform(0, TWICE, n), rng.uniform(29, 31, n) * 1852
    return apart * np.sin(bearing), apart * np.cos(bearing)


def clumps(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (east, north) [m] in two clumps, three of ten in one that is 32 km off."""
    other = rng.random(n) < 0.3
    return rng.normal(0, 900, n) + 3e4 * other, rng.normal(0, 1500, n) + 1e4 * other


CLOUDS = {
    "a box of one degree": lambda rng, n: sector(rng, n, 0.5),
    "a box of a fifth of a degree": lambda rng, n: sector(rng, n, 0.1),
    "a line": lambda rng, n: sector(rng, n, 0.0),
    "a ring": ring,
    "two clumps": clumps,
    "a core of 100 m and a tenth of it 100 km round": lambda rng, n: rng.normal(
        0, np.where(rng.random(n) < 0.9, 100.0, 1e5), (2, n)
    ),
    "heavy tails": lambda rng, n: 500 * np.clip(rng.standard_cauchy((2, n)), -4000, 4000),
    "a cross": lambda rng, n: rng.normal(
        0, np.where(rng.permuted(np.repeat([[True], [False]], n, axis=1), axis=0), 100.0, 1e5)
    ),
}


FIRST = ("two clumps", "heavy tails")  # the others in the thorough stage


@pytest.mark.thorough
@pytest.mark.parametrize(
    "kind",
    [pytest.param(kind, marks=[pytest.mark.thorough] * (kind not in FIRST)) for kind in CLOUDS],
)
def test_areas_hold_their_shares_of_what_they_have_not_seen(kind: str) -> None:
    """Clouds of 2500, by uneven weights, against 2500 fresh particles of the same law, 16 times,
    across 180 degrees at 61 S.

    Within a core that is much smaller than windows the density is all but one, less by what leaving
    out a particle's own makes of it: there areas hold at least their share, and a twentieth more at
    most.

    Four standard errors, by how the 16 differ: no more than 0.03, where shares of 2500 and of the
    effective number of the cloud have 0.015.
    """
    rng = np.random.default_rng(7)
    held = []
    for _ in range(16):
        one, two = (
            path.vector(
                *sphere.destination(np.radians(179.9), np.radians(-61.0), *CLOUDS[kind](rng, 2500))
            )
            for _ in range(2)
        )
        weight = rng.uniform(0.1, 1.0, 2500)
        found = density.areas(density.surface(one, weight), (0.5, 0.9))
        held.append([within(found[share], two).mean() for share in (0.5, 0.9)])
    scatter = np.std(held, axis=0, ddof=1)
    assert (scatter < 0.03).all()
    more = np.mean(held, axis=0) - (0.5, 0.9)
    assert (more > -4 * scatter / np.sqrt(16)).all()
    assert (more < 4 * scatter / np.sqrt(16) + (0.025 if "core" in kind else 0.0)).all()


def test_a_surface_is_that_of_scipy() -> None:
    """Cells hold integrals, and are a quarter of a window wide: the mean over one differs from the
    density in its middle by (1 / 4)^2 / 24 (d^2 - 2) of it, d windows from a particle; where it is
    a hundredth of the highest d^2 is 2 ln(100): by 2 %.

    At a particle, less its own window, it is that of the cell: of a middle no farther than 1/8 of a
    window along both axes.
    """
    place = cloud(179.98, -61.0, (9000.0, 2000.0), 0.6, 400, 5)
    weight = np.random.default_rng(2).uniform(0.1, 1.0, 400)
    surface = density.surface(place, weight)
    grid = surface.grid
    points = np.stack(sphere.offset(grid.lon, grid.lat, *np.radians(path.degrees(place))))
    kernel = stats.gaussian_kde(points, weights=weight)
    middles = grid.axes @ np.stack([v.ravel() for v in np.meshgrid(*grid.middles())])
    exact = kernel(middles).reshape(surface.height.shape)
    some = exact > exact.max() / 100
    np.testing.assert_allclose(surface.height[some], exact[some], rtol=0.02)
    assert (surface.height * grid.areas()).sum() == pytest.approx(1, abs=1e-4)

    own = weight / weight.sum() / (TWICE * np.sqrt(np.linalg.det(kernel.covariance)))
    eighth = np.sqrt(np.linalg.eigvalsh(kernel.covariance)) / 8
    near = [
        kernel(points + grid.axes @ (eighth * (i, j))[:, None])
        for i in np.linspace(-1, 1, 5)
        for j in np.linspace(-1, 1, 5)
    ]
    low, high = (
        np.maximum(f - own, f / 2)
        for f in (0.98 * np.min(near, axis=0), 1.02 * np.max(near, axis=0))
    )
    found = surface.at_particles[np.argsort(np.argsort(points[0]))]  # it has them from the least on
    assert ((found >= low) & (found <= high)).all()


def test_a_weight_is_as_many_particles() -> None:
    """But for the width of the windows, which goes by how many effectively count: the middle of a
    surface is the mean by weight.
    """
    place = cloud(-76.3, 14.2, (9000.0, 4000.0), 0.6, 300, 5)
    lon, lat = np.radians(path.degrees(place))
    weight = np.random.default_rng(2).integers(1, 4, 300) + 3.0 * (lon > np.radians(-76.3))
    surface = density.surface(place, weight)
    nobody = density.surface(np.vstack([place, -place]), np.append(weight, np.zeros(300)))
    np.testing.assert_array_equal(nobody.height, surface.height)  # who has no weight is not there
    mean = np.average(
        sphere.offset(np.radians(-76.3), np.radians(14.2), lon, lat), axis=1, weights=weight
    )
    mass = surface.height * surface.grid.areas()
    x, y = np.meshgrid(*surface.grid.middles())
    middle = surface.grid.places(*(np.array([np.sum(mass * v)]) for v in (x, y)))
    found = np.ravel(sphere.offset(np.radians(-76.3), np.radians(14.2), *middle))
    np.testing.assert_allclose(found, mean, atol=5.0)


def test_two_clumps_have_two_outlines_and_each_its_share() -> None:
    place = np.concatenate(
        [
            cloud(-76.0, 14.0, (1500.0, 900.0), 0.3, 900, 1),
            cloud(-75.6, 14.3, (900.0, 1500.0), 0.9, 900, 2),
        ]
    )
    weight = np.repeat([1.0, 3.0], 900)
    found = density.areas(density.surface(place, weight), (0.5, 0.9))
    assert len(found[0.9].outline.geoms) == 2
    for share, region in found.items():
        fresh = (
            within(region, cloud(-76.0, 14.0, (1500.0, 900.0), 0.3, 900, 3)),
            within(region, cloud(-75.6, 14.3, (900.0, 1500.0), 0.9, 900, 4)),
        )
        held = 0.25 * fresh[0].mean() + 0.75 * fresh[1].mean()
        effective = weight.sum() ** 2 / (weight**2).sum()  # of either; four standard errors
        assert held == pytest.approx(share, abs=4 * np.sqrt(share * (1 - share) * 2 / effective))


def test_an_outline_is_where_a_surface_is_above_its_line() -> None:
    """Of a rough field, at 20,000 points, but for rounding."""
    rng = np.random.default_rng(5)
    x, y = 3.0 + 0.7 * np.arange(9), -2.0 + 0.4 * np.arange(7)
    field = np.pad(rng.normal(size=(5, 7)), 1, constant_values=-6.0)
    lattice = areas.Lattice(x, y, (0.7, 0.4), lambda ring: ring)
    at = rng.uniform((x[0], y[0]), (x[-1], y[-1]), (20_000, 2))
    for line in (-3.0, -0.4, 0.3, 0.8):
        _, outline = areas.contour(lattice, field, line)
        inside = areas.interpolated(lattice, field, *at.T) > line
        assert 0.01 < inside.mean() < 0.9
        assert np.mean(shapely.contains_xy(outline, *at.T) != inside) == 0


def test_what_lies_even_on_the_earth_is_as_dense_far_off() -> None:
    """A spiral of 20,000 over a cap of 60 degrees: its density 30 to 40 degrees off is that in the
    middle, one over the cap's area.

    In the plane that touches the Earth cells there are 5 to 7 % too large. Windows, 5 degrees wide,
    take less than 0.6 % off.
    """
    k = np.arange(20_000) + 0.5
    z, angle = 1 - 0.5 * k / 20_000, np.pi * (1 + np.sqrt(5)) * k
    middle, east, north = (
        np.array(v)
        for v in ((0.5, 0.5, 0.5**0.5), (-(0.5**0.5), 0.5**0.5, 0), (-0.5, -0.5, 0.5**0.5))
    )
    place = z[:, None] * middle + np.sqrt(1 - z**2)[:, None] * (
        np.cos(angle)[:, None] * east + np.sin(angle)[:, None] * north
    )
    surface = density.surface(place, np.ones(20_000))
    apart = np.degrees(np.hypot(*np.meshgrid(*surface.grid.middles())) / sphere.RADIUS)
    exact = 1 / (TWICE * sphere.RADIUS**2 * (1 - np.cos(np.radians(60))))
    for some in (apart < 10, (apart > 30) & (apart < 40)):
        assert surface.height[some].mean() / exact == pytest.approx(1, rel=0.01)


def test_many_particles_are_taken_some_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    place = cloud(12.0, -34.2, (7000.0, 3000.0), 0.9, 1001, 3)
    whole = density.surface(place, np.ones(1001))
    monkeypatch.setattr(density, "AT_ONCE", 100)
    np.testing.assert_allclose(
        density.surface(place, np.ones(1001)).height, whole.height, rtol=1e-10, atol=1e-30
    )


@pytest.mark.parametrize(
    ("lon", "lat"),
    [
        *((lon, -61.0) for lon in (12.0, *np.arange(179.2, 179.25, 0.01), 179.95)),
        (0.0, 90.0),
        (100.0, -89.9),
        (-70.0, 89.7),
    ],
)
def test_a_ring_has_a_hole_where_longitudes_jump_too(lon: float, lat: float) -> None:
    """By the spherical excess of its rings, in longitude and sine of latitude (Lambert), with every
    vertex on one turn.
    """
    east, north = ring(np.random.default_rng(3), 2500)
    place = path.vector(*sphere.destination(np.radians(lon), np.radians(lat), east, north))
    region = density.areas(density.surface(place, np.ones(2500)), (0.99,))[0.99]
    assert not within(region, path.vector(np.radians([lon]), np.radians([lat]))).any()
    assert within(region, place).mean() == pytest.approx(0.99, abs=0.01)
    flat = shapely.transform(
        region.outline,
        lambda v: np.stack([np.radians(v[:, 0]), np.sin(np.radians(v[:, 1]))], axis=1),
    )
    assert flat.area * sphere.RADIUS**2 == pytest.approx(region.area, rel=1e-6)
    assert (
        len(shapely.get_rings(shapely.get_parts(region.outline))) >= 2 or abs(lat) > 80
    )  # a band round a pole has one


def test_a_cloud_that_is_all_ashore_has_the_areas_it_would_have_at_sea() -> None:
    place = cloud(12.0, -34.2, (7000.0, 3000.0), 0.9, 500, 3)
    sea = density.areas(density.surface(place, np.ones(500)), (0.5, 0.9))
    land = density.areas(
        density.surface(place, np.ones(500), lambda lon, lat: np.ones(lon.shape, bool)), (0.5, 0.9)
    )
    assert [region.area for region in land.values()] == [region.area for region in sea.values()]
    assert all(region.area > 1e6 for region in sea.values())


def test_what_cells_ashore_cost_is_made_up_for() -> None:
    """Where three of ten particles are in cells whose middles are on land, the area of 50 % still
    holds half of all; that of 90 % all water. Outlines run between the middles of cells at sea and
    ashore.

    Four standard errors of shares of 4000 and 4000.
    """

    def dry(lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
        east, north = sphere.offset(np.radians(179.99), np.radians(-34.2), lon, lat)
        return east + 0.3 * north > 3000.0

    place, fresh = (cloud(179.99, -34.2, (7000.0, 3000.0), 0.9, 4000, seed) for seed in (3, 4))
    wet = ~dry(*np.radians(path.degrees(fresh)))
    assert 0.6 < wet.mean() < 0.8
    surface = density.surface(place, np.ones(4000), dry)
    found = density.areas(surface, (0.5, 0.9))
    for share, region in zip((0.5, wet.mean()), found.values(), strict=True):
        held = within(region, fresh)
        beyond = sphere.offset(
            np.radians(179.99), np.radians(-34.2), *np.radians(path.degrees(fresh[held & ~wet]))
        )
        cell = np.hypot(*(v[1] - v[0] for v in (surface.grid.x, surface.grid.y)))
        assert ((beyond[0] + 0.3 * beyond[1] - 3000.0) / np.hypot(1, 0.3)).max(initial=0) < cell
        assert held.mean() == pytest.approx(share, abs=4 * np.sqrt(share * (1 - share) * 2 / 4000))


@pytest.mark.parametrize("many", [1, 2, 500])
def test_a_cloud_at_a_point_has_an_area_of_a_few_metres(many: int) -> None:
    place = np.repeat(path.vector([np.radians(5.0)], [np.radians(-41.0)]), many, axis=0)
    region = density.areas(density.surface(place, np.ones(many)), (0.9,))[0.9]
    assert within(region, place).all()
    assert 0 < region.area < 0.01e6


def test_densities_of_a_course_go_round() -> None:
    """By quadrature they hold one, and they are those of von Mises' normal limit about north."""
    rng = np.random.default_rng(4)
    course, weight = rng.normal(0.0, 0.4, 2000) % TWICE, rng.random(2000)
    at = np.linspace(0, TWICE, 721)[:-1]
    found = density.along(course, weight, np.radians(7.2), at, TWICE)
    assert found.mean() * TWICE == pytest.approx(1, rel=1e-6)
    exact = stats.norm.pdf((at + np.pi) % TWICE - np.pi, scale=np.hypot(0.4, np.radians(7.2)))
    # Standard error of a density by windows: sqrt(p / (2 sqrt(pi) h m)), m effective; four of the
    # largest
    m = weight.sum() ** 2 / (weight**2).sum()
    assert np.abs(found - exact).max() < 4 * np.sqrt(
        exact.max() / (2 * np.sqrt(np.pi) * np.radians(7.2) * m)
    )


def test_copies_make_no_area_smaller() -> None:
    """Particles of which each is there several times are as those that are there once, by weight:
    their windows are as wide.
    """
    rng = np.random.default_rng(3)
    lon, lat = sphere.destination(
        np.radians(179.97), np.radians(-63.0), rng.normal(0, 2500, 60), rng.normal(0, 900, 60)
    )
    times = rng.integers(1, 9, 60)
    place = path.vector(lon, lat)
    once = density.areas(density.surface(place, times.astype(float)), (0.5, 0.9))
    copied = density.areas(
        density.surface(np.repeat(place, times, axis=0), np.ones(times.sum())), (0.5, 0.9)
    )
    for share in (0.5, 0.9):
        assert copied[share].area == pytest.approx(once[share].area, rel=1e-6)


def test_what_is_within_a_region_is_so_across_180_degrees_and_round_a_pole() -> None:
    """A cloud on either side of 180 degrees, with places by pyproj at 20 m and at 60 km from its
    middle; one round the pole.
    """
    rng = np.random.default_rng(3)
    for lon, lat in ((179.999, -16.3), (-179.99, 61.0), (40.0, 90.0)):
        azimuth = rng.uniform(0, 360, 900)
        to = EARTH.fwd(
            np.full(900, lon), np.full(900, lat), azimuth, 9000 * np.sqrt(rng.random(900))
        )
        region = density.areas(
            density.surface(path.vector(*np.radians(to[:2])), np.ones(900)), (0.9,)
        )[0.9]
        for away, inside in ((20.0, True), (5000.0, True), (60_000.0, False)):
            there = EARTH.fwd(
                np.full(60, lon), np.full(60, lat), np.arange(60) * 6.1, np.full(60, away)
            )
            assert (density.holds(region, path.vector(*np.radians(there[:2]))) == inside).all()
