"""Text for times, positions, directions, shares and numbers as planners read them.

Numbers that a case states are repeated with all their digits (`number`, `hundredths`, `bearing`,
`stated_position`, `stated_time`). Computed numbers are rounded (`percent`, `probability`,
`position`, `group`).
"""

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from geo import sphere

NMI = 1852.0  # [m] international nautical mile
KNOT = NMI / 3600  # [m/s]
COMPASS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")
GIVEN = 9  # significant digits of a stated number that are repeated
DERIVED = 4  # significant digits of a number that no case states
FINEST = 5  # largest number of decimals of the minutes of a stated position: 2 cm
ROUNDING = 1e-9  # rounding error of sums of weights
MONTHS = ("JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC")


def format_dtg(moment: Any) -> str:
    """Return a time (np.datetime64, UTC) as a date-time group (ACP 121), 211830ZNOV26.

    Seconds are dropped. Years of this century have two digits, others all of them: damaged files
    hold times outside the range of Python's dates.
    """
    date, clock = str(np.asarray(moment).astype("datetime64[s]")).split("T")
    year, month, day = date.rsplit("-", 2)
    short = year[2:] if year.startswith("20") and len(year) == 4 else year
    return f"{day}{clock[:2]}{clock[3:5]}Z{MONTHS[int(month) - 1]}{short}"


def day_time(moment: Any) -> str:
    """Return a time (np.datetime64, UTC) as day and time, 211830Z."""
    return f"{format_dtg(moment)[:6]}Z"


def distance_and_direction(lon1: float, lat1: float, lon2: float, lat2: float) -> str:
    """Return distance and compass direction of point 2 [deg] from point 1, on a great circle."""
    east, north = (float(x) for x in sphere.offset(*np.radians([lon1, lat1, lon2, lat2])))
    miles, eighth = (
        math.hypot(east, north) / NMI,
        round(math.degrees(math.atan2(east, north)) / 45) % 8,
    )
    return (
        f"{miles:,.0f} nmi to the {COMPASS[eighth]}"
        if miles >= 10
        else f"{miles:.1f} nmi to the {COMPASS[eighth]}"
    )


def percent(share: float, digits: int = 1, unit: str = " %") -> str:
    """Return a computed probability or share in percent, never rounded to 0 % or 100 %.

    Exactly 0 or 1 is "0 %" or "100 %"; values near them are "< 0.1 %" or "> 99.9 %".

    Args:
        share: 0 to 1; within ROUNDING of 1 it counts as 1, because sums of weights are inexact.
        digits: after the decimal point; they also set the limits of "near".
        unit: text after the number; "" where a cell of a picture has no room, which also drops the
            blank.
    """
    if math.isnan(share):
        return "unknown"
    blank = " " if unit else ""
    least = 10.0**-digits
    if share <= 0:
        text = "0"
    elif share >= 1 - ROUNDING:
        text = "100"
    elif float(f"{100 * share:.{digits}f}") == 0:
        text = f"<{blank}{least:.{digits}f}"
    elif float(f"{100 * share:.{digits}f}") >= 100:
        text = f">{blank}{100 - least:.{digits}f}"
    else:
        text = f"{100 * share:.{digits}f}"
    return f"{text}{unit}"


def short_percent(share: float) -> str:
    """Return a share like `percent`, with a decimal only below 10 % and above 99.5 %."""
    return percent(share, 0 if 0.0995 <= share <= 0.995 else 1)


def probability(value: float, digits: int = 2) -> str:
    """Return a computed probability as a decimal: 0.25; <0.01 and >0.99 unless exactly 0 or 1."""
    rounded = f"{value:.{digits}f}"
    least = 10.0**-digits
    if value > 0 and float(rounded) == 0:
        return f"<{least:.{digits}f}"
    return f">{1 - least:.{digits}f}" if value < 1 - ROUNDING and float(rounded) == 1 else rounded


def number(value: float, digits: int = DERIVED) -> str:
    """Return a number that a case states with all its digits: 0.25, not 0.3.

    The value may have been converted to SI and back: up to GIVEN significant digits are kept as
    written. A number with more digits is derived from what the case states (exp(0.3), 0.25 m/s in
    knots). It is rounded to `digits` significant digits, or to a whole number if that has more.
    """
    text = f"{value:.12g}"
    mantissa = text.partition("e")[0].lstrip("-0.").replace(".", "")
    if len(mantissa) <= GIVEN or not math.isfinite(value):
        return text
    whole = len(f"{abs(value):.0f}")
    return f"{value:.{max(digits, whole)}g}"


def hundredths(share: float) -> str:
    """Return a stated share in percent, without unit, with all digits: 95 for 0.95."""
    return number(100 * share)


def bearing(angle: float) -> str:
    """Return a course or bearing [deg] as `number` does, with three digits before the point.

    Examples: 045, 123.5.
    """
    rounded = float(number(angle % 360)) % 360  # 359.9999999999 is north
    whole, point, rest = number(rounded).partition(".")
    return f"{whole.zfill(3)}{point}{rest}"


def format_bytes(count: float) -> str:
    """Return a number of bytes as text in GiB or MiB."""
    return f"{count / 2**30:.1f} GiB" if count >= 2**30 else f"{count / 2**20:.1f} MiB"


def epoch(time: Any) -> int:
    """Return a time (np.datetime64, UTC) as whole seconds since 1970."""
    return int(np.asarray(time).astype("datetime64[s]").astype(np.int64))


def epochs(times: Any) -> npt.NDArray[np.int64]:
    """Return times (np.datetime64, UTC, any shape) as whole seconds since 1970."""
    return np.asarray(times).astype("datetime64[s]").astype(np.int64)


def iso(time: Any) -> str:
    """Return a time (np.datetime64, UTC) as 2026-11-21T18:30:00Z."""
    return f"{np.datetime_as_string(time, unit='s')}Z"


def format_duration(seconds: float) -> str:
    """Return a duration [s] as 90 min, or below a minute as 12 s."""
    return f"{seconds / 60:g} min" if seconds >= 60 else f"{seconds:g} s"


def position(lon: float, lat: float, decimals: int = 1) -> str | None:
    """Return a position [deg] in degrees and decimal minutes, 28-42.0N 087-30.0W.

    decimals: of the minutes. Returns None if the position is not finite.
    """
    if not (np.isfinite(lon) and np.isfinite(lat)):
        return None
    lon = sphere.wrap_degrees(lon)
    return f"{_format_minutes(lat, 2, decimals)}{'N' if lat >= 0 else 'S'} {_format_minutes(lon, 3, decimals)}{'E' if lon >= 0 else 'W'}"


def stated_position(lon: float, lat: float) -> str | None:
    """Return a position [deg] that a case states, with as many decimals of minutes as it has.

    At least one and at most FINEST.
    """
    exact = [60 * abs(angle) for angle in (lon, lat)]
    decimals = (
        digits
        for digits in range(1, FINEST)
        if all(abs(x - round(x, digits)) < 0.5 * 10.0**-FINEST for x in exact)
    )
    return position(lon, lat, next(decimals, FINEST))


def stated_time(moment: Any) -> str:
    """Return a time (np.datetime64, UTC) that a case states: a date-time group.

    With seconds it is ISO 8601.
    """
    return iso(moment) if epoch(moment) % 60 else format_dtg(moment)


def _format_minutes(angle: float, digits: int, decimals: int) -> str:
    """Return an unsigned angle [deg] as degrees and minutes.

    digits: of the degrees; decimals: of the minutes.
    """
    degree = 60 * 10**decimals
    parts = round(abs(angle) * degree)
    return (
        f"{parts // degree:0{digits}d}-{parts % degree / 10**decimals:0{3 + decimals}.{decimals}f}"
    )
