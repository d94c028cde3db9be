"""Fitting errors to drifters: the parameters against drifters simulated here."""

import functools
import math

import numpy as np
import pytest
import trial_case
import xarray as xr
from scipy import stats
from simulated_drifters import MEAN, RADIUS, TRUE, WINDAGE, simulated, ways

from drift.assess.verify import along, error_law, fitting
from drift.assess.verify.error_law import Law
from drift.tracking.tracks.records import Track

SETS, BUOYS = 6, 12


@pytest.fixture(scope="module")
def sets():
    return [ways(simulated(np.random.default_rng(700 + k), BUOYS, 2.0)) for k in range(SETS)]


@pytest.fixture(scope="module")
def fit_of(sets):
    """Return the fit to a set, made when it is first asked for."""
    return functools.cache(lambda k: fitting.fitted_errors(sets[k], True))


@pytest.mark.thorough
@pytest.mark.parametrize("many", [2, pytest.param(SETS, marks=pytest.mark.thorough)])
def test_parameters_are_recovered_within_what_their_errors_say(fit_of, many):
    """Each z is about a standard normal: the sum of the squares of so many has a chi-square law.

    Eight parameters, both tails: with limits of 1e-4 a true fit fails in 1 of 600 choices of seeds.
    Taken together, of all z's (each 2 printed standard errors wide or less with 95.4 %) at least so
    many lie within 2 as the binomial law says.
    """
    z = []
    for fit in map(fit_of, range(many)):
        row = [
            (math.log(fit.parameters[name].value) - math.log(getattr(TRUE, name)))
            / fit.parameters[name].curvature
            for name in error_law.NAMES
        ]
        row.append((fit.windage - WINDAGE) / fit.windage_error)
        row += [(a - b) / c for a, b, c in zip(fit.mean, MEAN, fit.mean_error, strict=True)]
        z.append(row)
        assert fit.clustered
        assert all(one.identified and one.error >= one.curvature for one in fit.parameters.values())
    squares = np.square(z).sum(axis=0)
    low, high = stats.chi2.ppf([1e-4, 1 - 1e-4], many)
    assert (squares > low).all()
    assert (squares < high).all()
    assert (np.abs(z) < 2).sum() >= stats.binom.ppf(1e-3, 8 * many, 0.954)


def test_correlation_of_the_data_is_that_of_the_law(sets):
    """About the true mean error nothing is fitted, and sets of drifters are independent: a t test
    of each lag, 1 in 1,000.
    """
    rows = np.array(
        [fitting._correlation(TRUE, np.array([WINDAGE, *MEAN]), one, True) for one in sets]
    )
    assert (rows[:, :, 0] == [3.0, 6.0, 12.0, 24.0, 48.0]).all()
    assert (stats.ttest_rel(rows[:, :, 1], rows[:, :, 3]).pvalue > 1e-3).all()


def test_correlation_beside_a_fit_is_that_of_the_fit(sets, fit_of):
    fit = fit_of(0)
    mean = np.array([fit.windage, *fit.mean])
    assert np.array_equal(fit.correlation, fitting._correlation(fit.law, mean, sets[0], True))


@pytest.mark.thorough
def test_ellipses_hold_out_what_they_say():
    fit = fitting.fitted_errors(
        ways(simulated(np.random.default_rng(31), 24, 3.2)), True, held_out=True
    )
    assert fit.held is not None
    assert {one.hours for one in fit.held.coverage} == {3.0, 6.0, 12.0, 24.0}
    for one in fit.held.coverage:
        assert one.held.count > 30
        assert abs(one.held.mean - one.share) < 3 * one.held.error
    assert abs(fit.held.own - fit.held.other) < 0.2


@pytest.mark.thorough
def test_what_the_data_do_not_tell_is_said():
    still = Law(std=0.2, time=6 * 3600, bias=0.0, diffusivity=0.0, noise=100.0)
    alone = fitting.fitted_errors(ways(simulated(np.random.default_rng(8), 1, 1.4, still)), True)
    assert not alone.parameters["bias"].identified
    assert alone.law.bias == 0
    assert not alone.clustered
    walk = alone.parameters["diffusivity"]
    assert not walk.identified
    # and beyond it the data speak against it, by the quantile of the profile's law
    assert walk.limit > walk.value
    tracks = along.residuals(ways(simulated(np.random.default_rng(8), 1, 1.4, still)), True)
    free = ["std", "time", "diffusivity", "noise"]
    _, there = fitting.fit_law(tracks, free, alone.law, {"diffusivity": walk.limit})
    assert alone.log - there.log == pytest.approx(stats.norm.ppf(0.95) ** 2 / 2, abs=0.2)
    short = fitting.fitted_errors(
        ways(simulated(np.random.default_rng(10), 4, 0.25, Law(0.2, 40 * 3600, 0.1, 4.0, 30.0))),
        True,
    )
    assert not short.parameters["time"].identified


def test_the_models_way_is_the_integral_along_the_drifters_own(tmp_path):
    """A current and a wind that are linear in place and time, so that their interpolation is exact,
    on grids of their own.

    The ways are integrals along the drifter's chords, here by 2,000 midpoints. What remains:
    float32 values (3e-8 m/s), and times of quadrature in whole seconds, 0.5 s of 2e-6 m/s2: both
    under 0.02 m in 2 h; the curve of a chord of 4 km, 0.3 m across, of a shear of 1e-5 /s: nothing.
    """

    def u(lon, lat, t, k):
        return 0.11 * k + 0.31 * (lon - 5) - 0.17 * (lat - 60) + 2e-6 * t * (2 - k)

    def v(lon, lat, t, k):
        return -0.23 + 0.12 * (lon - 5) * k + 0.4 * (lat - 60) - 1e-6 * t

    start = np.datetime64("2021-05-04T00:00", "s")
    hours, lons, lats = np.arange(0, 31, 3), np.linspace(4, 7, 31), np.linspace(59, 61, 41)
    t, y, x = np.meshgrid(hours * 3600.0, lats, lons, indexing="ij")
    sets = {}
    for name, k in (("c", 1.0), ("w", 3.0)):
        east, north = (f(x, y, t, k).astype(np.float32) for f in (u, v))
        if name == "c":
            hole = (x > 5.9) & (y > 60.4)
            east[hole] = north[hole] = np.nan
        sets[name] = xr.Dataset(
            {"ue": (("time", "lat", "lon"), east, {"units": "m/s"}), "vn": (("time", "lat", "lon"), north, {"units": "m/s"})},
            {"time": start.astype("datetime64[ns]") + hours * np.timedelta64(3600, "s"), "lat": ("lat", lats, {"units": "degrees_north"}),
             "lon": ("lon", lons, {"units": "degrees_east"})},
        )  # fmt: skip
    names = {"variables": {"east": "ue", "north": "vn"}}
    case = trial_case.load(
        tmp_path,
        start="2021-05-01T00:00Z",
        current={"dataset": "c", "fill": 0, **names},
        wind={"dataset": "w", **names},
        scenario={"object": {"windage": "2 %"}, "position": {"at": [5, 60], "error": "1 nmi"}},
    )
    rng = np.random.default_rng(2)
    begin = float(start.astype(np.int64))
    time = begin + np.cumsum([7, *rng.integers(1500, 7300, 40)])
    lon = 4.6 + 0.0231 * np.arange(41) + rng.normal(0, 0.01, 41)
    lat = 59.7 + 0.0081 * np.arange(41) + rng.normal(0, 0.005, 41)
    gone = Track("gone", time + 40 * 3600, lon, lat)  # the sources end meanwhile
    # in the hole
    north = Track("north", time[:4], np.linspace(6.3, 6.4, 4), np.linspace(60.7, 60.75, 4))
    made = along.compare_displacements(
        case, [Track("b", time, lon, lat), gone, north], {}, 3 * 3600.0, 3.0, sets
    )
    assert [way.name for way in made.ways] == ["b"]
    way = made.ways[0]
    inside = time <= begin + 30 * 3600
    assert (~way.fresh[1:] == inside[1:]).all()
    assert (
        f"{(~inside).sum() + 40 + 3} displacements between fixes left out: the forcing has no value there"
        in made.notes[-1]
    )
    share = (np.arange(2000) + 0.5) / 2000
    for k in np.flatnonzero(~way.fresh):
        px, py, pt = ((a[k - 1] + (a[k] - a[k - 1]) * share) for a in (lon, lat, time - begin))
        span = time[k] - time[k - 1]
        for found, factor in ((way.model, 1.0), (way.wind, 3.0)):
            expected = [f(px, py, pt, factor).mean() * span for f in (u, v)]
            assert found[k] == pytest.approx(expected, abs=0.05)
        middle = np.radians((lat[k] + lat[k - 1]) / 2)
        made_good = (
            np.radians([(lon[k] - lon[k - 1]) * np.cos(middle), lat[k] - lat[k - 1]]) * RADIUS
        )
        # the tangent plane of the fix before turns by half the convergence of meridians
        turn = np.radians(lon[k] - lon[k - 1]) / 2 * np.sin(middle)
        assert way.observed[k] == pytest.approx(
            made_good, abs=1.1 * abs(turn) * np.hypot(*made_good) + 0.05
        )


def test_a_wind_that_is_always_the_same_tells_no_windage():
    tracks = simulated(np.random.default_rng(15), 2, 0.8)
    same = [
        Track(
            t.name,
            t.time,
            t.lon,
            t.lat,
            {**t.columns, "a": 0 * t.time + 5.0, "b": 0 * t.time - 3.0},
        )
        for t in tracks
    ]
    fit = fitting.fitted_errors(ways(same), True)
    assert math.isnan(fit.windage)
    assert fitting.ONE_WIND in fit.notes
    assert np.isfinite(fit.mean_error).all()
