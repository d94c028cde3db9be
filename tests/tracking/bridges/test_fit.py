"""K from tracks: both likelihoods against dense normal laws, estimates and standard errors against
simulated tracks.
"""

import csv
import itertools
import math
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from scipy import linalg, stats

from drift.apps.cli import grammar
from drift.case.tracking import reading
from drift.tracking.bridges import fit, neighbours, stretches, text, together
from drift.tracking.bridges.stretches import Rules, Stretch
from drift.tracking.tracks.records import Track
from geo import sphere
from geo.box import Box
from geo.errors import UserError

NMI, KNOT, HOUR = 1852.0, 1852.0 / 3600, 3600.0
RADIUS = 6_371_008.8  # [m]
K = 2.3 * NMI / 60  # [m/sqrt(s)] of the simulated tracks
WAY = (5.1, -3.7)  # [m/s] east and north, of those that go somewhere


def simulated(
    rng, fixes, *, k=K, error=0.0, way=WAY, name="ship", begin=(7.3, 54.2), steps=(0.6, 1.7)
):
    """A track of Brownian motion with a mean velocity in a plane, laid on the Earth about its
    beginning; steps: hours.
    """
    time = np.concatenate([[0.0], np.cumsum(rng.uniform(*steps, fixes - 1))]) * HOUR
    moved = rng.normal(0, k, (fixes - 1, 2)) * np.sqrt(np.diff(time))[:, None]
    place = np.concatenate([np.zeros((1, 2)), np.cumsum(moved, axis=0)]) + np.outer(time, way)
    place = place - place[fixes // 2] + rng.normal(0, error, place.shape)
    lon, lat = sphere.destination(*np.radians(begin), *place.T)
    return Track(name, 1.6e9 + time, np.degrees(lon), np.degrees(lat))


def stretch_of(track):
    return Stretch(track.name, track.time, np.radians(track.lon), np.radians(track.lat))


@pytest.mark.parametrize(("k", "error"), [(K, 0.0), (K, 900.0), (0.0, 400.0), (0.3 * K, 1e4)])
def test_likelihood_of_neighbours_is_that_of_independent_normals(k: float, error: float) -> None:
    """Written out in a plane, whose places are right to 1e-5 here (r^2/6 at 40 km); fixes 2, 4, ..
    against those beside them.
    """
    track = simulated(np.random.default_rng(3), 12, way=(1.1, -0.7))
    lon, lat = np.radians(track.lon), np.radians(track.lat)
    place = np.stack(sphere.offset(lon[6], lat[6], lon, lat), -1)
    expected = 0.0
    for i in (1, 3, 5, 7, 9):
        whole = track.time[i + 1] - track.time[i - 1]
        s = (track.time[i] - track.time[i - 1]) / whole
        away = place[i] - (1 - s) * place[i - 1] - s * place[i + 1]
        variance = k**2 * whole * s * (1 - s) + error**2 * (1 + (1 - s) ** 2 + s**2)
        expected += stats.norm(0, math.sqrt(variance)).logpdf(away).sum()
    made = neighbours.triples([stretch_of(track)])
    assert made.time == pytest.approx(track.time[1:11:2])
    if k > 0 or error > 0:
        assert neighbours.log_likelihood(made, k, error).sum() == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize(("k", "error"), [(K, 0.0), (K, 900.0), (0.1 * K, 3e3), (2 * K, 40.0)])
def test_likelihood_of_whole_stretches_is_that_of_a_dense_normal_law(
    k: float, error: float
) -> None:
    """Covariance from its definition, k^2 dt and the differences of errors; the mean velocity by
    contrasts that know none.
    """
    rng = np.random.default_rng(6)
    tracks = [
        simulated(rng, n, error=500.0, name=name) for n, name in ((7, "a"), (11, "b"), (3, "b"))
    ]
    made = together.steps([stretch_of(track) for track in tracks])
    free, still = np.zeros(2), np.zeros(2)
    for track, name in zip(tracks, (0, 1, 1), strict=True):
        lon, lat = np.radians(track.lon), np.radians(track.lat)
        middle = lon.size // 2
        place = np.stack(sphere.offset(lon[middle], lat[middle], lon, lat), -1)
        differences = np.diff(np.eye(lon.size), axis=0)
        step = np.diff(track.time)
        covariance = k**2 * np.diag(step) + error**2 * differences @ differences.T
        moved = differences @ place
        free[name] += sum(
            stats.multivariate_normal(np.zeros(step.size), covariance).logpdf(moved[:, c])
            for c in (0, 1)
        )
        contrasts = linalg.null_space(step[None]).T
        law = stats.multivariate_normal(
            np.zeros(step.size - 1), contrasts @ covariance @ contrasts.T
        )
        still[name] += sum(
            law.logpdf(contrasts @ moved[:, c]) - 0.5 * math.log(step @ step) for c in (0, 1)
        )
    assert together.wandering(made, k, error) == pytest.approx(free, rel=1e-9)
    assert together.steady(made, k, error) == pytest.approx(still, rel=1e-9)


def test_without_errors_the_best_is_a_mean_square() -> None:
    """K^2 is the mean of squares over their variances for K = 1, of 2 n components; its standard
    error K / (2 sqrt(n)).
    """
    track = simulated(np.random.default_rng(14), 41)
    found = fit.fit([track], error=0.0)
    made = neighbours.triples([stretch_of(track)])
    assert found.spread_rate == pytest.approx(
        math.sqrt((made.away**2 / made.unit).mean()), rel=1e-6
    )
    assert found.count == 20
    assert found.curvature == pytest.approx(found.spread_rate / (2 * math.sqrt(20)), rel=1e-3)
    assert found.spread_error == found.curvature  # one track tells no spread between tracks


@pytest.mark.parametrize(
    ("method", "error", "way", "comparisons"),
    [
        ("neighbours", 600.0, WAY, 30),
        ("steady", 600.0, WAY, 59),
        ("wandering", 600.0, (0.0, 0.0), 60),
    ],
)
def test_estimates_of_simulated_tracks(
    method: str, error: float, way: tuple[float, float], comparisons: int
) -> None:
    """Over 150 tracks: mean of K within three standard errors and the bias of maximum likelihood,
    coverage of 2 standard errors.

    K^2 is unbiased, so that K is low by the share 1 / (8 n) with n comparisons of two components,
    and with errors of fixes by at most four times that. 95.4 % within two standard errors: less the
    skewness of K at n = 30, some 2 %.
    """
    rng = np.random.default_rng([2, comparisons])
    found = [
        fit.fit(
            [simulated(rng, 61, error=error, way=way)],
            method=method,
            error=error,
            rules=Rules(fastest=60 * KNOT),
        )
        for _ in range(150)
    ]
    rates = np.array([one.spread_rate for one in found])
    errors = np.array([one.spread_error for one in found])
    assert {one.count for one in found} == {comparisons}
    assert rates.mean() == pytest.approx(
        K, abs=3 * rates.std() / math.sqrt(150) + K / (2 * comparisons)
    )
    assert errors.mean() == pytest.approx(rates.std(), rel=3 / math.sqrt(300) + 0.05)
    held = (np.abs(rates - K) < 2 * errors).mean()
    assert held == pytest.approx(0.954, abs=3 * math.sqrt(0.954 * 0.046 / 150) + 0.02)


def test_errors_of_the_fixes_are_fitted_too() -> None:
    """Of 12 tracks that share a K and an error: both within three of their own standard errors;

    K is too large without it.
    """
    rng = np.random.default_rng(31)
    tracks = [
        simulated(rng, 50, error=2000.0, name=f"{k}", begin=(7.0 + k, 50.0)) for k in range(12)
    ]
    found = fit.fit(tracks, method="steady", error=None)
    assert abs(found.spread_rate - K) < 3 * found.curvature
    assert abs(found.error - 2000) < 3 * found.error_error
    assert found.error_error < 400  # it is told
    assert found.clustered / found.curvature == pytest.approx(
        1, abs=3 / math.sqrt(2 * 11) + 0.1
    )  # the tracks are alike
    assert found.spread_error == max(found.curvature, found.clustered)
    assert fit.fit(tracks, method="steady", error=0.0).spread_rate > K + 3 * found.curvature


def test_wandering_takes_a_mean_velocity_for_spread() -> None:
    """What steams at 12 kn for an hour a step has moved 12 nmi a step:

    K^2 grows by the square of the speed times the step, over 2.
    """
    track = simulated(np.random.default_rng(77), 200, steps=(1.0, 1.001))
    found = fit.fit([track], method="wandering").spread_rate
    expected = math.sqrt(K**2 + (WAY[0] ** 2 + WAY[1] ** 2) / 2 * HOUR)
    assert found == pytest.approx(expected, rel=3 / math.sqrt(400))
    assert fit.fit([track], method="steady").spread_rate == pytest.approx(
        K, rel=3 / math.sqrt(800) * 1.5
    )


def test_areas_hold_what_they_say_of_simulated_tracks() -> None:
    """Half of 40 tracks fitted; of the other half 50 and 90 % within three standard errors, the
    error of K included.
    """
    rng = np.random.default_rng(19)
    tracks = [
        simulated(rng, 41, error=300.0, name=f"{k}", begin=(3.0 + k, 50.0)) for k in range(40)
    ]
    found = fit.fit(tracks, error=300.0, held_out=True)
    assert [(half.tracks, half.count) for half in found.held.halves] == [(20, 400), (20, 400)]
    for half in found.held.halves:
        assert abs(half.spread_rate - K) < 3 * half.spread_error
    for coverage, share in zip(found.held.coverage, (0.5, 0.9), strict=True):
        assert (coverage.first.count, coverage.both.count) == (400, 800)
        assert coverage.both.drifters == 40
        assert coverage.both.mean == pytest.approx((coverage.first.mean + coverage.second.mean) / 2)
        assert coverage.both.mean == pytest.approx(
            share, abs=3 * math.hypot(coverage.both.error, 0.01)
        )


def test_halves_are_of_every_other_track_by_their_first_fixes() -> None:
    """The second and fourth stray twice as far: each half is fitted to its own, and judged by the
    other.
    """
    rng = np.random.default_rng(15)
    tracks = []
    for number, k in enumerate((K, 2 * K, K, 2 * K)):
        track = simulated(rng, 301, k=k, name=f"{number}", begin=(3.0, 50.0))
        tracks.append(Track(track.name, track.time + 60.0 * number, track.lon, track.lat))
    found = fit.fit([tracks[2], tracks[1], tracks[3], tracks[0]], error=0.0, held_out=True)
    first, second = found.held.halves
    assert first.spread_rate == pytest.approx(K, rel=3 / (2 * math.sqrt(300)))
    assert second.spread_rate == pytest.approx(2 * K, rel=3 / (2 * math.sqrt(300)))
    # an area by half the K, and by twice it, where 90 % are stated
    low, high = 1 - 0.1**0.25, 1 - 0.1**4
    assert found.held.coverage[1].first.mean == pytest.approx(
        low, abs=3 * math.sqrt(low / 300) + 0.05
    )
    assert found.held.coverage[1].second.mean == pytest.approx(high, abs=0.02)


def test_tracks_that_differ_have_a_larger_standard_error() -> None:
    """Half of them stray three times as far: the curvature knows nothing of it."""
    rng = np.random.default_rng(4)
    tracks = [
        simulated(rng, 61, k=K * (1 + 2 * (k % 2)), name=f"{k}", begin=(3.0 + k, 50.0))
        for k in range(16)
    ]
    found = fit.fit(tracks)
    assert found.clustered > 3 * found.curvature
    assert found.spread_error == found.clustered


def fixes(hours, east_nmi, name="a"):
    """A track along the equator."""
    return Track(
        name,
        np.array(hours) * HOUR,
        np.degrees(np.array(east_nmi) * NMI / RADIUS),
        np.zeros(len(hours)),
    )


def test_a_stretch_ends_at_a_gap_at_anchor_and_at_a_box() -> None:
    hours = [0, 1, 2, 3, 10, 11, 12, 13, 14, 15]
    east = [0, 9, 18, 27, 60, 69, 69.5, 78, 87, 96]
    found = stretches.cut_tracks([fixes(hours, east)], Rules(gap=4 * HOUR, slowest=5 * KNOT))
    assert [one.time.tolist() for one in found.stretches] == [
        [h * HOUR for h in part] for part in ([0, 1, 2, 3], [10, 11], [12, 13, 14, 15])
    ]
    assert found.notes == ("1 step left out of more than 4 h", "1 step left out of 5 kn or less")
    west, east_edge = math.degrees(8 * NMI / RADIUS), math.degrees(10 * NMI / RADIUS)
    boxed = stretches.cut_tracks(
        [fixes(hours, east)], Rules(without=Box(west, -1.0, east_edge, 1.0))
    )
    assert [one.time.size for one in boxed.stretches] == [8]  # the fix before the box is alone
    assert "1 fix left out in the box that was named" in boxed.notes


def test_a_box_across_the_antimeridian() -> None:
    track = Track(
        "a",
        np.arange(6) * HOUR,
        np.array([179.0, 179.4, 179.8, -179.8, -179.4, -179.0]),
        np.full(6, 5.0),
    )
    found = stretches.cut_tracks([track], Rules(without=Box(179.7, 0.0, 180.3, 9.0)))
    assert [np.degrees(one.lon).round(6).tolist() for one in found.stretches] == [
        [179.0, 179.4],
        [-179.4, -179.0],
    ]


def test_an_interval_that_is_lost_in_rounding_keeps_all_fixes() -> None:
    assert stretches._thinned(np.array([1.6e9, 1.6e9 + 60, 1.6e9 + 90]), 1e-297).tolist() == [
        0,
        1,
        2,
    ]


def test_thinning_takes_the_fix_nearest_to_the_interval() -> None:
    hours = [0, 0.5, 2.4, 3.2, 5.9, 6.3, 6.4, 9.1, 9.2, 16.0, 19.1]
    found = stretches.cut_tracks([fixes(hours, [9 * h for h in hours])], Rules(every=3 * HOUR))
    assert [one.time / HOUR for one in found.stretches] == [
        pytest.approx([0, 3.2, 6.3, 9.2]),  # 3.2 h is nearer to 3 h than 2.4 h; 6.3 to 6.2
        pytest.approx([16.0, 19.1]),  # after 6.8 h of silence
    ]


@pytest.mark.parametrize(
    ("tracks", "options", "words"),
    [
        ([fixes([0], [0])], {}, "no step from fix to fix is left; 1 track left out with fewer than two fixes"),
        ([fixes([0, 1], [0, 9])], {}, "0 comparisons of a fix with those beside it: too few .* each of three consecutive .* 2 fixes in 1 stretch"),
        ([fixes(range(20), range(0, 180, 9))], {"rules": Rules(slowest=20 * KNOT)}, "no step .* 20 kn or less"),
        ([fixes(range(20), range(0, 180, 9))], {}, "no track leaves the straight line"),
        ([fixes(range(20), range(0, 180, 9))], {"method": "steady"}, "no track leaves the straight line"),
        ([fixes(range(20), range(0, 180, 9))], {"method": "horne"}, 'by "horne" is not known; choose from neighbours'),
        ([fixes(range(20), range(0, 180, 9))], {"error": -3.0}, "error = -3.0 must be from 0"),
        ([fixes(range(20), range(0, 180, 9))], {"error": 1e9}, "error = 1000000000.0 must be from 0"),
        ([simulated(np.random.default_rng(1), 30)], {"error": 2e7}, "explains all of their deviation"),
        ([simulated(np.random.default_rng(1), 30)], {"error": 2e7, "method": "steady"}, "explains all of their deviation"),
        ([simulated(np.random.default_rng(1), 30)], {"error": 2e7, "method": "wandering"}, "explains all of their deviation"),
        ([simulated(np.random.default_rng(1), 30)], {"error": 5e4}, "explains all of their deviation"),
        ([simulated(np.random.default_rng(1), 30)], {"held_out": True}, "none can be held out"),
    ],
)  # fmt: skip
def test_what_cannot_be_fitted_is_refused(
    tracks: list[Track], options: dict[str, object], words: str
) -> None:
    with pytest.raises(UserError, match=words) as refusal:
        fit.fit(tracks, **options)
    assert len(refusal.value.lines) == 1


def test_a_fit_in_words_and_as_a_line_of_a_case() -> None:
    import tomllib

    from drift.case.values import units

    found = fit.fit([simulated(np.random.default_rng(14), 41)], error=0.0)
    written = tomllib.loads(text.toml(found))
    # three digits
    assert units.spread_rate(written["k"]) == pytest.approx(found.spread_rate, rel=5e-3)
    facts = text.fitted(found)
    assert facts["spread rate K"].startswith(written["k"].split()[0])
    assert "20 comparisons in 1 stretch;" in facts["tracks"]


@pytest.mark.thorough
def test_real_ships(data: Path) -> None:
    """Ships about the Suez Canal every 3 h at over 5 kn, beside a plain computation in a plane: the
    same triples, K within 0.3 %.
    """
    path = data / "ships" / "suez_ships.csv"
    if not path.exists():
        pytest.skip(f"no {path}")
    rules = Rules(every=3 * HOUR, slowest=5 * KNOT)
    found = fit.fit(reading.read_drifters(path), error=0.0, rules=rules)
    ships = defaultdict(dict)
    with path.open() as file:
        for row in csv.DictReader(file):
            seconds = np.datetime64(row["time"].rstrip("Z"), "s").astype(int)
            ships[row["ship"]].setdefault(int(seconds), (float(row["lon"]), float(row["lat"])))
    squares = []
    for ship in ships.values():
        time = np.array(sorted(ship))
        lon, lat = np.radians([ship[t] for t in time]).T
        place = RADIUS * np.column_stack([lon * np.cos(np.radians(30.7)), lat])
        run = []
        kept, last = [0], 0
        while True:  # from each fix the one nearest to 3 h later
            later = [j for j in range(last + 1, time.size) if time[j] - time[last] >= 1.5 * HOUR]
            if not later:
                break
            last = min(later, key=lambda j: (abs(time[j] - time[last] - 3 * HOUR), j))
            kept.append(last)
        runs = [[kept[0]]]
        for i, j in itertools.pairwise(kept):
            quick = np.linalg.norm(place[j] - place[i]) > 5 * KNOT * (time[j] - time[i])
            if time[j] - time[i] <= 4.5 * HOUR and quick:
                runs[-1].append(j)
            else:
                runs.append([j])
        for run in runs:
            for a, b, c in zip(run[0::2], run[1::2], run[2::2], strict=False):
                s = (time[b] - time[a]) / (time[c] - time[a])
                away = place[b] - (1 - s) * place[a] - s * place[c]
                squares.append((away**2).sum() / (2 * s * (1 - s) * (time[c] - time[a])))
    # the plane's speeds differ a little from the sphere's
    assert found.count == pytest.approx(len(squares), abs=2)
    assert found.spread_rate == pytest.approx(math.sqrt(np.mean(squares)), rel=0.01)


def test_the_grammar_knows_every_method() -> None:
    """It repeats their names, because it imports nothing heavy."""
    command = grammar.parser()._subparsers._group_actions[0].choices["fit-bridge"]
    (by,) = (action for action in command._actions if action.dest == "by")
    assert tuple(by.choices) == tuple(fit.METHODS)
