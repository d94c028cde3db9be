"""A verification as text, for a terminal, a table and the title of a picture."""

import math

import numpy as np

from drift.assess.verify import verification
from drift.assess.verify.verification import Verification
from drift.engine.motion.errors import forcing_error
from drift.tracking.tracks.clusters import Estimate
from geo import notation, sphere
from geo.notation import NMI

Facts = dict[str, str]

EARTH = 4 * math.pi * (sphere.RADIUS / 1000) ** 2  # [km2] its surface
MOST_LOST = 0.05  # if a larger share of the probability is lost, areas of the rest are not judged


def verdict(share: float, held: Estimate, lost: float = 0.0) -> str:
    """Return whether areas of a stated share are too small, too large, or as stated.

    Args:
        share: stated share of the areas, 0 to 1.
        held: share of drifters that the areas held, with its standard error.
        lost: share of the probability that is not mapped; if it is large, areas of the rest cannot
            be judged.

    Returns:
        The verdict in words: as stated means within two standard errors.
    """
    if lost > MOST_LOST:
        return (
            f"not to be judged, as {notation.percent(lost, 0)} of the probability left the "
            "forcing; add a source beyond its edges"
        )
    if not math.isfinite(held.error):
        return "too few forecasts to judge"
    if held.mean < share - 2 * held.error:
        return "too small"
    return (
        "too large"
        if held.mean > share + 2 * held.error
        else "as stated, within two standard errors"
    )


def _coverage_sentence(result: Verification, lead: int, share: float) -> str:
    """Return as a sentence how often the area of a share held the drifter at a lead (index)."""
    held = result.held(lead, share)
    return (
        f"after {result.leads[lead]:g} h the {100 * share:.0f} % area held {_percent_with_error(held)} of "
        f"{held.count} positions: {verdict(share, held, float(result.lost.mean()))}"
    )


def _percent_with_error(held: Estimate) -> str:
    """Return a share with its standard error, 84 % ± 4."""
    return f"{100 * held.mean:.0f} %{_more(100 * held.error, 0)}"


def _more(error: float, digits: int, scale: float = 1.0) -> str:
    """Return "± error" to follow a mean; "" if the error is not finite; scale: the unit in SI."""
    return f" ± {error / scale:.{digits}f}" if math.isfinite(error) else ""


def uniform_area(log_score: float) -> str:
    """Return a log score [log of 1/km2] as the uniform area with that density, in words.

    None is larger than the Earth.
    """
    if -log_score > math.log(EARTH):
        return "a lower density than if it were uniform over the whole Earth"
    area = f"{math.exp(-log_score) * 1e6 / NMI**2:.3g}"
    return f"the density of a uniform area of {float(area):,.9g} nmi2"


def headline(result: Verification) -> str:
    """Return the sentence on the HEADLINE area at the longest lead."""
    text = _coverage_sentence(result, len(result.leads) - 1, verification.HEADLINE)
    return text[0].upper() + text[1:]


def verification_facts(result: Verification) -> Facts:
    """Return all lines for a terminal, by name."""
    skill = result.mean(result.skill)
    count, days = len(result.names), np.unique(result.start // verification.DAY).size
    lines = {
        "forecasts": f"{result.skill.size} of {result.hours[-1]:g} h, of {count} drifter{'s' if count > 1 else ''} "
        f"on {days} days{left_out(result)}",
        "errors": assumed_errors(result),
    }
    if doubts := doubts_about_errors(result):
        lines["standard errors"] = doubts
    lines["skill"] = (
        f"{skill.mean:.2f}{_more(skill.error, 2)}, median {np.median(result.skill):.2f} "
        "(Liu and Weisberg; 1 is perfect, 0: errors as large as the drifter's path length)"
    )
    unclipped, staying = result.mean(result.unclipped), result.mean(result.staying)
    lines["skill, unclipped"] = (
        f"{unclipped.mean:.2f}{_more(unclipped.error, 2)}; staying put "
        f"{staying.mean:.2f}{_more(staying.error, 2)} (SS*; may be negative)"
    )
    for lead, hours in enumerate(result.leads):
        column = int(np.searchsorted(result.hours, hours))
        apart = result.apart[:, column]
        separation, persistence = result.mean(apart), result.mean(result.waiting[:, column])
        lines[f"after {hours:g} h, apart"] = (
            f"{separation.mean / NMI:.1f}{_more(separation.error, 1, NMI)} nmi, median "
            f"{np.median(apart) / NMI:.1f}; staying put "
            f"{persistence.mean / NMI:.1f}{_more(persistence.error, 1, NMI)}; root mean square "
            f"{_rms(apart) / NMI:.1f}, of the particles {_rms(result.spread[:, column]) / NMI:.1f}"
        )
        lines[f"after {hours:g} h, held"] = ", ".join(
            f"{100 * share:.0f} % area {_percent_with_error(result.held(lead, share))}"
            for share in result.shares
        )
        energy, log = result.mean(result.energy[:, lead]), result.mean(result.log[:, lead])
        lines[f"after {hours:g} h, scores"] = (
            f"energy score {energy.mean / NMI:.2f}{_more(energy.error, 2, NMI)} nmi, staying put "
            f"{persistence.mean / NMI:.2f}; log score {log.mean:.2f}{_more(log.error, 2)} "
            f"({uniform_area(log.mean)})"
        )
        if aground := _aground(result, column):
            lines[f"after {hours:g} h, aground"] = aground
    for name, ranks, below, above in (
        ("along", result.along, "go slower than forecast", "go faster than forecast"),
        (
            "across",
            result.across,
            "go to the left of the forecasts",
            "go to the right of the forecasts",
        ),
    ):
        mean = result.mean(ranks[:, -1])
        leans = abs(mean.mean - 0.5) > 2 * mean.error
        lean = f": drifters {below if mean.mean < 0.5 else above}" if leans else ""
        lines[f"rank {name} the drift"] = (
            f"{mean.mean:.2f}{_more(mean.error, 2)} on average, 0.50 if unbiased{lean}"
        )
    lost = float(result.lost.mean())
    if lost > 0.005:
        lines["lost"] = (
            f"{notation.percent(lost, 0)} of the probability left the forcing or the domain; areas are shares of the rest"
        )
    lines |= {f"note {k}": note for k, note in enumerate(result.notes, 1)}
    lines["in short"] = headline(result)
    return lines


def _aground(result: Verification, column: int) -> str:
    """Return the shares of drifters and of particles aground at a time (`column`: its index).

    It is "" if no drifter ever is aground. It is also "" if particles refloat, because spells of
    drifters shorter than the shortest detectable one are not known.
    """
    if not result.aground.any() or result.case.coast.behaviour != "strand":
        return ""
    drifters = result.mean(result.aground[:, column], share=True)
    particles = 100 * float(result.ashore[:, column].mean())
    return f"{_percent_with_error(drifters)} of the drifters; {particles:.0f} % of the particles"


def left_out(result: Verification) -> str:
    """Return the starts left out, by reason, as text that follows the number of forecasts."""
    if not result.left_out:
        return ""
    reasons = ", ".join(f"{count:,} {reason}" for reason, count in result.left_out.items())
    return f"; {sum(result.left_out.values()):,} starts left out: {reasons}"


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def assumed_errors(result: Verification) -> str:
    """Return the assumed errors of the forecasts in words."""
    case = result.case
    wind_error = case.wind_error if case.scenarios[0].object.uses_wind else None
    text = forcing_error.errors_in_words(
        case.current_error, wind_error, case.diffusivity, case.diffusivity_by
    )
    return f"{text}; start {result.error:.0f} m (50 %); object {case.scenarios[0].object.name}"


def doubts_about_errors(result: Verification) -> str:
    """Return on how few drifters or days the standard errors rest; "" if these are enough."""
    drifters, days = len(result.names), int(np.unique(result.block).size)
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
