"""A spill's run in shards: ranges of whole blocks of its worlds, with all classes of objects.

Importance sampling simulates the worlds in rounds: first those of the prior, then those of each
proposal. The shards of each round are stored beside those of earlier rounds. The weights of the
worlds are computed from the files part by part, as from the file of a run in one piece.
"""

import contextlib
import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from drift.case.record import Case
from drift.engine.environment import lost
from drift.engine.environment.environment import Environment
from drift.engine.motion import simulate
from drift.engine.motion.clock import Clock
from drift.engine.motion.errors.buoys import Buoys
from drift.engine.motion.forcing import Forcing
from drift.engine.motion.scene import Scene
from drift.engine.motion.spool import ShardFile, SnapshotStore
from drift.engine.motion.step_size import TRIAL_SIZE
from drift.engine.particles import ensemble as record
from drift.engine.particles.ensemble import Ensemble, Layout
from drift.engine.particles.partials import WORLDS
from drift.pipeline import run_setup
from drift.pipeline.buoys import share_with_buoys
from drift.pipeline.run_options import Job
from drift.pipeline.run_setup import Setup
from drift.pipeline.shards import cluster, fingerprint, shelf
from drift.pipeline.shards.work import Work
from drift.spills.worlds import release
from drift.spills.worlds.records import Spill
from drift.spills.worlds.renewal import DriftedRun
from drift.spills.worlds.strandings import Landings
from drift.spills.worlds.worlds import Worlds
from geo.array import Array
from geo.errors import UserError
from kernels.step import coast as device_coast
from kernels.step.coast import DeviceCoast

BYTES_STAY = 16  # [bytes] a stay ashore in a shard's file
BYTES_WEIGHED = 4  # [bytes] a particle, for its final weight
DRY = "dry"  # stored column of a shard: objects of each class that could not be placed on water


@dataclass(frozen=True)
class Shards:
    """A spill's run, divided into shards."""

    setup: Setup
    worlds: Worlds
    # of each shard, the number of its first world and of the one after its last
    spans: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Unit:
    """A shard of a round: a drift.pipeline.shards.work.Task."""

    case: Case
    clock: Clock
    layout: Layout
    worlds: Worlds  # of the shard alone
    seed: int
    number: int
    buoys: Buoys | None = None  # errors at the drifting buoys

    @property
    def opened(self) -> Case:
        """The case whose environment the run has."""
        return self.case

    @property
    def n(self) -> int:
        """Number of particles."""
        return self.layout.bounds[-1]

    @property
    def of(self) -> str:
        """The worlds and the seed, which a proposal determines in later rounds."""
        return f"{self.worlds.digest} {self.seed}"

    def draw(self, coast: DeviceCoast) -> tuple[Ensemble, Array]:
        """Draw the particles; return with them the number of each class not placed on water."""
        case = self.case
        assert case.spill is not None
        ensemble, dry = release.draw_some_worlds(
            case.spill, self.worlds, case.period, case.errors, coast, self.seed, self.layout
        )
        return run_setup.with_buoy_columns(case, ensemble), dry

    @property
    def name(self) -> str:
        """Name of its file, without suffix."""
        return f"shard-{self.number:05}"

    def move(
        self, scene: Scene, where: Environment, tell: simulate.Progress | None, kept: Work
    ) -> ShardFile:
        """Return the file of the particles at all outputs and their stays ashore; see
        `Task.move`."""
        return kept.reel(self.name, self.n, partial(self._fill, scene, where, tell), self.of)

    def _fill(
        self, scene: Scene, where: Environment, tell: simulate.Progress | None, reel: ShardFile
    ) -> None:
        case = self.case
        if tell:
            tell(0.0)
        ensemble, dry = self.draw(scene.place.coast)
        landings = Landings(ensemble, scene.place.beach.stay > 0)
        with contextlib.closing(Forcing(list(where.scenarios), case.direction)) as forcing:
            own = share_with_buoys(replace(scene, forcing=forcing), self.buoys)
            outputs = case.period.seconds(case.outputs)
            watch = landings.watch if landings.refloats else None
            moments = simulate.run(ensemble, own, self.clock, outputs, tell, watch)
            reel.record(case.period, moments)
        reel.record_end(ensemble, case.period.duration)
        landings.note(reel)
        reel.note(DRY, dry)


@dataclass(frozen=True)
class Rounds:
    """Simulates the rounds of a spill; results can be read while the store is open."""

    job: Job
    run: Shards
    kept: Work
    mark: Mapping[str, str]  # the run's fingerprint

    def moved(self, drawn: Worlds, seed: int, number: int) -> DriftedRun:
        """Simulate a round shard by shard.

        Args:
            drawn: the worlds of the round.
            seed: the seed of their objects.
            number: number of the round, from 0.

        Raises:
            UserError: objects could not be placed on water, or too many particles were lost.
        """
        job, kept, setup, many = self.job, self.kept, self.run.setup, len(self.run.spans)
        units = [
            replace(unit, buoys=setup.scene.buoys)
            for unit in _units(job.case, setup.clock, self.run.spans, drawn, seed, number * many)
        ]
        if job.client is not None:
            missing = [unit for unit in units if not kept.finished(unit.name, unit.of)]
            cluster.move_shards_on_cluster(
                job.client, kept, self.mark, missing, partial(self._tell, many - len(missing))
            )
        reels = [
            unit.move(setup.scene, job.where, partial(self._tell, done), kept)
            for done, unit in enumerate(units)
        ]
        spool = SnapshotStore([reels], worlds=True)
        try:
            release.check_water(
                _spill(job.case), np.sum([dry for _, dry in spool.noted(DRY)], axis=0)
            )
            run_setup.check_end(job.case, job.where, setup, spool, None)
        except UserError:
            kept.drop()  # the same command would be rejected again
            raise
        return DriftedRun(seed, spool, drawn)

    def _tell(self, done: int, share: float) -> None:
        """Report the progress of the round: `done` shards and the share of the next."""
        self.job.tell("drift", min((done + share) / len(self.run.spans), 1.0))


@contextlib.contextmanager
def open_rounds(job: Job, run: Shards) -> Iterator[Rounds]:
    """Open the store of a spill's shards and yield what simulates its rounds."""
    need = (
        shelf.bytes_of_shards(job.case, job.case.particles)
        + (BYTES_STAY + BYTES_WEIGHED) * job.case.particles
    )
    slices, mark = (
        shelf.bytes_of_slices(job.case, run.setup.scene),
        fingerprint.fingerprint_of(job.case, job.where, len(run.spans)),
    )
    with (
        shelf.open_shelf(job.out, mark, need, slices) as kept,
        shelf.cache_forcing_in(job.where, kept),
    ):
        yield Rounds(job, run, kept, mark)


def prepare(case: Case, where: Environment, many: int) -> Shards:
    """Set up a spill's run in `many` shards; the caller closes `setup.scene.forcing`.

    Raises UserError as `drift.pipeline.run_setup.prepare` does.
    """
    spill, drawn = _spill(case), run_setup.draw_prior_worlds(case, where)
    blocks = -(-spill.worlds // WORLDS)
    cuts = np.unique(np.rint(np.linspace(0, blocks, many + 1)).astype(int))
    edges = np.minimum(cuts * WORLDS, spill.worlds).tolist()
    spans = tuple(itertools.pairwise(edges))
    coast = device_coast.upload(where.coast)
    units = _units(case, Clock(0, 0, case.direction, 1, 0), spans, drawn, case.seed, 0)
    setup = run_setup.build_setup(
        case, where, coast, _sample(spill, units, coast), (0.0,) * len(case.scenarios)
    )
    with run_setup.closed_on_failure(setup):
        lacks = [
            lost.prior_without_forcing(where.box, unit.draw(coast)[0], setup.scene, setup.clock)
            for unit in units
        ]
        lost.check_prior(setup.spec, where, case.max_lost, setup.scene, lost.merged(lacks))
        setup = run_setup.add_buoys(setup, run_setup.buoys_of(case, where, setup.clock))
    return Shards(setup, run_setup.weigh_worlds_by_buoys(setup.scene.buoys, drawn), spans)


def _spill(case: Case) -> Spill:
    assert case.spill is not None
    return case.spill


def _units(
    case: Case,
    clock: Clock,
    spans: tuple[tuple[int, int], ...],
    drawn: Worlds,
    seed: int,
    first: int,
) -> list[Unit]:
    """Return the shards of a round's worlds, numbered from `first`."""
    return [
        Unit(
            case,
            clock,
            release.layout_of_worlds(_spill(case), *span),
            drawn.some(*span),
            seed,
            number,
        )
        for number, span in enumerate(spans, first)
    ]


def _sample(spill: Spill, units: list[Unit], coast: DeviceCoast) -> Ensemble:
    """Return an evenly spaced sample of the particles, from which the step is chosen.

    Raises UserError if objects cannot be placed on water.
    """
    n = release.layout_of_worlds(spill).bounds[-1]
    chosen = np.unique(np.linspace(0, n - 1, min(TRIAL_SIZE, n)).astype(np.int64))
    parts: list[list[Ensemble]] = [[] for _ in spill.kinds]  # of each class, shard after shard
    dry = np.zeros(len(spill.kinds), np.int64)
    for unit in units:
        ensemble, failed = unit.draw(coast)
        dry += failed
        for own, slots in zip(parts, ensemble.slots, strict=True):
            here = chosen - slots.number + slots.first
            here = here[(here >= slots.first) & (here < slots.last)]
            if here.size:
                own.append(record.sample(ensemble, here))
    release.check_water(spill, dry)
    return record.join_ensembles([part for own in parts for part in own])
