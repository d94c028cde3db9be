"""Output files for `drift track`: the estimated track, containment areas and a map."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drift.apps.track import files
from drift.apps.track.record import Chased, Regained
from drift.products.files.chapter import Chapter, Contents, Stamped, bound
from drift.products.maps.imprint import Imprint


@dataclass(frozen=True)
class TrackOutputs:
    """The data that the files and the map are made from."""

    found: Regained
    imprint: Imprint
    land: Callable[[Any], Any]  # returns the polygons of land in a box [deg]


def _map(matter: TrackOutputs, path: Path) -> None:
    from drift.apps.track import map as track_map  # imported here: Matplotlib takes a second

    track_map.plot_track(matter.found, path, matter.imprint, matter.land)


FILES: dict[str, Callable[[TrackOutputs, Stamped], Contents]] = {
    "track.csv": lambda matter, stamped: files.track_csv(matter.found),
    "track.gpx": lambda matter, stamped: files.gpx(matter.found, stamped["run_id"]),
    "track_areas.geojson": lambda matter, stamped: files.areas(matter.found, stamped),
}
PATHS: dict[str, Callable[[TrackOutputs, Stamped], Contents]] = {  # if there is a path
    "path.csv": lambda matter, stamped: files.path_table(matter.found),
    "path.gpx": lambda matter, stamped: files.path_gpx(matter.found, stamped["run_id"]),
}
PICTURES: dict[str, Callable[[TrackOutputs, Path], None]] = {"track.png": _map}


def chapter(matter: TrackOutputs, attributes: dict[str, str]) -> Chapter:
    """Return the outputs of `drift track`."""
    numbers = {"track": files.summary_of_track(matter.found)}
    written = {**FILES, **(PATHS if isinstance(matter.found.chased, Chased) else {})}
    return Chapter(numbers, bound(written, matter), bound(PICTURES, matter), facts=attributes)
