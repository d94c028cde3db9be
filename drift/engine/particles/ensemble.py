"""The record of a run: one slot a particle, one column a property.

Columns lie on the device (opaque here: only `kernels` touches them) and keep their order: the slots
of a scenario are contiguous, so that a scenario is a range of slots. Columns that kernels take
together stand in the rows of one device array (kernels.runtime.rows); under its own name each is
read and written as if it had an array of its own.
"""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from drift.engine.particles import partials, weights
from drift.engine.particles.partials import Blocks
from drift.engine.particles.status import Status
from drift.engine.particles.weights import Weighed
from geo.array import Array
from kernels.runtime import batch, rows, runtime
from kernels.runtime.batch import Batch

Device = Any  # a one-dimensional array on the device, or a row of one: kernels.runtime.rows.Row


@dataclass(frozen=True)
class Column:
    """A property that every particle has: an array of shape (n,) on the device."""

    name: str
    dtype: type[np.int32] | type[np.float32]
    first: float  # value before anything is drawn
    unit: str
    meaning: str
    # columns that name the same one stand in its rows, in their order; "": it has one of its own
    array: str = ""


NEVER = 2**31 - 1  # [s] a time that does not come
# What every particle has, however it moves. Times are seconds after the run's start.
CORE = (
    Column("lon", np.int32, 0, "binary angle", "longitude"),
    Column("lat", np.int32, 0, "binary angle", "latitude"),
    Column("status", np.int32, Status.PENDING, "", "drift.engine.particles.status.Status"),
    Column("release", np.int32, 0, "s", "when it is released"),
    Column(
        "status_since", np.int32, 0, "s", "when it went ashore, sank, left, or ran out of forcing"
    ),
    Column(
        "moving_since", np.int32, 0, "s", "when it last began to move, where what strands refloats"
    ),
    Column("sink_time", np.int32, NEVER, "s", "when it sinks if it is still adrift"),
    Column("edge", np.int32, -1, "", "number of the shoreline edge where it went ashore; -1: none"),
    Column("scenario", np.int32, 0, "", "number of the scenario to which it belongs"),
    Column(
        "world",
        np.int32,
        0,
        "",
        "number of the world whose unknowns it shares; 0 where there are none",
    ),
    Column("log_weight", np.float32, 0, "", "logarithm of its weight; -inf is legal"),
)


class Slots(NamedTuple):
    """A range of slots."""

    first: int
    last: int  # the one after it
    number: int  # number of the first slot in the whole run, the key of its noise


@dataclass(frozen=True)
class Layout:
    """Which slots belong to which scenario."""

    bounds: tuple[int, ...]  # the first slot of each scenario and, last, n
    numbers: tuple[int, ...]  # number of each scenario's first slot in the whole run
    # slots of each scenario that make a block: drift.engine.particles.partials
    block: tuple[int, ...]
    _batches: dict[tuple[int, ...], Batch] = field(default_factory=dict, repr=False, compare=False)

    @cached_property
    def blocks(self) -> Blocks:
        """The blocks by which sums over particles are made."""
        return partials.cut_blocks(self.bounds, self.numbers, self.block)

    @property
    def slots(self) -> list[Slots]:
        """The slots of each scenario, as what draws noise takes them."""
        return [
            Slots(a, b, number)
            for (a, b), number in zip(itertools.pairwise(self.bounds), self.numbers, strict=True)
        ]

    def shards(self, many: int) -> "list[Layout]":
        """Return the layouts of about as many shards: of whole blocks, one after another."""
        edges = np.append(self.blocks.first, self.blocks.n)
        cuts = np.unique(np.rint(np.linspace(0, len(edges) - 1, many + 1)).astype(int))
        return [
            self.some(int(edges[a]), int(edges[b])) for a, b in itertools.pairwise(cuts.tolist())
        ]

    def some(self, first: int, last: int) -> "Layout":
        """Return the layout of a range of slots, from the begin of a block to the end of one."""
        edges = np.clip(self.bounds, first, last)
        shift = np.array(self.numbers) - np.array(self.bounds[:-1])
        numbers = tuple(int(x) for x in edges[:-1] + shift)
        return Layout(tuple(int(x) for x in edges - first), numbers, self.block)

    def batch(self, scenarios: tuple[int, ...]) -> Batch:
        """Return the slots of some scenarios (ascending), for one launch; they are made once and
        kept.
        """
        if scenarios not in self._batches:
            self._batches[scenarios] = batch.batch_of(self.bounds, self.numbers, scenarios)
        return self._batches[scenarios]


@dataclass(eq=False)
class Ensemble:
    """All particles: CORE as fields of shape (n,), then the columns of the models by which they
    move, by name.

    What columns hold changes in place, and the layout where particles are resampled; nothing else
    of it changes.
    """

    seed: int
    layout: Layout
    lon: Device
    lat: Device
    status: Device
    release: Device
    status_since: Device
    moving_since: Device
    sink_time: Device
    edge: Device
    scenario: Device
    world: Device
    log_weight: Device
    own: Mapping[str, Device]

    @property
    def n(self) -> int:
        """Number of slots."""
        return self.bounds[-1]

    @property
    def bounds(self) -> tuple[int, ...]:
        """The first slot of each scenario and, last, n."""
        return self.layout.bounds

    @property
    def numbers(self) -> tuple[int, ...]:
        """The number of each scenario's first slot in the whole run."""
        return self.layout.numbers

    @property
    def scenarios(self) -> list[tuple[int, int]]:
        """Range [first, last) of slots of each scenario."""
        return list(zip(self.bounds[:-1], self.bounds[1:], strict=True))

    @property
    def slots(self) -> list[Slots]:
        """The slots of each scenario, as what draws noise takes them."""
        return self.layout.slots

    @property
    def places(self) -> Array:
        """The number of every slot in the whole run, int64 (n,)."""
        return np.concatenate(
            [number + np.arange(last - first) for first, last, number in self.slots]
        )

    @property
    def blocks(self) -> Blocks:
        """The blocks by which sums over particles are made."""
        return self.layout.blocks

    def batch(self, scenarios: Sequence[int]) -> Batch:
        """Return the slots of some scenarios (ascending), for one launch."""
        return self.layout.batch(tuple(scenarios))

    @property
    def columns(self) -> dict[str, Device]:
        """All columns by name."""
        return {**{column.name: getattr(self, column.name) for column in CORE}, **self.own}


def empty(seed: int, of: Layout | tuple[int, ...], own: Sequence[Column] = ()) -> Ensemble:
    """Return an ensemble whose particles all wait at (0, 0) for a release at the start, all of
    weight 1.

    of: which slots belong to which scenario; or the first slot of each and, last, n, where this is
    the whole run. own: columns besides CORE.
    """
    layout = (
        of if isinstance(of, Layout) else Layout(of, of[:-1], (partials.BLOCK,) * (len(of) - 1))
    )
    scenario, n = runtime.upload(owners(layout.bounds)), layout.bounds[-1]
    return Ensemble(seed, layout, own=filled(own, n), **filled(CORE, n) | {"scenario": scenario})


def filled(columns: Sequence[Column], n: int) -> dict[str, Device]:
    """Return new columns of n slots by name, in the order given, with what they hold before
    anything is drawn.
    """
    together: dict[str, list[Column]] = {}
    for column in columns:
        together.setdefault(column.array or f"{column.name} alone", []).append(column)
    found: dict[str, Device] = {}
    for each in together.values():
        first = np.array([column.first for column in each], each[0].dtype)
        values = np.repeat(first[:, None], max(n, 1), axis=1)
        if each[0].array:
            found |= rows.stack([column.name for column in each], values)
        else:
            found[each[0].name] = runtime.upload(values)
    return {column.name: found[column.name] for column in columns}


def owners(bounds: tuple[int, ...]) -> Array:
    """Return the number of the scenario to which each slot belongs, int32 (n,), by the bounds of
    scenarios.
    """
    return np.repeat(np.arange(len(bounds) - 1, dtype=np.int32), np.diff(bounds))


def inherit(columns: Iterable[Device], ancestors: Array) -> None:
    """Copy each ancestor's state into its offspring (resampling), in place; ancestors: slots, (n,).

    columns: of (n,) values, or of several of each particle, one after another. Arrays in whose rows
    they stand are taken whole: no other column may stand there.
    """
    for array in rows.arrays(columns):
        values = array.to_numpy()
        for row in values.reshape(-1, len(ancestors)):
            row[:] = row[ancestors]
        array.from_numpy(values)


def weighed(ensemble: Ensemble) -> Weighed:
    """Return what is needed of the weights of all particles."""
    return weights.weighed(ensemble.log_weight.to_numpy(), ensemble.blocks)


def probability(ensemble: Ensemble) -> Array:
    """Return each particle's normalised weight, float64, shape (n,), of sum 1."""
    return weights.normalised(ensemble.log_weight.to_numpy(), ensemble.blocks)


def sample(ensemble: Ensemble, slots: Array) -> Ensemble:
    """Return a copy of chosen slots (sorted), for trials that must not touch the run."""

    def chosen(_: str, array: Device) -> Device:
        values = array.to_numpy().reshape(-1, max(ensemble.n, 1))
        return runtime.upload(np.stack([row[slots] for row in values]))

    bounds = tuple(int(x) for x in np.searchsorted(slots, ensemble.bounds))
    layout = Layout(bounds, bounds[:-1], ensemble.layout.block)
    return _with(ensemble, layout, rows.rebuilt(ensemble.columns, chosen))


def join_ensembles(parts: Sequence[Ensemble]) -> Ensemble:
    """Return the particles of some ensembles of one run as one, part after part; scenarios are in
    their order.
    """
    columns = [part.columns for part in parts]

    def one(name: str, _: Device) -> Device:
        arrays = [rows.located(own[name])[0].to_numpy() for own in columns]
        values = [
            array.reshape(-1, max(part.n, 1))[:, : part.n]
            for array, part in zip(arrays, parts, strict=True)
        ]
        return runtime.upload(np.concatenate(values, axis=1))

    counts = np.sum([np.diff(part.bounds) for part in parts], axis=0)
    bounds = (0, *np.cumsum(counts).tolist())
    layout = Layout(bounds, bounds[:-1], parts[0].layout.block)
    return _with(parts[0], layout, rows.rebuilt(columns[0], one))


def _with(ensemble: Ensemble, layout: Layout, columns: dict[str, Device]) -> Ensemble:
    """Return an ensemble with other slots; columns: all, by name."""
    core = {column.name: columns.pop(column.name) for column in CORE}
    return replace(ensemble, layout=layout, own=columns, **core)
