"""The result of a backward run as text, for the terminal, report and picture, and as CSV.

Lengths have three digits, in nautical miles and kilometres; origin.csv has six digits.
"""

from collections.abc import Mapping

import numpy as np

from drift.products.files import formats
from geo import notation
from geo.notation import NMI

DIGITS = 7  # decimals of a degree: 1 cm
Row = Mapping[str, float | str]  # of drift.spills.backtrack.backward.summary_of_origin


def origin_facts(row: Row) -> dict[str, str]:
    """Return the figures of a release as text, by name."""
    value = {name: float(number) for name, number in row.items() if not isinstance(number, str)}
    error = float(np.hypot(value["east_error_km"], value["north_error_km"]))
    spread = value["time_std_h"] > 0
    shares = ", ".join(f"{share} % before {_group(row[f'time_{share}'])}" for share in (10, 50, 90))
    released = (
        f"{_group(row['time'])} on average, {shares}"
        if spread
        else f"{_group(row['time'])}, as given"
    )
    return {
        "mean position": notation.position(value["lon_deg"], value["lat_deg"]) or "",
        "half within": f"{length_in_words(value['radius_50_km'])} of it",
        "90 % within": f"{length_in_words(value['radius_90_km'])} of it",
        "50 % area": _area(value["area_50_km2"]),
        "90 % area": _area(value["area_90_km2"]),
        "standard deviation": f"{length_in_words(value['east_std_km'])} east, {length_in_words(value['north_std_km'])} north"
        + (f", {number(value['time_std_h'])} h" if spread else ""),
        "released": released,
        "error of the mean": f"+- {length_in_words(error)}"
        + (f", +- {number(value['time_error_h'])} h" if spread else "")
        + " (Monte Carlo)",
        "gained from the finds": f"{number(value['information_bit'])} bit beyond the case's own prior",
        "worlds": f"{value['effective_worlds']:,.0f} of {value['worlds']:,.0f} effective",
    }


def origin_csv(row: Row, run: str) -> str:
    """Return the figures as CSV: positions to 1 cm, the others to six digits."""
    place = {name: f"{round(float(row[name]), DIGITS):.10g}" for name in ("lon_deg", "lat_deg")}
    return formats.csv_rows([{**row, **place}], run=run, digits=".6g")


def _group(iso: float | str) -> str:
    return notation.format_dtg(np.datetime64(str(iso).removesuffix("Z"), "s"))


def length_in_words(km: float) -> str:
    """Return a length [km] as text in nautical miles and kilometres."""
    return f"{number(1000 * km / NMI)} nmi ({number(km)} km)"


def _area(km2: float) -> str:
    return f"{number(1e6 * km2 / NMI**2)} nmi2 ({number(km2)} km2)"


def number(value: float) -> str:
    """Return a number with three digits: 1,230, 12.3, 0.0123."""
    if not np.isfinite(value) or value == 0:
        return f"{value:g}"
    digits = 2 - int(np.floor(np.log10(abs(value))))
    return f"{round(value, digits):,.{max(digits, 0)}f}" if digits < 9 else f"{value:.3g}"
