"""Fates in parts: no number of parts changes a bit, and memory does not grow with the particles of
a world.
"""

import dataclasses
import tracemalloc
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import shapely
from spills import DAY, Cut, scattered

from drift.engine.particles.status import Status
from drift.spills.worlds import finds, realisations, renewal, washup
from drift.spills.worlds.exposure import Reporting, Walk
from drift.spills.worlds.fates import FOREVER, Adrift, Fates, FatesSource, Stays
from drift.spills.worlds.finds import AtSea, Detection, Numbers, SpillEvidence
from geo import sphere
from geo.coast.segments import Segments

START = np.datetime64("2026-11-21T00:00:00")
PLACE = AtSea(179.99, -60.0, 3e3, 0.1)
SEEN = (
    Detection("a", 0, 1, 2 * DAY), Detection("b", 1, 0, 4 * DAY), Detection("c", None, 1, 5 * DAY, latest=True),
    Detection("d", None, 2, 5 * DAY, false=0.4), Detection("e", 0, 1, 6 * DAY, by=0, false=0.1), Detection("f", None, PLACE, 5, false=0.2),
)  # fmt: skip
SEARCHES = (Walk((0, 1), 6 * DAY, 0.6), Walk((2,), 3 * DAY, 0.8))


def coast(count: int) -> Segments:
    lon = 0.1 * np.arange(count)
    lines = np.array([shapely.LineString([(x, 29), (x + 0.1, 29.01)]) for x in lon], object)
    length = np.linspace(9e3, 12e3, count)
    return Segments(
        tuple(f"S{k}" for k in range(count)),
        length,
        lon,
        0 * lon + 29,
        np.arange(count),
        lines,
        ("wild",) * count,
    )


def known(
    worlds: int, objects: list[int], shares: list[float], seen: Any = SEEN, searches: Any = SEARCHES
) -> SpillEvidence:
    count, grid = np.array(objects), np.array([0.0, 0.2, 0.5])
    numbers = Numbers(
        count, np.full(count.size, 1 / count.size), np.array(shares), grid, np.full(3, 1 / 3)
    )
    rate = np.array([0.1, 0.05, 0.2]) / DAY
    reporting = Reporting(rate, 1 / (40 * DAY), np.random.default_rng(2).uniform(0.5, 2, worlds))
    return SpillEvidence(numbers, seen, searches, reporting, coast(3).length, 7.0 * DAY)


def everything(fates: FatesSource, told: SpillEvidence, latent: Any) -> tuple[Any, ...]:
    """Return all that is made of fates after a run; stands and weights by world, as parts have them
    in another order.
    """
    log_weight = np.random.default_rng(5).normal(0, 0.3, fates.worlds)
    told = dataclasses.replace(told, usual=finds.usual(fates, told, log_weight))
    weighed = finds.posterior(fates, told, latent, log_weight)
    surprises = finds.surprises(fates, told, latent, log_weight)
    parts = zip(fates.parts(), renewal._log_weights(fates, weighed), strict=True)
    left = [column(part, values) for part, values in parts]
    stands = [
        column(part, one.stands)
        for part, drawn in realisations.realise(fates, weighed, 3, 2)
        for one in drawn
    ]
    drawn = realisations.realise(fates, weighed, 3, 2)
    outputs = np.arange(0, 8) * DAY
    made = washup.build_washup(drawn, coast(3), weighed.weight, outputs, START, ["drum", "box"], 2)
    return told.usual, weighed, surprises, left, stands, made


def column(part: Fates, values: Any) -> list[Any]:
    """Return values by class, (worlds, particles) each."""
    return [values[part.kind == kind].reshape(part.many, -1) for kind in range(len(part.counts))]


@pytest.mark.parametrize(
    ("seen", "searches"), [(SEEN, SEARCHES), ((), ())], ids=["finds", "nothing found"]
)
def test_no_number_of_parts_changes_a_bit(seen: Any, searches: Any) -> None:
    worlds = 150
    whole, rng = scattered(worlds, [20, 31]), np.random.default_rng(4)
    n = whole.world.size
    at = sphere.destination(
        np.radians(PLACE.lon), np.radians(PLACE.lat), *rng.normal(0, 6e3, (2, n))
    )
    status = np.where(rng.random(n) < 0.7, Status.ADRIFT, Status.ASHORE).astype(np.int32)
    whole = dataclasses.replace(
        whole, adrift={5: Adrift(*(sphere.to_binary(np.degrees(x)) for x in at), status)}
    )
    told, latent = (
        known(worlds, [40, 60], [0.4, 0.6], seen, searches),
        rng.standard_normal((worlds, 2)),
    )
    usual, weighed, surprises, left, stands, made = everything(whole, told, latent)
    assert not len(seen) or (usual > 0).sum() == 3
    # more objects than particles: several rounds
    assert max(x.max() for own in stands for x in own) > 1
    for edges in ((0, 32, 64, 96, 128, 150), (0, 96, 150)):
        cut = everything(Cut(whole, *edges), told, latent)
        assert cut[0].tolist() == usual.tolist()
        assert cut[2] == surprises
        for name, values in vars(weighed).items():
            assert name == "known" or np.array_equal(getattr(cut[1], name), values), name
        for mine, own in ((cut[3], left), (cut[4][::2], stands[:1]), (cut[4][1::2], stands[1:])):
            for kind in range(2):
                assert np.array_equal(np.concatenate([part[kind] for part in mine]), own[0][kind])
        assert cut[5].identical(made)


class Drawn:
    """A source that draws the fates of each world when it is read."""

    def __init__(self, worlds: int, each: int) -> None:
        self.worlds, self.counts = worlds, (each,)

    def parts(self) -> Iterator[Fates]:
        (n,) = self.counts
        nothing, forever = np.zeros(n, np.int32), np.full(n, FOREVER, np.int32)
        for world in range(self.worlds):
            rng = np.random.default_rng(world)
            at = sphere.destination(
                np.radians(PLACE.lon), np.radians(PLACE.lat), *rng.normal(0, 6e3, (2, n))
            )
            lies = np.flatnonzero(rng.random(n) < 0.7).astype(np.int32)
            stays = Stays(
                lies,
                rng.integers(0, 3, lies.size, np.int32),
                rng.integers(0, 6 * DAY, lies.size, np.int32),
                forever[: lies.size],
            )
            there = Adrift(*(sphere.to_binary(np.degrees(x)) for x in at), nothing)
            yield Fates(
                self.worlds, np.full(n, world, np.int32), nothing, nothing, forever, nothing, stays, {4: there}, (world, world + 1)
            )  # fmt: skip


@pytest.mark.thorough
def test_memory_does_not_grow_with_particles() -> None:
    """Three times as many worlds of 4,000: less than a byte for each particle more, where one
    column would take four.
    """
    seen = tuple(dataclasses.replace(find, kind=0) for find in SEEN if find.name != "b")
    each, peak = 4000, []
    for worlds in (2, 12, 36):  # the first time modules are imported
        told = known(worlds, [60], [1.0], seen)
        log_weight, latent = np.zeros(worlds), np.random.default_rng(6).standard_normal((worlds, 2))
        fates = Drawn(worlds, each)
        tracemalloc.start()
        told = dataclasses.replace(told, usual=finds.usual(fates, told, log_weight))
        weighed = finds.posterior(fates, told, latent, log_weight)
        finds.surprises(fates, told, latent, log_weight)
        for _ in renewal._log_weights(fates, weighed):
            pass
        drawn = realisations.realise(fates, weighed, 3, 1)
        washup.build_washup(drawn, coast(3), weighed.weight, np.arange(0, 8) * DAY, START, ["drum"])
        peak.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peak[2] - peak[1] < 24 * each
