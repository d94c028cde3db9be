"""The tracker table of case and tracking files: its track from legs, or from a GPX file."""

import math
from pathlib import Path

import numpy as np
from pydantic import Field, model_validator

from drift.case.forcing import sources
from drift.case.values import fields, gpx
from drift.tracking.tracker import path
from drift.tracking.tracker.path import Leg
from geo import notation, sphere
from geo.array import Array
from geo.errors import UserError
from geo.notation import KNOT

NEAR_POLE = np.radians(90 - 1e-6)  # [rad] of latitude
FASTEST = 150.0  # [m/s] highest speed of a tracker


class LegTable(fields.Table):
    """A leg along a rhumb line."""

    course: fields.Direction
    """True course."""
    speed: fields.Speed
    """Speed over ground."""
    lasting: fields.Duration | None = None
    """Duration of the leg; by default the last one lasts until the end of the case."""


class WayTable(fields.Table):
    """A track: an initial position and legs."""

    at: fields.Position
    """Initial position."""
    legs: list[LegTable] = Field(default_factory=list)
    """Legs in order; without any it does not move."""

    def way(self, end: float) -> path.Path:
        """Return the track until an end [s]."""
        left, legs = end, []
        for number, leg in enumerate(self.legs, 1):
            if leg.lasting is None and number < len(self.legs):
                raise ValueError(
                    f"legs {number}: lasting is missing; only the last leg lasts until the end"
                )
            lasting = min(left, end if leg.lasting is None else leg.lasting)
            if lasting > 0:
                legs.append(Leg(math.radians(leg.course), leg.speed, lasting))
            left -= lasting
        lon, lat = np.radians(self.at)
        if legs and abs(lat) > NEAR_POLE:
            raise ValueError("legs: at a pole a course has no meaning; begin beside it")
        return path.of_legs(float(lon), float(lat), legs)


class TrackerTable(fields.Table):
    """The track of the tracker: legs, a GPX file, or for detections their file's lat and lon."""

    at: fields.Position | None = None
    """Initial position."""
    legs: list[LegTable] = Field(default_factory=list)
    """Legs from there, in order."""
    track: str | None = None
    """A GPX file of its track, with times."""

    @model_validator(mode="after")
    def proper(self) -> "TrackerTable":
        """Reject two tracks at once, and legs without an initial position."""
        wrong = (
            ["at and track are both given; give one"]
            if self.at is not None and self.track is not None
            else []
        )
        if self.legs and self.at is None:
            wrong.append("at: is missing; legs begin there")
        fields.refuse(self, wrong)
        return self


def tracker_path(
    table: TrackerTable, own: path.Path | None, start: np.datetime64, end: float, folder: Path
) -> path.Path:
    """Return the track of the tracker.

    Args:
        table: the tracker's table.
        own: its track in the file of detections; None: there is none.
        start: start of the case.
        end: end of the case [s after its start].
        folder: folder from which relative paths start.

    Raises:
        ValueError: its track is missing, or given twice.
        UserError: the GPX file is invalid.
    """
    if own is not None and (table.at is not None or table.track is not None):
        raise ValueError("the detections give its positions (lat, lon); leave at and track out")
    if table.at is not None:
        way = WayTable(at=table.at, legs=table.legs).way(end)
        # After its last leg it does not move.
        stays = way.time[-1] < end
        return (
            path.Path(np.append(way.time, end), np.vstack([way.place, way.place[-1:]]))
            if stays
            else way
        )
    if table.track is not None:
        return _read_track(table.track, folder, start, end)
    if own is None:
        raise ValueError(
            "it has no position; give at with legs, track (a GPX file), or lat and lon in the file of detections"
        )
    return own


def _read_track(file: str, folder: Path, start: np.datetime64, end: float) -> path.Path:
    """Return the track of a GPX file, which must overlap the case's time."""
    name = sources.one_file(file, folder, "track")
    points = gpx.read_gpx(name)
    if not points.time:
        raise ValueError(f'"{Path(name).name}" has points without times; a tracker needs them')
    time = np.array(points.time) - notation.epoch(start)
    if time[0] > end or time[-1] < 0:
        raise ValueError(f'"{Path(name).name}" does not overlap the time of this case')
    return through(time, np.array(points.lon), np.array(points.lat), start, f'"{Path(name).name}"')


def through(time: Array, lon: Array, lat: Array, start: np.datetime64, label: str) -> path.Path:
    """Return the track through positions; of several at the same time the last one counts.

    Args:
        time: times [s after the start], shape (n,).
        lon: longitudes [deg], shape (n,).
        lat: latitudes [deg], shape (n,).
        start: start of the case, for messages.
        label: name of the source, for messages.

    Raises:
        UserError: the tracker would be faster than FASTEST.
    """
    last = np.append(np.diff(time) > 0, True)
    time, lon, lat = time[last], np.radians(lon[last]), np.radians(lat[last])
    if len(time) == 1:
        return path.standing(float(lon[0]), float(lat[0]), float(time[0]), float(time[0]) + 1.0)
    way = path.through(time, lon, lat)
    k = int(way.rate.argmax())
    if way.rate[k] * sphere.RADIUS > FASTEST:
        before, after = (
            notation.iso(start + np.timedelta64(round(float(t)), "s"))
            for t in (time[k], time[k + 1])
        )
        raise UserError(
            f"{label}: from {before} to {after} the tracker would make {way.rate[k] * sphere.RADIUS / KNOT:,.0f} kn; at most "
            f"{FASTEST / KNOT:.0f} kn is allowed: check times, latitudes and longitudes there"
        )
    return way
