"""Make two cases share their random numbers, or report why they can't.

Noise is keyed by seed, slot and lattice step. So the particles of two runs pair if each scenario
has the same slots in both; case B therefore takes the particles, seed and output times of case A.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from drift.case.record import Case
from drift.engine.environment import domain
from drift.engine.motion import prior
from drift.pipeline import run_setup
from drift.spills.worlds import release
from geo import notation, sphere
from geo.box import Box
from geo.errors import UserError


def pair_cases(a: Case, b: Case) -> tuple[Case, Case]:
    """Return both cases with the slots, seed, areas and grid of the first.

    Raises:
        UserError: the cases are of different kinds, or their particles cannot pair.
    """
    _raise_for(b, "cannot be compared", _reasons_not_comparable(a, b))
    _raise_for(b, f"cannot run on the particles of {a.path.name}", _reasons_not_paired(a, b))
    b = replace(b, particles=a.particles, seed=a.seed, grid=a.grid, trajectories=a.trajectories)
    if a.spill and b.spill:
        counts = release.particles_per_class(a.spill)
        spill = replace(b.spill, worlds=a.spill.worlds, per_world=a.spill.per_world, counts=counts)
        # A common domain, so that the coast is cut into the same stretches.
        box = _box_around(
            *(case.domain or domain.within_reach(run_setup.ensemble_spec(case)) for case in (a, b))
        )
        return replace(a, domain=box), replace(b, domain=box, spill=spill)
    counts = tuple(prior.counts_of(run_setup.ensemble_spec(a)))
    empty = [
        scenario.name
        for scenario, own in zip(b.scenarios, counts, strict=True)
        if own == 0 < scenario.weight
    ]
    _raise_for(
        b,
        f"cannot run on the particles of {a.path.name}",
        [
            f'scenario "{name}" has a weight, but no particle in that case; raise particles'
            for name in empty
        ],
    )
    return replace(a, counts=counts), replace(b, counts=counts)


def _raise_for(b: Case, complaint: str, reasons: Iterable[str]) -> None:
    lines = [f"{b.path.name}: {complaint}: {reason}" for reason in reasons]
    if lines:
        raise UserError(*lines)


def _reasons_not_comparable(a: Case, b: Case) -> list[str]:
    """Return why the results of two cases cannot be compared."""
    if (a.spill is None) != (b.spill is None):
        kinds = {True: "a search", False: "a spill"}
        return [f"it is {kinds[b.spill is None]}, and {a.path.name} is {kinds[a.spill is None]}"]
    if a.direction != b.direction:
        ways = {1: "forward", -1: "backward"}
        return [f"it runs {ways[b.direction]}, and {a.path.name} {ways[a.direction]}"]
    reasons = [
        f"it {verb} at {notation.format_dtg(theirs)}, and {a.path.name} at {notation.format_dtg(own)}; make "
        f"{key} equal"
        for verb, key, own, theirs in (
            ("begins", "start", a.start, b.start),
            ("ends", "duration", a.end, b.end),
        )
        if own != theirs
    ]
    if a.areas != b.areas:
        own, theirs = (
            ", ".join(notation.hundredths(share) for share in case.areas) for case in (a, b)
        )
        reasons.append(
            f"its areas are {theirs} %, those of {a.path.name} {own} %; make output.areas equal"
        )
    if not reasons and (odd := _unshared_outputs(a, b)):
        reasons.append(
            f"only one of it and {a.path.name} has an output at {notation.format_dtg(odd[0])}"
            f"{f' and at {len(odd) - 1} other times' if odd[1:] else ''}; make output.every or "
            "output.times equal"
        )
    return reasons


def _unshared_outputs(a: Case, b: Case) -> list[np.datetime64]:
    """Return the output times that only one of two cases has, except those of its evidence."""
    evidence_times = {time for case in (a, b) for time in _evidence_times(case)}
    return sorted(time for time in np.setxor1d(a.outputs, b.outputs) if time not in evidence_times)


def _evidence_times(case: Case) -> list[np.datetime64]:
    """Return the times of sorties, contacts, sensors and finds at sea, which are always outputs."""
    times = [time for sortie in case.sorties for time in (sortie.start, sortie.end)]
    times += [contact.time for contact in case.contacts] + case.sensors.times
    return times + [find.time for find in (case.spill.finds if case.spill else ()) if find.at_sea]


def _reasons_not_paired(a: Case, b: Case) -> list[str]:
    """Return why the particles of two cases of the same kind do not pair."""
    own, theirs = (case.spill.kinds if case.spill else case.scenarios for case in (a, b))
    if len(own) != len(theirs):
        groups = "classes of objects" if a.spill else "scenarios"
        return [
            f"it has {len(theirs)} {groups}, and {a.path.name} {len(own)}, which share the "
            "particles; scenarios pair by their order; to exclude a scenario, give it "
            "weight = 0"
            if not a.spill
            else (
                f"it has {len(theirs)} {groups}, and {a.path.name} {len(own)}, which share the "
                "particles of a world"
            )
        ]
    rules = [(case.resampling.below > 0, case.resampling.method) for case in (a, b)]
    if rules[0] != rules[1] and "kahn" in {method for below, method in rules if below}:
        return [
            'resampling.method "kahn" reserves spare slots, and only one of the cases has it; make '
            "[resampling] equal"
        ]
    return []


def _box_around(one: Box, other: Box) -> Box:
    """Return the smallest box that holds both."""
    west = sphere.near_degrees(other.west, one.west)
    east = max(one.east, west + other.east - other.west)
    low = min(one.west, west)
    south, north = min(one.south, other.south), max(one.north, other.north)
    if east - low >= 360:
        return Box(-180.0, south, 180.0, north)
    start_of = sphere.wrap_degrees(low)
    return Box(start_of, south, start_of + east - low, north)


def common_output_times(a: Case, b: Case) -> list[np.datetime64]:
    """Return the output times that both cases have, in the order of the runs."""
    times = np.intersect1d(a.outputs, b.outputs)
    return list(times[:: a.direction])
