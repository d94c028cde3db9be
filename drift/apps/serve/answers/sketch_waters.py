"""The waters of the last first map, kept for the next one: one planner's maps lie close together.

To open files and to crop and regrid their slices takes most of the time of a first map in model
winds and currents. Its numbers do not depend on it (`drift.pipeline.shared_forcing`). What a first
map needs can also be read before it is asked for (`read_ahead`).
"""

import os
from collections.abc import Callable, Hashable
from contextlib import closing
from dataclasses import dataclass

from drift.case.record import Case
from drift.engine.environment import domain, environment
from drift.engine.environment.environment import Environment
from drift.engine.motion.clock import Clock
from drift.engine.motion.forcing import Forcing
from drift.pipeline import run_setup, shared_forcing
from geo.forcing.reading import kept

BEYOND = 0.25  # of the width and height of a case's box: so far its region reaches beyond it
HOUR = 3600


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
        The region; None for a case whose files may change unnoticed, as behind an address. That of
        a wide case is no larger than what the case reads, and shares no coast but its own.
    """
    paths = [path for spec in case.sources for part in spec.parts for path in part.files]
    paths += [str(path) for path in (case.coast.source, case.coast.lakes) if _is_file(path)]
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
    if shared_forcing.is_wide(around):
        around = environment.box_to_read(box)
    region = shared_forcing.SharedRegion(around, shared_forcing.Files({}))
    _last.append(_Kept(files, region))
    return region


def _is_file(named: object) -> bool:
    """Return whether a coast's source or lakes are a file of the user's."""
    return not isinstance(named, bool) and str(named).lower() not in ("gshhg", "none")


def _stamp(path: str) -> tuple[int, int]:
    now = os.stat(path)
    return now.st_size, now.st_mtime_ns


def read_ahead(case: Case, where: Environment, tell: Callable[[str, float], None]) -> bool:
    """Read the slices of a case's run into its region.

    Args:
        case: with a region.
        where: its environment, opened in that region.
        tell: called after each hour of the run with "slices" and the share that is read; it may
            raise.

    Returns:
        Whether the region keeps them all. Where it cannot, only as many are read as it can keep.
    """
    period = case.period
    hours = Clock(period.epoch, period.duration, period.direction, HOUR)
    begin, end = sorted((period.epoch, period.epoch + period.direction * period.duration))
    with closing(Forcing(list(where.scenarios), period.direction)) as forcing:
        room = kept.MOST / max(forcing.size(begin, end), 1)
        for low, high, step in hours.steps():
            share = (step.elapsed + step.duration) / period.duration
            if share > room:
                break
            forcing.set(low, high)
            tell("slices", min(share, 1.0))
    return room >= 1
