"""Objects of a case: a leeway class, leeway lines, plain windage, an immersion level, or water."""

from typing import Annotated

import numpy as np
from pydantic import BeforeValidator, PrivateAttr, ValidationInfo, model_validator

from drift.case.values import fields
from drift.engine.motion.objects import leeway
from drift.engine.motion.objects.leeway import Catalogue, Drifter, Line
from drift.evidence.filter.detection import sweep_width
from geo import notation
from geo.errors import UserError

LEAST_IMMERSION = 0.05


class LineTable(fields.Table):
    """A leeway line as written."""

    slope: fields.Slope
    """Leeway speed as a share of the wind speed."""
    offset: fields.SignedSpeed = 0.0
    """Leeway speed without wind."""
    std: fields.Speed = 0.0
    """Standard deviation of the leeway speed about the line."""

    def line(self) -> Line:
        """Return the record of the leeway line."""
        return Line(self.slope, self.offset, self.std)


def lines_of(
    downwind: LineTable, right: LineTable | None, left: LineTable | None
) -> tuple[Line, Line, Line]:
    """Return the records of three leeway lines; without crosswind lines these are 0."""
    return (
        downwind.line(),
        right.line() if right else Line(),
        left.line() if left else Line(),
    )


class ObjectTable(fields.Table):
    """An object: a leeway class, leeway lines of your own, windage, or an immersion level."""

    name: str | None = None
    """A leeway class, or `"water"`; with other keys, the name of the object."""
    downwind: LineTable | None = None
    """Downwind leeway line."""
    right: LineTable | None = None
    """Crosswind leeway line to the right of the wind; needs `left`."""
    left: LineTable | None = None
    """Crosswind leeway line to the left of the wind; needs `right`."""
    windage: fields.Windage | None = None
    """In place of leeway lines: a share of the wind speed, straight downwind."""
    spread: fields.Windage = 0.0
    """Standard deviation of `windage` between objects."""
    immersion: fields.ShareRange | None = None
    """In place of leeway lines: share of the object under water, 5 to 100 %, or a range; drift
    computes the leeway from it."""
    # the classes that it may name, from the validation context
    _catalogue: Catalogue = PrivateAttr(default_factory=Catalogue)

    @model_validator(mode="after")
    def one_kind(self, info: ValidationInfo) -> "ObjectTable":
        """Reject an incomplete description of the object, or two at once."""
        self._catalogue = (info.context or {}).get("catalogue", self._catalogue)
        if self.immersion is not None:
            if self.downwind or self.windage is not None or self.right or self.left or self.spread:
                raise ValueError("immersion alone determines the leeway; leave the other keys out")
            if self.immersion[0] < LEAST_IMMERSION:
                raise ValueError(
                    f"immersion {self.immersion[0]:g} must be {LEAST_IMMERSION:g} to 1, the share under water"
                )
        elif self.downwind is None and self.windage is None:
            if self.right or self.left or self.spread or self.name is None:
                raise ValueError(
                    'give a class ("PIW-1"), { downwind, right, left }, { windage, spread } or "water"'
                )
            try:
                self._catalogue.find(self.name)
            except UserError as error:
                raise ValueError(str(error)) from None
        elif self.downwind is not None and self.downwind.slope < 0:
            raise ValueError(
                f"downwind slope {100 * self.downwind.slope:g} % must be 0 to 50 %: no object drifts "
                "upwind"
            )
        elif self.downwind is not None and self.windage is not None:
            raise ValueError("give either downwind, right and left or windage, not both")
        if self.windage is not None and (self.right or self.left):
            raise ValueError("right and left belong to downwind; windage has no crosswind lines")
        if (self.right is None) != (self.left is None):
            raise ValueError(
                "give both right and left, or neither; the mirror image has slope and offset negated"
            )
        if self.spread and self.windage is None:
            raise ValueError("spread belongs to windage; a leeway line has its own std")
        return self

    def drifter(self) -> Drifter:
        """Return the record of the drifting object."""
        return self._catalogue.with_stokes(self._drifter())

    def _drifter(self) -> Drifter:
        still = Line()
        if self.immersion is not None:
            low, high = self.immersion
            mean = float(np.mean(leeway.windage(np.linspace(low, high, 1001))))
            least, most = notation.hundredths(low), notation.hundredths(high)
            words = f"Immersed to {least} to {most} %" if high > low else f"Immersed to {least} %"
            return Drifter(
                self.name or "immersed", words, Line(mean), still, still, immersion=self.immersion
            )
        if self.windage is not None:
            down = Line(self.windage, spread=self.spread)
            return Drifter(
                self.name or "windage",
                f"Windage {notation.hundredths(self.windage)} %",
                down,
                still,
                still,
            )
        if self.downwind is not None:
            return Drifter(
                self.name or "own lines",
                "Leeway of the case",
                *lines_of(self.downwind, self.right, self.left),
            )
        return self._catalogue.find(str(self.name))


def _search_object(value: object) -> object:
    try:
        return sweep_width.find(value) if isinstance(value, str) else value
    except UserError as error:
        raise ValueError(str(error)) from None


# an object of the sweep width tables
SearchObject = Annotated[str, BeforeValidator(_search_object)]
