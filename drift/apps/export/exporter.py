"""Export a finished result for other programs: a folder of files in one format, all or none."""

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from drift.apps.export import animation, finished, gis, globe, messages, plotter, raster, routes
from drift.apps.export.finished import Finished, Release
from drift.products.files import publication, writer
from geo.errors import UserError

FORMATS: Mapping[str, Callable[[Finished], dict[str, bytes]]] = {
    "kml": globe.kml_files,
    "kmz": globe.kmz_files,
    "gpx": plotter.files,
    "geojson": gis.files,
    "geotiff": raster.files,
    "rtz": routes.files,
    "gif": animation.files,
    "sitrep": messages.files,
}
# Formats for results of `drift origin`.
OF_RELEASE: Mapping[str, Callable[[Release], dict[str, bytes]]] = {
    "kml": globe.release_files,
    "gpx": plotter.release_files,
    "geojson": gis.release_files,
}


def export(
    folder: str | os.PathLike[str],
    format: str,
    out: str | os.PathLike[str] | None = None,
    *,
    times: str | Sequence[str] = (),
    overwrite: bool = False,
) -> list[Path]:
    """Write a finished run in a format of other programs.

    Args:
        folder: complete results of `run`, `plan` or `origin` (see `results`).
        format: "kml", "kmz", "gpx", "geojson", "geotiff", "rtz" (of plans), "gif" or "sitrep"; of an origin
            "kml", "gpx" or "geojson".
        out: a folder; None: FOLDER-FORMAT in the current one.
        times: outputs to export, such as "+12 h" or ["+12 h", "221200ZNOV26"]; () for all.
        overwrite: whether an earlier export in `out` is replaced.

    Returns:
        The paths of the files.

    Raises:
        UserError: the results are incomplete or do not suit the format, there is no output at a
            time, or `out` contains files; then nothing is written.
    """
    if format not in FORMATS:
        raise UserError(f'format "{format}" is not known; there are {", ".join(FORMATS)}')
    folder = Path(folder)
    target = Path(out) if out is not None else Path(f"{folder.resolve().name}-{format}")
    publication.check(target, overwrite)
    run = finished.open_result(folder, [times] if isinstance(times, str) else times)
    contents_by_name = format_files(run, format)
    publication.check(target, overwrite, contents_by_name)

    def fill(staging: Path) -> None:
        for name, contents in contents_by_name.items():
            (staging / name).write_bytes(contents)

    return writer.write_all_or_none(target, run.run, fill, overwrite=overwrite)


def format_files(run: Finished | Release, format: str) -> dict[str, bytes]:
    """Return the contents of a format's files by name; raise UserError if the result is damaged."""
    try:
        if isinstance(run, Finished):
            return FORMATS[format](run)
        if format not in OF_RELEASE:
            raise UserError(
                f"results {run.folder}: come from drift origin, which {format} does not support; "
                f"use {', '.join(OF_RELEASE)}"
            )
        return OF_RELEASE[format](run)
    except (
        ValueError,
        TypeError,
        LookupError,
        ArithmeticError,
        AttributeError,
        RecursionError,
    ) as error:
        # Each file is checked when it is read, but two files may contradict each other.
        reason = " ".join(str(error).split())[:150] or type(error).__name__
        raise UserError(
            f"results {run.folder}: cannot be written as {format} ({reason}); run the case again"
        ) from error
