"""Scenarios of one model in one forcing move in one launch, each by the bits by which it would move
alone.
"""

from itertools import pairwise

import numpy as np
import pytest
import shapely

from drift.engine.motion import simulate
from drift.engine.motion.clock import Clock
from drift.engine.motion.forcing import Forcing, Sources
from drift.engine.motion.models.drift import COLUMNS, DRIFT, LEEWAY
from drift.engine.motion.models.model import Motion
from drift.engine.motion.scene import Scene
from drift.engine.particles import ensemble as record
from drift.engine.particles.ensemble import Ensemble, Layout
from drift.engine.particles.partials import BLOCK
from drift.engine.particles.status import Status
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast.edges import Coast
from geo.coast.shore import Shore
from geo.forcing import sources
from kernels.runtime import batch, launch, runtime
from kernels.step import advance as kernel
from kernels.step import coast as device_coast

EVERYWHERE = kernel.Domain(-(2**31), -(2**30), 2**32 - 1, 2**31)
SIZES = (301, 0, 517, 89, 1, 1203, 411)
# which forcing each scenario sees: neither's scenarios stand side by side
SEAS = (0, 1, 1, 0, 1, 0, 1)
# of first slots in the whole run, of which this is a part
NUMBERS = (1000, 2000, 5000, 9000, 9800, 11_000, 20_000)
PHYSICS = (
    kernel.Physics(),
    kernel.Physics(0.21, 17_000.0, 1.3, 23_000.0, 31.0, 2.3e-5),
    kernel.Physics(0.17, 13_000.0, 0.0, 1.0, 0.0, 4.1e-5),
    kernel.Physics(0.0, 1.0, 1.9, 9000.0, 17.0, 0.0),
    kernel.Physics(diffusivity=53.0),
    kernel.Physics(jibe_rate=7.7e-5),
    kernel.Physics(0.11, 8000.0, diffusivity=71.0),
)


def drawn(which: list[int]) -> Ensemble:
    """Return some of the scenarios' particles to the west of an island; each has what it has,
    whoever is beside it.
    """
    bounds = (0, *np.cumsum([SIZES[k] for k in which]).tolist())
    ensemble = record.empty(
        99, Layout(bounds, tuple(NUMBERS[k] for k in which), (BLOCK,) * len(which)), COLUMNS
    )
    for name, column in ensemble.columns.items():
        values = column.to_numpy()
        for k, (a, b) in zip(which, pairwise(bounds), strict=True):
            random = np.random.default_rng([k, *name.encode()])
            if name in ("lon", "lat"):
                values[a:b] = (
                    random.uniform(1.1e6, 3.6e6, b - a)
                    if name == "lat"
                    else random.uniform(-7e6, -5.4e6, b - a)
                )
            elif name in LEEWAY:
                values[a:b] = random.uniform(0.003, 0.06, b - a)
            elif name == "side":
                values[a:b] = random.choice([-1, 1], b - a)
            elif name == "release":
                values[a:b] = random.integers(-500, 5000, b - a)
        column.from_numpy(values)
    return ensemble


def world(which: list[int], shore: Coast) -> Scene:
    blowing = sources.constant_field("wind", 6.1, 4.7)
    seas = [
        Sources({"current": (sources.constant_field("current", east, north),), "wind": (blowing,)})
        for east, north in ((0.43, -0.11), (0.29, 0.23))
    ]
    return Scene(
        Forcing([seas[SEAS[k]] for k in which], 1),
        tuple(Motion(DRIFT, PHYSICS[k]) for k in which),
        kernel.Surroundings(EVERYWHERE, device_coast.upload(shore)),
    )


@pytest.fixture
def shore() -> Coast:
    """An island of four corners."""
    island = shapely.Polygon([(-0.44, 0.1), (-0.25, 0.12), (-0.27, 0.31), (-0.42, 0.37)])
    return shoreline.build_coast(
        Shore(np.array([island], object), "test", (), Box(-1.5, -1.5, 1.5, 1.5)),
        Box(-1.2, -1, 1, 1),
    )


@pytest.mark.thorough
def test_many_scenarios_move_in_one_launch_a_forcing(
    shore: Coast, monkeypatch: pytest.MonkeyPatch
) -> None:
    runtime.start()
    launches = []
    bind = launch.bind

    def counted(bound: object, *given: object) -> object:
        move = bind(bound, *given)
        return lambda *values: (launches.append(bound), move(*values))

    monkeypatch.setattr(launch, "bind", counted)
    every = list(range(len(SIZES)))
    whole, scene, clock = drawn(every), world(every, shore), Clock(1000, 14_400, 1, 1800, 100)
    outputs = np.array([4100, 14_400])
    moments = list(simulate.run(whole, scene, clock, outputs))
    scene.forcing.close()
    # In one go: two steps until the one that holds an output inside, that one, five, and the last,
    # which the end cuts.
    assert len(launches) == 2 * 4
    status = whole.status.to_numpy()
    assert 0.05 < (status == Status.ASHORE).mean() < 0.95
    for k, (a, b) in zip(every, whole.scenarios, strict=True):
        if a == b:
            continue
        own, alone = drawn([k]), world([k], shore)
        seen = list(simulate.run(own, alone, clock, outputs))
        alone.forcing.close()
        for name in set(own.columns) - {"scenario"}:
            assert np.array_equal(
                own.columns[name].to_numpy(), whole.columns[name].to_numpy()[a:b]
            ), (k, name)
        for moment, mine in zip(moments, seen, strict=True):
            for name in ("lon", "lat", "status"):
                assert np.array_equal(getattr(moment, name)[a:b], getattr(mine, name)), (k, name)


@pytest.mark.parametrize(
    ("scenarios", "slots"),
    [
        ((0,), range(3)),
        ((0, 1, 2), range(7)),
        ((1, 3), [*range(7, 12)]),
        ((0, 3), [0, 1, 2, *range(7, 12)]),
        ((1,), []),
    ],
)
def test_a_batch_holds_the_slots_of_its_scenarios(
    scenarios: tuple[int, ...], slots: list[int]
) -> None:
    """A range where that is possible: a scenario without slots, the second, is no gap."""
    runtime.start()
    own = batch.batch_of((0, 3, 3, 7, 12), (20, 30, 40, 50), scenarios)
    places = range(own.first, own.last)
    found = own.slots.to_numpy()[list(places)] if own.listed else np.array(places, int)
    assert found.tolist() == list(slots)
    assert own.listed == (scenarios == (0, 3))
    assert own.shift.to_numpy().tolist() == [20, 27, 37, 43]
    rows = [(k + 0.5, -k) for k in scenarios]
    table = own.table(rows).to_numpy().reshape(4, 2)
    for k in range(4):
        assert table[k].tolist() == ([k + 0.5, -k] if k in scenarios else [0, 0])
