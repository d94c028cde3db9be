"""What a search hands out: what each sortie and contact has done.

It comes as a table, as shapes for a GIS, and in pictures.
"""

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


def _evidence(matter: Matter, path: Path) -> None:
    from drift.search import evidence_map  # imported here, for Matplotlib takes a second

    evidence_map.draw(matter.updates, path, matter.setting)


def _search(matter: Matter, path: Path, page: int = 1) -> None:
    from drift.search import map as search_map

    sorties = matter.updates.sorties
    search_map.draw(matter.forecast, sorties, matter.contacts, matter.updates, path, matter.setting, page=page)


FILES: dict[str, Callable[[Matter, Stamped], Contents]] = {
    "sorties.csv": lambda matter, stamped: search_tables.csv(matter.updates, stamped["run_id"]),
    "sorties.geojson": lambda matter, stamped: search_tables.shapes(
        matter.updates.sorties, matter.contacts, matter.updates, stamped
    ),
}
PICTURES: dict[str, Callable[[Matter, Path], None]] = {
    "evidence.png": _evidence,
}
# Maps of the sorties, which need a forecast with outputs at their times.
MAPS: dict[str, Callable[[Matter, Path], None]] = {
    "search.png": _search,
}


def chapter(matter: Matter, *, mapped: bool) -> Chapter:
    """Return the chapter of a search; mapped: whether the forecast has outputs at the times of its sorties."""
    pictures = bound(PICTURES, matter)
    if mapped and matter.updates.sorties:
        from drift.search import map as search_map

        more = range(2, 1 + search_map.pages(matter.updates.sorties))
        pictures |= bound(MAPS, matter) | {f"search-{page}.png": partial(_search, matter, page=page) for page in more}
    return Chapter({"search": search_tables.numbers(matter.updates)}, bound(FILES, matter), pictures)


def overlay(sorties: Sequence[Sortie], contacts: Sequence[Contact], time: Any) -> Any:
    """Return what the map of a forecast shows of a search at a time, a drift.maps.overlay.Overlay."""
    from drift.search import layers

    return layers.reminder(sorties, contacts, time)
