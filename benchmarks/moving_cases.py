"""Random cases of targets that drift, spread, converge and mix, for a plan and its bound to be
tried on.

A field of currents on a grid of 0.02 degrees in the open Atlantic, of one of these kinds: plain
(all drift as one), strait (from far and wide towards one gap, and through it), front (converging on
a line, along which they are sheared), saddle (strain and a vortex). Errors of the current are
Ornstein-Uhlenbeck of 0.03 to 0.7 m/s a component over 2 to 14 h, and a bias that lasts. One to
three scenarios of 0.2 to 8 nmi, one in three with a failed search. Two to four units, boats and
aircraft together, sweep widths that differ by scenario and are unsure by up to 60 %, laws of all
kinds, one to three rounds, 6 to 72 h. Half of the cases plan for finding alive.
"""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

import drift
from drift.case.record import Case
from drift.evidence.filter.records import Unit

NMI = 1852.0
LON, LAT = -30.0, 45.0
DEGREE = 60 * NMI
START = np.datetime64("2026-06-16T00:00:00", "s")
KINDS = ("plain", "strait", "front", "saddle")


def current(kind: str, rng: np.random.Generator, hours: float) -> xr.Dataset:
    """Return currents of a kind, steady in time [m/s]."""
    lon, lat = np.arange(LON - 4, LON + 4, 0.02), np.arange(LAT - 3, LAT + 3, 0.02)
    x, y = np.meshgrid((lon - LON) * DEGREE * np.cos(np.radians(LAT)), (lat - LAT) * DEGREE)
    east, north = rng.uniform(-0.3, 0.3, 2)
    turn = rng.uniform(0, 2 * np.pi)
    along, across = x * np.cos(turn) + y * np.sin(turn), -x * np.sin(turn) + y * np.cos(turn)
    fast, wide = rng.uniform(0.15, 0.5), rng.uniform(2, 10) * NMI
    if kind == "strait":
        reach = np.hypot(along, across) + wide
        slow, aside = fast * (0.4 - along / reach), -fast * across / reach
    elif kind == "front":
        slow, aside = fast * np.tanh(across / (2 * wide)), -fast * np.tanh(across / wide)
    elif kind == "saddle":
        rate, spin = rng.uniform(0.3, 2, 2) * 1e-5
        slow, aside = rate * along - spin * across, spin * along - rate * across
    else:
        slow, aside = fast + 0 * x, 0 * x
    steady = kind == "plain" or kind == "saddle"
    east, north = (east, north) if steady else (0.3 * east, 0.3 * north)
    u = east + slow * np.cos(turn) - aside * np.sin(turn)
    v = north + slow * np.sin(turn) + aside * np.cos(turn)
    time = START + np.array([-6, round(hours) + 90]) * np.timedelta64(3600, "s")
    held = {
        "x_sea_water_velocity": (
            ("time", "lat", "lon"),
            np.stack([np.clip(u, -1.5, 1.5)] * 2).astype("f4"),
        ),
        "y_sea_water_velocity": (
            ("time", "lat", "lon"),
            np.stack([np.clip(v, -1.5, 1.5)] * 2).astype("f4"),
        ),
    }
    names = {
        "x_sea_water_velocity": "eastward_sea_water_velocity",
        "y_sea_water_velocity": "northward_sea_water_velocity",
    }
    data = xr.Dataset(held, {"time": time.astype("datetime64[ns]"), "lat": ("lat", lat, {"units": "degrees_north"}),
                             "lon": ("lon", lon, {"units": "degrees_east"})})  # fmt: skip
    for name, standard in names.items():
        data[name].attrs = {"standard_name": standard, "units": "m s-1"}
    return data


def case(number: int, particles: int) -> tuple[Case, xr.Dataset, str, float]:
    """Return a random case, its currents, what it is like, and the bound that its effort is to be
    scaled to.
    """
    rng = np.random.Generator(np.random.Philox(key=20_000 + number))
    kind = KINDS[number % len(KINDS)]
    tenfold = number % 5 == 4  # spreads tenfold or more: small at first, large errors
    hours = int(rng.integers(6, 73))
    data = current(kind, rng, hours)
    std, memory = np.exp(rng.uniform(np.log(0.03), np.log(0.7))), rng.uniform(2, 14)
    if tenfold:
        std, hours = rng.uniform(0.4, 0.7), max(hours, 24)
    lasts = rng.uniform(0, 0.1)
    alive = bool(rng.random() < 0.5)
    rounds = int(rng.choice([1, 1, 2, 3]))
    stories = int(rng.integers(1, 4))
    failed = bool(rng.random() < 1 / 3) and hours > 8
    begin = int(rng.integers(2, 8))
    lines = [
        f'title = "{number}: {kind}"',
        f'start = "{START}Z"',
        f'duration = "{hours + begin} h"',
        f"particles = {particles}",
        "max_lost = 1",
        f"seed = {number + 1}",
        "domain = { west = -33.9, east = -26.1, south = 42.1, north = 47.9 }",
        '[output]\nevery = "100 h"',
        '[[current]]\nname = "field"\ndataset = "field"',
        f'[uncertainty]\ncurrent = {{ std = "{std:.3f} m/s", time = "{memory:.2f} h", bias = "{lasts:.3f} m/s" }}\ndiffusivity = "{rng.uniform(0, 20):.1f} m2/s"',
    ]
    near = 1.0 if kind in ("plain", "saddle") else 2.0
    for s in range(stories):
        east, north = rng.uniform(-8, 8, 2) * near * (stories > 1)
        # IAMSAR's error is the radius of half of the probability: 1.18 standard deviations.
        error = 1.18 * (
            rng.uniform(0.2, 0.5) if tenfold else np.exp(rng.uniform(np.log(0.3), np.log(8.0)))
        )
        lines.append(
            f'[[scenario]]\nname = "story {s}"\nweight = {rng.uniform(0.3, 1):.3f}\nobject = {{ windage = "0 %" }}\n'
            f'position = {{ at = [{LON + east / 60 / np.cos(np.radians(LAT)):.5f}, {LAT + north / 60:.5f}], error = "{error:.3f} nmi" }}'
        )
        if alive:
            lines.append(
                f'survival = {{ median = "{rng.uniform(0.3, 2) * (hours + begin):.1f} h", spread = {rng.uniform(1.3, 2.5):.2f} }}'
            )
    if failed:
        lines.append(
            f'[[sortie]]\nname = "failed"\nstart = "+{0.4 * begin:.2f} h"\nend = "+{0.9 * begin:.2f} h"\nspeed = "100 kn"\nsweep_width = "0.5 nmi"\n'
            f'pattern = {{ kind = "square", datum = [{LON + rng.uniform(-0.05, 0.05):.4f}, {LAT + rng.uniform(-0.05, 0.05):.4f}], spacing = "0.8 nmi", orientation = {rng.integers(360)} }}'
        )
    lines.append(
        f'[plan]\nbegin = "+{begin} h"\nuntil = "+{begin + hours} h"\nobjective = "{"alive" if alive else "pos"}"\nrounds = {rounds}\nparticles = {particles}\n'
        f'separation = "{rng.choice([0, 0, 1.5])} nmi"'
    )
    laws = [
        '"inverse_cube"',
        '"random"',
        '"definite_range"',
        "{ m_beta = 0.8 }",
        '{ curve = [["0 nmi", 0.9], ["1 nmi", 0.5], ["2 nmi", 0]] }',
    ]
    any_law = rng.random() < 0.3
    count = int(rng.integers(2, 5))
    for u in range(count):
        boat = u == 1 or (u > 1 and rng.random() < 0.5)
        knots = rng.uniform(12, 25) if boat else rng.uniform(70, 180)
        east, north = rng.uniform(-40, 40, 2) * (0.3 if boat else 1.0)
        width = rng.uniform(0.3, 2.0) * rng.uniform(0.5, 1, stories)
        law = laws[int(rng.integers(len(laws)))] if any_law else laws[0]
        wide = " , ".join(f'"story {s}" = "{w:.3f} nmi"' for s, w in enumerate(width))
        lines.append(
            f'[[unit]]\nname = "unit {u}"\nkind = "{"Boat" if boat else "Aircraft"}"\nbase = [{LON + east / 60 / np.cos(np.radians(LAT)):.4f}, {LAT + north / 60:.4f}]\n'
            f'ready = "+{begin + rng.uniform(0, 3):.2f} h"\nsearch_speed = "{knots:.1f} kn"\ntransit_speed = "{1.3 * knots:.1f} kn"\n'
            f'endurance = "{rng.uniform(4, 8) if boat else rng.uniform(1.5, 5):.2f} h"\nlaw = {law}\ndaylight = {str(bool(rng.random() < 0.3)).lower()}\n'
            f'sweep_width = {{ {wide} }}\nsweep_width_uncertainty = "{rng.choice([0, 0, 30, 60])} %"'
        )
    told = f"{kind}{', tenfold' if tenfold else ''}, {hours} h, {stories} stories, {count} units, {rounds} rounds{', alive' if alive else ''}{', failed search' if failed else ''}{', any law' if any_law else ''}"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "case.toml"
        path.write_text("\n".join(lines) + "\n")
        made = drift.load(path)
    return made, data, told, float(rng.uniform(0.3, 0.9))


def scaled(units: tuple[Unit, ...], factor: float) -> tuple[Unit, ...]:
    """Return units whose sweep width times endurance is so many times as large, each by the root of
    it.
    """
    root = float(np.sqrt(factor))
    return tuple(
        replace(
            unit,
            sweep_width=tuple(w * root for w in unit.sweep_width),
            width_under_way=tuple(w * root for w in unit.width_under_way),
            endurance=unit.endurance * root,
        )
        for unit in units
    )
