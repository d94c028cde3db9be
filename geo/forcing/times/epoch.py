"""Units of time as files write them: "hours since 2024-03-10 00:00:00 -6:00".

The grammar is that of UDUNITS, as CF requires: a unit with a factor, a shift ("since", "after",
"from", "ref", "@"), a date, a time of day, and a zone, positive if ahead of UTC. In addition, a
date may be written with slashes or blanks, year first. Zones without a meaning in UDUNITS (MDT,
local, UTC+8) are rejected: ignoring them would shift all times.
"""

import re
from dataclasses import dataclass, replace

from geo.errors import UserError

# [s]; months and years have no fixed length
SECONDS = {
    "nanosecond": 1e-9,
    "microsecond": 1e-6,
    "millisecond": 1e-3,
    "second": 1.0,
    "minute": 60.0,
    "hour": 3600.0,
    "day": 86400.0,
    "week": 604800.0,
    "fortnight": 1209600.0,
}
SHORT = {
    "ns": "nanosecond",
    "nsec": "nanosecond",
    "us": "microsecond",
    "usec": "microsecond",
    "microsec": "microsecond",
    "ms": "millisecond",
    "msec": "millisecond",
    "millisec": "millisecond",
    "s": "second",
    "sec": "second",
    "min": "minute",
    "h": "hour",
    "hr": "hour",
    "d": "day",
}
UNEVEN = ("month", "mon", "year", "yr", "common_year")  # units without a fixed length
FARTHEST = 18 * 3600  # [s] largest difference of a zone from UTC

_SHIFT = re.compile(r"^\s*(.*?)\s*(?:\b(?:since|after|from|ref)\b|@)\s*(\S.*?)\s*$", re.IGNORECASE)
_UNIT = re.compile(r"^(?:(\d+(?:\.\d*)?(?:[eE][+-]?\d+)?)\s*\*?\s*)?([A-Za-z]+)$")
_DATE = (
    r"(?P<year_s>\d{4})(?P<mark>[/ ])(?P<month_s>\d{1,2})(?P=mark)(?P<day_s>\d{1,2})"
    r"|(?P<year>[+-]?\d{1,4})(?:-(?P<month>\d{1,2})(?:-(?P<day>\d{1,2}))?)?"
    r"|(?P<year_p>\d{4})(?P<month_p>\d{2})(?P<day_p>\d{2})?"
)
_CLOCK = (
    r"(?P<hour>\d{1,2})(?::(?P<minute>\d{1,2})(?::(?P<second>\d{1,2}(?:\.\d*)?))?)?"
    r"|(?P<hour_p>\d{2})(?P<minute_p>\d{2})(?P<second_p>\d{2}(?:\.\d*)?)?"
)
_MOMENT = re.compile(
    rf"(?:{_DATE})(?:(?:\s+|[Tt])(?:{_CLOCK}))?(?:\s*(?P<zone>[Zz]|UTC|GMT|utc|gmt|Utc|Gmt)"
    r"|\s*(?P<sign>[+-])(?P<off>\d{1,2}:\d{1,2}|\d{1,4})(?:\s*(?:UTC|GMT|Z))?"
    r"|\s+(?P<plain>\d{1,2}:\d{1,2}|\d{1,4})(?:\s*(?:UTC|GMT|Z))?)?"
)
_BEGIN = re.compile(rf"(?:{_DATE})(?:(?:\s+|[Tt])(?:{_CLOCK}))?")
_ZONE = re.compile(r"^([+-])(\d{1,2}):?(\d{2})?$")


class ZoneError(UserError):
    """A zone without a definite meaning; the case can state it instead."""


@dataclass(frozen=True)
class Epoch:
    """Units of time: number * scale `unit`s since a date and time of day in a zone.

    unit: name for cftime; seconds: length of 1 in the file's units; moment: "2024-03-10 00:00:00";
    zone: [s] ahead of UTC.
    """

    unit: str
    scale: float
    seconds: float
    moment: str
    zone: int

    @property
    def units(self) -> str:
        """The units as cftime reads them, without the zone."""
        return f"{self.unit}s since {self.moment}"


def is_shifted(units: str) -> bool:
    """Return True if units count from a date, in whatever format."""
    match = _SHIFT.match(units)
    unit = _UNIT.match(match[1]) if match else None
    if match is None or unit is None or not any(letter.isdigit() for letter in match[2]):
        return False
    return _unit_name(unit[2]) is not None or unit[2].lower().rstrip("s") in UNEVEN


def parse(units: str, zone: int | None = None) -> Epoch:
    """Return units of time, parsed as UDUNITS does.

    Args:
        units: as the file writes them.
        zone: [s] ahead of UTC that the case states, which replaces the file's zone.

    Raises:
        ZoneError: the zone has no meaning.
        UserError: another part has no meaning.
    """
    match = _SHIFT.match(units)
    unit = _UNIT.match(match[1]) if match else None
    if match is None or unit is None:
        raise UserError(f'units "{units}" give no date')
    name = _unit_name(unit[2])
    if name is None:
        raise UserError(f'units "{units}": "{unit[2]}" is no unit of time with a fixed length')
    scale = float(unit[1] or 1.0)
    seconds = scale * SECONDS[name]
    if name in ("week", "fortnight"):
        name, scale = "day", seconds / SECONDS["day"]
    elif name == "nanosecond":
        name, scale = "microsecond", scale / 1000.0
    complete = _MOMENT.fullmatch(match[2])
    begin = _BEGIN.match(match[2])
    if begin is not None and complete is None:
        rest = match[2][begin.end() :].strip()
        timed = begin["hour"] is None and begin["hour_p"] is None and re.match(r"[^+-]*\d", rest)
        if timed or re.fullmatch(r"[ap]\.?m\.?", rest, re.IGNORECASE):
            raise UserError(
                f'units "{units}": "{rest}" after the date is no time of day, as 06:00:00 on a 24 hour clock is'
            )
    if begin is None or (complete is None and zone is None):
        rest = "" if begin is None else match[2][begin.end() :].strip()
        if rest:
            raise ZoneError(f'units "{units}": "{rest}" after the time has no meaning as a zone')
        raise UserError(f'units "{units}": "{match[2]}" is no date and time')
    part = (complete or begin).groupdict()
    own = 0 if complete is None or zone is not None else _zone_offset(part)
    if zone is None and part["hour"] is None and part["hour_p"] is None and own:
        raise ZoneError(f'units "{units}": "{match[2]}" may end in a zone or in a time of day')
    if abs(own) > FARTHEST and zone is None:
        raise ZoneError(f'units "{units}": no zone is that far from UTC')
    epoch = Epoch(name, scale, seconds, _format_moment(part), own)
    return epoch if zone is None else replace(epoch, zone=zone)


def zone_of(text: str) -> int:
    """Return a zone of a case ("-06:00", "+5:30", "UTC" or "Z") in seconds ahead of UTC."""
    if text.strip().upper() in ("UTC", "GMT", "Z"):
        return 0
    match = _ZONE.match(text.strip())
    seconds = (int(match[2]) * 3600 + int(match[3] or 0) * 60) if match else FARTHEST + 1
    if match is None or seconds > FARTHEST or int(match[3] or 0) > 59:
        raise UserError(
            f'zone "{text}": allowed are "UTC" and hours ahead of UTC, as "-06:00" or "+05:30"'
        )
    return -seconds if match[1] == "-" else seconds


def _unit_name(word: str) -> str | None:
    """Return the singular name of a unit of time; None if the word is no such unit."""
    folded = word.lower()
    for text in (folded, folded.removesuffix("s")):
        if text in SECONDS:
            return text
        if text in SHORT:
            return SHORT[text]
    return None


def _format_moment(part: dict[str, str | None]) -> str:
    """Return a date and time of day as cftime reads them."""

    def first(name: str, otherwise: str) -> str:
        return next(
            (v for v in (part.get(name + end) for end in ("", "_s", "_p")) if v is not None),
            otherwise,
        )

    year, month, day = int(first("year", "1")), int(first("month", "1")), int(first("day", "1"))
    hour, minute, second = (
        int(first("hour", "0")),
        int(first("minute", "0")),
        float(first("second", "0")),
    )
    if hour > 23 or minute > 59 or second > 60.0:
        raise UserError(f"{hour:02d}:{minute:02d}:{second:g} is no time of day")
    # cftime has no 60th second; times are rounded to whole seconds later.
    return (
        f"{year:04d}-{month:02d}-{day:02d} {hour:02d}:{minute:02d}:{min(second, 59.999999):09.6f}"
    )


def _zone_offset(part: dict[str, str | None]) -> int:
    """Return the offset of a written zone from UTC [s], from 6, -6, -3:30 or -0600."""
    digits = part.get("off") or part.get("plain")
    if digits is None:
        return 0
    if ":" in digits:
        hours, minutes = (int(text) for text in digits.split(":"))
    elif len(digits) <= 2:
        hours, minutes = int(digits), 0
    else:
        hours, minutes = int(digits[:-2]), int(digits[-2:])
    if minutes > 59:
        raise ZoneError(f'a zone "{digits}" has {minutes} minutes')
    seconds = hours * 3600 + minutes * 60
    return -seconds if part.get("sign") == "-" else seconds


def seconds_of(unit: str) -> float | None:
    """Return the length [s] of a unit of time without a date, like "hours"; None otherwise."""
    match = _UNIT.match(unit.strip())
    name = _unit_name(match[2]) if match else None
    return None if match is None or name is None else float(match[1] or 1.0) * SECONDS[name]
