"""Priors: moments, ellipses and areas against closed forms and shapely; releases; water; the
antimeridian.
"""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from scipy import stats

from drift.engine.motion import prior
from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.errors.forcing_error import Errors, ForcingError
from drift.engine.motion.objects.leeway import Drifter, Line
from drift.engine.motion.period import Period
from drift.engine.motion.scenario import (
    AreaPrior,
    Displacement,
    PositionPrior,
    Scenario,
    TracklinePrior,
)
from drift.engine.particles import ensemble as record
from geo import sphere
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast.shore import Shore
from kernels.maths import noise
from kernels.runtime import runtime
from kernels.step import coast as device_coast
from kernels.step import prior as kernel

N = 100_000
START = np.datetime64("2026-11-21T18:30:00", "s")
HOUR = np.timedelta64(3600, "s")
DRIFTER = Drifter(
    "test", "", Line(0.03, 0.02, 0.06), Line(0.01, -0.03, 0.04), Line(-0.02, 0.01, 0.05)
)


def told(*scenarios: Scenario, particles: int = N, direction: int = 1) -> EnsembleSpec:
    """Return what a prior is drawn from, over a day, without errors of the forcing."""
    none, period = ForcingError(0.0, 1.0), Period(START, START + direction * 24 * HOUR, direction)
    return EnsembleSpec(period, scenarios, Errors(none, none, 0.0), particles, seed=3)


def scenario(where, weight: float = 1.0, name: str = "s") -> Scenario:
    return Scenario(name, weight, DRIFTER, 0.0, where, {})


def position(
    lon: float,
    lat: float,
    major=5000.0,
    minor=2000.0,
    orientation=0.6,
    displacement=None,
    hours=(0, 0),
):
    first, last = (START + h * HOUR for h in hours)
    return PositionPrior(
        np.radians(lon), np.radians(lat), major, minor, orientation, displacement, first, last
    )


def columns(spec: EnsembleSpec, coast=None) -> tuple[record.Ensemble, np.ndarray, np.ndarray]:
    ensemble = prior.draw_ensemble(spec, coast).ensemble
    return ensemble, ensemble.lon.to_numpy() * sphere.UNIT, ensemble.lat.to_numpy() * sphere.UNIT


@pytest.mark.parametrize(("lon", "lat"), [(-88.3, 27.5), (179.97, -17.0), (30.0, 84.5)])
def test_a_position_report_is_normal_in_its_tangent_plane(lon: float, lat: float) -> None:
    _, x, y = columns(told(scenario(position(lon, lat))))
    east, north = sphere.offset(np.radians(lon), np.radians(lat), x, y)
    along = east * np.sin(0.6) + north * np.cos(0.6)
    across = east * np.cos(0.6) - north * np.sin(0.6)
    for sample, std in ((along, 5000.0), (across, 2000.0)):
        assert abs(sample.mean()) < 4.5 * std / np.sqrt(N)
        assert abs(sample.std() / std - 1) < 4.5 / np.sqrt(2 * N)
    assert abs(np.corrcoef(along, across)[0, 1]) < 4.5 / np.sqrt(N)


def test_a_displacement_is_uniform_in_distance_and_sector() -> None:
    moved = Displacement((2000.0, 12_000.0), (np.radians(350), np.radians(380)))
    _, x, y = columns(told(scenario(position(-88, 27, 0.0, 0.0, 0.0, moved))))
    east, north = sphere.offset(np.radians(-88), np.radians(27), x, y)
    length, bearing = np.hypot(east, north), np.degrees(np.arctan2(east, north))
    assert length.min() == pytest.approx(2000, abs=5)
    assert length.max() == pytest.approx(12_000, abs=5)
    assert abs(length.mean() - 7000) < 4.5 * 10_000 / np.sqrt(12 * N)
    assert bearing.min() == pytest.approx(-10, abs=0.05)
    assert bearing.max() == pytest.approx(20, abs=0.05)


def test_an_area_is_filled_uniformly_on_the_sphere_across_the_antimeridian() -> None:
    """Counts in strips of latitude go as the area between parallels, sin(lat): at 60-75 N far from
    uniform in degrees.
    """
    lon, lat = np.radians([170, 195, 190, 175]), np.radians([60, 60, 75, 75])
    _, x, y = columns(told(scenario(AreaPrior(tuple(lon), tuple(lat), START, START))))
    x = np.degrees(x) % 360
    polygon = shapely.Polygon([(170, 60), (195, 60), (190, 75), (175, 75)])
    assert shapely.contains_xy(polygon.buffer(1e-6), x, np.degrees(y)).all()
    edges = np.radians(np.linspace(60, 75, 7))
    # Width of the polygon at a latitude is linear: integrate width * cos(lat) by fine Riemann sums.
    fine = np.linspace(edges[0], edges[-1], 60_001)
    density = (25 - 10 * (np.degrees(fine) - 60) / 15) * np.cos(fine)
    cumulative = np.concatenate([[0], np.cumsum((density[1:] + density[:-1]) / 2)])
    expected = np.diff(np.interp(edges, fine, cumulative / cumulative[-1]))
    found = np.histogram(y, edges)[0] / N
    assert np.abs(found - expected).max() < 4.5 * np.sqrt(0.25 / N)


def test_a_trackline_has_its_cross_track_error_and_times() -> None:
    lon, lat = np.radians([178.0, -178.5, -177.0]), np.radians([-17.0, -16.0, -18.0])
    length = sphere.distance(lon[:-1], lat[:-1], lon[1:], lat[1:])
    speed = 5.0
    seconds = round(float(length.sum() / speed))
    arrival = START + np.timedelta64(seconds, "s")
    where = TracklinePrior(
        tuple(lon), tuple(lat), 1500.0, START, arrival, speed, 0.0, 1.0, 0.7, START, arrival
    )
    ensemble, x, y = columns(told(scenario(where)))
    share = ensemble.release.to_numpy() / seconds
    assert share.min() >= 0
    assert share.max() <= 1
    # Triangular on [0, 1] with its top at 0.7: mean (0 + 1 + 0.7) / 3, variance (1 + 0.49 - 0.7) /
    # 18.
    assert abs(share.mean() - 1.7 / 3) < 4.5 * np.sqrt(0.79 / 18 / N)
    first = share < length[0] / length.sum() - 0.01
    ahead, off = _legwise(lon, lat, x[first], y[first])
    assert abs(off.std() / 1500 - 1) < 4.5 / np.sqrt(2 * first.sum())
    # a whole second of sailing, and rounding
    assert np.abs(ahead - share[first] * length.sum()).max() < 20.0


def _legwise(lon, lat, x, y) -> tuple[np.ndarray, np.ndarray]:
    """Return distances along and across the first leg [m] by spherical trigonometry (Williams'
    Aviation Formulary).
    """
    d = sphere.distance(lon[0], lat[0], x, y) / sphere.RADIUS
    to_point = np.arctan2(*sphere.offset(lon[0], lat[0], x, y))
    course = np.arctan2(*sphere.offset(lon[0], lat[0], lon[1], lat[1]))
    across = np.arcsin(np.sin(d) * np.sin(to_point - course))
    along = np.arctan2(np.sin(d) * np.cos(to_point - course), np.cos(d))
    return along * sphere.RADIUS, across * sphere.RADIUS


def test_releases_are_uniform_in_their_window_forward_and_backward() -> None:
    for direction, hours in ((1, (1, 5)), (-1, (-5, -1))):
        where = position(-88, 27, hours=hours)
        release = columns(told(scenario(where), direction=direction))[0].release.to_numpy()
        assert release.min() == 3600
        assert release.max() == 5 * 3600
        assert abs(release.mean() - 3 * 3600) < 4.5 * 4 * 3600 / np.sqrt(12 * N)


def test_scenarios_share_the_particles_and_keep_their_weights() -> None:
    spec = told(scenario(position(-88, 27), 0.999, "a"), scenario(position(-85, 25), 0.001, "b"))
    ensemble = columns(spec)[0]
    # an unlikely scenario is still told by 5 %
    assert ensemble.bounds[1] / N == pytest.approx(0.999 / 1.049, abs=1e-4)
    assert record.weighed(ensemble).scenarios == pytest.approx([0.999, 0.001], rel=1e-5)


def test_objects_get_their_own_lines_and_sides() -> None:
    ensemble = columns(told(scenario(position(-88, 27))))[0]
    xi = []
    for name in ("down", "right", "left"):
        line = getattr(DRIFTER, name)
        slope, offset = (
            ensemble.own[f"{name}_{what}"].to_numpy().astype(float) for what in ("slope", "offset")
        )
        at_ten = slope * 10 + offset  # DESIGN: the variance at 10 m/s is the regression's
        assert abs(at_ten.mean() - (line.slope * 10 + line.offset)) < 4.5 * line.std / np.sqrt(N)
        assert abs(at_ten.std() / line.std - 1) < 4.5 / np.sqrt(2 * N)
        xi.append((slope - line.slope) / (line.std / 20))
        assert np.abs((offset - line.offset) / (line.std / 2) - xi[-1]).max() < 1e-3
    assert np.abs(np.corrcoef(xi) - np.eye(3)).max() < 4.5 / np.sqrt(N)
    side = ensemble.own["side"].to_numpy()
    assert set(np.unique(side)) == {-1, 1}
    assert abs(side.mean()) < 4.5 / np.sqrt(N)


def test_a_prior_partly_on_land_is_conditioned_on_water() -> None:
    """Land east of 88 W: half of a prior centred on the shore is dry, and what is left is the other
    half, unchanged.
    """
    land = shapely.Polygon([(-88, 20), (-80, 20), (-80, 35), (-88, 35)])
    box = Box(-90, 26, -86, 29)
    grid = shoreline.build_coast(Shore(np.array([land]), "square"), box)
    spec = told(scenario(position(-88.0000001, 27.5, 4000.0, 4000.0, 0.0)))
    drawn = prior.draw_ensemble(spec, device_coast.upload(grid))
    lon, lat = (c.to_numpy() * sphere.UNIT for c in (drawn.ensemble.lon, drawn.ensemble.lat))
    assert (np.degrees(lon) < -88).all()
    assert prior.shares_on_land(spec, drawn.tried, None)[0] == pytest.approx(
        0.5, abs=4.5 * 0.5 / np.sqrt(2 * N)
    )
    east, north = sphere.offset(np.radians(-88), np.radians(27.5), lon, lat)
    assert abs(np.abs(east).mean() / (4000 * np.sqrt(2 / np.pi)) - 1) < 4.5 * 0.756 / np.sqrt(N)
    assert abs(north.std() / 4000 - 1) < 4.5 / np.sqrt(2 * N)


def test_the_errors_that_particles_start_with_are_independent_normals() -> None:
    """East and north, of current and of wind: four numbers of their own, each with its standard
    deviation.
    """
    spec = told(scenario(position(-88, 27)))
    errors = Errors(ForcingError(0.3, 3600.0), ForcingError(1.7, 7200.0), 0.0)
    ensemble = columns(replace(spec, errors=errors))[0]
    names = [f"{kind}_error_{axis}" for kind in ("current", "wind") for axis in ("east", "north")]
    drawn = np.array([ensemble.columns[name].to_numpy() for name in names], np.float64)
    assert np.abs(drawn.std(axis=1) / [0.3, 0.3, 1.7, 1.7] - 1).max() < 4.5 / np.sqrt(2 * N)
    assert np.abs(np.corrcoef(drawn) - np.eye(4)).max() < 4.5 / np.sqrt(N)


def test_immersion_is_uniform_and_its_slope_balances_drag() -> None:
    """Of equal drag coefficients (Daniel et al. 2002): slope^2 = ratio^2 (1 - I) / I, so I = 1 / (1
    + (slope / ratio)^2).
    """
    slope = runtime.empty(N)
    kernel.draw_immersion(0, N, 0, slope, *noise.key(5), 0.35, 0.85, 0.034)
    immersion = 1 / (1 + (slope.to_numpy().astype(float) / 0.034) ** 2)
    assert stats.kstest(immersion, "uniform", args=(0.35, 0.5)).pvalue > 1e-4
