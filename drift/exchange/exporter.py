"""A finished run, written for other programs: a folder of files in one format, whole or not there."""

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from drift.exchange import bridge, finished, globe, plotter, raster
from drift.exchange.finished import Finished
from drift.output import publication, writer
from geo.errors import UserError

FORMATS: Mapping[str, Callable[[Finished], dict[str, bytes]]] = {
    "kml": globe.kml_files,
    "kmz": globe.kmz_files,
    "gpx": plotter.files,
    "geotiff": raster.files,
    "rtz": bridge.files,
}


def export(
    folder: str | os.PathLike[str],
    format: str,
    out: str | os.PathLike[str] | None = None,
    *,
    times: Sequence[str] = (),
    overwrite: bool = False,
) -> list[Path]:
    """Write a finished run in a format of other programs; return the paths of the files.

    folder: what `run` or `plan` wrote, whole (see `results`). format: "kml", "kmz", "gpx", "geotiff" or "rtz" (of plans).
    out: a folder, by default FOLDER-FORMAT in the current one. times: outputs that are wanted, all by default, such as
    ["+12 h", "221200ZNOV26"]. Raises UserError, and writes nothing, where that cannot be.
    """
    if format not in FORMATS:
        raise UserError(f'format "{format}" is not known; there are {", ".join(FORMATS)}')
    folder = Path(folder)
    target = Path(out) if out is not None else Path(f"{folder.resolve().name}-{format}")
    publication.check(target, overwrite)
    run = finished.opened(folder, times)
    made = FORMATS[format](run)
    publication.check(target, overwrite, made)

    def fill(place: Path) -> None:
        for name, contents in made.items():
            (place / name).write_bytes(contents)

    return writer.whole(target, run.run, fill, overwrite=overwrite)
