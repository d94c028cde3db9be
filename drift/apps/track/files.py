"""Files of `drift track`: CSV tables, GPX, GeoJSON, and a summary for programs."""

import xml.etree.ElementTree as ET
from typing import Any

import numpy as np

from drift.apps.track import text
from drift.apps.track.record import Chased, Failed, Regained
from drift.products.files import formats, geojson, markup
from drift.products.files import gpx as gpx_file
from drift.products.files.chapter import Stamped
from drift.tracking.tracker import holding, path
from drift.tracking.tracker.holding import Shown
from geo import notation, sphere
from geo.notation import KNOT, NMI


def _percent(share: float) -> str:
    return "" if np.isnan(share) else f"{100 * share:.1f}"


def path_table(found: Regained) -> str:
    """Return the path as CSV, a row per look.

    Columns have the shares of its own and of a check cloud that were within reach by then.
    """
    chased = found.chased
    assert isinstance(chased, Chased)
    path_found = chased.found.path
    lon, lat = path.degrees(path_found.place)
    course = np.degrees(path.course(path_found.place[:-1], path_found.way)) % 360
    speed = path_found.rate * sphere.RADIUS / KNOT
    rows: list[dict[str, Any]] = []
    for k, time in enumerate(path_found.time):
        last = k == len(speed)
        met, judged = (share[min(k, len(share) - 1)] for share in (chased.found.met, chased.judged))
        rows.append(
            {
                "time": text.moment(found, time),
                "lat": f"{lat[k]:.4f}",
                "lon": f"{lon[k]:.4f}",
                "course_deg": ""
                if last or speed[k] < 0.05
                else f"{round(float(course[k])) % 360:03d}",
                "speed_kn": "" if last else f"{speed[k]:.1f}",
                "within_reach_percent": _percent(met),
                "of_another_cloud_percent": _percent(judged),
                "planned": k in chased.found.plans,
            }
        )
    return formats.csv_rows(rows)


def path_gpx(found: Regained, run: str) -> str:
    """Return the path as a GPX route with a point for each look."""
    chased = found.chased
    assert isinstance(chased, Chased)
    root = gpx_file.document(found.held.study.title, f"Path through the cloud; run {run}")
    way = ET.SubElement(root, "rte")
    markup.leaf(way, "name", "pursuit")
    lon, lat = path.degrees(chased.found.path.place)
    for k, time in enumerate(chased.found.path.time):
        when = text.moment(found, time)
        gpx_file.point(
            way, "rtept", float(lon[k]), float(lat[k]), time=when, name=notation.format_dtg(when)
        )
    return markup.document_text(root)


def track_csv(found: Regained) -> str:
    """Return the estimated track as CSV, a row per detection and time shown."""
    held = found.held
    lon, lat = path.degrees(held.place)
    carried = path.degrees(held.carried)
    rows: list[dict[str, Any]] = []
    for k, regions in enumerate(held.areas):
        numbers = {
            "lat": f"{lat[k]:.4f}",
            "lon": f"{lon[k]:.4f}",
            "course_deg": f"{np.degrees(held.course[k]) % 360:.1f}",
            "course_spread_deg": f"{np.degrees(held.off[k]):.1f}",
            "speed_kn": f"{held.speed[k] / KNOT:.1f}",
            "speed_std_kn": f"{held.slower[k] / KNOT:.1f}",
        }
        inside = "none" if np.isnan(held.within[k]) else notation.hundredths(held.within[k])
        rows.append(
            {
                "time": text.moment(found, held.time[k]),
                "detection": bool(held.detected[k]),
                "left_percent": _percent(held.left[k] if held.detected[k] else np.nan),
                **(numbers if regions else dict.fromkeys(numbers, "")),
                "particles": int(held.count[k]) if regions else 0,
                "within_percent": inside if regions else "",
                **{
                    f"area_{notation.hundredths(share)}_nmi2": f"{regions[share].area / NMI**2:.4g}"
                    if regions
                    else ""
                    for share in holding.SHARES
                },
                **{
                    f"carried_{name}": "" if np.isnan(values[k]) else f"{values[k]:.4f}"
                    for name, values in zip(("lat", "lon"), carried[::-1], strict=True)
                },
            }
        )
    return formats.csv_rows(rows)


def gpx(found: Regained, run: str) -> str:
    """Return the estimated track as GPX, with waypoints at the times shown.

    A segment covers a time in which the estimate was inside its areas: the mean of a ring-shaped
    cloud is not a position to steer for.
    """
    held = found.held
    root = gpx_file.document(held.study.title, f"Estimated track; run {run}")
    lon, lat = path.degrees(held.place)
    inside = np.isfinite(held.within)
    for one in held.shown:
        k = held.row(one.time)
        if inside[k]:
            when = text.moment(found, one.time)
            gpx_file.point(
                root, "wpt", float(lon[k]), float(lat[k]), time=when, name=notation.format_dtg(when)
            )
    track = ET.SubElement(root, "trk")
    markup.leaf(track, "name", "estimated track")
    for some in np.split(np.arange(len(inside)), np.flatnonzero(np.diff(inside)) + 1):
        if inside[some[0]]:
            times = [text.moment(found, held.time[k]) for k in some]
            gpx_file.segments(track, lon[some].tolist(), lat[some].tolist(), times)
    return markup.document_text(root)


def areas(found: Regained, attributes: Stamped) -> dict[str, Any]:
    """Return the areas at the times shown as GeoJSON, split at the antimeridian."""
    features = []
    for one in found.held.shown:
        when = text.moment(found, one.time)
        for share, region in found.held.areas[found.held.row(one.time)].items():
            properties = {
                "name": f"{notation.hundredths(share)} % area {notation.format_dtg(when)}",
                "time": notation.iso(when),
                "probability": share,
                "area_nmi2": float(f"{region.area / NMI**2:.4g}"),
                "area_km2": float(f"{region.area / 1e6:.4g}"),
            }
            features.append(geojson.feature(geojson.polygons(region.outline), properties))
    return geojson.collection(features, attributes)


def summary_of_track(found: Regained) -> dict[str, Any]:
    """Return the track at the times shown, its losses and the path, for programs."""
    held = found.held
    shown = [_estimate_at(found, one) for one in held.shown]
    lost = [
        {
            "time": notation.iso(text.moment(found, loss.time)),
            "sensors": [sensor.name for sensor in loss.sensors],
        }
        for loss in held.lost
    ]
    repopulated = [
        {"time": notation.iso(text.moment(found, float(time))), "left": float(left)}
        for time, left in zip(held.time[held.anew], held.left[held.anew], strict=True)
    ]
    return {
        "title": held.study.title,
        "shown": shown,
        "lost": lost,
        "drawn_anew": repopulated,
        **_path_numbers(found.chased),
    }


def _estimate_at(found: Regained, one: Shown) -> dict[str, Any]:
    held, cloud, k = found.held, one.cloud, found.held.row(one.time)
    carried = path.degrees(held.carried[k])
    numbers = {
        "time": notation.iso(text.moment(found, one.time)),
        "held": cloud is not None,
        "others_holding": one.holding,
        "carried": {"lon": float(carried[0]), "lat": float(carried[1])},
    }
    if cloud is None:
        return numbers
    lon, lat = path.degrees(held.place[k])
    return {
        **numbers,
        "lat": float(lat),
        "lon": float(lon),
        "within": float(held.within[k]),
        "course_deg": float(np.degrees(held.course[k]) % 360),
        "speed_kn": float(held.speed[k] / KNOT),
        "particles": int(held.count[k]),
        "course_spread_deg": float(np.degrees(held.off[k])),
        "speed_std_kn": float(held.slower[k] / KNOT),
        "area_nmi2": {
            notation.hundredths(share): region.area / NMI**2
            for share, region in held.areas[k].items()
        },
        "other_clouds_within": {
            notation.hundredths(share): value for share, value in one.within.items()
        },
        "areas_of_clouds_nmi2": {
            notation.hundredths(share): [v / NMI**2 for v in size]
            for share, size in one.sizes.items()
        },
    }


def _path_numbers(chased: Chased | Failed | None) -> dict[str, Any]:
    if chased is None:
        return {}
    if isinstance(chased, Failed):
        return {"path": {"found": False, "why": chased.why}}
    return {
        "path": {
            "found": True,
            "within_reach": chased.found.met[-1],
            "of_another_cloud": chased.judged[-1],
            "could_be_within_reach": chased.found.near,
            "plans": len(chased.found.plans),
        }
    }
