"""Units of speed, as files and users write them, to metres per second.

The spellings that nearly every file uses are looked up; pint (slow to import) is asked about the
rest.
"""

import re
import unicodedata
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
# As files write what pint knows otherwise: words, superscripts and dots
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


# arithmetic that no unit needs and that may take for ever
TOWER = re.compile(r"(\*\*|\^)[^A-Za-z]*(\*\*|\^)|\d{4}")


def factor(units: str) -> float:
    """Return what a value in these units is multiplied by to be in m/s; a UserError where it is no
    speed.
    """
    text = units.strip()
    if text.lower() in COMMON:
        return COMMON[text.lower()]
    import pint  # imported here: it takes a quarter of a second, which files in m/s need not pay

    spelled = text
    for pattern, word in WORDS:
        spelled = pattern.sub(word, spelled)
    # s-1, s^-1, s**-1
    spelled = re.sub(r"(?<=[A-Za-z])\s*(\*\*|\^)?\s*([+-]?\d+)", r"**(\2)", spelled)
    spelled = re.sub(r"(?<=[A-Za-z)])[\s.]+(?=[A-Za-z])", "*", spelled)
    try:
        if TOWER.search(spelled):
            raise ValueError
        registry: Any = pint.UnitRegistry()
        try:
            return float(registry(spelled).to("m/s").magnitude)
        except pint.UndefinedUnitError:
            return float(registry(spelled.lower()).to("m/s").magnitude)  # Metres Per Second, KM/H
    except Exception as error:  # pint raises its own, tokenizer's and arithmetic errors
        raise UserError(
            f'units "{units}" are not a speed; allowed: m/s, cm/s, kn and the like'
        ) from error


def inside_text(text: str) -> str | None:
    """Return a unit of speed written in brackets in a long name, as RTOFS does: "velocity (m/s)"."""
    for inside in re.findall(r"[(\[]([^()\[\]]+)[)\]]", text):
        if inside.strip().lower() in COMMON:
            return str(inside.strip())
    return None
