"""Fitting errors to drifters: the likelihood against a dense normal law, the parameters against
drifters simulated here.
"""

import functools
import math
import tomllib
from types import MappingProxyType

import numpy as np
import pytest
import xarray as xr
from scipy import stats

import drift
from drift.apps.cli import commands
from drift.assess.verify import along, error_law, fitting, hold_out
from drift.assess.verify.error_law import Law
from drift.case.values import units
from drift.engine.environment import along_track
from drift.tracking.tracks import clusters
from drift.tracking.tracks.records import Track

TRUE = Law(std=0.23, time=4.3 * 3600, bias=0.19, diffusivity=9.0, noise=130.0)
WINDAGE, MEAN = 0.017, (0.06, -0.035)
RADIUS = 6_371_008.8  # [m] of the sphere


def current(lon, lat, time):
    """East and north [m/s]: a shear, a tide and a trend, nowhere the same in both components."""
    tide = 2 * np.pi * time / (12.42 * 3600)
    return 0.21 + 0.09 * np.sin(tide + 0.4) + 0.3 * (lat - 47.0), -0.13 + 0.06 * np.cos(
        tide
    ) + 0.2 * (lon + 6.0)


def wind(lon, lat, time):
    """East and north [m/s], turning in three days."""
    turn = 2 * np.pi * time / (71 * 3600)
    return 4.0 + 5.5 * np.cos(turn), -2.5 + 4.2 * np.sin(turn + 1.1)


def simulated(rng, drifters, days, law=TRUE, step=300.0, start=1.0e9):
    """Return tracks with columns of the model at the fixes:

    Euler steps of a known flow, exact ones of the errors.
    """
    n = round(days * 86_400 / step)
    lon, lat = rng.uniform(-6.2, -5.6, drifters), rng.uniform(46.7, 47.3, drifters)
    bias = rng.normal(0, law.bias, (2, drifters))
    error = rng.normal(0, law.std, (2, drifters))
    phi = math.exp(-step / law.time)
    path = [(lon, lat)]
    for k in range(n):
        t = start + (k + 0.5) * step
        new = phi * error + law.std * math.sqrt(1 - phi**2) * rng.standard_normal((2, drifters))
        walk = rng.normal(0, math.sqrt(2 * law.diffusivity * step), (2, drifters))
        velocity = np.add(current(lon, lat, t), WINDAGE * np.array(wind(lon, lat, t))[:, None])
        moved = (velocity + np.array(MEAN)[:, None] + bias + (error + new) / 2) * step + walk
        error = new
        middle = lat + np.degrees(moved[1] / 2 / RADIUS)
        lat = lat + np.degrees(moved[1] / RADIUS)
        lon = lon + np.degrees(moved[0] / RADIUS / np.cos(np.radians(middle)))
        path.append((lon, lat))
    lons, lats = np.array(path).transpose(1, 0, 2)
    tracks = []
    for d in range(drifters):
        gaps = rng.choice([2, 7, 13, 20], n)  # of 10 to 100 minutes
        at = np.concatenate([[0], np.cumsum(gaps)])
        at = at[at <= n]
        time = start + at * step
        north = rng.normal(0, law.noise, at.size)
        east = rng.normal(0, law.noise, at.size)
        y = lats[at, d] + np.degrees(north / RADIUS)
        x = lons[at, d] + np.degrees(east / RADIUS / np.cos(np.radians(y)))
        u, v = current(lons[at, d], lats[at, d], time)
        a, b = wind(lons[at, d], lats[at, d], time)
        tracks.append(Track(f"buoy {d}", time, x, y, {"u": u, "v": v, "a": a, "b": b}))
    return tracks


COLUMNS = {"current_east": "u", "current_north": "v", "wind_east": "a", "wind_north": "b"}


class Bare:
    """A case without sources: all forcing comes from columns."""

    forcing = MappingProxyType({})


def ways(tracks):
    return along.compare_displacements(Bare, tracks, COLUMNS, 3 * 3600.0, 3.0).ways


def dense(tracks, law, mean):
    """Log likelihood of the increments by their dense covariance: double integrals in closed form,
    drifter by drifter.
    """
    total, information = 0.0, 0.0
    for d in range(len(tracks.step)):
        n = int(tracks.there[d].sum())
        t = np.cumsum(tracks.step[d, :n])
        stretch = np.cumsum(tracks.fresh[d, :n])
        a, b = np.meshgrid(t, t, indexing="ij")
        low, high = np.minimum(a, b), np.maximum(a, b)
        memory = law.time
        integral = law.std**2 * memory * (
            2 * low + memory * (np.exp(-low / memory) + np.exp(-high / memory) - 1 - np.exp(-(high - low) / memory))
        )  # fmt: skip
        position = (
            integral + law.bias**2 * a * b + 2 * law.diffusivity * low + law.noise**2 * np.eye(n)
        )
        steps = np.array(
            [
                row
                for row, k in zip(np.diff(np.eye(n), axis=0), np.diff(stretch), strict=True)
                if k == 0
            ]
        )
        covariance = steps @ position @ steps.T
        for c in range(2):
            # sums start again with each stretch, and no step crosses from one to the next
            left = steps @ (tracks.data[d, :n, c] - tracks.regressors[d, :n, c] @ mean)
            total += stats.multivariate_normal(np.zeros(len(left)), covariance).logpdf(left)
            design = steps @ tracks.regressors[d, :n, c]
            information = information + design.T @ np.linalg.solve(covariance, design)
    return total, np.atleast_2d(information)


def test_likelihood_is_that_of_a_dense_normal_law():
    tracks = simulated(np.random.default_rng(4), 3, 0.7)
    long = tracks[1]  # a night of silence splits one track; its velocity and bias go on
    awake = (long.time < long.time[5]) | (long.time > long.time[5] + 5 * 3600)
    tracks[1] = Track(
        long.name,
        long.time[awake],
        long.lon[awake],
        long.lat[awake],
        {k: v[awake] for k, v in long.columns.items()},
    )
    found = along.residuals(ways(tracks), wind=True)
    assert found.fresh[1].sum() == 2
    for law in (TRUE, Law(0.05, 400.0, 0.3, 0.0, 3.0), Law(0.4, 9e6, 0.0, 40.0, 700.0)):
        made = error_law.likelihood(law, found)
        total, information = dense(found, law, made.mean)
        assert made.own.sum() == pytest.approx(total, rel=1e-9)
        assert made.covariance == pytest.approx(np.linalg.inv(information), rel=1e-6)
        size = len(made.mean)
        restricted = total + size / 2 * math.log(2 * np.pi) - np.linalg.slogdet(information)[1] / 2
        assert made.log == pytest.approx(restricted, rel=1e-9)
        for shift in np.eye(size) * 1e-3:  # the unknowns of the mean are at their best
            assert dense(found, law, made.mean + shift)[0] < total


@pytest.mark.parametrize("hours", [0.001, 0.05, 1.0, 40.0])
def test_spread_and_correlation_are_integrals_of_the_covariance(hours):
    span, lag = hours * 3600, hours * 3600 * 2.3
    nodes, weight = np.polynomial.legendre.leggauss(60)
    t, w = (nodes + 1) * span / 2, weight * span / 2
    # the kernel has an edge on the diagonal: what lies below it counts twice, by a second rule on
    # [0, t]
    inner = np.array(
        [(weight * x / 2 * np.exp(-(x - (nodes + 1) * x / 2) / TRUE.time)).sum() for x in t]
    )
    variance = 2 * TRUE.std**2 * (w * inner).sum()
    expected = variance + TRUE.bias**2 * span**2 + 2 * TRUE.diffusivity * span + 2 * TRUE.noise**2
    assert error_law.error_variance(TRUE, span) == pytest.approx(expected, rel=1e-9)
    far = np.exp(-(lag + t[:, None] - t[None]) / TRUE.time)
    cross = TRUE.bias**2 + TRUE.std**2 * (w[:, None] * w[None] * far).sum() / span**2
    assert error_law.correlation(TRUE, lag, span) == pytest.approx(cross, rel=1e-9)


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


def test_clustered_errors_are_the_sum_over_pairs_that_share_a_cluster():
    rng = np.random.default_rng(6)
    who, when = rng.integers(0, 7, 60), rng.integers(0, 11, 60)
    x = rng.normal(0, 1, 60) + rng.normal(0, 1, 7)[who] + rng.normal(0, 1.5, 11)[when]
    e = x - x.mean()
    both = {(a, b) for a, b in zip(who.tolist(), when.tolist(), strict=True)}

    def pairs(same, groups):
        return (
            sum(e[i] * e[j] for i in range(60) for j in range(60) if same(i, j))
            * groups
            / (groups - 1)
            / 60**2
        )

    drifter = pairs(lambda i, j: who[i] == who[j], 7)
    day = pairs(lambda i, j: when[i] == when[j], 11)
    crossed = pairs(lambda i, j: who[i] == who[j] and when[i] == when[j], len(both))
    found = clusters.mean(x, who, when)
    assert found.error**2 == pytest.approx(max(drifter, day, drifter + day - crossed), rel=1e-9)
    assert (found.drifters, found.days, found.count) == (7, 11, 60)
    alone = clusters.mean(x, np.zeros(60), when)
    assert alone.error**2 == pytest.approx(day, rel=1e-9)
    sure = clusters.mean(np.ones(20), who[:20], when[:20], share=True)
    assert sure.error == pytest.approx(math.sqrt(21 / 22 * (1 / 22) / 20), rel=1e-9)


def test_halves_share_no_way():
    tracks = ways(simulated(np.random.default_rng(12), 1, 10.0))
    halves = hold_out.split_halves(tracks)
    spans = [{(float(t), float(s)) for t, s, f in zip(w.time, w.step, w.fresh, strict=True) if not f} for w in (*halves.fitted, *halves.held)]  # fmt: skip
    assert not spans[0] & spans[1]
    assert all(spans)
    # none leads over days that were held out
    assert all(max(step for _, step in span) <= 3 * 3600 for span in spans)


def test_quadrature_is_exact_for_cubics_but_for_whole_seconds():
    time = np.array([0.0, 5000.0, 12_000.0])
    at, weight, owner = along_track.quadrature_points(time)
    for k in (1, 2):
        found = (weight[owner == k] * at[owner == k] ** 3).sum()
        exact = (time[k] ** 4 - time[k - 1] ** 4) / 4
        # half a second of each point
        assert abs(found - exact) < 0.5 * 3 * time[k] ** 2 * (time[k] - time[k - 1])


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
    file = tmp_path / "case.toml"
    names = 'variables = { east = "ue", north = "vn" }'
    file.write_text(
        'start = "2021-05-01T00:00Z"\nduration = "6 h"\n'
        f'[[current]]\nname = "c"\ndataset = "c"\nfill = 0\n{names}\n[[wind]]\nname = "w"\ndataset = "w"\n{names}\n'
        '[[scenario]]\nname = "b"\nobject = { windage = "2 %" }\nposition = { at = [5, 60], error = "1 nmi" }\n'
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
        drift.load(file), [Track("b", time, lon, lat), gone, north], {}, 3 * 3600.0, 3.0, sets
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


@pytest.mark.thorough
def test_the_command_prints_an_uncertainty_to_paste(tmp_path, capsys):
    rows = ["buoy;time;lat;lon;u;v;a;b"]
    for track in simulated(
        np.random.default_rng(40), 3, 0.9, Law(0.2, 3 * 3600.0, 0.2, 30.0, 90.0)
    ):
        columns = (track.lat, track.lon, *(track.columns[name] for name in "uvab"))
        rows += [f"{track.name};{np.datetime64(round(t * 1000), 'ms')}Z;{';'.join(map(repr, map(float, row)))}"
                 for t, row in zip(track.time, zip(*columns, strict=True), strict=True)]  # fmt: skip
    (tmp_path / "buoys.csv").write_text("\n".join(rows))
    (tmp_path / "case.toml").write_text(
        'start = "2021-03-01T00:00Z"\nduration = "6 h"\ncurrent = [{ constant = { east = 0, north = 0 } }]\n'
        '[[scenario]]\nname = "b"\nobject = "water"\nposition = { at = [-6, 47], error = "1 nmi" }\n'
    )
    given = ["fit-errors", str(tmp_path / "case.toml"), "--drifters", str(tmp_path / "buoys.csv")]
    columns = "current_east=u,current_north=v,wind_east=a,wind_north=b"
    assert commands.main([*given, "--columns", columns]) == 0
    said = capsys.readouterr().out
    made = drift.fit_errors(
        drift.load(tmp_path / "case.toml"), tmp_path / "buoys.csv", columns=COLUMNS
    )
    table = said[said.index("[uncertainty]") :]
    pasted = tomllib.loads(table)["uncertainty"]
    assert units.quantity(pasted["current"]["std"], "m/s", "", "") == pytest.approx(
        made.law.std, abs=5e-4
    )
    assert units.quantity(pasted["current"]["time"], "s", "", "") == pytest.approx(
        made.law.time, abs=180
    )
    assert units.quantity(pasted["current"]["bias"], "m/s", "", "") == pytest.approx(
        made.standing_bias, abs=5e-4
    )
    assert units.quantity(pasted["diffusivity"], "m^2/s", "", "") == pytest.approx(
        made.law.diffusivity, rel=0.05, abs=0.05
    )
    assert f'object = {{ windage = "{100 * made.windage:.2f} %" }}' in table
    # the mean's square, less its error's, joins the square of the bias: what a drifter's bias is
    # where the mean is left in
    square = made.law.bias**2 + (np.square(made.mean).sum() - np.square(made.mean_error).sum()) / 2
    assert made.standing_bias == pytest.approx(math.sqrt(max(square, made.law.bias**2)))
    drift.vary(drift.load(tmp_path / "case.toml"), {"uncertainty": pasted})
    for wrong, words in (
        (["--max-gap", "9 min"], "no two fixes at most 0.15 h apart"),
        (["--max-gap", "-1 h"], "--max-gap"),
        (["--columns", "current_east=q,current_north=v"], 'no column "q"'),
        (["--max-speed", "3 h"], "--max-speed"),
    ):
        assert commands.main([*given, *wrong]) == 2
        assert words in capsys.readouterr().err
