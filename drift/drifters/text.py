"""How forecasts of drifters did, in words and figures for a terminal, a table and a picture's title."""

import math

import numpy as np

from drift.drifters import verification
from drift.drifters.clusters import Estimate
from drift.drifters.verification import Verification
from drift.motion import forcing_error
from geo.notation import NMI

Facts = dict[str, str]

MOST_LOST = 0.05  # share of the probability beyond which areas of the rest are not judged


def verdict(share: float, held: Estimate, lost: float = 0.0) -> str:
    """Return whether areas that should hold a share are too small, too large, or as stated, within two standard errors.

    lost: share of the probability that is on no map: where it is, nobody knows, and areas of the rest cannot be judged.
    """
    if lost > MOST_LOST:
        return f"not to be judged, as {lost:.0%} of the probability left the forcing; add a source beyond its edges"
    if not math.isfinite(held.error):
        return "too few forecasts to tell"
    if held.mean < share - 2 * held.error:
        return "too small"
    return "too large" if held.mean > share + 2 * held.error else "as stated, within two standard errors"


def sentence(made: Verification, lead: int, share: float) -> str:
    """Return how often the area of a share held the drifter at a lead, and what that means."""
    held = made.held(lead, share)
    return (
        f"after {made.leads[lead]:g} h the {100 * share:.0f} % area held {percent(held)} of {held.count} positions: "
        f"{verdict(share, held, float(made.lost.mean()))}"
    )


def percent(held: Estimate) -> str:
    """Return a share with its standard error, 84 % +- 4."""
    return f"{100 * held.mean:.0f} %{_more(100 * held.error, 0)}"


def _more(error: float, digits: int, scale: float = 1.0) -> str:
    """Return a standard error as it follows its mean; "" where there is none."""
    return f" ± {error / scale:.{digits}f}" if math.isfinite(error) else ""


def headline(made: Verification) -> str:
    """Return the sentence on the 90 % area at the end."""
    told = sentence(made, len(made.leads) - 1, verification.HEADLINE)
    return told[0].upper() + told[1:]


def facts(made: Verification) -> Facts:
    """Return all that a terminal is told, by name."""
    skill = made.mean(made.skill)
    told = {
        "forecasts": f"{made.skill.size} of {made.hours[-1]:g} h, of {len(made.names)} drifter{'s' if len(made.names) > 1 else ''} "
        f"on {np.unique(made.start // verification.DAY).size} days",
        "errors": errors(made),
    }
    if few := doubt(made):
        told["standard errors"] = few
    told["skill"] = (
        f"{skill.mean:.2f}{_more(skill.error, 2)}, median {np.median(made.skill):.2f} (Liu and Weisberg; 1 is perfect, 0 as far "
        "off as the drifter's own way)"
    )
    for lead, hours in enumerate(made.leads):
        column = int(np.searchsorted(made.hours, hours))
        apart, waiting = (made.mean(values[:, column]) for values in (made.apart, made.waiting))
        told[f"after {hours:g} h, apart"] = (
            f"{apart.mean / NMI:.1f}{_more(apart.error, 1, NMI)} nmi, median {np.median(made.apart[:, column]) / NMI:.1f}; staying put "
            f"{waiting.mean / NMI:.1f}{_more(waiting.error, 1, NMI)}; root mean square {_rms(made.apart[:, column]) / NMI:.1f}, "
            f"of the particles {_rms(made.spread[:, column]) / NMI:.1f}"
        )
        told[f"after {hours:g} h, held"] = ", ".join(
            f"{100 * share:.0f} % area {percent(made.held(lead, share))}" for share in made.shares
        )
    for name, ranks, below, above in (
        ("along", made.along, "go slower than forecast", "go faster than forecast"),
        ("across", made.across, "go to the left of the forecasts", "go to the right of the forecasts"),
    ):
        mean = made.mean(ranks[:, -1])
        leans = abs(mean.mean - 0.5) > 2 * mean.error
        lean = f": drifters {below if mean.mean < 0.5 else above}" if leans else ""
        told[f"rank {name} the drift"] = f"{mean.mean:.2f}{_more(mean.error, 2)} on average, 0.50 if unbiased{lean}"
    lost = float(made.lost.mean())
    if lost > 0.005:
        told["lost"] = f"{lost:.0%} of the probability left the forcing or the domain; areas are shares of the rest"
    told |= {f"note {k}": note for k, note in enumerate(made.notes, 1)}
    told["in short"] = headline(made)
    return told


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def errors(made: Verification) -> str:
    """Return the errors that the forecasts were made with."""
    case = made.case
    felt = case.wind_error if case.scenarios[0].object.uses_wind else None
    told = forcing_error.words(case.current_error, felt, case.diffusivity, case.diffusivity_by)
    return f"{told}; start {made.error:.0f} m (50 %); object {case.scenarios[0].object.name}"


def doubt(made: Verification) -> str:
    """Return what the standard errors rest on where that is little; "" where it is enough."""
    drifters, days = len(made.names), int(np.unique(made.block).size)
    if drifters == 1:
        few = ", and few of these: rough" if days < 10 else ""
        return (
            f"clustered by the {days} days of the one drifter{few}; other drifters may do otherwise"
            if days > 1
            else "none: all forecasts are of one drifter on one day"
        )
    if min(drifters, days) < 10:
        return f"clustered by {drifters} drifters and {days} days: few, so rough"
    return ""
