"""The waters of the last first map, kept for the next one: one planner's maps lie close together.

To open files and to crop and regrid their slices takes most of the time of a first map in model
winds and currents. Its numbers do not depend on it (`drift.pipeline.shared_forcing`).
"""

import os
from collections.abc import Hashable
from dataclasses import dataclass

from drift.case.record import Case
from drift.engine.environment import domain
from drift.pipeline import run_setup, shared_forcing
from geo.box import Box

BEYOND = 0.25  # of the width and height of a case's box: so far its region reaches beyond it


@dataclass(frozen=True)
class _Kept:
    files: Hashable  # with their sizes and times
    region: shared_forcing.SharedRegion


_last: list[_Kept] = []  # at most one


def region_of(case: Case) -> shared_forcing.SharedRegion | None:
    """Return the region in which a case lies, that of the case before if that holds it too.

    Args:
        case: with sources of any kind, but no dataset in memory.

    Returns:
        The region; None for a case whose files may change unnoticed, as behind an address, and for
        one that is too wide to share anything.
    """
    paths = [path for spec in case.sources for part in spec.parts for path in part.files]
    try:
        files = tuple((path, *_stamp(path)) for path in paths)
    except OSError:  # an address, or a file that is gone: the case opens it itself, and says so
        return None
    box = domain.bounds(run_setup.ensemble_spec(case), run_setup.environment_spec(case))
    if _last and _last[0].files == files and shared_forcing.lies_inside(box, _last[0].region.box):
        return _last[0].region
    width, height = box.east - box.west, box.north - box.south
    around = box.grown(BEYOND * width, BEYOND * height)
    _last.clear()  # before the next one is made: two would be too much memory
    if _square_degrees(around) > shared_forcing.WIDEST:
        return None
    region = shared_forcing.SharedRegion(around, shared_forcing.Files({}))
    _last.append(_Kept(files, region))
    return region


def _stamp(path: str) -> tuple[int, int]:
    now = os.stat(path)
    return now.st_size, now.st_mtime_ns


def _square_degrees(box: Box) -> float:
    return (box.east - box.west) * (box.north - box.south)
