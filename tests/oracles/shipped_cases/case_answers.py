"""What drift and the oracle say of a shipped case, and the comparison of both."""

from dataclasses import dataclass

import numpy as np
import oracle
import shipped
from case_draws import World, table
from oracle import Array
from scipy import stats

from drift.case import file as case_file
from drift.engine.particles.status import Status
from drift.pipeline import flow

OURS, THEIRS = 10_000, 2_500  # particles, in all; a scenario
# numbers that the tests compare; three standard errors on each would be exceeded by chance once in
# three files
COMPARED = 170
SIGMAS = stats.norm.isf(
    stats.norm.sf(3.0) / COMPARED
)  # 4.3: all of them together are as sure as three hold one (Bonferroni)
FATES = {
    oracle.ADRIFT: Status.ADRIFT,
    oracle.ASHORE: Status.ASHORE,
    oracle.OUTSIDE: Status.OUTSIDE,
    oracle.SUNK: Status.SUNK,
}


@dataclass(frozen=True)
class Told:
    """Where the particles of one scenario are at the end: places [m] in a plane, what became of
    each, and its world's number.
    """

    places: Array  # (n, 2)
    became: Array  # (n,) of FATES
    world: Array  # (n,) particles of one number are not independent


def theirs(world: World, rng: np.random.Generator, about: tuple[float, float]) -> list[Told]:
    """Return what the oracle says, a scenario each."""
    told = []
    for one in world.clouds:
        lon, lat, became = oracle.run(
            rng,
            one,
            world.duration,
            world.current,
            world.wind,
            world.errors,
            world.coast,
            world.step,
        )
        codes = np.array([FATES[fate] for fate in became])
        told.append(Told(flat(lon, lat, about), codes, np.arange(lon.size)))
    return told


def flat(lon: Array, lat: Array, about: tuple[float, float]) -> Array:
    """Return positions [deg] in an even-distance plane about one [m], shape (n, 2)."""
    scale = oracle.R * np.pi / 180
    return np.stack(
        [(lon - about[0]) * scale * np.cos(np.radians(about[1])), (lat - about[1]) * scale], axis=1
    )


def ours(
    name: str, about: tuple[float, float], settings: dict[str, str]
) -> tuple[list[Told], list[Array]]:
    """Return what drift.run says without finds, and the weights of its particles, by scenario."""
    spill = "spill" in table(name)
    few = {"spill.worlds": "1000", "spill.per_world": "20"} if spill else {"particles": str(OURS)}
    output = '{ every = "100 d", trajectories = 1_000_000 }'
    loaded = case_file.load(name, few | {"find": "[]", "output": output} | settings)
    result = flow.run(loaded)
    if name in shipped.COMPARED:
        assert shipped.misses(result) == []
    tracks = result.trajectories
    told, weights = [], []
    for number in range(len(loaded.scenarios)):
        here = tracks.scenario == number
        lon, lat = (x[here, -1].astype(float) * 360 / 2**32 for x in (tracks.lon, tracks.lat))
        slot = tracks.slot[here] - tracks.slot[here].min()
        # a class has its particles world after world
        world = slot // (len(slot) // 1000) if spill else slot
        told.append(Told(flat(lon, lat, about), tracks.status[here, -1], world))
        weights.append(tracks.weight[here, -1].astype(float))
    return told, weights


def mean_and_error(values: Array, world: Array) -> tuple[Array, Array]:
    """Return the mean of columns and its standard error between worlds, shape (k,)."""
    count = np.bincount(world)
    sums = np.stack([np.bincount(world, column) for column in values.T], axis=1)[count > 0]
    count = count[count > 0]
    mean = sums.sum(axis=0) / count.sum()
    left = sums - count[:, None] * mean
    return mean, np.sqrt((left**2).sum(axis=0)) / count.sum()


def numbers(told: Told) -> tuple[Array, Array]:
    """Return shares adrift, ashore, outside, sunk; mean place; second moments about it; and their
    standard errors.
    """
    shares = mean_and_error(
        np.stack([told.became == fate for fate in FATES.values()], axis=1) + 0.0, told.world
    )
    there = (told.became == Status.ADRIFT) | (told.became == Status.ASHORE)
    xy, world = told.places[there], told.world[there]
    mean = mean_and_error(xy, world)
    x, y = (xy - mean[0]).T
    second = mean_and_error(np.stack([x * x, y * y, x * y], axis=1), world)
    return np.concatenate([shares[0], mean[0], second[0]]), np.concatenate(
        [shares[1], mean[1], second[1]]
    )


NAMES = (
    "adrift",
    "ashore",
    "outside",
    "sunk",
    "mean east",
    "mean north",
    "variance east",
    "variance north",
    "covariance",
)


def agrees(ours: list[Told], theirs: list[Told]) -> None:
    """Shares, means and second moments by scenario; no room beside standard errors of the
    difference.
    """
    for a, b in zip(ours, theirs, strict=True):
        (here, e), (there, f) = numbers(a), numbers(b)
        apart = (here - there) / np.maximum(np.hypot(e, f), 1e-300)
        told = [
            f"{NAMES[k]}: {here[k]:.5g}, oracle {there[k]:.5g}: {z:+.1f} errors"
            for k, z in enumerate(apart)
        ]
        assert (np.abs(apart[here != there]) < SIGMAS).all(), told
