"""Text of bridges and fitted spread rates: terminal lines, a line for the case, GeoJSON."""

import json
import math
from typing import Any

import numpy as np
import shapely

from drift.products.files import geojson
from drift.tracking.bridges import ellipse
from drift.tracking.bridges.fit import METHODS, Fit
from drift.tracking.bridges.stretches import counted, told
from drift.tracking.bridges.study import Answers, Touch, polygons
from geo import notation
from geo.notation import NMI

Facts = dict[str, str]

UNIT = NMI / math.sqrt(3600)  # [m/sqrt(s)] one nmi/sqrt(h)
CERTAIN = 1e-4  # standard error of integration above which it is shown


def spread_rate(value: float) -> str:
    """Return a spread rate [m/sqrt(s)] as in a case file: 3.6 nmi/sqrt(h)."""
    return f"{value / UNIT:.3g} nmi/sqrt(h)"


def _moment(seconds: float) -> str:
    """Return the date-time group of a time [s since 1970]."""
    return notation.format_dtg(np.datetime64(round(seconds), "s"))


def answers(found: Answers) -> Facts:
    """Return the bridge's positions, areas and line crossings as labelled lines."""
    study, place = found.study, found.position
    long, short, direction = ellipse.axes(place.covariance)
    hours = (study.bridge.time[-1] - study.bridge.time[0]) / 3600
    facts = {
        "bridge": f"{len(study.names)} way points in {hours:g} h, K = {spread_rate(study.bridge.spread_rate)}"
    }
    for k, time in enumerate(place.time):
        sizes = ", ".join(
            f"{notation.hundredths(share)} % in {area:,.0f} nmi2"
            for share, area in zip(study.shares, found.areas[k], strict=True)
        )
        name = f"{_moment(time)}, +{(time - study.bridge.time[0]) / 3600:g} h"
        facts[name] = (
            f"{notation.position(np.degrees(place.lon[k]), np.degrees(place.lat[k]))}, standard deviation {long[k] / NMI:.1f} nmi along "
            f"{np.degrees(direction[k]):03.0f}, {short[k] / NMI:.1f} nmi across; {sizes}"
        )
    facts |= {f'line "{touch.line.name}"': _touch(found, touch) for touch in found.touches}
    return facts | {f"note {k}": note for k, note in enumerate(found.notes, 1)}


def summary_of_bridge(found: Answers) -> dict[str, Any]:
    """Return the same as JSON data: positions in degrees, the rest in SI units."""
    study, place = found.study, found.position
    long, short, direction = ellipse.axes(place.covariance)
    return {
        "spread_rate_m_per_sqrt_s": study.bridge.spread_rate,
        "positions": [
            {
                "time": np.datetime64(round(time), "s"),
                "lon_deg": np.degrees(place.lon[k]),
                "lat_deg": np.degrees(place.lat[k]),
                "std_major_m": long[k],
                "std_minor_m": short[k],
                "orientation_deg": np.degrees(direction[k]),
                "area_m2": {
                    f"{notation.hundredths(share)}%": area * NMI**2
                    for share, area in zip(study.shares, found.areas[k], strict=True)
                },
            }
            for k, time in enumerate(place.time)
        ],
        "lines": [
            {
                "name": touch.line.name,
                "probability": touch.chance.value,
                "by": {
                    f"{notation.hundredths(share)}%": np.datetime64(round(time), "s")
                    for share, time in zip(study.percentiles, touch.percentiles, strict=True)
                }
                if touch.chance.value > 0
                else {},
            }
            for touch in found.touches
        ],
    }


def _touch(found: Answers, touch: Touch) -> str:
    """Return the crossing of a line as text."""
    error = f" ± {touch.chance.error:.1g}" if touch.chance.error > CERTAIN else ""
    words = f"touched with probability {touch.chance.value:.4g}{error}"
    if not touch.chance.value > 0:
        return words
    times = ", ".join(
        f"{notation.hundredths(share)} % by {_moment(time)} (+{(time - found.study.bridge.time[0]) / 3600:.2f} h)"
        for share, time in zip(found.study.percentiles, touch.percentiles, strict=True)
    )
    return f"{words}; if so, first {times}"


def features(found: Answers) -> str:
    """Return the areas at each time, and the mean positions, as GeoJSON (RFC 7946)."""
    study, place = found.study, found.position
    features: list[Any] = []
    for k, (time, outlines) in enumerate(zip(place.time, polygons(found), strict=True)):
        when = notation.iso(np.datetime64(round(float(time)), "s"))
        mean = geojson.point(float(np.degrees(place.lon[k])), float(np.degrees(place.lat[k])))
        features.append(geojson.feature(mean, {"kind": "mean", "time": when}))
        for share, area, outline in zip(study.shares, found.areas[k], outlines, strict=True):
            shape = geojson.polygons(shapely.MultiPolygon([shapely.Polygon(outline)]))
            properties = {
                "kind": "area",
                "time": when,
                "probability": share,
                "area_nmi2": round(float(area), 3),
            }
            features.append(geojson.feature(shape, properties))
    attributes = {"title": study.title, "spread_rate": spread_rate(study.bridge.spread_rate)}
    return json.dumps(geojson.collection(features, attributes), indent=1) + "\n"


def fitted(fit: Fit) -> Facts:
    """Return a fit as labelled lines: the spread rate, its uncertainty and its checks."""
    facts = {
        "spread rate K": f"{fit.spread_rate / UNIT:.3g} ± {fit.spread_error / UNIT:.2g} nmi/sqrt(h) ({fit.spread_rate:.4g} m/sqrt(s))",
        "likelihood": METHODS[fit.method].words,
        "tracks": f"{fit.tracks}, {counted(fit.count, 'comparison')} in {counted(fit.stretches, 'stretch', 'stretches')}; {told(fit.rules)}; {fit.hours:.2g} h from fix to fix (median)",
        "standard error": f"{fit.curvature / UNIT:.2g} by the curvature of the likelihood, "
        + (
            f"{fit.clustered / UNIT:.2g} clustered by track; the larger counts"
            if fit.clustered == fit.clustered
            else "tracks are too few to cluster by"
        ),
        "errors of the fixes": f"{fit.error:.3g} m in each component"
        + (f" ± {fit.error_error:.2g}, fitted" if fit.error_error == fit.error_error else ""),
    }
    if fit.held is not None:
        halves = " and ".join(
            f"{half.spread_rate / UNIT:.3g} ± {half.spread_error / UNIT:.2g} ({counted(half.tracks, 'track')}, {counted(half.count, 'comparison')})"
            for half in fit.held.halves
        )
        facts["held out"] = (
            f"K of every other track in order of their first fixes, and of the rest: {halves}"
        )
        for coverage in fit.held.coverage:
            both = coverage.both
            rough = ", few tracks or days: rough" if both.few else ""
            facts[f"held out, {100 * coverage.share:.0f} % area"] = (
                f"held {100 * both.mean:.0f} % ± {100 * both.error:.0f} of {both.count} fixes between two others{rough} "
                f"({100 * coverage.first.mean:.0f} % of {coverage.first.count} by the first K, {100 * coverage.second.mean:.0f} % of "
                f"{coverage.second.count} by the second)"
            )
    return facts | {f"note {k}": note for k, note in enumerate(fit.notes, 1)}


def toml(fit: Fit) -> str:
    """Return the fitted spread rate as a line for a case."""
    interval = f", {fit.hours:.2g} h from fix to fix" if fit.method == "neighbours" else ""
    return f'k = "{spread_rate(fit.spread_rate)}"  # ± {fit.spread_error / UNIT:.2g}, fitted to {counted(fit.tracks, "track")}{interval}'
