"""Divide a run into shards: how many, and the particles of each.

A shard is a range of whole blocks of particles (drift.engine.particles.partials). Random numbers
depend on a particle's number in the whole run, and sums are taken by blocks, so the results are the
same to the bit for any number of shards.
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
# [bytes] of a run without its particles: the program, the forcing, the coast, maps
BASE = 700 * 2**20
# [bytes] reserved for a particle of the shard being drawn and moved; about 130 measured
HELD = 200
WEIGHED = 6_000  # [bytes] a world of a spill while the finds weight the worlds
TOLD = 150  # [bytes] a world and output in addition: 8,600 in total measured at 21 outputs
LEAST = 2**16  # smallest number of particles in a shard when memory is short
LOSS = 2**20  # largest number in a shard: the unfinished shard is lost when a run is stopped
# on a graphics card, which moves about as many in the same time (docs/backends.md)
LOSS_CARD = 2**23
PER_WORKER = 4  # least number of shards per worker, so that workers end at about the same time


@dataclass(frozen=True)
class Divided:
    """A run, divided into shards."""

    setup: Setup
    layout: Layout  # of all particles
    many: int  # number of shards


@dataclass(frozen=True)
class Workers:
    """The workers of a cluster."""

    count: int
    together: int  # largest number of the run's processes on one machine, this process included
    free: float  # [bytes] least free memory per process of any machine
    limit: float = math.inf  # [bytes] lowest memory limit that dask sets for a worker


def number_of_shards(
    case: Case, memory: float | None, shards: int | None, workers: Workers | None = None
) -> int:
    """Return the number of shards of a run; 1 without workers is a run in one piece.

    Without `shards`, a shard fits into the memory and is small enough that a stopped run loses
    little. On a graphics card, a shard also fits into half of the card's free memory.

    Args:
        case: the case of the run.
        memory: memory limit of the run on one machine [GiB]; None: half of the free memory.
        shards: the requested number of shards; None: choose it.
        workers: workers that move the shards; None: this process does.

    Raises:
        UserError: the memory or the number of shards is out of range, or shards exclude the
            case's resampling method.
    """
    at_once = workers.together if workers else 1
    card = None if workers else runtime.room()
    least = at_once * (BASE + HELD * LEAST) / GIB
    if memory is not None and not isinstance(memory, int | float):
        raise UserError(f"memory = {memory!r}: give a number of GiB")
    if memory is not None and not least <= memory < math.inf:
        who = f"{at_once} processes on one machine take" if workers else "a run takes"
        raise UserError(
            f"--memory {memory:.3g} (GiB): {who} {_round_up(least)} GiB at least; give as much{', or fewer workers' * bool(workers)}"
        )
    if shards is not None and not isinstance(shards, int):
        raise UserError(f"--shards {shards}: give a whole number")
    if case.resampling.fills:
        if shards not in (None, 1) or workers:
            raise UserError(
                f'[resampling] method = "{case.resampling.method}" needs all particles at once: run it in one piece, without '
                "--shards or --workers or --cluster"
            )
        whole = (BASE + case.particles * _bytes_per_particle(case)) / GIB
        if whole > machine_memory.free() / GIB:
            raise UserError(
                f'particles: {case.particles:,} in one piece, as [resampling] method = "{case.resampling.method}" asks for, take '
                f"{_round_up(whole)} GiB of memory, and {machine_memory.free() / GIB:.1f} GiB are free; give fewer"
            )
        run_setup.check_array_size(
            card, case, case.particles, "particles", "give fewer, or use --backend cpu"
        )
        return 1
    spill = case.spill
    weighed = (BASE + (WEIGHED + TOLD * case.outputs.size) * spill.worlds) / GIB if spill else 0.0
    if spill and memory is not None and memory < weighed:
        raise UserError(
            f"--memory {memory:.3g} (GiB): weighting the spill's {spill.worlds:,} worlds takes {_round_up(weighed)} GiB; give as much, or "
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
        each = (
            (BASE + math.ceil(case.particles / shards) * _bytes_per_particle(case)) * at_once / GIB
        )
        if memory is not None and each > memory:
            raise UserError(
                f"--shards {shards}: shards of this size take {_round_up(each)} GiB, and --memory is {memory:.3g} (GiB); give only one of the two"
            )
        remedy = (
            "give more shards"
            if shards < most
            else "use --backend cpu, or end other programs on the card"
        )
        run_setup.check_array_size(
            card, case, math.ceil(case.particles / shards), f"--shards {shards}", remedy
        )
        return shards
    if memory is not None:
        room = min(memory * GIB / at_once, workers.limit if workers else math.inf)
    else:
        room = min(workers.free, workers.limit) / 2 if workers else machine_memory.free() / 2
    size = max(int((room - BASE) / _bytes_per_particle(case)), LEAST)
    if card is not None:
        size = min(
            size, max(int((card / 2 - devices.LEAST) / run_setup.bytes_on_card(case)), LEAST)
        )
    size = min(size, LOSS if card is None else LOSS_CARD)
    return min(
        max(math.ceil(case.particles / size), PER_WORKER * (workers.count if workers else 0), 1),
        most,
    )


def _round_up(size: float) -> str:
    """Return a size rounded up to a tenth, so that the size named in a message suffices."""
    return f"{math.ceil(10 * size) / 10:g}"


def _bytes_per_particle(case: Case) -> int:
    """Return the bytes reserved for a particle of the shard being moved."""
    return HELD + run_setup.extra_bytes_per_particle(case)


Begun = tuple[
    Array, Lacking
]  # trials of a shard's positions (drift.engine.motion.prior.Prior), and particles without forcing
Deal = Callable[[Clock, Sequence[Layout]], Iterable[Begun]]


def check_shard_start(
    case: Case, where: Environment, scene: Scene, clock: Clock, layout: Layout
) -> Begun:
    """Draw the positions of a shard; return their trials and the particles without initial forcing.

    The particles are drawn again, completely, when they are moved: storing them would cost more.
    For
    a million particles, drawing takes 0.24 s for positions and 0.61 s for everything; writing,
    checking and reading 100 bytes each takes 0.4 s.

    Args:
        case: the case of the run.
        where: its environment.
        scene: forcing, motion models and coast.
        clock: the steps of the run.
        layout: the particles of the shard.
    """
    drawn = prior.draw_ensemble(
        run_setup.spec_of(case, where), scene.place.coast, layout, still=True
    )
    return drawn.tried, lost.prior_without_forcing(where.box, drawn.ensemble, scene, clock)


def prepare(case: Case, where: Environment, many: int, deal: Deal | None = None) -> Divided:
    """Set up a case's run in shards; the caller closes `setup.scene.forcing`.

    Args:
        case: the case of the run; not a spill (see drift.pipeline.shards.spilled).
        where: its environment.
        many: the number of shards.
        deal: computes `begun` for all shards, on workers; None: this process does.

    Raises:
        UserError: as `drift.pipeline.run_setup.prepare`.
    """
    assert not case.spill  # drift.pipeline.shards.spilled
    spec = run_setup.spec_of(case, where)
    coast = device_coast.upload(where.coast) if where.coast else None
    whole = prior.layout(spec)
    layouts = whole.shards(many)
    setup = run_setup.build_setup(case, where, coast, _sample(spec, coast, whole), ())
    with run_setup.closed_on_failure(setup):
        if deal is None:
            parts = list(
                map(partial(check_shard_start, case, where, setup.scene, setup.clock), layouts)
            )
        else:
            parts = list(deal(setup.clock, layouts))
        dry = prior.shares_on_land(spec, np.sum([tried for tried, _ in parts], axis=0), coast)
        lost.check_prior(
            spec, where, case.max_lost, setup.scene, lost.merged([lacks for _, lacks in parts])
        )
        setup = run_setup.add_buoys(setup, run_setup.buoys_of(case, where, setup.clock))
        guide = run_setup.guide_of(case, where, setup)
    return Divided(replace(setup, dry=dry, guide=guide), whole, many)


def _sample(spec: EnsembleSpec, coast: DeviceCoast | None, whole: Layout) -> Ensemble:
    """Return an evenly spaced sample of the particles, from which the step is chosen."""
    n = whole.bounds[-1]
    chosen = np.unique(np.linspace(0, n - 1, min(TRIAL_SIZE, n)).astype(np.int64))
    parts = []
    for layout, slots in _blocks_of_slots(whole, chosen):
        drawn = prior.draw_ensemble(spec, coast, layout).ensemble
        parts.append(record.sample(drawn, slots))
    return record.join_ensembles(parts)


def _blocks_of_slots(whole: Layout, chosen: np.ndarray) -> Iterator[tuple[Layout, np.ndarray]]:
    """Yield layouts of the blocks that contain chosen slots, and the slots' numbers in them."""
    edges = np.append(whole.blocks.first, whole.blocks.n)
    block = np.searchsorted(edges, chosen, "right") - 1
    for run in np.split(np.arange(len(block)), np.flatnonzero(np.diff(block) > 1) + 1):
        first, last = int(edges[block[run[0]]]), int(edges[block[run[-1]] + 1])
        yield whole.some(first, last), chosen[run] - first
