"""What the exporting process answers: a result as one file of another format, or as one to mail.

Nothing is written, so a result never changes by it.
"""

import base64
import io
import os
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from drift.apps.export import exporter, finished, gis, globe
from drift.apps.export.finished import Finished, Release
from drift.apps.serve import shelf
from drift.apps.serve.answers import note_answers
from geo.errors import UserError
from geo.files import fence

MAIL = "mail"
FORMATS = (MAIL, *exporter.FORMATS)
LARGEST = 20 * 10**6  # [bytes] of a file that the page offers
LARGEST_MAIL = 10 * 10**6  # [bytes] that most mail servers take
LARGEST_MAILED = 2**28  # [bytes] of a file before it is packed
# files of a result that are mailed, the most important first
MAILED = ("report.html", "map.png", "plan.txt", "plan.gpx", "plan.png", "patrols.txt")
SHEETS = "plan-"  # sheets of units: plan-A-1.png
ARCHIVE_DATE = globe.ARCHIVE_DATE


def export(request: Mapping[str, Any]) -> dict[str, Any]:
    """Return a result in a format: the suffix of the file and its content in base64.

    Args:
        request: `folder`, `run` and `format`, one of FORMATS.
    """
    folder, run, kind = Path(request["folder"]), request["run"], request["format"]
    try:
        handle, _ = shelf.file_of_run(folder, run, shelf.SUMMARY)
        os.close(handle)
    except OSError:
        raise UserError(f"{run}: is not a complete result of this folder") from None
    fence.check(str(folder / run / shelf.SUMMARY))
    try:
        return _exported(finished.open_result(folder / run), run, kind)
    except UserError as error:  # without the folder, which other machines need not know
        raise UserError(*(line.replace(f"{folder}{os.sep}", "") for line in error.lines)) from None


def _exported(opened: Finished | Release, run: str, kind: str) -> dict[str, Any]:
    if kind == MAIL:
        if not isinstance(opened, Finished):
            raise UserError(f"{run}: has no forecast to mail; export kml, gpx or geojson")
        return _answer(".zip", _zipped(_fitting(_mailed(opened))), run)
    contents = exporter.format_files(opened, kind)
    if len(contents) == 1:
        ((name, content),) = contents.items()
        return _answer(os.path.splitext(name)[1], content, run)
    return _answer(f"-{kind}.zip", _zipped(contents), run)


def _answer(suffix: str, content: bytes, run: str) -> dict[str, Any]:
    if len(content) > LARGEST:
        raise UserError(
            f"{run}: this file has {len(content) / 1e6:.0f} MB, the page offers at most "
            f"{LARGEST / 1e6:.0f}; make it with drift export"
        )
    return {"suffix": suffix, "content": base64.b64encode(content).decode()}


def _mailed(run: Finished) -> Iterator[tuple[str, bytes]]:
    """Yield name and content of the files to mail, the most important first."""
    yield "summary.txt", note_answers.note({"path": str(run.folder)})["text"].encode()
    yield "case.toml", str(run.forecast.attrs.get("case", "")).encode()
    sheets = sorted(name for name in run.names if name.startswith(SHEETS) and name[-4:] == ".png")
    for name in (*MAILED, *sheets):
        if name in run.names:
            folder = run.folder
            yield name, shelf.content_of_run(folder.parent, folder.name, name, LARGEST_MAILED)
    yield from globe.kml_files(run).items()
    yield from gis.files(run).items()


def _fitting(files: Iterator[tuple[str, bytes]]) -> dict[str, bytes]:
    """Return the files that fit into a mail; the summary names those that do not."""
    kept: dict[str, bytes] = {}
    left, room = [], LARGEST_MAIL - 10_000  # names and dates of the archive
    for name, content in files:
        size = len(zlib.compress(content))
        if size <= room:
            kept[name], room = content, room - size
        else:
            left.append(name)
    if left:
        words = f"Not in this file, which would be too large to mail: {', '.join(left)}.\n"
        kept["summary.txt"] += words.encode()
    return kept


def _zipped(contents: Mapping[str, bytes]) -> bytes:
    """Return an archive; equal contents give equal bytes."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in contents.items():
            entry = zipfile.ZipInfo(name, ARCHIVE_DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, content)
    return packed.getvalue()
