"""Output files for `drift track`: the estimated track, containment areas and a map."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drift.apps.track import files
from drift.apps.track.record import Chased, Regained
from drift.products.files.chapter import Contents, OutputBundle, Stamped, bind_outputs
from drift.products.maps.imprint import Imprint


@dataclass(frozen=True)
class TrackOutputs:
    """The data that the files and the map are made from."""

    found: Regained
    imprint: Imprint
    land: Callable[[Any], Any]  # returns the polygons of land in a box [deg]


def _map(outputs: TrackOutputs, path: Path) -> None:
    from drift.apps.track import map as track_map  # imported here: Matplotlib takes a second

    track_map.plot_track(outputs.found, path, outputs.imprint, outputs.land)


FILES: dict[str, Callable[[TrackOutputs, Stamped], Contents]] = {
    "track.csv": lambda outputs, stamped: files.track_csv(outputs.found),
    "track.gpx": lambda outputs, stamped: files.gpx(outputs.found, stamped["run_id"]),
    "track_areas.geojson": lambda outputs, stamped: files.areas(outputs.found, stamped),
}
PATHS: dict[str, Callable[[TrackOutputs, Stamped], Contents]] = {  # if there is a path
    "path.csv": lambda outputs, stamped: files.path_table(outputs.found),
    "path.gpx": lambda outputs, stamped: files.path_gpx(outputs.found, stamped["run_id"]),
}
PICTURES: dict[str, Callable[[TrackOutputs, Path], None]] = {"track.png": _map}


def chapter(outputs: TrackOutputs, attributes: dict[str, str]) -> OutputBundle:
    """Return the outputs of `drift track`."""
    numbers = {"track": files.summary_of_track(outputs.found)}
    written = {**FILES, **(PATHS if isinstance(outputs.found.chased, Chased) else {})}
    return OutputBundle(
        numbers, bind_outputs(written, outputs), bind_outputs(PICTURES, outputs), facts=attributes
    )
