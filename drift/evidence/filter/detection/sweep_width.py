"""Visual sweep widths from the published tables, with their corrections.

They depend on unit, height, visibility and object. The tables are the project's own copies,
data/sweep_width.csv and data/sweep_width_corrections.csv. All arguments and results are SI. Rules
where the tables leave a choice:

- visibility: a row holds up to the next one; below the least of the tables (1 nmi) it is rejected;
- height: linear between the tabulated ones. Below an aircraft's lowest (300 ft) and above a boat's
  highest eye (14 ft) the value of that end holds, which is generous for small objects (the tables
  fall from 500 to 300 ft for some); beyond the other end it is rejected;
- speed: linear between the tabulated ones, constant beyond them. A speed that is missing has the
  value of the one before it. Boats have no correction;
- weather: the worse of wind and seas; fatigue multiplies by 0.9.
"""

import bisect
import csv
import difflib
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from typing import Literal

import numpy as np

from drift.engine.motion.objects import everyday, leeway
from geo.errors import UserError
from geo.notation import KNOT, NMI

SOURCE = (
    "US Coast Guard Addendum to IAMSAR, COMDTINST M16130.2F (public domain), as transcribed by "
    "canterbury-air-patrol/marine-sweep-width-data"
)
FOOT = 0.3048  # [m]
METRES = ("m", "metre", "metres", "meter", "meters")
MEANT = {  # everyday names of a kind of object
    "boat": "Power Boat",
    "motorboat": "Power Boat",
    "motoryacht": "Power Boat",
    "yacht": "Sail Boat",
    "liferaft": "Raft",
    "vessel": "Ship",
    "freighter": "Ship",
    "piw": "Person in Water",
}
KINDS = ("Aircraft", "Helicopter", "Boat")
FATIGUE = 0.9
# weather is moderate from the first on, bad above the second
WIND, SEAS = (15 * KNOT, 25 * KNOT), (2 * FOOT, 4 * FOOT)
WEATHER = {"small": (1.0, 0.5, 0.25), "large": (1.0, 0.9, 0.9)}
# [kn] columns of the tables
SPEEDS = {"Aircraft": (150, 180, 210), "Helicopter": (60, 90, 120, 140), "Boat": ()}


@dataclass(frozen=True)
class Conditions:
    """The conditions in which a sortie searches."""

    visibility: float  # [m]
    altitude: float  # [m]; of a boat, the height of eye
    speed: float = float("nan")  # [m/s]; needed by aircraft
    wind: float | None = None  # [m/s]
    seas: float | None = None  # [m] wave height
    fatigue: bool = False


def lookup(name: str, kind: str, altitude: float, visibility: float) -> float:
    """Return the uncorrected sweep width [m] of an object for a kind of unit.

    Args:
        name: of the object, as in the tables.
        kind: of the unit, as in the tables.
        altitude: height of the unit or its eye [m].
        visibility: meteorological visibility [m].

    Raises:
        UserError: an unknown name or kind, or conditions outside the tables.
    """
    rows = _table()[find(name), find_kind(kind)]
    if visibility < NMI * (1 - 1e-9):
        raise UserError(
            f"visibility {visibility / NMI:g} nmi: the sweep width tables begin at 1 nmi; give the sweep width itself"
        )
    heights = sorted(rows)
    low, high = heights[0], heights[-1]
    if (altitude < low * (1 - 1e-9) and kind == "Boat") or (
        altitude > high * (1 + 1e-9) and kind != "Boat"
    ):
        what = "height of eye" if kind == "Boat" else "altitude"
        raise UserError(
            f"{what} {altitude / FOOT:.0f} ft: the sweep width tables of {kind} are for {low / FOOT:.0f} to "
            f"{high / FOOT:.0f} ft; give the sweep width itself"
        )
    widths = [_width_at_visibility(rows[height], visibility) for height in heights]
    return float(np.interp(altitude, heights, widths))


def width(name: str, kind: str, seen: Conditions) -> float:
    """Return the corrected sweep width [m] of an object for a kind of unit."""
    uncorrected = lookup(name, kind, seen.altitude, seen.visibility)
    rough = FATIGUE if seen.fatigue else 1.0
    return (
        uncorrected
        * speed_factor(name, kind, seen.speed)
        * weather_factor(name, seen.wind, seen.seas)
        * rough
    )


def speed_factor(name: str, kind: str, speed: float) -> float:
    """Return the correction factor for a speed [m/s]."""
    factors = _corrections()[find(name)].speeds.get(find_kind(kind))
    if factors is None:
        return 1.0
    if not speed > 0:
        raise UserError(
            f"the sweep width tables of {kind} need its speed; give speed, or the sweep width itself"
        )
    return float(
        np.interp(speed / KNOT, [knots for knots, _ in factors], [factor for _, factor in factors])
    )


def weather_factor(name: str, wind: float | None, seas: float | None) -> float:
    """Return the correction factor for wind [m/s] and seas [m].

    None where one is not known, which then has no effect.
    """
    worst = 0
    for value, (moderate, bad) in ((wind, WIND), (seas, SEAS)):
        if value is not None:
            worst = max(worst, (value >= moderate * (1 - 1e-9)) + (value > bad * (1 + 1e-9)))
    return WEATHER[_corrections()[find(name)].weather][worst]


def objects() -> tuple[str, ...]:
    """Return the names of the objects, in the tables' order."""
    return tuple(_corrections())


def find(name: str) -> str:
    """Return an object's name as in the tables, ignoring case, spaces and signs.

    Raises:
        UserError: the tables have no such object.
    """
    names = {_plain(key): key for key in objects()}
    if _plain(name) in names:
        return names[_plain(name)]
    raise UserError(f'no search object "{name}" in the sweep width tables; {_advice(name)}')


def _advice(name: str) -> str:
    """Return a suggestion for an unknown name: the object nearest in size or in meaning."""
    text = unicodedata.normalize("NFKC", name).lower()
    size = re.search(r"(\d+(?:[.,]\d+)?(?:e\d+)?)\s*-?\s*([^\W\d_]*)", text)
    letters = _letters(text.replace(size[0], "") if size else text)
    kinds: dict[str, list[str]] = {}
    for one in objects():
        kinds.setdefault(_kind(one), []).append(one)
    spelled = {_letters(kind.lower()): kind for kind in kinds} | MEANT
    everyday_names = everyday.search_objects_of(name, tuple(leeway.classes()))
    if everyday_names == ():
        return f'none of them fits "{name}": give sweep_width itself'
    if everyday_names and letters not in spelled:
        ordered = [one for one in objects() if one in everyday_names]
        return f'for "{name}" choose {_quoted(ordered)}; see: drift objects {name}'
    near = difflib.get_close_matches(letters, spelled, n=1, cutoff=0.6)
    if not near:
        return (
            'they have Person in Water, and by size Raft (like "Raft 4 person"), Power Boat ("Power Boat 20ft"), '
            'Sail Boat ("Sail Boat 40ft"), Ship ("Ship 120ft")'
        )
    kind = spelled[near[0]]
    own = kinds[kind]
    if len(own) == 1:
        return f"nearest is {_quoted(own)}"
    if size is None:
        return f"give its size: {_quoted(own)}"
    in_metres = size[2] in METRES and kind != "Raft"
    chosen = _nearest(own, float(size[1].replace(",", ".")) / (FOOT if in_metres else 1))
    return f"nearest {'is' if len(chosen) == 1 else 'by size are'} {_quoted(chosen)}"


def _letters(text: str) -> str:
    return "".join(letter for letter in text if letter.isalpha())


def _nearest(names: Sequence[str], size: float) -> list[str]:
    """Return the objects of a kind, ascending, that are next to a size: one or two."""
    sizes = [_size(name) for name in names]
    above = bisect.bisect_left(sizes, size)
    if above == len(names):
        return [names[-1]]
    if above == 0 or sizes[above] == size:
        return [names[above]]
    return [names[above - 1], names[above]]


def _kind(name: str) -> str:
    """Return an object's name without its size, such as "Power Boat"."""
    return re.split(r"\s*[≤≥]?\s*\d", name)[0]


def _size(name: str) -> float:
    """Return the size in an object's name [feet or persons]."""
    found = re.search(r"\d+", name)
    return float(found[0]) if found else 0.0


def _quoted(names: Sequence[str]) -> str:
    """Return names in quotes: "A", "B" or "C"."""
    *others, last = (f'"{name}"' for name in names)
    return f"{', '.join(others)} or {last}" if others else last


def find_kind(kind: str) -> str:
    """Return a kind of unit as in the tables.

    Raises:
        UserError: the tables have no such kind.
    """
    for listed in KINDS:
        if kind.strip().lower() == listed.lower():
            return listed
    raise UserError(
        f'no unit kind "{kind}" in the sweep width tables; there are: {", ".join(KINDS)}'
    )


def _plain(name: str) -> str:
    """Return a name without spelling variants: persons, people, =<, <=, spaces."""
    text = (
        unicodedata.normalize("NFKC", name)
        .lower()
        .replace("persons", "person")
        .replace("people", "person")
    )
    return "".join(letter for letter in text if letter.isalnum())


def _width_at_visibility(rows: list[tuple[float, float]], visibility: float) -> float:
    """Return the sweep width [m] of the last row whose visibility is not above the given one."""
    return [width for least, width in rows if least <= visibility * (1 + 1e-9)][-1]


@dataclass(frozen=True)
class _Correction:
    weather: Literal["small", "large"]
    speeds: dict[str, list[tuple[float, float]]]  # by kind: (speed [kn], factor)


def _rows(name: str) -> list[dict[str, str]]:
    text = resources.files("drift.data").joinpath(name).read_text(encoding="utf-8")
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


@lru_cache(maxsize=1)
def _table() -> dict[tuple[str, str], dict[float, list[tuple[float, float]]]]:
    """Return (visibility [m], sweep width [m]), ascending, by height [m], by object and kind."""
    table: dict[tuple[str, str], dict[float, list[tuple[float, float]]]] = {}
    for row in _rows("sweep_width.csv"):
        heights = table.setdefault((row["object"], row["unit"]), {})
        entry = (float(row["visibility_nmi"]) * NMI, float(row["sweep_width_nmi"]) * NMI)
        heights.setdefault(float(row["height"].removesuffix("ft")) * FOOT, []).append(entry)
    return {
        key: {height: sorted(rows) for height, rows in heights.items()}
        for key, heights in table.items()
    }


@lru_cache(maxsize=1)
def _corrections() -> dict[str, _Correction]:
    corrections: dict[str, _Correction] = {}
    for row in _rows("sweep_width_corrections.csv"):
        weather: Literal["small", "large"] = "small" if row["weather_class"] == "small" else "large"
        entry = corrections.setdefault(row["object"], _Correction(weather, {}))
        entry.speeds.setdefault(row["unit"], []).append(
            (float(row["speed_kn"]), float(row["factor"]))
        )
    for entry in corrections.values():
        for kind, factors in entry.speeds.items():
            given = dict(factors)
            factor, filled = 1.0, []
            for speed in SPEEDS[kind]:  # a missing speed has the factor of the one before
                factor = given.get(speed, factor)
                filled.append((float(speed), factor))
            entry.speeds[kind] = filled
    return corrections
