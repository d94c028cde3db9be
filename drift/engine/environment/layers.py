"""Chart layers of lane networks and itineraries.

A network shows its corridors as a light tint, the lanes' centre lines, and arrows on one-way lanes.
An itinerary shows its track, the areas where its way points may lie, and where it loiters. Shapes
common to several scenarios are drawn once.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as Outline

from drift.engine.environment import corridors
from drift.engine.environment.ambient import Flow
from drift.engine.motion.errors.buoys import BuoyTrack, PointReport
from drift.engine.motion.scenario import Scenario
from drift.engine.motion.steering import family
from drift.engine.motion.steering import lanes as network_of
from drift.engine.motion.steering.itinerary import (
    Acts,
    InBox,
    InDisc,
    InRing,
    Itinerary,
    Near,
    Place,
    Ways,
)
from drift.engine.motion.steering.lanes import Network
from drift.products.maps import chart, labels
from drift.products.maps.chart import Frame
from drift.products.maps.overlay import Overlay
from geo import notation, polyline, sphere
from geo.array import Array
from geo.notation import KNOT

INK, WASH = "#1f4e8c", "#a9c4e6"  # of lanes and their corridors
TRACKER: dict[str, Any] = {
    "color": "#12355b",
    "linewidth": 1.3,
    "marker": ">",
    "markevery": [-1],
    "markersize": 6,
}
BUOY: dict[str, Any] = {
    "color": "#b35900",
    "linewidth": 1.4,
    "marker": "D",
    "markevery": [-1],
    "markersize": 4.5,
}
REPORT: dict[str, Any] = {
    "color": "#b35900",
    "linestyle": "none",
    "marker": "s",
    "markersize": 4.5,
    "fillstyle": "none",
}
AREA: dict[str, Any] = {"color": "#7a1f6b", "linewidth": 1.5, "linestyle": (0, (6, 2))}
WAY_COLOURS = ("#1b5e20", "#00838f", "#5d4037", "#9e7b00", "#b0306a")
WAY_DASHES: tuple[Any, ...] = (
    (0, (6, 2, 1, 2)),
    (0, (10, 2.5)),
    (0, (3, 1, 1, 1, 1, 1)),
    (0, (5, 1.5)),
    "-",
)
# With more tracks than colours, all are drawn in one style.
CROWD: dict[str, Any] = {"color": WAY_COLOURS[0], "linestyle": "-", "linewidth": 0.5, "alpha": 0.5}
ARROW = 0.05  # of the chart's width: the longest arrow of a current
ARROWS: dict[str, Any] = {
    "color": "#00629b",
    "angles": "xy",
    "scale_units": "xy",
    "scale": 1.0,
    "width": 0.0016,
    "headwidth": 4.5,
    "alpha": 0.75,
}
BARBS: dict[str, Any] = {"color": "#4a4a4a", "length": 5.5, "linewidth": 0.7, "alpha": 0.8}
HALF = np.sqrt(2 * np.log(2))  # standard deviations within which half of a round normal law lies
NAMED = 3  # scenarios listed in a row of the legend
FINE = 20_000.0  # [m] between points of great circles as drawn
Ring = Sequence[tuple[float, float]]  # corners (lon, lat) [deg]


def overlay(network: Network, areas: Mapping[str, Ring]) -> Overlay:
    """Return a network and areas of patrol as a chart layer."""

    def draw(ax: Axes, frame: Frame) -> None:
        lanes(ax, frame, network)
        patrols(ax, frame, areas.values())

    rings = {f'area "{name}"': [np.array(ring)] for name, ring in areas.items()}
    return Overlay(draw, {"the lanes": middles(network), **rings}, key(bool(areas)))


def lanes(ax: Axes, frame: Frame, network: Network, alpha: float = 0.75) -> None:
    """Draw corridors with all their joints, centre lines of lanes, and an arrow on each one-way
    lane.

    alpha: opacity of the corridors, so that shading underneath stays visible.
    """
    quads = [corners for found in corridors.swept(network).values() for corners in found]
    shapes = []
    for corners in quads:
        closed = np.vstack([corners, corners[:1]])
        lon, lat = sphere.track(closed[:, 0], closed[:, 1], FINE)
        shapes.append(
            shapely.make_valid(
                shapely.Polygon(np.column_stack(frame.project(*np.degrees([lon, lat]))))
            )
        )
    whole = shapely.union_all(shapes)
    rings = [np.array(ring.coords) for ring in shapely.get_rings(shapely.get_parts(whole))]
    codes = [
        [Outline.MOVETO, *[Outline.LINETO] * (len(ring) - 2), Outline.CLOSEPOLY] for ring in rings
    ]
    wash = Outline(np.concatenate(rings), np.concatenate(codes))
    chart.outline(ax, PathPatch(wash, facecolor=WASH, edgecolor="none", alpha=alpha, zorder=5.5))
    lines = [np.column_stack(frame.project(*line.T)) for line in middles(network)]
    ax.add_collection(LineCollection(lines, colors=INK, linewidths=0.7, zorder=6), autolim=False)
    for lane in np.flatnonzero(network.one_way):
        line = lines[lane]
        a, b = line[(len(line) - 1) // 2], line[(len(line) - 1) // 2 + 1]
        style = {"arrowstyle": "-|>", "color": INK, "linewidth": 0.7, "shrinkA": 0, "shrinkB": 0}
        ax.annotate("", a + 0.6 * (b - a), a + 0.4 * (b - a), zorder=6.2, arrowprops=style)
    ax.plot(
        *frame.project(*np.degrees([network.lon, network.lat])),
        marker="o",
        markersize=2.6,
        linestyle="none",
        color=INK,
        zorder=6.3,
        scalex=False,
        scaley=False,
    )


def patrols(ax: Axes, frame: Frame, rings: Iterable[Ring]) -> None:
    """Draw areas of patrol, whose edges are straight in longitude and latitude."""
    for ring in rings:
        closed = np.array([*ring, ring[0]])
        closed[:, 0] = polyline.unwrap(closed[:, 0])
        fine = shapely.get_coordinates(shapely.segmentize(shapely.LineString(closed), 0.5))
        ax.plot(*frame.project(*fine.T), zorder=6.5, scalex=False, scaley=False, **AREA)


def middles(network: Network) -> list[Array]:
    """Return the centre line of each lane, points (lon, lat) [deg], unwrapped, (n, 2)."""
    found = []
    for a, b in zip(network.start, network.end, strict=True):
        lon, lat = sphere.track(network.lon[[a, b]], network.lat[[a, b]], FINE)
        found.append(np.column_stack([polyline.unwrap(np.degrees(lon)), np.degrees(lat)]))
    return found


def key(areas: bool = True) -> list[tuple[Any, str]]:
    """Return symbols and texts of a legend."""
    rows: list[tuple[Any, str]] = [
        (
            Line2D([], [], color=INK, linewidth=0.7, marker="o", markersize=2.6),
            "Lane; an arrow if it is one-way",
        ),
        (Patch(facecolor=WASH, alpha=0.75), "Its corridor"),
    ]
    return [*rows, (Line2D([], [], **AREA), "Area of patrol")] if areas else rows


def flows(found: Mapping[str, Flow], time: np.datetime64) -> Overlay:
    """Return current and wind at a time as a chart layer: arrows, and barbs in knots."""
    drawn: list[tuple[str, Array, Array, Array]] = []
    for quantity in ("current", "wind"):
        if quantity not in found:
            continue
        flow = found[quantity]
        # barbs take more room than arrows
        some = _some(flow) if quantity == "wind" else np.ones(len(flow.lon), bool)
        for velocity in flow.velocity[flow.time == time]:
            there = some & np.isfinite(velocity).all(axis=1)
            if there.any():
                drawn.append((quantity, flow.lon[there], flow.lat[there], velocity[there]))

    def draw(ax: Axes, frame: Frame) -> None:
        for quantity, lon, lat, velocity in drawn:
            x, y = frame.project(lon, lat)
            u, v = _rotate_to_chart(frame, lon, lat, velocity)
            if quantity == "wind":
                ax.barbs(x, y, u / KNOT, v / KNOT, zorder=4.6, **BARBS)
            else:
                long = ARROW * (frame.x[1] - frame.x[0]) / max(np.hypot(u, v).max(), 1e-9)
                ax.quiver(x, y, long * u, long * v, zorder=4.5, **ARROWS)

    rows: list[tuple[Any, str]] = []
    for quantity, _, _, velocity in drawn:
        fastest = np.hypot(*velocity.T).max() / KNOT
        if quantity == "wind":
            rows.append(
                (
                    Line2D([], [], color=BARBS["color"], marker=(3, 0, 0), linewidth=1),
                    f"Wind, barbs, up to {fastest:.3g} kn",
                )
            )
        else:
            rows.append(
                (
                    Line2D([], [], color=ARROWS["color"], marker=">", linewidth=1),
                    f"Current, longest arrow {fastest:.3g} kn",
                )
            )
    return Overlay(draw, {}, rows)


def buoy_tracks(buoys: Sequence[BuoyTrack], time: np.datetime64) -> Overlay:
    """Return the tracks of drifting buoys until a time as a chart layer."""
    moment = notation.epoch(time)
    shown = [(own, own.time <= moment) for own in buoys if own.time[0] <= moment]

    def draw(ax: Axes, frame: Frame) -> None:
        for own, seen in shown:
            x, y = frame.project(own.lon[seen], own.lat[seen])
            ax.plot(x, y, zorder=6.8, **BUOY)

    names = [(np.array([[own.lon[seen][-1], own.lat[seen][-1]]]), own.name) for own, seen in shown]
    places = {
        f"drifter {own.name}": [np.stack([own.lon[seen], own.lat[seen]], -1)] for own, seen in shown
    }
    rows = [(Line2D([], [], **BUOY), "Drifting buoy, and its last fix")] if shown else []
    return Overlay(draw, places, rows, names)


def reports_on_scene(reports: Sequence[PointReport], time: np.datetime64) -> Overlay:
    """Return the places of winds and currents reported until a time as a chart layer."""
    moment = notation.epoch(time)
    shown = [own for own in reports if own.time <= moment]

    def draw(ax: Axes, frame: Frame) -> None:
        for own in shown:
            x, y = frame.project(np.array([own.lon]), np.array([own.lat]))
            ax.plot(x, y, zorder=6.8, **REPORT)

    names = [(np.array([[own.lon, own.lat]]), own.name) for own in shown]
    places = {f"report {own.name}": [np.array([[own.lon, own.lat]])] for own in shown}
    rows = [(Line2D([], [], **REPORT), "Wind or current reported")] if shown else []
    return Overlay(draw, places, rows, names)


def _some(flow: Flow) -> Array:
    """Return which places of a flow are in every third row and column, bool (m,)."""
    column, row = (np.unique(place, return_inverse=True)[1] for place in (flow.lon, flow.lat))
    return np.asarray((column % 3 == min(1, column.max())) & (row % 3 == min(1, row.max())))


def _rotate_to_chart(frame: Frame, lon: Array, lat: Array, velocity: Array) -> tuple[Array, Array]:
    """Return velocities (m, 2) rotated to the chart, whose north is up only in its middle."""
    little = np.where(lat > 89, -0.01, 0.01)
    x0, y0 = frame.project(lon, lat)
    x1, y1 = frame.project(lon, lat + little)
    turn = np.arctan2((y1 - y0) * np.sign(little), (x1 - x0) * np.sign(little)) - np.pi / 2
    east, north = velocity.T
    return east * np.cos(turn) - north * np.sin(turn), east * np.sin(turn) + north * np.cos(turn)


def itineraries(scenarios: Sequence[Scenario]) -> Overlay:
    """Return the itineraries of scenarios as a chart layer: lanes, tracks, way points and patrol
    areas.
    """
    named_itineraries = [
        (scenario.name, own) for scenario in scenarios if (own := scenario.itinerary) is not None
    ]
    networks = [
        phase.lanes.network
        for _, own in named_itineraries
        for phase in own.phases
        if isinstance(phase, Ways) and phase.lanes
    ]
    network = network_of.join_networks(networks) if networks else None
    places_of = {
        scenario.name: scenario.family for scenario in scenarios if scenario.family is not None
    }
    ways = _tracks_off_lanes(named_itineraries)
    groups = [(shapes, family.merge_names(names, places_of)) for shapes, names in ways.items()]
    rings = list(dict.fromkeys(ring for _, own in named_itineraries for ring in own.rings))
    trackers = _trackers(named_itineraries)
    corners = [
        list(zip(np.degrees(ring.lon).tolist(), np.degrees(ring.lat).tolist(), strict=True))
        for ring in rings
    ]

    def draw(ax: Axes, frame: Frame) -> None:
        if network is not None:
            lanes(ax, frame, network, alpha=0.3)
        if len(groups) > len(WAY_COLOURS):
            _draw_ways(ax, frame, [replace(shapes, odds=()) for shapes, _ in groups], CROWD)
        else:
            for number, (shapes, _) in enumerate(groups):
                _draw_ways(ax, frame, [shapes], _style(number))
        patrols(ax, frame, corners)
        for line in trackers:
            ax.plot(*frame.project(*line.T), zorder=6.6, scalex=False, scaley=False, **TRACKER)

    if len(groups) > len(WAY_COLOURS):
        rows: list[tuple[Any, str]] = [
            (Line2D([], [], **CROWD), f"Tracks of {sum(map(len, ways.values()))} scenarios")
        ]
    else:
        rows = [
            (Line2D([], [], **_style(k)), f"Way: {_names(names)}")
            for k, (_, names) in enumerate(groups)
        ]
    if any(shapes.outlines for shapes, _ in groups):
        rows.append((Patch(facecolor="none", edgecolor=WAY_COLOURS[0]), "50 % area of a way point"))
    rows += key(areas=False) if network is not None else []
    rows += [(Line2D([], [], **AREA), "Area of patrol")] if rings else []
    rows += (
        [
            (
                Line2D([], [], **{**TRACKER, "markevery": None}),
                "Tracker that targets seek or flee from",
            )
        ]
        if trackers
        else []
    )
    places: dict[str, Sequence[Array]] = {
        f"the track of {_names(names)}": shapes.arrays for shapes, names in groups
    }
    if len(groups) > len(WAY_COLOURS):
        places = {"the ways": [line for shapes, _ in groups for line in shapes.arrays]}
    if network is not None:
        places["the lanes"] = middles(network)
        places["where the lanes begin"] = _route_starts(named_itineraries)
    if rings:
        places["the patrol areas"] = [np.array([*ring, ring[0]]) for ring in corners]
    if trackers:
        places["the tracker"] = trackers
    return Overlay(draw, places, rows)


def _trackers(named_itineraries: Sequence[tuple[str, Itinerary]]) -> list[Array]:
    """Return the track of each tracker, points (lon, lat) [deg], unwrapped, (n, 2)."""
    found = dict.fromkeys(
        phase.tracker
        for _, own in named_itineraries
        for phase in own.phases
        if isinstance(phase, Acts) and phase.tracker
    )
    return [
        np.degrees(np.column_stack([np.unwrap(own.lon), own.lat]))
        for own in found
        if own is not None
    ]


def _route_starts(named_itineraries: Sequence[tuple[str, Itinerary]]) -> list[Array]:
    """Return the first node of each route, points (lon, lat) [deg], (1, 2)."""
    routes = [
        phase.lanes.route
        for _, own in named_itineraries
        for phase in own.phases
        if isinstance(phase, Ways) and phase.lanes
    ]
    first = dict.fromkeys((float(route.lon[0]), float(route.lat[0])) for route in routes)
    return [np.degrees([place]) for place in first]


@dataclass(frozen=True)
class _Shapes:
    """The shapes of one track, as rows (lon, lat) [deg]; equal ones are drawn once."""

    lines: tuple[tuple[tuple[float, float], ...], ...]
    outlines: tuple[tuple[tuple[float, float], ...], ...]  # closed: areas of its way points
    # label position (lon, lat) of each destination, and its probability
    odds: tuple[tuple[float, float, float], ...]

    @property
    def arrays(self) -> list[Array]:
        """All of its shapes, each (n, 2)."""
        return [np.array(shape) for shape in (*self.lines, *self.outlines)]


def _tracks_off_lanes(
    named_itineraries: Sequence[tuple[str, Itinerary]],
) -> dict[_Shapes, list[str]]:
    """Return the tracks off lanes, and the names of the scenarios that follow each."""
    found: dict[_Shapes, list[str]] = {}
    for name, own in named_itineraries:
        lines = tuple(
            _rows(np.degrees(line))
            for phase in own.phases
            if isinstance(phase, Ways) and phase.lanes is None
            for line in Itinerary((phase,)).ways
        )
        outlines = tuple(
            _rows(outline) for place, _ in own.places if (outline := _outline(place)) is not None
        )
        odds = tuple((*_label_position(place), share) for place, share in own.places if share < 1)
        if lines:
            found.setdefault(_Shapes(lines, outlines, odds), []).append(name)
    return found


def _rows(lonlat: npt.ArrayLike) -> tuple[tuple[float, float], ...]:
    return tuple((float(x), float(y)) for x, y in np.asarray(lonlat).T)


def _outline(place: Place) -> Array | None:
    """Return the edge (lon, lat) [deg] of a way point's area, or of its 50 % area; None for a
    point.
    """
    turn = np.linspace(0, 2 * np.pi, 73)
    match place:
        case InRing():
            return np.degrees([[*place.lon, place.lon[0]], [*place.lat, place.lat[0]]])
        case InDisc():
            along, across, to = place.radius * np.cos(turn), place.radius * np.sin(turn), 0.0
        case Near() if place.minor > 0:
            along, across, to = (
                HALF * place.major * np.cos(turn),
                HALF * place.minor * np.sin(turn),
                place.orientation,
            )
        case InBox():
            along = place.length / 2 * np.array([1, 1, -1, -1, 1])
            across, to = place.width / 2 * np.array([1, -1, -1, 1, 1]), place.orientation
        case _:
            return None
    s, c = np.sin(to), np.cos(to)
    lon, lat = sphere.destination(
        place.lon, place.lat, along * s + across * c, along * c - across * s
    )
    return np.array([polyline.unwrap(np.degrees(lon)), np.degrees(lat)])


def _label_position(place: Place) -> tuple[float, float]:
    """Return the northern end (lon, lat) [deg] of a way point's area, where the label
    covers least.
    """
    outline = _outline(place)
    if outline is None:
        return float(np.degrees(place.lon)), float(np.degrees(place.lat))
    return float(outline[0].mean()), float(outline[1].max())


def _draw_ways(ax: Axes, frame: Frame, some: Sequence[_Shapes], style: dict[str, Any]) -> None:
    """Draw tracks of one style, the areas of their way points, and probabilities of their
    destinations.
    """

    def lines(shapes: Iterable[Sequence[tuple[float, float]]], **how: Any) -> None:
        """Draw many lines as one with gaps: hundreds of separate lines take a hundred times as
        long.
        """
        drawn = [np.column_stack(frame.project(*np.array(shape).T)) for shape in shapes]
        if drawn:
            gap = np.full((1, 2), np.nan)
            ax.plot(
                *np.concatenate([x for one in drawn for x in (one, gap)]).T,
                scalex=False,
                scaley=False,
                zorder=8,
                **how,
            )

    lines((line for shapes in some for line in shapes.lines), **style)
    lines(
        (outline for shapes in some for outline in shapes.outlines),
        color=style["color"],
        linewidth=0.9,
    )
    for lon, lat, share in (odds for shapes in some for odds in shapes.odds):
        x, y = frame.project(lon, lat)
        text = f"prior {notation.number(100 * share, 3)} %"
        ax.annotate(
            text,
            (float(x), float(y)),
            (0, 3),
            textcoords="offset points",
            ha="center",
            fontsize=8,
            color=style["color"],
            path_effects=labels.HALO,
            zorder=14,
            annotation_clip=True,
        )


def _style(number: int) -> dict[str, Any]:
    return {
        "color": WAY_COLOURS[number],
        "linestyle": WAY_DASHES[number],
        "linewidth": 1.3,
    }


def _names(names: Sequence[str]) -> str:
    """Return the names of the scenarios that follow a track; of many, the first few and a count."""
    rest = len(names) - NAMED
    return f"{', '.join(names[:NAMED])} and {rest} more" if rest > 0 else ", ".join(names)
