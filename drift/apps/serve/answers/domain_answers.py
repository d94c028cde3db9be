"""What the warm process answers about the domain of a text: the box that a run computes."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from drift.apps.fetch import fetching
from drift.case import file as case_file
from geo.errors import UserError


def domain(request: Mapping[str, Any]) -> dict[str, Any]:
    """Return the box outside which a particle of a run counts as departed.

    Args:
        request: `text` of a case, whose winds and currents may be missing, and its `path`.

    Returns:
        `box`: west, south, east, north [deg]; None for a case with mistakes.
    """
    for changes in ({}, fetching.NO_SOURCES):
        try:
            case = case_file.load_text(Path(request["path"]), request["text"], changes)
            box, _, _ = fetching.area_and_span(case)
        except UserError:
            continue
        return {"box": [box.west, box.south, box.east, box.north]}
    return {"box": None}
