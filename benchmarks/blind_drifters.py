"""Do areas hold what they say of drifters drawn from the case's own law beside a coast, where many
run aground?

    python benchmarks/blind_drifters.py [DRIFTERS] [--particles N] [--law NAME] [--seed N]

Drifters are simulated here in float64 NumPy (steps of two minutes, errors from their exact
transition, land by shapely), which shares no code with the program. `drift verify` forecasts each
once, from its begin. A line for each law and lead says how many drifters were aground, how many
particles, and which share of the drifters each area held, with the difference in standard errors of
independent trials. Of 80 differences, one beyond 3 is expected in 5 runs. DRIFTERS: 400; 60 takes a
minute and tells only gross errors.
"""

import argparse
import math
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
import smallest

import drift
from drift.assess.verify.verification import Verification
from drift.tracking.tracks.records import Track

RADIUS = 6_371_008.8  # [m] of the sphere
STEP, FIX, HOURS = 120.0, 3600.0, 72  # [s], [s], [h]
LEADS, SHARES = (6, 12, 24, 48), (0.5, 0.75, 0.9, 0.95)
BEGIN = 1_600_000_000  # [s since 1970]
LON, LAT = -40.0, 40.0  # where all begin

STRAIGHT = [[(-48, 40.2), (-32, 40.2), (-32, 44), (-48, 44)]]
HEADLAND = [  # a coast that turns, and an island before it
    [
        (-48, 40.3),
        (-39.9, 40.3),
        (-39.85, 39.95),
        (-39.6, 39.9),
        (-39.5, 40.3),
        (-32, 40.3),
        (-32, 44),
        (-48, 44),
    ],
    [(-40.1, 40.1), (-39.98, 40.06), (-39.96, 40.16), (-40.08, 40.2)],
]
BAY = [  # open to the west
    [
        (-39.9, 40.1),
        (-39.5, 40.15),
        (-39.45, 39.9),
        (-39.9, 39.92),
        (-39.9, 39.5),
        (-32, 39.5),
        (-32, 44),
        (-39.9, 44),
    ],
]


@dataclass(frozen=True)
class Law:
    """A law of drift and a coast;

    SI. current, wind: functions of the time since the begin [s], east and north [m/s].
    """

    land: list[list[tuple[float, float]]]  # rings [deg]
    current: Callable[[float], tuple[float, float]]
    std: float = 0.0
    time: float = 11 * 3600.0
    bias: float = 0.0
    diffusivity: float = 0.0
    wind: tuple[float, float] = (0.0, 0.0)
    windage: float = 0.0
    wind_std: float = 0.0
    wind_time: float = 12 * 3600.0
    behaviour: str = "strand"
    half_life: float = 0.0
    offing: float = 100.0


def turning(time: float) -> tuple[float, float]:
    """Return a current that turns in a day and a half."""
    turn = 2 * math.pi * time / (36 * 3600)
    return 0.15 * math.sin(turn), 0.1 + 0.35 * math.cos(turn)


LAWS = {
    "OU": Law(STRAIGHT, lambda time: (0.0, 0.2), std=0.31),
    "OU + bias, headland": Law(HEADLAND, lambda time: (0.2, 0.08), std=0.2, time=6 * 3600.0, bias=0.12),
    "diffusion + wind, bay": Law(
        BAY, lambda time: (0.1, -0.05), diffusivity=80.0, wind=(6.0, 2.0), windage=0.03, wind_std=3.0
    ),
    "OU + bias, slides": Law(STRAIGHT, lambda time: (0.1, 0.15), std=0.25, bias=0.08, behaviour="slide"),
    "diffusion, refloats": Law(
        STRAIGHT, turning, bias=0.15, diffusivity=60.0, behaviour="refloat", half_life=6 * 3600.0
    ),
    "OU, refloats": Law(
        STRAIGHT, lambda time: (0.0, 0.1), std=0.25, behaviour="refloat", half_life=8 * 3600.0
    ),
}  # fmt: skip


def simulated(law: Law, count: int, rng: np.random.Generator) -> list[Track]:
    """Return the tracks of drifters, a fix an hour."""
    land = shapely.union_all([shapely.Polygon(ring) for ring in law.land])
    shapely.prepare(land)
    error, wind_error = rng.normal(0, law.std, (2, count)), rng.normal(0, law.wind_std, (2, count))
    bias = rng.normal(0, law.bias, (2, count))
    keep, wind_keep = math.exp(-STEP / law.time), math.exp(-STEP / law.wind_time)
    place = np.array([[LON] * count, [LAT] * count])
    free_from = np.zeros(count)  # [s] when each is afloat again; inf: never
    seen = [place]
    for k in range(round(HOURS * 3600 / STEP)):
        time = k * STEP
        new = keep * error + law.std * math.sqrt(1 - keep**2) * rng.standard_normal((2, count))
        blown = wind_keep * wind_error
        blown = blown + law.wind_std * math.sqrt(1 - wind_keep**2) * rng.standard_normal((2, count))
        wind = np.array(law.wind)[:, None] + (wind_error + blown) / 2
        velocity = (
            np.array(law.current(time + STEP / 2))[:, None]
            + (error + new) / 2
            + bias
            + law.windage * wind
        )
        error, wind_error = new, blown
        walk = math.sqrt(2 * law.diffusivity * STEP) * rng.standard_normal((2, count))
        # What has lain its time goes on once its drift leads off the shore, which is straight
        # there: southward.
        lies = free_from > 0
        leaves = lies & (free_from <= time) & (velocity[1] < 0)
        place = np.where(
            leaves, moved(place, np.array([np.zeros(count), np.full(count, -law.offing)])), place
        )
        free_from = np.where(leaves, 0.0, free_from)
        goes = ~lies | leaves
        target = np.where(goes, moved(place, velocity * STEP + walk), place)
        hit = goes & shapely.contains_xy(land, *target)
        if law.behaviour == "slide":  # along a parallel
            target[1] = np.where(hit, law.land[0][0][1] - 1e-6, target[1])
        else:
            target[:, hit] = shore(land, place[:, hit], target[:, hit])
            wait = (
                rng.exponential(law.half_life / math.log(2), count)
                if law.half_life
                else np.full(count, np.inf)
            )
            free_from = np.where(hit, time + STEP + wait, free_from)
        place = target
        if (k + 1) * STEP % FIX == 0:
            seen.append(place)
    path = np.array(seen)
    times = BEGIN + FIX * np.arange(len(path))
    return [Track(f"{n}", times, path[:, 0, n], path[:, 1, n]) for n in range(count)]


def moved(place: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Return places (2, n) [deg] after ways (2, n) [m] east and north, which are short."""
    lat = place[1] + np.degrees(way[1] / RADIUS)
    middle = np.radians((place[1] + lat) / 2)
    return np.array([place[0] + np.degrees(way[0] / (RADIUS * np.cos(middle))), lat])


def shore(land: shapely.Geometry, wet: np.ndarray, dry: np.ndarray) -> np.ndarray:
    """Return the last places in water on the ways from wet to dry ones, (2, n) [deg], by bisection."""
    low, high = np.zeros(wet.shape[1]), np.ones(wet.shape[1])
    for _ in range(20):
        middle = (low + high) / 2
        inside = shapely.contains_xy(land, *(wet + middle * (dry - wet)))
        low, high = np.where(inside, low, middle), np.where(inside, middle, high)
    return wet + low * (dry - wet)


def case(law: Law, folder: Path, particles_seed: int) -> drift.Case:
    """Return the case of a law, which is written to a folder."""
    rings = [[[*ring, ring[0]]] for ring in law.land]
    features = [
        {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": ring}}
        for ring in rings
    ]
    (folder / "land.geojson").write_text(
        str({"type": "FeatureCollection", "features": features})
        .replace("'", '"')
        .replace("(", "[")
        .replace(")", "]")
    )
    steady = law.current(0.0) == law.current(7 * 3600.0)
    rows = [
        f'{{ time = "{np.datetime64(BEGIN + t, "s")}Z", east = {law.current(t)[0]}, north = {law.current(t)[1]} }}'
        for t in range(0, (HOURS + 1) * 3600, HOURS * 3600 if steady else 3600)
    ]
    refloats = (
        f'half_life = "{law.half_life} s"\noffing = "{law.offing} m"\n' if law.half_life else ""
    )
    (folder / "case.toml").write_text(
        f'start = "{np.datetime64(BEGIN, "s")}Z"\nduration = "48 h"\nseed = {particles_seed}\n'
        f'[coast]\nsource = "land.geojson"\nbehaviour = "{law.behaviour}"\n{refloats}'
        f"[[current]]\ntable = [{', '.join(rows)}]\n"
        f"[[wind]]\nconstant = {{ east = {law.wind[0]}, north = {law.wind[1]} }}\n"
        f'[uncertainty]\ndiffusivity = "{law.diffusivity} m2/s"\n'
        f'current = {{ std = "{law.std} m/s", time = "{law.time} s", bias = "{law.bias} m/s" }}\n'
        f'wind = {{ std = "{law.wind_std} m/s", time = "{law.wind_time} s" }}\n'
        f'[[scenario]]\nname = "drifter"\nobject = {{ windage = {law.windage} }}\n'
        f'position = {{ at = [{LON}, {LAT}], error = "10 m" }}\n'
    )
    return drift.load(folder / "case.toml")


def verified(law: Law, count: int, particles: int, seed: int) -> Verification:
    """Return the verification of drifters of a law by the case of the law."""
    tracks = simulated(law, count, np.random.default_rng(seed))
    with tempfile.TemporaryDirectory() as folder:
        made = case(law, Path(folder), seed + 1)
        return drift.verify(
            made, tracks, every=HOURS * 3600.0, hours=48, error=10.0, particles=particles
        )


def differences(found: Verification) -> Iterator[tuple[int, float, float, float]]:
    """Give (lead [h], share, share held, difference in standard errors) of each lead and area."""
    for number, lead in enumerate(found.leads):
        for share in SHARES:
            held = float((found.containment[:, number] <= share).mean())
            yield (
                int(lead),
                share,
                held,
                (held - share) / math.sqrt(share * (1 - share) / found.skill.size),
            )


def main() -> None:
    """Simulate, verify, and print a line for each law and lead."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("drifters", nargs="?", type=int, default=400)
    options.add_argument("--particles", type=int, default=2000)
    options.add_argument("--law", choices=tuple(LAWS))
    options.add_argument("--seed", type=int, default=20_261_126)
    given = smallest.parse(options, drifters=4, particles=500)
    beyond = 0
    for name in [given.law] if given.law else LAWS:
        found = verified(LAWS[name], given.drifters, given.particles, given.seed)
        print(f"{name}: {found.skill.size} forecasts; {'; '.join(found.notes) or 'no notes'}"[:300])
        rows = list(differences(found))
        for lead in LEADS:
            column = int(np.searchsorted(found.hours, lead))
            told = [
                f"{share:.0%} held {held:.1%} ({z:+.1f})"
                for hours, share, held, z in rows
                if hours == lead
            ]
            ashore = f"aground {found.aground[:, column].mean():.0%}, particles {found.ashore[:, column].mean():.0%}"
            print(f"  after {lead:2} h: {ashore}; {', '.join(told)}", flush=True)
        beyond += sum(abs(z) > 3 for *_, z in rows)
    print(f"{beyond} differences beyond 3 standard errors")


if __name__ == "__main__":
    main()
