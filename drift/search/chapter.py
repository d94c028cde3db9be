"""What a search hands out: what each sortie and contact has done, as a table, as shapes for a GIS, and in pictures."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from drift.forecast.build import Forecast
from drift.maps.imprint import Setting
from drift.output.chapter import Chapter, Contents, Stamped, bound
from drift.search import tables as search_tables
from drift.search.records import Contact, Sortie
from drift.search.updates import Updates


@dataclass(frozen=True)
class Matter:
    """What the files and pictures are made from."""

    updates: Updates
    contacts: Sequence[Contact]
    forecast: Forecast
    setting: Setting


def _evidence(one: Matter, path: Path) -> None:
    from drift.search import evidence_map  # here: Matplotlib takes a second to import

    evidence_map.draw(one.updates, path, one.setting.imprint, particles=one.setting.particles)


def _search(one: Matter, path: Path, page: int = 1) -> None:
    from drift.search import map as search_map

    on = one.setting
    search_map.draw(
        one.forecast, one.updates.sorties, one.contacts, one.updates, path, on.imprint, page=page, polygons=on.polygons,
        marks=on.marks, particles=on.particles,
    )  # fmt: skip


FILES: dict[str, Callable[[Matter, Stamped], Contents]] = {
    "sorties.csv": lambda one, stamped: search_tables.csv(one.updates, stamped["run_id"]),
    "sorties.geojson": lambda one, stamped: search_tables.geojson(
        one.updates.sorties, one.contacts, one.updates, stamped
    ),
}
PICTURES: dict[str, Callable[[Matter, Path], None]] = {
    "evidence.png": _evidence,
}
MAPS: dict[
    str, Callable[[Matter, Path], None]
] = {  # a picture for each sortie: of a forecast with outputs at its times
    "search.png": _search,
}


def chapter(one: Matter, *, mapped: bool) -> Chapter:
    """Return the chapter of a search; mapped: whether the forecast has outputs at the times of its sorties."""
    pictures = bound(PICTURES, one)
    if mapped and one.updates.sorties:
        from drift.search import map as search_map

        more = range(2, 1 + search_map.pages(one.updates.sorties))
        pictures |= bound(MAPS, one) | {f"search-{page}.png": partial(_search, one, page=page) for page in more}
    return Chapter({"search": search_tables.numbers(one.updates)}, bound(FILES, one), pictures)


def overlay(sorties: Sequence[Sortie], contacts: Sequence[Contact], time: Any) -> Any:
    """Return what the map of a forecast shows of a search at a time, a drift.maps.overlay.Overlay."""
    from drift.search import layers

    return layers.reminder(sorties, contacts, time)
