"""The [expect] table: ranges in which a case expects the numbers of its forecast.

`drift run` prints one line on it. If a number is outside its range, the exit status is 1; the
results are written in any case.
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
# tolerance of sums of shares in float64 (largest error seen: 2e-15)
ROUNDING = 1e-12
FOUND = 6  # significant digits of values in messages, enough to show a narrow miss


class PlaceWithin(fields.Table):
    """A position, and the distance within which the forecast's mean position is expected."""

    of: fields.Position
    """Expected position."""
    distance: fields.Length
    """Largest distance of the mean position from it."""


def _percent(value: object) -> float:
    try:
        return float(str(value))
    except ValueError:
        raise ValueError(f"{value!r} is no percentage, like 90") from None


Percent = Annotated[float, BeforeValidator(_percent)]


class Expect(fields.Table):
    """Ranges at the end of the run: probabilities by status, containment areas, mean position.

    `drift run` prints in one line whether the forecast is within these ranges. If not, its exit
    status is 1; the results are written in any case. `--set expect='{}'` removes all ranges, for
    example for a run with other inputs.
    """

    adrift: fields.ShareRange | None = None
    """Probability adrift, as [least, most]."""
    ashore: fields.ShareRange | None = None
    """Probability ashore, as [least, most]."""
    outside: fields.ShareRange | None = None
    """Probability that left the forcing, as [least, most]."""
    left: fields.ShareRange | None = None
    """Probability that left the domain, as [least, most]."""
    under_way: fields.ShareRange | None = None
    """Probability under way, as [least, most]."""
    arrived: fields.ShareRange | None = None
    """Probability that the target arrived, as [least, most]."""
    aground: fields.ShareRange | None = None
    """Probability that the target ran aground, as [least, most]."""
    area_50: fields.AreaRange | None = None  # [m2]
    """Size of the 50 % containment area, as [least, most]."""
    area_95: fields.AreaRange | None = None
    """Size of the 95 % containment area, as [least, most]."""
    # by any percentage of output.areas
    areas: dict[Percent, fields.AreaRange] = Field(default_factory=dict)
    """Sizes of containment areas by percentage, `{ 90 = ["100 nmi2", "200 nmi2"] }`."""
    mean_position_within: PlaceWithin | None = None
    """Expected mean position."""

    def by_percent(self) -> dict[float, tuple[float, float]]:
        """Return the ranges of containment areas [m2] by percentage."""
        named = {50.0: self.area_50, 95.0: self.area_95}
        return {percent: span for percent, span in named.items() if span is not None} | self.areas


def misses(expected: Expect, end: Mapping[str, Any]) -> list[str]:
    """Return one line for each expected range that the last output misses.

    Args:
        expected: the ranges.
        end: the numbers of the last output, from `forecast.tables.numbers`.
    """
    missed = []
    for name in SHARES:
        # outputs without targets have no probability under way
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
                else f"{notation.number(away, FOUND)} m from the expected one"
            )
            missed.append(
                f"mean position: {found}, expected within {notation.number(place.distance)} m"
            )
    return missed


def evaluate(expected: Expect, end: Mapping[str, Any]) -> dict[str, Any]:
    """Return whether a forecast meets its [expect] table, and the missed ranges.

    Args:
        expected: the ranges; without any the result is {}.
        end: the numbers of the last output, from `forecast.tables.numbers`.
    """
    if not expected.model_fields_set or expected == Expect():
        return {}
    missed = misses(expected, end)
    return {"met": not missed, "misses": missed}


def _square_metres(area_nmi2: float | None) -> float:
    return float("nan") if area_nmi2 is None else area_nmi2 * NMI**2
