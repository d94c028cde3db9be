"""pacsearch in plain float64: submarines by their scenarios, arrays that hear them or not by
chance, and what contacts make of it.

Where the project carries the probability of silence along, this draws the fluctuation of each array
for each submarine and lets it jump: who is heard is out. It shares no code with the project.
Bearings are degrees, ranges metres, times hours after the start.
"""

import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import passages
import pyproj
import xarray as xr
from places import ROOT
from scipy import stats
from scipy.spatial import Delaunay

GEOD = pyproj.Geod(a=6_371_008.8, b=6_371_008.8)
NMI, KNOT, HOUR = 1852.0, 1852.0 / 3600, 3600.0
BETWEEN = 1 / 6  # [h] from one moment to the next at which it is asked whether a submarine is heard
Array = np.ndarray
CASE = tomllib.loads((ROOT / "cases" / "pacsearch.toml").read_text())


def number(text: Any) -> float:
    """Return the number of a quantity as it is written."""
    return float(text if isinstance(text, int | float) else text.lstrip("+").split()[0])


def place(text: str) -> tuple[float, float]:
    """Return (lon, lat) [deg] of 46 30N 158 00W."""
    words = text.split()
    lat, lon = (float(words[k]) + float(words[k + 1][:-1]) / 60 for k in (0, 2))
    return lon * (-1 if words[3][-1] == "W" else 1), lat


@dataclass(frozen=True)
class Submarines:
    """Submarines, and what is believed of them."""

    axes: Array  # (n, 3) numbers of their route, speed and departure
    # (n, k, 3) unit vectors of their way points, the last again and again where a route has fewer
    point: Array
    hour: Array  # (n, k)
    weight: Array  # (n,)

    def _leg(self, hour: float) -> tuple[Array, Array, Array, Array, Array]:
        """Return of the leg that they are on where it begins and ends (n, 3), its angle, and when
        it begins and ends.
        """
        k = np.clip((self.hour <= hour).sum(axis=1) - 1, 0, self.hour.shape[1] - 2)
        row = np.arange(k.size)
        a, b = self.point[row, k], self.point[row, k + 1]
        angle = 2 * np.arcsin(np.clip(np.linalg.norm(b - a, axis=1) / 2, 0, 1))
        return a, b, angle, self.hour[row, k], self.hour[row, k + 1]

    def at(self, hour: float) -> tuple[Array, Array]:
        """Return where they are (lon, lat) [deg]."""
        a, b, angle, begin, end = self._leg(hour)
        share = np.clip((hour - begin) / (end - begin), 0, 1)
        whole = np.maximum(np.sin(angle), 1e-15)
        p, q = np.sin((1 - share) * angle) / whole, np.sin(share * angle) / whole
        x, y, z = np.where(angle[:, None] > 1e-9, p[:, None] * a + q[:, None] * b, a).T
        return np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, np.hypot(x, y)))

    def pace(self, hour: float) -> Array:
        """Return how fast they go [m/s] over ground."""
        _, _, angle, begin, end = self._leg(hour)
        return np.where(
            (begin <= hour) & (hour < end), angle * GEOD.a / ((end - begin) * HOUR), 0.0
        )

    def there(self, hour: float) -> Array:
        """Return whether they have departed."""
        return self.hour[:, 0] <= hour

    def some(self, chosen: Array, weight: Array) -> "Submarines":
        """Return some of them, by number, with other weights."""
        return Submarines(*(x[chosen] for x in (self.axes, self.point, self.hour)), weight)


def drawn(rng: np.random.Generator, n: int) -> Submarines:
    """Draw submarines by the weights of their scenarios."""
    (family,) = CASE["family"]
    axis = family["axis"]
    weights = [
        axis["route"]["weights"],
        axis["speed"]["weights"],
        np.ones(axis["departure"]["ranges"]),
    ]
    axes = np.stack([rng.choice(len(w), n, p=np.array(w) / np.sum(w)) for w in weights], axis=1)

    def within(name: str, k: int) -> Array:
        low, high = (number(axis[name][end]) for end in ("from", "to"))
        return low + (high - low) * (axes[:, k] + rng.uniform(size=n)) / axis[name]["ranges"]

    speed, departure = within("speed", 1) * KNOT, within("departure", 2)
    side, off = (
        rng.standard_normal(n),
        number(family["scenario"]["phase"][0]["voyage"]["cross_track"]) * NMI,
    )
    routes = [
        [place(one) for one in CASE["voyage"][name]["waypoints"]]
        for name in axis["route"]["values"]
    ]
    most = max(map(len, routes))
    point, hour = np.empty((n, most, 3)), np.empty((n, most))
    for k, route in enumerate(routes):
        here = axes[:, 0] == k
        x, y, along = passages.aside(route, [2 * off] * (len(route) - 1), side[here])
        time = departure[here, None] + along / speed[here, None] / HOUR
        more = most - len(route)
        x, y = (np.radians(np.pad(z, ((0, 0), (0, more)), mode="edge")) for z in (x, y))
        point[here] = np.stack([np.cos(y) * np.cos(x), np.cos(y) * np.sin(x), np.sin(y)], axis=-1)
        hour[here] = np.hstack([time, time[:, -1:] + np.arange(1, more + 1)])
    return Submarines(axes, point, hour, np.full(n, 1 / n))


@dataclass(frozen=True)
class Ears:
    """A sonar of the case."""

    told: dict[str, Any]
    ranges: Array
    losses: Array  # [dB] (places, 12, ranges)
    spots: Array  # (places, 2) [m] in the plane about the middle of the places
    about: tuple[float, float]
    gain: Array  # [dB] by the tenth of a degree of relative bearing

    def excess(self, own: tuple[float, float], heading: float, bearing: Array, far: Array) -> Array:
        """Return the signal excess of a source of 0 dB [dB]."""
        table = np.tensordot(self._weights(own), self.losses, 1)
        table = np.vstack([table, table[:1]])
        turned, out = (bearing % 360) / 30, np.clip(far, self.ranges[0], None)
        ray = np.minimum(turned.astype(int), 11)
        ring = np.clip(
            (out - self.ranges[0]) / (self.ranges[1] - self.ranges[0]),
            0,
            self.ranges.size - 1 - 1e-9,
        )
        k, a, b = ring.astype(int), turned - ray, ring % 1
        loss = (1 - a) * ((1 - b) * table[ray, k] + b * table[ray, k + 1])
        loss += a * ((1 - b) * table[ray + 1, k] + b * table[ray + 1, k + 1])
        around, level = np.array([[angle, number(one)] for angle, one in self.told["noise"]]).T
        noise = np.interp(bearing, around, level, period=360.0)
        gain = np.interp((bearing - heading) % 360, np.arange(3601) / 10, self.gain)
        found = gain - noise - loss - number(self.told["threshold"])
        return np.where(far <= self.ranges[-1], found, -np.inf)

    def _weights(self, own: tuple[float, float]) -> Array:
        """Return how much each place counts: straight on Delaunay's triangles."""
        mesh, here = Delaunay(self.spots), np.array(plane(self.about, *own))
        simplex = int(mesh.find_simplex(here))
        assert simplex >= 0  # no array of the case is beyond the places
        corners = mesh.simplices[simplex]
        weight = np.zeros(len(self.spots))
        weight[corners] = np.linalg.solve(
            np.vstack([self.spots[corners].T, np.ones(3)]), [*here, 1.0]
        )
        return weight


def plane(about: tuple[float, float], lon: float, lat: float) -> tuple[float, float]:
    """Return (east, north) [m] in the azimuthal equidistant plane about a place."""
    bearing, _, far = GEOD.inv(*about, lon, lat)
    return far * np.sin(np.radians(bearing)), far * np.cos(np.radians(bearing))


def line_gain(line: dict[str, Any]) -> Array:
    """Return the gain of the best beam of a line array by relative bearing, every tenth of a degree
    [dB].

    Of each beam power in its own direction over the mean power from all over the sphere, by
    quadrature.
    """
    n, wave = line["elements"], 1500.0 / number(line["frequency"])
    turn = 2 * np.pi * number(line["spacing"]) / wave
    ahead = np.cos(np.radians(np.arange(3601) / 10))
    nodes, quadrature = np.polynomial.legendre.leggauss(400)

    def answer(x: Array, steered: float) -> Array:
        return np.abs(np.exp(1j * turn * np.outer(x - steered, np.arange(n))).mean(axis=1)) ** 2

    beams = np.linspace(1, -1, int(np.ceil(2 * n * turn / (2 * np.pi) / 0.886)) + 1)
    powers = [answer(ahead, c) / (answer(nodes, c) @ quadrature / 2) for c in beams]
    return 10 * np.log10(np.max(powers, axis=0))


def ears() -> dict[str, Ears]:
    """Return the case's sonars by name."""
    found = {}
    for sensor in CASE["sensor"]:
        told = sensor["sonar"]
        with xr.open_dataset(ROOT / "cases" / told["loss"]["file"]) as data:
            loss = (
                data["loss"]
                .sel(told["loss"]["select"])
                .transpose("place", "bearing", "range")
                .values
            )
            lon, lat, ranges = (data[name].values for name in ("lon", "lat", "range"))
        x, y = np.radians(lon), np.radians(lat)
        middle = np.mean([np.cos(y) * np.cos(x), np.cos(y) * np.sin(x), np.sin(y)], axis=1)
        about = tuple(
            np.degrees(
                [np.arctan2(middle[1], middle[0]), np.arctan2(middle[2], np.hypot(*middle[:2]))]
            )
        )
        spots = np.array([plane(about, a, b) for a, b in zip(lon, lat, strict=True)])
        found[sensor["name"]] = Ears(
            told, ranges, loss, spots, about, line_gain(told["gain"]["line"])
        )
    return found


def level(pace: Array) -> Array:
    """Return source levels [dB] at paces [m/s]."""
    rows = CASE["family"][0]["scenario"]["source_level"]
    speed, level = np.array([[number(a), number(b)] for a, b in rows]).T
    return np.interp(pace / KNOT, speed, level)


def toward(own: tuple[float, float], lon: Array, lat: Array) -> tuple[Array, Array]:
    """Return bearings [deg] and ranges [m] by the formulae of the sphere: quicker than geodesics."""
    x, y, dx = np.radians(own[1]), np.radians(lat), np.radians(lon - own[0])
    east, north = np.cos(y) * np.sin(dx), np.cos(x) * np.sin(y) - np.sin(x) * np.cos(y) * np.cos(dx)
    up = np.sin(x) * np.sin(y) + np.cos(x) * np.cos(y) * np.cos(dx)
    return np.degrees(np.arctan2(east, north)), GEOD.a * np.arctan2(np.hypot(east, north), up)


def way(
    sortie: dict[str, Any],
) -> tuple[float, float, Callable[[float], tuple[tuple[float, float], float]]]:
    """Return when a sortie begins and ends, and where its array is and heads by time."""
    if "waypoints" not in sortie:
        (own,) = [one for one in CASE["sensor"] if one["name"] == sortie["watch"]["sensor"]]
        return (
            number(sortie["start"]),
            number(sortie["end"]),
            lambda hour: (place(own["at"]), own["heading"]),
        )
    hours = [number(time) for time, _ in sortie["waypoints"]]
    points = [place(point) for _, point in sortie["waypoints"]]

    def at(hour: float) -> tuple[tuple[float, float], float]:
        k = int(np.clip(np.searchsorted(hours, hour, side="right") - 1, 0, len(hours) - 2))
        course, _, far = GEOD.inv(*points[k], *points[k + 1])
        share = (hour - hours[k]) / (hours[k + 1] - hours[k])
        lon, lat, back = GEOD.fwd(*points[k], course, share * far)
        return (lon, lat), (back + 180) % 360

    return hours[0], hours[-1], at


def missed(
    rng: np.random.Generator, ear: Ears, sortie: dict[str, Any], submarines: Submarines
) -> Array:
    """Return of whom a watch has heard nothing, by chance."""
    begin, end, own = way(sortie)
    rate, spread, n = (
        number(ear.told["jump_rate"]),
        number(ear.told["fluctuation"]),
        submarines.weight.size,
    )
    many = round((end - begin) / BETWEEN)
    moments = np.linspace(begin, end, many + 1)
    fluctuation, silent = rng.standard_normal(n) * spread, np.ones(n, bool)
    jumps = -np.expm1(-rate * (end - begin) / many)
    for k, hour in enumerate(moments):
        anew = (rng.uniform(size=n) < jumps) & (k > 0)
        fluctuation = np.where(anew, rng.standard_normal(n) * spread, fluctuation)
        at, heading = own(hour)
        bearing, far = toward(at, *submarines.at(hour))
        near = silent & submarines.there(hour) & (far <= ear.ranges[-1])
        over = ear.excess(at, heading, bearing[near], far[near]) + level(
            submarines.pace(hour)[near]
        )
        silent[near] &= over + fluctuation[near] <= 0
    return silent


def likely(ear: Ears, contact: dict[str, Any], submarines: Submarines) -> Array:
    """Return how likely a contact is of each submarine: density of its bearing [1/deg] or its
    image's, and being heard at once.
    """
    told, hour = contact["bearing"], number(contact["time"])
    (sensor,) = [one for one in CASE["sensor"] if one["name"] == told["sensor"]]
    at, heading = (
        place(told.get("from") or sensor["at"]),
        told.get("heading", sensor.get("heading")),
    )
    bearing, far = toward(at, *submarines.at(hour))
    relative = np.abs((bearing - heading + 180) % 360 - 180)
    angle, std = np.array([[a, number(b)] for a, b in told["std"]]).T
    error = np.interp(np.minimum(relative, 180 - relative), angle, std)
    images = (told["bearing"], 2 * heading - told["bearing"])
    off = [(one - bearing + 180) % 360 - 180 for one in images]
    density = np.mean([stats.norm.pdf(x, scale=error) for x in off], axis=0)
    over = ear.excess(at, heading, bearing, far) + level(submarines.pace(hour))
    heard = stats.norm.cdf(over / number(ear.told["fluctuation"]))
    return np.where(submarines.there(hour), density * heard, 0.0)


@dataclass(frozen=True)
class After:
    """What is believed after an update."""

    name: str
    submarines: Submarines
    pos: float = np.nan  # of a sortie: the probability that it would have heard the target
    error: float = np.nan  # standard error of that


def believed(rng: np.random.Generator, many: int, kept: int) -> Iterator[After]:
    """Yield what is believed after each update, in their order.

    Of `many` submarines some `kept` are followed, each by a chance of its own: more of those that
    contacts are likely of. They weigh accordingly less.
    """
    sonars, every = ears(), drawn(rng, many)
    one, two = (likely(sonars[c["bearing"]["sensor"]], c, every) for c in CASE["contact"])
    some = np.mean(
        [x / x.mean() for x in (np.ones(many), one, two, np.sqrt(one * two), one * two)], axis=0
    )
    chance = np.minimum(some * kept / many, 1)
    chosen = np.flatnonzero(rng.uniform(size=many) < chance)
    now = every.some(chosen, 1 / (many * chance[chosen]))
    sorties = [(way(sortie)[1], "sortie", sortie) for sortie in CASE["sortie"]]
    contacts = [(number(contact["time"]), "contact", contact) for contact in CASE["contact"]]
    for _, kind, told in sorted([*sorties, *contacts], key=lambda update: update[0]):
        weight = now.weight / now.weight.sum()
        if kind == "sortie":
            silent = missed(rng, sonars[told["watch"]["sensor"]], told, now)
            pos = float(weight @ ~silent)
            now = now.some(np.flatnonzero(silent), now.weight[silent])
            yield After(told["name"], now, pos, float(np.sqrt(weight**2 @ (~silent - pos) ** 2)))
        else:
            said = likely(sonars[told["bearing"]["sensor"]], told, now)
            now = replace(
                now, weight=weight * (told["belief"] * said / (weight @ said) + 1 - told["belief"])
            )
            yield After(told["name"], now)
