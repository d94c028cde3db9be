"""Text of times, positions, directions and shares as a planner reads them, and of times as ISO 8601."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from geo import sphere

NMI = 1852.0  # [m] international nautical mile
KNOT = NMI / 3600  # [m/s]
COMPASS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")
MONTHS = ("JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC")


def group(moment: Any) -> str:
    """Return a time (np.datetime64, UTC) as a date-time group (ACP 121), 211830ZNOV26.

    Seconds are dropped. The year has two digits in this century, which a reader assumes, and all in any other: damaged
    files hold times that Python's own dates do not reach.
    """
    date, clock = str(np.asarray(moment).astype("datetime64[s]")).split("T")
    year, month, day = date.rsplit("-", 2)
    short = year[2:] if year.startswith("20") and len(year) == 4 else year
    return f"{day}{clock[:2]}{clock[3:5]}Z{MONTHS[int(month) - 1]}{short}"


def day_time(moment: Any) -> str:
    """Return a time (np.datetime64, UTC) as day and time, 211830Z."""
    return f"{group(moment)[:6]}Z"


def toward(lon1: float, lat1: float, lon2: float, lat2: float) -> str:
    """Return how far and in which direction point 2 lies from point 1 [deg], along a great circle."""
    east, north = (float(x) for x in sphere.offset(*np.radians([lon1, lat1, lon2, lat2])))
    miles, eighth = math.hypot(east, north) / NMI, round(math.degrees(math.atan2(east, north)) / 45) % 8
    return f"{miles:,.0f} nmi to the {COMPASS[eighth]}" if miles >= 10 else f"{miles:.1f} nmi to the {COMPASS[eighth]}"


def percent(share: float) -> str:
    """Return a share in percent with all its digits: 0.95 is 95, 0.999 is 99.9."""
    return f"{100 * share:.6g}"


def size(count: float) -> str:
    """Return a number of bytes in words."""
    return f"{count / 2**30:.1f} GiB" if count >= 2**30 else f"{count / 2**20:.1f} MiB"


def epoch(time: Any) -> int:
    """Return a time (np.datetime64, UTC) as whole seconds since 1970."""
    return int(np.asarray(time).astype("datetime64[s]").astype(np.int64))


def epochs(times: Any) -> npt.NDArray[np.int64]:
    """Return times, np.datetime64 in UTC of any shape, as whole seconds since 1970."""
    return np.asarray(times).astype("datetime64[s]").astype(np.int64)


def iso(time: Any) -> str:
    """Return a time (np.datetime64, UTC) as 2026-11-21T18:30:00Z."""
    return f"{np.datetime_as_string(time, unit='s')}Z"


def lasting(seconds: float) -> str:
    """Return a duration as 90 min, or under a minute as 12 s."""
    return f"{seconds / 60:g} min" if seconds >= 60 else f"{seconds:g} s"


def position(lon: float, lat: float) -> str | None:
    """Return a position [deg] in degrees and decimal minutes, 28-42.0N 087-30.0W.

    Returns None where it is not finite.
    """
    if not (np.isfinite(lon) and np.isfinite(lat)):
        return None
    lon = sphere.wrap_degrees(lon)
    return f"{_minutes(lat, 2)}{'N' if lat >= 0 else 'S'} {_minutes(lon, 3)}{'E' if lon >= 0 else 'W'}"


def _minutes(angle: float, digits: int) -> str:
    """Return an angle [deg] without its sign as degrees of so many digits and minutes to a tenth."""
    tenths = round(abs(angle) * 600)
    return f"{tenths // 600:0{digits}d}-{tenths % 600 / 10:04.1f}"
