"""Found debris by brute force: pairs of an object and its debris in float64 NumPy, none of them
guided.

Nothing of drift, geo or kernels is used. The flow is uniform in space and linear in time between
rows; errors of current and wind are Ornstein-Uhlenbeck processes that both of a pair share, moved
by their exact integrals (oracle.py). Debris has plain windage. Pairs whose debris would
never come near the find if there were no coast are dropped before a coast is asked: at no end of a
step, since debris that passed the find may have stranded beside it.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import oracle
from oracle import DEG, JIBES, Array, Coast, R

BEYOND = 6.0  # standard deviations of a find; the program's normal ends there


@dataclass(frozen=True)
class Setup:
    """What all pairs go through; times are seconds after the release."""

    lon: float  # [deg] of the report
    lat: float
    std: float  # [m] of a component of the release
    found_lon: float
    found_lat: float
    found_std: float  # [m] of a component
    time: float  # [s] of the find
    current: Callable[[float], tuple[float, float]]  # [m/s] at a time
    wind: Callable[[float], tuple[float, float]]
    current_error: tuple[float, float]  # [m/s], [s]
    wind_error: tuple[float, float]
    windage: tuple[float, float]  # of the debris: mean and standard deviation
    coast: Coast | None = None
    step: float = 600.0


@dataclass
class Sums:
    """What is left of pairs: how many there were, and those whose debris was found."""

    pairs: int = 0
    weight: list[Array] = field(default_factory=list)  # [1/m2] likelihood of the find
    # [deg] (kinds, 2, k) of the objects at the time of the find
    places: list[Array] = field(default_factory=list)


def interpolated(rows: list[tuple[float, float, float]]) -> Callable[[float], tuple[float, float]]:
    """Return a flow linear in time between rows of time [s], east and north [m/s]."""
    time, east, north = (np.array(column) for column in zip(*rows, strict=True))
    return lambda t: (float(np.interp(t, time, east)), float(np.interp(t, time, north)))


def add_pairs(
    sums: Sums, rng: np.random.Generator, n: int, setup: Setup, rows: list[dict[str, float]]
) -> None:
    """Draw n releases with their errors and debris, and add those that are found, each with an
    object of every row.

    rows: of the leeway table. Debris is first moved on a flat sea without a coast, by sums of its
    errors; only what comes near the find, at its time or before, is moved step by step on the
    sphere, with its objects.
    """
    lon, lat = oracle.moved(
        np.full(n, setup.lon), np.full(n, setup.lat), *(setup.std * rng.standard_normal((2, n)))
    )
    if setup.coast is not None:
        dry = setup.coast.on_land(lon, lat)
        lon, lat, n = lon[~dry], lat[~dry], int((~dry).sum())
    sums.pairs += n
    slope = setup.windage[0] + setup.windage[1] * rng.standard_normal(n)
    while (low := slope < 0).any():
        slope[low] = setup.windage[0] + setup.windage[1] * rng.standard_normal(low.sum())
    begins = np.arange(0, setup.time, setup.step)
    ends = np.minimum(begins + setup.step, setup.time)
    processes = [_Process(rng, n, *setup.current_error), _Process(rng, n, *setup.wind_error)]
    kept = np.empty((len(begins), 4, n), np.float32)
    flat, near = np.zeros((2, n)), np.zeros(n, bool)
    for k, (begin, end) in enumerate(zip(begins, ends, strict=True)):
        kept[k, :2], kept[k, 2:] = (process.mean_over(end - begin) for process in processes)
        u, a = (np.array(_mean(flow, begin, end))[:, None] for flow in (setup.current, setup.wind))
        flat += (end - begin) * (u + kept[k, :2] + slope * (a + kept[k, 2:]))
        if setup.coast is not None or k == len(begins) - 1:
            x, y = oracle.moved(lon, lat, *flat)
            reach = BEYOND * setup.found_std * np.sqrt(2) + 0.02 * np.hypot(*flat) + 300
            near |= np.hypot(*_apart(setup, x, y)) < reach
    if near.any():
        _add_found(
            sums,
            rng,
            setup,
            rows,
            np.stack([lon, lat])[:, near],
            slope[near],
            kept[:, :, near],
            begins,
            ends,
        )


class _Process:
    """Ornstein-Uhlenbeck errors east and north, of n pairs: the mean over a step and its end, drawn
    together.

    Gillespie 1996, doi:10.1103/PhysRevE.54.2084, eqs. 2.12-2.13.
    """

    def __init__(self, rng: np.random.Generator, n: int, std: float, time: float) -> None:
        self.rng, self.std, self.time = rng, std, time
        self.now = std * rng.standard_normal((2, n), np.float32)

    def mean_over(self, h: float) -> Array:
        """Go on by h [s], and return the mean over it."""
        a = np.exp(-h / self.time)
        variance, both = self.std**2 * (1 - a * a), self.std**2 * self.time * (1 - a) ** 2
        whole = self.std**2 * self.time**2 * (2 * h / self.time - 3 + 4 * a - a * a)
        first, second = self.rng.standard_normal((2, *self.now.shape), np.float32)
        rest = np.sqrt(max(whole - both**2 / variance, 0))
        integral = np.float32(self.time * (1 - a)) * self.now
        integral += np.float32(both / np.sqrt(variance)) * first + np.float32(rest) * second
        self.now = np.float32(a) * self.now + np.float32(np.sqrt(variance)) * first
        return integral / np.float32(h)


def _add_found(sums, rng, setup, rows, place, slope, kept, begins, ends):
    """Move debris that comes near the find, and an object of each row, step by step with the coast;
    add what is found.
    """
    n = slope.size
    lines = [oracle.lines(rng, n, row) for row in rows]
    sides = [rng.choice([-1, 1], n) for _ in rows]
    every = [place.copy() for _ in range(1 + len(rows))]
    stopped = [np.zeros(n, bool) for _ in every]
    for k, (begin, end) in enumerate(zip(begins, ends, strict=True)):
        asked = [(slope, None, None)]
        for number, (down, right, left) in enumerate(lines):
            turns = rng.poisson(JIBES * (end - begin), n) % 2 == 1
            sides[number] = np.where(turns, -sides[number], sides[number])
            asked.append((None, down, np.where(sides[number] > 0, right, left)))
        for which, still, own in zip(every, stopped, asked, strict=True):
            new = np.stack(_stepped(*which, setup, begin, end, kept[k].astype(np.float64), *own))
            part = np.ones(n)
            if setup.coast is not None:
                met = setup.coast.first_met(*which, *new)
                part = np.where(np.isfinite(met), met, 1.0)
            part = np.where(still, 0.0, part)
            which += part * (new - which)
            still |= part < 1
    east, north = _apart(setup, *every[0])
    own = setup.found_std
    weight = np.exp(-(east**2 + north**2) / (2 * own**2)) / (2 * np.pi * own**2)
    weight[(np.abs(east) > BEYOND * own) | (np.abs(north) > BEYOND * own)] = 0
    found = weight > 0
    sums.weight.append(weight[found])
    sums.places.append(np.stack(every[1:])[:, :, found])


def _apart(setup: Setup, lon: Array, lat: Array) -> tuple[Array, Array]:
    """Return how far east and north of the find places are [m]: flat, within some km of it."""
    return (lon - setup.found_lon) * DEG * R * np.cos(0.5 * (lat + setup.found_lat) * DEG), (
        lat - setup.found_lat
    ) * DEG * R


def _stepped(lon, lat, setup, begin, end, errors, slope, down, across):
    """Return places after a step: of debris with a windage, or of an object with leeway lines."""
    h, t = end - begin, 0.5 * (begin + end)
    u, v = _mean(setup.current, begin, end)
    u, v = u + errors[0], v + errors[1]
    if slope is not None:
        a, b = _mean(setup.wind, begin, end)
        a, b = a + errors[2], b + errors[3]
        u, v = u + slope * a, v + slope * b
    else:
        a, b = setup.wind(t)
        a, b = a + errors[2], b + errors[3]
        speed = np.hypot(a, b) + 1e-12
        along, off = down[0] * speed + down[1], across[0] * speed + across[1]
        u, v = u + (a * along + b * off) / speed, v + (b * along - a * off) / speed
    north = lat + v * h / (R * DEG)
    return lon + u * h / (R * DEG * np.cos(0.5 * (lat + north) * DEG)), north


def _mean(flow, begin, end):
    """Return the mean of a flow over a step: Simpson's rule, exact but where a row lies inside."""
    a, b, c = (flow(t) for t in (begin, 0.5 * (begin + end), end))
    return tuple((p + 4 * q + r) / 6 for p, q, r in zip(a, b, c, strict=True))


@dataclass(frozen=True)
class Told:
    """What sums say: evidence [1/m2], mean place [deg] and covariance [m2] of the object, with
    standard errors.
    """

    evidence: float
    evidence_error: float
    effective: float
    mean: Array  # (2,) [deg]
    mean_error: Array  # (2,) [m]
    covariance: Array  # (2, 2) [m2]
    covariance_error: Array


def told(weight: Array, lon: Array, lat: Array, pairs: float) -> Told:
    """Return what weighted places say of all pairs, those without weight included."""
    total = weight.sum()
    share = weight / total
    mean = np.array([share @ lon, share @ lat])
    metres = np.array([DEG * R * np.cos(mean[1] * DEG), DEG * R])[:, None]
    off = (np.stack([lon, lat]) - mean[:, None]) * metres
    covariance = (share * off) @ off.T
    squares = off[:, None] * off[None] - covariance[..., None]
    spread = (weight**2).sum() / pairs - (total / pairs) ** 2
    return Told(
        total / pairs, float(np.sqrt(max(spread, 0) / pairs)), float(total**2 / (weight**2).sum()),
        mean, np.sqrt((share**2 * off**2).sum(axis=1)), covariance, np.sqrt((share**2 * squares**2).sum(axis=2)),
    )  # fmt: skip
