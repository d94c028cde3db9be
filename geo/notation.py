"""How times are written where a planner reads them; what machines read is ISO 8601."""

from datetime import datetime
from typing import Any

import numpy as np

MONTHS = ("JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC")


def group(moment: Any) -> str:
    """Return a time, np.datetime64 in UTC, as a date-time group (ACP 121): 211830ZNOV26; seconds are dropped.

    The year has two digits in this century, in which a reader takes them to be, and four in any other.
    """
    when: datetime = np.asarray(moment).astype("datetime64[s]").item()
    year = f"{when.year % 100:02d}" if 2000 <= when.year < 2100 else f"{when.year:04d}"
    return f"{when.day:02d}{when.hour:02d}{when.minute:02d}Z{MONTHS[when.month - 1]}{year}"
