"""How many particles sorties and contacts leave, and the warnings where these are few."""

import math
from collections.abc import Sequence
from typing import Any

from drift.evidence.filter.records import Contact
from drift.evidence.filter.updates import Update, Updates
from drift.forecast import effective
from drift.forecast.effective import Count
from geo.notation import NMI


def of_run(
    data: Any, particles: int, updates: Updates | None, contacts: Sequence[Contact] = ()
) -> list[str]:
    """Return warnings of few particles: after which update, at which outputs, and of which parts at
    the end.

    contacts: of the case, whose errors are named where they are the cause.
    """
    lost = [_lost(update) for update in updates.all if update.filled == "lost"] if updates else []
    placed = [update for update in updates.all if update.filled == "contact"] if updates else []
    lost += [_placed(placed[0])] if placed else []
    update = first_low(updates) if updates else None
    if update is None:
        return lost + effective.of_run(data, particles)
    low = Count(update.left, particles)
    resampling = "" if update.resampled else ", or [resampling] below = 0.05"
    when = f"{after(update)} ({Count(update.ess_before).number:,.0f} before it)"
    words = effective.sentence(low, when, "areas and shares after it are rough")
    warning = f"{words}. {_cause(update, contacts)}; otherwise use {enough(low):,} particles or more{resampling}"
    return [*lost, warning, *effective.of_run(data, particles, update.time, update.left)]


def _cause(update: Update, contacts: Sequence[Contact]) -> str:
    """Return what to check first: of a contact, its error."""
    seen = next(
        (one for one in contacts if update.kind == "contact" and one.name == update.name), None
    )
    if seen is None:
        return "Check it"
    error = ""
    if seen.kind == "position":
        half = math.sqrt(2 * math.log(2) * seen.major * seen.minor)
        error = f" ({half / NMI:.2g} nmi, which holds half of it)"
    what = "position, time, error" if seen.kind == "position" else "time, place, error"
    of = " and class (of)" if seen.drifter is not None else ""
    check = f"Check its {what}{error}{of} first: a narrow error leaves few particles"
    if seen.drifter is not None and seen.kind == "position" and not seen.guide:
        check += "; remove its guide = false, so that particles are guided toward it"
    return check


def _placed(update: Update) -> str:
    """Return a warning of the first update after which particles were placed again."""
    return (
        f"Particles were repopulated {after(update)}, as [resampling] asks: a heuristic, no posterior. Areas and shares from then on are "
        "rough; speed and course are of the particles before"
    )


def _lost(update: Update) -> str:
    """Return a warning of an update that lost the track."""
    return (
        f"The track is lost {after(update)}: it leaves fewer particles than [resampling] bulk. Maps after it show what little is "
        "left, until a contact repopulates them; search wider, or give a smaller bulk"
    )


def enough(low: Count) -> int:
    """Return how many particles would leave so many that count that they are not few, to two
    digits, rounded up.

    What a likelihood leaves of particles grows with their number.
    """
    assert low.of is not None
    wanted = low.of * effective.FEW[low.what] / low.number
    digit = 10 ** max(math.floor(math.log10(wanted)) - 1, 0)
    return int(math.ceil(wanted / digit) * digit)


def first_low(updates: Updates) -> Update | None:
    """Return the first sortie or contact after which few particles count; all later ones depend on
    these.
    """
    return next((update for update in updates.all if Count(update.left).few), None)


def lowest(updates: Updates, particles: int | None = None) -> Count:
    """Return how many particles count for the evidence: the fewest after any update, for copies add
    nothing.
    """
    return Count(min((update.left for update in updates.all), default=0.0), particles)


def after(update: Update) -> str:
    """Return in words after which update."""
    return f'after {update.kind} "{update.name}"'
