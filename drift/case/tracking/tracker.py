"""Where a tracker is, as keys of case files and of tracking files have it: from a place along legs,
or by a GPX file.
"""

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
FASTEST = 150.0  # [m/s] of a tracker


class LegTable(fields.Table):
    """A rhumb line."""

    course: fields.Direction
    """True, in degrees."""
    speed: fields.Speed
    """Over ground."""
    lasting: fields.Duration | None = None
    """How long; the last one until the end of the case by default."""


class WayTable(fields.Table):
    """Where something is."""

    at: fields.Position
    """Where it begins."""
    legs: list[LegTable] = Field(default_factory=list)
    """Where it goes, one after the other; without any it stays."""

    def way(self, end: float) -> path.Path:
        """Return the way until an end [s]."""
        left, legs = end, []
        for number, leg in enumerate(self.legs, 1):
            if leg.lasting is None and number < len(self.legs):
                raise ValueError(
                    f"legs {number}: lasting is missing; only the last leg goes on until the end"
                )
            lasting = min(left, end if leg.lasting is None else leg.lasting)
            if lasting > 0:
                legs.append(Leg(math.radians(leg.course), leg.speed, lasting))
            left -= lasting
        lon, lat = np.radians(self.at)
        if legs and abs(lat) > NEAR_POLE:
            raise ValueError("legs: from a pole all courses lead the same way; begin beside it")
        return path.of_legs(float(lon), float(lat), legs)


class TrackerTable(fields.Table):
    """Where the tracker is: from a place along legs, or by a track; of detections also by their
    file's lat and lon.
    """

    at: fields.Position | None = None
    """Where it begins."""
    legs: list[LegTable] = Field(default_factory=list)
    """Where it goes from there."""
    track: str | None = None
    """A GPX file with times, of where it was."""

    @model_validator(mode="after")
    def proper(self) -> "TrackerTable":
        """Refuse two ways at once, and legs from nowhere."""
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
    """Return where the tracker is; own: by the file of detections."""
    if own is not None and (table.at is not None or table.track is not None):
        raise ValueError("the detections say where it was (lat, lon); leave at and track out")
    if table.at is not None:
        way = WayTable(at=table.at, legs=table.legs).way(end)
        # It stays where its legs end.
        stays = way.time[-1] < end
        return (
            path.Path(np.append(way.time, end), np.vstack([way.place, way.place[-1:]]))
            if stays
            else way
        )
    if table.track is not None:
        return _tracked(table.track, folder, start, end)
    if own is None:
        raise ValueError(
            "it has no position; give at with legs, track (a GPX file), or lat and lon in the file of detections"
        )
    return own


def _tracked(file: str, folder: Path, start: np.datetime64, end: float) -> path.Path:
    """Return where a tracker was by a GPX file, from the start on to an end [s after it].

    Raises UserError, one line.
    """
    name = sources.one_file(file, folder, "track")
    points = gpx.read_gpx(name)
    if not points.time:
        raise ValueError(f'"{Path(name).name}" has points without times; a tracker needs them')
    time = np.array(points.time) - notation.epoch(start)
    if time[0] > end or time[-1] < 0:
        raise ValueError(f'"{Path(name).name}" is not of the time of this case')
    return through(time, np.array(points.lon), np.array(points.lat), start, f'"{Path(name).name}"')


def through(time: Array, lon: Array, lat: Array, start: np.datetime64, label: str) -> path.Path:
    """Return the way through places [deg] at times [s] after the start, of those of one time the
    last.
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
            f"{label}: from {before} to {after} the tracker would make {way.rate[k] * sphere.RADIUS / KNOT:,.0f} kn; allowed are "
            f"{FASTEST / KNOT:.0f}: check times, latitudes and longitudes there"
        )
    return way
