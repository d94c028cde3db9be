"""The command `drift export`: its options and its call."""

import argparse
from pathlib import Path
from typing import Any

from drift.apps.cli.answer import Answer

FORMATS = ("kml", "kmz", "gpx", "geojson", "geotiff", "rtz", "gif", "sitrep")


def add(commands: Any) -> argparse.ArgumentParser:
    """Add the command's parser to the grammar, and return it."""
    export: argparse.ArgumentParser = commands.add_parser(
        "export",
        help="write a finished run for Google Earth, chart plotters, ECDIS or a GIS, or as an animation",
    )
    export.add_argument(
        "folder", metavar="FOLDER", help="results of drift run, drift plan or drift origin"
    )
    export.add_argument(
        "format", metavar="FORMAT", choices=FORMATS, help=f"{', '.join(FORMATS)} (docs/formats.md)"
    )
    export.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for the files (default: FOLDER-FORMAT)"
    )
    export.add_argument(
        "--time",
        action="append",
        default=[],
        dest="times",
        metavar="TIME",
        help="time of an output to export, like '+12 h' or 221200ZNOV26; may be repeated "
        "(default: all)",
    )
    export.add_argument(
        "--overwrite", action="store_true", help="replace files that an earlier export wrote there"
    )
    return export


def run(args: argparse.Namespace) -> Answer:
    """Export a finished run and list the files."""
    from drift.apps.export import exporter
    from drift.products.files import manifest

    paths = exporter.export(
        args.folder, args.format, args.out, times=args.times, overwrite=args.overwrite
    )
    names = [path.name for path in paths if path.name != manifest.NAME]
    listed = ", ".join(names) if len(names) <= 4 else f"{len(names)} files"
    folder = paths[0].parent
    return Answer(lines=(f"{listed} in {folder}",), numbers={"files": names}, results=folder)
