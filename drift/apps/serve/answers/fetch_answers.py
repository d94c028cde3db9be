"""What the warm processes answer about downloads: the box of a text, and a text with its files."""

import tomllib
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from drift.apps.serve.fields import form, form_sources
from geo.errors import UserError


def area(request: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a download for a text must cover.

    Args:
        request: `text` of a case whose winds and currents may be missing, its `path`, and the
            `quantities` to download.

    Returns:
        `box`: west, south, east, north [deg]; `begin` and `end`: UTC.

    Raises:
        UserError: the text has a mistake, or sets one of the quantities where a form cannot.
    """
    from drift.apps.fetch import fetching
    from drift.case import file as case_file

    text = request["text"]
    data = form.parse_text(text)
    for quantity in request["quantities"]:
        form_sources.check_free(data, quantity)
    case = case_file.load_text(Path(request["path"]), text, fetching.NO_SOURCES)
    box, begin, end = fetching.area_and_span(case)
    edges = [box.west, box.south, box.east, box.north]
    return {"box": edges, "begin": f"{begin}Z", "end": f"{end}Z"}


def use(request: Mapping[str, Any]) -> dict[str, Any]:
    """Return a text that reads downloaded files.

    Args:
        request: `text` of a case, the `folder` of the files, beside the case, and the `tables` that
            `drift fetch` has written for them.

    Raises:
        UserError: the text sets a quantity where a form cannot, or the tables are of something else.
    """
    try:
        written = tomllib.loads(request["tables"])
        tables = {
            quantity: {**one, "files": f"{request['folder']}/{PurePosixPath(one['files']).name}"}
            for quantity in form_sources.SOURCES
            for one in written.get(quantity, [])
        }
    except (ValueError, RecursionError, TypeError, KeyError, AttributeError):
        tables = {}
    if not tables:
        raise UserError(f"{request['folder']} has no winds and currents of drift fetch")
    return {"text": form.use_files(request["text"], tables)}
