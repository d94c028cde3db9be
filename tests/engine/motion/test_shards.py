"""A part of the particles moves by itself as within the whole: noise goes by the slot's number in
the whole run.
"""

from pathlib import Path

import numpy as np
import pytest
import shards
import spills

import drift
from drift.engine.motion import prior, simulate
from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.models import by_name as models
from drift.engine.motion.scenario import Scenario
from drift.engine.particles import ensemble as record
from drift.engine.particles import weights
from drift.engine.particles.ensemble import Ensemble, Layout
from drift.engine.particles.partials import BLOCK
from drift.engine.particles.status import Status
from drift.pipeline import run_setup
from drift.spills.worlds import release
from kernels.runtime import runtime


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> tuple[run_setup.Start, EnsembleSpec]:
    """Return what a run of three scenarios starts with, and what its particles are drawn from."""
    folder = tmp_path_factory.mktemp("shards")
    case = drift.vary(shards.case(folder), {"particles": 26_000, "clock.step": "30 min"})
    runtime.start()
    return run_setup.prepare(case, run_setup.open_for(case)), run_setup.ensemble_spec(case)


def shares(whole: Ensemble) -> list[list[tuple[int, int]]]:
    """Return the slots of three shards, a range of whole blocks of each scenario; one of them has
    none of the second.
    """
    cuts = []
    for number, (a, b) in enumerate(whole.scenarios):
        blocks = -(-(b - a) // BLOCK)
        inner = [0, 1, blocks if number == 1 else 2, blocks]
        cuts.append([min(a + k * BLOCK, b) for k in inner])
    return [[(cut[k], cut[k + 1]) for cut in cuts] for k in range(3)]


def layout_of(part: list[tuple[int, int]]) -> Layout:
    bounds = tuple(int(n) for n in np.cumsum([0, *(b - a for a, b in part)]))
    return Layout(bounds, tuple(a for a, _ in part), (BLOCK,) * len(part))


def empty(
    whole: Ensemble, part: list[tuple[int, int]], scenarios: tuple[Scenario, ...]
) -> Ensemble:
    return record.empty(whole.seed, layout_of(part), models.columns(scenarios))


def here(whole: Ensemble, part: list[tuple[int, int]], name: str) -> np.ndarray:
    return np.concatenate([whole.columns[name].to_numpy()[a:b] for a, b in part])


def test_a_shard_draws_its_slice_of_the_whole(begun: tuple[run_setup.Start, EnsembleSpec]) -> None:
    begin, spec = begun
    coast = begin.scene.place.coast
    drawn = prior.draw_ensemble(spec, coast)
    tried = np.zeros_like(drawn.tried)
    for part in shares(drawn.ensemble):
        own = prior.draw_ensemble(spec, coast, layout_of(part))
        assert own.ensemble.n > 0
        for name in set(own.ensemble.columns) - {"world"}:
            assert np.array_equal(
                own.ensemble.columns[name].to_numpy(), here(drawn.ensemble, part, name)
            ), name
        tried += own.tried
    assert np.array_equal(tried, drawn.tried)
    # some of the prior lies on land
    assert (tried[:2, 0] > np.diff(drawn.ensemble.bounds)[:2]).all()


@pytest.mark.parametrize("many", [1, 2, 5, 100])
def test_shards_are_whole_blocks_one_after_another(
    begun: tuple[run_setup.Start, EnsembleSpec], many: int
) -> None:
    whole = begun[0].ensemble.layout
    cut = whole.shards(many)
    blocks = len(whole.blocks.first)
    assert len(cut) == min(many, blocks)
    assert np.array_equal(np.concatenate([own.blocks.number for own in cut]), whole.blocks.number)
    assert np.array_equal(
        np.concatenate([own.blocks.scenario for own in cut]), whole.blocks.scenario
    )
    assert np.array_equal(
        np.concatenate([own.blocks.places for own in cut]), np.arange(whole.bounds[-1])
    )
    assert (
        max(len(own.blocks.first) for own in cut) - min(len(own.blocks.first) for own in cut) <= 1
    )


def test_a_shard_moves_as_within_the_whole(begun: tuple[run_setup.Start, EnsembleSpec]) -> None:
    """Errors, walk, jibes, landings, refloating, and places inside a step: every bit."""
    begin, spec = begun
    drawn = {name: column.to_numpy() for name, column in begin.ensemble.columns.items()}
    outputs = np.array([2400, 9000, 17_100])  # two of them inside a step
    alone = []
    for part in shares(begin.ensemble):
        own = empty(begin.ensemble, part, spec.scenarios)
        for name, column in own.columns.items():
            column.from_numpy(np.concatenate([drawn[name][a:b] for a, b in part]))
        alone.append((part, own, list(simulate.run(own, begin.scene, begin.clock, outputs))))
    moments = list(simulate.run(begin.ensemble, begin.scene, begin.clock, outputs))
    begin.scene.forcing.close()
    status = begin.ensemble.status.to_numpy()
    assert (status == Status.ASHORE).mean() > 0.1
    assert (begin.ensemble.moving_since.to_numpy() > 0).mean() > 0.05  # have refloated
    for part, own, seen in alone:
        for name, column in own.columns.items():
            assert np.array_equal(column.to_numpy(), here(begin.ensemble, part, name)), name
        for moment, mine in zip(moments, seen, strict=True):
            for name in ("lon", "lat", "status"):
                values = getattr(moment, name)
                assert np.array_equal(
                    getattr(mine, name), np.concatenate([values[a:b] for a, b in part])
                ), name
    # and what shards know of their weights makes what the whole knows, whoever comes first
    sums = [record.weighed(own) for _, own, _ in alone]
    merged, all_ = (
        weights.merge_weight_sums([sums[2], sums[0], sums[1]]),
        record.weighed(begin.ensemble),
    )
    assert np.array_equal(merged.log_sums, all_.log_sums)
    assert (merged.log_sum, merged.ess) == (all_.log_sum, all_.ess)


def test_a_shard_of_a_spill_draws_its_slice(tmp_path: Path) -> None:
    """Whole worlds of each class: places, releases, worlds, windage, immersion, sinking."""
    more = '[[spill.class]]\nname = "box"\nobject = { immersion = [0.3, 0.7] }\nsinking = { waterlogged = "3 d", spread = 2 }\n'
    text = spills.CASE.replace('name = "drum"', 'share = 0.4\nname = "drum"').format(
        more="", duration="1 d", objects=60, worlds=96, per_world=30, seed=9
    )
    (tmp_path / "land.geojson").write_text(spills.SHORE)
    more += '[[wind]]\nconstant = { speed = "9 m/s", from = 250 }\n'
    (tmp_path / "case.toml").write_text(text + more.replace("name =", "share = 0.6\nname =", 1))
    case = drift.load(tmp_path / "case.toml")
    assert case.spill is not None
    runtime.start()
    where = run_setup.open_for(case)
    begin = run_setup.prepare(case, where)
    begin.scene.forcing.close()
    whole, worlds, coast = begin.ensemble, begin.worlds, begin.scene.place.coast
    assert worlds is not None
    assert whole.layout == release.layout_of_worlds(case.spill)
    assert whole.layout.block == tuple(
        32 * count for count in release.particles_per_class(case.spill)
    )
    for first, last in ((0, 32), (32, 96)):
        of = release.layout_of_worlds(case.spill, first, last)
        some = worlds.some(first, last)
        own, dry = release.draw_some_worlds(
            case.spill, some, case.period, case.errors, coast, case.seed, of
        )
        assert (dry == 0).all()
        part = [(slots.number, slots.number + slots.last - slots.first) for slots in own.slots]
        assert [b - a for a, b in part] == [
            count * (last - first) for count in release.particles_per_class(case.spill)
        ]
        assert set(own.columns) == set(whole.columns)
        for name, column in own.columns.items():
            assert np.array_equal(column.to_numpy(), here(whole, part, name)), name
        assert set(own.world.to_numpy()) == set(range(first, last))
