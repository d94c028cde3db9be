"""Itineraries as text: phases in order, distress, and when a target is overdue."""

import math

import numpy as np

from drift.engine.motion.steering.itinerary import (
    Acts,
    Between,
    Course,
    Distress,
    Itinerary,
    Loiter,
    Moment,
    Part,
    Phase,
    Rate,
    Spread,
    Ways,
)
from geo import notation, sphere
from geo.notation import KNOT, NMI

HOUR = 3600.0


def itinerary_in_words(itinerary: Itinerary, adrift: str) -> str:
    """Describe an itinerary; adrift: description of the object that it becomes in distress."""
    text = "; then ".join(_phase(phase) for phase in itinerary.phases)
    if itinerary.currents == "felt":
        text += "; by dead reckoning, set off its way by the current"
    if itinerary.distress is not None:
        text += f"; in distress {_distress(itinerary.distress)}, and then adrift as {adrift}"
    if itinerary.overdue is not None:
        text += (
            f"; from {notation.stated_time(itinerary.overdue)} on, targets that have arrived "
            f"within {notation.number(itinerary.arrival_radius / NMI)} nmi of their "
            "last way point are in port and no longer searched for"
        )
    return text


def _phase(phase: Phase) -> str:
    match phase:
        case Course():
            change = (
                f", changed every {notation.number(phase.change / HOUR)} h on average"
                if phase.change
                else ""
            )
            return f"course {_course(phase.course)} at {_speed(phase.speed)}{change}{_until(phase)}"
        case Acts():
            return f"{_acts(phase)}{_until(phase)}"
        case Loiter():
            return f"to and fro in a polygon at {_speed(phase.speed)}, legs of {notation.number(phase.leg / NMI)} nmi{_until(phase)}"
        case Ways():
            return _way(phase)


def _acts(phase: Acts) -> str:
    """Describe the actions that a target takes at random times.

    Example: "course any at 2 to 12 kn; every 3 to 15 min 45 % take another".
    """
    parts = {
        f"take another at up to {notation.number(phase.fastest / KNOT)} kn": phase.change,
        "seek": phase.seek,
        "flee": phase.hide,
    }
    actions = [
        f"{notation.number(100 * share)} % {what}" for what, share in parts.items() if share > 0
    ]
    least, longest = (f"{notation.number(seconds / 60)}" for seconds in phase.between)
    interval = least if least == longest else f"{least} to {longest}"
    text = (
        f"course {_course(phase.course)} at {_speed(phase.speed)}; every {interval} min "
        f"{', '.join(actions) or 'it goes on'}"
    )
    if phase.hide > 0:
        text += (
            f" within {notation.number(math.degrees(phase.spread))} deg of the reciprocal bearing"
        )
    if phase.leave > 0 and phase.seek + phase.hide > 0:
        text += f"; {notation.number(100 * phase.leave)} % of those stop doing so"
    if phase.tracker is not None:
        lon, lat = (math.degrees(x[0]) for x in (phase.tracker.lon, phase.tracker.lat))
        text += f"; the tracker starts at {notation.stated_position(lon, lat)}"
    return text


def _way(phase: Ways) -> str:
    begin = f"from {_time(phase.start, phase.after)}"
    if phase.lanes is not None:
        nodes, along = phase.lanes.route.node, phase.lanes.route.along[-1]
        between = len(nodes) - 2
        by = f"by {between} node{'s' * (between != 1)}, " if between else ""
        return (
            f"lanes from {nodes[0]} to {nodes[-1]} {by}{along / NMI:,.0f} nmi, {begin}, at "
            f"{_speed(phase.speed)}"
        )
    if phase.points[-1].time is None and not phase.destinations:
        length = math.fsum(point.distance for point in phase.points)
        return f"voyage of {length / NMI:,.0f} nmi by {len(phase.points)} way points, {begin}, at {_speed(phase.speed)}"
    times = [point.time for point in phase.points]
    first = times[0]
    if phase.k > 0 or phase.destinations:
        uncertain = (
            f", known to a factor of {notation.number(math.exp(phase.k_spread))}"
            if phase.k_spread > 0
            else ""
        )
        k = f"K = {notation.number(phase.k * math.sqrt(HOUR) / NMI)} nmi/sqrt(h){uncertain}"
        ends = [point for point, _ in phase.destinations] or [phase.points[-1]]
        odds = f" to one of {len(ends)} destinations" if len(ends) > 1 else ""
        last = " or ".join(_normal_time(phase.start, end.time) for end in ends)
        return f"bridge{odds}, {k}, from {_normal_time(phase.start, first)}, there {last}"
    return f"track of {len(phase.points)} way points, {begin}, the last after {_hours(times[-1])}"


def _until(phase: Course | Acts | Loiter) -> str:
    ends = [] if phase.until is None else [f"until {notation.stated_time(phase.until)}"]
    ends += (
        [f"for {notation.number(phase.lasting / HOUR)} h"] if math.isfinite(phase.lasting) else []
    )
    return f", {' or '.join(ends)}" if ends else ""


def _distress(distress: Distress) -> str:
    match distress:
        case Between():
            return _time(distress.earliest, distress.after)
        case Rate():
            return f"at a rate of {notation.number(distress.rate * HOUR)} / h"
        case Part():
            return f"after {_span(distress.part, 100)} % of its way"


def _time(earliest: np.datetime64, after: Spread) -> str:
    """Return an uncertain time as text."""
    first, last = (
        notation.stated_time(earliest + np.timedelta64(round(t), "s"))
        for t in (after.low, after.high)
    )
    if first == last:
        return first
    best = notation.stated_time(earliest + np.timedelta64(round(after.mode), "s"))
    return f"{first} to {last}" + (
        f" (best {best}, {notation.number(after.ratio)} times as likely)"
        if after.ratio != 1
        else ""
    )


def _normal_time(start: np.datetime64, time: Spread | Moment | None) -> str:
    if isinstance(time, Moment):
        return f"{notation.stated_time(start + np.timedelta64(round(time.mean), 's'))} +- {notation.number(time.std / HOUR)} h"
    return _time(start, time or Spread(0.0, 0.0, 0.0))


def _hours(time: Spread | Moment | None) -> str:
    return f"{_span(time, 1 / HOUR)} h" if isinstance(time, Spread) else "none"


def _speed(speed: Spread) -> str:
    return f"{_span(speed, 1 / KNOT)} kn"


def _course(course: Spread) -> str:
    low, mode, high = (
        float(np.degrees(sphere.wrap(x))) % 360 for x in (course.low, course.mode, course.high)
    )
    if course.low == course.high:
        return notation.bearing(low)
    if course.high - course.low > 2 * math.pi - 1e-6 and course.ratio == 1:
        return "any"
    text = f"{notation.bearing(low)} to {notation.bearing(high)}"
    return text + (f" (best {notation.bearing(mode)})" if course.ratio != 1 else "")


def _span(spread: Spread, unit: float) -> str:
    """Return an uncertain number as text, in a unit."""
    low, mode, high = (
        f"{notation.number(x * unit)}" for x in (spread.low, spread.mode, spread.high)
    )
    if low == high:
        return low
    return f"{low} to {high}" + (f" (best {mode})" if spread.ratio != 1 else "")
