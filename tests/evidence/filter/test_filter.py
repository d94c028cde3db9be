"""The particle filter against exact Bayes on a grid, a Kalman filter, and plain brute force."""

import dataclasses
import hashlib
import itertools
import math

import numpy as np
import pytest
import spills
from scipy import stats

from drift.case import file as case_file
from drift.engine.motion import leeway, simulate
from drift.engine.motion.drift import COLUMNS
from drift.engine.motion.forcing_error import ForcingError
from drift.engine.particles import ensemble as record
from drift.engine.particles import resample
from drift.engine.particles.status import Status
from drift.evidence.filter.debris import debris
from drift.evidence.filter.detection import sensor_path
from drift.evidence.filter.filter import SearchFilter
from drift.evidence.filter.meeting import Resampled
from drift.evidence.filter.records import (
    Barrier,
    Contact,
    Field,
    Fix,
    Law,
    Line,
    Look,
    Presence,
    Resampling,
    Sensors,
    Sight,
    Sortie,
    Watch,
)
from drift.forecast import effective
from drift.pipeline import run_setup
from geo import sphere
from geo.errors import UserError
from geo.polyline import Area, Legs
from kernels.evidence import sweep
from kernels.runtime import runtime
from kernels.steering import pieces

NMI = 1852.0
METRES = sphere.RADIUS * np.pi / 180  # [m] per degree of latitude
STILL = """
start = "2026-11-21T00:00Z"
duration = "6 h"
particles = 1000
[clock]
step = "30 min"
[coast]
source = "none"
[[current]]
constant = { speed = "0 kn", toward = 0 }
"""
BOX = """
[[scenario]]
name = "box"
object = "water"
[scenario.area]
polygon = [[179.84, -0.2], [-179.84, -0.2], [-179.84, 0.2], [179.84, 0.2]]
"""
NORMAL = """
[uncertainty]
diffusivity = "{d} m2/s"
[[scenario]]
name = "normal"
object = "water"
[scenario.position]
at = [-179.99, 30.0]
std = ["4000 m", "2500 m"]
orientation = 30
"""


def load(tmp_path, text, **changes):
    """Return a case of a text, with fields replaced."""
    path = tmp_path / "case.toml"
    path.write_text(text)
    return dataclasses.replace(case_file.load(path), **changes)


def filter_of(case, begin):
    """Return a case's filter, also of a case in which nothing was searched or seen."""
    spec = run_setup.ensemble_spec(case)
    return SearchFilter(
        spec,
        case.sorties,
        case.contacts,
        case.resampling,
        begin.ensemble,
        begin.scene,
        case.sensors,
    )


def run(case, outputs=()):
    """Run a case's filter and return it, its ensemble at the end, and the moments at output times
    [s].
    """
    runtime.start()
    where = run_setup.open_for(case)
    begin = run_setup.prepare(case, where)
    search = filter_of(case, begin)
    moments = list(
        simulate.run(begin.ensemble, begin.scene, begin.clock, np.array(outputs), search=search)
    )
    begin.scene.forcing.close()
    return search, begin.ensemble, moments


def hours(h):
    """Return a time after the cases' start."""
    return np.datetime64("2026-11-21T00:00:00") + np.timedelta64(round(3600 * h), "s")


def seconds(h):
    """Return it in seconds since 1970."""
    return float(hours(h).astype("datetime64[s]").astype(np.int64))


def weights(ensemble):
    """Return normalised weights."""
    w = np.exp(ensemble.log_weight.to_numpy().astype(np.float64))
    return w / w.sum()


def offsets(ensemble, lon, lat):
    """Return particles' places [m] east and north of a position [deg]."""
    x, y = (column.to_numpy() * sphere.UNIT for column in (ensemble.lon, ensemble.lat))
    return sphere.offset(math.radians(lon), math.radians(lat), x, y)


# Exact Bayes: a 64 x 64 grid of cells across the antimeridian, nothing moves.

CELLS = 64
WEST, SOUTH, WIDE, HIGH = 179.84, -0.2, 0.32, 0.4


def _target():
    """Return twelve sorties on whole cells and three contacts, and the exact posterior of cells
    with its log evidence.

    The contact that may be false comes last: its belief is about what is known then.
    """
    random = np.random.default_rng(5)
    laws = [Law("random"), Law("inverse_cube"), Law("definite_range"), Law("m_beta", 0.8)]
    sorties, exact = [], np.full((CELLS, CELLS), 1 / CELLS**2)  # (lat, lon)
    for k in range(12):
        i, j = np.sort(random.choice(CELLS + 1, (2, 2), replace=False), axis=1)
        law, coverage = laws[k % 4], float(random.uniform(0.2, 1.2))
        # b(C) of each law, written out
        pod = [
            1 - math.exp(-coverage),
            math.erf(math.sqrt(math.pi) / 2 * coverage),
            min(coverage, 1.0),
            1
            - 0.2 ** math.floor(coverage / 0.8)
            * (1 - 0.8 * (coverage / 0.8 - math.floor(coverage / 0.8))),
        ][k % 4]
        lon = WEST + WIDE / CELLS * np.array([j[0], j[1], j[1], j[0]])
        lat = SOUTH + HIGH / CELLS * np.array([i[0], i[0], i[1], i[1]])
        exact[i[0] : i[1], j[0] : j[1]] *= 1 - pod
        begin = 0.3 * k
        sorties.append(
            Sortie(f"s{k}", "", hours(begin), hours(begin + 1.1), law, (1.0,), area=Area(tuple(lon), tuple(lat)), coverage=(coverage,))
        )  # fmt: skip
    contacts = []
    fine = 16  # midpoints across a cell
    y = SOUTH + HIGH * (np.arange(CELLS * fine) + 0.5) / (CELLS * fine)
    x = WEST + WIDE * (np.arange(CELLS * fine) + 0.5) / (CELLS * fine)
    told = [
        (180.02, 0.03, 9000.0, 1.0, 0.0),
        (180.07, 0.11, 5000.0, 1.0, 4e-9),
        (179.95, -0.05, 6000.0, 0.6, 0.0),
    ]
    for k, (lon, lat, std, belief, false) in enumerate(told):
        fixes = (Fix(lon, lat),)
        contacts.append(
            Contact(
                f"c{k}",
                hours(2 + 1.5 * k),
                "position",
                belief,
                fixes=fixes,
                major=std,
                minor=std,
                false_density=false,
            )
        )
        east, north = (x - lon) * METRES, (y - lat) * METRES  # at the equator, to 1e-5
        density = stats.norm.pdf(north[:, None], scale=std) * stats.norm.pdf(
            east[None, :], scale=std
        )
        density = density.reshape(CELLS, fine, CELLS, fine).mean(axis=(1, 3)) + false
        # within a cell the product of both contacts is not that of their means: 1e-3 of it at this
        # size
        exact_before = exact.copy()
        if belief < 1:
            mean = (exact * density).sum() / exact.sum()
            density = belief * density + (1 - belief) * mean
        exact = exact_before * density
    return sorties, contacts, exact / exact.sum(), math.log(exact.sum())


@pytest.mark.parametrize("n", [10_000, 160_000])
def test_exact_bayes(tmp_path, n):
    """Total variation from the exact posterior falls as 1/sqrt(N), and so does the error of the
    evidence.
    """
    sorties, contacts, exact, evidence = _target()
    case = load(
        tmp_path, STILL + BOX, sorties=tuple(sorties), contacts=tuple(contacts), particles=n
    )
    search, ensemble, _ = run(case)
    w = weights(ensemble)
    lon = (
        (ensemble.lon.to_numpy().astype(np.int64) - int(sphere.to_binary(WEST)))
        % 2**32
        * (360 / 2**32)
    )
    lat = sphere.to_degrees(ensemble.lat.to_numpy())
    j, i = (lon / WIDE * CELLS).astype(int), ((lat - SOUTH) / HIGH * CELLS).astype(int)
    found = np.zeros((CELLS + 1, CELLS + 1))
    np.add.at(found, (i, j), w)
    variation = (
        0.5 * np.abs(found[:CELLS, :CELLS] - exact).sum()
        + 0.5 * found.sum()
        - 0.5 * found[:CELLS, :CELLS].sum()
    )
    # A cell's weight is a mean of n numbers: its mean absolute deviation is sqrt(2 / pi) standard
    # deviations.
    posterior_over_prior = exact * CELLS**2
    expected = 0.5 * math.sqrt(2 / math.pi) * np.sqrt(exact * posterior_over_prior / n).sum()
    assert variation == pytest.approx(expected, rel=0.1)
    relative = math.sqrt((exact * posterior_over_prior).sum() / n)
    assert abs(search.updates.log_evidence - evidence) < 4 * relative
    print(
        f"n {n}: total variation {variation:.5f}, theory {expected:.5f}; log evidence {search.updates.log_evidence:.5f}, exact {evidence:.5f}"
    )


def test_sorties_together_find_what_their_failures_leave_out(tmp_path):
    """Cumulative POS is 1 less the chance that all fail: areas that overlap, so that neither sums
    nor products of others do.
    """
    lon = WEST + WIDE * np.array(
        [[0.0, 0.5, 0.5, 0.0], [0.25, 0.75, 0.75, 0.25], [0.0, 1.0, 1.0, 0.0]]
    )
    lat = SOUTH + HIGH * np.array([0.0, 0.0, 1.0, 1.0])
    coverage = (0.9, 1.3, 0.4)
    sorties = tuple(
        Sortie(f"s{k}", "", hours(k), hours(k + 1.1), Law("random"), (1.0,), area=Area(tuple(lon[k]), tuple(lat)), coverage=(c,))
        for k, c in enumerate(coverage)
    )  # fmt: skip
    n = 40_000
    search, _, _ = run(load(tmp_path, STILL + BOX, sorties=sorties, particles=n))
    a, b, c = coverage
    quarters = np.array([a, a + b, b, 0.0]) + c
    missed = np.exp(-quarters).mean()
    error = np.sqrt(np.var(np.exp(-quarters)) / n)
    assert abs(search.updates.all[-1].cumulative[-1] - (1 - missed)) < 4 * error
    middle = np.exp(-np.array([a, a + b, b, 0.0]))
    assert abs(search.updates.all[1].cumulative[-1] - (1 - middle.mean())) < 4 * np.sqrt(
        np.var(middle) / n
    )


def test_weights_as_if_no_sortie_had_been_flown_hold_what_was_seen(tmp_path):
    """They are those of the same run without its sorties: by them it is told what ran out of the
    domain.
    """
    fix = Contact(
        "seen",
        hours(1.5),
        "position",
        fixes=(Fix(180.03, 60.01),),
        major=5000.0,
        minor=3000.0,
        orientation=0.7,
    )
    track = legs([(-4000, -2000), (4000, -2000), (4000, 2000), (-4000, 2000)], 1.7, 10.0)
    case = load(tmp_path, FLOW, contacts=(fix,))
    seen, both = (
        run(dataclasses.replace(case, sorties=s))[:2]
        for s in ((), (flown("square", track, Law(), 900.0),))
    )
    expected = seen[1].log_weight.to_numpy().astype(np.float64)
    found = both[0].unsearched.whole("unsearched")
    np.testing.assert_allclose(found - found.max(), expected - expected.max(), atol=1e-5)
    assert np.ptp(expected) > 1
    assert np.ptp(both[1].log_weight.to_numpy() - expected) > 0.5


def test_what_has_left_cannot_be_seen(tmp_path):
    """Beyond the domain nobody knows where it is: such a particle can be no contact; one that
    leaves later can.
    """
    text = FLOW.replace('until = "+1 h"', "").replace(
        "[coast]", "[domain]\nwest = 179.8\nsouth = 59.9\neast = -179.9\nnorth = 60.2\n[coast]"
    )
    fix = Contact(
        "seen", hours(1.5), "position", fixes=(Fix(180.0, 60.0),), major=8000.0, minor=8000.0
    )
    _, ensemble, _ = run(load(tmp_path, "max_lost = 1" + text, contacts=(fix,)))
    left = ensemble.status.to_numpy() == Status.LEFT
    before = left & (ensemble.status_since.to_numpy() <= 1.5 * 3600)
    assert before.sum() > 20
    assert (left & ~before).sum() > 20
    np.testing.assert_array_equal(np.isneginf(ensemble.log_weight.to_numpy()), before)


# A Kalman filter: a normal prior, a random walk, three fixes with error.


@pytest.mark.parametrize("method", ["systematic", "kahn", None])
def test_kalman(tmp_path, method):
    """Mean, covariance and evidence agree with the Kalman filter, with and without resampling."""
    d = 60.0  # [m2/s] so that the walk over 5 h, 1.5 km a component, counts beside the prior
    fixes = [
        (1.0, (2500.0, 1500.0), 2500.0),
        (2.6, (5000.0, -500.0), 2000.0),
        (5.0, (6000.0, 3000.0), 3000.0),
    ]
    lon0, lat0 = -179.99, 30.0
    contacts = []
    for k, (when, (east, north), std) in enumerate(fixes):
        lon, lat = sphere.destination(math.radians(lon0), math.radians(lat0), east, north)
        fix = Fix(float(np.degrees(lon)), float(np.degrees(lat)))
        contacts.append(
            Contact(f"fix {k}", hours(when), "position", fixes=(fix,), major=std, minor=std)
        )
    resampling = Resampling(method, 0.9) if method else Resampling()
    n = 200_000
    case = load(
        tmp_path,
        STILL + NORMAL.format(d=d),
        contacts=tuple(contacts),
        particles=n,
        resampling=resampling,
    )
    search, ensemble, _ = run(case)

    turn = math.radians(30)
    # (axis, east and north)
    axes = np.array([[math.sin(turn), math.cos(turn)], [math.cos(turn), -math.sin(turn)]])
    mean, cov, evidence, last = (
        np.zeros(2),
        axes.T @ np.diag([4000.0**2, 2500.0**2]) @ axes,
        0.0,
        0.0,
    )
    for when, z, std in fixes:
        cov = cov + 2 * d * 3600 * (when - last) * np.eye(2)
        total = cov + std**2 * np.eye(2)
        evidence += stats.multivariate_normal.logpdf(z, mean, total)
        gain = cov @ np.linalg.inv(total)
        mean, cov, last = mean + gain @ (np.array(z) - mean), cov - gain @ cov, when
    cov = cov + 2 * d * 3600 * (6.0 - last) * np.eye(2)

    w = weights(ensemble)
    at = np.stack(offsets(ensemble, lon0, lat0))
    found = at @ w
    spread = (w * (at - found[:, None])) @ (at - found[:, None]).T
    effective = min(update.ess_after for update in search.updates.all) / (3 if method else 1)
    assert all(update.resampled for update in search.updates.all[:2]) == bool(method)
    assert np.all(np.abs(found - mean) < 4 * np.sqrt(np.diag(cov) / effective))
    # standard error of a covariance: sqrt((c_ii c_jj + c_ij^2) / n); the sphere itself bends 10 km
    # by 1e-3
    error = np.sqrt((np.outer(np.diag(cov), np.diag(cov)) + cov**2) / effective)
    assert np.all(np.abs(spread - cov) < 4 * error + 2e-3 * np.abs(cov).max())
    assert abs(search.updates.log_evidence - evidence) < 4 * 3 / math.sqrt(effective)
    print(
        f"{method}: mean {found} / {mean}, log evidence {search.updates.log_evidence:.4f} / {evidence:.4f}"
    )


# Detection along legs: what a moving field and its sorties give, by brute force in fine steps.

FLOW = """
start = "2026-11-21T00:00Z"
duration = "3 h"
particles = 400
[clock]
step = "30 min"
[coast]
source = "none"
[[current]]
constant = { speed = "2 kn", toward = 60 }
[[scenario]]
name = "field"
object = "water"
[scenario.area]
polygon = [[179.9, 59.95], [-179.9, 59.95], [-179.9, 60.05], [179.9, 60.05]]
time = "+0 h"
until = "+1 h"
"""


def legs(points, begin, speed):
    """Return legs through points [m] east and north of 60 N 180 E, at a speed [m/s]."""
    lon, lat = sphere.destination(math.pi, math.radians(60), *np.array(points, float).T)
    lon = np.degrees(np.unwrap(lon))
    time = [seconds(begin)]
    for k in range(len(points) - 1):
        time.append(
            time[-1]
            + float(
                sphere.distance(
                    *np.radians(
                        [lon[k], lat[k] * 180 / np.pi, lon[k + 1], lat[k + 1] * 180 / np.pi]
                    )
                )
            )
            / speed
        )
    return Legs(
        tuple(time),
        tuple(lon.tolist()),
        tuple(np.degrees(lat).tolist()),
        (True,) * (len(points) - 1),
    )


def flown(name, track, law, width):
    """Return the sortie of a track."""
    begin, end = (np.datetime64(round(t), "s") for t in (track.time[0], math.ceil(track.time[-1])))
    return Sortie(name, "", begin, end, law, (width,), legs=track)


def test_two_overlapping_sorties_by_brute_force(tmp_path):
    """Inverse cube along two tracks at once, the field drifting at 2 kn: the hazard integrated in
    steps of 0.5 s.
    """
    first = legs([(-9000, -3000), (8000, -2500), (8200, 1500), (-8500, 2000)], 0.4, 20.0)
    second = legs([(5000, -6000), (4000, 6000), (-4000, 6500), (-3000, -6000)], 0.9, 11.0)
    widths = (1200.0, 700.0)
    sorties = tuple(
        flown(f"{k}", t, Law(), w)
        for k, (t, w) in enumerate(zip((first, second), widths, strict=True))
    )
    case = load(tmp_path, FLOW, sorties=sorties)
    _, still, _ = run(load(tmp_path, FLOW))
    _, ensemble, _ = run(case)
    hazard = np.zeros(ensemble.n)
    release = ensemble.release.to_numpy()
    # each particle's exact track: the end, less the current's great-circle rhumb; 3 h at 2 kn are
    # 11 km
    speed = 2 * NMI / 3600 * np.array([math.sin(math.radians(60)), math.cos(math.radians(60))])
    lon_end, lat_end = (c.to_numpy() for c in (ensemble.lon, ensemble.lat))
    lon_end = (lon_end.astype(np.int64) % 2**32) * (360 / 2**32)
    lat_end = sphere.to_degrees(lat_end)
    end, dt = seconds(3.0), 0.5
    for track, width in zip((first, second), widths, strict=True):
        a = width**2 / (4 * math.pi)
        every = np.arange(track.time[0] + dt / 2, track.time[-1], dt)[:, None]
        for k in range(len(track.time) - 1):
            t = every[np.searchsorted(track.time, every[:, 0]) == k + 1]
            share = (t - track.time[k]) / (track.time[k + 1] - track.time[k])
            corners = np.radians([track.lon[k], track.lat[k], track.lon[k + 1], track.lat[k + 1]])
            way = np.array(sphere.offset(*corners))
            x, y = sphere.destination(corners[0], corners[1], share * way[0], share * way[1])
            back = t - end
            lat = lat_end + speed[1] * back / METRES
            middle = np.radians(0.5 * (lat + lat_end))
            lon = lon_end + speed[0] * back / (METRES * np.cos(middle))  # a rhumb line, to 1e-7
            r = sphere.distance(x, y, np.radians(lon), np.radians(lat))
            # per unit of relative track: the sensor's velocity less the current
            ground = way / (track.time[k + 1] - track.time[k])
            relative = np.hypot(*(ground - speed))
            hazard += np.where(release <= t - seconds(0), a / (2 * r**3) * relative * dt, 0.0).sum(
                axis=0
            )
    found = still.log_weight.to_numpy() - ensemble.log_weight.to_numpy()
    ordinary = hazard < 8  # beyond, steps of 10 m are too coarse for the brute force
    assert ordinary.sum() > 350
    np.testing.assert_allclose(found[ordinary], hazard[ordinary], rtol=0.01, atol=2e-4)


@pytest.mark.parametrize(
    "law",
    [
        Law(),
        Law("definite_range"),
        Law("m_beta", 0.6),
        Law("curve", 1.0, (0.0, 400.0, 900.0), (0.9, 0.5, 0.0)),
    ],
)
def test_splitting_a_leg_changes_no_weight(tmp_path, law):
    """The same straight tracks cut into short legs, on a moving field: the same weights."""
    whole = legs([(-9000, -1000), (9000, -1000)], 0.3, 9.0)
    share = np.sort(np.concatenate([[0.0, 1.0], np.random.default_rng(2).uniform(0, 1, 12)]))
    way = np.array(
        sphere.offset(*np.radians([whole.lon[0], whole.lat[0], whole.lon[1], whole.lat[1]]))
    )
    x, y = sphere.destination(
        math.radians(whole.lon[0]), math.radians(whole.lat[0]), way[0] * share, way[1] * share
    )
    time = whole.time[0] + share * (whole.time[1] - whole.time[0])
    cut = Legs(
        tuple(time),
        tuple(np.degrees(np.unwrap(x))),
        tuple(np.degrees(y)),
        (True,) * (len(share) - 1),
    )
    results = []
    for track in (whole, cut):
        _, ensemble, _ = run(load(tmp_path, FLOW, sorties=(flown("sweep", track, law, 900.0),)))
        results.append(ensemble.log_weight.to_numpy())
    # While it drifts by 2 km a particle's north turns by 5e-4: a metre of lateral range, on the
    # steepest part of a law 2.5e-3.
    np.testing.assert_allclose(
        400 * np.exp(results[0]), 400 * np.exp(results[1]), rtol=0, atol=2.5e-3
    )
    assert len(np.unique(results[0])) > 1


SQUARE = """
[[scenario]]
name = "square"
object = "water"
[scenario.area]
polygon = [[179.9, 59.95], [-179.9, 59.95], [-179.9, 60.05], [179.9, 60.05]]
"""


@pytest.mark.parametrize("coverage", [0.5, 0.9, 1.7])
@pytest.mark.parametrize("kind", ["inverse_cube", "definite_range", "m_beta", "curve"])
def test_endless_sweeps_average_to_the_law(tmp_path, kind, coverage):
    """Parallel sweeps far beyond a field, at a spacing W / C, find b(C) of what is uniform in it."""
    n, high = 20_000, 0.1 * METRES  # of the field: a whole number of spacings
    spacing = high / round(high * coverage / 1000.0)
    width = coverage * spacing
    law = {
        "inverse_cube": Law(),
        "definite_range": Law("definite_range"),
        "m_beta": Law("m_beta", 0.7),
        # a triangle of height 0.8: W is its integral over both sides, so that it ends at W / 0.8
        "curve": Law("curve", 1.0, (0.0, width / 0.8), (0.8, 0.0)),
    }[kind]
    lines = (np.arange(-30, 31) + 0.137) * spacing
    points = [
        (x, y)
        for k, y in enumerate(lines)
        for x in ((-45_000, 45_000) if k % 2 == 0 else (45_000, -45_000))
    ]
    track = legs(points, 0.0, 2000.0)
    case = load(tmp_path, STILL + SQUARE, particles=n, sorties=(flown("sweep", track, law, width),))
    if kind == "definite_range" and coverage > 1:  # it was there and was missed: impossible
        with pytest.raises(UserError, match='sortie "sweep" contradicts every scenario'):
            run(case)
        return
    search, _, _ = run(case)
    # b(C), written out
    looks = coverage / 0.7
    offset = (np.arange(4000) + 0.5) / 4000 * spacing
    tracks = np.arange(-60, 61) * spacing
    triangle = np.maximum(0.8 - np.abs(offset[:, None] - tracks) * 0.8 / (width / 0.8), 0)
    expected = {
        "inverse_cube": math.erf(math.sqrt(math.pi) / 2 * coverage),
        "definite_range": min(coverage, 1.0),
        "m_beta": 1 - 0.3 ** math.floor(looks) * (1 - 0.7 * (looks - math.floor(looks))),
        "curve": 1 - np.prod(1 - triangle, axis=1).mean(),
    }[kind]
    found = float(search.updates.all[0].pos[-1])
    # 20,000 uniform places, POD between 0 and 1; the hazard of lines beyond 30 spacings is 1e-3 of
    # it all
    assert found == pytest.approx(expected, abs=4 * math.sqrt(expected * (1 - expected) / n) + 1e-3)


def test_shared_sweep_width(tmp_path):
    """Twenty looks at C = 0.3 with an unknown factor of shape 4:

    SEARCH.md's chances of a miss, in closed form.
    """
    whole = Area((179.9, 180.1, 180.1, 179.9), (59.9, 59.9, 60.1, 60.1))
    misses = {}
    for name, shape, group in (
        ("known", math.inf, "one"),
        ("anew", 4.0, ""),
        ("shared", 4.0, "one"),
    ):
        sorties = tuple(
            Sortie(
                f"{k}", "", hours(0.2 * k), hours(0.2 * k + 0.2), Law("random"), (1.0,), shape,
                group or str(k), area=whole, coverage=(0.3,),
            )
            for k in range(20)
        )  # fmt: skip
        search, _, _ = run(load(tmp_path, STILL + SQUARE, sorties=sorties))
        misses[name] = math.exp(search.updates.log_evidence)
    assert misses["known"] == pytest.approx(math.exp(-6), rel=1e-4)
    assert misses["anew"] == pytest.approx((1 + 0.3 / 4) ** -80, rel=1e-4)
    assert misses["shared"] == pytest.approx((1 + 6 / 4) ** -4, rel=1e-4)  # 0.0256


def test_share_of_time_inside(tmp_path):
    """Half the time in an area at C = 2 is half of b(2) for a swept pattern, and e^-1 of a miss for
    random search.
    """
    ring = Area((179.0, 181.0, 181.0, 179.0), (59.9, 59.9, 60.1, 60.1))
    for kind, expected in (
        ("inverse_cube", math.erf(math.sqrt(math.pi)) / 2),
        ("random", 1 - math.exp(-1)),
    ):
        # released half an hour after the search begins, it is there for half of the hour
        text = STILL + SQUARE + 'time = "+30 min"'
        sortie = Sortie("s", "", hours(0), hours(1), Law(kind), (1.0,), area=ring, coverage=(2.0,))
        search, _, _ = run(load(tmp_path, text, sorties=(sortie,)))
        assert search.updates.all[0].pos[-1] == pytest.approx(expected, rel=1e-5)
        # half of the time there; at least what was found, which is more where random search goes on
        # without an edge
        assert search.updates.all[0].poc[-1] == pytest.approx(max(0.5, expected), rel=1e-5)


@pytest.mark.parametrize("kind", ["inverse_cube", "definite_range", "m_beta", "random"])
def test_a_search_that_was_cut_short(tmp_path, kind):
    """Of a swept pattern a part of the area was swept in full: that part of b(C), not b of that
    part; random search has its effort.
    """
    ring, part, coverage = Area((179.0, 181.0, 181.0, 179.0), (59.9, 59.9, 60.1, 60.1)), 0.7, 0.9
    law = Law(kind, 0.8) if kind == "m_beta" else Law(kind)
    sortie = Sortie(
        "s", "", hours(0), hours(1), law, (1.0,), area=ring, coverage=(coverage,), completed=part
    )
    search, _, _ = run(load(tmp_path, STILL + SQUARE, sorties=(sortie,)))
    expected = {
        "inverse_cube": part * math.erf(math.sqrt(math.pi) / 2 * coverage),
        "definite_range": part * coverage,
        "m_beta": part * (1 - 0.2 * (1 - 0.8 * (coverage / 0.8 - 1))),
        "random": 1 - math.exp(-part * coverage),
    }[kind]
    assert search.updates.all[0].pos[-1] == pytest.approx(expected, rel=1e-5)


def test_a_sortie_that_does_nothing_changes_no_bit(tmp_path):
    """With a sortie far away, or of sweep width 0, every column is the same to the bit."""
    text = FLOW.replace("[[scenario]]", '[uncertainty]\ndiffusivity = "20 m2/s"\n[[scenario]]')
    far = legs([(300_000, 0), (310_000, 0)], 0.4, 20.0)
    blind = legs([(-9000, -3000), (8000, -2500)], 0.4, 20.0)
    _, bare, _ = run(load(tmp_path, text))
    for sortie in (
        flown("far", far, Law("definite_range"), 1000.0),
        flown("blind", blind, Law(), 0.0),
    ):
        _, ensemble, _ = run(load(tmp_path, text, sorties=(sortie,)))
        for name in ("lon", "lat", "log_weight", "status"):
            np.testing.assert_array_equal(
                bare.columns[name].to_numpy(), ensemble.columns[name].to_numpy()
            )


@pytest.mark.parametrize("completed", [1.0, 0.35])
def test_zones_in_closed_form(tmp_path, completed):
    """A watch with a convergence zone: an object in it all the time is missed with 1 - POD, one
    that crosses it by its share.

    Of a watch that was kept for a part of its time the hazard is that part.
    """
    watch = Watch((0.0, 20_000.0), (5000.0, 24_000.0), (0.5, 0.8))
    still = Legs((seconds(0.5), seconds(2.5)), (180.0, 180.0), (60.0, 60.0), (True,))
    sortie = Sortie(
        "buoy",
        "",
        hours(0.5),
        hours(2.5),
        Law(),
        (1.0,),
        legs=still,
        watch=watch,
        completed=completed,
    )
    text = (
        FLOW.replace("179.9", "179.4")
        .replace("59.95", "59.75")
        .replace("60.05", "60.25")
        .replace('until = "+1 h"', "")
    )
    _, ensemble, _ = run(load(tmp_path, text, sorties=(sortie,)))
    # the way of each particle past the buoy, by distances at 2,000 times
    speed = 2 * NMI / 3600 * np.array([math.sin(math.radians(60)), math.cos(math.radians(60))])
    lon_end = (ensemble.lon.to_numpy().astype(np.int64) % 2**32) * (360 / 2**32)
    lat_end = sphere.to_degrees(ensemble.lat.to_numpy())
    hazard = np.zeros(ensemble.n)
    times = (np.arange(2000) + 0.5) / 2000 * 2 + 0.5
    for t in times:
        back = 3600 * (t - 3.0)
        lat = lat_end + speed[1] * back / METRES
        lon = lon_end + speed[0] * back / (METRES * np.cos(np.radians(0.5 * (lat + lat_end))))
        r = sphere.distance(np.pi, np.radians(60), np.radians(lon), np.radians(lat))
        hazard += np.where(r < 5000, -math.log(0.5), 0) + np.where(
            (r >= 20_000) & (r < 24_000), -math.log(0.2), 0
        )
    found = np.log(np.full(ensemble.n, 1 / 400)) - ensemble.log_weight.to_numpy()
    np.testing.assert_allclose(
        found, completed * hazard / 2000, atol=4 * 1.61 / 2000 + 1e-3
    )  # an edge is told to one time of 2,000
    assert np.ptp(found) > completed


@pytest.mark.thorough
def test_debris_by_joint_normals(tmp_path):
    """Debris found reweights the object by what they share, the release and the errors of the
    current, and by no more.
    """
    std, time, bias, d, when, error = 0.25, 6 * 3600.0, 0.2, 40.0, 5.0, 1500.0
    text = STILL + NORMAL.format(d=d).replace(
        "[uncertainty]",
        '[uncertainty]\ncurrent = { std = "0.25 m/s", time = "6 h", bias = "0.2 m/s" }',
    )
    z = (9000.0, -4000.0)
    lon, lat = sphere.destination(math.radians(-179.99), math.radians(30.0), *z)
    fix = Fix(float(np.degrees(lon)), float(np.degrees(lat)))
    n = 100_000
    bare = load(tmp_path, text, particles=n)
    debris = dataclasses.replace(bare.scenarios[0].object, name="oar")
    contact = Contact(
        "oar", hours(when), "position", fixes=(fix,), major=error, minor=error, drifter=debris
    )
    case = dataclasses.replace(
        bare, contacts=(contact,), end=hours(when), outputs=np.array([hours(0), hours(when)])
    )
    search, ensemble, _ = run(case)
    turn, t = math.radians(30), 3600 * when
    axes = np.array([[math.sin(turn), math.cos(turn)], [math.cos(turn), -math.sin(turn)]])
    released = axes.T @ np.diag([4000.0**2, 2500.0**2]) @ axes
    # the integral of a stationary Ornstein-Uhlenbeck process (Gillespie 1996,
    # doi:10.1103/PhysRevE.54.2084)
    forcing = (
        2 * std**2 * time**2 * (t / time - 1 + math.exp(-t / time)) + (bias * t) ** 2
    ) * np.eye(2)
    walk = 2 * d * t * np.eye(2)
    shared, own = released + forcing, released + forcing + walk
    gain = shared @ np.linalg.inv(own + error**2 * np.eye(2))
    mean, cov = gain @ np.array(z), own - gain @ shared
    evidence = stats.multivariate_normal.logpdf(z, np.zeros(2), own + error**2 * np.eye(2))
    w = weights(ensemble)
    at = np.stack(offsets(ensemble, -179.99, 30.0))
    found = at @ w
    spread = (w * (at - found[:, None])) @ (at - found[:, None]).T
    effective = search.updates.all[0].ess_after
    assert np.all(np.abs(found - mean) < 4 * np.sqrt(np.diag(cov) / effective))
    width = np.sqrt((np.outer(np.diag(cov), np.diag(cov)) + cov**2) / effective)
    # 15 km on the sphere: 2e-3
    assert np.all(np.abs(spread - cov) < 4 * width + 3e-3 * np.abs(cov).max())
    assert abs(search.updates.log_evidence - evidence) < 4 * 3 / math.sqrt(effective)


def test_a_pattern_that_drifts_with_its_marker(tmp_path):
    """In a uniform current a search in the frame of its datum does what it does on still water."""
    track = legs([(-4000, -2000), (4000, -2000), (4000, 2000), (-4000, 2000)], 1.2, 10.0)
    sortie = dataclasses.replace(
        flown("square", track, Law(), 900.0), frame="datum", datum=(180.0, 60.0)
    )
    begin = FLOW.replace('until = "+1 h"', "")
    where = load(tmp_path, begin)
    _, moved, _ = run(dataclasses.replace(where, sorties=(sortie,)))
    _, ground, _ = run(
        dataclasses.replace(where, sorties=(dataclasses.replace(sortie, frame="ground"),))
    )
    # where each particle was when the search began: there the still one waits
    case = load(tmp_path, begin.replace("2 kn", "0 kn"))
    case = dataclasses.replace(case, sorties=(sortie,))
    runtime.start()
    start_of = run_setup.prepare(case, run_setup.open_for(case))
    back = -3600 * 1.8 * 2 * NMI / 3600
    turn = math.radians(60)
    lat = sphere.to_degrees(moved.lat.to_numpy()) + math.cos(turn) * back / METRES
    middle = np.radians(0.5 * (lat + sphere.to_degrees(moved.lat.to_numpy())))
    lon = sphere.to_degrees(moved.lon.to_numpy()) + math.sin(turn) * back / (
        METRES * np.cos(middle)
    )
    start_of.ensemble.lon.from_numpy(sphere.to_binary(lon))
    start_of.ensemble.lat.from_numpy(sphere.to_binary(lat))
    search = filter_of(case, start_of)
    list(
        simulate.run(
            start_of.ensemble, start_of.scene, start_of.clock, np.array([0]), search=search
        )
    )
    start_of.scene.forcing.close()
    still = start_of.ensemble.log_weight.to_numpy()
    np.testing.assert_allclose(
        np.exp(moved.log_weight.to_numpy()), np.exp(still), rtol=0, atol=2.5e-3 / 400
    )
    assert np.abs(np.exp(ground.log_weight.to_numpy()) - np.exp(still)).max() > 0.5 / 400


def test_resampling_is_unbiased():
    """Over many draws every particle has its expected offspring, and means of functions stay; one
    that has no weight has none.
    """
    random = np.random.default_rng(3)
    weight = random.gamma(0.3, 1.0, 200)
    weight[[0, 7, 199]] = 0.0
    values = random.normal(size=(2, 200))
    rounds, number = 4000, 200
    for draw in (
        lambda: resample.systematic(weight, number, random.random()),
        lambda: resample.kahn(weight, number, random.random(200)),
    ):
        counts = np.array([np.bincount(draw(), minlength=200) for _ in range(rounds)])
        expected = number * weight / weight.sum()
        assert not counts[:, weight == 0].any()
        assert np.all(np.abs(counts - expected[None]) < 1)  # floor or the next one
        spread = np.sqrt(np.maximum((expected % 1) * (1 - expected % 1), 1e-12) / rounds)
        assert np.all(np.abs(counts.mean(axis=0) - expected) < 4.5 * spread + 1e-9)
        means = counts @ values.T / number
        exact = values @ weight / weight.sum()
        assert np.all(
            np.abs(means.mean(axis=0) - exact) < 4.5 * means.std(axis=0) / math.sqrt(rounds)
        )
    total = counts.sum(axis=1)  # Kahn's number floats, its spread at most sqrt(N) / 2
    assert abs(total.mean() - number) < 4.5 * total.std() / math.sqrt(rounds)
    assert 1 < total.std() < 0.5 * math.sqrt(number)


def test_kahns_weights_are_those_that_were_aimed_at():
    """Each offspring weighs sum(w) / N, N the number aimed at: by the number drawn, their expected
    sum would be off.
    """
    random = np.random.default_rng(12)
    number, rounds = 60, 6000
    log_weight = np.log(random.gamma(0.4, 1.0, resample.capacity(number))).astype(np.float32)
    log_weight[number:] = -np.inf
    weight = np.exp(log_weight.astype(np.float64))
    value = np.where(
        np.arange(weight.size) == int(np.argmax(weight)), 1.0, 0.0
    )  # its offspring change the number drawn
    found = np.zeros((rounds, 2))
    for k in range(rounds):
        ancestors, made, _ = resample.offspring(
            log_weight, [(0, weight.size)], [number], "kahn", (5, k)
        )
        new = np.exp(made.astype(np.float64))
        np.testing.assert_allclose(new[new > 0], weight.sum() / number, rtol=1e-6)
        found[k] = new.sum(), (new * value[ancestors]).sum()
    exact = np.array([weight.sum(), (weight * value).sum()])
    assert np.all(np.abs(found.mean(axis=0) - exact) < 4.5 * found.std(axis=0) / math.sqrt(rounds))
    assert found[:, 0].std() > 0  # the number drawn floats, and the sum of the weights with it


def test_debris_has_coefficients_of_its_own(tmp_path):
    """It shares its object's release and errors to the bit; leeway coefficients and sides, even of
    one class, are independent.
    """
    text = STILL + NORMAL.format(d=10).replace('object = "water"', 'object = "LIFE-RAFT-DB-10"')
    text += '[[wind]]\nconstant = { speed = "9 m/s", from = 250 }\n'
    n = 50_000
    bare = load(tmp_path, text, particles=n, current_error=ForcingError(0.3, 40_000.0))
    seen = tuple(
        Contact(
            name,
            hours(2),
            "position",
            fixes=(Fix(-179.9, 30.1),),
            major=5000.0,
            minor=5000.0,
            drifter=drifter,
        )
        for name, drifter in (
            ("twin", bare.scenarios[0].object),
            ("oar", leeway.find_class("PIW-1")),
        )
    )
    case = dataclasses.replace(bare, contacts=seen)
    runtime.start()
    begin = run_setup.prepare(case, run_setup.open_for(case))
    found = debris.of_contacts(
        run_setup.ensemble_spec(case),
        [(7200, contact) for contact in seen],
        begin.scene,
        begin.ensemble,
    )
    begin.scene.forcing.close()
    whole = [begin.ensemble, *(one.ensemble for one in found.values())]
    assert len(whole) == 3
    for name in ("lon", "lat", "release", "current_error_east", "current_error_north"):
        columns = [ensemble.columns[name].to_numpy() for ensemble in whole]
        assert all(np.array_equal(columns[0], column) for column in columns[1:])
    for name in ("down_slope", "right_slope", "left_slope", "side"):
        columns = np.array([ensemble.columns[name].to_numpy() for ensemble in whole], np.float64)
        assert np.abs(np.corrcoef(columns) - np.eye(3)).max() < 4.5 / math.sqrt(n)


def test_object_and_debris_part_inside_a_step(tmp_path):
    """Half way through a step each walks on a bridge of its own: variance D T / 2 a component about
    the middle, no correlation.

    Noise that two of them have in common would show as a correlation of 1.
    """
    n, diffusivity = 40_000, 30.0
    text = STILL.replace("30 min", "1 h").replace('"6 h"', '"1 h"') + NORMAL.format(d=diffusivity)
    drifters = {"oar": leeway.find_class("PIW-1"), "raft": leeway.find_class("LIFE-RAFT-DB-10")}
    fix = {"kind": "position", "fixes": (Fix(-179.9, 30.1),), "major": 5e4, "minor": 5e4}
    contacts = tuple(
        Contact(name, hours(0.5), **fix, drifter=drifter) for name, drifter in drifters.items()
    )
    case = load(tmp_path, text, particles=n, contacts=contacts)
    runtime.start()
    begin = run_setup.prepare(case, run_setup.open_for(case))
    search, bends = run_setup.build_search_filter(case, begin), []
    first, apply_evidence = begin.ensemble.lat.to_numpy().astype(float), search.apply_evidence

    def effect(time, place):
        """Note how far north of the middle of its step debris is seen [m]."""

        def noted(debris, scene, before, time):
            lon, lat = place(debris, scene, before, time)
            bends.append(
                (lat - (before.lat.to_numpy().astype(float) + debris.lat.to_numpy()) / 2)
                * sphere.UNIT
                * sphere.RADIUS
            )
            return lon, lat

        apply_evidence(time, noted)

    search.apply_evidence = effect
    (moment,) = simulate.run(
        begin.ensemble, begin.scene, begin.clock, np.array([1800]), search=search
    )
    begin.scene.forcing.close()
    middle = (first + begin.ensemble.lat.to_numpy()) / 2
    bends.append((moment.lat - middle) * sphere.UNIT * sphere.RADIUS)
    assert len(bends) == 3
    for bend in bends:
        assert np.var(bend) == pytest.approx(diffusivity * 3600 / 2, rel=4.5 * math.sqrt(2 / n))
    assert np.abs(np.corrcoef(bends) - np.eye(3)).max() < 4.5 / math.sqrt(n)


def test_copies_ashore_begin_their_waits_anew_debris_too(tmp_path):
    """Else a copy, whose wait is drawn for its own slot, may long have waited enough, and most
    would leave at once.
    """
    (tmp_path / "land.geojson").write_text(spills.SHORE)
    coast = '[coast]\nsource = "land.geojson"\nbehaviour = "refloat"\nhalf_life = "2 h"\n'
    text = STILL.replace('[coast]\nsource = "none"\n', coast) + NORMAL.format(d=5).replace(
        "[-179.99, 30.0]", "[-0.2, 0.1]"
    )
    fix = {"kind": "position", "fixes": (Fix(-0.2, 0.1),), "major": 5e3, "minor": 5e3}
    contact = Contact("oar", hours(2), **fix, drifter=leeway.find_class("PIW-1"))
    case = load(
        tmp_path,
        text,
        particles=2000,
        contacts=(contact,),
        resampling=Resampling("systematic", 0.5),
    )
    runtime.start()
    begin = run_setup.prepare(case, run_setup.open_for(case))
    search = run_setup.build_search_filter(case, begin)
    begin.scene.forcing.close()
    (beside,) = search._debris.values()
    for ensemble in (begin.ensemble, beside.ensemble):
        ensemble.status.from_numpy(
            np.where(np.arange(2000) % 3 == 0, int(Status.ASHORE), 0).astype(np.int32)
        )
        ensemble.status_since.fill(17)
    log_weight, layout = begin.ensemble.log_weight.to_numpy(), begin.ensemble.layout
    search.resample_all(
        Resampled(
            *resample.offspring(log_weight, [(0, 2000)], [2000], "systematic", (1, 1)), layout
        ),
        7200,
    )
    for ensemble in (begin.ensemble, beside.ensemble):
        ashore = ensemble.status.to_numpy() == Status.ASHORE
        assert 0 < ashore.sum() < 2000
        assert (ensemble.status_since.to_numpy() == np.where(ashore, 7200, 17)).all()


def test_outputs_do_not_change_what_a_contact_sees(tmp_path):
    """Nor do two outputs at one time: evidence of a contact later in the same step is the same to
    the bit.
    """
    text = STILL.replace("30 min", "1 h") + NORMAL.format(d=80)
    fix = Contact(
        "fix", hours(0.6), "position", fixes=(Fix(-179.98, 30.01),), major=900.0, minor=700.0
    )
    case = load(tmp_path, text, particles=3000, contacts=(fix,))
    alone, shown = (run(case, outputs) for outputs in ([], [700, 1900, 1900, 2300]))
    assert len(shown[2]) == 4
    assert alone[0].updates.log_evidence == shown[0].updates.log_evidence
    np.testing.assert_array_equal(
        *(ensemble.log_weight.to_numpy() for _, ensemble, _ in (alone, shown))
    )


def test_weights_stay_near_one_after_small_densities(tmp_path):
    """A density of 1e-9 a square metre twice: float32 would lose small differences far from 0."""
    fixes = [
        Contact(str(h), hours(h), "position", fixes=(Fix(-179.98, 30.01),), major=9e3, minor=7e3)
        for h in (1, 2, 3)
    ]
    case = load(tmp_path, STILL + NORMAL.format(d=30), particles=2000, contacts=tuple(fixes))
    _, ensemble, _ = run(case)
    assert abs(np.log(np.exp(ensemble.log_weight.to_numpy().astype(float)).sum())) <= 20


def test_offspring_separate_and_remember(tmp_path):
    """After a narrow contact few ancestors remain; their offspring part by later noise, and tracks
    lead back to them.
    """
    text = STILL + NORMAL.format(d=30)
    fix = Contact(
        "fix", hours(1), "position", fixes=(Fix(-179.98, 30.01),), major=300.0, minor=300.0
    )
    vague = dataclasses.replace(fix, name="vague", time=hours(3), major=90e3, minor=90e3)
    case = load(
        tmp_path,
        text,
        particles=5000,
        contacts=(fix, vague),
        resampling=Resampling("systematic", 0.5),
    )
    search, ensemble, moments = run(case, outputs=[0, 3600, 7200, 21_600])
    update = search.updates.all[0]
    assert update.resampled
    assert update.distinct < 0.05
    assert update.ess_after < 500
    assert update.ess_resampled == pytest.approx(5000, rel=1e-3)
    later = search.updates.all[1]  # tells next to nothing: copies still count as one
    assert later.ess_before == pytest.approx(update.ess_after, rel=0.02)
    assert later.ess_after == pytest.approx(later.ess_before, rel=0.02)
    family = moments[2].ancestors
    assert effective.number(record.probability(ensemble), family) == pytest.approx(
        later.ess_after, rel=0.02
    )
    last, drawn = moments[-1], moments[2].ancestors
    assert moments[1].ancestors is None
    assert len(np.unique(drawn)) == round(update.distinct * 5000)
    assert len(np.unique(last.lon)) > 4900
    # over 5 h a walk leads sqrt(2 D t) a component from the ancestor's place at 1 h
    from_lon, from_lat = moments[1].lon[drawn], moments[1].lat[drawn]
    east, north = sphere.offset(
        *(x * sphere.UNIT for x in (from_lon, from_lat, last.lon, last.lat))
    )
    expected = math.sqrt(2 * 30 * 5 * 3600)
    assert np.std(east) == pytest.approx(expected, rel=0.05)
    assert np.std(north) == pytest.approx(expected, rel=0.05)


def of_every_kind(folder):
    """Return in words, to the bit, what sorties of every kind, a shared factor, sensors and
    resampling made of a case.
    """
    text = FLOW.replace("[[scenario]]", '[uncertainty]\ndiffusivity = "20 m2/s"\n[[scenario]]')
    track = legs([(-9000, -3000), (8000, -2500), (8200, 1500), (-8500, 2000)], 0.4, 20.0)
    laws = (Law(), Law("m_beta", 0.7))
    sorties = tuple(
        dataclasses.replace(flown(law.kind, track, law, 900.0), shape=5.0, group="g")
        for law in laws
    )
    field, ends = Field(180.02, 60.0, 0.0, 8000.0, 5000.0, 0.4), ((179.97, 59.9), (180.03, 60.1))
    sensors = Sensors(
        looks=(
            Look("look", hours(1.3), Field(179.98, 60.0, 4000.0), False, Sight("exponential", 2.0)),
        ),
        presences=(Presence("box", hours(0.4), hours(2.2), field, "never", 0.8),),
        barriers=(Barrier("barrier", hours(0.3), hours(2.7), ends, 0.6),),
        lines=(Line("line", ((180.04, 59.9), (180.05, 60.1))),),
    )
    drawn = Resampling("kahn", 0.99)
    case = load(folder, text, particles=5000, sorties=sorties, sensors=sensors, resampling=drawn)
    search, ensemble, _ = run(case)
    told = search.updates
    assert sorted(update.kind for update in told.all) == [
        "barrier",
        "look",
        "presence",
        "sortie",
        "sortie",
    ]
    columns = [ensemble.columns[name].to_numpy().tobytes() for name in ("lon", "lat", "log_weight")]
    digest = hashlib.sha256(b"".join([*columns, told.crossings.all[0].mass.tobytes()])).hexdigest()
    return f"{any(update.resampled for update in told.all[:-1])} {digest} {told.log_evidence.hex()}"


def test_the_same_bits_for_any_number_of_threads(one_thread, tmp_path):
    """A process of its own has one; this one has two."""
    script = """
import importlib.util, pathlib
of = importlib.util.spec_from_file_location("test_filter", given[0])
module = importlib.util.module_from_spec(of)
of.loader.exec_module(module)
answer = module.of_every_kind(pathlib.Path(given[1]))
"""
    one = one_thread.ask(script, __file__, str(tmp_path))
    assert one == of_every_kind(tmp_path)
    assert one.startswith("True")


# What an audit found.


def test_what_strands_or_goes_adrift_within_a_step_is_where_it_is():
    """A particle moves only from its release to its landing: the time in an area round the beach,
    in closed form.
    """
    runtime.start()
    ensemble = record.empty(1, (0, 2), COLUMNS)
    x = sphere.to_binary([-1000 / METRES, -1000 / METRES])
    before = runtime.upload(x), runtime.upload(np.zeros(2, np.int32))
    ensemble.status.from_numpy(np.array([1, 1], np.int32))
    ensemble.status_since.from_numpy(np.array([182, 2000], np.int32))
    ensemble.release.from_numpy(np.array([0, 1000], np.int32))
    still = sensor_path.path_of_fixed_sensor(0.0, 0.0, 0, 3600)
    ring = np.array([-100.0, -100.0, 100.0, -100.0, 100.0, 100.0, -100.0, 100.0])
    for cuts in ([0, 3600], [0, 100, 1950, 3600]):
        exposure = runtime.empty(2)
        afloat = runtime.empty(2)  # as a sensor has it that does not see the beach
        for begin, end in itertools.pairwise(cuts):
            track = still.between(begin, end, 0, None, (0.0, 0.0))
            after = ensemble.lon, ensemble.lat
            paths = pieces.straight(ensemble, ensemble.batch([0]), before, after, 0, 3600)
            args = (ensemble, paths, sweep.INSIDE, track, ring, np.ones(1))
            sweep.expose(*args, exposure)
            sweep.expose(*args, afloat, shore=False)
        # the last tenth of the way lies in the area, and all the time after it
        assert exposure.to_numpy() == pytest.approx(
            [3600 - 0.9 * 182, 3600 - 1000 - 0.9 * 1000], abs=0.1
        )
        assert afloat.to_numpy() == pytest.approx([0.1 * 182, 0.1 * 1000], abs=0.1)


@pytest.mark.parametrize("minutes", [7, 130, 300])
def test_a_pod_of_one_leaves_nothing(tmp_path, minutes):
    """However long it takes: an object that stayed where everything is found was not there."""
    ring = Area((179.0, 181.0, 181.0, 179.0), (59.9, 59.9, 60.1, 60.1))
    sortie = Sortie(
        "all",
        "",
        hours(0),
        hours(minutes / 60),
        Law("definite_range"),
        (1.0,),
        area=ring,
        coverage=(1.2,),
    )
    with pytest.raises(UserError, match='sortie "all" contradicts every scenario \\("square"\\)'):
        run(load(tmp_path, STILL + SQUARE, sorties=(sortie,)))


def test_a_story_that_is_dead_stays_so(tmp_path):
    """What a sortie rules out has no POS from later ones, and the others go on."""
    text = STILL + SQUARE + BOX.replace('"box"', '"elsewhere"')
    ring = Area((179.0, 181.0, 181.0, 179.0), (59.9, 59.9, 60.1, 60.1))
    sorties = [
        Sortie(
            "all",
            "",
            hours(0),
            hours(1),
            Law("definite_range"),
            (1.0, 1.0),
            area=ring,
            coverage=(1.2, 1.2),
        ),
        Sortie(
            "again",
            "",
            hours(1),
            hours(2),
            Law("random"),
            (1.0, 1.0),
            area=ring,
            coverage=(1.0, 1.0),
        ),
    ]
    search, _, _ = run(load(tmp_path, text, sorties=tuple(sorties)))
    first, second = search.updates.all
    assert first.posterior.tolist() == [0.0, 1.0]
    assert first.pos == pytest.approx([1.0, 0.0, 0.5])
    assert second.pos.tolist() == [0.0, 0.0, 0.0]
    assert second.cumulative == pytest.approx([1.0, 0.0, 0.5])


def test_an_output_within_a_sortie_changes_no_bit(tmp_path):
    """Looking on does not cut a leg."""
    track = legs([(-9000, -3000), (8000, -2500), (8200, 1500), (-8500, 2000)], 0.4, 20.0)
    sorties = tuple(flown(law.kind, track, law, 900.0) for law in (Law(), Law("m_beta", 0.7)))
    case = load(tmp_path, FLOW, sorties=sorties)
    _, bare, _ = run(case)
    _, seen, moments = run(case, outputs=[1700, 2000, 3000, 3300, 10_800])
    np.testing.assert_array_equal(bare.log_weight.to_numpy(), seen.log_weight.to_numpy())
    totals = [np.exp(moment.log_weight.astype(np.float64)).sum() for moment in moments]
    assert all(later < earlier for earlier, later in itertools.pairwise(totals[:4]))


def test_two_contacts_within_one_step(tmp_path):
    """The second is where a walk can get to from the first: evidence of a Kalman filter, fixes 6
    min apart in a step of 60.
    """
    d, fixes = 100.0, [(1.4, (500.0, 300.0), 200.0), (1.5, (700.0, 100.0), 200.0)]
    text = STILL.replace("30 min", "60 min") + NORMAL.format(d=d).replace(
        '["4000 m", "2500 m"]', '"600 m"'
    ).replace("orientation = 30", "")
    contacts, mean, cov, evidence, last = [], np.zeros(2), 600.0**2 * np.eye(2), 0.0, 0.0
    for k, (when, z, std) in enumerate(fixes):
        lon, lat = sphere.destination(math.radians(-179.99), math.radians(30.0), *z)
        fix = Fix(float(np.degrees(lon)), float(np.degrees(lat)))
        contacts.append(
            Contact(f"{k}", hours(when), "position", fixes=(fix,), major=std, minor=std)
        )
        cov = cov + 2 * d * 3600 * (when - last) * np.eye(2)
        total = cov + std**2 * np.eye(2)
        evidence += stats.multivariate_normal.logpdf(z, mean, total)
        gain = cov @ np.linalg.inv(total)
        mean, cov, last = mean + gain @ (np.array(z) - mean), cov - gain @ cov, when
    search, _, _ = run(load(tmp_path, text, contacts=tuple(contacts), particles=100_000))
    assert search.updates.log_evidence == pytest.approx(
        evidence, abs=4 * 3 / math.sqrt(search.updates.all[-1].ess_after)
    )


def test_a_contact_that_nothing_explains(tmp_path):
    """One wrong digit: refused where it is believed, without effect where it may be false; and no
    NaN.
    """
    far = Contact(
        "digit", hours(1), "position", fixes=(Fix(-50.0, 10.0),), major=3000.0, minor=3000.0
    )
    with pytest.raises(UserError, match='contact "digit" contradicts every scenario'):
        run(load(tmp_path, STILL + SQUARE, contacts=(far,)))
    search, ensemble, _ = run(
        load(tmp_path, STILL + SQUARE, contacts=(dataclasses.replace(far, belief=0.9),))
    )
    assert np.ptp(ensemble.log_weight.to_numpy()) == 0
    assert search.updates.all[0].ess_after == pytest.approx(1000)


def test_a_track_beside_its_area_has_a_pod(tmp_path):
    """What is seen outside the outline counts as searched: POC is never below POS."""
    beside = Area((179.99, 180.0, 180.0, 179.99), (60.2, 60.2, 60.21, 60.21))
    track = legs([(-9000, 0), (9000, 0)], 0.4, 20.0)
    sortie = dataclasses.replace(flown("astray", track, Law(), 2000.0), area=beside)
    update = run(load(tmp_path, STILL + SQUARE, sorties=(sortie,)))[0].updates.all[0]
    assert update.pos[-1] > 0.1
    assert update.poc[-1] == pytest.approx(update.pos[-1])
