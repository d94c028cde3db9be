"""Release from finds: the weight that divergence asks for, and backward against forward against
closed forms.
"""

from dataclasses import replace

import numpy as np
import pytest
from release_backward import (
    CONVERGENCE,
    DEGREE,
    DIFFUSIVITY,
    EVERYWHERE,
    HOUR,
    RADIUS,
    RUN,
    SCATTER,
    SEEN,
    SPILL,
    T0,
    WINDOW,
    at_sea,
    case_of,
    converging,
    environment,
    exact,
    figures,
    origin,
)

from drift.case.record import Case
from drift.engine.motion import simulate
from drift.engine.motion.clock import Clock
from drift.engine.motion.forcing import Forcing, Sources
from drift.engine.motion.models.drift import COLUMNS, DRIFT
from drift.engine.motion.models.model import Motion
from drift.engine.motion.scene import Scene
from drift.engine.particles import ensemble as record
from drift.engine.particles.status import Status
from drift.spills.backtrack import backward
from drift.spills.worlds import release as objects
from drift.spills.worlds import worlds as drawn_worlds
from geo import sphere
from geo.errors import UserError
from geo.forcing import sources
from geo.forcing.sources import Source
from kernels.step import advance as kernel


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


@pytest.mark.thorough
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


@pytest.mark.thorough
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


def test_finds_that_no_release_leads_to_are_refused_by_name(tmp_path) -> None:
    where = environment(sources.constant_field("current", 0.5, 0.0))
    text = SPILL.replace(f"{WINDOW // HOUR} h", "6 h")
    with pytest.raises(UserError, match="no finds"):
        origin(case_of(tmp_path, text), where, None, [])
    lost = case_of(tmp_path, text + at_sea(60 * HOUR, 100_000.0, 140_000.0))
    with pytest.raises(UserError, match="find 1: no release"):
        origin(lost, where, None, [-1], worlds=20, per_find=20, cells=20, times=3)
