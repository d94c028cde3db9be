"""Shipped cases of targets that steer, against a second opinion in plain float64
(tests/oracles/passages.py).

Had nothing been searched or seen: at two times, by scenario, what has become of them, where they
are on average, and second moments. Then, given all that was: the posterior of the scenarios, mean
and second moments. overdue_yacht goes on adrift: it stands in test_case_oracles.py.
"""

import functools
import itertools
import re
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import passages
import pytest
from oracle import HOUR, KNOT, NMI, R
from places import ROOT
from scipy import stats

from drift.case import file as case_file
from drift.engine.particles.status import Status
from drift.pipeline import flow

CASES = ROOT / "cases"
OURS = 16_000  # particles in all
# of the oracle, a scenario
THEIRS = {"cast_submarine": 12_000, "medsearch_transit": 5_000, "smuggler_bridge": 12_000}
COMPARED = (
    # numbers that this file compares; together they are as sure as three standard errors hold one
    # (Bonferroni)
    400
)
SIGMAS = stats.norm.isf(stats.norm.sf(3.0) / COMPARED)  # 4.5
Array = np.ndarray


def table(name: str) -> dict[str, Any]:
    """Return a case's tables as written."""
    return tomllib.loads((CASES / f"{name}.toml").read_text())


def place(text: str) -> tuple[float, float]:
    """Return longitude and latitude [deg] of a text like 46 20N 027 40W."""
    (lat, ns), (lon, ew) = re.findall(r"([\d. ]+)([NSEW])", text)
    degrees = [sum(float(part) / 60**k for k, part in enumerate(one.split())) for one in (lat, lon)]
    return degrees[1] * (-1 if ew == "W" else 1), degrees[0] * (-1 if ns == "S" else 1)


def number(value: Any) -> float:
    """Return a quantity in SI, or a bare number."""
    if not isinstance(value, str):
        return float(value)
    size, unit = value.split()
    units = {
        "nmi": NMI,
        "kn": KNOT,
        "min": 60.0,
        "h": HOUR,
        "/h": 1 / HOUR,
        "nmi/sqrt(h)": NMI / HOUR**0.5,
    }
    return float(size) * units[unit]


def spread(rng: np.random.Generator, n: int, told: Any) -> Array:
    """Draw an uncertain number as a case has it: a value, [low, high], or a truncated triangle."""
    if isinstance(told, dict):
        low, best, high = (number(told[k]) for k in told if k != "ratio")
        return passages.triangle(rng, n, low, best, high, told["ratio"])
    low, high = told if isinstance(told, list) else (told, told)
    return rng.uniform(number(low), number(high), n)


@dataclass(frozen=True)
class Where:
    """Where the particles of a scenario are, and what has become of each."""

    lon: Array  # (n,) [deg]
    lat: Array
    status: Array  # (n,) of Status


def probable(std: Any) -> float:
    """Return the semi-axis of an ellipse [standard deviations] that holds a probability."""
    return float(np.sqrt(-2 * np.log1p(-std)))


def cast_submarine(rng: np.random.Generator, n: int, hours: float) -> list[Where]:
    """A fix with course and speed, and a track with a random start that ends in a patrol."""
    return [places[0] for places in cast_ways(rng, n, [hours])]


def cast_ways(rng: np.random.Generator, n: int, hours: Sequence[float]) -> list[list[Where]]:
    """Return where the same submarines are at each of some times, by scenario."""
    first, second = table("cast_submarine")["scenario"]
    fix, motion, moments = (
        first["position"]["ellipse"],
        first["phase"][0]["course"],
        [h * HOUR for h in hours],
    )
    scale = probable(fix["probability"])
    lon, lat = passages.about(
        rng, place(first["position"]["at"]), n, number(fix["major"]) / scale, number(fix["minor"]) / scale,
        fix["orientation"],
    )  # fmt: skip
    course, speed = spread(rng, n, motion["course"]), spread(rng, n, motion["speed"])
    told = [
        [
            Where(*passages.rhumb(lon, lat, course, speed * time), np.full(n, Status.UNDER_WAY))
            for time in moments
        ]
    ]

    track, patrol = second["phase"][0]["track"], second["phase"][1]["loiter"]
    begin = rng.uniform(*(number(one[1:]) for one in track["start"]), n)
    a, b, c = track["points"]
    wide = probable(b["ellipse"]["probability"])
    far, to = number(c["radius"]) * np.sqrt(rng.uniform(size=n)), rng.uniform(0, 360, n)
    points = [
        passages.about(rng, place(a["at"]), n, number(a["std"]), number(a["std"])),
        passages.about(
            rng, place(b["at"]), n, number(b["ellipse"]["major"]) / wide, number(b["ellipse"]["minor"]) / wide,
            b["ellipse"]["orientation"],
        ),
        passages.off(place(c["at"]), far * np.cos(np.radians(to)), far * np.sin(np.radians(to)), 0.0),
    ]  # fmt: skip
    times = [begin + spread(rng, n, one["after"]) for one in track["points"]]
    lon, lat = (np.stack([one[k] for one in points], axis=1) for k in (0, 1))
    ring, pace = [place(one) for one in patrol["polygon"]], spread(rng, n, patrol["speed"])
    ends = [time - times[-1] for time in moments]
    patrols = passages.loiter(rng, ring, lon[:, -1], lat[:, -1], ends, pace, number(patrol["leg"]))
    told.append([])
    for time, left, there in zip(moments, ends, patrols, strict=True):
        way = passages.passed(lon, lat, np.stack(times, axis=1), time)
        x, y = (np.where(left > 0, b, a) for a, b in zip(way, there, strict=True))
        told[-1].append(Where(x, y, np.where(begin < time, Status.UNDER_WAY, Status.PENDING)))
    return told


@dataclass(frozen=True)
class Transit:
    """Way points (lon, lat, time) (n, k) of submarines on a route, and the patrol after it."""

    lon: Array
    lat: Array
    time: Array  # [s]
    patrol: dict[str, Any]
    pace: Array  # (n,) [m/s] on patrol

    def at(self, time: float | Array) -> tuple[Array, Array]:
        """Return where they are at a time [s] on their route."""
        return passages.passed(self.lon, self.lat, self.time, time)


def transits(rng: np.random.Generator, n: int) -> list[Transit]:
    """Return the submarines of each scenario of medsearch_transit."""
    found = []
    nodes, lanes = passages.network(CASES / "networks" / "mediterranean.toml")
    for scenario in table("medsearch_transit")["scenario"]:
        leg, patrol = scenario["phase"][0]["lanes"], scenario["phase"][1]["loiter"]
        route = passages.shortest(
            nodes, lanes, [leg["route"]["from"], *leg["route"]["via"], leg["route"]["to"]]
        )
        width = [lanes[pair] for pair in itertools.pairwise(route)]
        lon, lat, along = passages.aside(
            [nodes[one] for one in route], width, rng.uniform(-1, 1, n)
        )
        entry = {k: v[1:] if isinstance(v, str) else v for k, v in leg["entry"].items()}
        time = spread(rng, n, entry)[:, None] + along / spread(rng, n, leg["speed"])[:, None]
        found.append(Transit(lon, lat, time, patrol, spread(rng, n, patrol["speed"])))
    return found


def medsearch_transit(rng: np.random.Generator, n: int, hours: float) -> list[Where]:
    """Twelve routes along lanes, then an area of patrol."""
    return [patrolled(rng, one, hours * HOUR) for one in transits(rng, n)]


def patrolled(rng: np.random.Generator, one: Transit, time: float) -> Where:
    """Return where submarines are at a time on their route or on patrol."""
    left = time - one.time[:, -1]
    (at,) = passages.loiter(
        rng, one.patrol["polygon"], *one.at(time), [left], one.pace, number(one.patrol["leg"])
    )
    return Where(*at, np.where(one.time[:, 0] < time, Status.UNDER_WAY, Status.PENDING))


def touched(one: Transit, points: Sequence[str]) -> Array:
    """Return when submarines first meet a barrier, a great circle between two places, on their
    lanes [s]; inf: never.
    """

    def vectors(lon: Any, lat: Any) -> Array:
        x, y = np.radians(lon), np.radians(lat)
        return np.stack([np.cos(y) * np.cos(x), np.cos(y) * np.sin(x), np.sin(y)], axis=-1)

    def angle(a: Array, b: Array) -> Array:
        return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1))

    first, last = (vectors(*place(point)) for point in points)
    nodes = vectors(one.lon, one.lat)
    above = nodes @ np.cross(first, last)  # the plane of the barrier
    a, b, over, under = nodes[:, :-1], nodes[:, 1:], above[:, :-1, None], above[:, 1:, None]
    meets = a * np.abs(under) + b * np.abs(over)  # where the chord of a leg meets the plane
    meets /= np.linalg.norm(meets, axis=-1, keepdims=True)
    hits = (over * under < 0)[..., 0] & (
        angle(first, meets) + angle(meets, last) < angle(first, last) + 1e-12
    )
    when = one.time[:, :-1] + angle(a, meets) / angle(a, b) * np.diff(one.time, axis=1)
    return np.where(hits, when, np.inf).min(axis=1)


Knot = tuple[Array, Array, Array]  # lon, lat [deg] and time [s] of each particle


def smuggler_ends(rng: np.random.Generator, n: int) -> tuple[Knot, Knot]:
    """Return where and when smugglers depart, from a box, and arrive, at one of three places."""
    told = table("smuggler_bridge")["scenario"][0]["phase"][0]["bridge"]

    def anywhere(point: dict[str, Any]) -> tuple[Array, Array]:
        at = place(point["at"])
        if "box" in point:
            along, across = (number(side) * rng.uniform(-0.5, 0.5, n) for side in point["box"])
            return passages.off(at, along, across, point["orientation"])
        if "radius" in point:
            far, to = (
                number(point["radius"]) * np.sqrt(rng.uniform(size=n)),
                rng.uniform(0, 2 * np.pi, n),
            )
            return passages.off(at, far * np.cos(to), far * np.sin(to), 0.0)
        return passages.about(rng, at, n, number(point["std"]), number(point["std"]))

    def moment(law: Any) -> Array:
        if isinstance(law, dict):
            return number(law["at"][1:]) + number(law["std"]) * rng.standard_normal(n)
        return rng.uniform(*(number(one[1:]) for one in law), n)

    (first,), ends = told["points"], told["destinations"]
    begin = (*anywhere(first), moment(first["time"]))
    chosen = rng.choice(len(ends), n, p=[end["probability"] for end in ends])
    drawn = [(*anywhere(end), moment(end["time"])) for end in ends]
    lon, lat, time = (np.choose(chosen, [one[k] for one in drawn]) for k in range(3))
    return begin, (lon, lat, time)


def smuggler_bridge(rng: np.random.Generator, n: int, hours: float) -> list[Where]:
    """Bridges from a box to one of three places."""
    begin, end = smuggler_ends(rng, n)
    return [
        crossing(
            begin, end, passages.bridge(rng, begin, end, smuggler_k(), hours * HOUR), hours * HOUR
        )
    ]


def smuggler_k() -> float:
    """Return how fast a smuggler's bridge spreads [m/sqrt(s)]."""
    return number(table("smuggler_bridge")["scenario"][0]["phase"][0]["bridge"]["k"])


def crossing(begin: Knot, end: Knot, at: tuple[Array, Array], time: float) -> Where:
    """Return smugglers at a time."""
    status = np.where(
        time < begin[2], Status.PENDING, np.where(time < end[2], Status.UNDER_WAY, Status.ARRIVED)
    )
    return Where(*at, status)


ORACLES: dict[str, Callable[[np.random.Generator, int, float], list[Where]]] = {
    "cast_submarine": cast_submarine,
    "medsearch_transit": medsearch_transit,
    "smuggler_bridge": smuggler_bridge,
}
MIDWAY = {"cast_submarine": 19.0, "medsearch_transit": 97.0, "smuggler_bridge": 71.0}  # [h]
END = {"cast_submarine": 36.0, "medsearch_transit": 216.0, "smuggler_bridge": 100.0}


@functools.cache
def ours(name: str) -> dict[float, list[Where]]:
    """Return what drift.run says midway and at the end, by scenario, had nothing been searched or
    seen.
    """
    settings = {"particles": str(OURS), "expect": "{}", "resampling": "{}"}
    settings |= dict.fromkeys(("sortie", "contact", "look", "presence", "barrier"), "[]")
    output = f'{{ times = ["+{MIDWAY[name]:g} h"], trajectories = 1_000_000 }}'
    loaded = case_file.load(name, settings | {"output": output})
    tracks = flow.run(loaded).trajectories
    told: dict[float, list[Where]] = {}
    for hours in (MIDWAY[name], END[name]):
        (k,) = np.flatnonzero(
            tracks.time == loaded.start + np.timedelta64(round(hours * 3600), "s")
        )
        lon, lat = (x[:, k].astype(float) * 360 / 2**32 for x in (tracks.lon, tracks.lat))
        stories = [tracks.scenario == scenario for scenario in range(len(loaded.scenarios))]
        told[hours] = [Where(lon[here], lat[here], tracks.status[here, k]) for here in stories]
    return told


def numbers(told: Where, about: tuple[float, float]) -> tuple[list[str], Array, Array]:
    """Return names, values and standard errors: shares by status, and mean and second moments [m]
    in a plane about a place.
    """
    names, values, errors = [], [], []
    n = told.lon.size
    for status in Status:
        share = float((told.status == status).mean())
        names.append(status.name)
        values.append(share)
        errors.append(np.sqrt(share * (1 - share) / n))
    there = told.status != Status.PENDING
    x = (told.lon[there] - about[0]) * np.radians(R) * np.cos(np.radians(about[1]))
    y = (told.lat[there] - about[1]) * np.radians(R)
    a, b = x - x.mean(), y - y.mean()
    for what, values_of in (
        ("east", x),
        ("north", y),
        ("east 2", a * a),
        ("north 2", b * b),
        ("both", a * b),
    ):
        names.append(what)
        values.append(float(values_of.mean()))
        errors.append(float(values_of.std() / np.sqrt(there.sum())))
    return names, np.array(values), np.array(errors)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "hours"),
    [*END.items(), *(pytest.param(*one, marks=pytest.mark.thorough) for one in MIDWAY.items())],
)
def test_case_is_where_a_second_opinion_says(name: str, hours: float) -> None:
    rng = np.random.default_rng([20_260_603, int(hours)])
    theirs = ORACLES[name](rng, THEIRS[name], hours)
    found = ours(name)[hours]
    assert len(found) == len(theirs) == len(table(name)["scenario"])
    for number_of, (mine, their) in enumerate(zip(found, theirs, strict=True)):
        middle = float(their.lon.mean()), float(their.lat.mean())
        names, a, e = numbers(mine, middle)
        _, b, f = numbers(their, middle)
        apart = (a - b) / np.maximum(np.hypot(e, f), 1e-300)
        lines = [
            f"{what}: {p:.6g}, oracle {q:.6g}: {z:+.1f}"
            for what, p, q, z in zip(names, a, b, apart, strict=True)
        ]
        assert (np.abs(apart[a != b]) < SIGMAS).all(), (number_of, lines)


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
SEEN = {
    "cast_submarine": (12_000, 24_000),
    "medsearch_transit": (5_000, 40_000),
    "smuggler_bridge": (30_000, 30_000),
}  # particles: theirs, ours


@pytest.mark.thorough
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.thorough] * (name != "cast_submarine"))
        for name in POSTERIORS
    ],
)
def test_what_was_seen_says_what_a_second_opinion_says(name: str) -> None:
    """Posterior of the scenarios, what has arrived, mean and second moments at the end, given all
    sensors and contacts.
    """
    n, particles = SEEN[name]
    theirs, chances = POSTERIORS[name](np.random.default_rng(20_260_606), n)
    settings = {"particles": str(particles), "resampling": "{}", "expect": "{}"}
    loaded = case_file.load(
        name, settings | {"output": '{ every = "100 d", trajectories = 1_000_000 }'}
    )
    tracks = flow.run(loaded).trajectories
    mine = [tracks.scenario == k for k in range(len(loaded.scenarios))]
    lon, lat = (x[:, -1].astype(float) * 360 / 2**32 for x in (tracks.lon, tracks.lat))
    found = told(
        [Where(lon[k], lat[k], tracks.status[k, -1]) for k in mine],
        [tracks.weight[k, -1].astype(float) for k in mine],
    )
    expected = told(theirs, chances)
    apart = (found[0] - expected[0]) / np.maximum(np.hypot(found[1], expected[1]), 1e-300)
    assert (np.abs(apart[found[0] != expected[0]]) < SIGMAS).all(), (found, expected, apart)
    before = np.array([one.get("weight", 1.0) for one in table(name)["scenario"]])[:-1]
    # what was seen says something of the scenarios, where there are several
    there = slice(0, before.size)
    assert not before.size or (np.abs(found[0][there] - before) > 10 * found[1][there]).any()


def told(where: list[Where], weight: list[Array]) -> tuple[Array, Array]:
    """Return the shares of all scenarios but the last and of what has arrived, mean place and
    second moments, with standard errors.

    They are ratios of weighted sums, linearised by scenario.
    """
    total, stories = sum(float(w.sum()) for w in weight), np.eye(len(where))[:, :-1]
    middle = [
        sum(w @ x for w, x in zip(weight, xs, strict=True)) / total
        for xs in zip(*((p.lon, p.lat) for p in where), strict=True)
    ]
    columns = []
    for story, one in zip(stories, where, strict=True):
        x, y = one.lon - middle[0], one.lat - middle[1]
        shares = np.tile(story, (x.size, 1))
        columns.append(
            np.column_stack(
                [shares, one.status == Status.ARRIVED, one.lon, one.lat, x * x, x * y, y * y]
            )
        )
    value = sum(w @ c for w, c in zip(weight, columns, strict=True)) / total
    variance = np.zeros(value.size)
    for w, c in zip(weight, columns, strict=True):
        left = w[:, None] * (c - value) / total
        variance += w.size * left.var(axis=0)
    return np.asarray(value), np.sqrt(variance)
