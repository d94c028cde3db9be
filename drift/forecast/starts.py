"""Marks and lines on charts for the places where a forecast starts."""

from collections.abc import Sequence

import numpy as np

from drift.engine.motion.scenario import Scenario
from drift.forecast.likeliest import Shown
from drift.products.maps.marks import Line, Mark


def prior_marks(
    scenarios: Sequence[Scenario], known_as: str, short: str, shown: Shown | None = None
) -> tuple[list[Mark], list[Line]]:
    """Return the priors of scenarios for a chart: positions as marks, areas and tracklines as
    lines.

    Args:
        scenarios: of the run.
        known_as: label of a position where there is one scenario.
        short: label before the scenario's name where there are several.
        shown: the scenarios to draw; None: all.
    """
    marks, lines = [], []
    for scenario in scenarios if shown is None else [scenarios[number] for number in shown.alone]:
        prior = scenario.prior
        if prior is None:
            # its itinerary is a separate layer: drift.engine.environment.layers
            continue
        if prior.reported:
            label = known_as if len(scenarios) == 1 else f"{short}, {scenario.name}"
            marks.append(Mark(*prior.reported, label))
        else:
            lon = np.degrees(np.unwrap(prior.lon)).tolist()
            closed = not prior.moving  # an area has a closed outline, a voyage has two ends
            lines.append(Line(lon, np.degrees(prior.lat).tolist(), scenario.name, closed=closed))
    return marks, lines


def others(scenarios: Sequence[Scenario], shown: Shown) -> tuple[tuple[float, float], ...]:
    """Return the reported positions [deg] of the scenarios that are not displayed individually."""
    priors = (scenarios[number].prior for number in shown.rest)
    return tuple(prior.reported for prior in priors if prior is not None and prior.reported)
