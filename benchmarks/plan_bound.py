"""What plans find as a share of the bound that no plan exceeds, over random cases with motion; prints one table.

    python benchmarks/plan_bound.py [--moving] [--cases 20] [--first 0] [--particles 40000] [--threads N]

Objects: 1 to 4 normal clouds of 3 to 12 nmi, up to 40 nmi apart, drifting with up to 1.5 kn, the speed of each particle off by up to
0.5 kn, 12 h. Units: 1 to 4, boats of 12 to 25 kn, helicopters and aircraft of 70 to 180 kn, sweep widths of 0.3 to 2 nmi, 1.5 to 8 h of search, from bases up to
60 nmi away, ready within 3 h. Three in four cases sweep by inverse cube, one by any law.

--moving: clouds of 0.3 to 8 nmi that an Ornstein-Uhlenbeck error of 0.03 to 0.7 m/s a component and 2 to 14 h spreads, in a current that
converges along one axis and diverges along the other, over 6 to 72 h. Beside the plan, legs by hand are scored on the same particles: they chase
the densest spot, go to and fro against the drift of what they chase, or draw tiny expanding squares about it. Exits 1 if anything exceeds the bound.
"""

import argparse
import sys
import time
from dataclasses import replace

import numpy as np
from rich.console import Console
from rich.table import Table

from drift import bound, optimise, rectangle
from drift import reach as reaches
from drift import tracks as record
from drift.sortie import Law, PlanSpec, Unit
from drift.tracks import Tracks
from geo import sphere
from kernels import rectangles, runtime, sweeps

NMI, HOUR = 1852.0, 3600.0
BEGIN = np.datetime64("2026-06-20T06:00:00", "s")
BINS = 24


def case(number: int, particles: int) -> tuple[Tracks, list[Unit], PlanSpec]:
    """Return a random case."""
    rng = np.random.Generator(np.random.Philox(key=number))
    clouds = int(rng.integers(1, 5))
    share = rng.dirichlet(np.full(clouds, 2.0))
    of = rng.choice(clouds, particles, p=share)
    centre, spread = rng.uniform(-20, 20, (clouds, 2)), rng.uniform(3, 12, (clouds, 2))
    turn, drift, off = rng.uniform(0, np.pi, clouds), rng.uniform(-1, 1, (clouds, 2)), rng.uniform(0, 0.5, clouds)
    a = rng.standard_normal((particles, 2)) * spread[of]
    c, s = np.cos(turn[of]), np.sin(turn[of])
    place = centre[of] + np.stack([a[:, 0] * c - a[:, 1] * s, a[:, 0] * s + a[:, 1] * c], axis=1)
    speed = drift[of] + rng.standard_normal((particles, 2)) * off[of, None]
    hours = np.arange(BINS + 1) * 12 / BINS
    at = (place + hours[:, None, None] * speed) * NMI
    lon, lat = sphere.destination(np.radians(3.0), np.radians(58.0), at[..., 0], at[..., 1])
    begin = float(BEGIN.astype(np.int64))
    tracks = Tracks(
        time=begin + hours * HOUR,
        lon=sphere.to_binary(np.degrees(lon)),
        lat=sphere.to_binary(np.degrees(lat)),
        adrift=np.ones(lon.shape, bool),
        weight=np.full(particles, 1 / particles),
        scenario=np.zeros(particles, np.int32),
        release=np.full(particles, begin),
    )
    return tracks, units_of(rng, number), PlanSpec(BEGIN, BEGIN + np.timedelta64(12, "h"))


def units_of(rng: np.random.Generator, number: int) -> list[Unit]:
    """Return random units; every fourth case has any laws."""
    any_law = number % 4 == 3
    laws = [Law(), Law("random"), Law("definite_range"), Law("m_beta", beta=0.8)]
    units = []
    for u in range(int(rng.integers(1, 5))):
        boat = rng.random() < 0.4
        knots = rng.uniform(12, 25) if boat else rng.uniform(70, 180)
        east, north = rng.uniform(-60, 60, 2) * NMI * (0.4 if boat else 1.0)
        lon, lat = sphere.destination(np.radians(3.0), np.radians(58.0), east, north)
        base = (float(np.degrees(lon)), float(np.degrees(lat)))
        units.append(
            Unit(
                name=f"unit {u}",
                kind="Boat" if boat else "Aircraft",
                base=base,
                return_to=base,
                ready=BEGIN + np.timedelta64(int(rng.uniform(0, 3) * HOUR), "s"),
                search_speed=knots * NMI / HOUR,
                transit_speed=1.3 * knots * NMI / HOUR,
                endurance=float(rng.uniform(4, 8) if boat else rng.uniform(1.5, 5)) * HOUR / 0.85,
                law=laws[int(rng.integers(4))] if any_law else laws[0],
                sweep_width=(float(rng.uniform(0.3, 2.0)) * NMI,),
                daylight=False,
            )
        )
    return units


def moving(number: int, particles: int) -> tuple[Tracks, list[Unit], PlanSpec]:
    """Return a random case of clouds that spread, mix or converge."""
    rng = np.random.Generator(np.random.Philox(key=10_000 + number))
    hours = float(rng.integers(6, 73))
    bins = min(48, int(hours * 12))
    steps = 4  # of the motion in a bin
    dt = hours * HOUR / bins / steps
    clouds = int(rng.integers(1, 4))
    of = rng.choice(clouds, particles, p=rng.dirichlet(np.full(clouds, 2.0)))
    place = rng.uniform(-15, 15, (clouds, 2))[of] * (clouds > 1)
    place = (
        place + np.exp(rng.uniform(np.log(0.3), np.log(8.0), clouds))[of, None] * rng.standard_normal((particles, 2))
    ) * NMI
    size, keep = np.exp(rng.uniform(np.log(0.03), np.log(0.7))), np.exp(-dt / rng.uniform(2 * HOUR, 14 * HOUR))
    drift = rng.uniform(-0.75, 0.75, 2)
    strain = rng.uniform(0, 3e-5) * np.array([-1.0, 0.6]) * (rng.random() < 0.5)
    error = size * rng.standard_normal((particles, 2))
    at = [place]
    for k in range(bins * steps):
        later = keep * error + size * np.sqrt(1 - keep * keep) * rng.standard_normal((particles, 2))
        place = place + dt * ((error + later) / 2 + drift + strain * place)
        error = later
        if (k + 1) % steps == 0:
            at.append(place)
    x, y = np.moveaxis(np.array(at), 2, 0)
    lon, lat = sphere.destination(np.radians(179.9), np.radians(-58.0), x, y)
    begin = float(BEGIN.astype(np.int64))
    tracks = Tracks(
        time=begin + np.linspace(0, hours * HOUR, bins + 1),
        lon=sphere.to_binary(np.degrees(lon)),
        lat=sphere.to_binary(np.degrees(lat)),
        adrift=np.ones(lon.shape, bool),
        weight=np.full(particles, 1 / particles),
        scenario=np.zeros(particles, np.int32),
        release=np.full(particles, begin),
    )
    units = []
    for unit in units_of(rng, number):
        east, north = rng.uniform(-40, 40, 2) * NMI * (0.3 if unit.kind == "Boat" else 1.0)
        lon, lat = sphere.destination(np.radians(179.9), np.radians(-58.0), east, north)
        base = (float(np.degrees(lon)), float(np.degrees(lat)))
        units.append(replace(unit, base=base, return_to=base))
    return tracks, units, PlanSpec(BEGIN, BEGIN + np.timedelta64(int(hours), "h"))


def by_hand(tracks: Tracks, units: list[Unit], spec: PlanSpec, manner: str) -> float:
    """Return what units find that chase the densest spot of the particles left, each from leg to leg, one unit after the other."""
    plane = record.plane(tracks)
    x, y = plane.flat(tracks.lon * sphere.UNIT, tracks.lat * sphere.UNIT)
    time = tracks.time - tracks.time[0]
    swarm = rectangles.swarm(time, x, y, np.ones(x.shape), tracks.scenario)
    left = tracks.weight.copy()
    few = np.linspace(0, tracks.m - 1, min(tracks.m, 4000)).astype(int)
    for unit in units:
        if unit.law.kind == "random":  # which has no legs
            continue
        can = reaches.reach(unit, spec, (plane.lon, plane.lat))
        crew = rectangle.crew(unit, can, plane, float(tracks.time[0]), np.ones(1))
        base = np.array([float(v) for v in plane.flat(*np.radians(unit.base))])
        width, speed = unit.sweep_width[0], unit.search_speed

        def where(now: float, x=x, y=y, time=time, few=few) -> tuple[np.ndarray, np.ndarray]:  # type: ignore[no-untyped-def]
            k = min(int(np.searchsorted(time, now, side="right")) - 1, len(time) - 2)
            part = (now - time[k]) / (time[k + 1] - time[k])
            here = np.stack([x[k, few], y[k, few]]) * (1 - part) + np.stack([x[k + 1, few], y[k + 1, few]]) * part
            return here, np.stack([x[k + 1, few] - x[k, few], y[k + 1, few] - y[k, few]]) / (time[k + 1] - time[k])

        hope, now = left[few].copy(), float(can.leaves - tracks.time[0])
        end = float(spec.until.astype(np.int64)) - tracks.time[0] - reaches.MARGIN
        nodes: list[tuple[float, float, float, float]] = []  # (time, x, y, whether it seeks)
        spot = base
        while now < end - 60:
            here, way = where(now)
            cell = np.floor(here / (3 * width)).astype(np.int64)
            _, which = np.unique(cell, axis=1, return_inverse=True)
            mass = np.bincount(which.ravel(), hope)
            if not nodes:  # fly to the densest spot, and be there when it is
                best = which.ravel() == int(np.argmax(mass))
                spot = here[:, best].mean(axis=1)
                now += float(np.hypot(*(spot - base))) / unit.transit_speed
                if now >= end:
                    break
                here, _ = where(now)
                spot, until = here[:, best].mean(axis=1), min(now + can.search, end)
                nodes.append((now, *spot, 1.0))
                continue
            gone = np.hypot(
                *(np.array([np.bincount(which.ravel(), v) for v in here]) / np.bincount(which.ravel()) - spot[:, None])
            )
            best = which.ravel() == int(np.argmax(mass / (gone + 3 * width)))
            goal, flow = here[:, best].mean(axis=1), way[:, best].mean(axis=1)
            turn = flow / max(float(np.hypot(*flow)), 1e-9)
            legs = [goal - spot]
            if manner == "against":
                legs += [-6 * width * turn, np.array([-turn[1], turn[0]]) * width, 3 * width * turn]
            elif manner == "squares":
                legs += [
                    r * width * np.array(d)
                    for r, d in zip(
                        (0.3, 0.3, 0.6, 0.6, 0.9, 0.9), ((1, 0), (0, 1), (-1, 0), (0, -1), (1, 0), (0, 1)), strict=True
                    )
                ]
            for leg in legs:
                long = float(np.hypot(*leg))
                share = min(1.0, (until - now) * speed / max(long, 1e-9))
                if long * share < 1.0:
                    continue
                spot, now = spot + leg * share, now + long * share / speed
                nodes.append((now, *spot, 1.0))
                hope[np.hypot(*(where(min(now, time[-1]))[0] - spot[:, None])) < 0.7 * width] *= 0.4
            if nodes[-1][0] < now + 1e-9 and len(legs) == 1 and float(np.hypot(*legs[0])) < 1.0:
                now += 60.0  # it is there already
            hope[best] *= 0.5
            if now >= until - 1:
                break
        if len(nodes) > 1:
            chance, _ = sweeps.found(swarm, crew.table, np.array(nodes), crew.width, np.ones(1))
            left *= 1 - chance[:, 0]
    return float(tracks.weight.sum() - left.sum())


def main() -> None:
    """Plan, bound, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--particles", type=int, default=40_000)
    parser.add_argument("--threads", type=int)
    parser.add_argument("--moving", action="store_true")
    options = parser.parse_args()
    runtime.start("cpu", options.threads)
    table = Table(
        "case", "units", "hours", "POS", "bound", "share", "chasing", "against", "squares", "plan s", "bound s"
    )
    shares, beaten = [], 0
    for number in range(options.first, options.first + options.cases):
        tracks, units, spec = (moving if options.moving else case)(number, options.particles)
        clock = time.perf_counter()
        limit = bound.bound(tracks, units, spec, [None])
        middle = time.perf_counter()
        made = optimise.plan(tracks, units, spec, number, [None])
        end = time.perf_counter()
        hands = [by_hand(tracks, units, spec, manner) for manner in ("chase", "against", "squares")]
        shares.append(made.seen / limit.value)
        beaten += max(made.seen, *hands) > limit.value
        table.add_row(
            str(number), str(len(units)), f"{(tracks.time[-1] - tracks.time[0]) / HOUR:.0f}", f"{made.seen:.4f}", f"{limit.value:.4f}", f"{shares[-1]:.3f}",
            *(f"{hand:.4f}" for hand in hands), f"{end - middle:.1f}", f"{middle - clock:.1f}",
        )  # fmt: skip
        print(
            number,
            len(units),
            f"{made.seen:.4f} {limit.value:.4f} {shares[-1]:.3f}",
            *(f"{hand:.4f}" for hand in hands),
            flush=True,
        )
    console = Console(width=140)
    console.print(table)
    console.print(
        f"share of the bound: median {np.median(shares):.3f}, worst {min(shares):.3f}; above the bound: {beaten}"
    )
    sys.exit(beaten > 0)


if __name__ == "__main__":
    main()
