"""Release from finds: the weight that divergence asks for, and backward against forward against
closed forms.
"""

import csv
import io
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from scipy import stats

from drift.case import file as case_file
from drift.case.record import Case
from drift.engine.environment.environment import Environment
from drift.engine.motion import simulate
from drift.engine.motion.clock import Clock
from drift.engine.motion.drift import COLUMNS, DRIFT
from drift.engine.motion.forcing import Forcing, Sources
from drift.engine.motion.model import Motion
from drift.engine.motion.scene import Scene
from drift.engine.particles import ensemble as record
from drift.engine.particles.status import Status
from drift.pipeline import run_setup
from drift.spills.backtrack import backward, text
from drift.spills.worlds import release as objects
from drift.spills.worlds import worlds as drawn_worlds
from geo import sphere
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast import segments
from geo.coast.segments import Segments
from geo.coast.shore import Shore
from geo.errors import UserError
from geo.forcing import sources
from geo.forcing.sources import Source
from geo.grids.grid import Grid
from kernels.step import advance as kernel

BOX = Box(-1.4, -1.4, 1.4, 1.4)
EVERYWHERE = kernel.Domain(-(2**31), -(2**30), 2**32 - 1, 2**31)
DEGREE = np.radians(sphere.RADIUS)  # [m] at the equator
CONVERGENCE = 1.0e-5  # [1/s] -du/dx = -dv/dy
HUB = (20_000.0, -9_000.0)  # [m] (x, y) where the flow converges
T0 = 1_795_000_000 // 3600 * 3600
HOUR = 3600


def converging() -> Source:
    """u = -k (x - HUB), linear in lon and lat: bilinear sampling adds no error."""
    grid = Grid(-1.5, -1.5, 0.5, 0.5, 7, 7)
    lon, lat = np.meshgrid(grid.lon, grid.lat)
    flow = np.stack(
        [-CONVERGENCE * (lon * DEGREE - HUB[0]), -CONVERGENCE * (lat * DEGREE - HUB[1])], axis=-1
    )
    field = np.ascontiguousarray(flow, np.float32)
    return Source(
        "current",
        "converging",
        grid,
        np.empty(0, "datetime64[s]"),
        lambda i: field,
        0.0,
        (),
        "converging",
    )


def weights(
    source: Source, lat_deg: float, direction: int, duration: int, scheme: str
) -> tuple[np.ndarray, np.ndarray]:
    """Return log weights and latitudes [rad] at the end, of particles strewn about the equator or a
    parallel.
    """
    ensemble = record.empty(1, (0, 5), COLUMNS)
    ensemble.lon.from_numpy(sphere.to_binary([0.05, -0.1, 0.0, 0.2, -0.2]))
    ensemble.lat.from_numpy(sphere.to_binary(lat_deg + np.array([0.1, 0.15, -0.12, 0.0, -0.03])))
    place = kernel.Surroundings(EVERYWHERE, divergence=True, scheme=scheme)
    scene = Scene(
        Forcing([Sources({"current": (source,)})], direction),
        (Motion(DRIFT, kernel.Physics()),),
        place,
    )
    list(simulate.run(ensemble, scene, Clock(T0, duration, direction, 1800), np.array([duration])))
    scene.forcing.close()
    assert (ensemble.status.to_numpy() == Status.ADRIFT).all()
    return ensemble.log_weight.to_numpy(), ensemble.lat.to_numpy() * sphere.UNIT


@pytest.mark.parametrize("scheme", ["rk2", "rk4"])
@pytest.mark.parametrize("direction", [1, -1])
def test_log_weights_lose_the_divergence_along_the_track(direction: int, scheme: str) -> None:
    """In a flow that converges at 1e-5 per s in both axes the weight grows by exp(2 k t), forward
    as backward.

    float32 speeds of 2 m/s are known to 2e-7 m/s, 400 m apart that is 1e-9 per s in a divergence of
    2e-5: 0.01 % a step.
    """
    duration = 24 * HOUR
    log_weight, _ = weights(converging(), 0.0, direction, duration, scheme)
    assert log_weight == pytest.approx(2 * CONVERGENCE * duration, rel=2e-4)


@pytest.mark.parametrize("direction", [1, -1])
def test_on_the_sphere_meridians_converge(direction: int) -> None:
    """A uniform v has the divergence -v tan(lat) / R, whose integral along a meridian is that of
    -tan(lat): ln cos.
    """
    log_weight, lat = weights(
        sources.constant_field("current", 0.0, 1.2), 60.0, direction, 48 * HOUR, "rk4"
    )
    run_setup = np.radians(60.0 + np.array([0.1, 0.15, -0.12, 0.0, -0.03]))
    expected = direction * np.log(np.cos(run_setup) / np.cos(lat))
    assert expected.min() > 0.05
    # the midpoint rule: (v dt / R)^2, and float32
    assert log_weight == pytest.approx(expected, rel=1e-4)
    zonal, _ = weights(
        sources.constant_field("current", 1.2, 0.0), 60.0, direction, 48 * HOUR, "rk4"
    )
    assert np.abs(zonal).max() < 1e-6


START = np.datetime64(T0, "s")
SPREAD, BIAS, RADIUS, DIFFUSIVITY, SCATTER = 20_000.0, 0.06, 1_000.0, 50.0, 300.0
WINDOW = 24 * HOUR
# [s], [m] east and north: two finds
SEEN = ((40 * HOUR, 12_400.0, -2_900.0), (30 * HOUR, 7_500.0, 200.0))
SPILL = f"""
start = "{np.datetime_as_string(START)}Z"
duration = "120 h"
seed = 5
clock.step = "30 min"
uncertainty.diffusivity = "{DIFFUSIVITY} m2/s"
[[current]]
name = "converging"
constant = {{ east = "0 m/s", north = "0 m/s" }}
[spill]
objects = 2
worlds = 50
windage_bias = 0
current_bias = "{BIAS} m/s"
release_std = "{SCATTER} m"
position = {{ at = [0.0, 0.0], std = "{SPREAD} m", until = "+{WINDOW // HOUR} h" }}
[[spill.class]]
name = "drum"
object = "water"
"""


def at_sea(seconds: int, x: float, y: float) -> str:
    return (
        f'\n[[find]]\nat = [{x / DEGREE}, {y / DEGREE}]\ntime = "+{seconds / HOUR} h"\nat_sea = true\n'
        f'radius = "{RADIUS} m"\n'
    )


def case_of(tmp_path: Path, text: str) -> Case:
    file = tmp_path / "spill.toml"
    file.write_text(text, encoding="utf-8")
    return case_file.load(file)


def environment(source: Source, coast: shoreline.Coast | None = None) -> Environment:
    return Environment(BOX, (Sources({"current": (source,)}),), (source,), coast, ())


@dataclass(frozen=True)
class Exact:
    """Means of x, y [m] and release [s], and standard deviations."""

    mean: np.ndarray
    std: np.ndarray


def exact(finds: tuple[tuple[int, float, float], ...], shared: bool = True) -> Exact:
    """Return the posterior by closed form: Gaussian in (x0, bias) given the release, which is
    summed over.

    dx = (-k (x - hub) + b) dt + sqrt(2 D) dW. shared: finds have the same b; otherwise each has its
    own.
    """
    times = (np.arange(2000) + 0.5) * WINDOW / 2000
    log_weight, moments = np.zeros(times.size), np.zeros((2, 2, times.size))  # axis; mean, variance
    for axis in range(2):
        for n, t in enumerate(times):
            age = np.array([seen - t for seen, _, _ in finds])
            if (age <= 0).any():
                log_weight[n] = -np.inf
                continue
            keep = np.exp(-CONVERGENCE * age)
            drawn = np.array([seen[1 + axis] for seen in finds])
            gain = (1 - keep) / CONVERGENCE
            noise = DIFFUSIVITY * (1 - keep**2) / CONVERGENCE + RADIUS**2 + (keep * SCATTER) ** 2
            of_bias = BIAS**2 * (np.outer(gain, gain) if shared else np.diag(gain**2))
            covariance = SPREAD**2 * np.outer(keep, keep) + of_bias + np.diag(noise)
            apart = drawn - HUB[axis] * (1 - keep)
            log_weight[n] += stats.multivariate_normal.logpdf(
                apart, np.zeros(len(finds)), covariance
            )
            pull = np.linalg.solve(covariance, SPREAD**2 * keep)
            moments[axis, :, n] = pull @ apart, SPREAD**2 - pull @ (SPREAD**2 * keep)
    share = np.exp(log_weight - log_weight.max())
    share /= share.sum()
    place = (moments[:, 0] * share).sum(1)
    variance = ((moments[:, 1] + moments[:, 0] ** 2) * share).sum(1) - place**2
    time = (times * share).sum()
    spread = np.sqrt([*variance, ((times - time) ** 2 * share).sum()])
    return Exact(np.array([*place, time]), spread)


def figures(found: backward.Origin) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return mean (x, y [m], release [s after start]), its standard error, and standard deviations."""
    mean = np.array([found.mean[0] * DEGREE, found.mean[1] * DEGREE, found.mean[2] - T0])
    return mean, np.array(found.error), np.array(found.std)


def forward(case: Case, source: Source, worlds: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return mean (x, y, release) and its standard error by worlds from the prior, weighted by the
    finds.
    """
    assert case.spill is not None
    drawn = drawn_worlds.draw_worlds(
        case.spill, 9, lambda lon, lat: np.zeros(lon.shape, bool), count=worlds
    )
    release = drawn.release - T0
    n = worlds * count
    ensemble = record.empty(11, (0, n), COLUMNS)
    scatter = np.degrees(np.random.default_rng(3).normal(0, SCATTER, (2, n)) / sphere.RADIUS)
    for column, values, shift in zip(
        (ensemble.lon, ensemble.lat), (drawn.lon, drawn.lat), scatter, strict=True
    ):
        column.from_numpy(np.repeat(values, count) + sphere.to_binary(shift))
    ensemble.release.from_numpy(np.repeat(release, count).astype(np.int32))
    ensemble.world.from_numpy(np.repeat(np.arange(worlds, dtype=np.int32), count))
    objects.share(ensemble, drawn.current_east, drawn.current_north)
    scene = Scene(
        Forcing([Sources({"current": (source,)})], 1),
        (Motion(DRIFT, kernel.Physics(diffusivity=DIFFUSIVITY)),),
        kernel.Surroundings(EVERYWHERE, bias=True),
    )
    order = sorted(SEEN)
    clock = Clock(T0, order[-1][0], 1, 1800)
    log_weight = np.zeros(worlds)
    for moment, (_, x, y) in zip(
        simulate.run(ensemble, scene, clock, np.array([seen[0] for seen in order])),
        order,
        strict=True,
    ):
        east, north = (c * (360 / sphere.TURN) * DEGREE for c in (moment.lon, moment.lat))
        near = np.exp(-((east - x) ** 2 + (north - y) ** 2) / (2 * RADIUS**2))
        near[moment.status != Status.ADRIFT] = 0
        with np.errstate(divide="ignore"):
            log_weight += np.log(near.reshape(worlds, count).mean(1))
    scene.forcing.close()
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    unknown = np.stack(
        [
            drawn.lon * (360 / sphere.TURN) * DEGREE,
            drawn.lat * (360 / sphere.TURN) * DEGREE,
            release,
        ]
    )
    mean = unknown @ weight
    return mean, np.sqrt((weight**2 * (unknown - mean[:, None]) ** 2).sum(1))


RUN = {"worlds": 500, "per_find": 60, "cells": 40, "times": 12}


def origin(
    case: Case, where: Environment, cut: Segments | None, stretch: list[int], **fine: int
) -> backward.Origin:
    """Return where a case's spill may have come from; fine: the resolution."""
    assert case.spill is not None
    spec, clock = run_setup.ensemble_spec(case), run_setup.clock_spec(case)
    return backward.estimate_origin(
        case.spill, spec, clock, where, cut, stretch, backward.Resolution(**fine)
    )


@pytest.mark.thorough
def test_backward_and_forward_agree_with_the_closed_form_where_the_flow_converges(
    tmp_path, monkeypatch
) -> None:
    """Within three standard errors, two finds sharing an error of the current; a plume without the
    weight is not.
    """
    case = case_of(tmp_path, SPILL + "".join(at_sea(*seen) for seen in SEEN))
    where = environment(converging())
    truth = exact(SEEN)
    found = origin(case, where, None, [-1, -1], **RUN)
    mean, error, std = figures(found)
    ahead, ahead_error = forward(case, converging(), 2500, 40)
    monkeypatch.setattr(
        backward.advance,
        "Surroundings",
        lambda *a, place=kernel.Surroundings, **k: place(*a, **{**k, "divergence": False}),
    )
    plain, plain_error, _ = figures(
        origin(case, where, None, [-1, -1], **RUN | {"worlds": 200, "cells": 24})
    )
    print("exact", truth.mean, truth.std)
    print("backward", mean, error, std, found.effective)
    print("forward", ahead, ahead_error)
    print("plain", plain, plain_error)
    assert (np.abs(mean - truth.mean) < 3 * error).all()
    assert (np.abs(ahead - truth.mean) < 3 * ahead_error).all()
    assert (np.abs(mean - ahead) < 3 * np.hypot(error, ahead_error)).all()
    assert std == pytest.approx(truth.std, rel=0.05)
    assert (error < 0.12 * truth.std).all()  # sharp enough to mean something
    # In this flow the weight is exp(2 k age) at all places: without it late releases, whose plumes
    # spread less, win.
    assert abs(plain[2] - truth.mean[2]) > 3 * np.hypot(plain_error[2], error[2])
    assert found.probability.shape == found.prior.shape == (12, found.lat.size, found.lon.size)
    assert found.probability.sum() == pytest.approx(1)
    assert found.prior.sum() == pytest.approx(1)


@pytest.mark.thorough
def test_finds_multiply_within_a_world_not_between_averages(tmp_path) -> None:
    """Averages over worlds multiplied are the posterior of finds that share no error of the
    current: another one.
    """
    case = case_of(tmp_path, SPILL + "".join(at_sea(*seen) for seen in SEEN))
    assert case.spill is not None
    where, run = environment(converging()), RUN | {"worlds": 300}
    alone = [
        origin(replace(case, spill=replace(case.spill, finds=(find,))), where, None, [-1], **run)
        for find in case.spill.finds
    ]
    prior = alone[0].prior
    both = np.divide(
        alone[0].probability * alone[1].probability,
        prior,
        out=np.zeros_like(prior),
        where=prior > 0,
    )
    both /= both.sum()
    axes = (alone[0].lon * DEGREE, alone[0].lat * DEGREE, alone[0].time.astype(np.int64) - T0)
    mean = np.array(
        [(both.sum(k) * axis).sum() for k, axis in zip(((0, 1), (0, 2), (1, 2)), axes, strict=True)]
    )
    error = np.hypot(alone[0].error, alone[1].error)
    shared, apart = exact(SEEN), exact(SEEN, shared=False)
    print(mean, error, shared.mean, apart.mean)
    assert (np.abs(mean - apart.mean) < 3 * error).all()
    assert abs(mean[2] - shared.mean[2]) > 6 * error[2]


JAGGED = np.concatenate([[-1.4], np.arange(-1.0, 1.0, 0.004), [1.4]])
COAST_RATE, REMOVAL, SPEED, SHORE_D = 0.5 / 86_400, 0.1 / 86_400, 0.1, 20.0
FOUND = 100 * HOUR
ASHORE = (
    SPILL[: SPILL.index("[[current]]")].replace(f"{DIFFUSIVITY} m2/s", f"{SHORE_D} m2/s")
    + f"""
[[current]]
name = "onshore"
constant = {{ east = "{SPEED} m/s", north = "0 m/s" }}
[spill]
objects = 1
worlds = 50
windage_bias = 0
area = {{ polygon = [[-0.30, -0.1], [-0.02, -0.1], [-0.02, 0.15], [-0.30, 0.15]], until = "+72 h" }}
reporting = {{ rate = {{ wild = "0.5 /day" }}, removal = "0.1 /day" }}
[[spill.class]]
name = "drum"
object = "water"
[[find]]
stretch = "STRETCH"
time = "+{FOUND // HOUR} h"
"""
)


def straight() -> shoreline.Coast:
    """Return land east of lon 0 with a straight shore."""
    shape = shapely.Polygon([(1.4, 1.4), (1.4, -1.4), *[(0.0, lat) for lat in JAGGED]])
    return shoreline.build_coast(
        Shore(np.array([shape], object), "test", (), BOX), Box(-1.2, -1.2, 1.2, 1.2)
    )


@pytest.mark.thorough
@pytest.mark.parametrize("count", [1, pytest.param(4, marks=pytest.mark.thorough)])
def test_finds_ashore_tell_the_release_by_the_law_of_arrivals(tmp_path, count: int) -> None:
    """Arrivals at a straight shore follow the inverse Gaussian law, waits the exponential:
    quadrature over both.

    Finds of one stretch and time that share no error multiply the same likelihood.
    """
    coast = straight()
    cut = segments.cut_coast(coast, 10_000.0)
    on, _ = segments.nearest_segment(cut, coast, 0.0, 0.04)
    text = ASHORE.replace("STRETCH", cut.name[on]).replace("objects = 1", f"objects = {count}")
    case = case_of(tmp_path, text + (count - 1) * text[text.index("[[find]]") :])
    found = origin(
        case, environment(sources.constant_field("current", SPEED, 0.0), coast), cut, count * [on],
        worlds=200, per_find=400, cells=24, times=12,
    )  # fmt: skip
    edge = shoreline.shoreline_edges(coast)[cut.of_edge == on]
    south, north = np.sort(edge[:, [1, 3]].ravel())[[0, -1]] * (360 / sphere.TURN) * DEGREE
    away, y0 = -found.lon * DEGREE, found.lat * DEGREE
    arrival = (np.arange(800) + 0.5) * FOUND / 800
    weight = np.exp(-(COAST_RATE + REMOVAL) * (FOUND - arrival))
    times = found.time.astype(np.int64) - T0
    chance = np.zeros((times.size, y0.size, away.size))
    for k, t in enumerate(times):
        age = arrival[arrival > t] - t
        law = stats.invgauss(2 * SHORE_D / (SPEED * away), scale=away**2 / (2 * SHORE_D)).pdf(
            age[:, None]
        )
        spread = np.sqrt(2 * SHORE_D * age)[:, None]
        along = stats.norm.cdf((north - y0) / spread) - stats.norm.cdf((south - y0) / spread)
        chance[k] = np.einsum("a,ax,ay->yx", weight[arrival > t], law, along)
    chance = found.prior * (chance / chance.max()) ** count
    chance /= chance.sum()
    expected = np.array(
        [
            -(chance.sum((0, 1)) * away).sum(),
            (chance.sum((0, 2)) * y0).sum(),
            (chance.sum((1, 2)) * times).sum(),
        ]
    )
    mean, error, std = figures(found)
    # Kernels of width h that keep mean and variance change a density of standard deviation s by a
    # share h^2 / (2 s^2) times a function of place that is 0 for a normal density and otherwise of
    # order one. The mean shifts by as large a share of s at most, find by find. The shore, at which
    # tracks begin, leaves about 100 of 400 particles, so the share is 1 / (2 sqrt(100)), 5 %, and
    # this law has up to two thirds of it. By Silverman's rule for one world it is 11 %.
    smoothing = 0.033 * count * std
    assert (np.abs(mean - expected) < 3 * error + smoothing).all()
    assert (3 * error + smoothing < 0.055 * count * std).all()


def test_what_may_have_sunk_came_from_near(tmp_path) -> None:
    """With the same tracks a half-life multiplies each release time by 2^-(age / half-life), find
    by find.
    """
    text = SPILL.replace(f"{WINDOW // HOUR} h", "6 h") + "".join(at_sea(*seen) for seen in SEEN)
    where = environment(converging())
    origins = [
        origin(
            case_of(tmp_path, said),
            where,
            None,
            [-1, -1],
            worlds=50,
            per_find=40,
            cells=24,
            times=6,
        )
        for said in (
            text,
            text.replace('object = "water"', 'object = "water"\nsinking = { half_life = "5 h" }'),
        )
    ]
    ages = sum(T0 + seen[0] - origins[0].time.astype(np.int64) for seen in SEEN)
    expected = origins[0].probability * np.exp2(-ages / (5 * HOUR))[:, None, None]
    # float32 densities
    assert origins[1].probability == pytest.approx(expected / expected.sum(), rel=1e-4, abs=1e-9)


def test_a_patrol_that_misses_nothing_rules_out_earlier_landings(tmp_path) -> None:
    """Arrivals before it are out: releases after it keep their odds, and those long before lose
    theirs.
    """
    coast = straight()
    cut = segments.cut_coast(coast, 10_000.0)
    on, _ = segments.nearest_segment(cut, coast, 0.0, 0.04)
    text, passed = ASHORE.replace("STRETCH", cut.name[on]), 50 * HOUR
    patrol = f'[[patrol]]\nname = "p"\nstretches = ["{cut.name[on]}"]\ntime = "+{passed // HOUR} h"\ndetection = 1\n'
    where = environment(sources.constant_field("current", SPEED, 0.0), coast)
    before, after = (
        origin(
            case_of(tmp_path, said), where, cut, [on], worlds=50, per_find=100, cells=20, times=9
        )
        for said in (text, text + patrol)
    )
    late = before.time.astype(np.int64) - T0 > passed
    ratio = after.probability[late].sum((1, 2)) / before.probability[late].sum((1, 2))
    assert 1.05 < ratio[0] == pytest.approx(ratio, rel=1e-4)
    assert after.probability[0].sum() < 0.9 * before.probability[0].sum()


def test_classes_that_drift_alike_are_one_class(tmp_path) -> None:
    """A find of unknown class is the mixture of its classes by their shares."""
    twice = SPILL[: SPILL.index("[[spill.class]]")] + "".join(
        f'[[spill.class]]\nname = "{name}"\nshare = {share}\nobject = "water"\n'
        for name, share in (("drum", 0.3), ("box", 0.7))
    )
    run = {"worlds": 200, "per_find": 60, "cells": 40, "times": 6}
    one, two = (
        origin(
            case_of(tmp_path, text + at_sea(*SEEN[0])),
            replace(environment(converging()), scenarios=(Sources({"current": (converging(),)}),) * classes),
            None, [-1], **run,
        )
        for classes, text in ((1, SPILL), (2, twice))
    )  # fmt: skip
    (mean, error, _), (other, other_error, _) = figures(one), figures(two)
    assert (np.abs(mean - other) < 3 * np.hypot(error, other_error)).all()


def test_figures_and_dataset_say_what_the_grid_says(tmp_path) -> None:
    lon, lat = np.linspace(-0.2, 0.2, 41), 50 + np.linspace(-0.3, 0.3, 61)
    time = T0 + HOUR * np.arange(10)
    east = (lon[None] + 0 * lat[:, None]) * DEGREE * np.cos(np.radians(50))
    north = (lat[:, None] - 50 + 0 * lon[None]) * DEGREE
    place = (
        np.exp(-((east / 3000) ** 2 + (north / 3000) ** 2) / 2) * np.cos(np.radians(lat))[:, None]
    )
    chance = np.ones((10, 1, 1)) * place / place.sum() / 10
    release = backward.Origin(
        lon, lat, time.astype("datetime64[s]"), chance, chance, (0.0, 50.0, T0 + 4.5 * HOUR),
        (3000.0, 3000.0, 10_000.0), (1.0, 1.0, 1.0), 10, 5.0,
    )  # fmt: skip
    said = backward.summary_of_origin(release)
    # A circular normal holds 1 - exp(-r^2 / 2 s^2); cells are 0.8 by 1.1 km.
    for share in (50, 90):
        radius = 3 * np.sqrt(-2 * np.log1p(-share / 100))
        assert said[f"radius_{share}_km"] == pytest.approx(radius, abs=0.6)
        assert said[f"area_{share}_km2"] == pytest.approx(np.pi * radius**2, rel=0.08)
    begin = np.datetime64(T0 - HOUR // 2, "s")
    for share in (10, 50, 90):
        assert said[f"time_{share}"] == f"{begin + np.timedelta64(share * HOUR // 10, 's')}Z"
    words = text.origin_facts(said)
    radius = said["radius_50_km"]
    assert words["half within"] == f"{radius / 1.852:.2f} nmi ({radius:.2f} km) of it"
    assert words["mean position"] == "50-00.0N 000-00.0E"
    assert (
        words["standard deviation"] == "1.62 nmi (3.00 km) east, 1.62 nmi (3.00 km) north, 2.78 h"
    )
    assert words["worlds"] == "5 of 10 effective"
    (row,) = csv.DictReader(io.StringIO(text.origin_csv(said, "run-s1")))
    for name, value in said.items():
        assert (
            row[name] == value
            if isinstance(value, str)
            else float(row[name]) == pytest.approx(value, rel=5e-6)
        )
    digits = [
        len(cell.lstrip("-0.").replace(".", "").partition("e")[0])
        for name, cell in row.items()
        if name.endswith(("km", "km2", "_h", "bit"))
    ]
    assert max(digits) <= 6
    data = backward.origin_dataset(release)
    assert float(data["probability"].sum()) == pytest.approx(1)
    assert data["probability"].dims == ("time", "lat", "lon")
    data.to_netcdf(tmp_path / "origin.nc")


def test_finds_that_say_nothing_beyond_the_prior_are_said_to() -> None:
    """The divergence of two normal laws on a fine grid is that of the closed form; below LITTLE
    that is a warning.
    """
    lat = np.linspace(-0.5, 0.5, 2001)
    prior = np.exp(-((lat / 0.1) ** 2) / 2)

    def release(centre: float, width: float) -> backward.Origin:
        chance = np.exp(-(((lat - centre) / width) ** 2) / 2)
        shares = [(law / law.sum()).reshape(1, -1, 1) for law in (prior, chance)]
        time = np.array([T0], "datetime64[s]")
        return backward.Origin(
            np.zeros(1),
            lat,
            time,
            *shares,
            (0.0, 0.0, float(T0)),
            (1.0, 1.0, 1.0),
            (1.0, 1.0, 1.0),
            500,
            400.0,
        )

    for centre, width in ((0.0, 0.1), (0.03, 0.09), (0.1, 0.05)):
        ratio, shift = width / 0.1, centre / 0.1
        exact = ((ratio**2 + shift**2 - 1) / 2 - np.log(ratio)) / np.log(2)
        told = release(centre, width)
        # Cut at five standard deviations: what is beyond holds 6e-7, and says at most 13 nats.
        assert backward.information_gain(told) == pytest.approx(exact, abs=2e-5)
        assert backward.summary_of_origin(told)["information_bit"] == backward.information_gain(
            told
        )
        assert any(
            "next to no information" in words for words in backward.origin_warnings(told)
        ) == (exact < backward.LITTLE)


def test_finds_that_no_release_leads_to_are_refused_by_name(tmp_path) -> None:
    where = environment(sources.constant_field("current", 0.5, 0.0))
    text = SPILL.replace(f"{WINDOW // HOUR} h", "6 h")
    with pytest.raises(UserError, match="no finds"):
        origin(case_of(tmp_path, text), where, None, [])
    lost = case_of(tmp_path, text + at_sea(60 * HOUR, 100_000.0, 140_000.0))
    with pytest.raises(UserError, match="find 1: no release"):
        origin(lost, where, None, [-1], worlds=20, per_find=20, cells=20, times=3)
