"""What a case expects of its own forecast: the [expect] table, held against the numbers of a run."""

from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from drift.case import fields
from geo import sphere
from geo.notation import NMI

SHARES = ("adrift", "ashore", "outside", "left", "under_way", "arrived", "aground")
ROUNDING = 1e-12  # by which a sum of shares may exceed 1 in float64 (the largest seen was 7e-16)


class PlaceWithin(fields.Table):
    """A position and the distance within which the forecast's mean is expected."""

    of: fields.Position
    """A position."""
    distance: fields.Length
    """How far from it the mean may be."""


def _percent(value: object) -> float:
    try:
        return float(str(value))
    except ValueError:
        raise ValueError(f"{value!r} is no percentage, like 90") from None


Percent = Annotated[float, BeforeValidator(_percent)]


class Expect(fields.Table):
    """Ranges at the end of the run: shares by what became of the object, containment areas, the mean position."""

    adrift: fields.ShareRange | None = None
    """Share adrift, as [least, most]."""
    ashore: fields.ShareRange | None = None
    """Share ashore."""
    outside: fields.ShareRange | None = None
    """Share that left the forcing."""
    left: fields.ShareRange | None = None
    """Share that left the domain."""
    under_way: fields.ShareRange | None = None
    """Share under way."""
    arrived: fields.ShareRange | None = None
    """Share that arrived."""
    aground: fields.ShareRange | None = None
    """Share that ran aground."""
    area_50: fields.AreaRange | None = None  # [m2]
    """Of the 50 % area, as [least, most]."""
    area_95: fields.AreaRange | None = None
    """Of the 95 % area."""
    areas: dict[Percent, fields.AreaRange] = Field(default_factory=dict)  # of any shares of output.areas [%]
    """Of areas by their percentage, `{ 90 = ["100 nmi2", "200 nmi2"] }`."""
    mean_position_within: PlaceWithin | None = None
    """Where the mean position is."""

    def by_percent(self) -> dict[float, tuple[float, float]]:
        """Return the ranges of areas [m2] by the percentage that they hold."""
        named = {50.0: self.area_50, 95.0: self.area_95}
        return {percent: span for percent, span in named.items() if span is not None} | self.areas


def misses(expected: Expect, end: Mapping[str, Any]) -> list[str]:
    """Return what the last output of a forecast misses, a line each; empty when all is as expected.

    end: that output as in `forecast.tables.numbers`.
    """
    missed = []
    values = {name: end["probability"].get(name, 0.0) for name in SHARES}  # where nothing steers, nothing is under way
    spans = {name: getattr(expected, name) for name in values}
    for percent, span in expected.by_percent().items():
        values[f"area_{percent:g}"] = _square_metres(end["area_nmi2"][f"{percent:g}%"])
        spans[f"area_{percent:g}"] = span
    for name, value in values.items():
        span = spans[name]
        if span is not None and not span[0] <= value <= span[1] + ROUNDING:
            missed.append(f"{name}: {value:.4g}, expected {span[0]:.4g} to {span[1]:.4g}")
    place = expected.mean_position_within
    if place is not None:
        mean = end["mean"] or {"lon": np.nan, "lat": np.nan}
        away = float(sphere.distance(*np.radians([*place.of, mean["lon"], mean["lat"]])))
        if not away <= place.distance:
            missed.append(f"mean position: {away:.0f} m from the one expected, more than {place.distance:.0f} m")
    return missed


def _square_metres(area_nmi2: float | None) -> float:
    return float("nan") if area_nmi2 is None else area_nmi2 * NMI**2
