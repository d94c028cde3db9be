"""Text outputs of a beam allocation: a table for people and rows for programs."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from drift.planning.arrays.records import Allocation, Hearing, Names
from drift.products.files import formats
from drift.products.files.text_sheet import paragraph, text_sheet
from geo import notation

HEADER = ("date_time_group", "time", "end", "processor", "array", "beam", "gain", "heard")
SHOWN = 8  # most slots printed in a terminal
BEST_LEFT = 3  # best unprocessed beams that are listed


def processing_as_text(
    allocation: Allocation,
    hearing: Hearing,
    names: Names,
    title: str,
    run: str,
    notes: Sequence[str] = (),
) -> str:
    """Return the allocation as text: its value, and each processor's beam by slot.

    Args:
        allocation: which beams are processed when.
        hearing: detection probabilities of all beams.
        names: of arrays, beams and processors.
        title: of the case.
        run: id of the run.
        notes: the first two head the section on the value, the others stand at the end.
    """
    value = [line for note in (*notes[:2], worth(allocation)) for line in paragraph(note, 3)]
    for other in sorted(allocation.alternatives, key=lambda other: -other.value):
        share = _share_of(other.value, allocation)
        value += paragraph(f"{other.name}: {share:.3f}, {_less(allocation, other.value)}", 3, 6)
    lines = paragraph("Gain: probability of detection that would be lost without the beam.", 3)
    last: tuple[int, ...] | None = None
    for slot, row in enumerate(allocation.processing.tolist()):
        now = _share_of(float(allocation.by_slot[slot]), allocation)
        lines += ["", f"   {names.begins(slot)}  heard by its end: {now:.3f}"]
        for processor, beam in enumerate(row):
            works = bool(hearing.manned[slot, processor])
            change = "  NEW" if last is not None and beam >= 0 and last[processor] != beam else ""
            gain = _share_of(float(allocation.gain[slot, beam]), allocation) if beam >= 0 else 0.0
            what = (
                f"{called(beam, hearing, names)}, gain {gain:.4f}{change}"
                if beam >= 0
                else _idle(works)
            )
            lines += paragraph(f"{names.processors[processor]}: {what}", 6, 10)
        last = tuple(row)
    left = f"Choices that would add most: {_left(allocation, hearing, names)}."
    sections = [("WORTH", value), ("SLOTS", lines), ("NOT PROCESSED", paragraph(left, 3))]
    if notes[2:]:
        sections.append(("NOTES", [line for note in notes[2:] for line in paragraph(note, 3)]))
    return text_sheet("PROCESSING", title, run, sections)


def worth(allocation: Allocation) -> str:
    """Return one line with the allocation's value and its upper bound."""
    value = f"Heard at least once: {_share_of(allocation.heard, allocation):.3f}"
    cost = allocation.heard - allocation.value
    if cost > 0:
        value += f", {_share_of(allocation.value, allocation):.3f} minus the cost of the beams"
    if allocation.exact:
        return f"{value}; no choice of beams is worth more (proved)"
    return f"{value}; no choice of beams is worth more than {_up(_share_of(allocation.bound, allocation)):.3f}"


def csv(allocation: Allocation, hearing: Hearing, names: Names, run: str) -> str:
    """Return a CSV row for each processed beam, by slot and processor.

    The columns `gain` and `heard` are shares of the total weight.
    """
    rows: list[list[Any]] = []
    for slot, row in enumerate(allocation.processing.tolist()):
        heard = _share_of(float(allocation.by_slot[slot]), allocation)
        for processor, beam in enumerate(row):
            if beam >= 0:
                gain = _share_of(float(allocation.gain[slot, beam]), allocation)
                what = [
                    names.processors[processor],
                    names.arrays[hearing.array[beam]],
                    names.beams[beam],
                ]
                rows.append([names.begins(slot), *names.edges[slot : slot + 2], *what, gain, heard])
    return formats.csv_text(HEADER, rows, run=run, digits=".6g")


def summary_of_processing(allocation: Allocation, hearing: Hearing, names: Names) -> dict[str, Any]:
    """Return the allocation as JSON data; all values are shares of the total weight."""
    return {
        "heard": _share_of(allocation.heard, allocation),
        "value": _share_of(allocation.value, allocation),
        "bound": _share_of(allocation.bound, allocation),
        "exact": allocation.exact,
        "alternatives": {
            other.name: _share_of(other.value, allocation) for other in allocation.alternatives
        },
        "slots": [
            {
                "time": names.edges[slot],
                "heard": _share_of(float(allocation.by_slot[slot]), allocation),
                "beams": {
                    names.processors[processor]: called(beam, hearing, names)
                    for processor, beam in enumerate(row)
                    if beam >= 0
                },
            }
            for slot, row in enumerate(allocation.processing.tolist())
        ],
    }


def pod(plan: Any) -> str:
    """Return one line with the POD of a ProcessingPlan, as a run would compute it."""
    return (
        f"POD {notation.percent(plan.pod)} +- {notation.percent(plan.standard_error)} on the {plan.particles:,} tracks of the plan; "
        "fluctuations continue from slot to slot"
    )


def begun_anew(plan: Any) -> str:
    """Return one line with the value and bound if each slot starts afresh."""
    return f"Each slot by itself, h{worth(plan.allocation)[1:]}"


def notes(plan: Any) -> list[str]:
    """Return the notes for readers of a plan, the POD first."""
    return [
        f"{pod(plan)}.",
        f"All other numbers treat each slot by itself, on {plan.made_on:,} of these tracks: those on which beams were chosen.",
        "Each slot by itself: as if no sensor had listened before. If levels fluctuate more slowly than slots change, gains, the "
        "probability by a slot's end, the bound and the alternatives are too high; POD is not. Beams of an array share its "
        "fluctuation: of those processed in a slot only the best counts. Different arrays miss independently.",
        "POD: probability that the target is heard at least once, given all that the case knows. It is computed on tracks drawn for "
        "planning, not on the particles of the forecast; beams were chosen on the same tracks or some of them.",
        "Beams: R is relative to the array's heading, T true. A line cannot distinguish port from starboard: its beam hears both "
        "sides.",
        "An unknown that a group of sensors shares is drawn once for each track.",
    ]


def plan_numbers(plan: Any) -> dict[str, Any]:
    """Return a plan as JSON data."""
    return {
        "pod": plan.pod,
        "pod_standard_error": plan.standard_error,
        "pod_particles": plan.particles,
        "made_on_particles": plan.made_on,
        **summary_of_processing(plan.allocation, plan.hearing, plan.names),
    }


def processing_facts(plan: Any) -> dict[str, str]:
    """Return a plan as a few labelled lines for a terminal."""
    allocation, hearing, names = plan.allocation, plan.hearing, plan.names
    rows = {"plan": pod(plan), "chosen": begun_anew(plan)}
    for slot, row in enumerate(allocation.processing[:SHOWN].tolist()):
        beams = [
            f"{names.processors[k]} {called(beam, hearing, names)}"
            for k, beam in enumerate(row)
            if beam >= 0
        ]
        rows[names.begins(slot)] = "; ".join(beams) or "no beam"
    if hearing.slots > SHOWN:
        rows["later"] = f"{hearing.slots - SHOWN} more slots"
    for other in sorted(allocation.alternatives, key=lambda other: -other.value):
        rows[f"else, {other.name}"] = (
            f"{_share_of(other.value, allocation):.3f}, {_less(allocation, other.value)}"
        )
    return rows


def called(beam: int, hearing: Hearing, names: Names) -> str:
    """Return a beam's name with that of its array."""
    return f"{names.arrays[hearing.array[beam]]} {names.beams[beam]}"


def _share_of(value: float, allocation: Allocation) -> float:
    """Return a weight as a share of the total weight."""
    return value / allocation.weight


def _less(allocation: Allocation, value: float) -> str:
    """Return how much less (or more) an alternative is worth."""
    difference = (allocation.value - value) / allocation.weight
    return (
        "as much"
        if abs(difference) < 5e-4
        else f"{abs(difference):.3f} {'less' if difference > 0 else 'more'}"
    )


def _idle(works: bool) -> str:
    """Return the text for a processor without a beam."""
    return "idle: no beam adds anything" if works else "off"


def _left(allocation: Allocation, hearing: Hearing, names: Names) -> str:
    """Return the beams that would add most if there were one more processor."""
    gain = np.nan_to_num(allocation.gain - hearing.cost, nan=-1.0)
    for slot, beams in enumerate(allocation.chosen):
        gain[slot, list(beams)] = -1
    found = []
    for k in np.argsort(-gain, axis=None, kind="stable")[:BEST_LEFT].tolist():
        slot, beam = divmod(k, hearing.beams)
        if gain[slot, beam] > 0:
            share = _share_of(float(gain[slot, beam]), allocation)
            found.append(f"{called(beam, hearing, names)} at {names.begins(slot)} ({share:.4f})")
    return "; ".join(found) or "no beam"


def _up(share: float) -> float:
    """Return a bound rounded up to three digits."""
    return min(math.ceil(share * 1000 - 1e-9) / 1000, 1.0)
