"""Uncertain numbers and times: one value, a range, a truncated triangle; for times also normal."""

import math
from collections.abc import Callable
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, model_validator

from drift.case.values import fields, units
from drift.engine.motion.steering.itinerary import Moment, Spread
from geo import notation

LEAST_RATIO = 1.0


def _spread(single: Callable[[object], float], example: str) -> BeforeValidator:
    """Return a validator of an uncertain number: a value, [low, high], or a truncated triangle."""

    return BeforeValidator(lambda value: _uncertain(value, single, example))


def _uncertain(value: object, single: Callable[[object], float], example: str) -> Spread:
    if isinstance(value, Spread):
        return value
    if isinstance(value, dict):
        return _triangle(value, single, example)
    low, high = fields.pair_of(single)(value)
    if high < low:
        raise ValueError(f"{value!r} must go from low to high")
    return Spread(low, high, (low + high) / 2)


def _triangle(value: dict[Any, Any], single: Callable[[object], float], example: str) -> Spread:
    keys = ("low", "best", "high", "ratio")
    if set(value) != set(keys):
        raise ValueError(
            f"{value!r} must be one value, [low, high], or a table with {', '.join(keys)}, like {example}"
        )
    low, best, high = (single(value[key]) for key in keys[:3])
    ratio = units.quantity(value["ratio"], "", "ratio", "4")
    if not low <= best <= high:
        raise ValueError(
            f"best {value['best']!r} must lie between low {value['low']!r} and high {value['high']!r}"
        )
    if ratio < LEAST_RATIO:
        raise ValueError(
            f"ratio {ratio:g}, of the highest to the lowest density, must be at least 1 (1: uniform)"
        )
    return Spread(low, high, best, ratio)


def _course(value: object) -> Spread:
    """Return courses [rad]; a range through north, like [340, 20], continues beyond 360 degrees."""
    if isinstance(value, Spread):
        return value
    one = fields.direction
    if isinstance(value, dict) and set(value) == {"low", "best", "high", "ratio"}:
        low, best, high = (one(value[key]) for key in ("low", "best", "high"))
        high += 360.0 * (high < low)
        best += 360.0 * (best < low)
        value = {"low": low, "best": best, "high": high, "ratio": value["ratio"]}
    elif isinstance(value, list | tuple) and len(value) == 2:
        low, high = one(value[0]), one(value[1])
        value = [low, high + 360.0 * (high < low)]
    else:
        value = one(value)

    def bare(number: object) -> float:
        return units.quantity(number, "deg", "direction", "120 deg")

    spread = _uncertain(value, bare, "{ low = 340, best = 10, high = 40, ratio = 4 }")
    return Spread(
        math.radians(spread.low), math.radians(spread.high), math.radians(spread.mode), spread.ratio
    )


Speeds = Annotated[
    Spread, _spread(fields.ship_speed, '{ low = "5 kn", best = "8 kn", high = "12 kn", ratio = 4 }')
]
Courses = Annotated[Spread, BeforeValidator(_course)]
Durations = Annotated[
    Spread, _spread(fields.interval, '{ low = "2 h", best = "3 h", high = "6 h", ratio = 4 }')
]
Parts = Annotated[Spread, _spread(fields.share, "{ low = 0.2, best = 0.5, high = 0.9, ratio = 4 }")]


class Times(fields.Table):
    """An uncertain time: a time, [earliest, latest], a truncated triangle, or a normal one."""

    earliest: fields.Time | None = None
    """Earliest time; needs `latest`. Uniform between the two unless `best` is given."""
    best: fields.Time | None = None
    """Likeliest time; needs `ratio`."""
    latest: fields.Time | None = None
    """Latest time; needs `earliest`."""
    ratio: float = 1.0
    """Ratio of the density at `best` to the density at the ends."""
    at: fields.Time | None = None
    """The exact time, or with `std` the mean."""
    std: fields.Duration | None = None
    """Standard deviation of a normal distribution."""

    @model_validator(mode="after")
    def one_law(self) -> "Times":
        """Reject an incomplete distribution, or two."""
        given = {name for name in self.model_fields_set if getattr(self, name) is not None}
        if given not in (
            {"at"},
            {"at", "std"},
            {"earliest", "latest"},
            {"earliest", "best", "latest", "ratio"},
        ):
            raise ValueError(
                "give a time, [earliest, latest], { earliest, best, latest, ratio } or { at, std }; found "
                f"{', '.join(sorted(given)) or 'nothing'}"
            )
        if self.ratio < LEAST_RATIO:
            raise ValueError(
                f"ratio {self.ratio:g}, of the highest to the lowest density, must be at least 1"
            )
        return self

    def seconds(self, origin: np.datetime64, start: np.datetime64) -> Spread | Moment:
        """Return the distribution in seconds after an origin.

        Args:
            origin: time from which the seconds count.
            start: start of the case, for relative times.

        Raises:
            ValueError: the times are out of order.
        """

        def after(time: units.Instant) -> float:
            return float((units.resolve(time, start) - origin) / np.timedelta64(1, "s"))

        if self.at is not None:
            mean = after(self.at)
            return Moment(mean, self.std) if self.std else Spread(mean, mean, mean)
        assert self.earliest is not None
        assert self.latest is not None
        low, high = after(self.earliest), after(self.latest)
        best = after(self.best) if self.best is not None else (low + high) / 2
        if not low <= best <= high:
            first, last = (
                notation.format_dtg(units.resolve(time, start))
                for time in (self.earliest, self.latest)
            )
            raise ValueError(
                f"times go from {first} to {last}, or the best one lies outside; give them in order"
            )
        return Spread(low, high, best, self.ratio)


def _times(value: Any) -> Any:
    if isinstance(value, dict | Times):
        return value
    if isinstance(value, list):
        if len(value) != 2:
            raise ValueError(f"{value!r} must be a time or [earliest, latest]")
        return {"earliest": value[0], "latest": value[1]}
    return {"at": value}


Time = Annotated[Times, BeforeValidator(_times)]


AT_ONCE = Times(at="+0 h")  # the start of the case


def start_distribution(law: Times, start: np.datetime64) -> tuple[np.datetime64, Spread]:
    """Return the earliest start of a phase, and the distribution of its delay [s] after that.

    Args:
        law: the uncertain time; a normal distribution is rejected.
        start: start of the case.
    """
    seconds = law.seconds(start, start)
    if isinstance(seconds, Moment):
        raise ValueError(
            "a start has no std; give a time, [earliest, latest] or { earliest, best, latest, ratio }"
        )
    earliest = start + np.timedelta64(round(seconds.low), "s")
    low = seconds.low
    return earliest, Spread(0.0, seconds.high - low, seconds.mode - low, seconds.ratio)
