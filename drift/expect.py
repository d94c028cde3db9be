"""What a case expects of its own forecast: the [expect] table, held against the numbers of a run."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from drift import fields, units
from geo import sphere

NMI = units.NMI
ROUNDING = 1e-12  # by which a sum of shares may exceed 1 in float64; seen: 7e-16


class PlaceWithin(fields.Table):
    """A position and the distance within which the forecast's mean is expected."""

    of: fields.Position
    distance: fields.Length


class Expect(fields.Table):
    """Ranges at the end of the run: shares by what became of the object, containment areas, the mean position."""

    adrift: fields.ShareRange | None = None
    ashore: fields.ShareRange | None = None
    outside: fields.ShareRange | None = None
    left: fields.ShareRange | None = None
    area_50: fields.AreaRange | None = None  # [m2]
    area_95: fields.AreaRange | None = None
    mean_position_within: PlaceWithin | None = None


def misses(expected: Expect, end: Mapping[str, Any]) -> list[str]:
    """Return what a forecast's last output (see tables.numbers) misses, a line each; empty when all is as expected."""
    missed = []
    found = {name: end["probability"][name] for name in ("adrift", "ashore", "outside", "left")}
    found |= {f"area_{share}": _square_metres(end["area_nmi2"][f"{share}%"]) for share in (50, 95)}
    for name, value in found.items():
        span = getattr(expected, name)
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
