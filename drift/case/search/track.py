"""Tracks that units and markers made good.

They are cut to their sortie, are no faster than the unit, and are done by the end.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np

from drift.case.context import Run
from drift.case.forcing import sources
from drift.case.search import pattern as pattern_table
from drift.case.values import gpx
from geo import notation, polyline
from geo.notation import KNOT, NMI
from geo.polyline import Legs

TOO_FAST = 1.2  # times its own speed, which no unit exceeds over the ground
FASTEST = 150.0  # [m/s] of a unit whose speed is not given
TOO_SHORT = 30.0  # [s] legs of a receiver's track that are shorter are too noisy to tell a speed
SLACK = 1.0  # [s] by which legs may be late: times are whole seconds
FINEST = 25.0  # [m] to which tracks are followed at most


def made_good(
    given: Any, key: str, speed: float | None, since: float | None, until: float | None, run: Run
) -> Legs:
    """Return the legs of a track, as far as they lie between start and end [s since 1970].

    given: a file, or waypoints with times; key: where it stands; speed [m/s]: of the unit, None if
    not told.
    """
    if isinstance(given, list):
        legs = pattern_table.timed_legs(given, run.start)
        check_speed(legs, speed, 0.0, key)
        return legs
    file = sources.one_file(given, run.folder, key)
    track = gpx.read_gpx(file)
    try:
        legs = pattern_table.track_legs(track, since, speed)
    except ValueError as error:
        raise ValueError(f'{key}: "{Path(file).name}": {error}') from None
    if track.time:
        first, last = (pattern_table.moment(time) for time in (legs.time[0], legs.time[-1]))
        try:
            legs = polyline.legs_between(legs, since or -math.inf, until or math.inf)
        except ValueError:
            raise ValueError(
                f'{key}: "{Path(file).name}" is of {notation.format_dtg(first)} to {notation.format_dtg(last)}, not of this '
                "sortie's time"
            ) from None
        check_speed(polyline.thin_legs(legs, FINEST), speed, TOO_SHORT, key)
    return legs


def completed_share(legs: Legs, completed: float, until: float | None) -> Legs:
    """Return what was completed of legs, a share; refuse what cannot be done by the end [s since
    1970].
    """
    done = polyline.cut_legs(legs, completed)
    if until is None or done.time[-1] <= until:
        return done
    if done.time[-1] > until + SLACK:
        takes, has = done.time[-1] - done.time[0], until - done.time[0]
        length = float(polyline.lengths(done).sum()) / NMI
        raise ValueError(
            f"{length:.3g} nmi of legs take {hours(takes)}, from start to end are {hours(has)}; "
            "change end, speed or the legs, or say what was done: completed or actual"
        )
    return polyline.legs_between(done, done.time[0], until)


def marker(
    track: str | None, positions: Any, start: np.datetime64, end: np.datetime64, run: Run
) -> Legs:
    """Return where a marker was, all the time from a start to an end.

    Its track is a GPX track, or positions with times.
    """
    if track is not None:
        file = sources.one_file(track, run.folder, "marker.track")
        points = gpx.read_gpx(file)
        if not points.time:
            raise ValueError(f'marker.track: "{Path(file).name}" has no times')
        legs = pattern_table.track_legs(points, None, None)
    else:
        legs = pattern_table.timed_legs(positions, run.start)
    if legs.time[0] > notation.epoch(start) or legs.time[-1] < notation.epoch(end):
        first, last = (pattern_table.moment(time) for time in (legs.time[0], legs.time[-1]))
        raise ValueError(
            f"marker is known from {notation.format_dtg(first)} to {notation.format_dtg(last)}, not for the whole sortie, "
            f"{notation.format_dtg(start)} to {notation.format_dtg(end)}"
        )
    return polyline.thin_legs(legs, FINEST)


def check_speed(legs: Legs, speed: float | None, shortest: float, key: str) -> None:
    """Refuse legs of search that lasted more than `shortest` [s] and were faster than the unit."""
    time = np.array(legs.time)
    lasted = np.diff(time)
    speeds = np.where(
        (lasted > shortest) & np.array(legs.searching), polyline.lengths(legs) / lasted, 0.0
    )
    most = FASTEST if speed is None else TOO_FAST * speed
    if speeds.size and speeds.max() > most:
        k = int(np.argmax(speeds))
        first, last = (notation.format_dtg(pattern_table.moment(legs.time[j])) for j in (k, k + 1))
        said = (
            "no unit searches at that" if speed is None else f"its speed is {speed / KNOT:.3g} kn"
        )
        raise ValueError(
            f"{key}: the leg from {first} to {last} is made at {speeds.max() / KNOT:.3g} kn; {said}; check times and "
            f"positions{'' if shortest == 0 else ', or give start and end of the search without its transit'}"
        )


def hours(seconds: float) -> str:
    """Return a duration [s] in words."""
    return f"{seconds / 3600:.1f} h" if seconds >= 5400 else f"{seconds / 60:.0f} min"
