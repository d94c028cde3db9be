"""Tables of forcing sources: files, a dataset in memory, a constant, a table, or a built-in flow.

Nothing is opened here; geo.forcing.sources does that. A constant or a table holds on-scene reports,
so that the first hour of a case needs no file. Directions are given by the key `from` (winds) or
`toward` (currents).
"""

import glob
import itertools
import math
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, ValidationError, field_validator, model_validator

from drift.case.values import fields, messages, units
from drift.engine.environment.forcing_spec import ForcingSpec, Report, Slices
from geo import notation
from geo.errors import UserError
from geo.files import fence
from geo.forcing.quantity import QUANTITIES
from geo.forcing.times import epoch

# parameters of built-in flows that are in m/s
SPEEDS = ("speed", "tide", "sea_breeze", "mean_east", "mean_north")

MOST_MEMBERS = 1000

ADDRESS = re.compile(r"[a-z][a-z0-9+]*://", re.IGNORECASE)


class Vector(fields.Table):
    """A reported wind or current: speed and direction, or components east and north."""

    speed: fields.Speed | None = None
    """Speed; needs `from` or `toward`."""
    from_: fields.Direction | None = Field(None, alias="from")
    """Direction from which it comes, the convention for winds."""
    toward: fields.Direction | None = None
    """Direction toward which it flows, the convention for currents."""
    east: fields.SignedSpeed | None = None
    """Component toward the east; needs `north`."""
    north: fields.SignedSpeed | None = None
    """Component toward the north; needs `east`."""

    @model_validator(mode="after")
    def complete(self) -> "Vector":
        """Reject a vector that is incomplete or given twice."""
        given = {
            name
            for name in ("speed", "from_", "toward", "east", "north")
            if getattr(self, name) is not None
        }
        if given not in ({"speed", "from_"}, {"speed", "toward"}, {"east", "north"}):
            found = ", ".join(sorted(name.rstrip("_") for name in given)) or "nothing"
            raise ValueError(
                f"give speed and from (winds), or speed and toward (currents), or east and north; found {found}"
            )
        return self

    def components(self) -> tuple[float, float]:
        """Return the components (east, north) [m/s], relative to true north."""
        if self.speed is None:
            return self.east or 0.0, self.north or 0.0
        toward = math.radians(
            self.toward if self.toward is not None else (self.from_ or 0.0) + 180.0
        )
        return self.speed * math.sin(toward), self.speed * math.cos(toward)


class TimedVector(Vector):
    """A row of a table by time."""

    time: fields.Time
    """Time of the row; between rows the vector is interpolated linearly, however far apart."""


class StatedTimes(fields.Table):
    """Times that replace those of a file, or say how to read those."""

    start: fields.Time | None = None
    """Time of the first slice; needs `every`."""
    every: fields.Duration | None = None
    """Interval between slices."""
    zone: str | None = None
    """Time zone of the file's times, hours ahead of UTC: "-06:00"."""
    stamp: Literal["start", "middle", "end", "instant"] | None = None
    """Which part of the averaging interval a time stamp marks; `instant`: slices are not means."""

    @field_validator("zone")
    @classmethod
    def known(cls, value: str | None) -> str | None:
        """Reject an invalid time zone."""
        if value is not None:
            try:
                epoch.zone_of(value)
            except UserError as error:
                raise ValueError(str(error)) from None
        return value

    @model_validator(mode="after")
    def complete(self) -> "StatedTimes":
        """Reject a start without an interval, and a zone of times that are replaced."""
        if (self.start is None) != (self.every is None):
            raise ValueError(
                "start and every go together: the first slice's time, and the time from one to the next"
            )
        if self.start is None and self.zone is None and self.stamp is None:
            raise ValueError("give start and every, or zone, or stamp")
        if self.start is not None and self.zone is not None:
            raise ValueError(
                "zone applies to the file's own times, which start and every replace; give zone, or start and every"
            )
        return self

    def stated(self, start: np.datetime64) -> Slices:
        """Return the record of the times, for a case that starts at `start`."""
        return Slices(
            None if self.start is None else units.resolve(self.start, start),
            None if self.every is None else np.timedelta64(round(self.every), "s"),
            self.zone,
            self.stamp,
        )


def _as_tuple(value: Any) -> Any:
    return (value,) if isinstance(value, str) else value


def _reject_list(value: Any) -> Any:
    """Reject a value that is not one vector, with the form to use instead."""
    if isinstance(value, list):
        raise ValueError(
            "must be one vector, constant in time; given a list: for a changing vector write table = [{ time = .., .. }, ..]"
        )
    if not isinstance(value, dict | Vector | None):
        raise ValueError(
            f'{value!r} has no direction; write {{ speed = "15 kn", from = 240 }}, or toward'
        )
    return value


def _reject_single_vector(value: Any) -> Any:
    """Reject one vector in place of rows."""
    if isinstance(value, dict):
        raise ValueError(
            "must be rows by time, [{ time = .., speed = .., from = .. }, ..]; given one vector: for a constant vector write constant = { .. }"
        )
    return value


def _indices_as_text(value: Any) -> Any:
    """Convert whole numbers in a table of names, which are indices along a dimension, to text."""
    if not isinstance(value, dict):
        return value
    return {
        k: str(v) if isinstance(v, int) and not isinstance(v, bool) else v for k, v in value.items()
    }


def _parameters(value: Any) -> dict[str, float]:
    if not isinstance(value, dict):
        raise ValueError(f"must be a table, not {value!r}")
    return {key: _to_base_units(number) for key, number in value.items()}


def _to_base_units(value: object) -> float:
    """Return a parameter of a built-in flow in SI base units, whatever its dimension."""
    units.short(value, "number", "0.5 m/s")
    if isinstance(value, str) and (match := units.NUMBER.fullmatch(value)) and match[2]:
        try:
            if units.TOWER.search(match[2]):
                raise ValueError
            return float(units.registry().Quantity(value).to_base_units().magnitude)
        except Exception:
            raise ValueError(f'"{value}" is not a quantity') from None
    return units.quantity(value, "", "number", "0.5 m/s")


def _members(value: Any) -> Any:
    """Reject a value that does not describe ensemble members."""
    if isinstance(value, bool) or (isinstance(value, str) and value.strip()):
        return value
    if not isinstance(value, list) or not all(isinstance(member, dict) for member in value):
        raise ValueError(
            f"{value!r} does not describe members; write true, the name of their dimension, or a list of tables, one per "
            "member: [{ constant = { .. } }, { constant = { .. } }]"
        )
    if not 2 <= len(value) <= MOST_MEMBERS:
        raise ValueError(
            f"has {len(value)} member{'s' * (len(value) != 1)}; must have 2 to {MOST_MEMBERS}"
        )
    for number, member in enumerate(value, 1):
        for key in ("name", "fill", "add", "members"):
            if key in member:
                raise ValueError(
                    f"member {number}: {key} is the same for all members; give it beside members"
                )
    return value


class SourceTable(fields.Table):
    """A forcing source as written in the case file: [[current]], [[wind]] and so on."""

    name: fields.Label | None = None
    files: (
        Annotated[tuple[Annotated[str, Field(min_length=1)], ...], BeforeValidator(_as_tuple)]
        | None
    ) = None
    dataset: fields.Label | None = None
    constant: Annotated[Vector | None, BeforeValidator(_reject_list)] = None
    table: Annotated[list[TimedVector] | None, BeforeValidator(_reject_single_vector)] = None
    analytic: str | None = None
    """Name of a built-in synthetic flow; every map carries a warning."""
    parameters: Annotated[dict[str, float], BeforeValidator(_parameters)] = Field(
        default_factory=dict
    )
    """Parameters of the built-in flow, in SI units or with a unit."""
    variables: Annotated[dict[str, str] | None, BeforeValidator(_indices_as_text)] = None
    units: str | None = None
    depth: fields.Depth | None = None
    steady: bool = False
    times: StatedTimes | None = None
    fill: fields.Count | None = None  # None: the default of the quantity
    plausible: bool = False
    timeout: fields.Timeout = 60.0
    add: bool = False
    members: Annotated[bool | str | list[dict[str, Any]], BeforeValidator(_members)] = False

    @field_validator("fill")
    @classmethod
    def few(cls, value: int | None) -> int | None:
        """Reject a fill that would extrapolate a current far inland."""
        if value is not None and not 0 <= value <= 20:
            raise ValueError(f"{value} cells; must be 0 to 20")
        return value

    @model_validator(mode="after")
    def one_kind(self) -> "SourceTable":
        """Reject two kinds of source in one table, and keys that belong to another kind."""
        if isinstance(self.members, list):
            for number, member in enumerate(self.members, 1):
                try:
                    self._member(member)
                except ValidationError as error:
                    raise ValueError(
                        f"member {number}: {messages.lines(error, member)[0]}"
                    ) from None
            return self
        try:
            kind = fields.one_of(self, ("files", "dataset", "constant", "table", "analytic"))
        except ValueError as error:
            several = " and " in str(error).partition("found")[2]
            how = (
                "; leave one out (--set replaces a whole source: current.0='{ constant = { .. } }')"
            )
            raise ValueError(f"{error}{how if several else ''}") from None
        if kind not in ("files", "dataset"):
            if self.members:
                raise ValueError(
                    f"members = {str(self.members).lower()} belongs to files and to a dataset; this source is {kind}: give a "
                    "table for each member"
                )
            for key in ("variables", "units", "depth", "steady", "times", "plausible"):
                if key in self.model_fields_set:
                    raise ValueError(
                        f"{key} belongs to files and to a dataset; this source is {kind}"
                    )
        if kind != "files" and "timeout" in self.model_fields_set:
            raise ValueError(f"timeout belongs to files at an address; this source is {kind}")
        if kind != "analytic" and self.parameters:
            raise ValueError(f"parameters belong to analytic; this source is {kind}")
        if self.files is not None and not self.files:
            raise ValueError("files is empty")
        if self.steady and self.times:
            raise ValueError("steady and times exclude each other: a steady field has no times")
        return self

    def spec(self, quantity: str, number: int, start: np.datetime64, folder: Path) -> ForcingSpec:
        """Return the record of the source, with absolute paths and times in UTC.

        Args:
            quantity: "current", "wind" and so on.
            number: number of the source among those of its quantity, from 1.
            start: start of the case.
            folder: folder from which relative paths start.

        Raises:
            ValueError: a file is missing, or a stated speed is implausibly high for the quantity.
        """
        if QUANTITIES[quantity].in_air and self.depth is not None:
            in_water = " and ".join(
                f"[[{name}]]" for name, other in QUANTITIES.items() if not other.in_air
            )
            raise ValueError(
                f"depth belongs to {in_water}; name a wind's level by its index, in variables"
            )
        if isinstance(self.members, list):
            return ForcingSpec(
                name=self.name or f"{quantity} {number}",
                quantity=quantity,
                fill=QUANTITIES[quantity].fill if self.fill is None else self.fill,
                add=self.add,
                members=True,
                each=tuple(
                    self._of(k, self._member(member), quantity, start, folder)
                    for k, member in enumerate(self.members, 1)
                ),
            )
        ceiling = QUANTITIES[quantity].fastest
        for place, speed in self._speeds():
            if speed > ceiling:
                raise ValueError(
                    f"{place}: {speed:.4g} m/s is too fast for a {QUANTITIES[quantity].spoken}; at most {ceiling:g} m/s"
                )
        entries = [tuple(matching_files(written, folder)) for written in self.files or ()]
        return ForcingSpec(
            name=self.name or f"{quantity} {number}",
            quantity=quantity,
            files=tuple(itertools.chain.from_iterable(entries)),
            dataset=self.dataset,
            constant=self.constant.components() if self.constant else None,
            table=_report(self.table, start) if self.table is not None else None,
            analytic=self.analytic,
            parameters=self.parameters,
            variables=self.variables,
            units=self.units,
            depth=self.depth,
            steady=self.steady,
            times=self.times.stated(start) if self.times else None,
            fill=QUANTITIES[quantity].fill if self.fill is None else self.fill,
            plausible=self.plausible,
            timeout=self.timeout,
            add=self.add,
            members=self.members,
            entries=tuple((path,) for path in entries[0]) if len(entries) == 1 else tuple(entries),
        )

    def _member(self, member: dict[str, Any]) -> "SourceTable":
        """Return a member as a source table: its own keys, else those given beside `members`."""
        shared = {
            key: getattr(self, key)
            for key in self.model_fields_set - {"name", "fill", "add", "members"}
        }
        own = dict(member)
        if "parameters" in own and isinstance(own["parameters"], dict):
            own["parameters"] = {**self.parameters, **own["parameters"]}
        return SourceTable(**{**shared, **own})

    def _of(
        self, number: int, member: "SourceTable", quantity: str, start: np.datetime64, folder: Path
    ) -> ForcingSpec:
        """Return the source record of a member."""
        try:
            return member.spec(quantity, number, start, folder)
        except ValueError as error:
            raise ValueError(f"member {number}: {error}") from None

    def _speeds(self) -> Iterator[tuple[str, float]]:
        """Yield the speeds [m/s] written in the table, each with its key."""
        if self.constant:
            yield "constant", math.hypot(*self.constant.components())
        for row, vector in enumerate(self.table or (), 1):
            yield f"table, row {row}", math.hypot(*vector.components())
        for key in SPEEDS:
            yield f"parameters.{key}", abs(self.parameters.get(key, 0.0))


def _number(value: Any) -> Any:
    """Return a number as the vector that stands for it: see geo.forcing.quantity."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{value!r} must be a number")
    return {"east": float(value), "north": 0.0}


class ScalarTable(SourceTable):
    """A source of a quantity that is a number: a constant has no direction."""

    constant: Annotated[Vector | None, BeforeValidator(_number)] = None


def source_label(quantity: str, number: int, name: str | None) -> str:
    """Return the name of a source in messages: its name, or its number within its quantity.

    Args:
        quantity: "current", "wind" and so on.
        number: number of the source among those of its quantity, from 1.
        name: its name in the case file; None: it has none.
    """
    return f'{quantity} "{name}"' if name else f"{quantity} {number}"


def _report(rows: list[TimedVector], start: np.datetime64) -> Report:
    if len(rows) < 2:
        raise ValueError("table needs at least two rows; for one, write constant")
    times = tuple(units.resolve(row.time, start) for row in rows)
    for before, after in itertools.pairwise(times):
        if after <= before:
            raise ValueError(
                f"table: {notation.format_dtg(after)} does not come after {notation.format_dtg(before)}"
            )
    vectors = [row.components() for row in rows]
    return Report(times, tuple(east for east, _ in vectors), tuple(north for _, north in vectors))


def matching_files(written: str, folder: Path) -> list[str]:
    """Return the files that a path or pattern matches, absolute and sorted.

    Args:
        written: path or pattern as in the case file, with ~ and environment variables; an address
            (http://..) is returned unchanged.
        folder: folder from which relative paths start.

    Raises:
        ValueError: no file matches, or the path is outside the folders that may be read.
    """
    text = re.sub(
        r"\$\{(\w+)\}|\$(\w+)",
        lambda match: _environment_variable(match[1] or match[2], written),
        written,
    )
    try:
        if ADDRESS.match(text):
            fence.check_address(text)
            return [text]
        path = folder / os.path.expanduser(text)
        fence.check_pattern(str(path))
    except UserError as error:
        raise ValueError(str(error)) from None
    try:
        matches = [str(path)] if path.exists() else sorted(glob.glob(str(path), recursive=True))
        if matches:
            for match in matches:
                fence.check(match)
            # strict: a broken link raises
            return [str(Path(match).resolve(strict=True)) for match in matches]
    except UserError as error:
        raise ValueError(str(error)) from None
    except (OSError, RuntimeError, ValueError) as error:  # too long a name, a loop of links
        reason = error.strerror if isinstance(error, OSError) else None
        raise ValueError(
            f'no file "{_shorten(written)}" ({reason or "a loop of links"}); name another'
        ) from None
    raise ValueError(f'no file "{_shorten(written)}"; looked for {_shorten(str(path))}')


def _shorten(text: str) -> str:
    return text if len(text) <= 300 else f"{text[:300]}..."


def _environment_variable(name: str, written: str) -> str:
    try:
        fence.check_variable(name)
    except UserError as error:
        raise ValueError(str(error)) from None
    if name not in os.environ:
        raise ValueError(
            f'"{written}" needs the environment variable {name}; set it: export {name}=/folder/of/the/data'
        )
    return os.environ[name]


def one_file(name: str, folder: Path, place: str, allowed: str = "") -> str:
    """Return the absolute path of exactly one file.

    Args:
        name: path as in the case file.
        folder: folder from which relative paths start.
        place: key of the case file, for the message.
        allowed: end of the message.

    Raises:
        UserError: no file or several files match.
    """
    try:
        files = matching_files(name, folder)
    except ValueError as error:
        raise UserError(f"{place}: {error}{allowed}") from None
    if len(files) != 1 or not Path(files[0]).is_file():
        raise UserError(f'{place}: "{name}" is not one file; it is {", ".join(files)}')
    return files[0]
