"""Read the input file of `drift bridge`: way points, spread rate, lines and outputs, as TOML.

The file is not a case: it has no forcing and no particles. Values are written as in cases. All
mistakes are reported at once, one per line.
"""

import os
import tomllib
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, ValidationError, model_validator

from drift.case.values import fields, messages, mistakes, units
from drift.case.values.mistakes import Mistakes
from drift.case.values.places import EllipseTable, ErrorTable
from drift.tracking.bridges import bridge as bridges
from drift.tracking.bridges import crossing
from drift.tracking.bridges.study import Study
from geo import notation
from geo.array import Array
from geo.errors import UserError
from geo.files import small

LARGEST = 2**20  # [bytes] of a file
INNER = 5  # output times between departure and arrival by default
MOST = 1000  # most output times


def _correlation(value: object) -> Array:
    """Return the correlation (2, 2) of two positions' errors: rows east and north of the first."""
    single = isinstance(value, int | float) and not isinstance(value, bool)
    try:
        matrix = np.asarray(np.eye(2) * float(str(value)) if single else value, np.float64)
    except (TypeError, ValueError):
        matrix = np.empty(0)
    if matrix.shape != (2, 2) or not (np.abs(matrix) <= 1).all():
        raise ValueError(
            f"correlation {value!r} must be a number from -1 to 1, for both east and north, or [[ee, en], [ne, nn]] of such"
        )
    return matrix


class PointTable(fields.Table):
    """A way point: position with its error, and time."""

    at: fields.Position
    """Position of the way point."""
    time: fields.Time
    """Time at the way point; relative times count from the first point's."""
    name: fields.Label | None = None
    """Name of the way point."""
    error: fields.Length | None = None
    """Radius that contains half of the probability; without any error the position is exact."""
    std: fields.LengthPair | None = None
    """Standard deviation, or two: along `orientation` and across it."""
    orientation: fields.Direction | None = None
    """Direction of the first of two standard deviations."""
    ellipse: EllipseTable | None = None
    """Error ellipse that contains a given probability."""
    correlation: Annotated[Any, BeforeValidator(_correlation)] = None
    """Correlation of its error with that of the point before; a number, or a 2 x 2 matrix."""

    @model_validator(mode="after")
    def proper(self) -> "PointTable":
        """Reject two errors of a position."""
        self.covariance()
        return self

    def covariance(self) -> Array:
        """Return the covariance of the position's error, east and north [m2], shape (2, 2)."""
        given = {name: getattr(self, name) for name in ("error", "std", "orientation", "ellipse")}
        given = {name: value for name, value in given.items() if value is not None}
        if not given:
            return np.zeros((2, 2))
        wrong = [name for name in ("error", "std", "ellipse") if name in given]
        if len(wrong) != 1:
            found = " and ".join(wrong) or "orientation alone"
            raise ValueError(
                f"give one of error, std and ellipse as the error of the position; found {found}"
            )
        if "orientation" in given and "std" not in given:
            raise ValueError("orientation belongs to std; an ellipse has its own inside its table")
        if self.std is not None and self.std[0] != self.std[1] and self.orientation is None:
            raise ValueError(
                "std has two values: give orientation too, of the first, in degrees true"
            )
        long, short, turn = ErrorTable(**given).axes()
        axes = np.array([[np.sin(turn), np.cos(turn)], [np.cos(turn), -np.sin(turn)]])
        return np.asarray(axes.T @ np.diag([long**2, short**2]) @ axes)


class LineTable(fields.Table):
    """A line: the great circle through two positions."""

    name: fields.Label
    """Name of the line."""
    through: Annotated[list[fields.Position], Field(min_length=2, max_length=2)]
    """Two positions that define the great circle; the line is the whole circle."""

    def line(self) -> crossing.Line:
        """Return the record of the line."""
        return crossing.through(self.name, *np.array(self.through).T)

    @model_validator(mode="after")
    def proper(self) -> "LineTable":
        """Reject two positions that do not define a great circle."""
        self.line()
        return self


class OutputTable(fields.Table):
    """Requested outputs."""

    times: list[fields.Time] | None = None
    """Output times."""
    every: fields.Duration | None = None
    """In place of `times`: their interval. By default there are five output times between departure
    and arrival."""
    areas: fields.Percents = (0.5, 0.9)
    """Probabilities of the reported ellipses, in per cent."""
    percentiles: fields.Percents = (0.05, 0.5, 0.95)
    """Reported percentiles of the time of the first crossing of a line."""
    coast: str = "gshhg"
    """Shoreline on the picture: `"gshhg"`, `"none"` or a file."""

    @model_validator(mode="after")
    def one_kind(self) -> "OutputTable":
        """Reject output times given twice."""
        if self.times is not None and self.every is not None:
            raise ValueError("give times or every, not both")
        return self


class BridgeTable(fields.Table):
    """The input file of `drift bridge`."""

    title: fields.Label
    """Title of the results."""
    k: fields.SpreadRate
    """The spread rate K, like `"12 nmi/sqrt(h)"`."""
    point: Annotated[list[PointTable], Field(min_length=2)]
    """Two or more way points, in order of time."""
    line: list[LineTable] = Field(default_factory=list)
    """Lines whose first crossing is reported."""
    output: OutputTable = OutputTable()
    """Requested outputs and their times."""


def load(path: str | os.PathLike[str], spread_rate: str | None = None) -> Study:
    """Read an input file of `drift bridge`.

    Args:
        path: the file.
        spread_rate: a spread rate K as text, in place of the file's.

    Raises:
        UserError: all mistakes of the file, one line for each.
    """
    path = Path(path)
    try:
        data = tomllib.loads(small.read_small_file(path, LARGEST).decode("utf-8-sig"))
    except OSError as error:
        raise UserError(f'bridge "{str(path)[:300]}": cannot be read: {error.strerror}') from None
    except UnicodeDecodeError:
        raise UserError(f'bridge "{path}": is not text in UTF-8') from None
    except (ValueError, RecursionError) as error:
        raise UserError(f"{path.name}: not valid TOML: {error}") from None
    if spread_rate is not None:
        data["k"] = spread_rate
    try:
        return study(
            BridgeTable.model_validate(data, context={"whole": BridgeTable}), path.absolute().parent
        )
    except ValidationError as error:
        raise _error_of_file(path, messages.lines(error, data)) from None
    except (UserError, ValueError) as error:
        raise _error_of_file(
            path, error.lines if isinstance(error, UserError) else (str(error),)
        ) from None
    except OverflowError:  # integers beyond the largest float
        raise UserError(f"{path.name}: one of its whole numbers is too large") from None


def _error_of_file(path: Path, lines: Sequence[str]) -> UserError:
    return UserError(
        *(f"{path.name}: {' '.join(line.split())}" for line in mistakes.shorten_lines(tuple(lines)))
    )


def study(table: BridgeTable, folder: Path) -> Study:
    """Build the study of a bridge from the tables of its file.

    Args:
        table: the validated tables.
        folder: folder of the file, from which the path of a shoreline starts.

    Raises:
        UserError: tables do not fit together, one line for each mistake.
    """
    start = table.point[0].time
    if isinstance(start, np.timedelta64):
        raise UserError("point 1: its time must be a date and time; times like +6 h count from it")
    moments = np.array([units.resolve(point.time, start) for point in table.point])
    lon, lat = np.array([point.at for point in table.point]).T
    wrong = Mistakes()
    with wrong.gathered():
        bridge = bridges.between(lon, lat, moments, table.k, _covariance(table.point))
    wrong.refuse()
    seconds = _output_times(table.output, start, bridge.time, wrong)
    coast = table.output.coast
    if coast.lower() not in ("gshhg", "none") and not (folder / coast).is_file():
        wrong.lines.append(
            f'output.coast: no file "{coast}"; give "gshhg", "none" or a shoreline file'
        )
    wrong.refuse()
    names = tuple(point.name or f"way point {k}" for k, point in enumerate(table.point, 1))
    return Study(
        table.title,
        bridge,
        names,
        tuple(line.line() for line in table.line),
        seconds,
        table.output.areas,
        table.output.percentiles,
        coast if coast.lower() in ("gshhg", "none") else str(folder / coast),
    )


def _covariance(points: Sequence[PointTable]) -> Array:
    """Return the covariance of all way points' errors [m2], shape (2 n, 2 n)."""
    blocks = [point.covariance() for point in points]
    whole = np.zeros((2 * len(points),) * 2)
    for k, block in enumerate(blocks):
        whole[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = block
    if points[0].correlation is not None:
        raise UserError(
            "point 1.correlation: the first point has no point before it; give correlation at the later point"
        )
    for k, (before, after) in enumerate(pairwise(range(len(points)))):
        if points[after].correlation is not None:
            scale = np.outer(*(np.sqrt(np.diag(blocks[side])) for side in (before, after)))
            cross = points[after].correlation * scale
            whole[2 * k : 2 * k + 2, 2 * k + 2 : 2 * k + 4] = cross
            whole[2 * k + 2 : 2 * k + 4, 2 * k : 2 * k + 2] = cross.T
    return whole


def _output_times(output: OutputTable, start: np.datetime64, time: Array, wrong: Mistakes) -> Array:
    """Return the output times [s since 1970]; `time` holds those of the way points."""
    begin, end = float(time[0]), float(time[-1])
    if output.every is not None:
        count = int((end - begin) / output.every) + 1
        if count > MOST:
            wrong.lines.append(f"output.every: gives {count:,} times; at most {MOST:,} are allowed")
            return time
        return begin + output.every * np.arange(count)
    if output.times is None:
        return np.linspace(begin, end, INNER + 2)[1:-1]
    moments = [units.resolve(moment, start) for moment in output.times]
    for moment in moments:
        if not begin <= notation.epoch(moment) <= end:
            wrong.lines.append(
                f"output.times: {notation.format_dtg(moment)} is outside the bridge, {notation.format_dtg(np.datetime64(int(begin), 's'))} to "
                f"{notation.format_dtg(np.datetime64(int(end), 's'))}"
            )
    return notation.epochs(np.array(moments)).astype(np.float64)
