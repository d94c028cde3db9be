"""Units of table columns, derived from their names: names in the CSV files end in the unit."""

import re
from collections.abc import Iterable, Mapping

# pattern of a whole name: its unit, as pint reads it; for positions as in CF
BY_NAME: Mapping[str, str] = {
    r"(.*_)?lon(_deg)?": "degrees_east",
    r"(.*_)?lat(_deg)?": "degrees_north",
    r"expected_per_km": "1/km",
    r".*_nmi2": "nmi**2",
    r".*_km2": "km**2",
    r".*_km": "km",
    r".*_m": "m",
    r".*_h": "h",
    r"poc|pod|pos(_.*)?|prior|posterior|share|cumulative|distinct|probability(_.*)?": "1",
    r"log_evidence|bayes_factor|factor|ess(_.*)?|effective_.*|standard_error": "1",
    r"(expected|arrived|number|ever)(_.*)?": "1",
}
COMPILED = [(re.compile(pattern), unit) for pattern, unit in BY_NAME.items()]


def units_of(numbers: Iterable[str]) -> dict[str, str]:
    """Return the units of numeric columns whose names determine them.

    `mean`, `std` and the quantiles of posteriors.csv are excluded: their unit differs by row and is
    in the column `unit`.
    """
    found = {
        name: [unit for pattern, unit in COMPILED if pattern.fullmatch(name)] for name in numbers
    }
    return {name: units[0] for name, units in found.items() if units}
