"""An agency's own catalogue of leeway classes, a TOML file that a case names.

`[leeway] catalogue = "objects.toml"` adds its classes to the shipped ones (docs/leeway.md). It is
read before the case's tables are checked, because their objects refer to it by name.
"""

import tomllib
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError, model_validator

from drift.case.forcing import sources
from drift.case.scenario.objects import LineTable, lines_of
from drift.case.values import fields, messages, mistakes
from drift.case.values.mistakes import Mistakes
from drift.engine.motion.objects import leeway
from drift.engine.motion.objects.leeway import STOKES, WATER, Catalogue, Drifter
from geo.errors import UserError
from geo.files import small

LARGEST = 4 * 2**20  # [bytes] of a catalogue: ten thousand classes
# What a class may have without `plausible = true`; the published ones have downwind slopes of 0.4
# to 7.7 % (or 0), offsets of at most 15 cm/s, errors of at most 28 cm/s.
FLATTEST, STEEPEST = 0.002, 0.15
FASTEST = 0.5  # [m/s] offset or error
# [m/s] how far a line may lead to the other side than its name says in a wind of 10 m/s: of the
# published ones one does, by 1.6 cm/s
ACROSS = 0.03


class LeewayTable(fields.Table):
    """The [leeway] table as written: an agency's own classes, and the Stokes drift of all."""

    catalogue: str | None = None
    """A TOML file with leeway classes of your own, which objects name like the shipped ones."""
    stokes: Literal["inside", "added"] | None = None
    """Whether leeway lines include the Stokes drift, or that of `[[stokes]]` is added to them; by
    default each class says it."""


class OwnLineTable(LineTable):
    """A leeway line of a class of a catalogue: its error has no default."""

    std: fields.Speed
    """Standard error of the regression; if none is known, a wide one, and a `warning`."""


class ClassTable(fields.Table):
    """A [[class]] table of a catalogue as written."""

    name: fields.Label
    """Name of the class, as objects of cases give it; not one of a shipped class."""
    text: fields.Label
    """What the object is, in a line."""
    downwind: OwnLineTable
    """Downwind leeway line."""
    right: OwnLineTable | None = None
    """Crosswind leeway line to the right of the wind; needs `left`."""
    left: OwnLineTable | None = None
    """Crosswind leeway line to the left of the wind; needs `right`."""
    measured: Literal["direct", "indirect", "unknown", "estimated"]
    """How: relative to the water at the object (`direct`), as the drift less a current measured
    elsewhere (`indirect`), in a way that the source does not say, or not at all."""
    source: fields.Label
    """Where the figures come from."""
    stokes: Literal["inside", "added"] | None = None
    """Whether the lines include the Stokes drift; by default `added` if measured directly, else
    `inside`."""
    warning: fields.Label | None = None
    """A line that `drift check` and every output print where such an object drifts."""
    plausible: bool = False
    """`true` accepts slopes, offsets and errors that drift would reject."""

    @model_validator(mode="after")
    def whole(self) -> "ClassTable":
        """Reject a class with half of its crosswind lines, or with figures that look mistyped."""
        if (self.right is None) != (self.left is None):
            raise ValueError(
                "give both right and left, or neither; the mirror image has slope and offset negated"
            )
        if self.downwind.slope < 0:
            raise ValueError(
                f"downwind slope {100 * self.downwind.slope:g} % must be 0 to 50 %: no object drifts upwind"
            )
        wrong = [] if self.plausible else self._implausible()
        fields.refuse(self, wrong)
        return self

    def _implausible(self) -> list[str]:
        advice = "; if it is right, add plausible = true"
        wrong = []
        slope = self.downwind.slope
        if 0 < slope < FLATTEST:
            wrong.append(
                f"downwind slope {100 * slope:g} % is below {100 * FLATTEST:g} %, less than any published class has: was "
                f'"{1e4 * slope:g} %" meant{advice}'
            )
        for side in ("downwind", "right", "left"):
            line = getattr(self, side)
            if line is None:
                continue
            if abs(line.slope) > STEEPEST:
                wrong.append(
                    f"{side} slope {100 * line.slope:g} % is more than {100 * STEEPEST:g} % of the wind{advice}"
                )
            for what, value in (("offset", line.offset), ("std", line.std)):
                if abs(value) > FASTEST:
                    wrong.append(
                        f"{side} {what} {100 * value:g} cm/s is more than {100 * FASTEST:g} cm/s: a bare number is in "
                        f'm/s; was "{value:g} cm/s" meant{advice}'
                    )
        for side, sign in (("right", 1), ("left", -1)):
            line = getattr(self, side)
            speed = 0.0 if line is None else 10 * line.slope + line.offset
            if sign * speed < -ACROSS:
                wrong.append(
                    f"{side} line leads to the other side, by {100 * abs(speed):.3g} cm/s in a wind of 10 m/s: leeway "
                    f"to the right is positive, to the left negative{advice}"
                )
        return wrong

    def drifter(self) -> Drifter:
        """Return the record of the class."""
        record = leeway.class_of(
            Drifter(
                self.name,
                self.text,
                *lines_of(self.downwind, self.right, self.left),
                measured=self.measured,
                source=self.source,
                warning=self.warning or "",
            )
        )
        return record if self.stokes is None else replace(record, stokes=self.stokes)


class CatalogueTable(fields.Table):
    """A catalogue of leeway classes as written."""

    classes: list[ClassTable] = Field(min_length=1, alias="class")
    """The classes, `[[class]]`."""

    @model_validator(mode="after")
    def distinct(self) -> "CatalogueTable":
        """Reject two classes of one name, and the names of shipped ones; case is ignored."""
        times = Counter(one.name.upper() for one in self.classes)
        shipped = {name.upper() for name in (*leeway.classes(), WATER.name)}
        wrong = [
            f'class "{one.name}": two classes have this name; give each its own'
            for one in {one.name.upper(): one for one in self.classes}.values()
            if times[one.name.upper()] > 1
        ]
        wrong += [
            f'class "{one.name}": a shipped class has this name (drift objects); give another'
            for one in self.classes
            if one.name.upper() in shipped
        ]
        fields.refuse(self, wrong)
        return self


def read_catalogue(path: Path) -> Catalogue:
    """Return the classes of a catalogue, a file.

    Raises:
        UserError: the file cannot be read or has mistakes, one line for each.
    """
    try:
        data = _toml(path)
        try:
            table = CatalogueTable.model_validate(data, context={"whole": CatalogueTable})
        except ValidationError as error:
            raise UserError(*messages.lines(error, data)) from None
        except OverflowError:  # integers beyond the largest float
            raise UserError("one of its whole numbers is too large") from None
    except UserError as error:
        raise UserError(
            *(f'catalogue "{path.name}": {line}' for line in mistakes.shorten_lines(error.lines))
        ) from None
    return Catalogue({one.name: one.drifter() for one in table.classes}, str(path))


def _toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(small.read_small_file(path, LARGEST).decode("utf-8-sig"))
    except UnicodeDecodeError:
        raise UserError("is not text in UTF-8") from None
    except OSError as error:
        raise UserError(f"cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise UserError(f"not valid TOML: {error}") from None


def catalogue_of_case(data: Mapping[str, Any], folder: Path, wrong: Mistakes) -> Catalogue:
    """Return the classes that the objects of a case may name.

    Args:
        data: the case's tables as read, valid or not.
        folder: folder from which relative paths start.
        wrong: the mistakes of the catalogue are added to it.
    """
    table = data.get("leeway")
    given = table if isinstance(table, Mapping) else {}
    answer, name = given.get("stokes"), given.get("catalogue")
    stokes = answer if answer in set(STOKES.values()) else None
    if not isinstance(name, str):
        return Catalogue(stokes=stokes, readable=name is None)
    with wrong.gathered():
        path = Path(sources.one_file(name, folder, "leeway.catalogue"))
        return replace(read_catalogue(path), stokes=stokes)
    return Catalogue(stokes=stokes, readable=False)
