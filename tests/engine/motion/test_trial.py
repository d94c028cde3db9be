"""The errors of the steps that "auto" tries are those of whole runs with these steps."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from drift.engine.motion import simulate, step_size
from drift.engine.motion.clock import Clock, off_lattice_times
from drift.engine.motion.forcing import Forcing, Sources
from drift.engine.motion.models.drift import COLUMNS, DRIFT
from drift.engine.motion.models.model import Motion
from drift.engine.motion.scene import Scene
from drift.engine.particles import ensemble as record
from geo import sphere
from geo.forcing.sources import Source
from geo.grids.grid import Grid
from kernels.runtime import runtime
from kernels.step import advance as kernel

EVERYWHERE = kernel.Domain(-(2**31), -(2**30), 2**32 - 1, 2**31)
T0 = 1_795_000_000 // 3600 * 3600
DAY = 86_400
N = 150


def whirls(times: np.ndarray) -> Source:
    """A field of whirls 20 km across that drift and grow."""
    grid = Grid(-2.0, 43.5, 0.02, 0.015, 201, 201)
    lon, lat = grid.lon[None, :], grid.lat[:, None]

    def read(i: int) -> np.ndarray:
        phase = 0.7 * i
        strength = np.float32(1.0 + 0.03 * i)
        u = np.sin(25 * lon + phase) * np.cos(31 * lat - 0.3 * phase)
        v = 0.8 * np.cos(23 * lon - 0.5 * phase) * np.sin(29 * lat + phase)
        return (strength * np.stack([u, v], axis=-1)).astype(np.float32)

    stamps = times.astype("datetime64[s]")
    return Source("current", "whirls", grid, stamps, read, 0.0, (), "")


def scene(
    source: Source, direction: int, physics: kernel.Physics | None = None, bias: bool = False
) -> Scene:
    forcing = Forcing([Sources({"current": (source,)})], direction)
    surroundings = kernel.Surroundings(EVERYWHERE, bias=bias)
    return Scene(forcing, (Motion(DRIFT, physics or kernel.Physics()),), surroundings)


def particles() -> record.Ensemble:
    runtime.start()
    ensemble = record.empty(5, (0, N), COLUMNS)
    rng = np.random.default_rng(7)
    ensemble.lon.from_numpy(sphere.to_binary(rng.uniform(-0.4, 0.3, N)))
    ensemble.lat.from_numpy(sphere.to_binary(45 + rng.uniform(-0.2, 0.3, N)))
    ensemble.release.from_numpy(rng.integers(0, 3 * 3600, N).astype(np.int32))
    return ensemble


@pytest.mark.parametrize(
    "direction", [1, pytest.param(-1, marks=pytest.mark.thorough)], ids=["on", "back"]
)
@pytest.mark.parametrize(
    "times",
    [T0 + 3600 * np.arange(-30, 31, 3), np.sort(T0 + 1800 * np.array([*range(-60, 61, 4), 7, 29]))],
    ids=["3-hourly", "uneven"],
)
def test_errors_of_steps_are_those_of_whole_runs(
    times: np.ndarray, direction: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By runs that share no launch and no slice with another, and with one launch for each step."""
    start = T0 + direction * 1234
    clock = Clock(start, 20 * 3600, direction, 1)
    divisor = 10_800 if times.size == 21 else 1800

    def choose(count: int) -> tuple[step_size.Trial, int]:
        launches: list[int] = []
        advance: Callable[..., object] = Scene.advance

        def counted(*given: object, **more: object) -> object:
            launches.append(1)
            return advance(*given, **more)

        with monkeypatch.context() as changed:
            changed.setattr(Scene, "advance", counted)
            changed.setattr(Scene, "at_once", lambda *given: count)
            place = scene(whirls(times), direction)
            trial = step_size.choose_step(
                particles(), place, clock, divisor, T0, np.inf, 5.0, [times]
            )
            place.forcing.close()
        return trial, len(launches)

    trial, launches = choose(32)
    alone, more = choose(1)
    assert trial == alone
    assert launches < more
    assert len(trial.errors) >= 5
    ends = {step: error_of_ends(times, clock, step) for step in trial.errors}
    for step, error in trial.errors.items():
        assert error >= ends[step] * (1 - 1e-5)
    # between uneven times, places half-way in a step err more than the ends
    if divisor == 10_800:
        assert trial.errors[3600] == pytest.approx(ends[3600], rel=1e-5)


def error_of_ends(times: np.ndarray, clock: Clock, step: int) -> float:
    """Return how far the ends of two whole runs lie apart, with a step and with half of it."""
    places = []
    for size in (step, step // 2):
        breaks = off_lattice_times([times], size, T0)
        own = replace(clock, step=size, phase=T0 % size, breaks=breaks)
        place = scene(whirls(times), clock.direction)
        (end,) = simulate.run(particles(), place, own, np.array([clock.duration]))
        places.append((end.lon * sphere.UNIT, end.lat * sphere.UNIT))
        place.forcing.close()
    days = np.maximum(clock.duration - particles().release.to_numpy(), 3600) / DAY
    return float(np.percentile(sphere.distance(*places[0], *places[1]) / days, 95))


def test_a_trial_leaves_random_motion_out_but_not_the_bias() -> None:
    """By scenes that have none: the same errors of steps. A run and its trial share a kernel."""
    times = T0 + 3600 * np.arange(-30, 31, 3)
    clock = Clock(T0 + 1234, 20 * 3600, 1, 1)
    random = kernel.Physics(0.4, 18_000.0, 0.0, 1.0, 25.0, 1e-4)

    def choose(physics: kernel.Physics, bias: float) -> step_size.Trial:
        place, ensemble = scene(whirls(times), 1, physics, bias > 0), particles()
        for name in ("current_error_east", "current_error_north"):
            ensemble.own[name].fill(0.4 if physics.current_std else 0.0)
        for name in ("current_bias_east", "current_bias_north"):
            ensemble.own[name].fill(bias)
        trial = step_size.choose_step(ensemble, place, clock, 10_800, T0, np.inf, 5.0, [times])
        place.forcing.close()
        return trial

    assert choose(random, 0.0) == choose(kernel.Physics(), 0.0)
    assert choose(random, 0.3) == choose(kernel.Physics(), 0.3)
    assert choose(random, 0.3) != choose(random, 0.0)
    variants = kernel._advance._primal.compiled_kernels
    before = len(variants)
    place = scene(whirls(times), 1, random)
    simulate.run(particles(), place, replace(clock, step=600), np.array([clock.duration]))
    place.forcing.close()
    assert len(variants) == before
