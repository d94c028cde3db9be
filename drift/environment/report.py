"""What report.html shows of where a run drifts: arrows of winds and currents, and the ways of what steers."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import shapely

from drift.environment import ambient, layers
from drift.motion.forcing import Sources
from drift.motion.scenario import Scenario
from drift.output import geojson
from drift.report import leaves
from drift.report.leaves import Leaf
from geo import sphere
from geo.box import Box
from geo.forcing.quantity import QUANTITIES

ACROSS = 14  # arrows along the longer side of the map


def flows(sources: Sources, times: npt.NDArray[np.datetime64], box: Box) -> list[Leaf]:
    """Return arrows of what a scenario drifts in, at places spread over a box."""
    x, y = ambient.lattice(box, ACROSS)
    shown: list[Leaf] = []
    for quantity in QUANTITIES:
        if sources.of(quantity):
            velocity = ambient.at(sources, quantity, times, x, y)
            title, look = QUANTITIES[quantity].spoken.capitalize(), "wind" if QUANTITIES[quantity].in_air else "current"
            shown.append(
                leaves.arrows(title, times, sphere.wrap_degrees(x), y, velocity, look, shown=quantity == "current")
            )
    return shown


def itineraries(scenarios: Sequence[Scenario]) -> list[Leaf]:
    """Return the ways of targets that steer."""
    if not any(scenario.itinerary for scenario in scenarios):
        return []
    places = layers.itineraries(scenarios).places
    drawn = [
        geojson.feature(geojson.lines([shapely.LineString(line) for line in lines if len(line) > 1]), {"name": name})
        for name, lines in places.items()
    ]
    return [leaves.features("Ways of what steers", [one for one in drawn if one["geometry"]["coordinates"]], "way")]
