"""What winds and currents that were reported on scene showed, and how much they changed."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from drift.case.record import Case
from drift.engine.environment.environment import Environment
from drift.engine.motion.errors.buoys import Buoys, PointReport
from drift.pipeline import buoy_effect
from drift.products.files.chapter import OutputBundle
from drift.products.maps.marks import Mark
from drift.products.report import leaves
from geo import notation
from geo.array import Array
from geo.notation import KNOT

ODD = 0.01  # chance of a residual as large, below which a report is odd


def summary_of_reports(case: Case, where: Environment, buoys: Buoys) -> dict[str, Any]:
    """Return what each report showed and changed, and the containment areas with and without them.

    Args:
        case: of the run.
        where: its environment.
        buoys: its conditioned errors.

    Returns:
        For summary.json: `reports`, a table for each, `warnings` about odd ones, and
        `buoy_effect.areas_without`.
    """
    covariances = _covariances(buoys)
    shown = [_shown_by(case, buoys, number, covariances) for number in range(len(case.reports))]
    shown = [own | {"text": _in_words(own)} for own in shown]
    odd = [
        f'report "{own["name"]}" is odd: {_residual(own)}; '
        f"so large a residual has a chance of {notation.percent(own['chance'], 2)}; check its direction, unit, position and time"
        for own in shown
        if own["chance"] < ODD
    ]
    found = {"reports": shown, "warnings": odd}
    return found | buoy_effect.areas_without(case, where, "reports", shown)


def _shown_by(
    case: Case, buoys: Buoys, number: int, covariances: Sequence[Array]
) -> dict[str, Any]:
    """Return the residual of a report, and the errors at its place with and without all reports.

    The errors are those at the time of the report, or at the nearest of the run. They, and the
    residual, are of the forcing that is likeliest.
    """
    report, sight = case.reports[number], buoys.sights[number]
    error = case.wind_error if sight.of_wind else case.current_error
    likeliest = int(np.argmax(buoys.given.log_likelihood))
    excess = sight.excess[likeliest]
    step = int(np.argmin(np.abs(buoys.edges - sight.time)))
    parts = buoys.parts(sight.place, sight.of_wind)
    correction = parts @ buoys.given.means[step, likeliest]
    expected = np.sqrt(error.std**2 + error.bias**2 + report.error**2)
    return {
        "name": report.name,
        "quantity": report.quantity,
        "time": str(np.datetime64(int(report.time), "s")),
        **_polar("residual", excess),
        "expected_residual_m_s": float(expected),
        "chance": float(np.exp(-0.5 * (excess**2).sum() / expected**2)),
        **_polar("correction", correction),
        "error_before_m_s": float(np.hypot(error.std, error.bias)),
        "error_left_m_s": float(np.sqrt(parts @ covariances[step] @ parts)),
    }


def _polar(name: str, velocity: Array) -> dict[str, float]:
    """Return speed and direction of a velocity (east, north) [m/s]."""
    toward = float(np.degrees(np.arctan2(*velocity)) % 360)
    return {f"{name}_m_s": float(np.hypot(*velocity)), f"{name}_toward_deg": toward}


def _covariances(buoys: Buoys) -> list[Array]:
    """Return the covariance of the states at the begin of each step and at the last one's end."""
    given = buoys.given
    found = [given.first @ given.first.T]
    for move, kick in zip(given.moves, given.kicks, strict=True):
        found.append(move @ found[-1] @ move.T + kick @ kick.T)
    return found


def _in_words(own: Mapping[str, Any]) -> str:
    """Return what one report showed and changed in one line; own: its table in summary.json."""
    return (
        f"{_residual(own)}; corrected by {_velocity(own, 'correction')}, whose error is {own['error_left_m_s'] / KNOT:.2f} kn a component "
        f"in place of {own['error_before_m_s'] / KNOT:.2f}"
    )


def _residual(own: Mapping[str, Any]) -> str:
    """Return the residual of a report in words."""
    return (
        f"the {own['quantity']} at {notation.format_dtg(own['time'])} differed from that of the case by {_velocity(own, 'residual')} "
        f"(expected: {own['expected_residual_m_s'] / KNOT:.2f} kn a component)"
    )


def _velocity(own: Mapping[str, Any], name: str) -> str:
    """Return a velocity of a report's table in words."""
    toward = notation.bearing(round(own[f"{name}_toward_deg"]))
    return f"{own[f'{name}_m_s'] / KNOT:.2f} kn toward {toward}"


def reports_bundle(found: Mapping[str, Any], reports: Sequence[PointReport]) -> OutputBundle:
    """Return the report's layer and table of what was reported; found: of `summary_of_reports`."""
    return OutputBundle(leaves=(partial(_leaves, found, reports),))


def _leaves(found: Mapping[str, Any], reports: Sequence[PointReport]) -> list[Any]:
    """Return a layer of the reports' places, and a table of what each showed and changed."""
    areas = found.get("area_nmi2", {})
    rows = [
        [
            own["name"],
            own["quantity"],
            notation.format_dtg(own["time"]),
            _velocity(own, "residual"),
            f"{own['expected_residual_m_s'] / KNOT:.2f}",
            _velocity(own, "correction"),
            f"{own['error_left_m_s'] / KNOT:.2f} of {own['error_before_m_s'] / KNOT:.2f}",
            buoy_effect.listed_areas(own.get("area_nmi2_without_it", areas.get("without", {}))),
            buoy_effect.shift_in_words(own if "shift_nmi" in own else found),
        ]
        for own in found["reports"]
    ]
    columns = [
        ("name", "Report", "words"),
        ("quantity", "Of", "words"),
        ("time", "Time", "words"),
        ("residual", "Less that of the case", "words"),
        ("expected", "Expected a component [kn]", "words"),
        ("correction", "Correction there", "words"),
        ("error", "Error left [kn]", "words"),
        ("without", "Areas without it [nmi2]", "words"),
        ("shift", "Moved the mean by", "words"),
    ]
    note = "The correction and the error left are those by all reports and buoys together."
    if areas:
        note += f" Areas with all reports, before any search: {buoy_effect.listed_areas(areas['with'])} nmi2."
    marks = [Mark(report.lon, report.lat, report.name) for report in reports]
    return [
        leaves.marks_leaf("Reports on scene", marks, [], "report"),
        leaves.table_leaf("Reports on scene", columns, rows=rows, note=note, unfolded=True),
    ]
