"""The [[barrier]] and [[line]] tables: barriers that detect crossings, and reported lines."""

from typing import Annotated

from pydantic import BeforeValidator, Field, model_validator

from drift.case.context import Run, build_each
from drift.case.search.presence import Detection, span
from drift.case.values import fields, units
from drift.evidence.filter.records import Barrier, Line
from geo import gnomonic, notation

MOST_POINTS = 200


class LineTable(fields.Table):
    """A [[line]] table as written: the results report each particle's first crossing."""

    name: fields.Label | None = None
    points: Annotated[list[fields.Position], Field(max_length=MOST_POINTS)]

    @model_validator(mode="after")
    def lines(self) -> "LineTable":
        """Reject a line with one point, without length, or too long."""
        if len(self.points) < 2:
            raise ValueError(
                f"points are {len(self.points)}; a line has at least 2, with great circles between them"
            )
        try:
            gnomonic.build_plane_line(self.points)
        except ValueError as error:
            raise ValueError(f"points: {error}") from None
        return self

    def line(self, name: str, run: Run) -> Line:
        """Return the record of the line."""
        return Line(name, tuple(self.points))


class BarrierTable(LineTable):
    """A [[barrier]] table as written."""

    start: fields.Time
    end: fields.Time
    detection: Detection
    reported: fields.Time | None = None
    error: fields.Duration | None = None
    false_alarms: Annotated[float, BeforeValidator(fields.rate)] | None = None

    @model_validator(mode="after")
    def reports(self) -> "BarrierTable":
        """Reject an incomplete report, and keys of a report without one."""
        wrong = []
        if self.reported is None:
            wrong += [
                f"{key} belongs to a report: give reported, or leave it out"
                for key in ("error", "false_alarms")
                if getattr(self, key) is not None
            ]
        elif self.error is None:
            wrong.append(
                'error is missing: the standard deviation of the time reported, like "10 min"'
            )
        fields.refuse(self, wrong)
        return self

    def barrier(self, name: str, run: Run) -> Barrier:
        """Return the record of the barrier; raise ValueError if it does not fit the run."""
        begin, over = span(self.start, self.end, run)
        if self.reported is None:
            return Barrier(name, begin, over, tuple(self.points), self.detection)
        reported = units.resolve(self.reported, run.start)
        if not begin <= reported <= over:
            raise ValueError(
                f"reported {notation.format_dtg(reported)} is outside the time it was manned, {notation.format_dtg(begin)} to "
                f"{notation.format_dtg(over)}"
            )
        error, false = self.error or 0.0, self.false_alarms or 0.0
        return Barrier(
            name, begin, over, tuple(self.points), self.detection, reported, error, false
        )


def build_barriers(tables: list[BarrierTable], run: Run) -> tuple[Barrier, ...]:
    """Return the barriers, ordered by end; raise UserError with all their mistakes."""
    every = build_each(
        [table.barrier for table in tables], [table.name for table in tables], "barrier", run
    )
    return tuple(sorted(every, key=lambda barrier: barrier.end))


def build_lines(tables: list[LineTable], run: Run) -> tuple[Line, ...]:
    """Return the lines in the order of the file; raise UserError for duplicate names."""
    return tuple(
        build_each([table.line for table in tables], [table.name for table in tables], "line", run)
    )
