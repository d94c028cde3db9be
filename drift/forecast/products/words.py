"""Texts on the pictures of a forecast: status shares, probability off the map, and number of
particles.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from drift.forecast.build import Forecast
from geo import notation

STATUS = {
    "adrift": "adrift",
    "ashore": "ashore",
    "outside": "outside the forcing",
    "left": "left the domain",
    "sunk": "sunk",
    "pending": "not yet released",
    "under_way": "under way",
    "arrived": "arrived",
    "aground": "aground",
}

STEERING = {"pending": "not yet departed"}  # words where targets steer
OFF_MAP_STEERING = {"pending": "has not yet departed"}
OFF_MAP = {
    "outside": "ran out of forcing",
    "left": "left the domain",
    "sunk": "sank",
    "pending": "is not yet released",
}
REST = "areas are shares of the rest"

TELLING = 0.01  # probability off the map above which a picture warns


def statuses(at: Any) -> dict[str, float]:
    """Return the probability of each status at a time, by name."""
    return {
        str(k): float(v)
        for k, v in zip(at["status"].values, at["status_probability"].values, strict=True)
    }


def steers(data: Any) -> bool:
    """Return whether any target steers in a forecast."""
    return "under_way" in data["status"].values


def moving_text(at: Any) -> str:
    """Return the word for moving particles at a time: "adrift", "under way", or both.

    Where targets steer and nothing moves, it is "under way".
    """
    if not steers(at):
        return "adrift"
    now = statuses(at)
    kinds = [STATUS[name] for name in ("adrift", "under_way") if now[name] > 0]
    return " or ".join(kinds) or "under way"


def on_map_text(at: Any) -> str:
    """Return the word for particles on the map."""
    return "on the map" if steers(at) else "adrift or ashore"


def waiting(data: Any) -> str:
    """Return a short text for pending particles on small maps."""
    times = data["time"].values
    if steers(data):
        return STEERING["pending"]
    return "not yet released" if times.size > 1 and times[-1] < times[0] else "not yet adrift"


def account(at: Any) -> str:
    """Return the status shares as text: adrift, ashore, and off the map."""
    called = STATUS | STEERING if steers(at) else STATUS
    parts = [
        f"{called[name]} {notation.percent(value)}"
        for name, value in statuses(at).items()
        if value > 0
    ]
    return "Account:  " + "   ·   ".join(parts)


def off_map_warning(at: Any) -> str:
    """Return a warning of probability that is not on the map; "" if it is at most TELLING."""
    off = {name: value for name, value in statuses(at).items() if name in OFF_MAP and value > 0}
    told = OFF_MAP | OFF_MAP_STEERING if steers(at) else OFF_MAP
    if sum(off.values()) <= TELLING:
        return ""
    if len(off) == 1:
        ((name, value),) = off.items()
        return f"{notation.percent(value)} of the probability {told[name]} and is not on the map; {REST}"
    parts = ", ".join(f"{notation.percent(value)} {told[name]}" for name, value in off.items())
    return f"{notation.percent(sum(off.values()))} of the probability is not on the map: {parts}; {REST}"


def unshaded(at: Any) -> str:
    """Return a warning of probability outside a user-defined grid; "" if it is at most TELLING."""
    off = float(at["off_grid"]) if "off_grid" in at else 0.0
    if not off > TELLING:
        return ""
    return f"{notation.percent(off)} of the probability lies outside output.grid and is not shaded; areas count it"


def basis(forecast: Forecast, time: int, particles: int | None) -> str:
    """Return a text with the start of the forecast and its effective number of particles."""
    times = forecast.data["time"].values
    hours = float((times[time] - times[0]) / np.timedelta64(1, "s")) / 3600
    when = f"{notation.number(round(abs(hours), 2))} h {'before' if hours < 0 else 'after'} {notation.format_dtg(times[0])}"
    many = float(forecast.data["effective_particles"].values[time])
    if particles is None:
        return f"{when}   ·   {many:,.0f} effective particles"
    return f"{when}   ·   {particles:,} particles, effective {many:,.0f}"


def span(times: Sequence[Any], ends: Sequence[float]) -> str:
    """Return a text with the times drawn and the meaning of the numbers above each panel."""
    to = "back to" if times[-1] < times[0] else "to"
    return f"{notation.format_dtg(times[0])} {to} {notation.format_dtg(times[-1])}, UTC; {small_map_caption(ends)}"


def small_map_caption(ends: Sequence[float]) -> str:
    """Return a text that explains the numbers above a small map."""
    shares = " and ".join(notation.hundredths(share) for share in ends)
    return f"{shares} % areas in nmi² (on the coast: bands)"
