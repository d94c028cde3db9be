"""Tracks made good by units and datum markers.

A track is cut to the time of its sortie. It must not be faster than the unit, and must be complete
by the end of the sortie.
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

TOO_FAST = 1.2  # largest ratio of speed over ground to the speed of the unit
FASTEST = 150.0  # [m/s] of a unit whose speed is not given
TOO_SHORT = 30.0  # [s] shorter legs of a GPS track are too noisy to estimate a speed
SLACK = 1.0  # [s] allowed delay of legs: times are whole seconds
FINEST = 25.0  # [m] finest tolerance when tracks are simplified


def read_track(
    given: Any, key: str, speed: float | None, since: float | None, until: float | None, run: Run
) -> Legs:
    """Return the legs of a track between the start and the end of a sortie.

    Args:
        given: a GPX file, or waypoints with times.
        key: key of the case file, for messages.
        speed: speed of the unit [m/s]; None: not given.
        since: start of the sortie [s since 1970]; None: that of the track.
        until: end of the sortie [s since 1970]; None: that of the track.
        run: the run.

    Raises:
        ValueError: the track lies outside the sortie's time, or is too fast for the unit.
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
                f'{key}: "{Path(file).name}" covers {notation.format_dtg(first)} to {notation.format_dtg(last)}, outside this '
                "sortie's time"
            ) from None
        check_speed(polyline.thin_legs(legs, FINEST), speed, TOO_SHORT, key)
    return legs


def completed_share(legs: Legs, completed: float, until: float | None) -> Legs:
    """Return the completed part of legs.

    Args:
        legs: the planned legs.
        completed: the completed share, 0 to 1.
        until: end of the sortie [s since 1970]; None: that of the legs.

    Raises:
        ValueError: the legs cannot be completed by the end.
    """
    done = polyline.cut_legs(legs, completed)
    if until is None or done.time[-1] <= until:
        return done
    if done.time[-1] > until + SLACK:
        takes, has = done.time[-1] - done.time[0], until - done.time[0]
        length = float(polyline.lengths(done).sum()) / NMI
        raise ValueError(
            f"{length:.3g} nmi of legs take {hours(takes)}, but start to end is {hours(has)}; "
            "change end, speed or the legs, or give completed or actual"
        )
    return polyline.legs_between(done, done.time[0], until)


def read_marker(
    track: str | None, positions: Any, start: np.datetime64, end: np.datetime64, run: Run
) -> Legs:
    """Return the track of a datum marker, which must cover a whole sortie.

    Args:
        track: a GPX file; None: positions are given.
        positions: positions with times.
        start: start of the sortie.
        end: end of the sortie.
        run: the run.

    Raises:
        ValueError: the track has no times, or does not cover the sortie.
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
    """Reject search legs that were faster than the unit.

    Args:
        legs: the legs.
        speed: speed of the unit [m/s]; None: not given.
        shortest: legs up to this duration [s] are not checked.
        key: key of the case file, for the message.

    Raises:
        ValueError: a leg is too fast.
    """
    time = np.array(legs.time)
    lasted = np.diff(time)
    speeds = np.where(
        (lasted > shortest) & np.array(legs.searching), polyline.lengths(legs) / lasted, 0.0
    )
    most = FASTEST if speed is None else TOO_FAST * speed
    if speeds.size and speeds.max() > most:
        k = int(np.argmax(speeds))
        first, last = (notation.format_dtg(pattern_table.moment(legs.time[j])) for j in (k, k + 1))
        limit = (
            f"at most {FASTEST / KNOT:.3g} kn is allowed"
            if speed is None
            else f"its speed is {speed / KNOT:.3g} kn"
        )
        raise ValueError(
            f"{key}: the leg from {first} to {last} is made at {speeds.max() / KNOT:.3g} kn; {limit}; check times and "
            f"positions{'' if shortest == 0 else ', or give start and end of the search without its transit'}"
        )


def hours(seconds: float) -> str:
    """Return a duration [s] as text, in hours or minutes."""
    return f"{seconds / 3600:.1f} h" if seconds >= 5400 else f"{seconds / 60:.0f} min"
