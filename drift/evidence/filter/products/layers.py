"""Map layers of a search: areas, legs as flown, zones of a watch, contacts and sensors.

Lines are dark with a light halo, for greyscale print.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from drift.evidence.filter import shapes as search_shapes
from drift.evidence.filter.records import (
    NO_SENSORS,
    Barrier,
    Contact,
    Line,
    Look,
    Presence,
    Sensors,
    Sortie,
)
from drift.products.maps import marks
from drift.products.maps.chart import Frame
from drift.products.maps.overlay import Overlay
from geo.array import Array

AREA: dict[str, Any] = {"color": "#003b36", "linewidth": 1.6, "linestyle": "-"}
LEGS: dict[str, Any] = {"color": "#003b36", "linewidth": 0.7, "linestyle": "-"}
TRANSIT: dict[str, Any] = {"color": "#003b36", "linewidth": 0.8, "linestyle": (0, (1, 2))}
ZONES: dict[str, Any] = {"color": "#003b36", "linewidth": 1.0, "linestyle": (0, (8, 3))}
CONTACT: dict[str, Any] = {"color": "#a30052", "linewidth": 1.1, "linestyle": (0, (5, 1.5, 1, 1.5))}
SENSORS: dict[str, dict[str, Any]] = {
    "Field, nothing there": {"color": "#003b36", "linewidth": 1.3, "linestyle": (0, (4, 1.5))},
    "Field, something there": {
        "color": "#a30052",
        "linewidth": 1.3,
        "linestyle": (0, (6, 1.2, 1, 1.2, 1, 1.2)),
    },
    "Barrier, silent": {"color": "#003b36", "linewidth": 2.6, "linestyle": (0, (1.2, 0.8))},
    "Barrier, reported": {
        "color": "#a30052",
        "linewidth": 2.6,
        "linestyle": (0, (4, 0.8, 1.2, 0.8)),
    },
    "Line asked about": {"color": "#333333", "linewidth": 1.4, "linestyle": (0, (7, 2, 1, 2))},
}
POINT: dict[str, Any] = {
    "marker": "D",
    "linestyle": "none",
    "markeredgewidth": 1.4,
    "markerfacecolor": "white",
}
LIGHT = 0.55  # relative width of lines on the map of a forecast
Sensor = Look | Presence | Barrier | Line

WORDS = f"Contact, {100 * search_shapes.NEAR_ALL:g} % of its error"


def reminder(
    sorties: Sequence[Sortie], contacts: Sequence[Contact], time: Any, sensors: Sensors = NO_SENSORS
) -> Overlay:
    """Return the overlay of a search on the map of a forecast.

    It has thin lines, and everything that had begun by the time of the map.
    """
    begun = [sortie for sortie in sorties if sortie.start <= time]
    seen = [contact for contact in contacts if contact.time <= time]
    heard = begun_sensors(sensors, time)

    def draw(ax: Axes, frame: Frame) -> None:
        for past in begun:
            sortie(ax, frame, past, time, light=True)
        for report in seen:
            contact(ax, frame, report, 0.75)
        for what in heard:
            sensor(ax, frame, what, LIGHT)

    named = _named(begun, seen, heard)
    places_of = places(seen, begun) | sensor_places(heard)
    return Overlay(draw, places_of, key(begun, seen, LIGHT) + sensor_key(heard, LIGHT), named)


def _named(
    sorties: Sequence[Sortie], contacts: Sequence[Contact], sensors: Sequence[Sensor]
) -> list[tuple[Array, str]]:
    """Return one shape (n, 2) [deg] of each sortie, contact and sensor, with its name."""
    named = []
    for flown in sorties:
        ring = search_shapes.searched(flown)
        legs = [points for searching, points in search_shapes.flown(flown) if searching]
        if ring is not None or legs:
            named.append((ring if ring is not None else legs[0], flown.name))
    named += [(search_shapes.contact(contact)[0][1], contact.name) for contact in contacts]
    return named + [(search_shapes.sensor(what), what.name) for what in sensors]


def sortie(ax: Axes, frame: Frame, flown: Sortie, time: Any, *, light: bool = False) -> None:
    """Draw the area of a sortie at a time, and its legs until then.

    light: whether to draw thin lines, for the map of a forecast.
    """
    over = time >= flown.end
    scale = LIGHT if light else 1.0
    ring = search_shapes.searched(flown, min(max(time, flown.start), flown.end))
    if ring is not None:
        _line(ax, frame, ring, AREA, scale, zorder=7)
    for searching, points in search_shapes.flown(flown, None if over else time):
        _line(ax, frame, points, LEGS if searching else TRANSIT, scale, zorder=6.5)
    for ring in search_shapes.zones(flown, min(max(time, flown.start), flown.end)):
        _line(ax, frame, ring, ZONES, scale, zorder=6.5)


def contact(ax: Axes, frame: Frame, seen: Contact, scale: float = 1.0) -> None:
    """Draw the possible positions of a contact, and the sensor or the fix as a diamond."""
    for shape, points in search_shapes.contact(seen):
        if shape == "point":
            x, y = frame.project(points[:, 0], points[:, 1])
            ax.plot(
                x, y, markersize=6.5 * scale, markeredgecolor=CONTACT["color"], zorder=11.8, **POINT
            )
        else:
            _line(ax, frame, points, CONTACT, scale, zorder=6)


def begun_sensors(sensors: Sensors, time: Any) -> list[Sensor]:
    """Return the looks made and the presences and barriers begun by a time, and all lines."""
    looks = [look for look in sensors.looks if look.time <= time]
    lasting: list[Presence | Barrier] = [*sensors.presences, *sensors.barriers]
    return [*looks, *(what for what in lasting if what.start <= time), *sensors.lines]


def sensor(ax: Axes, frame: Frame, what: Sensor, scale: float = 1.0) -> None:
    """Draw the field of a look or a presence, a barrier, or a line."""
    _line(ax, frame, search_shapes.sensor(what), SENSORS[_style_of(what)], scale, zorder=6)


def _style_of(what: Sensor) -> str:
    """Return the entry of SENSORS with which a sensor is drawn."""
    if isinstance(what, Line):
        return "Line asked about"
    if isinstance(what, Barrier):
        return "Barrier, silent" if what.reported is None else "Barrier, reported"
    silent = what.present == "never" if isinstance(what, Presence) else not what.positive
    return "Field, nothing there" if silent else "Field, something there"


def sensor_places(sensors: Sequence[Sensor]) -> dict[str, list[Array]]:
    """Return the shapes of sensors by name, for beyond.left_out.

    Lines are left out, since they may lie anywhere.
    """
    shown = [what for what in sensors if not isinstance(what, Line)]
    return {
        f'{type(what).__name__.lower()} "{what.name}"': [search_shapes.sensor(what)]
        for what in shown
    }


def sensor_key(sensors: Sequence[Sensor], scale: float = 1.0) -> list[tuple[Any, str]]:
    """Return the symbols and texts of sensors for the legend."""
    sorts = {_style_of(what) for what in sensors}
    styles = {
        words: {**style, "linewidth": scale * style["linewidth"]}
        for words, style in SENSORS.items()
    }
    return [(Line2D([], [], **style), words) for words, style in styles.items() if words in sorts]


def _line(
    ax: Axes, frame: Frame, points: Array, style: dict[str, Any], scale: float, zorder: float
) -> None:
    width = scale * style["linewidth"]
    # Thin lines lie close together: wide halos would hide what they cross.
    more, alpha = (1.6, 0.75) if width >= 0.9 else (1.0, 0.4)
    halo = [patheffects.withStroke(linewidth=width + more, foreground="white", alpha=alpha)]
    x, y = frame.project(points[:, 0], points[:, 1])
    ax.plot(
        x,
        y,
        zorder=zorder,
        path_effects=halo,
        scalex=False,
        scaley=False,
        **{**style, "linewidth": width},
    )


def extent(sorties: Sequence[Sortie]) -> list[marks.Line]:
    """Return the shapes of sorties that a map must include: areas and searching legs."""
    lines = []
    for sortie in sorties:
        shapes = [
            points
            for searching, points in search_shapes.flown(sortie)
            if searching and not sortie.watches
        ]
        shapes += [
            ring
            for time in (sortie.start, sortie.end)
            if (ring := search_shapes.searched(sortie, time)) is not None
        ]
        lines += [
            marks.Line(points[:, 0].tolist(), points[:, 1].tolist(), sortie.name)
            for points in shapes
        ]
    return lines


def _is_stationary(sortie: Sortie) -> bool:
    """Whether a sortie is a watch at one position."""
    return (
        sortie.watches
        and sortie.legs is not None
        and len({*zip(sortie.legs.lon, sortie.legs.lat, strict=True)}) == 1
    )


def places(contacts: Sequence[Contact], sorties: Sequence[Sortie] = ()) -> dict[str, list[Array]]:
    """Return the shapes of contacts and sorties by name, for beyond.left_out."""
    shapes_of: dict[str, list[Array]] = {}
    for seen in contacts:
        if len(seen.fixes) > 1:  # list the positions A and B of a beacon separately
            for k, fix in enumerate(seen.fixes, 1):
                alone = replace(seen, fixes=(fix,))
                shapes_of[f'contact "{seen.name}", position {k}'] = [
                    points for _, points in search_shapes.contact(alone)
                ]
        else:
            shapes_of[f'contact "{seen.name}"'] = [
                points for _, points in search_shapes.contact(seen)
            ]
    for sortie in sorties:
        ring = search_shapes.searched(sortie)
        shapes = [points for _, points in search_shapes.flown(sortie)] + search_shapes.zones(
            sortie, sortie.end
        )
        shapes_of[f'sortie "{sortie.name}"'] = shapes + ([] if ring is None else [ring])
    return shapes_of


def key(
    sorties: Sequence[Sortie], contacts: Sequence[Contact], scale: float = 1.0
) -> list[tuple[Any, str]]:
    """Return the symbols and texts of sorties and contacts for the legend."""

    def symbol(style: dict[str, Any]) -> Line2D:
        return Line2D([], [], **{**style, "linewidth": scale * style["linewidth"]})

    rows: list[tuple[Any, str]] = []
    if any(sortie.area is not None for sortie in sorties):
        rows.append((symbol(AREA), "Searched area"))
    if any(
        sortie.legs is not None and any(sortie.legs.searching) and not _is_stationary(sortie)
        for sortie in sorties
    ):
        planned = {sortie.planned for sortie in sorties}
        how = "planned" if planned == {True} else "flown or planned" if True in planned else "flown"
        rows.append((symbol(LEGS), f"Legs as {how}"))
    if any(sortie.legs is not None and not all(sortie.legs.searching) for sortie in sorties):
        rows.append((symbol(TRANSIT), "Not searching"))
    if any(sortie.watch is not None for sortie in sorties):
        rows.append((symbol(ZONES), "Edges of zones"))
    if contacts:
        diamond = Line2D([], [], color=CONTACT["color"], markersize=6.5 * scale, **POINT)
        rows.append(((symbol(CONTACT), diamond), WORDS))
    return rows
