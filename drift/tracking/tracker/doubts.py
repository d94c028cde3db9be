"""What must be doubted in a tracking case before anything is followed: plots and logs that no
vessel made.
"""

from collections import Counter

import numpy as np
import shapely

from drift.tracking.tracker import detections, path, shore
from drift.tracking.tracker.detections import Detections
from drift.tracking.tracker.study import Scene, Study
from geo import notation, sphere
from geo.array import Array
from geo.coast import shore as coast
from geo.notation import KNOT

# [m] from the water, of a tracker's place that is doubted: charts, shorelines and logs differ
INLAND = 1000.0
MOST = 0.5  # of the box of a plot on land, from which on it is doubted
SAMPLE = 200  # places of a tracker that are looked at, beside those that its log has
GRID = 40  # ranges, and bearings, of a box at which land is looked for


def doubts_about(study: Study) -> list[str]:
    """Return what must be doubted in the detections and the tracker's log of a case, each in words."""
    told = [*_strayed(study), *_inland(study)]
    if not isinstance(study.target, Detections):
        return told
    dry = [
        f"{notation.percent(share, 0)} of the box of the plot of {notation.format_dtg(_moment(study, time))} is land: check its bearing and range, "
        "and the tracker's position"
        for time, share in ashore(study).items()
        if share > MOST
    ]
    return [*_plots(study, study.target), *dry, *told]


def ashore(study: Study) -> dict[float, float]:
    """Return what share of the box of each plot that has a bearing and a range is land, by its time
    [s].

    Of several at one time it is the largest.
    """
    found = study.target
    assert isinstance(found, Detections)
    whole = ~np.isnan(found.bearing) & ~np.isnan(found.range)
    if not study.minds_land or not whole.any():
        return {}
    time, far, sensors = (
        found.time[whole],
        found.range[whole],
        [study.sensors[k] for k in found.sensor[whole]],
    )
    reach, share, half = (
        np.array([getattr(one, name) for one in sensors])
        for name in ("reach", "range_share", "bearing_error")
    )
    middles = (np.arange(GRID) + 0.5) / GRID
    near, outer = far * (1 - share), np.minimum(far * (1 + share), reach)
    ranges = (near[:, None] + (outer - near)[:, None] * middles)[:, :, None]
    bearings = (found.bearing[whole][:, None] + half[:, None] * (2 * middles - 1))[:, None, :]
    lon, lat = (np.radians(x)[:, None, None] for x in path.degrees(study.tracker.at(time)[0]))
    places = path.vector(
        *sphere.destination(lon, lat, ranges * np.sin(bearings), ranges * np.cos(bearings))
    )
    dry: dict[float, float] = {}
    for when, part in zip(time, _on_land(study, places).mean(axis=(1, 2)), strict=True):
        dry[float(when)] = max(float(part), dry.get(float(when), 0.0))
    return dry


def _inland(study: Study) -> list[str]:
    """Return where the tracker, and a target that is followed in an experiment, are inland: no
    water is within INLAND north, south, east or west, nor between.
    """
    ways = {"tracker": study.tracker}
    if isinstance(study.target, Scene):
        ways["target"] = study.target.way
    told = []
    for who, way in ways.items() if study.minds_land else ():
        begin, end = max(way.time[0], 0.0), min(way.time[-1], study.end)
        known = way.time[(way.time >= begin) & (way.time <= end)]
        time = np.unique(np.concatenate([known, np.linspace(begin, max(begin, end), SAMPLE)]))
        lon, lat, polygons = _placed(study, way.at(time)[0])
        high = float(np.degrees(INLAND / sphere.RADIUS))
        wide = high / np.maximum(np.cos(np.radians(lat)), 0.01)
        squares = shapely.STRtree(shapely.box(lon - wide, lat - high, lon + wide, lat + high))
        if (dry := np.sort(squares.query(polygons, predicate="covers")[1])).size:
            told.append(
                f"the {who} is on land at {notation.format_dtg(_moment(study, float(time[dry[0]])))}, "
                f"{notation.position(float(lon[dry[0]]), float(lat[dry[0]]))}: check latitudes and longitudes, unless it flies"
            )
    return told


def _placed(study: Study, place: Array) -> tuple[Array, Array, Array]:
    """Return (lon, lat) [deg] of unit vectors (..., 3), and the polygons of land about them."""
    box = shore.within_reach(study)
    lon, lat = path.degrees(place)
    return (
        sphere.near_degrees(lon, (box.west + box.east) / 2),
        lat,
        coast.read_land("gshhg", box).polygons,
    )


def _on_land(study: Study, place: Array) -> Array:
    """Return whether places (..., 3) are on land; in their shape (...)."""
    lon, lat, polygons = _placed(study, place)
    found = np.zeros(lon.shape, bool)
    found.flat[
        shapely.STRtree(shapely.points(lon.ravel(), lat.ravel())).query(
            polygons, predicate="intersects"
        )[1]
    ] = True
    return found


def _moment(study: Study, seconds: float) -> np.datetime64:
    return np.datetime64(notation.epoch(study.start) + round(seconds), "s")


def _plots(study: Study, seen: Detections) -> list[str]:
    """Return which plots are too far from the one before, stand twice, or were made by what was
    off.
    """
    fastest, told = study.methods[0].behaviour.fastest, []
    bearing = np.round(np.mod(seen.bearing, 2 * np.pi), 9) % round(2 * np.pi, 9)
    rows = Counter(
        zip(
            seen.time,
            seen.sensor,
            *(np.nan_to_num(part, nan=-1.0) for part in (bearing, seen.range)),
            strict=True,
        )
    )
    for (time, number, *_), times in rows.items():
        if times > 1:
            when = notation.format_dtg(_moment(study, float(time)))
            told.append(
                f"the plot of {when} by {study.sensors[number].name} stands {times} times: check for one that is missing"
            )
    for time, speed in zip(*detections.needed(study.sensors, seen, study.tracker), strict=True):
        if speed > fastest * 1.001:
            digits = 0 if speed > fastest + KNOT else 2
            told.append(
                f"the plot of {notation.format_dtg(_moment(study, time))} needs {speed / KNOT:,.{digits}f} kn from the one before, "
                f"fastest is {fastest / KNOT:.4g} kn: check both, or take a higher fastest"
            )
    for number, time in zip(seen.sensor, seen.time, strict=True):
        sensor = study.sensors[number]
        # One that is never on is one whose silence is not to count.
        if (
            not sensor.hears
            and np.isfinite(sensor.on.begin)
            and not sensor.on.includes(float(time))
        ):
            when = notation.format_dtg(_moment(study, float(time)))
            told.append(
                f"{sensor.name} was off when it detected something at {when}: check when it is on"
            )
    return list(dict.fromkeys(told))


def _strayed(study: Study) -> list[str]:
    """Return between which times the tracker's log has it go far faster than it mostly does."""
    way = study.tracker
    speed = way.rate * sphere.RADIUS / KNOT
    usual = float(np.median(speed[speed > 1.0])) if (speed > 1.0).sum() > 2 else np.inf
    times = [notation.iso(_moment(study, time)) for time in way.time]
    return [
        f"the tracker would make {speed[k]:,.0f} kn from {times[k]} to {times[k + 1]}, mostly it makes {usual:,.0f} kn: "
        "check its latitudes and longitudes there"
        for k in np.flatnonzero((speed > 2.5 * usual) & (speed > 20.0))
    ]
