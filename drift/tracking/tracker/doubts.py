"""Plausibility checks of a tracking case: plots and logs that no vessel can have made."""

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

# [m] tolerated distance of a tracker from water: charts, shorelines and logs differ
INLAND = 1000.0
MOST = 0.5  # share of a plot's box on land above which a warning is given
SAMPLE = 200  # positions of a tracker that are checked, in addition to those of its log
GRID = 40  # ranges, and bearings, at which a box is tested for land


def doubts_about(study: Study) -> list[str]:
    """Return warnings about a case's detections and its tracker's log."""
    warnings = [*_strayed(study), *_inland(study)]
    if not isinstance(study.target, Detections):
        return warnings
    plots_on_land = [
        f"{notation.percent(share, 0)} of the box of the plot of {notation.format_dtg(_moment(study, time))} is land: check its bearing and range, "
        "and the tracker's position"
        for time, share in ashore(study).items()
        if share > MOST
    ]
    return [*_plots(study, study.target), *plots_on_land, *warnings]


def ashore(study: Study) -> dict[float, float]:
    """Return the share of each located plot's box that is land, by its time [s].

    Of several plots at one time it is the largest.
    """
    found = study.target
    assert isinstance(found, Detections)
    located = ~np.isnan(found.bearing) & ~np.isnan(found.range)
    if not study.minds_land or not located.any():
        return {}
    time, far, sensors = (
        found.time[located],
        found.range[located],
        [study.sensors[k] for k in found.sensor[located]],
    )
    reach, share, half = (
        np.array([getattr(one, name) for one in sensors])
        for name in ("reach", "range_share", "bearing_error")
    )
    middles = (np.arange(GRID) + 0.5) / GRID
    near, outer = far * (1 - share), np.minimum(far * (1 + share), reach)
    ranges = (near[:, None] + (outer - near)[:, None] * middles)[:, :, None]
    bearings = (found.bearing[located][:, None] + half[:, None] * (2 * middles - 1))[:, None, :]
    lon, lat = (np.radians(x)[:, None, None] for x in path.degrees(study.tracker.at(time)[0]))
    places = path.vector(
        *sphere.destination(lon, lat, ranges * np.sin(bearings), ranges * np.cos(bearings))
    )
    dry: dict[float, float] = {}
    for when, part in zip(time, _on_land(study, places).mean(axis=(1, 2)), strict=True):
        dry[float(when)] = max(float(part), dry.get(float(when), 0.0))
    return dry


def _inland(study: Study) -> list[str]:
    """Return warnings if the tracker, or an experiment's target, is inland.

    Inland means: no water within INLAND to the north, south, east or west, or between.
    """
    ways = {"tracker": study.tracker}
    if isinstance(study.target, Scene):
        ways["target"] = study.target.way
    warnings = []
    for name, way in ways.items() if study.minds_land else ():
        begin, end = max(way.time[0], 0.0), min(way.time[-1], study.end)
        known = way.time[(way.time >= begin) & (way.time <= end)]
        time = np.unique(np.concatenate([known, np.linspace(begin, max(begin, end), SAMPLE)]))
        lon, lat, polygons = _placed(study, way.at(time)[0])
        high = float(np.degrees(INLAND / sphere.RADIUS))
        wide = high / np.maximum(np.cos(np.radians(lat)), 0.01)
        squares = shapely.STRtree(shapely.box(lon - wide, lat - high, lon + wide, lat + high))
        if (dry := np.sort(squares.query(polygons, predicate="covers")[1])).size:
            warnings.append(
                f"the {name} is on land at {notation.format_dtg(_moment(study, float(time[dry[0]])))}, "
                f"{notation.position(float(lon[dry[0]]), float(lat[dry[0]]))}: check latitudes and longitudes, unless it flies"
            )
    return warnings


def _placed(study: Study, place: Array) -> tuple[Array, Array, Array]:
    """Return (lon, lat) [deg] of unit vectors (..., 3), and the land polygons about them."""
    box = shore.within_reach(study)
    lon, lat = path.degrees(place)
    return (
        sphere.near_degrees(lon, (box.west + box.east) / 2),
        lat,
        coast.read_land("gshhg", box).polygons,
    )


def _on_land(study: Study, place: Array) -> Array:
    """Return whether positions (..., 3) are on land, shape (...)."""
    lon, lat, polygons = _placed(study, place)
    found = np.zeros(lon.shape, bool)
    found.flat[
        shapely.STRtree(shapely.points(lon.ravel(), lat.ravel())).query(
            polygons, predicate="intersects"
        )[1]
    ] = True
    return found


def _moment(study: Study, seconds: float) -> np.datetime64:
    """Return the time of seconds after the start."""
    return np.datetime64(notation.epoch(study.start) + round(seconds), "s")


def _plots(study: Study, seen: Detections) -> list[str]:
    """Return warnings about plots too far apart, duplicated, or by a sensor that was off."""
    fastest, warnings = study.methods[0].behaviour.fastest, []
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
            warnings.append(
                f"the plot of {when} by {study.sensors[number].name} stands {times} times: check for one that is missing"
            )
    for time, speed in zip(*detections.needed(study.sensors, seen, study.tracker), strict=True):
        if speed > fastest * 1.001:
            digits = 0 if speed > fastest + KNOT else 2
            warnings.append(
                f"the plot of {notation.format_dtg(_moment(study, time))} needs {speed / KNOT:,.{digits}f} kn from the one before, "
                f"fastest is {fastest / KNOT:.4g} kn: check both, or take a higher fastest"
            )
    for number, time in zip(seen.sensor, seen.time, strict=True):
        sensor = study.sensors[number]
        # A sensor that is never on is one whose silence does not count.
        if (
            not sensor.hears
            and np.isfinite(sensor.on.begin)
            and not sensor.on.includes(float(time))
        ):
            when = notation.format_dtg(_moment(study, float(time)))
            warnings.append(
                f"{sensor.name} was off when it detected something at {when}: check when it is on"
            )
    return list(dict.fromkeys(warnings))


def _strayed(study: Study) -> list[str]:
    """Return warnings about times at which the tracker's log implies an unusual speed."""
    way = study.tracker
    speed = way.rate * sphere.RADIUS / KNOT
    usual = float(np.median(speed[speed > 1.0])) if (speed > 1.0).sum() > 2 else np.inf
    times = [notation.iso(_moment(study, time)) for time in way.time]
    return [
        f"the tracker would make {speed[k]:,.0f} kn from {times[k]} to {times[k + 1]}, mostly it makes {usual:,.0f} kn: "
        "check its latitudes and longitudes there"
        for k in np.flatnonzero((speed > 2.5 * usual) & (speed > 20.0))
    ]
