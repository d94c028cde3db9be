"""A fixed grid for all outputs (`output.grid`), so that runs can be compared cell by cell."""

import math
import re
from typing import Annotated

from pydantic import BeforeValidator, model_validator

from drift.case.values import fields, units
from geo import sphere
from geo.box import box_between
from geo.cells import QUANTUM, Cells

MOST_CELLS = 1_000_000
FEWEST = 8  # least number of cells in each direction
POLEWARD = 89.0  # [deg] highest latitude
DEGREES = re.compile(r"\s*([0-9.]+)\s*(deg|degrees?|°)\s*")

Spacing = tuple[float, str]  # size of a cell and its unit, "deg" or "m"


def _spacing(value: object) -> Spacing:
    if isinstance(value, str) and (match := DEGREES.fullmatch(value)):
        try:
            number, unit = float(match[1]), "deg"
        except ValueError:
            number, unit = 0.0, "deg"
    else:
        number, unit = units.quantity(value, "m", "spacing", "0.02 deg"), "m"
    if number <= 0:
        raise ValueError(f'{value!r} must be above 0, like "0.02 deg", "1 nmi" or "500 m"')
    return number, unit


class GridTable(fields.Table):
    """The `output.grid` table: the edges of the grid and the size of its cells."""

    west: fields.Edge
    """Western edge."""
    south: fields.Latitude
    """Southern edge."""
    east: fields.Edge
    """Eastern edge; across the antimeridian write -170 or 190."""
    north: fields.Latitude
    """Northern edge; the grid must lie within 89 degrees of latitude."""
    spacing: Annotated[Spacing, BeforeValidator(_spacing)]
    """Width and height of a cell, in degrees or as a length; at most a million cells."""

    @model_validator(mode="after")
    def proper(self) -> "GridTable":
        """Reject a grid without cells, with too few or too many."""
        if self.south >= self.north:
            raise ValueError(f"south {self.south:g} is not below north {self.north:g}")
        if max(abs(self.south), abs(self.north)) > POLEWARD:
            raise ValueError(
                f"reaches beyond {POLEWARD:g} degrees of latitude, where there is no forecast"
            )
        cells = self.cells()
        given = f"{self._described()} makes {cells.nlon:,} x {cells.nlat:,} cells"
        if min(cells.shape) < FEWEST:
            raise ValueError(
                f"{given}; at least {FEWEST} each way are needed to locate anything: widen it, or make spacing smaller"
            )
        if cells.nlon * cells.nlat > MOST_CELLS:
            larger = math.sqrt(cells.nlon * cells.nlat / MOST_CELLS)
            raise ValueError(
                f"{given}; at most {MOST_CELLS:,}: make spacing {math.ceil(10 * larger) / 10:g} times as large"
            )
        return self

    def cells(self) -> Cells:
        """Return the cells that cover the box, counted from its south-west corner."""
        number, unit = self.spacing
        high = number if unit == "deg" else math.degrees(number / sphere.RADIUS)
        shrink = 1.0 if unit == "deg" else math.cos(math.radians((self.south + self.north) / 2))
        box = box_between(self.west, self.south, self.east, self.north)
        west, span = box.west, box.east - box.west
        width, height = (_to_quantum(size) for size in (high / shrink, high))
        units_a_degree = sphere.TURN / 360
        lon0, lat0 = (round(edge * units_a_degree) for edge in (west, self.south))
        # A remainder below a hundredth of a cell is rounding and needs no further cell.
        columns, rows = (
            max(math.ceil(size * units_a_degree / cell - 0.01), 1)
            for size, cell in ((span, width), (self.north - self.south, height))
        )
        return Cells(lon0, lat0, width, height, min(columns, -(-sphere.TURN // width)), rows)

    def _described(self) -> str:
        number, unit = self.spacing
        return f"a spacing of {number:g} {unit} over {self.west:g}..{self.east:g} E, {self.south:g}..{self.north:g} N"


def _to_quantum(degrees: float) -> int:
    return max(round(degrees * sphere.TURN / 360 / QUANTUM), 1) * QUANTUM
