"""The [[report]] table: a wind or current reported on scene, which corrects the case's near it."""

from collections.abc import Mapping, Sequence

import numpy as np
from pydantic import model_validator

from drift.case.context import Run, build_each
from drift.case.forcing.sources import Vector
from drift.case.search import drifter
from drift.case.values import fields, units
from drift.engine.motion.errors.buoys import PointReport
from drift.engine.motion.errors.forcing_error import ForcingError
from drift.engine.motion.scenario import Scenario
from geo import notation, sphere
from geo.errors import UserError
from geo.forcing.quantity import QUANTITIES
from geo.notation import KNOT

LEAST = 0.01  # [m/s] smallest error of a report
LARGEST = {"wind": 20.0, "current": 2.5}  # [m/s] largest, as of the forcing
OLDEST = 5  # decorrelation times from the run to a report; a longer time is a mistake


class ReportTable(fields.Table):
    """A [[report]] table as written."""

    name: fields.Label | None = None
    """Name in messages and results, such as that of the ship; by default "report 1" and so on."""
    wind: Vector | None = None
    """The wind, 10 m above the sea, by speed and direction (`from`) or by components."""
    current: Vector | None = None
    """The current at the depth of the object, by speed and direction (`toward`) or by components;
    give either this or `wind`."""
    at: fields.Position
    """Where it was measured."""
    time: fields.Time
    """When it was measured."""
    error: fields.Speed
    """Standard deviation of each component of the report."""

    @model_validator(mode="after")
    def whole(self) -> "ReportTable":
        """Reject no wind or current or both, an impossible speed, and an impossible error."""
        quantity = fields.one_of(self, ("wind", "current"))
        speed, ceiling = float(np.hypot(*self.velocity())), QUANTITIES[quantity].fastest
        wrong = []
        if speed > ceiling:
            wrong.append(
                f"{quantity}: {speed:.4g} m/s is too fast for a {quantity}; at most {ceiling:g} m/s ({ceiling / KNOT:.3g} kn)"
            )
        if not LEAST <= self.error <= LARGEST[quantity]:
            wrong.append(
                f"error: {self.error:g} m/s of a {quantity} must be {LEAST:g} to {LARGEST[quantity]:g} m/s"
            )
        fields.refuse(self, wrong)
        return self

    def velocity(self) -> tuple[float, float]:
        """Return the components (east, north) [m/s]."""
        given = self.wind or self.current
        assert given is not None  # whole
        return given.components()

    def report(self, name: str, run: Run) -> PointReport:
        """Return the record of the report."""
        quantity = "current" if self.wind is None else "wind"
        time = float(notation.epoch(units.resolve(self.time, run.start)))
        return PointReport(name, quantity, time, *self.at, self.velocity(), self.error)


def build_reports(
    tables: Sequence[ReportTable], drifters: int, run: Run
) -> tuple[PointReport, ...]:
    """Return the reports of a case.

    Args:
        tables: of the case.
        drifters: number of its drifting buoys, the errors at which are known too.
        run: its times and folder.

    Raises:
        UserError: two have one name, or they come from too many places.
    """
    reports = build_each(
        [table.report for table in tables], [table.name for table in tables], "report", run
    )
    places = len({(report.lon, report.lat) for report in reports})
    if places + drifters > drifter.MOST:
        raise UserError(
            f"[[report]]: they come from {places} places, and there are {drifters} drifters; at most {drifter.MOST} in all: leave out the "
            "oldest and the farthest, or give several of one ship the same position"
        )
    return tuple(reports)


def check_reports(
    reports: Sequence[PointReport], run: Run, errors: Mapping[str, ForcingError]
) -> None:
    """Reject reports that correct nothing: no error, no object that feels it, too far, too old.

    Args:
        reports: of the case.
        run: its times and scenarios.
        errors: of the case's wind and current.

    Raises:
        UserError: one line for each such report.
    """
    felt = any(scenario.uses_wind for scenario in run.scenarios)
    wrong = []
    for report in reports:
        place, error = f'report "{report.name}"', errors[report.quantity]
        if report.quantity == "wind" and not felt:
            wrong.append(f"{place}: nothing of the case drifts with the wind; leave it out")
        elif error.std == error.bias == 0:
            wrong.append(
                f"{place}: the {report.quantity} has no error that a report could correct ({error.by[0]}); give "
                f"uncertainty.{report.quantity}.std, or leave the report out"
            )
        else:
            wrong += [f"{place}: {reason}" for reason in _why_useless(report, run, error)]
    if wrong:
        raise UserError(*wrong)


def _why_useless(report: PointReport, run: Run, error: ForcingError) -> list[str]:
    """Return why a report is too far off, in space or time, to be of use; [] if it is of use."""
    found = []
    farthest = drifter.FARTHEST * error.length
    nearest = _nearest(report, run.scenarios)
    if nearest > farthest:
        found.append(
            f"at is {nearest / 1000:,.0f} km from the nearest reported position at least; the errors of the {report.quantity} are "
            f"correlated over {error.length / 1000:.3g} km, so at most {farthest / 1000:.3g} km are of use; check it (east is "
            f"positive), leave the report out, or give uncertainty.{report.quantity}.length"
        )
    first, last = (notation.epoch(time) for time in (run.start, run.end))
    apart = max(first - report.time, report.time - last)
    if apart > OLDEST * error.time:
        moment = notation.format_dtg(np.datetime64(int(report.time), "s"))
        found.append(
            f"time {moment} is {apart / 3600:,.0f} h outside the run; the errors of the {report.quantity} are correlated over "
            f"{error.time / 3600:.3g} h, so at most {OLDEST * error.time / 3600:.3g} h are of use; check it, or leave the report out"
        )
    return found


def _nearest(report: PointReport, scenarios: Sequence[Scenario]) -> float:
    """Return the least distance [m] of a report from where the objects of a case may begin."""
    x, y = np.radians(report.lon), np.radians(report.lat)
    places = [extent for scenario in scenarios for extent in scenario.extents(3.0)]
    return min(float(sphere.distance(x, y, lon, lat).min()) - reach for lon, lat, reach in places)
