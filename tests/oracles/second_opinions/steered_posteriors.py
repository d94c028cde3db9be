"""Posteriors of shipped cases of targets that steer, in plain float64: weights of what was seen and
not seen.
"""

from typing import Any

import numpy as np
import passages
from oracle import HOUR
from scipy import stats
from steered_cases import (
    Array,
    Where,
    cast_ways,
    crossing,
    number,
    patrolled,
    place,
    smuggler_ends,
    smuggler_k,
    table,
    touched,
    transits,
)

from drift.engine.particles.status import Status

END = {"cast_submarine": 36.0, "medsearch_transit": 216.0, "smuggler_bridge": 100.0}


def cast_posterior(rng: np.random.Generator, n: int) -> tuple[list[Where], list[Array]]:
    """Return cast_submarine at its end, and the weights of its particles given what the buoys and
    the aircraft say.

    A watch has a constant hazard while a target is in a zone, such that what stays in it throughout
    is heard with its chance.
    """
    case = table("cast_submarine")
    begin, end = 12.0, 16.0
    watched = np.linspace(begin, end, 25)
    middles = (watched[1:] + watched[:-1]) / 2
    assert {(one["start"], one["end"]) for one in case["sortie"]} == {("+12 h", "+16 h")}
    (contact,) = case["contact"]
    ways = cast_ways(rng, n, [*middles, number(contact["time"][1:]) / HOUR, END["cast_submarine"]])
    weights = []
    for scenario, places in zip(case["scenario"], ways, strict=True):
        hazard = np.zeros(n)
        for one in places[: middles.size]:
            there = one.status != Status.PENDING
            for sortie in case["sortie"]:
                x, y = (np.full(n, v) for v in place(sortie["watch"]["at"]))
                far = np.asarray(passages.GEOD.inv(x, y, one.lon, one.lat)[2])
                for inner, outer, pod in sortie["watch"]["zones"]:
                    inside = there & (far >= number(inner)) & (far <= number(outer))
                    hazard -= inside * np.log1p(-pod) / middles.size
        weights.append(scenario["weight"] * np.exp(-hazard) / n)
    told, std = contact["position"], number(contact["position"]["std"])
    likely = []
    for places in ways:
        seen = places[middles.size]
        x, y = (np.full(n, v) for v in place(told["at"]))
        far = np.asarray(passages.GEOD.inv(x, y, seen.lon, seen.lat)[2])
        likely.append(np.where(seen.status != Status.PENDING, np.exp(-0.5 * (far / std) ** 2), 0.0))
    mean = sum(w @ p for w, p in zip(weights, likely, strict=True)) / sum(w.sum() for w in weights)
    believed = [
        w * (contact["belief"] * p / mean + 1 - contact["belief"])
        for w, p in zip(weights, likely, strict=True)
    ]
    return [places[-1] for places in ways], believed


def medsearch_posterior(rng: np.random.Generator, n: int) -> tuple[list[Where], list[Array]]:
    """Return medsearch_transit at its end, and the weights of its particles given what both
    barriers say.
    """
    case = table("medsearch_transit")
    places, weights = [], []
    for scenario, one in zip(case["scenario"], transits(rng, n), strict=True):
        weight = np.full(n, scenario["weight"] / n)
        for barrier in case["barrier"]:
            first, last = (number(barrier[key][1:]) for key in ("start", "end"))
            met = touched(one, barrier["points"])
            seen = barrier["detection"] * ((first <= met) & (met <= last))
            said = 1 - seen
            if "reported" in barrier:
                error, false = number(barrier["error"]), number(barrier["false_alarms"])
                said = (
                    seen * stats.norm.pdf(met, number(barrier["reported"][1:]), error)
                    + false * said
                )
            weight *= said
        places.append(patrolled(rng, one, END["medsearch_transit"] * HOUR))
        weights.append(weight)
    return places, weights


def beside(field: dict[str, Any], lon: Array, lat: Array) -> tuple[Array, Array]:
    """Return how far places are to the right and ahead of the middle of a field [m], in the plane
    about it.
    """
    x, y = (np.full(lon.shape, v) for v in place(field["at"]))
    to, _, far = passages.GEOD.inv(x, y, lon, lat)
    angle = np.radians(np.asarray(to) - field.get("turned", 0))
    return far * np.sin(angle), far * np.cos(angle)


def looked(look: dict[str, Any], seen: Where) -> Array:
    """Return how likely a look says what it says of places."""
    x, y = beside(look, seen.lon, seen.lat)
    far = np.hypot(x, y) / number(look["radius"]) if "radius" in look else np.maximum(
        np.abs(x) * 2 / number(look["width"]), np.abs(y) * 2 / number(look["height"])
    )  # fmt: skip
    law = look["law"]
    if law == "cookie_cutter":
        chance = (far <= 1) + 0.0
    elif "linear" in law:
        chance = 1 - law["linear"] * np.minimum(far, 1)
    else:
        chance = np.exp(-(far ** law["exponential"]))
    false = look.get("false_alarms", 0.0)
    some = false + (1 - false) * chance * (seen.status != Status.PENDING)
    return some if look["sees"] == "something" else 1 - some


def listened(
    rng: np.random.Generator,
    presence: dict[str, Any],
    k: float,
    before: Where,
    after: Where,
    steps: int = 300,
) -> Array:
    """Return how likely a box says what it says of ways between places at its start and at its end.

    A piece of a bridge between two known places is a bridge between these, whatever comes after.
    Ways in steps of dt miss what they do between them as if the edge were 0.5826 K sqrt(dt) away
    (Broadie, Glasserman and Kou 1997, doi:10.1111/1467-9965.00035).
    """
    lasting = number(presence["end"][1:]) - number(presence["start"][1:])
    share, walk = np.arange(1, steps) / steps, k * np.sqrt(lasting / steps)
    there, edge = [], 0.5826 * walk * (-1 if presence["present"] == "throughout" else 1)
    for a, b, side in zip(
        *(beside(presence, one.lon, one.lat) for one in (before, after)),
        ("width", "height"),
        strict=True,
    ):
        noise = walk * rng.standard_normal((a.size, steps), np.float32).cumsum(axis=1)
        way = a[:, None] + share * (b - a)[:, None] + noise[:, :-1] - share * noise[:, -1:]
        there.append(np.abs(way) < number(presence[side]) / 2 + edge)
    inside = there[0] & there[1]
    detected = presence.get("detection", 1.0) * inside.any(axis=1)
    return inside.all(axis=1) + 0.0 if presence["present"] == "throughout" else 1 - detected


def smuggler_posterior(rng: np.random.Generator, n: int) -> tuple[list[Where], list[Array]]:
    """Return smuggler_bridge at its end, and the weights of its particles given what looks and
    presences say.

    Who is impossible is followed no further.
    """
    case, k = table("smuggler_bridge"), smuggler_k()
    looks, presences = case["look"], case["presence"]
    assert {one["present"] for one in presences} == {"throughout", "never"}
    hours = {number(one["time"][1:]) for one in looks} | {
        number(one[key][1:]) for one in presences for key in ("start", "end")
    }
    begin, end = smuggler_ends(rng, n)
    now, weight, gone = (*begin[:2], begin[2].copy()), np.full(n, 1 / n), {}
    for time in [*sorted(hours), END["smuggler_bridge"] * HOUR]:
        at = passages.bridge(rng, now, end, k, time, steps=8)
        here = gone[time] = crossing(begin, end, at, time)
        for look in (one for one in looks if number(one["time"][1:]) == time):
            weight = weight * looked(look, here)
        for one in (one for one in presences if number(one["end"][1:]) == time):
            weight = weight * listened(rng, one, k, gone[number(one["start"][1:])], here)
        left = weight > 0
        weight, begin, end, at = (keep(one, left) for one in (weight, begin, end, at))
        gone = {
            when: Where(*keep((one.lon, one.lat, one.status), left)) for when, one in gone.items()
        }
        now = (*at, np.maximum(begin[2], time))
    return [gone[time]], [weight]


def keep(one: Any, left: Array) -> Any:
    """Return the rows of an array, or of each of several, that are left."""
    return tuple(part[left] for part in one) if isinstance(one, tuple) else one[left]


POSTERIORS = {
    "cast_submarine": cast_posterior,
    "medsearch_transit": medsearch_posterior,
    "smuggler_bridge": smuggler_posterior,
}
