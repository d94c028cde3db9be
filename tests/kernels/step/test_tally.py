"""Sums by block and by cell, by the kernel and by NumPy, against whole numbers and fsum, a particle
at a time.
"""

import itertools
from collections import Counter
from fractions import Fraction
from math import cos, fsum, sin

import numpy as np
import pytest

from geo import cells, sphere
from geo.cells import Cells
from kernels.step import tally
from kernels.step.tally import HIDDEN, MOVING, RESTING, Marks, Swarm

N, STATUSES, MEDIA, GROUPS = 997, 4, 2, 3
KINDS = np.array([MOVING, RESTING, HIDDEN, RESTING], np.int32)
MEDIUM = np.array([0, 1, 0, 0], np.int32)
EDGES = np.array([0, 311, 311, 640, N])  # a block is empty
WINDOW = Cells(2**31 - 9000, -5000, 700, 900, 27, 13)  # over the antimeridian; some lie off it
SHOWN = np.array([1, 0, 2, 1], np.int32)


@pytest.fixture(params=["kernel", "NumPy"])
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Which of the two makes the sums."""
    if request.param == "NumPy":
        monkeypatch.setattr(tally, "able", lambda: False)
    return str(request.param)


def swarm() -> Swarm:
    random = np.random.default_rng(11)
    lon = (2**31 + random.integers(-10_000, 11_000, N) + 2**31) % 2**32 - 2**31
    lat = random.integers(-6000, 8000, N)
    probability = random.gamma(0.2, size=N)
    probability /= probability.sum()
    probability[::17] = 0.0
    probability[5], probability[6] = tally.LEAST, np.nextafter(tally.LEAST, 1.0)
    status = random.integers(0, STATUSES, N)
    status[5:7] = 0
    return Swarm(
        lon.astype(np.int32), lat.astype(np.int32), probability, status.astype(np.int32), KINDS
    )


def spread_out() -> Swarm:
    """The same over the whole sphere, where sines count."""
    random = np.random.default_rng(12)
    lon, lat = random.integers(-(2**31), 2**31, N), random.integers(-(2**30), 2**30, N)
    return swarm()._replace(lon=lon.astype(np.int32), lat=lat.astype(np.int32))


def test_sums_of_blocks_are_those_of_their_particles(way: str) -> None:
    own = spread_out()
    found = tally.summed(own, EDGES)
    for b, (first, last) in enumerate(itertools.pairwise(EDGES)):
        rows = [tuple(column[i].item() for column in own[:4]) for i in range(first, last)]
        seen = [
            (x * sphere.UNIT, y * sphere.UNIT, p, KINDS[s])
            for x, y, p, s in rows
            if KINDS[s] and p > tally.LEAST
        ]
        weight = [p for _, _, p, _ in seen]
        expected = [
            fsum(p for *_, p, _ in rows),
            fsum(p * p for *_, p, _ in rows),
            fsum(weight),
            fsum(p * p for p in weight),
        ]
        expected += [
            fsum(p * cos(x) for x, _, p, _ in seen),
            fsum(p * sin(x) for x, _, p, _ in seen),
        ]
        for kind in (MOVING, RESTING):
            vectors = [
                (p * cos(y) * cos(x), p * cos(y) * sin(x), p * sin(y))
                for x, y, p, own_kind in seen
                if own_kind == kind
            ]
            expected += [fsum(vector[axis] for vector in vectors) for axis in range(3)]
        for power in (1, 2):
            expected += [
                fsum(p**power for *_, p, s in rows if s == status) for status in range(STATUSES)
            ]
        # A sum of n numbers is off by n units in the last place of the sum of their sizes, at most.
        np.testing.assert_allclose(
            found.sums[b], expected, rtol=0, atol=N * 2.3e-16 * fsum(p for *_, p, _ in rows)
        )
        assert (found.lightest[b], found.heaviest[b]) == (
            min(weight, default=1.0),
            max(weight, default=0.0),
        )


def cell_of(lon: int, lat: int) -> int | None:
    column = (lon - WINDOW.lon0) % 2**32 // WINDOW.width
    row = (lat - WINDOW.lat0) // WINDOW.height
    return row * WINDOW.nlon + column if column < WINDOW.nlon and 0 <= row < WINDOW.nlat else None


def rounded(value: Fraction) -> int:
    return round(value)  # halves go to even


@pytest.mark.parametrize("shown", [1, 3])
@pytest.mark.parametrize("squared", [False, True])
def test_what_lies_in_cells_is_what_falls_into_them(way: str, shown: int, squared: bool) -> None:
    own, random = swarm(), np.random.default_rng(13)
    group, scenario = (random.integers(0, k, N).astype(np.int32) for k in (GROUPS, len(SHOWN)))
    heaviest = float(own.probability.max()) if squared else 0.0
    places = SHOWN if shown > 1 else np.zeros_like(SHOWN)
    sums: list[Counter[tuple[int, ...]]] = [Counter(), Counter(), Counter()]
    for i in range(N):
        lon, lat, p, status = (column[i].item() for column in own[:4])
        cell = cell_of(lon, lat)
        if cell is None or KINDS[status] == HIDDEN or p <= tally.LEAST:
            continue
        sums[0][int(group[i]), int(MEDIUM[status]), cell] += rounded(Fraction(p) * cells.ONE)
        if squared:
            sums[1][int(group[i]), int(MEDIUM[status]), cell] += rounded(
                Fraction(p * (p / heaviest)) * cells.ONE
            )
        if shown > 1:
            sums[2][int(places[scenario[i]]), int(MEDIUM[status]), cell] += rounded(
                Fraction(p) * cells.ONE
            )
    parts = [slice(0, 640), slice(640, N)]
    swarms = [Swarm(*(column[part] for column in own[:4]), KINDS) for part in parts]
    marks = [Marks(group[part], MEDIUM, scenario[part], places) for part in parts]
    held = tally.held(swarms, WINDOW)
    np.testing.assert_array_equal(held, sorted({cell for _, _, cell in sums[0]}))
    found = tally.laid(
        zip(swarms, marks, strict=True), WINDOW, held, GROUPS, MEDIA, shown, heaviest
    )
    assert [one.shape for one in found] == [(GROUPS, MEDIA, held.size)] * 2 + [
        (shown, MEDIA, held.size)
    ]
    for array, expected in zip(found, sums, strict=True):
        there = {key: value for key, value in expected.items() if value}
        first, second, third = np.nonzero(array)
        keys = zip(first.tolist(), second.tolist(), held[third].tolist(), strict=True)
        assert dict(zip(keys, array[first, second, third].tolist(), strict=True)) == there


def test_nothing_adds_up_to_nothing(way: str) -> None:
    none = Swarm(*(column[:0] for column in swarm()[:4]), KINDS)
    found = tally.summed(none, np.array([0]))
    assert (found.sums.shape, found.lightest.size) == ((0, 12 + 2 * STATUSES), 0)
    assert tally.held([none], WINDOW).size == 0


def test_cells_on_the_far_side_of_a_wide_map_hold_what_falls_into_them(way: str) -> None:
    """A map of 300 degrees, whose eastern cells lie more than half a turn from its corner."""
    window = Cells(-(2**31) + 12_345, -(2**30), 5 * 2**32 // 6 // 40, 2**31 // 30, 40, 30)
    own = spread_out()
    expected = set()
    for lon, lat, p, status in zip(*(column.tolist() for column in own[:4]), strict=True):
        column, row = (
            (lon - window.lon0) % 2**32 // window.width,
            (lat - window.lat0) // window.height,
        )
        if (
            column < window.nlon
            and row < window.nlat
            and KINDS[status] != HIDDEN
            and p > tally.LEAST
        ):
            expected.add(row * window.nlon + column)
    np.testing.assert_array_equal(tally.held([own], window), sorted(expected))
