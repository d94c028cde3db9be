"""A run cut into shards: how many, and what each goes through.

A shard is a range of whole blocks of particles (drift.engine.particles.partials). Noise goes by a
particle's number in the whole run and sums go by blocks, so that no number of shards changes a bit
of the results.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from drift.case.record import Case
from drift.engine.environment import lost
from drift.engine.environment.environment import Environment
from drift.engine.environment.lost import Lacking
from drift.engine.motion import prior
from drift.engine.motion.clock import Clock
from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.scene import Scene
from drift.engine.motion.step_size import TRIAL_SIZE
from drift.engine.particles import ensemble as record
from drift.engine.particles.ensemble import Ensemble, Layout
from drift.engine.particles.partials import WORLDS
from drift.pipeline import run_setup
from drift.pipeline.run_setup import Setup
from geo.array import Array
from geo.errors import UserError
from kernels.runtime import devices, runtime
from kernels.runtime import memory as machine_memory
from kernels.step import coast as device_coast
from kernels.step.coast import DeviceCoast

GIB = 2**30
# [bytes] that a run takes however few its particles are: the program, the forcing, the coast, maps
BASE = 700 * 2**20
# [bytes] a particle of the shard under way is given, while it is drawn and moved: about 130 were
# seen
HELD = 200
WEIGHED = 6_000  # [bytes] a world of a spill while finds weigh it
TOLD = 150  # [bytes] more for each output: 8,600 in all were seen at 21
LEAST = 2**16  # particles in a shard, if memory is scarce
LOSS = 2**20  # particles in a shard at most: what is under way is lost when a run is stopped
# on a graphics card, which is expected to move as many in the same time (docs/backends.md)
LOSS_CARD = 2**23
PER_WORKER = 4  # shards at least, so that none waits long for another at the end


@dataclass(frozen=True)
class Divided:
    """A run that is about to be moved shard by shard."""

    setup: Setup
    layout: Layout  # of all particles
    many: int  # shards


@dataclass(frozen=True)
class Workers:
    """Those who move the shards of a run."""

    count: int
    together: int  # processes of the run on one machine at most, this one among them
    free: float  # [bytes] of memory that is left on its machine to the one with the least
    limit: float = math.inf  # [bytes] that dask lets the one with the least take


def number(
    case: Case, memory: float | None, shards: int | None, workers: Workers | None = None
) -> int:
    """Return how many shards a run is cut into: as many as is said, or as its memory and the loss
    at a stop ask for.

    memory: [GiB] that it may take on one machine, by default half of what is free. workers: that
    move them; None: this process does. 1 without workers is a run in one piece. On a graphics card
    a shard must fit into half of what the card has left, too. Raises UserError for what cannot be.
    """
    at_once = workers.together if workers else 1
    card = None if workers else runtime.room()
    least = at_once * (BASE + HELD * LEAST) / GIB
    if memory is not None and not isinstance(memory, int | float):
        raise UserError(f"memory = {memory!r}: give a number of GiB")
    if memory is not None and not least <= memory < math.inf:
        who = f"{at_once} processes on one machine take" if workers else "a run takes"
        raise UserError(
            f"--memory {memory:.3g} (GiB): {who} {_up(least)} GiB at least; give as much{', or fewer workers' * bool(workers)}"
        )
    if shards is not None and not isinstance(shards, int):
        raise UserError(f"--shards {shards}: give a whole number")
    if case.resampling.fills:
        if shards not in (None, 1) or workers:
            raise UserError(
                f'[resampling] method = "{case.resampling.method}" goes by an estimate of all particles: run it in one piece, without '
                "--shards or --workers or --cluster"
            )
        whole = (BASE + case.particles * held(case)) / GIB
        if whole > machine_memory.free() / GIB:
            raise UserError(
                f'particles: {case.particles:,} in one piece, as [resampling] method = "{case.resampling.method}" asks for, take '
                f"{_up(whole)} GiB of memory, and {machine_memory.free() / GIB:.1f} GiB are free; give fewer"
            )
        run_setup.refuse_beyond(
            card, case, case.particles, "particles", "give fewer, or use --backend cpu"
        )
        return 1
    spill = case.spill
    weighed = (BASE + (WEIGHED + TOLD * case.outputs.size) * spill.worlds) / GIB if spill else 0.0
    if spill and memory is not None and memory < weighed:
        raise UserError(
            f"--memory {memory:.3g} (GiB): to weigh a spill's {spill.worlds:,} worlds takes {_up(weighed)} GiB; give as much, or "
            "fewer worlds"
        )
    most = (
        -(-spill.worlds // WORLDS)
        if spill
        else prior.layout(run_setup.ensemble_spec(case)).blocks.first.size
    )
    if shards is not None:
        if not 1 <= shards <= most:
            what = "of worlds" if spill else "of particles"
            raise UserError(
                f"--shards {shards}: {case.path.name} has {most:,} blocks {what}; give 1 to {most:,}"
            )
        each = (BASE + math.ceil(case.particles / shards) * held(case)) * at_once / GIB
        if memory is not None and each > memory:
            raise UserError(
                f"--shards {shards}: so large they take {_up(each)} GiB, and --memory is {memory:.3g} (GiB); give one of them"
            )
        remedy = (
            "give more shards"
            if shards < most
            else "use --backend cpu, or end other programs on the card"
        )
        run_setup.refuse_beyond(
            card, case, math.ceil(case.particles / shards), f"--shards {shards}", remedy
        )
        return shards
    if memory is not None:
        room = min(memory * GIB / at_once, workers.limit if workers else math.inf)
    else:
        room = min(workers.free, workers.limit) / 2 if workers else machine_memory.free() / 2
    size = max(int((room - BASE) / held(case)), LEAST)
    if card is not None:
        size = min(
            size, max(int((card / 2 - devices.LEAST) / run_setup.bytes_on_card(case)), LEAST)
        )
    size = min(size, LOSS if card is None else LOSS_CARD)
    return min(
        max(math.ceil(case.particles / size), PER_WORKER * (workers.count if workers else 0), 1),
        most,
    )


def _up(size: float) -> str:
    """Return a size rounded up to a tenth: what is asked for suffices."""
    return f"{math.ceil(10 * size) / 10:g}"


def held(case: Case) -> int:
    """Return how many bytes a particle of the shard under way is given."""
    return HELD + run_setup.more_bytes(case)


Begun = tuple[
    Array, Lacking
]  # how a shard's places were drawn (drift.engine.motion.prior.Prior), and what lacks forcing
Deal = Callable[[Clock, Sequence[Layout]], Iterable[Begun]]


def begun(case: Case, where: Environment, scene: Scene, clock: Clock, layout: Layout) -> Begun:
    """Return how the places of a shard were drawn, and what of it lacks forcing as the run begins.

    Its particles are drawn in full when they are moved. To draw them once and keep them in between
    would cost more: of a million, places take 0.24 s of processor time and all of it 0.61 s;
    writing, checking and reading 96 bytes each 0.4 s.
    """
    drawn = prior.draw_ensemble(
        run_setup.spec_of(case, where), scene.place.coast, layout, still=True
    )
    return drawn.tried, lost.lacking(where.box, drawn.ensemble, scene, clock)


def prepare(case: Case, where: Environment, many: int, deal: Deal | None = None) -> Divided:
    """Return a case's run, cut into some shards; close `setup.scene.forcing` after it.

    deal: does what `begun` does for the shards, by default this process does. Raises UserError as
    drift.pipeline.run_setup.prepare does.
    """
    assert not case.spill  # drift.pipeline.shards.spilled
    spec = run_setup.spec_of(case, where)
    coast = device_coast.upload(where.coast) if where.coast else None
    whole = prior.layout(spec)
    layouts = whole.shards(many)
    setup = run_setup.staged(case, where, coast, _sample(spec, coast, whole), ())
    with run_setup.closed_on_failure(setup):
        if deal is None:
            parts = list(map(partial(begun, case, where, setup.scene, setup.clock), layouts))
        else:
            parts = list(deal(setup.clock, layouts))
        dry = prior.dry(spec, np.sum([tried for tried, _ in parts], axis=0), coast)
        lost.check_prior(
            spec, where, case.max_lost, setup.scene, lost.merged([lacks for _, lacks in parts])
        )
        guide = run_setup.guide_of(case, where, setup)
    return Divided(replace(setup, dry=dry, guide=guide), whole, many)


def _sample(spec: EnsembleSpec, coast: DeviceCoast | None, whole: Layout) -> Ensemble:
    """Return the particles by which the step of a run is chosen, evenly spread over it."""
    n = whole.bounds[-1]
    chosen = np.unique(np.linspace(0, n - 1, min(TRIAL_SIZE, n)).astype(np.int64))
    parts = []
    for layout, slots in _around(whole, chosen):
        drawn = prior.draw_ensemble(spec, coast, layout).ensemble
        parts.append(record.sample(drawn, slots))
    return record.join_ensembles(parts)


def _around(whole: Layout, chosen: np.ndarray) -> Iterator[tuple[Layout, np.ndarray]]:
    """Yield layouts of the blocks that hold chosen slots, and the slots within."""
    edges = np.append(whole.blocks.first, whole.blocks.n)
    block = np.searchsorted(edges, chosen, "right") - 1
    for run in np.split(np.arange(len(block)), np.flatnonzero(np.diff(block) > 1) + 1):
        first, last = int(edges[block[run[0]]]), int(edges[block[run[-1]] + 1])
        yield whole.some(first, last), chosen[run] - first
