"""What a case expects of its own forecast: the [expect] table, held against the numbers of a run.

`drift run` prints one line of it and ends with exit status 1 where something is missed; the results
are written.
"""

import math
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from drift.case.values import fields
from geo import notation, sphere
from geo.notation import NMI

SHARES = ("adrift", "ashore", "outside", "left", "under_way", "arrived", "aground")
# by which a sum of shares may differ from 1 in float64 (the largest seen was 2e-15)
ROUNDING = 1e-12
FOUND = 6  # significant digits of values found: a narrow miss must not read as a hit


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
    """Ranges at the end of the run: shares by fate of the object, containment areas, the mean
    position.

    `drift run` says in one line whether the forecast is within them; if not, its exit status is 1
    and the results are written all the same. `--set expect='{}'` leaves them out, as for a run with
    other inputs.
    """

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
    # of any shares of output.areas [%]
    areas: dict[Percent, fields.AreaRange] = Field(default_factory=dict)
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
    for name in SHARES:
        # nothing is under way in plain drift
        value, span = end["probability"].get(name, 0.0), getattr(expected, name)
        if span is not None and not span[0] - ROUNDING <= value <= span[1] + ROUNDING:
            least, most = (notation.hundredths(share) for share in span)
            missed.append(
                f"{name}: {notation.number(100 * value, FOUND)} %, expected {least} to {most} %"
            )
    for percent, span in expected.by_percent().items():
        area = _square_metres(end["area_nmi2"][f"{notation.number(percent)}%"])
        if not span[0] <= area <= span[1]:
            found, least, most = (notation.number(size / NMI**2, FOUND) for size in (area, *span))
            found = "none" if math.isnan(area) else f"{found} nmi2"
            missed.append(
                f"area_{notation.number(percent)}: {found}, expected {least} to {most} nmi2"
            )
    place = expected.mean_position_within
    if place is not None:
        mean = end["mean"] or {"lon": np.nan, "lat": np.nan}
        away = float(sphere.distance(*np.radians([*place.of, mean["lon"], mean["lat"]])))
        if not away <= place.distance:
            found = (
                "none"
                if end["mean"] is None
                else f"{notation.number(away, FOUND)} m from the one expected"
            )
            missed.append(
                f"mean position: {found}, expected within {notation.number(place.distance)} m"
            )
    return missed


def evaluate(expected: Expect, end: Mapping[str, Any]) -> dict[str, Any]:
    """Return whether a forecast meets its case's [expect], and what it misses; {} where the case
    has none.

    end: as in `misses`.
    """
    if not expected.model_fields_set or expected == Expect():
        return {}
    missed = misses(expected, end)
    return {"met": not missed, "misses": missed}


def _square_metres(area_nmi2: float | None) -> float:
    return float("nan") if area_nmi2 is None else area_nmi2 * NMI**2
