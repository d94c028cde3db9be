"""Number of effective particles after updates, and warnings if they are few."""

import math
from collections.abc import Sequence
from typing import Any

from drift.evidence.filter.records import Contact
from drift.evidence.filter.updates import Update, Updates
from drift.forecast import effective
from drift.forecast.effective import Count
from geo.notation import NMI


def few_particles_warnings(
    data: Any, particles: int, updates: Updates | None, contacts: Sequence[Contact] = ()
) -> list[str]:
    """Return warnings about few effective particles.

    They name the first such update, the outputs, and the parts of the result at the end.

    Args:
        data: of the forecast.
        particles: number of particles of the run.
        updates: of the run, if it has any.
        contacts: of the case; a warning names the error of the contact that is the cause.
    """
    lost = (
        [_lost_track_warning(update) for update in updates.all if update.filled == "lost"]
        if updates
        else []
    )
    placed = [update for update in updates.all if update.filled == "contact"] if updates else []
    lost += [_repopulated_warning(placed[0])] if placed else []
    update = _first_low(updates) if updates else None
    if update is None:
        return lost + effective.effective_warnings(data, particles)
    low = Count(update.left, particles)
    resampling = "" if update.resampled else ", or [resampling] below = 0.05"
    when = f"{_after_update(update)} ({Count(update.ess_before).number:,.0f} before it)"
    words = effective.sentence(low, when, "areas and shares after it are rough")
    warning = f"{words}. {_what_to_check(update, contacts)}; otherwise use {_particles_needed(low):,} particles or more{resampling}"
    return [
        *lost,
        warning,
        *effective.effective_warnings(data, particles, update.time, update.left),
    ]


def _what_to_check(update: Update, contacts: Sequence[Contact]) -> str:
    """Return what to check first; for a contact, this includes its error."""
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


def _repopulated_warning(update: Update) -> str:
    """Return a warning about the first update that repopulated particles."""
    return (
        f"Particles were repopulated {_after_update(update)}, as [resampling] asks: a heuristic, not a posterior. Areas and shares from then on are "
        "rough; speed and course are of the particles before"
    )


def _lost_track_warning(update: Update) -> str:
    """Return a warning about an update after which the track is lost."""
    return (
        f"The track is lost {_after_update(update)}: it leaves fewer particles than [resampling] bulk. Maps after it show the few "
        "particles that remain, until a contact repopulates them; search wider, or give a smaller bulk"
    )


def _particles_needed(low: Count) -> int:
    """Return the number of particles that avoids the warning, rounded up to two digits.

    The number of effective particles is proportional to the number of particles.
    """
    assert low.of is not None
    wanted = low.of * effective.FEW[low.what] / low.number
    digit = 10 ** max(math.floor(math.log10(wanted)) - 1, 0)
    return int(math.ceil(wanted / digit) * digit)


def _first_low(updates: Updates) -> Update | None:
    """Return the first update with few effective particles; all later ones depend on it."""
    return next((update for update in updates.all if Count(update.left).few), None)


def lowest(updates: Updates, particles: int | None = None) -> Count:
    """Return the smallest number of effective particles after any update.

    Resampling adds no effective particles.
    """
    return Count(min((update.left for update in updates.all), default=0.0), particles)


def _after_update(update: Update) -> str:
    """Return the words "after" and the update."""
    return f'after {update.kind} "{update.name}"'
