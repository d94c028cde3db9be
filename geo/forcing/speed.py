"""Conversion of units, as files and users write them, to those of a quantity: mostly m/s.

Usual spellings are looked up in a table; pint, which is slow to import, parses all others.
"""

import re
import unicodedata
from functools import cache
from typing import Any

from geo.errors import UserError

COMMON = {  # [m/s]
    "m/s": 1.0,
    "m s-1": 1.0,
    "m s**-1": 1.0,
    "m s^-1": 1.0,
    "m.s-1": 1.0,
    "ms-1": 1.0,
    "meter second-1": 1.0,
    "metre second-1": 1.0,
    "meters/second": 1.0,
    "meters s-1": 1.0,
    "meter/second": 1.0,
    "m/sec": 1.0,
    "meters/sec": 1.0,
    "cm/s": 0.01,
    "cm s-1": 0.01,
    "kn": 1852 / 3600,
    "kt": 1852 / 3600,
    "kts": 1852 / 3600,
    "knot": 1852 / 3600,
    "knots": 1852 / 3600,
    "nm/h": 1852 / 3600,
    "nm/hr": 1852 / 3600,
    "nm per hour": 1852 / 3600,
    "metres per second": 1.0,
    "meters per second": 1.0,
    "metre per second": 1.0,
    "meter per second": 1.0,
}
# Rewrite what files write and pint does not read: words, superscripts and dots
WORDS = (
    (
        re.compile(r"[\u2070\u00b9\u00b2\u00b3\u2074-\u2079\u207b]+"),
        lambda hit: unicodedata.normalize("NFKC", hit[0]).replace("\u2212", "-"),
    ),
    (re.compile(r"[\u00b7\u22c5\u2022]"), lambda hit: " "),
    (re.compile(r"(?<=[A-Za-z)\d])\s*\bper\b\s*", re.IGNORECASE), lambda hit: "/"),
    (
        re.compile(r"\bnautical[\s_-]+miles?\b|\bn\.?\s?miles?\b", re.IGNORECASE),
        lambda hit: "nautical_mile",
    ),
    (re.compile(r"\b(kn|kts?|knots?)\b", re.IGNORECASE), lambda hit: "knot"),
    (re.compile(r"\bsecs?\b", re.IGNORECASE), lambda hit: "second"),
    (re.compile(r"\bhrs?\b", re.IGNORECASE), lambda hit: "hour"),
)


# powers of powers and long numbers, which no unit needs and which may take forever to evaluate
TOWER = re.compile(r"(\*\*|\^)[^A-Za-z]*(\*\*|\^)|\d{4}")


@cache
def _registry() -> Any:
    """Return the units that pint knows. It takes half a second, which files in m/s do not need."""
    import pint

    return pint.UnitRegistry()


def factor_to(unit: str, units: str) -> float:
    """Return the factor that converts values in some units to a unit.

    Args:
        unit: of a quantity: "m/s", "1" for a share, or any other that pint knows.
        units: as a file or a user writes them.

    Raises:
        UserError: the units cannot be converted.
    """
    text = units.strip()
    if unit != "m/s":
        return _factor_of_scalar(unit, text)
    if text.lower() in COMMON:
        return COMMON[text.lower()]
    spelled = text
    for pattern, word in WORDS:
        spelled = pattern.sub(word, spelled)
    # s-1, s^-1, s**-1
    spelled = re.sub(r"(?<=[A-Za-z])\s*(\*\*|\^)?\s*([+-]?\d+)", r"**(\2)", spelled)
    spelled = re.sub(r"(?<=[A-Za-z)])[\s.]+(?=[A-Za-z])", "*", spelled)
    try:
        if TOWER.search(spelled):
            raise ValueError
        registry = _registry()
        try:
            return float(registry(spelled).to("m/s").magnitude)
        except AttributeError:  # pint's for a unit that it does not know
            return float(registry(spelled.lower()).to("m/s").magnitude)  # Metres Per Second, KM/H
    except Exception as error:  # pint raises its own errors, and those of tokenizer and arithmetic
        raise UserError(
            f'units "{units}" are not a speed; allowed: m/s, cm/s, kn and the like'
        ) from error


def _factor_of_scalar(unit: str, text: str) -> float:
    registry = _registry()
    try:
        if TOWER.search(text):
            raise ValueError
        own, wanted = (
            registry.Quantity(1, "" if one in ("1", "") else one) for one in (text, unit)
        )
        return float(own.to(wanted.units).magnitude)
    except Exception as error:  # as above
        raise UserError(f'units "{text}" cannot be converted to "{unit}"') from error


def inside_text(text: str) -> str | None:
    """Return a unit of speed in brackets in a long name, as in RTOFS: "velocity (m/s)"."""
    for inside in re.findall(r"[(\[]([^()\[\]]+)[)\]]", text):
        if inside.strip().lower() in COMMON:
            return str(inside.strip())
    return None
