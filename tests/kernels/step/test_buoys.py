"""Errors that particles share with buoys, against NumPy."""

from typing import Any

import numpy as np
import pytest
from scipy import stats

from drift.engine.particles.status import Status
from geo import sphere
from kernels.runtime import launch, runtime
from kernels.step import buoys

N, BUOYS, STATES, SCENARIOS, MEMBERS, STEPS = 60, 2, 8, 2, 3, 4
PLACE = (179.98, 58.0)
LENGTHS = (9_000.0, 70_000.0)
AHEAD, KEEP, END = 0.4, (0.97, 0.9), 7200
STDS = {"current_std": 0.3, "wind_std": 2.1, "bias_std": 0.07}


def tables(seed: int) -> dict[str, Any]:
    """Return random tables of a run, and particles."""
    random = np.random.default_rng(seed)
    east, north = random.normal(size=(2, N)) * 8000
    lon, lat = (np.degrees(x) for x in sphere.destination(*np.radians(PLACE), east, north))
    there = random.normal(size=(2, STEPS + 1, BUOYS)) * 6000
    x, y = (np.degrees(v) for v in sphere.destination(*np.radians(PLACE), *there))
    factors = np.tril(random.uniform(0.2, 0.9, (STEPS + 1, 2, BUOYS, BUOYS)), -1) + np.eye(BUOYS)
    return {
        "lon": lon,
        "lat": lat,
        "buoy_lon": x,
        "buoy_lat": y,
        "scenario": np.repeat([0, 1], N // 2),
        "member": random.integers(0, MEMBERS, N),
        "z": random.normal(size=(STATES, 2, N)),
        "last": random.uniform(0, 12_000, (BUOYS, N)),  # [m] distances a step ago
        "moves": random.normal(size=(STEPS + 1, STATES, STATES)) / 3,
        "kicks": np.zeros((STEPS + 1, STATES, STATES)),
        "means": random.normal(size=(STEPS + 1, SCENARIOS * MEMBERS, 2, STATES, 2)),
        "mixes": np.linalg.inv(factors),
        "world": random.integers(0, 7, N),
        "own": random.normal(size=(6, N)),
        "status": random.choice(
            [Status.ADRIFT, Status.PENDING, Status.UNDER_WAY, Status.ASHORE], N
        ),
        "release": random.choice([END - 1, END, END + 900], N),
    }


def share(
    given: dict[str, Any], row: int, **numbers: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the deviations (states, 2, n) after a step, the shared rows (6, n), and the errors of
    particles (6, n).
    """
    runtime.start()
    z = np.concatenate([given["z"].reshape(-1, N), given["last"]])
    z = runtime.upload(z.astype(np.float32).ravel())
    shared, own = runtime.empty(6 * N), runtime.upload(given["own"].astype(np.float32).ravel())
    ints = [
        runtime.upload(np.asarray(values, np.int32))
        for values in (
            [100, 400 - N // 2], given["scenario"], given["world"], given["member"],
            given["status"], given["release"],
        )
    ]  # fmt: skip
    lon, lat = (runtime.upload(sphere.to_binary(given[name])) for name in ("lon", "lat"))
    flat = [
        runtime.upload(given[name].astype(np.float32).ravel())
        for name in ("moves", "kicks", "means", "mixes")
    ]
    places = np.stack([sphere.to_binary(given[f"buoy_{name}"]) for name in ("lon", "lat")], axis=-1)
    words = {
        "buoys": BUOYS, "states": STATES, "windy": 1, "biased": 1, **STDS, "current_keep": KEEP[0],
        "wind_keep": KEEP[1], "current_length": LENGTHS[0], "wind_length": LENGTHS[1],
        "members": MEMBERS, "worlds": 0, "begins": 0, "ahead": AHEAD, **numbers,
    }  # fmt: skip
    moves, kicks, means, mixes = flat
    order = runtime.upload(np.tile(np.arange(STATES, dtype=np.int32), STEPS + 1))
    particles = launch.pack(buoys.Particles, *ints[1:], lon, lat, own, z, shared)
    tables = launch.pack(
        buoys.Tables, moves, kicks, order, means, mixes, runtime.upload(places.ravel())
    )
    numbers = buoys.Numbers(**words)
    buoys.share_errors(N, ints[0], particles, tables, numbers, row, 77, END, (5, 9))
    moved = z.to_numpy()[: 2 * STATES * N].reshape(STATES, 2, N)
    return moved, shared.to_numpy().reshape(6, N), own.to_numpy().reshape(6, N)


def expected(given: dict[str, Any], row: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return what `share` should, without noise, in float64."""
    z = np.einsum("ij,jcn->icn", given["moves"][row], given["z"])
    shared, own = np.zeros((6, N)), given["own"].copy()
    for i in range(N):
        x, y = np.radians([given["lon"][i], given["lat"][i]])
        apart = sphere.distance(
            x, y, np.radians(given["buoy_lon"][row]), np.radians(given["buoy_lat"][row])
        )
        apart = np.maximum(apart + AHEAD * (apart - given["last"][:, i]), 0)
        which = given["scenario"][i] * MEMBERS + given["member"][i]
        before = given["means"][row, which, 0] + given["z"][..., i]
        after = given["means"][row, which, 1] + z[..., i]
        begins = given["status"][i] in (Status.PENDING, Status.UNDER_WAY) and (
            given["release"][i] < END
        )
        for kind in (0, 1):
            mix, keep = given["mixes"][row, kind], KEEP[kind]
            alpha = mix @ np.exp(-((apart / LENGTHS[kind]) ** 1.5))
            left = np.sqrt(max(1 - alpha @ alpha, 0))
            part = slice(2 * kind, 2 * kind + 2)
            kick = (after[part] - keep * before[part]) / np.sqrt(1 - keep**2)
            shared[part, i], shared[4 + kind, i] = alpha @ (mix @ kick), left
            if begins:
                std = STDS["wind_std" if kind else "current_std"]
                own[part, i] = std * (alpha @ (mix @ before[part])) + left * own[part, i]
            if begins and not kind:
                own[4:, i] = STDS["bias_std"] * (alpha @ (mix @ before[4:6])) + left * own[4:, i]
    return z, shared, own


@pytest.mark.parametrize("row", [1, 3])
def test_two_buoys_with_wind_and_bias_in_an_ensemble(row: int) -> None:
    given = tables(3)
    own, other = share(given, row), expected(given, row)
    # some thirty roundings of float32, 6e-8 each, of values up to 1, 20 and 5
    np.testing.assert_allclose(own[0], other[0], rtol=0, atol=2e-6)
    np.testing.assert_allclose(own[1][:4], other[1][:4], rtol=0, atol=4e-5)
    np.testing.assert_allclose(own[2], other[2], rtol=0, atol=1e-5)
    changed = (own[2] != given["own"].astype(np.float32)).any(axis=0)
    released = np.isin(given["status"], (Status.PENDING, Status.UNDER_WAY)) & (
        given["release"] < END
    )
    np.testing.assert_array_equal(changed, released)
    # a square root near 0 keeps half of the digits
    np.testing.assert_allclose(own[1][4:] ** 2, other[1][4:] ** 2, atol=2e-5)
    assert (own[1][4] < 1).all()
    assert own[1][4].min() < 0.5 < own[1][4].max()


def test_each_particle_has_noise_of_its_own() -> None:
    given = tables(4) | {"moves": np.zeros((STEPS + 1, STATES, STATES))}
    given["kicks"] = np.tile(np.eye(STATES), (STEPS + 1, 1, 1))
    noise = share(given, 2)[0]
    assert stats.kstest(noise.ravel(), "norm").pvalue > 1e-3
    assert np.unique(noise).size == noise.size
    again = share(given, 2, begins=1)[0]  # the first draw is overwritten by the step's own
    np.testing.assert_array_equal(noise, again)


def test_the_particles_of_a_world_share_their_noise() -> None:
    given = tables(5) | {"moves": np.zeros((STEPS + 1, STATES, STATES))}
    given["kicks"] = np.tile(np.eye(STATES), (STEPS + 1, 1, 1))
    noise = share(given, 1, worlds=1)[0]
    for world in np.unique(given["world"]):
        own = noise[..., given["world"] == world]
        assert (own == own[..., :1]).all()
    assert np.unique(noise[0, 0]).size == np.unique(given["world"]).size


def test_the_first_draw_is_moved_on() -> None:
    """Its root stands in row 0; a step that keeps everything leaves it."""
    given = tables(6) | {"moves": np.tile(np.eye(STATES), (STEPS + 1, 1, 1))}
    given["moves"][0] = 0.0
    given["kicks"] = np.zeros((STEPS + 1, STATES, STATES))
    given["kicks"][0] = np.diag(np.arange(STATES) * 0.5)
    drawn = share(given, 1, begins=1)[0]
    assert (drawn[0] == 0).all()
    for state in range(1, STATES):
        assert stats.kstest(drawn[state].ravel() / (0.5 * state), "norm").pvalue > 1e-4
