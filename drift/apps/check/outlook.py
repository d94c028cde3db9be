"""Predictions before a run: its work and memory, gaps in its forcing, and the particles' fates."""

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

# particle-steps per second on two cores, with errors, diffusion and coast (docs/performance.md)
PACE = 8e6
LONG = 600.0  # [s] of work above which a caution is printed
FOLLOWED = 2_000  # particles that are moved to the end with a coarse step
MOST_STEPS, FEWEST_STEPS = 60, 8  # coarse steps to the end
# per ensemble member: two slices on the device, and three of half their size that are read ahead
BYTES_PER_NODE = 40
NODES = 2e8  # forcing nodes read for the coarse run; limits the number of its steps
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


def work_in_words(case: Case, step: int, nodes: int = 0) -> str:
    """Return the work of a run with a step [s] as text: steps, duration, disk and memory.

    nodes: total number of grid nodes of all ensemble members.
    """
    count = -(-case.period.duration // step)
    waiting = _duration_in_words(count * case.particles / PACE)
    text = f"{count:,} steps x {case.particles:,} particles, moved in about {waiting} on two cores"
    text += f"; {case.outputs.size:,} output times"
    stored, shards = (
        case.outputs.size * case.particles * BYTES / 2**30,
        divide.number_of_shards(case, None, None),
    )
    if shards > 1:
        text += f", in {shards:,} shards, with {notation.format_bytes(shelf.bytes_of_shards(case, case.particles))} next to the results"
    elif stored >= 1:
        text += f", {stored:,.0f} GiB in the temporary folder"
    memory = (
        -(-case.particles // shards)
        * (run_setup.BYTES_PER_PARTICLE + run_setup.extra_bytes_per_particle(case))
        + nodes * BYTES_PER_NODE
    )
    return f"{text}; {max(memory / 2**30, 0.1):.1f} GiB of memory"


def shard_needs(case: Case, memory: float | None = None, shards: int | None = None) -> str | None:
    """Return the shards, disk and time of a run that exceeds the memory; None if it fits.

    Args:
        case: the case.
        memory: memory that the run may use [GiB]; None: chosen by drift.
        shards: number of shards; None: chosen by drift.
    """
    count = divide.number_of_shards(case, memory, shards)
    if count == 1:
        return None
    disk = notation.format_bytes(shelf.bytes_of_shards(case, case.particles))
    lasting = _duration_in_words(case.particles / PACE)
    return (
        f"{case.particles:,} particles are moved in {count:,} shards. They need {disk} of disk "
        "next to the results, and each step "
        f"takes about {lasting} on two cores; use fewer particles, fewer output times or "
        "--memory to change that"
    )


def caution_about_work(case: Case) -> str | None:
    """Return a caution if the step that a case states makes a lot of work; else None."""
    if case.step is None or -(-case.period.duration // case.step) * case.particles / PACE < LONG:
        return None
    return f'clock.step = {case.step} s: {work_in_words(case, case.step)}; step = "auto" takes the longest that is exact enough'


def advice_on_step(case: Case, environment: Environment, setup: Start) -> str:
    """Return what step = "auto" would choose if the case's step makes a lot of work; else ""."""
    if caution_about_work(case) is None:
        return ""
    spec = replace(run_setup.clock_spec(case), step=None)
    auto, _ = step_size.clock_of(
        case.period, spec, case.errors, environment.sources, setup.ensemble, setup.scene
    )
    count = -(-case.period.duration // auto.step)
    return (
        f'; step = "auto" would take {auto.step} s: {count:,} steps, about '
        f"{_duration_in_words(count * case.particles / PACE)}"
        if auto.step > setup.clock.step
        else ""
    )


def gaps_in_source(case: Case, source: Source) -> str:
    """Return the gaps between a source's times within the run as text; "" without gaps."""
    first, last = case.period.span
    gaps = [
        (max(a, first), min(b, last)) for a, b in stream.data_gaps(source) if a < last and b > first
    ]
    usual = np.median(np.diff(source.times)) if gaps else None
    return "; ".join(
        f"no data from {notation.format_dtg(a)} to {notation.format_dtg(b)}, {_interval_in_words(b - a)}, "
        "while its other times are "
        f"{_interval_in_words(usual)} apart"
        for a, b in gaps
    )


def predict_final_statuses(case: Case, setup: Start) -> tuple[str, str]:
    """Predict the final statuses of a sample of particles, and the time of the first loss.

    The particles are moved with a coarse step.

    Returns:
        The shares by status as text, and why a run would be rejected at its end ("" if it would
        not be).
    """
    ensemble = setup.ensemble
    chosen = np.unique(np.linspace(0, ensemble.n - 1, min(FOLLOWED, ensemble.n)).astype(np.int64))
    sampled = record.sample(ensemble, chosen)
    nodes = setup.scene.forcing.tiles.members * sum(
        tile.nlon * tile.nlat for tile in {id(t): t for t in _grids(setup)}.values()
    )
    steps = int(np.clip(NODES / max(nodes, 1), FEWEST_STEPS, MOST_STEPS))
    duration = case.period.duration
    step = setup.clock.step * max(-(-duration // (steps * setup.clock.step)), 1)
    # the last step ends at the end of the run: steered targets would go on to the end of a step
    step = -(-duration // -(-duration // step))
    clock = Clock(
        setup.clock.start,
        setup.clock.duration,
        setup.clock.direction,
        step,
        setup.clock.start % step,
    )
    scene = setup.scene.without_buoys()  # what they show is known by the run's own steps
    for low, high, part in clock.steps():
        scene.advance(sampled, low, high, part)
    weight, status = record.probability(sampled), sampled.status.to_numpy()
    share = {kind: float(weight[status == kind].sum()) for kind in Status}
    summary = ", ".join(
        f"{notation.percent(share[kind], 0)} {word}"
        for kind, word in ENDS.items()
        if share[kind] > 0
    )
    lost = share[Status.OUTSIDE] + share[Status.LEFT]
    if lost > 0:
        gone = np.isin(status, (Status.OUTSIDE, Status.LEFT)) & (weight > 0)
        when = case.period.time(int(max(sampled.status_since.to_numpy()[gone].min(), 0)))
        summary += f"; the first is lost about {notation.format_dtg(when)}"
    rejection = (
        f"a run would be rejected at its end: about {notation.percent(lost)} of the probability is lost, at most {notation.hundredths(case.max_lost)} % is allowed (max_lost). "
        "Shorten it, add a source, or widen [domain]"
    )
    basis = (
        f"roughly: {chosen.size:,} particles at a step of "
        f"{_interval_in_words(np.timedelta64(step, 's'))}"
    )
    return f"{summary} ({basis})", rejection if lost > case.max_lost else ""


def _grids(begin: Start) -> list[Any]:
    return list(begin.scene.forcing.tiles.grids)


def _interval_in_words(span: Any) -> str:
    seconds = float(span / np.timedelta64(1, "s"))
    return f"{seconds / 3600:.3g} h" if seconds >= 3600 else f"{seconds / 60:.3g} min"


def _duration_in_words(seconds: float) -> str:
    """Return a waiting time as text, rounded as an estimate."""
    for size, word in ((86_400, "days"), (3600, "h"), (60, "min")):
        if seconds >= 2 * size:
            return f"{seconds / size:,.0f} {word}"
    return f"{max(seconds, 1):.0f} s"
