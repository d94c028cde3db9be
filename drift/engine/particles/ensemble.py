"""The particle ensemble: one slot per particle, one device column per property.

Only `kernels` reads or writes the device columns. The slots of a scenario are contiguous, so that a
scenario is a range of slots. Columns that a kernel uses together are rows of one device array
(kernels.runtime.rows); each row is read and written by its own name like a separate array.
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
from drift.engine.particles.weights import WeightSums
from geo.array import Array
from kernels.runtime import batch, rows, runtime
from kernels.runtime.batch import Batch

Device = Any  # a one-dimensional array on the device, or a row of one: kernels.runtime.rows.Row


@dataclass(frozen=True)
class Column:
    """A property of every particle: a device array of shape (n,)."""

    name: str
    dtype: type[np.int32] | type[np.float32]
    first: float  # initial value, before any random draw
    unit: str
    meaning: str
    # device array in whose rows this column lies, shared by columns that name it; "": its own array
    array: str = ""


NEVER = 2**31 - 1  # [s] time of an event that never happens
# Columns of every particle, whatever its motion model. Times are seconds after the run's start.
CORE = (
    Column("lon", np.int32, 0, "binary angle", "longitude"),
    Column("lat", np.int32, 0, "binary angle", "latitude"),
    Column("status", np.int32, Status.PENDING, "", "drift.engine.particles.status.Status"),
    Column("release", np.int32, 0, "s", "when it is released"),
    Column("status_since", np.int32, 0, "s", "when it stranded, sank, left, or ran out of forcing"),
    Column("moving_since", np.int32, 0, "s", "when it last began to move; refloating resets it"),
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
    last: int  # exclusive
    number: int  # number of the first slot in the whole run, the key of its random numbers


@dataclass(frozen=True)
class Layout:
    """The range of slots of each scenario."""

    bounds: tuple[int, ...]  # the first slot of each scenario and, last, n
    numbers: tuple[int, ...]  # number of each scenario's first slot in the whole run
    # slots per block of each scenario: drift.engine.particles.partials
    block: tuple[int, ...]
    _batches: dict[tuple[int, ...], Batch] = field(default_factory=dict, repr=False, compare=False)

    def __getstate__(self) -> dict[str, Any]:
        """Return what another process needs: `_batches` holds arrays of this process's device."""
        return {"bounds": self.bounds, "numbers": self.numbers, "block": self.block, "_batches": {}}

    @cached_property
    def blocks(self) -> Blocks:
        """The blocks in which sums over particles are computed."""
        return partials.cut_blocks(self.bounds, self.numbers, self.block)

    @property
    def slots(self) -> list[Slots]:
        """The slots of each scenario, as the functions that draw random numbers take them."""
        return [
            Slots(a, b, number)
            for (a, b), number in zip(itertools.pairwise(self.bounds), self.numbers, strict=True)
        ]

    def shards(self, many: int) -> "list[Layout]":
        """Return the layouts of about `many` shards: consecutive ranges of whole blocks."""
        edges = np.append(self.blocks.first, self.blocks.n)
        cuts = np.unique(np.rint(np.linspace(0, len(edges) - 1, many + 1)).astype(int))
        return [
            self.some(int(edges[a]), int(edges[b])) for a, b in itertools.pairwise(cuts.tolist())
        ]

    def some(self, first: int, last: int) -> "Layout":
        """Return the layout of the slots [first, last), which begin and end at the edge of
        a block.
        """
        edges = np.clip(self.bounds, first, last)
        shift = np.array(self.numbers) - np.array(self.bounds[:-1])
        numbers = tuple(int(x) for x in edges[:-1] + shift)
        return Layout(tuple(int(x) for x in edges - first), numbers, self.block)

    def batch(self, scenarios: tuple[int, ...]) -> Batch:
        """Return the slots of some scenarios (ascending) for one kernel launch; the result is
        cached.
        """
        if scenarios not in self._batches:
            self._batches[scenarios] = batch.batch_of(self.bounds, self.numbers, scenarios)
        return self._batches[scenarios]


@dataclass(eq=False)
class Ensemble:
    """All particles: the CORE columns as fields of shape (n,), and the columns of the motion models
    by name in `own`.

    The values in the columns change in place. Resampling may replace the layout. Nothing else
    changes during a run.
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
        """The slots of each scenario, as the functions that draw random numbers take them."""
        return self.layout.slots

    @property
    def places(self) -> Array:
        """The number of every slot in the whole run, int64 (n,)."""
        return np.concatenate(
            [number + np.arange(last - first) for first, last, number in self.slots]
        )

    @property
    def blocks(self) -> Blocks:
        """The blocks in which sums over particles are computed."""
        return self.layout.blocks

    def batch(self, scenarios: Sequence[int]) -> Batch:
        """Return the slots of some scenarios (ascending) for one kernel launch."""
        return self.layout.batch(tuple(scenarios))

    @property
    def columns(self) -> dict[str, Device]:
        """All columns by name."""
        return {**{column.name: getattr(self, column.name) for column in CORE}, **self.own}


def empty(seed: int, of: Layout | tuple[int, ...], own: Sequence[Column] = ()) -> Ensemble:
    """Return an ensemble of pending particles at (0, 0), released at the start, each of weight 1.

    Args:
        seed: of the run.
        of: the layout; or, for a whole run, the first slot of each scenario and, last, n.
        own: columns besides CORE.
    """
    layout = (
        of if isinstance(of, Layout) else Layout(of, of[:-1], (partials.BLOCK,) * (len(of) - 1))
    )
    scenario, n = runtime.upload(owners(layout.bounds)), layout.bounds[-1]
    return Ensemble(seed, layout, own=filled(own, n), **filled(CORE, n) | {"scenario": scenario})


def filled(columns: Sequence[Column], n: int) -> dict[str, Device]:
    """Return new device columns of n slots by name, in the given order, filled with their `first`
    values.
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
    """Return the scenario number of each slot, int32 (n,), from the bounds of the scenarios."""
    return np.repeat(np.arange(len(bounds) - 1, dtype=np.int32), np.diff(bounds))


def inherit(columns: Iterable[Device], ancestors: Array) -> None:
    """Copy each ancestor's state into its offspring (resampling), in place; ancestors: slots, (n,).

    columns: of (n,) values, or of several values per particle. The whole device arrays that hold
    these columns are rewritten, so they may hold no other columns.
    """
    for array in rows.arrays(columns):
        values = array.to_numpy()
        for row in values.reshape(-1, len(ancestors)):
            row[:] = row[ancestors]
        array.from_numpy(values)


def weighed(ensemble: Ensemble) -> WeightSums:
    """Return the sums of the weights of all particles by block."""
    return weights.sum_weights(ensemble.log_weight.to_numpy(), ensemble.blocks)


def probability(ensemble: Ensemble) -> Array:
    """Return each particle's normalised weight, float64 (n,); the weights add up to 1."""
    return weights.normalised(ensemble.log_weight.to_numpy(), ensemble.blocks)


def sample(ensemble: Ensemble, slots: Array) -> Ensemble:
    """Return a copy of some slots (sorted), for trials that must not change the run."""

    def chosen(_: str, array: Device) -> Device:
        values = array.to_numpy().reshape(-1, max(ensemble.n, 1))
        return runtime.upload(np.stack([row[slots] for row in values]))

    bounds = tuple(int(x) for x in np.searchsorted(slots, ensemble.bounds))
    layout = Layout(bounds, bounds[:-1], ensemble.layout.block)
    return _replace_columns(ensemble, layout, rows.rebuilt(ensemble.columns, chosen))


def join_ensembles(parts: Sequence[Ensemble]) -> Ensemble:
    """Return the particles of several ensembles of one run as one ensemble.

    Within each scenario the slots follow the order of `parts`.
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
    return _replace_columns(parts[0], layout, rows.rebuilt(columns[0], one))


def _replace_columns(ensemble: Ensemble, layout: Layout, columns: dict[str, Device]) -> Ensemble:
    """Return an ensemble with another layout and other columns; columns: all of them, by name."""
    core = {column.name: columns.pop(column.name) for column in CORE}
    return replace(ensemble, layout=layout, own=columns, **core)
