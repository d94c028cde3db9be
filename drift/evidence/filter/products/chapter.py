"""Output files of a search: effects of each sortie, contact and sensor, and crossings of lines.

The files are a table, shapes for a GIS, and pictures.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from drift.evidence.filter import crossings
from drift.evidence.filter.products import report
from drift.evidence.filter.products import tables as search_tables
from drift.evidence.filter.records import NO_SENSORS, Contact, Sensors, Sortie
from drift.evidence.filter.updates import Updates
from drift.forecast.build import Forecast
from drift.products.files.chapter import Contents, OutputBundle, Stamped, bind_outputs
from drift.products.maps.imprint import Setting


@dataclass(frozen=True)
class SearchOutputs:
    """The data from which the files and pictures are made."""

    updates: Updates
    contacts: Sequence[Contact]
    forecast: Forecast
    setting: Setting
    sensors: Sensors = NO_SENSORS


def _evidence(matter: SearchOutputs, path: Path) -> None:
    # imported here, since importing Matplotlib takes a second
    from drift.evidence.filter.products import evidence_map

    evidence_map.plot_evidence(matter.updates, path, matter.setting)


def _search(matter: SearchOutputs, path: Path, page: int = 1) -> None:
    from drift.evidence.filter.products import map as search_map

    sorties = matter.updates.sorties
    search_map.plot_searches(
        matter.forecast,
        sorties,
        matter.contacts,
        matter.updates,
        path,
        matter.setting,
        page=page,
        sensors=matter.sensors,
    )


def _lines(matter: SearchOutputs, path: Path) -> None:
    from drift.evidence.filter.products import crossings_map

    crossings_map.plot_crossings(matter.updates, path, matter.setting)


FILES: dict[str, Callable[[SearchOutputs, Stamped], Contents]] = {
    "sorties.csv": lambda matter, stamped: search_tables.csv(matter.updates, stamped["run_id"]),
    "sorties.geojson": lambda matter, stamped: search_tables.shapes(
        matter.updates.sorties, matter.contacts, matter.updates, stamped, matter.sensors
    ),
}
PICTURES: dict[str, Callable[[SearchOutputs, Path], None]] = {
    "evidence.png": _evidence,
}
# Maps of the sorties, which need a forecast with outputs at their times.
MAPS: dict[str, Callable[[SearchOutputs, Path], None]] = {
    "search.png": _search,
}
# Files of lines whose first crossing is reported.
LINE_FILES: dict[str, Callable[[SearchOutputs, Stamped], Contents]] = {
    "lines.csv": lambda matter, stamped: crossings.csv(matter.updates.crossings, stamped["run_id"]),
}
LINE_PICTURES: dict[str, Callable[[SearchOutputs, Path], None]] = {
    "lines.png": _lines,
}


def search_bundle(matter: SearchOutputs, *, mapped: bool) -> OutputBundle:
    """Return the outputs of a search.

    Args:
        matter: the data.
        mapped: whether the forecast has outputs at the times of the sorties.
    """
    has_updates = bool(matter.updates.all or matter.updates.sorties)
    files, pictures = (
        (bind_outputs(FILES, matter), bind_outputs(PICTURES, matter)) if has_updates else ({}, {})
    )
    if matter.updates.crossings is not None:
        files, pictures = (
            files | bind_outputs(LINE_FILES, matter),
            pictures | bind_outputs(LINE_PICTURES, matter),
        )
    if mapped and matter.updates.sorties:
        from drift.evidence.filter.products import map as search_map

        more = range(2, 1 + search_map.pages(matter.updates.sorties))
        pictures |= bind_outputs(MAPS, matter) | {
            f"search-{page}.png": partial(_search, matter, page=page) for page in more
        }
    # planned sorties are among the outputs of the plan
    sorties = [sortie for sortie in matter.updates.sorties if not sortie.planned]
    leaves = (
        (partial(report.search_leaves, matter.updates, sorties, matter.contacts, matter.sensors),)
        if has_updates
        else ()
    )
    return OutputBundle(
        {"search": search_tables.summary_of_search(matter.updates)}, files, pictures, leaves=leaves
    )


def overlay(
    sorties: Sequence[Sortie], contacts: Sequence[Contact], time: Any, sensors: Sensors = NO_SENSORS
) -> Any:
    """Return the overlay of a search on the map of a forecast at a time.

    It is a drift.products.maps.overlay.Overlay.
    """
    from drift.evidence.filter.products import layers

    return layers.reminder(sorties, contacts, time, sensors)
