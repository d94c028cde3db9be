"""Items of report.html for the environment: arrows of winds and currents, and itineraries of
targets.
"""

from collections.abc import Mapping, Sequence

import shapely

from drift.engine.environment import layers
from drift.engine.environment.ambient import Flow
from drift.engine.motion.scenario import Scenario
from drift.products.files import geojson
from drift.products.report import leaves
from drift.products.report.leaves import Leaf
from geo import sphere
from geo.forcing.quantity import QUANTITIES


def flows(found: Mapping[str, Flow]) -> list[Leaf]:
    """Return arrows of a scenario's winds and currents, by quantity."""
    shown: list[Leaf] = []
    for quantity, flow in found.items():
        title, look = (
            QUANTITIES[quantity].spoken.capitalize(),
            "wind" if QUANTITIES[quantity].in_air else "current",
        )
        lon, visible = sphere.wrap_degrees(flow.lon), quantity == "current"
        shown.append(
            leaves.arrows_leaf(title, flow.time, lon, flow.lat, flow.velocity, look, shown=visible)
        )
    return shown


def itineraries(scenarios: Sequence[Scenario]) -> list[Leaf]:
    """Return the itineraries of steering targets."""
    if not any(scenario.itinerary for scenario in scenarios):
        return []
    places = layers.itineraries(scenarios).places
    drawn = [
        geojson.feature(
            geojson.lines([shapely.LineString(line) for line in lines if len(line) > 1]),
            {"name": name},
        )
        for name, lines in places.items()
    ]
    return [
        leaves.features_leaf(
            "Itineraries of targets",
            [one for one in drawn if one["geometry"]["coordinates"]],
            "way",
        )
    ]
