"""What can be known of a run before it is made: its work, how its forcing lasts, and what will
leave it.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from drift.case.record import Case
from drift.engine.environment.environment import Environment
from drift.engine.motion import step_size
from drift.engine.motion.clock import Clock
from drift.engine.motion.spool import BYTES
from drift.engine.particles import ensemble as record
from drift.engine.particles.status import Status
from drift.pipeline import run_setup
from drift.pipeline.run_setup import Start
from drift.pipeline.shards import divide, shelf
from geo import notation
from geo.forcing.reading import stream
from geo.forcing.sources import Source

# particle-steps a second of two cores, with errors, diffusion and the coast (docs/performance.md)
PACE = 8e6
LONG = 600.0  # [s] of work from which a caution is given
FOLLOWED = 2_000  # particles that are moved to the end by a coarse step
MOST_STEPS, FEWEST_STEPS = 60, 8  # that those particles take
# of a member: two slices on the device, three of half their size that are read ahead
BYTES_PER_NODE = 40
NODES = 2e8  # nodes of forcing that are read for them; it limits the number of steps
ENDS = {
    Status.ADRIFT: "adrift",
    Status.ASHORE: "ashore",
    Status.SUNK: "sunk",
    Status.PENDING: "not yet released",
    Status.UNDER_WAY: "under way",
    Status.ARRIVED: "arrived",
    Status.AGROUND: "aground",
    Status.OUTSIDE: "run out of forcing",
    Status.LEFT: "leave the domain",
}


def work(case: Case, step: int, nodes: int = 0) -> str:
    """Return how much a run with a step [s] has to do, and about how long that takes.

    nodes: of the grids of all members of an ensemble.
    """
    count = -(-case.period.duration // step)
    waiting = _lasting(count * case.particles / PACE)
    text = f"{count:,} steps x {case.particles:,} particles, moved in about {waiting} on two cores"
    text += f"; {case.outputs.size:,} output times"
    kept, many = case.outputs.size * case.particles * BYTES / 2**30, divide.number(case, None, None)
    if many > 1:
        text += f", in {many:,} shards, {notation.size(shelf.need(case, case.particles))} beside the results"
    elif kept >= 1:
        text += f", {kept:,.0f} GiB in the temporary folder"
    held = (
        -(-case.particles // many) * (run_setup.BYTES_PER_PARTICLE + run_setup.more_bytes(case))
        + nodes * BYTES_PER_NODE
    )
    return f"{text}; {max(held / 2**30, 0.1):.1f} GiB of memory"


def needs(case: Case, memory: float | None = None, shards: int | None = None) -> str | None:
    """Return the shards, disk and time that a run larger than memory needs; None where it fits.

    memory: [GiB] that it may take, and shards: how many, as the command line gives them.
    """
    many = divide.number(case, memory, shards)
    if many == 1:
        return None
    kept = notation.size(shelf.need(case, case.particles))
    lasting = _lasting(case.particles / PACE)
    return (
        f"{case.particles:,} particles are moved in {many:,} shards. They need {kept} of disk beside the results, and each step "
        f"takes about {lasting} on two cores; fewer particles, fewer output times or --memory change that"
    )


def caution(case: Case) -> str | None:
    """Return a word of caution about the work of a case that states its step, if there is much of
    it.
    """
    if case.step is None or -(-case.period.duration // case.step) * case.particles / PACE < LONG:
        return None
    return f'clock.step = {case.step} s: {work(case, case.step)}; step = "auto" takes the longest that is exact enough'


def advised(case: Case, where: Environment, begin: Start) -> str:
    """Return what "auto" would do instead of a step that makes much work; "" where there is nothing
    to say.
    """
    if caution(case) is None:
        return ""
    free = replace(run_setup.clock_spec(case), step=None)
    auto, _ = step_size.clock_of(
        case.period, free, case.errors, where.sources, begin.ensemble, begin.scene
    )
    count = -(-case.period.duration // auto.step)
    return (
        f'; step = "auto" would take {auto.step} s: {count:,} steps, about {_lasting(count * case.particles / PACE)}'
        if auto.step > begin.clock.step
        else ""
    )


def holes(case: Case, source: Source) -> str:
    """Return when within the run a source has nothing between its times; "" where it has no holes."""
    first, last = case.period.span
    gaps = [
        (max(a, first), min(b, last)) for a, b in stream.holes_of(source) if a < last and b > first
    ]
    usual = np.median(np.diff(source.times)) if gaps else None
    return "; ".join(
        f"nothing from {notation.group(a)} to {notation.group(b)}, {_hours(b - a)}, where its times are else "
        f"{_hours(usual)} apart"
        for a, b in gaps
    )


def ends(case: Case, begin: Start) -> tuple[str, str]:
    """Return what becomes of a sample of particles by the end of the run, and when the first leave
    it.

    They are moved by a coarse step. The second is why a run would be refused at its end, "" where
    it would not.
    """
    ensemble = begin.ensemble
    chosen = np.unique(np.linspace(0, ensemble.n - 1, min(FOLLOWED, ensemble.n)).astype(np.int64))
    some = record.sample(ensemble, chosen)
    nodes = begin.scene.forcing.tiles.members * sum(
        tile.nlon * tile.nlat for tile in {id(t): t for t in _grids(begin)}.values()
    )
    steps = int(np.clip(NODES / max(nodes, 1), FEWEST_STEPS, MOST_STEPS))
    duration = case.period.duration
    step = begin.clock.step * max(-(-duration // (steps * begin.clock.step)), 1)
    # from the start to the end: what steers would go on until a step's end
    step = -(-duration // -(-duration // step))
    clock = Clock(
        begin.clock.start,
        begin.clock.duration,
        begin.clock.direction,
        step,
        begin.clock.start % step,
    )
    for low, high, part in clock.steps():
        begin.scene.advance(some, low, high, part)
    weight, status = record.probability(some), some.status.to_numpy()
    share = {kind: float(weight[status == kind].sum()) for kind in Status}
    text = ", ".join(
        f"{notation.percent(share[kind], 0)} {word}"
        for kind, word in ENDS.items()
        if share[kind] > 0
    )
    lost = share[Status.OUTSIDE] + share[Status.LEFT]
    if lost > 0:
        gone = np.isin(status, (Status.OUTSIDE, Status.LEFT)) & (weight > 0)
        when = case.period.time(int(max(some.status_since.to_numpy()[gone].min(), 0)))
        text += f"; the first is lost about {notation.group(when)}"
    refused = (
        f"a run would be rejected at its end: about {notation.percent(lost)} of the probability is lost, at most {notation.hundredths(case.max_lost)} % is allowed (max_lost). "
        "Shorten it, add a source, or widen [domain]"
    )
    rough = f"roughly: {chosen.size:,} particles at a step of {_hours(np.timedelta64(step, 's'))}"
    return f"{text} ({rough})", refused if lost > case.max_lost else ""


def _grids(begin: Start) -> list[Any]:
    return list(begin.scene.forcing.tiles.grids)


def _hours(span: Any) -> str:
    seconds = float(span / np.timedelta64(1, "s"))
    return f"{seconds / 3600:.3g} h" if seconds >= 3600 else f"{seconds / 60:.3g} min"


def _lasting(seconds: float) -> str:
    """Return a time of waiting in words that fit an estimate."""
    for size, word in ((86_400, "days"), (3600, "h"), (60, "min")):
        if seconds >= 2 * size:
            return f"{seconds / size:,.0f} {word}"
    return f"{max(seconds, 1):.0f} s"
