"""What a chart shows of a search: areas, legs as flown, zones of a watch and contacts, dark with a halo, for grey print."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from drift.maps.chart import Frame
from drift.maps.marks import Line
from drift.maps.overlay import Overlay
from drift.search import shapes as search_shapes
from drift.search.records import Contact, Sortie
from geo.array import Array

AREA: dict[str, Any] = {"color": "#003b36", "linewidth": 1.6, "linestyle": "-"}
LEGS: dict[str, Any] = {"color": "#003b36", "linewidth": 0.7, "linestyle": "-"}
TRANSIT: dict[str, Any] = {"color": "#003b36", "linewidth": 0.8, "linestyle": (0, (1, 2))}
ZONES: dict[str, Any] = {"color": "#003b36", "linewidth": 1.0, "linestyle": (0, (8, 3))}
CONTACT: dict[str, Any] = {"color": "#a30052", "linewidth": 1.1, "linestyle": (0, (5, 1.5, 1, 1.5))}
POINT: dict[str, Any] = {"marker": "D", "linestyle": "none", "markeredgewidth": 1.4, "markerfacecolor": "white"}
LIGHT = 0.55  # of the width of lines where searches are only a reminder
WORDS = f"Contact, {100 * search_shapes.NEAR_ALL:g} % of its error"


def reminder(sorties: Sequence[Sortie], contacts: Sequence[Contact], time: Any) -> Overlay:
    """Return what the map of a forecast shows of a search: thin, and of it only what had begun by the map's time."""
    begun = [one for one in sorties if one.start <= time]
    seen = [one for one in contacts if one.time <= time]

    def draw(ax: Axes, here: Frame) -> None:
        for each in begun:
            sortie(ax, here, each, time, light=True)
        for other in seen:
            contact(ax, here, other, 0.75)

    return Overlay(draw, places(seen, begun), key(begun, seen, LIGHT))


def sortie(ax: Axes, here: Frame, one: Sortie, time: Any, *, light: bool = False) -> None:
    """Draw a sortie as it is at a time: its area, and its legs so far; after its end, the whole of it.

    light: thin, as a reminder on a map of something else.
    """
    over = time >= one.end
    scale = LIGHT if light else 1.0
    ring = search_shapes.searched(one, min(max(time, one.start), one.end))
    if ring is not None:
        _line(ax, here, ring, AREA, scale, zorder=7)
    for searching, points in search_shapes.flown(one, None if over else time):
        _line(ax, here, points, LEGS if searching else TRANSIT, scale, zorder=6.5)
    for ring in search_shapes.zones(one, min(max(time, one.start), one.end)):
        _line(ax, here, ring, ZONES, scale, zorder=6.5)


def contact(ax: Axes, here: Frame, one: Contact, scale: float = 1.0) -> None:
    """Draw where something seen may have been, and the sensor or the fix as a diamond."""
    for shape, points in search_shapes.contact(one):
        if shape == "point":
            x, y = here.project(points[:, 0], points[:, 1])
            ax.plot(x, y, markersize=6.5 * scale, markeredgecolor=CONTACT["color"], zorder=11.8, **POINT)
        else:
            _line(ax, here, points, CONTACT, scale, zorder=6)


def _line(ax: Axes, here: Frame, points: Array, style: dict[str, Any], scale: float, zorder: float) -> None:
    width = scale * style["linewidth"]
    # Thin lines lie close together: wide halos would hide what they cross
    more, alpha = (1.6, 0.75) if width >= 0.9 else (1.0, 0.4)
    halo = [patheffects.withStroke(linewidth=width + more, foreground="white", alpha=alpha)]
    x, y = here.project(points[:, 0], points[:, 1])
    ax.plot(x, y, zorder=zorder, path_effects=halo, scalex=False, scaley=False, **{**style, "linewidth": width})


def extent(sorties: Sequence[Sortie]) -> list[Line]:
    """Return what of sorties a chart must show: areas and searching legs; not transit, and no sonar's rings."""
    found = []
    for one in sorties:
        shapes = [points for searching, points in search_shapes.flown(one) if searching and one.watch is None]
        shapes += [ring for time in (one.start, one.end) if (ring := search_shapes.searched(one, time)) is not None]
        found += [Line(points[:, 0].tolist(), points[:, 1].tolist(), one.name) for points in shapes]
    return found


def _stands(one: Sortie) -> bool:
    """Whether it is a watch at one place: its legs go nowhere."""
    return one.watch is not None and one.legs is not None and len({*zip(one.legs.lon, one.legs.lat, strict=True)}) == 1


def places(contacts: Sequence[Contact], sorties: Sequence[Sortie] = ()) -> dict[str, list[Array]]:
    """Return the shapes of contacts and sorties by name, for beyond.told."""
    found: dict[str, list[Array]] = {}
    for seen in contacts:
        if len(seen.fixes) > 1:  # each is a place of its own: A and B of a beacon
            for k, fix in enumerate(seen.fixes, 1):
                alone = replace(seen, fixes=(fix,))
                found[f'contact "{seen.name}", position {k}'] = [points for _, points in search_shapes.contact(alone)]
        else:
            found[f'contact "{seen.name}"'] = [points for _, points in search_shapes.contact(seen)]
    for one in sorties:
        ring = search_shapes.searched(one)
        shapes = [points for _, points in search_shapes.flown(one)] + search_shapes.zones(one, one.end)
        found[f'sortie "{one.name}"'] = shapes + ([] if ring is None else [ring])
    return found


def key(sorties: Sequence[Sortie], contacts: Sequence[Contact], scale: float = 1.0) -> list[tuple[Any, str]]:
    """Return symbols and texts of a legend for what is drawn of these."""

    def symbol(style: dict[str, Any]) -> Line2D:
        return Line2D([], [], **{**style, "linewidth": scale * style["linewidth"]})

    rows: list[tuple[Any, str]] = []
    if any(one.area is not None for one in sorties):
        rows.append((symbol(AREA), "Searched area"))
    if any(one.legs is not None and any(one.legs.searching) and not _stands(one) for one in sorties):
        rows.append((symbol(LEGS), "Legs as flown"))
    if any(one.legs is not None and not all(one.legs.searching) for one in sorties):
        rows.append((symbol(TRANSIT), "Not searching"))
    if any(one.watch is not None for one in sorties):
        rows.append((symbol(ZONES), "Edges of zones"))
    if contacts:
        diamond = Line2D([], [], color=CONTACT["color"], markersize=6.5 * scale, **POINT)
        rows.append(((symbol(CONTACT), diamond), WORDS))
    return rows
