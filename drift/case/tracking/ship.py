"""The track of a ship that lost objects on her way: fixes of a file, checked for the losses."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from drift.case.forcing import sources
from drift.case.tracking.one_track import read_one_track
from geo import notation, sphere
from geo.array import Array
from geo.notation import NMI

KEY = "[spill] track"
ROUNDED = NMI  # [m] between fixes at one time; ships make less in a minute, to which AIS rounds
LONGEST_GAP = 6 * 3600.0  # [s] between fixes; over a longer one the ship's way is unknown


class Fixes(NamedTuple):
    """Where a ship was, in order of time."""

    time: Array  # [s since 1970], (n,)
    lon: Array  # [deg]
    lat: Array


def read_ship(given: str, name: str | None, folder: Path) -> Fixes:
    """Return the fixes of a ship in a file; of several at one time, close together, the first.

    Args:
        given: the file, as the case names it.
        name: which ship of the file; None: its only one.
        folder: folder from which relative paths start.

    Raises:
        UserError: the file cannot be read, or holds no track.
        ValueError: a fix is not possible, or the fixes are not in the order of time.
    """
    file = sources.one_file(given, folder, KEY)
    track = read_one_track(
        file,
        name,
        KEY,
        "[spill] ship",
        "ships",
        'give ship = "NAME", the one that lost the objects',
    )
    label = f'{KEY}: "{Path(file).name}"'
    time, lon, lat = track.time, track.lon, track.lat
    possible = np.isfinite(time) & (np.abs(lat) <= 90) & (lon >= -180) & (lon <= 360)
    if not possible.all():
        k = int(np.argmin(possible))
        what = (
            f"lon {lon[k]:g}, lat {lat[k]:g}, which is not on Earth in degrees"
            if np.isfinite([time[k], lon[k], lat[k]]).all()
            else "no proper time, lon or lat"
        )
        raise ValueError(
            f"{label}: fix {k + 1:,} has {what}; mend or remove the {(~possible).sum():,} of its "
            f"{time.size:,} fixes that are so"
        )
    lon = sphere.wrap_degrees(lon)
    step = np.diff(time)
    if (step < 0).any():
        k = int(np.argmax(step < 0))
        raise ValueError(
            f"{label} goes back in time: fix {k + 2:,} at {_dtg(time[k + 1])} follows "
            f"{_dtg(time[k])}; put its fixes in the order of their times"
        )
    leap = sphere.distance(*np.radians([lon[:-1], lat[:-1], lon[1:], lat[1:]]))
    apart = (step == 0) & (leap > ROUNDED)
    if apart.any():
        k = int(np.argmax(apart))
        raise ValueError(
            f"{label} has two places at {_dtg(time[k])}, {leap[k] / NMI:,.1f} nmi apart: "
            f"{notation.stated_position(lon[k], lat[k])} and "
            f"{notation.stated_position(lon[k + 1], lat[k + 1])}; remove the wrong one, or add a "
            "column ship if they are of two ships"
        )
    fresh = np.append(True, step > 0)
    if fresh.sum() < 2:
        raise ValueError(f"{label} has fixes at one time only; a track needs two")
    return Fixes(time[fresh], lon[fresh], lat[fresh])


def during(fixes: Fixes, first: float, last: float) -> Fixes:
    """Return the fixes from the last one before a period to the first one after it.

    Args:
        fixes: that cover the period.
        first: its begin [s since 1970].
        last: its end.

    Raises:
        ValueError: no fix is known for so long that the way between is a guess.
    """
    begin = min(int(np.searchsorted(fixes.time, first, "right")) - 1, fixes.time.size - 2)
    end = max(int(np.searchsorted(fixes.time, last, "left")), begin + 1)
    cut = Fixes(*(column[begin : end + 1] for column in fixes))
    gap = np.diff(cut.time)
    if gap.max() > LONGEST_GAP:
        k = int(np.argmax(gap))
        raise ValueError(
            f"{KEY}: no fix from {_dtg(cut.time[k])} to {_dtg(cut.time[k + 1])}, while objects may "
            f"go overboard; at most {LONGEST_GAP / 3600:g} h between two fixes of a file; add some, "
            "narrow [[spill.loss]], or write the track as points with at and time in the case"
        )
    return cut


def _dtg(time: float) -> str:
    return notation.format_dtg(np.datetime64(round(time), "s"))
