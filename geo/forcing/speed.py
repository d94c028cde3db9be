"""Units of speed, as files and users write them, to metres per second.

The spellings that nearly every file uses are looked up; pint (slow to import) is asked about the rest.
"""

import re

from geo.errors import UserError

COMMON = {  # [m/s]
    "m/s": 1.0, "m s-1": 1.0, "m s**-1": 1.0, "m s^-1": 1.0, "m.s-1": 1.0, "ms-1": 1.0, "meter second-1": 1.0,
    "metre second-1": 1.0, "meters/second": 1.0, "meters s-1": 1.0, "meter/second": 1.0, "m/sec": 1.0,
    "meters/sec": 1.0, "cm/s": 0.01, "cm s-1": 0.01, "kn": 1852 / 3600, "kt": 1852 / 3600, "kts": 1852 / 3600,
    "knot": 1852 / 3600, "knots": 1852 / 3600,
}  # fmt: skip


TOWER = re.compile(r"(\*\*|\^)[^A-Za-z]*(\*\*|\^)|\d{4}")  # arithmetic that no unit needs and that may take for ever


def factor(units: str) -> float:
    """Return what a value in these units is multiplied by to be in m/s; a UserError where it is no speed."""
    text = units.strip()
    if text.lower() in COMMON:
        return COMMON[text.lower()]
    import pint  # imported here: it takes a quarter of a second, which files in m/s need not pay

    spelled = re.sub(r"\bkn\b|\bkts\b", "knot", text)
    spelled = re.sub(r"(?<=[A-Za-z])\s*(\*\*|\^)?\s*([+-]?\d+)", r"**(\2)", spelled)  # s-1, s^-1, s**-1
    spelled = re.sub(r"(?<=[A-Za-z)])[\s.]+(?=[A-Za-z])", "*", spelled)
    try:
        if TOWER.search(spelled):
            raise ValueError
        return float(pint.UnitRegistry()(spelled).to("m/s").magnitude)
    except Exception as error:  # pint raises its own, tokenizer's and arithmetic errors
        raise UserError(f'units "{units}" are not a speed; allowed: m/s, cm/s, kn and the like') from error


def inside_text(text: str) -> str | None:
    """Return a unit of speed written in brackets in a long name, as RTOFS does: "velocity (m/s)"."""
    for inside in re.findall(r"[(\[]([^()\[\]]+)[)\]]", text):
        if inside.strip().lower() in COMMON:
            return str(inside.strip())
    return None
