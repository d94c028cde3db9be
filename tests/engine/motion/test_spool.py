"""The particles at all output times, read back whole, part by part, and along their tracks: against
the columns put in.
"""

from collections.abc import Iterator

import numpy as np
import pytest

from drift.engine.motion import spool
from drift.engine.motion.models.drift import COLUMNS
from drift.engine.motion.period import Period
from drift.engine.motion.simulate import Moment
from drift.engine.motion.spool import SnapshotStore
from drift.engine.particles import ensemble as record
from drift.engine.particles.ensemble import Ensemble

BEGIN = np.datetime64("2026-11-23T06:00")
BOUNDS = (0, 9000, 9000, 30_000)  # a scenario of nobody
N, OUTPUTS = BOUNDS[-1], 5


def moments(ensemble: Ensemble, weighted: bool) -> list[Moment]:
    """Return five moments, of which the second and the fourth come after particles have been drawn
    again.
    """
    random, taken, lineage = np.random.default_rng(3), [], None
    for k in range(OUTPUTS):
        lon, lat = random.integers(-(2**31), 2**31, (2, N)).astype(np.int32)
        status = random.integers(0, 9, N).astype(np.int32)
        weight = random.normal(-200, 30, N).astype(np.float32) if weighted else None
        ancestors = np.sort(random.integers(0, N, N)) if weighted and k in (1, 3) else None
        if ancestors is not None:
            lineage = ancestors if lineage is None else lineage[ancestors]
        taken.append(
            Moment(3600 * k, lon, lat, status, ensemble.layout, weight, ancestors, lineage)
        )
    return taken


@pytest.fixture(params=[True, False], ids=["weighted", "unweighted"])
def spooled(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> Iterator[tuple[SnapshotStore, list[Moment], Ensemble]]:
    """Return a spool in parts of two blocks, what was put in, and the ensemble."""
    monkeypatch.setattr(spool, "PART", 8192)
    ensemble = record.empty(1, BOUNDS, COLUMNS)
    ensemble.log_weight.from_numpy(np.random.default_rng(8).normal(-500, 2, N).astype(np.float32))
    ensemble.world.from_numpy((np.arange(N) // 7).astype(np.int32))
    taken = moments(ensemble, request.param)
    with SnapshotStore.of_run(
        Period(BEGIN, BEGIN + np.timedelta64(4, "s"), 1), ensemble, taken, OUTPUTS, worlds=True
    ) as made:
        yield made, taken, ensemble


def test_what_was_put_in_comes_back_whole_and_in_parts(
    spooled: tuple[SnapshotStore, list[Moment], Ensemble],
) -> None:
    made, taken, ensemble = spooled
    family = np.arange(N)
    for k, moment in enumerate(taken):
        log_weight = (
            ensemble.log_weight.to_numpy() if moment.log_weight is None else moment.log_weight
        )
        weight = np.exp(log_weight.astype(float) - log_weight.max())
        whole = made[k]
        for name in ("lon", "lat", "status"):
            np.testing.assert_array_equal(getattr(whole, name), getattr(moment, name))
        np.testing.assert_allclose(whole.probability, weight / weight.sum(), rtol=1e-12)
        assert np.array_equal(whole.scenario, np.repeat([0, 2], (9000, 21_000)))
        if moment.ancestors is not None:
            family = family[moment.ancestors]
        assert (
            whole.family is None
            if (family == np.arange(N)).all()
            else np.array_equal(whole.family, family)
        )
        parts = list(made.outputs[k].parts())
        assert len(parts) > 3
        for name in ("lon", "lat", "status", "probability", "scenario", "family", "world"):
            values = [getattr(part, name) for part in parts]
            if getattr(whole, name) is None:
                assert values == [None] * len(parts)
            else:
                assert np.array_equal(np.concatenate(values), getattr(whole, name)), name
        assert np.array_equal(np.concatenate([part.blocks.places for part in parts]), np.arange(N))


def test_a_track_is_that_of_ancestors_before(
    spooled: tuple[SnapshotStore, list[Moment], Ensemble],
) -> None:
    made, taken, _ = spooled
    slots = np.array([0, 17, 8999, 9000, 20_111, 29_999])
    way = made.follow(slots)
    for k in range(OUTPUTS - 1, -1, -1):
        for name in ("lon", "lat", "status"):
            assert np.array_equal(way[name][:, k], getattr(taken[k], name)[slots]), (name, k)
        assert np.array_equal(way["probability"][:, k], made[k].probability[slots])
        slots = slots if taken[k].ancestors is None else np.asarray(taken[k].ancestors)[slots]


def test_new_weights_are_those_of_times_that_have_none_of_their_own(
    spooled: tuple[SnapshotStore, list[Moment], Ensemble],
) -> None:
    made, taken, _ = spooled
    before = made[2].probability
    log_weight = np.linspace(-3, 3, N).astype(np.float32)
    portions = list(made.portions())
    assert len(portions) > 3
    made.reweigh(
        np.concatenate([log_weight[own.number :][: own.last - own.first] for own in one.slots])
        for one in portions
    )
    assert np.array_equal(made[2].probability, before) is (taken[2].log_weight is not None)
    if taken[2].log_weight is None:
        np.testing.assert_allclose(
            made[2].probability,
            np.exp(np.linspace(-3, 3, N)) / np.exp(np.linspace(-3, 3, N)).sum(),
            rtol=1e-5,
        )
