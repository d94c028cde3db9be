"""Convert quantities, positions and times from the notation of a search planner to SI.

A quantity is "12 kn" or a bare SI number. A position is degrees and decimal minutes with hemisphere
letters, or [lon, lat] in degrees. A time is a date-time group or ISO 8601, always with a zone, or
relative to the start of the case ("+6 h"). Ambiguous text ("5 nm": nautical miles or nanometres) is
rejected. Errors are ValueErrors that say what was given and what is allowed; the caller adds the
place.
"""

import math
import re
from datetime import UTC, datetime, timedelta, timezone
from functools import lru_cache
from typing import Any

import numpy as np

from geo import notation, sphere

NUMBER = re.compile(r"\s*([+-]?(?:\d[\d_]*\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*", re.DOTALL)
POWER = re.compile(r"(?<=[A-Za-z])\^?(-?[1-4])(?![\d.])")  # m2/s, nmi^2
GROUP = re.compile(r"(\d{2})(\d{2})(\d{2})([A-Z])([A-Z]{3})(\d{4}|\d{2})")  # 211830ZNOV26
ANGLE = re.compile(
    r"(?P<before>[NSEW])?\s*(?P<degrees>[+-]?\d+(?:\.\d+)?)\s*[°d]?"
    r"(?:[\s-]*(?P<minutes>\d+(?:\.\d+)?)\s*['′]?)?"
    r"(?:[\s-]*(?P<seconds>\d+(?:\.\d+)?)\s*(?:[\"″]|'')?)?"
    r"\s*(?P<after>[NSEW])?"
)

ROOT = re.compile(  # the unit of a spread rate: a length over the square root of a time
    r"(?P<length>[^\s/^*()√]+?)\s*"
    r"(?:(?:/|per\s)\s*(?:sqrt\s*\(\s*(?P<root>[^()]+?)\s*\)|sqrt\s+(?P<bare>\w+)|√\s*\(?\s*(?P<sign>\w+)\s*\)?"
    r"|(?P<time>[A-Za-z]+)\s*(?:\^|\*\*)\s*(?:0?\.50*|\(?\s*1\s*/\s*2\s*\)?))"
    r"|[\s*](?P<inverse>[A-Za-z]+)\s*(?:\^|\*\*)?\s*\(?\s*-\s*(?:0?\.50*|1\s*/\s*2)\s*\)?)"
)
# powers of powers and large exponents: no unit needs them, and evaluation may never end
TOWER = re.compile(r"(\*\*|\^)[^A-Za-z]*(\*\*|\^)|\d{4}")

LONGEST = 200  # most letters of a quantity, a position or a time
MOST = 10**300  # largest whole number
CENTURY = 3_155_760_000  # [s]
FREEZING = 273.15  # [K] 0 degC

Instant = np.datetime64 | np.timedelta64  # a time, or an interval after the start of the case

# Nautical abbreviations with another meaning, or none, in SI.
MISREAD = {
    "nm": "nmi",
    "NM": "nmi",
    "Nm": "nmi",
    "M": "nmi or m",
    "miles": "nmi or mi",
    "mile": "nmi or mi",
}


# The units that most cases use, in SI. Pint converts all other units with the same results, but its
# import takes half a second.
USUAL = {
    ("nmi", "m"): 1852.0,
    ("km", "m"): 1000.0,
    ("m", "m"): 1.0,
    ("ft", "m"): 0.9144 * (1 / 3),
    ("nmi2", "m^2"): 1852.0**2,
    ("d", "s"): 86_400.0,
    ("h", "s"): 3600.0,
    ("min", "s"): 60.0,
    ("s", "s"): 1.0,
    ("/day", "1/s"): 1 / 86_400,
    ("/h", "1/s"): 1 / 3600,
    ("kn", "m/s"): 1852 / 3600,
    ("m/s", "m/s"): 1.0,
    ("%", ""): 0.01,
    ("deg", "deg"): 1.0,
}


@lru_cache(maxsize=1)
def registry() -> Any:
    """Return pint's unit registry, built at the first quantity with a unit outside USUAL."""
    import pint

    return pint.UnitRegistry()


def short(value: object, what: str, example: str) -> None:
    """Reject text longer than LONGEST and whole numbers beyond the range of floats.

    Both are typing errors, and parsing 100,000 letters would take minutes.

    Args:
        value: the value as written.
        what: kind of quantity, for the message.
        example: a correct value, for the message.
    """
    if isinstance(value, str) and len(value) > LONGEST:
        raise ValueError(
            f'"{value[:20]}..." has {len(value):,} letters, too many for {_with_article(what)}; write it like "{example}"'
        )
    if isinstance(value, int) and abs(value) > MOST:
        raise ValueError(
            f"{str(value)[:20]}... is too large for {_with_article(what)}; write it like {example!r}"
        )


def quantity(value: object, unit: str, what: str, example: str) -> float:
    """Return a quantity in SI.

    Args:
        value: "12 kn", or a bare number already in `unit`.
        unit: SI unit that the quantity must have ("m/s").
        what: kind of quantity, for the message ("speed").
        example: a correct value, for the message ("12 kn").

    Raises:
        ValueError: the value is not such a quantity.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f'{value!r} is not {_with_article(what)}; write it like "{example}"')
    short(value, what, example)
    number = _convert(value, unit, what, example) if isinstance(value, str) else float(value)
    if not math.isfinite(number):
        raise ValueError(f"{value!r} is not finite")
    return number


def _convert(text: str, unit: str, what: str, example: str) -> float:
    match = NUMBER.fullmatch(text)
    if match is None:
        raise ValueError(f'"{text}" is not {_with_article(what)}; write it like "{example}"')
    number, name = float(match[1].replace("_", "")), match[2]
    if not name:
        return number
    if name in MISREAD:
        raise ValueError(f'"{text}": the unit "{name}" can be misread; write {MISREAD[name]}')
    if usual := USUAL.get((name, unit)):
        return number * usual
    import pint

    try:
        spelled = re.sub(r"^(/|per\s+)\s*", "1/", name.replace("²", "2"))
        if TOWER.search(spelled):
            raise ValueError
        given = registry().Unit(POWER.sub(r"**\1", spelled))
        factor = registry().Quantity(1.0, given).to(unit).magnitude
    except pint.DimensionalityError:
        raise ValueError(
            f'"{text}" is not {_with_article(what)}: "{name}" is a unit of another kind; write it like "{example}"'
        ) from None
    except Exception:  # pint raises many kinds of errors for text that is not a unit
        raise ValueError(
            f'"{text}": there is no unit "{name}"; write the {what} like "{example}"'
        ) from None
    return number * float(factor)


def temperature(value: object) -> float:
    """Return a temperature [K] from text with a unit, like "12 degC".

    A bare number is rejected, because it could be in any of three units.
    """
    short(value, "temperature", "12 degC")
    match = NUMBER.fullmatch(value) if isinstance(value, str) else None
    if match is None or not match[2]:
        raise ValueError(f'{value!r} is not a temperature with its unit; write it like "12 degC"')
    try:
        if TOWER.search(match[2]):
            raise ValueError
        name = match[2].replace("°", "deg")
        kelvin = float(
            registry().Quantity(float(match[1].replace("_", "")), name).to("kelvin").magnitude
        )
    except Exception:  # pint raises many kinds of errors for text that is not a unit
        raise ValueError(f'"{value}" is not a temperature; write it like "12 degC"') from None
    if not math.isfinite(kelvin):
        raise ValueError(f"{value!r} is not finite")
    return kelvin


def spread_rate(value: object) -> float:
    """Return the spread rate K of a Brownian bridge [m/sqrt(s)], at least 0.

    The root is parsed here, because pint's fractional powers are inexact and it has no "sqrt". A
    speed or a diffusivity is rejected.

    Args:
        value: "12 nmi/sqrt(h)", "12 nmi/h^0.5", or a bare number in m/sqrt(s).
    """
    what, example = "spread rate", "12 nmi/sqrt(h)"
    short(value, what, example)
    match = NUMBER.fullmatch(value) if isinstance(value, str) else None
    if match is None or not match[2]:
        number = quantity(value, "m", what, example)
    else:
        unit = ROOT.fullmatch(match[2])
        if unit is None:
            raise ValueError(
                f'"{value}" is not {_with_article(what)}: "{match[2]}" is no length over the square root of a time; write it like '
                f'"{example}"'
            )
        time_unit = next(
            unit[name] for name in ("root", "bare", "sign", "time", "inverse") if unit[name]
        )
        length = quantity(f"1 {unit['length']}", "m", f"length of {_with_article(what)}", example)
        seconds = quantity(f"1 {time_unit}", "s", f"time of {_with_article(what)}", example)
        number = float(match[1].replace("_", "")) * length / math.sqrt(seconds)
        if not math.isfinite(number):
            raise ValueError(f"{value!r} is not finite")
    if number < 0:
        raise ValueError(f"{what} {value!r} must be at least 0 m/sqrt(s)")
    return number


def _with_article(what: str) -> str:
    return f"{'an' if what[:1] in 'aeiou' else 'a'} {what}"


def angle(value: object, letters: str) -> float:
    """Return a longitude (letters "EW") or latitude (letters "NS") [deg].

    Args:
        value: a number [deg], or text with a hemisphere letter: "88 15.0W".
        letters: the hemisphere letters, "EW" or "NS".
    """
    what, limit = ("latitude", 90.0) if letters == "NS" else ("longitude", 180.0)
    if isinstance(value, bool):
        raise ValueError(f"{value!r} is not a {what}")
    short(value, what, "27 30.5N" if letters == "NS" else "088 15.0W")
    if isinstance(value, int | float):
        # A bare longitude may be up to 360, as in many model files.
        if not (-limit <= value <= limit or (letters == "EW" and 180 < value <= 360)):
            raise ValueError(
                f"{what} {value!r} is outside {-limit:g} to {360 if letters == 'EW' else limit:g}"
            )
        return sphere.wrap_degrees(value) if abs(value) > 180 else float(value)
    match = ANGLE.fullmatch(str(value).strip().upper().replace("º", "°").replace("’", "'"))
    if (
        match is None
        or not (match["before"] or match["after"])
        or (match["before"] and match["after"])
    ):
        raise ValueError(
            f'"{value}" is not a {what}; write it like {"27 30.5N" if letters == "NS" else "088 15.0W"}'
        )
    return _signed(match, letters, what, limit)


def edge(value: object) -> float:
    """Return the longitude of a box edge [deg], like `angle`, but keep numbers above 180."""
    lon = angle(value, "EW")
    return float(value) if isinstance(value, int | float) and value > 180 else lon


def _signed(match: re.Match[str], letters: str, what: str, limit: float) -> float:
    letter = match["before"] or match["after"]
    text = match[0].strip()
    if letter not in letters:
        raise ValueError(
            f'"{text}" is not a {what}: it ends in {letter}, not in {letters[0]} or {letters[1]}'
        )
    degrees, minutes, seconds = match["degrees"], match["minutes"] or "0", match["seconds"] or "0"
    if degrees[0] in "+-":
        raise ValueError(f'"{text}" has both a sign and a letter; leave the sign out')
    if ("." in degrees and match["minutes"]) or ("." in minutes and match["seconds"]):
        raise ValueError(
            f'"{text}": only the last of degrees, minutes and seconds may have decimals'
        )
    if float(minutes) >= 60 or float(seconds) >= 60:
        raise ValueError(f'"{text}": minutes and seconds must be below 60')
    size = float(degrees) + float(minutes) / 60 + float(seconds) / 3600
    if size > limit:
        raise ValueError(f'{what} "{text}" is outside {-limit:g} to {limit:g}')
    return -size if letter in "SW" else size


def position(value: object) -> tuple[float, float]:
    """Return (lon, lat) [deg], lon in [-180, 180).

    Args:
        value: "27 30.5N 088 15.0W" in either order, [lon, lat] in degrees, or { lat = .., lon = ..
            }.
    """
    short(value, "position", "27 30.5N 088 15.0W")
    if isinstance(value, dict):
        if set(value) != {"lon", "lat"}:
            raise ValueError("a position table has exactly the keys lon and lat")
        lon, lat = angle(value["lon"], "EW"), angle(value["lat"], "NS")
    elif isinstance(value, list | tuple):
        if len(value) != 2:
            raise ValueError(f"{list(value)!r} is not a position; write [lon, lat] in degrees")
        try:
            lon, lat = angle(value[0], "EW"), angle(value[1], "NS")
        except ValueError as error:
            raise ValueError(f"{error} (the order is [lon, lat])") from None
    elif isinstance(value, str):
        lon, lat = _pair(value)
    else:
        raise ValueError(f'{value!r} is not a position; write it like "27 30.5N 088 15.0W"')
    return sphere.wrap_degrees(lon), lat


def _pair(text: str) -> tuple[float, float]:
    """Return (lon, lat) [deg] of two angles with hemisphere letters before or after each."""
    plain = text.strip().upper().replace("º", "°").replace("’", "'")
    if fault := _position_fault(plain):
        raise ValueError(f'position "{text}" {fault}; write it like "27 30.5N 088 15.0W"')
    letters = re.findall(r"[NSEW]", plain)
    if plain[0] in "NSEW":
        halves = re.split(r"[\s,;/]*(?=[NSEW])", plain[1:], maxsplit=1)
        halves[0] = plain[0] + halves[0]
    else:
        halves = re.split(r"(?<=[NSEW])[\s,;/]*", plain, maxsplit=1)
    latitude_first = letters[0] in "NS"
    lat, lon = halves if latitude_first else reversed(halves)
    try:
        return angle(lon, "EW"), angle(lat, "NS")
    except ValueError as error:
        raise ValueError(f"{error}{_hint_if_exchanged(lon, lat)}") from None


def _position_fault(text: str) -> str:
    """Return the fault of a position text in capitals, for a message; "" if there is none."""
    if not text:
        return "is empty"
    if not re.search(r"\d", text):
        return "holds no number"
    words = [
        word for word in re.findall(r"[^\W\d_]+", text) if word not in {"N", "S", "E", "W", "D"}
    ]
    if words:
        return f'holds "{words[0]}", which is neither a number nor one of N, S, E and W'
    letters = re.findall(r"[NSEW]", text)
    if not letters:
        return "is ambiguous: no letter says which number is the latitude, N or S, and which the longitude, E or W"
    if len(letters) > 2:
        return (
            f"has {len(letters)} letters of N, S, E and W; a latitude and a longitude have one each"
        )
    if len(letters) == 1:
        there, lacks = (
            ("latitude", "longitude, E or W")
            if letters[0] in "NS"
            else ("longitude", "latitude, N or S")
        )
        return f"has a {there} and lacks its {lacks}"
    if (letters[0] in "NS") == (letters[1] in "NS"):
        there, lacks = (
            ("latitudes", "longitude") if letters[0] in "NS" else ("longitudes", "latitude")
        )
        return f"has two {there} and no {lacks}"
    if comma := re.search(r"\d+,\d+", text):
        return f"has a decimal comma; with a point it is {comma[0].replace(',', '.')}"
    return ""


def _hint_if_exchanged(lon: str, lat: str) -> str:
    """Return a hint if two angles are valid with their hemisphere letters exchanged, else ""."""
    swap = str.maketrans("NSEW", "EWNS")
    try:
        angle(lat.translate(swap), "EW")
        angle(lon.translate(swap), "NS")
    except ValueError:
        return ""
    return " (have the letters of latitude and longitude been exchanged?)"


def time(value: object) -> Instant:
    """Return a UTC time in whole seconds, or for "+6 h" an interval after the start of the case.

    Args:
        value: "211830ZNOV26" (any military zone letter but J), "2026-11-21T18:30Z" or with an
            offset, a TOML date-time with an offset, or "+6 h" / "-30 min".
    """
    if isinstance(value, datetime):
        return _utc(value, value.isoformat())
    if not isinstance(value, str):
        raise ValueError(
            f'{value!r} is not a time; write it like "211830ZNOV26", or in ISO 8601 with its zone'
        )
    short(value, "time", "211830ZNOV26")
    text = value.strip()
    if text[:1] in {"+", "-"}:
        if re.fullmatch(r"[\d.]*[1-9][\d.]*", text[1:].strip()):  # minutes or hours?
            raise ValueError(f'"{text}" has no unit; write it like "{text} min"')
        seconds = quantity(text, "s", "interval after the start", "+6 h")
        if abs(seconds) > CENTURY:
            raise ValueError(f'"{text}" is more than a century')
        return np.timedelta64(round(seconds), "s")
    group = re.sub(r"\s+", "", text.upper())
    if match := GROUP.fullmatch(group):
        return _utc(_group(match, text), text)
    if re.fullmatch(r"\d{6}[A-Z]?([A-Z]{3})?", group):
        raise ValueError(
            f'time "{text}" lacks its zone, month or year; write it like "211830ZNOV26"'
        )
    try:
        moment = datetime.fromisoformat(re.sub(r"[zZ]$", "+00:00", text))
    except ValueError:
        raise ValueError(
            f'"{text}" is not a time; write it like "211830ZNOV26", in ISO 8601 with its zone, or like "+6 h" (after '
            "the start)"
        ) from None
    return _utc(moment, text)


def _group(match: re.Match[str], text: str) -> datetime:
    day, hour, minute, letter, month, year = match.groups()
    if month not in notation.MONTHS:
        raise ValueError(f'time "{text}": there is no month "{month}"')
    if letter == "J":
        raise ValueError(
            f'time "{text}": zone J means local time; write the zone letter, Z for UTC'
        )
    # A to M without J are 1 to 12 hours ahead of UTC, N to Y 1 to 12 behind (ACP 121(I), 2010,
    # table of zones).
    ahead = "ZABCDEFGHIKLM".find(letter)
    hours = ahead if ahead >= 0 else -("NOPQRSTUVWXY".index(letter) + 1)
    century = int(year) if len(year) == 4 else 2000 + int(year)
    zone = timezone(timedelta(hours=hours))
    try:
        return datetime(
            century, notation.MONTHS.index(month) + 1, int(day), int(hour), int(minute), tzinfo=zone
        )
    except ValueError as error:
        raise ValueError(f'time "{text}" does not exist: {error}') from None


def _utc(moment: datetime, text: str) -> np.datetime64:
    if moment.tzinfo is None:
        raise ValueError(f'time "{text}" has no zone; add Z for UTC, or an offset like +02:00')
    if not 1800 <= moment.year <= 2200:
        raise ValueError(f'time "{text}" is in the year {moment.year}; 1800 to 2200 are allowed')
    naive = moment.astimezone(UTC).replace(tzinfo=None)
    return np.datetime64(naive, "s")


def resolve(instant: Instant, start: np.datetime64) -> np.datetime64:
    """Return a time in UTC: the time itself, or the start plus an interval."""
    return start + instant if isinstance(instant, np.timedelta64) else instant
