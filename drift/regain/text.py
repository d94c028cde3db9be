"""A contact that was lost, in words and tables."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from typing import Any

import numpy as np

from drift.output import formats, geojson, markup
from drift.output import gpx as gpx_file
from drift.output.chapter import Stamped
from drift.regain.record import Regained
from drift.tracker import density, detections, path
from drift.tracker.density import Region
from drift.tracker.detections import Detections
from drift.tracker.following import Particles
from drift.tracker.holding import Held
from geo import notation, sphere
from geo.notation import KNOT, NMI

VAGUE = np.radians(90)  # spread of courses from which on none is told: if all are alike it is 104 degrees
FEW = 50.0  # effective particles under which results warn


def moment(found: Regained, seconds: float) -> np.datetime64:
    """Return a time [s after the start] as a date and time, to the second."""
    return np.datetime64(notation.epoch(found.held.study.start) + round(seconds), "s")


def facts(found: Regained) -> dict[str, str]:
    """Return a line for the last detection, each time shown, and for what must be doubted."""
    held = found.held
    seen = held.study.target
    assert isinstance(seen, Detections)
    who = held.study.sensors[int(seen.sensor[-1])].name
    told = {"last detection": f"{notation.group(moment(found, seen.time[-1]))} by {who}; {len(seen.time)} in all"}
    for time, regions in found.areas:
        when = moment(found, time)
        minute = notation.group(when)
        told[notation.iso(when) if minute in told else minute] = _state(found, time, regions)
    if found.chased is not None:
        told["path"] = _path(found)
    if held.lost:
        times = ", ".join(notation.group(moment(found, time)) for time in held.lost)
        told["lost"] = f"no particle is left by {times}: sweeps that found nothing rule out where it could be. " \
            "Check positions and reaches and when sensors are on, or take a higher fastest speed, or more particles"  # fmt: skip
    warnings = _warnings(found)
    return {**told, "warning": "; ".join(warnings)} if warnings else told


def _warnings(found: Regained) -> list[str]:
    """Return what must be doubted: plots that no target made, few particles, ways of following that are left out."""
    held, study = found.held, found.held.study
    seen, law = study.target, study.methods[0]
    assert isinstance(seen, Detections)
    told = []
    for time, speed in zip(*detections.needed(study.sensors, seen, study.tracker), strict=True):
        if speed > law.behaviour.fastest * 1.001:
            when = notation.group(moment(found, time))
            told.append(
                f"the plot of {when} needs {speed / KNOT:,.0f} kn from the one before, fastest is {law.behaviour.fastest / KNOT:.3g} kn: "
                "check its bearing and range"
            )
    for k, number in enumerate(seen.sensor):
        sensor = study.sensors[number]
        # One that is never on is one whose silence is not to count.
        if not sensor.hears and np.isfinite(sensor.on.begin) and not sensor.on.includes(float(seen.time[k])):
            told.append(
                f"{sensor.name} was off when it detected something at {notation.group(moment(found, seen.time[k]))}: check when it is on"
            )
    few = [
        f"{count:.0f} at {notation.group(moment(found, time))}"
        for time, cloud in held.clouds if cloud is not None and (count := density.effective(cloud.place, cloud.weight)) < FEW
    ]  # fmt: skip
    if few:
        told.append(f"few particles count, {', '.join(few)}: take more particles")
    if len(study.methods) > 1:
        told.append(f'followed by "{law.name}" alone, the first of {len(study.methods)} ways')
    nothing = held.time[held.detected & np.isnan(held.place[:, 0])]
    if nothing.size:
        times = ", ".join(dict.fromkeys(notation.group(moment(found, float(time))) for time in nothing))
        told.append(f"no water in the box of what was detected at {times}: check position, bearing and range")
    if not held.clouds[-1][1]:
        told.append("no track is held at the end")
    return told


def _state(found: Regained, time: float, regions: Mapping[float, Region]) -> str:
    held = found.held
    k = int(np.flatnonzero((held.time == time) & ~held.detected)[-1])
    cloud = dict(held.clouds)[time]
    if not regions or cloud is None:
        return "no track is held"
    lon, lat = path.degrees(held.place[k])
    course = round(float(np.degrees(held.course[k]))) % 360
    off, slower = _spread(cloud, held.course[k])
    told = f"course {course:03d} +- {np.degrees(off):.0f}" if off < VAGUE else "any course"
    return f"{notation.position(float(lon), float(lat))}, {told}, {held.speed[k] / KNOT:.0f} +- {slower / KNOT:.0f} kn; {sizes(regions)}"


def _spread(cloud: Particles, course: float) -> tuple[float, float]:
    """Return the root mean square of what courses differ from one [rad], and the standard deviation of speeds [m/s]."""
    off = sphere.wrap(path.course(cloud.place, cloud.velocity) - course)
    speed = np.linalg.norm(cloud.velocity, axis=1) * sphere.RADIUS
    mean = np.average(speed, weights=cloud.weight)
    one, two = (float(np.sqrt(np.average(v**2, weights=cloud.weight))) for v in (off, speed - mean))
    return one, two


def _once(held: Held) -> list[tuple[int, bool]]:
    """Return the last row of each time, and whether anything was detected then."""
    last = np.append(np.diff(held.time) > 0, True)
    groups = np.split(held.detected, np.flatnonzero(last)[:-1] + 1)
    return [(int(k), bool(some.any())) for k, some in zip(np.flatnonzero(last), groups, strict=True)]


def _path(found: Regained) -> str:
    """Return what a path comes to."""
    chase, chased = found.held.study.pursuit, found.chased
    assert chase is not None
    assert chased is not None
    until = notation.group(moment(found, chased.found.path.time[-1]))
    anew = [notation.group(moment(found, chase.times[step])) for step in chased.found.plans[1:]]
    words = f"{_share(chased.judged[-1])} of another cloud within {chase.reach / NMI:g} nmi by {until}, of the one it was planned on {_share(chased.found.met[-1])}"
    return words + (f"; planned anew at {', '.join(anew)}" if anew else "")


def _share(share: float) -> str:
    return f"{100 * share:.2g} %" if share < 0.1 else f"{100 * share:.0f} %"


def path_table(found: Regained) -> str:
    """Return the path as CSV, a line for each look; shares met are of the cloud and of another one."""
    chase, chased = found.held.study.pursuit, found.chased
    assert chase is not None
    assert chased is not None
    way = chased.found.path
    lon, lat = path.degrees(way.place)
    course = np.degrees(path.course(way.place[:-1], way.way)) % 360
    speed = way.rate * sphere.RADIUS / KNOT
    header = ["time", "lat", "lon", "course_deg", "speed_kn", "met_percent", "met_of_another_percent", "planned"]
    rows: list[list[Any]] = []
    for k, time in enumerate(way.time):
        last = k == len(speed)
        rows.append([
            notation.iso(moment(found, time)), f"{lat[k]:.4f}", f"{lon[k]:.4f}",
            "" if last or speed[k] < 0.05 else f"{round(float(course[k])) % 360:03d}", "" if last else f"{speed[k]:.1f}",
            *(f"{100 * share[min(k, len(share) - 1)]:.1f}" for share in (chased.found.met, chased.judged)),
            "yes" if k in chased.found.plans else "no",
        ])  # fmt: skip
    return formats.csv_text(header, rows)


def path_gpx(found: Regained, run: str) -> str:
    """Return the path as a GPX route with a point for each look."""
    chased = found.chased
    assert chased is not None
    root = gpx_file.document(found.held.study.title, f"Path through the cloud; run {run}")
    way = ET.SubElement(root, "rte")
    markup.leaf(way, "name", "pursuit")
    lon, lat = path.degrees(chased.found.path.place)
    for k, time in enumerate(chased.found.path.time):
        when = moment(found, time)
        gpx_file.point(way, "rtept", float(lon[k]), float(lat[k]), time=when, name=notation.group(when))
    return markup.text(root)


def sizes(regions: Mapping[float, Region]) -> str:
    """Return how large the areas are."""
    each = (f"{notation.percent(share)} % {_rounded(region.area / NMI**2)} nmi2" for share, region in regions.items())
    return ", ".join(each)


def _rounded(value: float) -> str:
    """Return an area to two digits: more than that a cloud does not know."""
    return f"{float(f'{value:.2g}'):,.10g}"


def table(found: Regained) -> str:
    """Return the track as CSV."""
    held = found.held
    header = ["time", "detection", "lat", "lon", "course_deg", "speed_kn", "particles"]
    lon, lat = path.degrees(held.place)
    rows: list[list[Any]] = []
    for k, detected in _once(held):
        known = np.isfinite(lat[k])
        numbers = [lat[k], lon[k], np.degrees(held.course[k]) % 360, held.speed[k] / KNOT]
        rows.append([
            notation.iso(moment(found, held.time[k])), "yes" if detected else "no",
            *(f"{v:.{d}f}" if known else "" for v, d in zip(numbers, (4, 4, 1, 1), strict=True)),
            int(held.count[k]) if known else 0,
        ])  # fmt: skip
    return formats.csv_text(header, rows)


def gpx(found: Regained, run: str) -> str:
    """Return the estimate as a GPX track, in a segment for each time that it was held, and the estimates shown as waypoints."""
    held = found.held
    root = gpx_file.document(held.study.title, f"Estimated track; run {run}")
    lon, lat = path.degrees(held.place)
    rows = np.array([k for k, _ in _once(held)])
    known = np.isfinite(lat)
    for time, _ in found.areas:
        k = int(np.flatnonzero(held.time == time)[-1])
        if known[k]:
            name = notation.group(moment(found, time))
            gpx_file.point(root, "wpt", float(lon[k]), float(lat[k]), time=moment(found, time), name=name)
    track = ET.SubElement(root, "trk")
    markup.leaf(track, "name", "estimated track")
    edges = np.flatnonzero(np.diff(known[rows].astype(int))) + 1
    for some in np.split(rows, edges):
        if known[some[0]]:
            segment = ET.SubElement(track, "trkseg")
            for k in some:
                when = moment(found, held.time[k])
                gpx_file.point(segment, "trkpt", float(lon[k]), float(lat[k]), time=when)
    return markup.text(root)


def areas(found: Regained, attributes: Stamped) -> dict[str, Any]:
    """Return the areas at the times shown as GeoJSON, cut at the antimeridian."""
    features = [
        geojson.feature(
            geojson.polygons(region.outline),
            {
                "time": notation.iso(moment(found, time)),
                "probability": share,
                "area_km2": float(f"{region.area / 1e6:.4g}"),
            },
        )
        for time, regions in found.areas
        for share, region in regions.items()
    ]
    return geojson.collection(features, attributes)


def numbers(found: Regained) -> dict[str, Any]:
    """Return the track at the times shown, for programs."""
    held = found.held
    lon, lat = path.degrees(held.place)
    told = []
    for time, regions in found.areas:
        k = int(np.flatnonzero((held.time == time) & ~held.detected)[-1])
        cloud = dict(held.clouds)[time]
        off, slower = (np.nan, np.nan) if cloud is None else _spread(cloud, held.course[k])
        state = {
            "lat": float(lat[k]), "lon": float(lon[k]), "course_deg": float(np.degrees(held.course[k]) % 360),
            "speed_kn": float(held.speed[k] / KNOT), "particles": int(held.count[k]),
            "course_spread_deg": float(np.degrees(off)), "speed_std_kn": slower / KNOT,
            "area_nmi2": {notation.percent(share): region.area / NMI**2 for share, region in regions.items()},
        } if regions else {}  # fmt: skip
        told.append({"time": notation.iso(moment(found, time)), "held": bool(regions), **state})
    summary = {"title": held.study.title, "shown": told, "lost": [notation.iso(moment(found, t)) for t in held.lost]}
    if found.chased is None:
        return summary
    met = {"met": found.chased.found.met[-1], "met_of_another": found.chased.judged[-1]}
    return {**summary, "path": {**met, "plans": len(found.chased.found.plans)}}
