"""Sums that several processes make of an output's particles give the bits of all read in one."""

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import clouds
import numpy as np
import pytest

from drift.engine.particles import partials
from drift.engine.particles.snapshot import Output, Question, Snapshot
from drift.engine.particles.status import Status
from drift.forecast import build, survey

N, BOUNDS = 6 * partials.BLOCK + 700, (0, 2 * partials.BLOCK + 300, 6 * partials.BLOCK + 700)
TIME = np.datetime64("2026-11-21T18:00")


def output(hours: int, *, copies: bool) -> Snapshot:
    """Return particles of two scenarios across the antimeridian, some ashore, sunk or pending."""
    rng = np.random.default_rng(40 + hours)
    lon = (179.99 + 0.02 * hours + 0.05 * rng.standard_normal(N) + 180) % 360 - 180
    lat = 58.3 + 0.03 * rng.standard_normal(N) + 0.01 * np.repeat([0, 1], np.diff(BOUNDS))
    weight = rng.random(N) * 10 ** rng.uniform(-3, 0, N)
    fates = [Status.ADRIFT, Status.ADRIFT, Status.ASHORE, Status.SUNK, Status.PENDING]
    scenario = np.repeat([0, 1], np.diff(BOUNDS))
    time = TIME + np.timedelta64(hours, "h")
    one = clouds.at(time, lon, lat, weight / weight.sum(), rng.choice(fates, N), scenario)
    cut = partials.cut_blocks(BOUNDS, BOUNDS[:-1], (partials.BLOCK, partials.BLOCK))
    family = np.sort(rng.integers(0, N // 3, N)) if copies else None
    return dataclasses.replace(one, family=family, cut=cut)


def answer_in_shards(
    edges: Sequence[int], outputs: Sequence[Output], questions: Sequence[Question]
) -> Iterator[Sequence[Any]]:
    """Yield the answers of ranges of blocks, each as if no other particles were there."""
    for whole, question in zip(outputs, questions, strict=True):
        assert isinstance(whole, Snapshot)
        firsts = np.append(whole.blocks.first, whole.n)
        answers = []
        for begin, end in itertools.pairwise(edges):
            own = slice(firsts[begin], firsts[end])
            columns = {
                field.name: getattr(whole, field.name)[own]
                for field in dataclasses.fields(whole)
                if isinstance(getattr(whole, field.name), np.ndarray)
            }
            part = dataclasses.replace(whole, **columns, cut=whole.blocks.some(begin, end))
            answers.append(question(part))
        yield answers


@pytest.mark.parametrize("copies", [False, True])
@pytest.mark.parametrize("edges", [(0, 1, 8), (0, 2, 3, 6, 8)])
def test_the_same_bits(edges: tuple[int, ...], copies: bool) -> None:
    outputs = [output(hours, copies=copies) for hours in (0, 6)]
    whole = build.build_forecast(outputs, scenarios=["a", "b"])
    made = build.build_forecast(
        outputs, scenarios=["a", "b"], deal=partial(answer_in_shards, edges)
    )
    assert made.data.identical(whole.data)
    assert [one.area for one in made.contours] == [one.area for one in whole.contours]


def test_the_lightest_and_the_heaviest_of_all_shards_count() -> None:
    """They decide whether all particles have the same weight."""
    one = output(0, copies=False)
    weight = np.where(np.arange(N) < partials.BLOCK, 1.0, 3.0)
    one = dataclasses.replace(one, probability=weight / weight.sum())
    (made,) = survey.survey_outputs([one], 2, partial(answer_in_shards, (0, 1, 8)))
    assert (made.lightest, made.heaviest) == (1 / weight.sum(), 3 / weight.sum())


def test_a_shard_may_have_nothing_on_the_map() -> None:
    one = output(0, copies=False)
    status = one.status.copy()
    status[: partials.BLOCK] = Status.PENDING
    pending = dataclasses.replace(one, status=status)
    whole = build.build_forecast([pending], scenarios=["a", "b"])
    made = build.build_forecast(
        [pending], scenarios=["a", "b"], deal=partial(answer_in_shards, (0, 1, 8))
    )
    assert made.data.identical(whole.data)
