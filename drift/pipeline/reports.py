"""Compare winds and currents that were reported on scene with the forcing of a run."""

from collections.abc import Sequence

import numpy as np

from drift.case.record import Case
from drift.engine.environment import along_track
from drift.engine.environment.environment import Environment
from drift.engine.motion.errors.buoy_errors import Sight
from drift.engine.motion.errors.buoys import PointReport
from drift.engine.motion.forcing import Forcing
from geo import notation, sphere
from geo.array import Array
from geo.coast import edges
from geo.errors import UserError
from geo.forcing.reading import stream


def places_of_reports(reports: Sequence[PointReport]) -> list[tuple[float, float]]:
    """Return lon, lat [deg] of the places from which reports came, each once."""
    return list(dict.fromkeys((report.lon, report.lat) for report in reports))


def sights_of(
    case: Case,
    where: Environment,
    forcing: Forcing,
    hypotheses: Sequence[tuple[int, int]],
    start: float,
) -> list[Sight]:
    """Return what the reports of a case show beyond the forcing.

    Args:
        case: of the run.
        where: its environment.
        forcing: of the run.
        hypotheses: scenario and member of each.
        start: of the run [s since 1970].

    Raises:
        UserError: a report lies where the forcing has no value, one line for each.
    """
    places, wrong, sights = places_of_reports(case.reports), [], []
    for report in case.reports:
        model = _forcing_there(report, forcing, hypotheses)
        if reason := _why_not_compared(report, where, model):
            wrong.append(f'{case.path.name}: report "{report.name}": {reason}')
            continue
        place = len(case.drifters) + places.index((report.lon, report.lat))
        excess = np.array(report.velocity) - model
        of_wind = report.quantity == "wind"
        sights.append(Sight(place, report.time - start, of_wind, excess, report.error))
    if wrong:
        raise UserError(*wrong)
    return sights


def _forcing_there(
    report: PointReport, forcing: Forcing, hypotheses: Sequence[tuple[int, int]]
) -> Array:
    """Return the wind or current (hypotheses, 2) [m/s] where and when a report was made.

    A scenario whose object feels no wind has that of the first scenario that does, so that a report
    of the wind says nothing for or against it.
    """
    quantity = report.quantity
    tiles = [ranges[quantity] for ranges in forcing.ranges]
    known = [s for s, (first, last) in enumerate(tiles) if last > first]
    lon, lat = (sphere.to_binary(np.array([angle])) for angle in (report.lon, report.lat))
    time = np.array([report.time])
    found = {
        (s, member): along_track.sample_forcing(forcing, s, [quantity], time, lon, lat, member)
        for s, member in hypotheses
        if s in known
    }
    return np.stack(
        [found[s if s in known else known[0], member][quantity][0] for s, member in hypotheses]
    )


def _why_not_compared(report: PointReport, where: Environment, model: Array) -> str:
    """Return why a report cannot be compared with the forcing; "" if it can.

    model: the forcing there, (hypotheses, 2); NaN where it has no value.
    """
    place = notation.position(report.lon, report.lat)
    if report.quantity == "current" and where.coast is not None:
        lon, lat = (sphere.to_binary(np.array([angle])) for angle in (report.lon, report.lat))
        if edges.is_land(where.coast, lon, lat)[0]:
            return f"{place} lies on land, where there is no current; check its position"
    if np.isfinite(model).all():
        return ""
    moment = np.datetime64(int(report.time), "s")
    spans = [
        span
        for source in where.sources
        if source.quantity == report.quantity and source.times.size
        for span in stream.data_spans(source)
    ]
    if spans and not any(begin <= moment <= end for begin, end in spans):
        first, last = min(span[0] for span in spans), max(span[1] for span in spans)
        return (
            f"the {report.quantity} of the case has no value at {notation.format_dtg(moment)}; it lasts from "
            f"{notation.format_dtg(first)} to {notation.format_dtg(last)}; check time, or add a [[{report.quantity}]]"
        )
    return (
        f"the {report.quantity} of the case has no value at {place}; check its position (east is positive), widen [domain], or leave "
        "the report out"
    )
