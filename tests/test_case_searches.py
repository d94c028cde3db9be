"""Shipped cases and their sorties against a second opinion in plain float64
(tests/oracles/second_opinions/oracle.py).
"""

import itertools
from dataclasses import replace

import numpy as np
import oracle
import pytest
import shapely
from case_answers import FATES, NAMES, SIGMAS, Told, agrees, flat, ours
from case_draws import World, start, table
from case_worlds import world_of
from oracle import Array, Cloud, Errors, Field

from drift.case import file as case_file
from drift.engine.particles.status import Status


def searched(
    name: str, world: World, rng: np.random.Generator, about: tuple[float, float]
) -> tuple[list[Told], list[Array]]:
    """Return what the oracle says of a case with its sorties: particles, and by scenario the chance
    that each was missed.

    How the sorties were flown (turning points, times, sweep widths by the tables) is the case's;
    what they say is not.
    """
    loaded, begin = case_file.load(name), start(name)
    origin = float((begin - np.datetime64(0, "s")) / np.timedelta64(1, "s"))
    told, chances = [], []
    for number, one in enumerate(world.clouds):
        tracks: list[Array] = []
        lon, lat, became = oracle.run(
            rng,
            one,
            world.duration,
            world.current,
            world.wind,
            world.errors,
            world.coast,
            world.step,
            tracks,
        )
        places, chance = np.array(tracks), np.ones(lon.size)
        for sortie in loaded.sorties:
            if sortie.legs is None:
                first, last = (
                    (t - begin) / np.timedelta64(1, "s") for t in (sortie.start, sortie.end)
                )
                shape, times = shapely.Polygon(sortie.area.ring), np.linspace(first, last, 41)
                within = np.zeros(lon.size)
                for t in 0.5 * (times[:-1] + times[1:]):
                    k = int(t // world.step)
                    x, y = places[k] + (t / world.step - k) * (places[k + 1] - places[k])
                    within += shapely.contains_xy(shape, x, y) / 40
                chance *= np.exp(-sortie.coverage[number] * within)
                continue
            time = np.array(sortie.legs.time) - origin
            unit, searching = (
                np.stack([sortie.legs.lon, sortie.legs.lat], axis=1),
                np.array(sortie.legs.searching),
            )
            if sortie.frame == "datum":
                time, unit, searching = drifting(world, time, unit, searching, sortie.datum)
            spread = 0.0 if np.isinf(sortie.shape) else sortie.shape**-0.5
            chance *= oracle.missed(
                oracle.exposure(places, world.step, time, unit, searching),
                sortie.sweep_width[number],
                spread,
            )
        codes = np.array([FATES[fate] for fate in became])
        chances.append(np.where(codes == Status.OUTSIDE, 1.0, chance))
        told.append(Told(flat(lon, lat, about), codes, np.arange(lon.size)))
    return told, chances


def drifting(
    world: World, time: Array, unit: Array, searching: Array, datum: tuple[float, float]
) -> tuple[Array, Array, Array]:
    """Return turning points, more of them, of legs that drift as water does from a datum."""
    fine = np.unique(np.concatenate([time, np.linspace(time[0], time[-1], 33)]))
    still = np.zeros((2, 1))
    marker = [np.array(datum)]
    for a, b in itertools.pairwise(fine):
        x, y = (np.array([one]) for one in marker[-1])
        cloud = Cloud(
            x, y, np.array([a]), still, still, still, np.ones(1), still, np.full(1, np.inf)
        )
        shifted: Field = lambda t, lon, lat, a=a: world.current(t + a, lon, lat)  # noqa: E731
        end = oracle.run(
            np.random.default_rng(0), replace(cloud, release=np.zeros(1)), b - a, shifted, None,
            Errors((0, 1), (0, 1)), None, b - a,
        )  # fmt: skip
        marker.append(np.array([end[0][0], end[1][0]]))
    way = np.array(marker) - np.array(datum)
    points = np.stack([np.interp(fine, time, one) for one in unit.T], axis=1) + way
    return (
        fine,
        points,
        searching[np.searchsorted(time, 0.5 * (fine[:-1] + fine[1:]), side="right") - 1],
    )


def posterior(told: list[Told], weights: list[Array]) -> tuple[Array, Array]:
    """Return shares, mean, second moments, and posteriors of the scenarios, with their standard
    errors.

    Ratios of weighted sums, so linearised; scenarios are strata: how many particles each has is not
    left to chance.
    """
    w = np.concatenate(weights)
    w = w / w.sum()
    became, places = (
        np.concatenate([getattr(one, k) for one in told]) for k in ("became", "places")
    )
    stratum = np.repeat(np.arange(len(told)), [one.became.size for one in told])
    there = (became == Status.ADRIFT) | (became == Status.ASHORE)
    mean = (w * there) @ places / (w @ there)
    x, y = (places - mean).T
    fates = np.stack([became == fate for fate in FATES.values()], axis=1)
    stories = np.eye(len(told))[stratum, :-1]  # the last one follows from the others
    found, errors = [], []
    for columns, of in (
        (fates, 1.0),
        (places, there),
        (np.stack([x * x, y * y, x * y], axis=1), there),
        (stories, 1.0),
    ):
        share = w * of
        value = share @ columns / share.sum()
        left = share[:, None] * (columns - value) / share.sum()
        for number in range(len(told)):
            left[stratum == number] -= left[stratum == number].mean(axis=0)
        found.append(value)
        errors.append(np.sqrt((left**2).sum(axis=0)))
    return np.concatenate(found), np.concatenate(errors)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "name", ["overdue_boat", pytest.param("norkyst_raft", marks=pytest.mark.thorough)]
)
def test_case_and_its_sorties_are_what_a_second_opinion_says(
    name: str, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    # As they drift, then given that all sorties failed: shares, mean, second moments and posteriors
    # of the scenarios.
    rng = np.random.default_rng(20_260_602)
    world, about = world_of(name, rng, request, monkeypatch)
    told, chances = searched(name, world, rng, about)
    prior = [
        one["weight"] if len(world.clouds) > 1 else 1.0
        for one in ({"weight": 1} | s for s in table(name)["scenario"])
    ]
    there, f = posterior(told, [p * c / c.size for p, c in zip(prior, chances, strict=True)])
    tracks, here = ours(name, about, {})
    agrees(tracks, told)
    mine, e = posterior(tracks, here)
    apart = (mine - there) / np.maximum(np.hypot(e, f), 1e-300)
    names = (*NAMES, *(one["name"] for one in table(name)["scenario"]))
    lines = [
        f"{names[k]}: {mine[k]:.5g}, oracle {there[k]:.5g}: {z:+.1f} errors"
        for k, z in enumerate(apart)
    ]
    assert (np.abs(apart[mine != there]) < SIGMAS).all(), lines
