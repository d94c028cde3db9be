"""Rejects itineraries over land where the vessel may not cross it: lanes, voyages, loitering areas.

Tested against the full coast are the corridors of lanes, voyages with SPREADS standard deviations
of their cross-track error, the connections between these with the larger of the two widths, and
polygons. Courses, tracks and bridges may lead anywhere and are not tested; their way points are
drawn in water.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from drift.engine.environment import corridors
from drift.engine.motion.scenario import Scenario
from drift.engine.motion.steering import family, lanes
from drift.engine.motion.steering.itinerary import Abeam, InRing, Loiter, Near, Phase, Ways, middle
from drift.engine.motion.steering.lanes import Network
from geo import sphere
from geo.array import Array
from geo.box import Box
from geo.coast.edges import Coast
from geo.errors import UserError

# standard deviations of a cross-track error: 1 target in 16,000 keeps farther off its voyage
SPREADS = 4.0
OTHERWISE = 'set vessel = { land = "stop" } (or "ignore") in its [[scenario]]'
ROOM = 0.1  # [deg] margin of known coast around everything that is tested


def box(scenarios: Sequence[Scenario]) -> Box | None:
    """Return the box in which `refuse` needs the coast; None if nothing is tested."""
    places = [
        (np.unwrap(lon), lat, far)
        for scenario in scenarios
        if scenario.itinerary is not None and scenario.itinerary.land == "refuse"
        for phase, (lon, lat, far) in zip(
            scenario.itinerary.phases, _extents(scenario), strict=True
        )
        if isinstance(phase, Loiter) or _voyage(phase) or (isinstance(phase, Ways) and phase.lanes)
    ]
    if not places:
        return None
    middle = places[0][0][0]
    near = [lon - 2 * np.pi * np.round((lon.mean() - middle) / (2 * np.pi)) for lon, _, _ in places]
    far = np.degrees(max(far for _, _, far in places) / sphere.RADIUS)
    north, south = (
        np.degrees(f(np.concatenate([lat for _, lat, _ in places]))) for f in (np.max, np.min)
    )
    west, east = (np.degrees(f(np.concatenate(near))) for f in (np.min, np.max))
    whole = Box(west, max(south, -90.0), east, min(north, 90.0))
    high = far + ROOM
    return whole.grown(
        high / np.cos(np.radians(min(max(abs(north), abs(south)) + high, 85.0))), high
    )


def _extents(scenario: Scenario) -> list[tuple[Array, Array, float]]:
    """Return the extent of each phase; of a course it is empty."""
    assert scenario.itinerary is not None
    own = iter(scenario.itinerary.extents(SPREADS))
    nothing = np.zeros(1), np.zeros(1), 0.0
    return [
        next(own) if isinstance(phase, Ways | Loiter) else nothing
        for phase in scenario.itinerary.phases
    ]


def refuse(scenarios: Sequence[Scenario], coast: Coast) -> None:
    """Raise UserError, with a line for each lane, leg and area that touches land; the coast covers
    `box`.
    """
    wrong: dict[str, None] = {}
    stories = [
        (s.name, s.itinerary)
        for s in scenarios
        if s.itinerary is not None and s.itinerary.land == "refuse"
    ]
    followed = [
        phase.lanes
        for _, own in stories
        for phase in own.phases
        if isinstance(phase, Ways) and phase.lanes is not None
    ]
    if followed:
        routes = {route.node: route for _, route in ((own.network, own.route) for own in followed)}
        try:
            corridors.refuse_lanes(
                lanes.join_networks([own.network for own in followed]), coast, list(routes.values())
            )
        except UserError as error:
            wrong |= dict.fromkeys(error.lines)
    seen: dict[InRing, None] = {}
    known: dict[bytes, list[tuple[int, str, str]]] = {}  # scenarios of a family share itineraries
    shore = corridors.Shore.of(coast)
    for name, own in stories:
        for number, phase in enumerate(own.phases, 1):
            place = f'scenario "{name}".phase {number}'
            if isinstance(phase, Loiter) and phase.ring not in seen:
                seen[phase.ring] = None
                corners = np.degrees([phase.ring.lon, phase.ring.lat]).T
                try:
                    corridors.refuse_area(
                        f"{place}.loiter.polygon", [(float(x), float(y)) for x, y in corners], coast
                    )
                except UserError as error:
                    wrong |= dict.fromkeys(error.lines)
            elif isinstance(phase, Ways) and (legs := _voyage(phase)) is not None:
                spread = f"with {SPREADS:g} standard deviations of cross_track to each side"
                key = b"".join(column.tobytes() for column in (legs.lon, legs.lat, legs.width))
                if key not in known:
                    known[key] = list(_legs_on_land(legs, shore, f"{place}.voyage", spread))
                for lane, width, where in known[key]:
                    wrong[
                        f"{place}.voyage: leg {lane + 1}, {width} wide {spread}, touches land {where}; move its waypoints, "
                        f"or {OTHERWISE}"
                    ] = None
            if (
                number < len(own.phases)
                and (between := _connection(phase, own.phases[number])) is not None
            ):
                for _, width, where in _legs_on_land(
                    between, shore, place, f"on the way to phase {number + 1}"
                ):
                    wrong[
                        f"{place}: the track from its end to the start of phase {number + 1}, {width} wide, touches land "
                        f"{where}; let that phase begin at this end, or {OTHERWISE}"
                    ] = None
    if wrong:
        raise UserError(
            *family.merge_lines(
                [*wrong], {s.name: s.family for s in scenarios if s.family is not None}
            )
        )


def _legs_on_land(
    legs: Network, shore: corridors.Shore, place: str, what: str
) -> Iterator[tuple[int, str, str]]:
    """Yield the legs that touch land, as corridors.touching does; reject those that cannot be
    tested.

    what: the word for such a leg in messages.
    """
    try:
        yield from corridors.touching(legs, shore, [lanes.route(legs, legs.name)])
    except ValueError as error:
        # a turn too sharp for its width, or a leg that bulges out of the box of the coast
        raise UserError(f"{place}: {what}: {error}; or {OTHERWISE}") from None


def _connection(before: Phase, after: Phase) -> Network | None:
    """Return the connection of two phases with fixed way points as a lane; None if it does not
    exist.
    """
    if not isinstance(before, Ways) or not isinstance(after, Ways) or before.destinations:
        return None
    a, b = before.points[-1].place, after.points[0].place
    if (
        not isinstance(a, Abeam)
        or not isinstance(b, Abeam)
        or sphere.distance(a.lon, a.lat, b.lon, b.lat) < corridors.CLEAR
    ):
        return None
    half = max(place.half * (SPREADS if place.law == "normal" else 1.0) for place in (a, b))
    lon, lat = np.array([a.lon, b.lon]), np.array([a.lat, b.lat])
    first, last = np.zeros(1, int), np.ones(1, int)
    return Network(
        ("end", "begin"), lon, lat, first, last, np.array([2 * half]), np.ones(1, np.bool_)
    )


def _voyage(phase: object) -> Network | None:
    """Return a voyage as a network of lanes as wide as its cross-track error; None for other
    phases.
    """
    if not isinstance(phase, Ways) or phase.lanes is not None:
        return None
    places = [point.place for point in phase.points]
    across = [place.half for place in places if isinstance(place, Abeam)]
    begin = places[0]
    if not across or len(across) < len(places) - isinstance(begin, Near):
        return None
    legs = np.arange(len(places) - 1)
    # Half the line across a corner is longer than the error by the mitre, which the network puts on
    # again.
    width = np.full(legs.size, 2 * SPREADS * min(across))
    if isinstance(begin, Near):  # the error of its departure
        width[0] = max(width[0], 2 * SPREADS * begin.major)
    lon, lat = np.array([middle(place) for place in places]).T
    names = tuple(str(k + 1) for k in range(len(places)))
    return Network(names, lon, lat, legs, legs + 1, width, np.ones(legs.size, np.bool_))
