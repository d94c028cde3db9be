"""Scores of past cases as text for the terminal, as a CSV table, and as numbers."""

from typing import Any

import numpy as np

from drift.assess.score import calibration
from drift.assess.score.calibration import Held, Score
from drift.assess.score.incident import Incident
from drift.products.files import formats
from geo import notation
from geo.notation import NMI

LISTED = 20  # most incidents in a line of their own on the terminal


def score_facts(score: Score) -> dict[str, str]:
    """Return the score of each find, what the areas held, and the tests."""
    facts = {one.run: _incident_in_words(one) for one in score.incidents[:LISTED]}
    left = len(score.incidents) - LISTED
    if left > 0:
        facts["others"] = f"{left} more finds: see score.csv"
    for held in score.held:
        facts[f"{notation.hundredths(held.share)} % area"] = _held_in_words(held)
    apart = score.mean(np.array([one.separation for one in score.incidents]) / NMI)
    error = "" if np.isnan(apart.error) else f" +- {apart.error:.2g}"
    facts["most likely place"] = f"{apart.mean:.3g}{error} nmi from the find, on average"
    distance, p = score.uniform
    facts["uniform"] = f"Kolmogorov's distance {distance:.3f}, p = {p:.2g}"
    facts["in short"] = calibration.verdict(score)
    return facts


def _incident_in_words(one: Incident) -> str:
    """Return the score of one find as text."""
    apart = (one.nearest - one.find.time) / np.timedelta64(1, "m")
    when = "at" if apart == 0 else f"{abs(apart):.0f} min {'after' if apart > 0 else 'before'}"
    searched = (
        f"POS so far {notation.percent(one.pos)} by {one.sorties} {'sortie' if one.sorties == 1 else 'sorties'}"
        if one.sorties
        else "not searched before"
    )
    inside = (
        "outside all areas"
        if one.containment >= 1
        else f"in the {notation.percent(one.containment)} area"
    )
    coast = (
        f" ({one.from_coast / NMI:.1f} nmi from the likeliest coast, {notation.percent(one.coast_share)})"
        if np.isfinite(one.from_coast) and not one.ashore
        else ""
    )
    return (
        f"found {notation.format_dtg(one.find.time)} {inside}, {one.separation / NMI:.1f} nmi from "
        f"the most likely place{' (ashore)' * one.ashore}{coast}; {searched}; nearest output {when} the find"
    )


def _held_in_words(held: Held) -> str:
    """Return how often an area held the find as text."""
    return (
        f"held {held.count} of {held.of} finds, {notation.percent(held.count / held.of, 0)} "
        f"({100 * held.low:.0f} to {100 * held.high:.0f} % with 95 % confidence), p = {held.p:.2g}"
    )


def score_csv(score: Score, run: str) -> str:
    """Return a row for each find as CSV; run: the run_id, for the last column."""
    rows = [
        {
            "run": one.run,
            "scored_run_id": one.run_id,
            "title": one.title,
            "start": one.start,
            "time": one.find.time,
            "lead_h": one.hours,
            "lon": one.find.lon,
            "lat": one.find.lat,
            "nearest_output": one.nearest,
            "containment": one.containment,
            "separation_nmi": one.separation / NMI,
            "separation_coast_nmi": one.from_coast / NMI,
            "coast_share": one.coast_share,
            "separation_mean_nmi": one.from_mean / NMI,
            "sorties": one.sorties,
            "pos_cumulative": one.pos,
        }
        for one in score.incidents
    ]
    return formats.csv_rows(rows, run=run, digits=".7g")


def _number(value: float) -> float | None:
    """Return None for NaN: a file has no such number."""
    return None if np.isnan(value) else value


def summary_of_score(score: Score) -> dict[str, Any]:
    """Return the scores for summary.json."""
    distance, p = score.uniform
    apart = score.mean(np.array([one.separation for one in score.incidents]))
    return {
        "finds": [
            {
                "run": one.run,
                "run_id": one.run_id,
                "time": one.find.time,
                "containment": one.containment,
                "separation_m": one.separation,
                "likeliest_ashore": one.ashore,
                "separation_coast_m": _number(one.from_coast),
                "coast_share": _number(one.coast_share),
                "separation_mean_m": one.from_mean,
                "sorties": one.sorties,
                "cumulative_pos": one.pos,
                "nearest_output": one.nearest,
            }
            for one in score.incidents
        ],
        "held": [
            {
                "area": held.share,
                "count": held.count,
                "of": held.of,
                "low": held.low,
                "high": held.high,
                "p": held.p,
            }
            for held in score.held
        ],
        "separation_m": {"mean": apart.mean, "standard_error": apart.error},
        "kolmogorov": {"distance": distance, "p": p},
        "in_short": calibration.verdict(score),
    }
