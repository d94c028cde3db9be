"""Densities of clouds, against normal distributions, SciPy's, and the sphere's own areas."""

import numpy as np
import pytest
import shapely
from scipy import stats

from drift.tracker import density, path
from geo import sphere

TWICE = 2 * np.pi


def cloud(lon: float, lat: float, std: tuple[float, float], turn: float, n: int, seed: int) -> np.ndarray:
    """Return unit vectors normal about a place [deg], with standard deviations [m] along an axis and across it."""
    along, across = np.random.default_rng(seed).standard_normal((2, n)) * np.array(std)[:, None]
    east, north = along * np.sin(turn) + across * np.cos(turn), along * np.cos(turn) - across * np.sin(turn)
    return path.vector(*sphere.destination(np.radians(lon), np.radians(lat), east, north))


@pytest.mark.parametrize("lon", [-76.3, 179.99])
def test_areas_of_a_normal_cloud(lon: float) -> None:
    """2 pi a b ln(1 / (1 - p)), and by the windows, of n^(-1/6) of its spread (Scott), (1 + n^(-1/3)) times that.

    By 4000 particles: the area's standard error about sqrt(ln(1 / (1 - p)) / n) relative, for that of a b is 1 / sqrt(n);
    four of it, and 1 % for cells and outline.
    """
    n, a, b = 4000, 9000.0, 4000.0
    place = cloud(lon, 34.2, (a, b), 0.6, n, 3)
    found = density.areas(density.surface(place, np.ones(n)), (0.5, 0.9))
    for share, region in found.items():
        exact = TWICE * a * b * np.log(1 / (1 - share)) * (1 + n ** (-1 / 3))
        assert region.area == pytest.approx(exact, rel=4 / np.sqrt(n) + 0.01)
        ring = np.concatenate([np.array(r.coords) for r in shapely.get_rings(shapely.get_parts(region.outline))])
        assert np.ptp(ring[:, 0]) < 1  # no jump at 180
        own = np.degrees(np.unwrap(np.radians([ring[0, 0], *path.degrees(place)[0]])))[1:]
        inside = shapely.contains_xy(region.outline, own, path.degrees(place)[1]).mean()
        # Windows widen the area: the particles within are those of 1 - (1 - p)^(1 + n^(-1/3)).
        assert inside == pytest.approx(1 - (1 - share) ** (1 + n ** (-1 / 3)), abs=4 * np.sqrt(0.25 / n) + 0.005)


def test_a_weight_is_as_many_particles() -> None:
    """But for the width of the windows, which goes by how many effectively count: here given alike."""
    place = cloud(-76.3, 14.2, (9000.0, 4000.0), 0.6, 300, 5)
    lon, lat = np.radians(path.degrees(place))
    weight = np.random.default_rng(2).integers(1, 4, 300) + 3 * (lon > np.radians(-76.3))
    points = np.stack(sphere.offset(np.radians(-76.3), np.radians(14.2), lon, lat))
    one = stats.gaussian_kde(points, 0.3, weight)
    two = stats.gaussian_kde(np.repeat(points, weight, axis=1), 0.3)
    at = points[:, :20]
    np.testing.assert_allclose(one(at), two(at), rtol=0.01)
    surface = density.surface(place, weight.astype(float))
    assert surface.mass.sum() == pytest.approx(1)
    lon, lat = (
        np.degrees(x)
        for x in sphere.destination(np.radians(-76.3), np.radians(14.2), *np.average(points, axis=1, weights=weight))
    )
    assert (surface.mass.sum(axis=0) @ surface.cells.lon()) == pytest.approx(float(lon), abs=1e-3)
    assert (surface.mass.sum(axis=1) @ surface.cells.lat()) == pytest.approx(float(lat), abs=1e-3)


def test_two_clumps_have_two_outlines_and_each_its_share() -> None:
    place = np.concatenate(
        [cloud(-76.0, 14.0, (1500.0, 900.0), 0.3, 900, 1), cloud(-75.6, 14.3, (900.0, 1500.0), 0.9, 900, 2)]
    )
    weight = np.repeat([1.0, 3.0], 900)
    region = density.areas(density.surface(place, weight), (0.9,))[0.9]
    assert len(region.outline.geoms) == 2


@pytest.mark.parametrize("many", [1, 2, 500])
def test_a_cloud_at_a_point_has_an_area_of_a_few_metres(many: int) -> None:
    place = np.repeat(path.vector([np.radians(5.0)], [np.radians(-41.0)]), many, axis=0)
    region = density.areas(density.surface(place, np.ones(many)), (0.9,))[0.9]
    assert 0 < region.area < 0.01e6


def test_densities_of_a_course_go_round() -> None:
    """By quadrature they hold one, and they are those of von Mises' normal limit about north."""
    rng = np.random.default_rng(4)
    course, weight = rng.normal(0.0, 0.4, 2000) % TWICE, rng.random(2000)
    at = np.linspace(0, TWICE, 721)[:-1]
    found = density.along(course, weight, np.radians(7.2), at, TWICE)
    assert found.mean() * TWICE == pytest.approx(1, rel=1e-6)
    exact = stats.norm.pdf((at + np.pi) % TWICE - np.pi, scale=np.hypot(0.4, np.radians(7.2)))
    # Standard error of a density by windows: sqrt(p / (2 sqrt(pi) h m)), m effective; four of the largest
    m = weight.sum() ** 2 / (weight**2).sum()
    assert np.abs(found - exact).max() < 4 * np.sqrt(exact.max() / (2 * np.sqrt(np.pi) * np.radians(7.2) * m))


def test_copies_make_no_area_smaller() -> None:
    """Particles of which each is there several times are as those that are there once, by weight: their windows are as wide."""
    rng = np.random.default_rng(3)
    lon, lat = sphere.destination(
        np.radians(179.97), np.radians(-63.0), rng.normal(0, 2500, 60), rng.normal(0, 900, 60)
    )
    times = rng.integers(1, 9, 60)
    place = path.vector(lon, lat)
    once = density.areas(density.surface(place, times.astype(float)), (0.5, 0.9))
    copied = density.areas(density.surface(np.repeat(place, times, axis=0), np.ones(times.sum())), (0.5, 0.9))
    for share in (0.5, 0.9):
        assert copied[share].area == pytest.approx(once[share].area, rel=1e-6)


def test_effective_particles_are_those_at_places_of_their_own() -> None:
    place = path.vector(np.radians([179.99, -179.99, 12.0]), np.radians([-63.0, -63.1, 71.0]))
    assert density.effective(np.repeat(place, 5, axis=0), np.ones(15)) == pytest.approx(3.0)
    assert density.effective(place, np.array([3.0, 1.0, 0.0])) == pytest.approx(16 / 10)
