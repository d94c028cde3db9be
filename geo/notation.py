"""How times and directions are written where a planner reads them; what machines read is ISO 8601."""

import math
from datetime import datetime
from typing import Any

import numpy as np

from geo import sphere

MONTHS = ("JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC")


def group(moment: Any) -> str:
    """Return a time, np.datetime64 in UTC, as a date-time group (ACP 121): 211830ZNOV26; seconds are dropped.

    The year has two digits in this century, in which a reader takes them to be, and four in any other.
    """
    when: datetime = np.asarray(moment).astype("datetime64[s]").item()
    year = f"{when.year % 100:02d}" if 2000 <= when.year < 2100 else f"{when.year:04d}"
    return f"{when.day:02d}{when.hour:02d}{when.minute:02d}Z{MONTHS[when.month - 1]}{year}"


COMPASS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")
NMI = 1852.0  # [m]


def toward(lon1: float, lat1: float, lon2: float, lat2: float) -> str:
    """Return how far and in which direction a second point lies from a first [deg], along a great circle."""
    east, north = (float(x) for x in sphere.offset(*np.radians([lon1, lat1, lon2, lat2])))
    miles, eighth = math.hypot(east, north) / NMI, round(math.degrees(math.atan2(east, north)) / 45) % 8
    return f"{miles:,.0f} nmi to the {COMPASS[eighth]}" if miles >= 10 else f"{miles:.1f} nmi to the {COMPASS[eighth]}"
