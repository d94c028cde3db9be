"""Passive sonars in plain float64: the sonar equation along pyproj's geodesics, and what a silent
watch says of a target.

It shares no code with ours. Positions are degrees, ranges metres, times hours after the run's
start, speeds knots.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import xarray as xr
from scipy import special

from drift.case import file as case_file
from drift.engine.motion import simulate
from drift.pipeline import run_setup
from geo.array import Array
from kernels.runtime import runtime

GLOBE = pyproj.Geod(a=6_371_008.8, b=6_371_008.8)
NMI, KNOT, HOUR = 1852.0, 1852.0 / 3600, 3600.0
BEGIN = np.datetime64("2026-06-01T00:00:00")
HEAD = """
title = "Sonars"
start = "2026-06-01T00:00Z"
duration = "DURATION h"
particles = PARTICLES
seed = 8
output.times = []
coast.source = "none"
uncertainty = "none"
clock.step = "STEP min"
"""


@dataclass(frozen=True)
class Sonar:
    """A sonar as the oracle knows it, which can write itself down as a [[sensor]] table."""

    name: str = "ears"
    # (lon, lat) of the tables of losses; (): one, everywhere
    places: tuple[tuple[float, float], ...] = ()
    radials: Array = field(default_factory=lambda: np.zeros(1))  # [deg] true
    ranges: Array = field(default_factory=lambda: np.array([0.0, 4e5]))  # [m]
    # [dB] (places, radials, ranges)
    loss: Array = field(default_factory=lambda: np.array([[[60.0, 90.0]]]))
    hours: tuple[float, ...] = (0.0,)  # of the noise
    around: Array = field(default_factory=lambda: np.zeros(1))  # [deg] true
    noise: Array = field(default_factory=lambda: np.array([[70.0]]))  # [dB] (hours, around)
    sides: Array = field(default_factory=lambda: np.zeros(1))  # [deg] relative bearings of the gain
    gain: Array = field(default_factory=lambda: np.zeros(1))  # [dB]
    threshold: float = 8.0
    fluctuation: float = 6.0
    rate: float = 1.0  # [1/h] of jumps
    unknown: float = 0.0
    # by scenario: [dB], or rows of speed and level
    levels: dict[str, Any] = field(default_factory=dict)
    at: tuple[float, float] | None = None
    heading: float | None = None
    group: str = ""

    def text(self, folder: Path) -> str:
        """Return its table, and write its files into a folder."""
        losses = xr.Dataset(
            {
                "loss": (
                    ("place", "bearing", "range"),
                    self.loss,
                    {"units": "dB", "long_name": "transmission loss"},
                )
            },
            {
                "bearing": ("bearing", self.radials, {"units": "degrees"}),
                "range": ("range", self.ranges, {"units": "m"}),
            },
        )
        if self.places:
            lon, lat = np.array(self.places).T
            losses = losses.assign_coords(
                lon=("place", lon, {"units": "degrees_east"}),
                lat=("place", lat, {"units": "degrees_north"}),
            )
        else:
            losses = losses.isel(place=0)
        if len(self.radials) == 1:
            losses = losses.isel(bearing=0, drop=True)
        losses.to_netcdf(folder / f"{self.name}_loss.nc")
        noise = str(
            [[float(a), f"{b} dB"] for a, b in zip(self.around, self.noise[0], strict=True)]
        )
        if len(self.hours) > 1:
            times = BEGIN + np.array([round(3600 * h) for h in self.hours]).astype("timedelta64[s]")
            xr.Dataset(
                {"noise": (("time", "bearing"), self.noise, {"units": "dB"})},
                {
                    "time": times.astype("datetime64[ns]"),
                    "bearing": ("bearing", self.around, {"units": "degrees"}),
                },
            ).to_netcdf(folder / f"{self.name}_noise.nc")
            noise = f'{{ file = "{self.name}_noise.nc" }}'
        gain = str([[float(a), f"{b} dB"] for a, b in zip(self.sides, self.gain, strict=True)])
        levels = ", ".join(f'"{name}" = {_level(own)}' for name, own in self.levels.items())
        return "\n".join(
            [
                "[[sensor]]",
                f'name = "{self.name}"',
                *([f"at = {list(self.at)}"] if self.at else []),
                *([f"heading = {self.heading}"] if self.heading is not None else []),
                *([f'group = "{self.group}"'] if self.group else []),
                "[sensor.sonar]",
                f"source_level = {{ {levels} }}",
                f'loss = {{ file = "{self.name}_loss.nc" }}',
                f"noise = {noise}",
                f"gain = {gain}",
                f'threshold = "{self.threshold} dB"',
                f'fluctuation = "{self.fluctuation} dB"',
                f'jump_rate = "{self.rate} /h"',
                f'unknown = "{self.unknown} dB"',
                "",
            ]
        )

    def source(self, scenario: str, speed: Array | float) -> Array:
        """Return the source level of a scenario [dB] at a speed."""
        own = self.levels[scenario]
        if not isinstance(own, list):
            return np.full(np.shape(speed), float(own))
        return np.interp(speed, *np.array(own, float).T)

    def losses(self, lon: float, lat: float) -> Array:
        """Return its table of losses at a place: straight between its places in the plane about
        their middle.
        """
        if len(self.places) < 2:
            return self.loss[0]
        x, y = np.radians(np.array(self.places)).T
        middle = np.mean([np.cos(y) * np.cos(x), np.cos(y) * np.sin(x), np.sin(y)], axis=1)
        about = np.degrees(
            [np.arctan2(middle[1], middle[0]), np.arctan2(middle[2], np.hypot(*middle[:2]))]
        )
        spots = np.stack(plane(about, *np.array(self.places).T), axis=-1)
        here = np.stack(plane(about, np.array([lon]), np.array([lat])), axis=-1)[0]
        if len(self.places) == 2:
            way = spots[1] - spots[0]
            share = float(np.clip((here - spots[0]) @ way / (way @ way), 0, 1))
            weight = np.array([1 - share, share])
        else:
            assert len(self.places) == 3
            weight = np.linalg.solve(np.vstack([spots.T, np.ones(3)]), [*here, 1.0])
            assert weight.min() >= 0  # the tests stay inside
        return np.tensordot(weight, self.loss, 1)

    def excess(
        self, own: tuple[float, float], heading: float, hour: float, lon: Array, lat: Array
    ) -> Array:
        """Return the signal excess [dB] of a source of 0 dB at places (n,) heard at its own one;
        -inf beyond its table.
        """
        bearing, far = toward(own, lon, lat)
        table = self.losses(*own)
        ring = np.clip(np.searchsorted(self.ranges, far, side="right") - 1, 0, len(self.ranges) - 2)
        share = np.clip((far - self.ranges[ring]) / np.diff(self.ranges)[ring], 0, 1)
        near, far_end = (_around(self.radials, table, bearing, at) for at in (ring, ring + 1))
        loss = (1 - share) * near + share * far_end
        level = [np.interp(hour, self.hours, column) for column in self.noise.T]
        noise = np.interp(bearing, self.around, level, period=360.0)
        gain = np.interp(bearing - heading, self.sides, self.gain, period=360.0)
        return np.where(far <= self.ranges[-1], gain - noise - loss - self.threshold, -np.inf)

    def chance(self, excess: Array) -> Array:
        """Return the probability of being heard at once."""
        return special.ndtr(excess / self.fluctuation)


def _around(radials: Array, table: Array, bearing: Array, ring: Array) -> Array:
    """Return values (n,) of a table (radials, rings) at bearings [deg], straight between radials,
    each at its ring.
    """
    order = np.argsort(radials % 360)
    rays = (radials % 360)[order]
    rays = np.concatenate([rays[-1:] - 360, rays, rays[:1] + 360])
    rows = np.concatenate([order[-1:], order, order[:1]])
    turned = bearing % 360
    k = np.searchsorted(rays, turned, side="right") - 1
    share = (turned - rays[k]) / (rays[k + 1] - rays[k])
    return np.asarray((1 - share) * table[rows[k], ring] + share * table[rows[k + 1], ring])


def _level(own: Any) -> str:
    return (
        str([[f"{s} kn", f"{level} dB"] for s, level in own])
        if isinstance(own, list)
        else f'"{own} dB"'
    )


def toward(own: tuple[float, float], lon: Array, lat: Array) -> tuple[Array, Array]:
    """Return true bearings [deg] and ranges [m] of places (n,) from one."""
    bearing, _, far = GLOBE.inv(np.full(len(lon), own[0]), np.full(len(lon), own[1]), lon, lat)
    return np.asarray(bearing), np.asarray(far)


def plane(about: Any, lon: Array, lat: Array) -> tuple[Array, Array]:
    """Return (east, north) [m] in the azimuthal equidistant plane about a place."""
    bearing, far = toward(tuple(about), lon, lat)
    return far * np.sin(np.radians(bearing)), far * np.cos(np.radians(bearing))


@dataclass(frozen=True)
class Way:
    """Places with times, great circles in between: of a towed array, or of a target; before and
    after it stays there.
    """

    hours: tuple[float, ...]
    points: tuple[tuple[float, float], ...]

    def at(self, hour: float) -> tuple[tuple[float, float], float]:
        """Return the place and the course [deg] at a time."""
        k = int(
            np.clip(np.searchsorted(self.hours, hour, side="right") - 1, 0, len(self.points) - 2)
        )
        share = np.clip((hour - self.hours[k]) / (self.hours[k + 1] - self.hours[k]), 0, 1)
        course, _, far = GLOBE.inv(*self.points[k], *self.points[k + 1])
        lon, lat, back = GLOBE.fwd(*self.points[k], course, share * far)
        return (lon, lat), (back + 180) % 360 if share > 0 else course

    def text(self) -> str:
        """Return it as waypoints."""
        return str(
            [[f"+{hour} h", list(at)] for hour, at in zip(self.hours, self.points, strict=True)]
        )


def rhumb(lon: Array, lat: Array, course: float, far: Array) -> tuple[Array, Array]:
    """Return where a constant course [deg] leads from places in so many metres."""
    arc, c = np.asarray(far) / GLOBE.a, np.radians(course)
    end = lat + np.degrees(arc) * np.cos(c)
    isometric = np.arctanh(np.sin(np.radians(end))) - np.arctanh(np.sin(np.radians(lat)))
    return lon + np.degrees(np.tan(c) * isometric), end


def missed(p: Array, hours: Array, rate: float) -> Array:
    """Return the probability (n, m) that nothing has been heard by each time (m,), of chances p (n,
    m) to be heard at once.

    G(t) = e^(-lt) (1 - max p[0, t]) + int l e^(-l(t-s)) G(s) (1 - max p[s, t]) ds, what stands
    beside the exponential taken to be straight between the times.
    """
    p = np.ascontiguousarray(p.T)  # (m, n): what stands before a time lies together
    x = np.maximum(rate * np.diff(hours), 1e-12)
    # of the end of each panel, as seen from there; the rest is of its begin
    late = 1 + np.expm1(-x) / x
    early = -np.expm1(-x) - late
    found, highest = np.empty(p.shape), np.zeros(p.shape)
    for k in range(len(p)):
        np.maximum(highest[: k + 1], p[k], out=highest[: k + 1])
        decay = np.exp(-rate * (hours[k] - hours[: k + 1]))
        first = decay[0] * (1 - highest[0])
        if k == 0:
            found[0] = first
            continue
        weight = np.append(decay[1:] * early[:k], 0) + np.append(0, decay[1:] * late[:k])
        known = weight[:-1] @ found[:k] - np.einsum(
            "k,kn,kn->n", weight[:-1], found[:k], highest[:k]
        )
        found[k] = (first + known) / (1 - weight[-1] * (1 - p[k]))
    return found.T


def heard(
    sonar: Sonar,
    way: Callable[[float], tuple[tuple[float, float], float]],
    hours: Array,
    targets: Callable[[float], tuple[Array, Array, Array]],
    unknown: float = 0.0,
    silent: Callable[[float], bool] = lambda hour: False,
) -> Array:
    """Return the chances (n, m) of being heard at once at times (m,).

    way: place and heading of the array at a time; targets: lon, lat and source level of each then,
    -inf of what is not there; unknown: [dB] that all have in common; silent: whether the array does
    not listen then.
    """
    columns = []
    for hour in hours:
        lon, lat, source = targets(hour)
        place, heading = way(hour)
        over = sonar.excess(place, heading, hour, lon, lat) + source + unknown
        columns.append(np.zeros(len(lon)) if silent(hour) else sonar.chance(over))
    return np.stack(columns, axis=1)


def bracket(p: Array, many: int) -> tuple[Array, Array]:
    """Return the lowest and highest chance within so many times before and after each."""
    padded = np.pad(p, ((0, 0), (many, many)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * many + 1, axis=1)
    return windows.min(axis=-1), windows.max(axis=-1)


@dataclass(frozen=True)
class Ran:
    """A run: particles at the begin and the logs of what its updates made of their weights."""

    first: Array  # (n, 2) [deg] lon, lat
    last: Array
    said: Array  # float64 (n,): log weight at the end less that at the begin
    scenario: Array  # (n,)
    ensemble: Any
    moments: list[Any]
    updates: Any


def run(
    folder: Path,
    text: str,
    *,
    particles: int = 300,
    hours: float = 6,
    step: float = 30,
    outputs: Sequence[float] = (),
    shore: str = "none",
) -> Ran:
    """Run a case, of which `text` is what follows HEAD."""
    path = folder / "case.toml"
    head = (
        HEAD.replace("DURATION", f"{hours}")
        .replace("PARTICLES", f"{particles}")
        .replace("STEP", f"{step}")
    )
    times = [f"+{hour} h" for hour in outputs]
    head = head.replace("output.times = []", f"output.times = {times}").replace(
        '"none"', f'"{shore}"', 1
    )
    path.write_text(head + text)
    case = case_file.load(path)
    runtime.start()
    begun = run_setup.prepare(case, run_setup.open_for(case))
    search = run_setup.build_search_filter(case, begun)
    outputs = case.period.seconds(case.outputs)
    moments = list(simulate.run(begun.ensemble, begun.scene, begun.clock, outputs, search=search))
    begun.scene.forcing.close()
    ends = [np.stack([m.lon, m.lat], axis=-1) * (360 / 2**32) for m in (moments[0], moments[-1])]
    with np.errstate(invalid="ignore"):  # spare slots have no weight before or after
        said = moments[-1].log_weight.astype(float) - moments[0].log_weight
    return Ran(
        *ends, said, begun.ensemble.scenario.to_numpy(), begun.ensemble, moments, search.updates
    )


def louder(sonar: Sonar, more: float) -> Sonar:
    """Return a sonar whose targets are louder by so many dB."""

    def level(own: Any) -> Any:
        return [(s, x + more) for s, x in own] if isinstance(own, list) else own + more

    return replace(sonar, levels={name: level(own) for name, own in sonar.levels.items()})
