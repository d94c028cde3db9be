"""Beams and sonars among places with losses of their own, against SciPy's interpolation and the
closed form of lambda-sigma.

Of a signal excess that stays the same, nothing is heard in a time T with probability (1 - p)
exp(-rate p T).
"""

import numpy as np
import pyproj
import pytest
from scipy.interpolate import RegularGridInterpolator
from scipy.stats import norm

from geo import sphere
from kernels.planning import beams, stations
from kernels.planning.beams import Beams, Course
from kernels.planning.stations import Swarm, Tables, Ways

GEOD = pyproj.Geod(a=sphere.RADIUS, b=sphere.RADIUS)
RANDOM = np.random.default_rng(21)
RINGS = np.linspace(500.0, 90_000.0, 180)
# (places, rays, rings)
LOSS = 62 + 15 * np.log10(1 + RINGS / 900) + RANDOM.uniform(-7, 7, (4, 6, 1))
GAIN = RANDOM.uniform(-6, 9, (3, 12))  # of beams, by relative bearing
NOISE = RANDOM.uniform(66, 72, (3, 5))  # by bin and true bearing
LEVEL = np.array([[141.0, 148.0], [152.5, 157.0]])
PACE = np.array([0.0, 8.0])
SPREAD, RATE = 6.3, 1 / 2700
WHICH = np.array([[2, 0, 1], [1, 3, 0], [3, 2, 0]])  # of each bin, in no order of weight
WEIGHT = np.array([[0.25, 0.35, 0.4], [0.2, 0.1, 0.7], [0.45, 0.55, 0.0]])
TIME = np.array([0.0, 1700.0, 2900.0, 5100.0])
HERE = (179.83, -41.2)
HEADING = np.array([0.4, 2.9, 5.1])


def binary(degrees: np.ndarray) -> np.ndarray:
    return (
        np.round((np.asarray(degrees) + 180) % 360 * 2**32 / 360 - 2**31)
        .astype(np.int64)
        .astype(np.int32)
    )


def around(table: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Return what a table has at an angle [rad], straight between entries that go round."""
    return np.interp(
        turn % (2 * np.pi), np.linspace(0, 2 * np.pi, table.size + 1), np.append(table, table[0])
    )


def swarm(m: int, scenario: np.ndarray) -> tuple[Swarm, np.ndarray, np.ndarray]:
    """Return particles that lie still, and their ranges [m] and bearings [rad] from the sonar,
    across the antimeridian.
    """
    far, turn = np.random.default_rng(4).uniform([[2e3], [0]], [[85e3], [360]], (2, m))
    lon, lat, _ = GEOD.fwd(np.full(m, HERE[0]), np.full(m, HERE[1]), turn, far)
    columns = (np.repeat(binary(x)[:, None], TIME.size, axis=1) for x in (lon, lat))
    return (
        Swarm(TIME.astype(np.float32), *columns, np.ones((m, TIME.size), np.uint8), scenario),
        far,
        np.radians(turn),
    )


def chances(
    far: np.ndarray, turn: np.ndarray, level: np.ndarray, bin_: int, gain: np.ndarray
) -> np.ndarray:
    """Return the probability that the excess and a fluctuation drawn again are above 0."""
    closed = np.linspace(0, 2 * np.pi, LOSS.shape[1] + 1)
    lost = np.zeros(far.size)
    for place, weight in zip(WHICH[bin_], WEIGHT[bin_], strict=True):
        table = np.vstack([LOSS[place], LOSS[place][:1]])
        lost += weight * RegularGridInterpolator((closed, RINGS), table)(
            np.stack([turn, far], axis=1)
        )
    excess = level - lost - around(NOISE[bin_], turn) + around(gain, turn - HEADING[bin_])
    return norm.cdf(excess / SPREAD)


def tables(gain: np.ndarray, offsets: np.ndarray) -> Tables:
    float32 = (np.asarray(x, np.float32) for x in (gain, NOISE, LEVEL, PACE))
    return Tables(
        LOSS.astype(np.float32), RINGS[0], RINGS[1] - RINGS[0], *float32, SPREAD, RATE, offsets
    )


def agree(log: np.ndarray, p: np.ndarray, lasting: float) -> None:
    """Hold logs of misses of float32 against the closed form, where bearings are right to 1e-5 rad
    and losses to 1e-4 dB.
    """
    expected = np.log1p(-p) - RATE * p * lasting
    assert np.ptp(p) > 0.5
    np.testing.assert_allclose(log, expected, rtol=2e-3, atol=2e-5)


@pytest.mark.parametrize("bin_", range(3))
def test_losses_of_a_beam_are_those_of_all_places_by_their_weights(bin_: int) -> None:
    """Each bin by itself; beams that do not listen then miss everything."""
    scenario = np.arange(300) % 2
    drifting, far, turn = swarm(300, scenario.astype(np.int32))
    listens = np.array([[0, 2, 1], [2, -1, 0], [-1, 1, 2]])  # which gain each beam has in each bin
    course = Course(
        np.full(4, binary(HERE[0])), np.full(4, binary(HERE[1])), HEADING.astype(np.float32), np.ones(3, np.uint8),
        WHICH.astype(np.int32), WEIGHT.astype(np.float32),
    )  # fmt: skip
    offset = np.random.default_rng(9).normal(0, 3, 300).astype(np.float32)
    made = tables(GAIN[0], np.zeros(1, np.float32))
    log = beams.missed(drifting, made, course, Beams(GAIN.astype(np.float32), listens.astype(np.int32)), (bin_, bin_ + 1), offset, 1500.0)  # fmt: skip
    for own, row in zip(log, listens[:, bin_], strict=True):
        if row < 0:
            assert (own == 0).all()
        else:
            agree(
                own,
                chances(far, turn, LEVEL[scenario, 0] + offset, bin_, GAIN[row]),
                TIME[bin_ + 1] - TIME[bin_],
            )


@pytest.mark.parametrize("bin_", range(3))
def test_losses_of_a_way_are_those_of_all_places_by_their_weights(bin_: int) -> None:
    """Of a sonar that listens in one bin alone; for each value of what is unknown."""
    scenario = np.arange(300) % 2
    drifting, far, turn = swarm(300, scenario.astype(np.int32))
    offsets = np.array([-4.2, 0.0, 2.9], np.float32)
    listens = (np.arange(3) == bin_).astype(np.uint8)
    ways = Ways(
        np.full((1, 4), binary(HERE[0])), np.full((1, 4), binary(HERE[1])), HEADING[None].astype(np.float32), listens[None],
        WHICH[None].astype(np.int32), WEIGHT[None].astype(np.float32),
    )  # fmt: skip
    log = stations.missed(drifting, tables(GAIN[1], offsets), ways, 1500.0)
    for k, offset in enumerate(offsets):
        p = chances(far, turn, LEVEL[scenario, 0] + offset, bin_, GAIN[1])
        agree(log[0, :, k], p, TIME[bin_ + 1] - TIME[bin_])
