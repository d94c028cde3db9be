"""What is handed out of a contact that was lost: its track, its areas and a picture."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drift.maps.imprint import Imprint
from drift.output.chapter import Chapter, Contents, Stamped, bound
from drift.regain import text
from drift.regain.record import Regained


@dataclass(frozen=True)
class Matter:
    """What the files and the picture are made from."""

    found: Regained
    imprint: Imprint
    land: Callable[[Any], Any]  # returns the polygons of land in a box [deg]


def _map(matter: Matter, path: Path) -> None:
    from drift.regain import map as track_map  # here: Matplotlib takes a second to import

    track_map.draw(matter.found, path, matter.imprint, matter.land)


FILES: dict[str, Callable[[Matter, Stamped], Contents]] = {
    "track.csv": lambda matter, stamped: text.table(matter.found),
    "track.gpx": lambda matter, stamped: text.gpx(matter.found, stamped["run_id"]),
    "track_areas.geojson": lambda matter, stamped: text.areas(matter.found, stamped),
}
PATHS: dict[str, Callable[[Matter, Stamped], Contents]] = {  # where a case asks for a pursuit
    "path.csv": lambda matter, stamped: text.path_table(matter.found),
    "path.gpx": lambda matter, stamped: text.path_gpx(matter.found, stamped["run_id"]),
}
PICTURES: dict[str, Callable[[Matter, Path], None]] = {"track.png": _map}


def chapter(matter: Matter, attributes: dict[str, str]) -> Chapter:
    """Return the chapter of a contact that was lost."""
    numbers = {"track": text.numbers(matter.found)}
    files = {**FILES, **(PATHS if matter.found.chased is not None else {})}
    return Chapter(numbers, bound(files, matter), bound(PICTURES, matter), facts=attributes)
