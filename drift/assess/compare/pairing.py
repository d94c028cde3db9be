"""A case held to another's slots, seed and output times, so that they share their random numbers;
or why it can't be.

Noise is keyed by seed, slot and lattice step. So particles pair where both runs give each scenario
the same slots.
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


def paired(a: Case, b: Case) -> tuple[Case, Case]:
    """Return two cases with the slots, seed, areas and grid of the first; raise UserError where
    that cannot be.
    """
    _refuse(b, "cannot be compared", _unlike(a, b))
    _refuse(b, f"cannot be held to the slots of {a.path.name}", _unheld(a, b))
    b = replace(b, particles=a.particles, seed=a.seed, grid=a.grid, trajectories=a.trajectories)
    if a.spill and b.spill:
        counts = release.per_world(a.spill)
        spill = replace(b.spill, worlds=a.spill.worlds, per_world=a.spill.per_world, counts=counts)
        # One domain, so that the coast is cut into the same stretches.
        box = _around(
            *(case.domain or domain.within_reach(run_setup.ensemble_spec(case)) for case in (a, b))
        )
        return replace(a, domain=box), replace(b, domain=box, spill=spill)
    counts = tuple(prior.counts_of(run_setup.ensemble_spec(a)))
    empty = [
        scenario.name
        for scenario, own in zip(b.scenarios, counts, strict=True)
        if own == 0 < scenario.weight
    ]
    _refuse(
        b,
        f"cannot be held to the slots of {a.path.name}",
        [
            f'scenario "{name}" has a weight, and no particle there; raise particles'
            for name in empty
        ],
    )
    return replace(a, counts=counts), replace(b, counts=counts)


def _refuse(b: Case, what: str, reasons: Iterable[str]) -> None:
    lines = [f"{b.path.name}: {what}: {reason}" for reason in reasons]
    if lines:
        raise UserError(*lines)


def _unlike(a: Case, b: Case) -> list[str]:
    """Return why the results of two cases are not of one kind."""
    if (a.spill is None) != (b.spill is None):
        kinds = {True: "a search", False: "a spill"}
        return [f"it is {kinds[b.spill is None]}, and {a.path.name} is {kinds[a.spill is None]}"]
    if a.direction != b.direction:
        ways = {1: "forward", -1: "backward"}
        return [f"it runs {ways[b.direction]}, and {a.path.name} {ways[a.direction]}"]
    reasons = [
        f"it {verb} at {notation.group(theirs)}, and {a.path.name} at {notation.group(own)}; make {key} equal"
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
    if not reasons and (odd := _odd_outputs(a, b)):
        reasons.append(
            f"only one of it and {a.path.name} has an output at {notation.group(odd[0])}"
            f"{f' and at {len(odd) - 1} other times' if odd[1:] else ''}; make output.every or output.times equal"
        )
    return reasons


def _odd_outputs(a: Case, b: Case) -> list[np.datetime64]:
    """Return the output times that only one of two cases has, less those at which something was
    searched or seen.
    """
    seen = {time for case in (a, b) for time in _seen(case)}
    return sorted(time for time in np.setxor1d(a.outputs, b.outputs) if time not in seen)


def _seen(case: Case) -> list[np.datetime64]:
    """Return when something of a case was searched, seen or found, which are output times besides
    those asked for.
    """
    times = [time for sortie in case.sorties for time in (sortie.start, sortie.end)]
    times += [contact.time for contact in case.contacts] + case.sensors.times
    return times + [find.time for find in (case.spill.finds if case.spill else ()) if find.at_sea]


def _unheld(a: Case, b: Case) -> list[str]:
    """Return why the particles of two cases of one kind do not pair."""
    own, theirs = (case.spill.kinds if case.spill else case.scenarios for case in (a, b))
    if len(own) != len(theirs):
        what = "classes of objects" if a.spill else "scenarios"
        return [
            f"it has {len(theirs)} {what}, and {a.path.name} {len(own)}, which share the particles; "
            "they pair by their order: give one that should not count weight = 0"
            if not a.spill
            else f"it has {len(theirs)} {what}, and {a.path.name} {len(own)}, which share the particles of a world"
        ]
    rules = [(case.resampling.below > 0, case.resampling.method) for case in (a, b)]
    if rules[0] != rules[1] and "kahn" in {method for below, method in rules if below}:
        return [
            'resampling.method "kahn" holds slots to spare, and only one of them has it; make [resampling] equal'
        ]
    return []


def _around(one: Box, other: Box) -> Box:
    """Return the smallest box that holds two."""
    west = sphere.near_degrees(other.west, one.west)
    east = max(one.east, west + other.east - other.west)
    low = min(one.west, west)
    south, north = min(one.south, other.south), max(one.north, other.north)
    if east - low >= 360:
        return Box(-180.0, south, 180.0, north)
    start_of = sphere.wrap_degrees(low)
    return Box(start_of, south, start_of + east - low, north)


def common(a: Case, b: Case) -> list[np.datetime64]:
    """Return the output times of both, in the order of the runs."""
    times = np.intersect1d(a.outputs, b.outputs)
    return list(times[:: a.direction])
