"""Random cases of targets that steer, for a plan and its bound to be tried on.

Of these kinds: strait (from a box far and wide through one gap, and on), submarine (from a fix by
any course at up to 12 kn, changed now and then), lanes (along one of two ways with a bend, to one
side), bridge (a Brownian bridge of 4 to 12 nmi/sqrt(h)), yacht (under way, then adrift). Half of
them stand beside a raft that drifts. Two or three units, aircraft and boats, whose sweep widths
differ by state; 6 to 20 h.
"""

import tempfile
from pathlib import Path

import numpy as np

import drift
from drift.case.record import Case

LON, LAT = -30.0, 45.0
KINDS = ("strait", "submarine", "lanes", "bridge", "yacht")
BEGIN = 6  # [h] when plans begin


def at(east: float, north: float) -> str:
    """Return a position, so many nautical miles from the middle, as a case file has it."""
    return f"[{LON + east / 60 / np.cos(np.radians(LAT)):.5f}, {LAT + north / 60:.5f}]"


def phase(kind: str, rng: np.random.Generator, hours: float) -> tuple[str, str]:
    """Return the keys of a scenario that steers, and its phase."""
    turn = rng.uniform(0, 2 * np.pi)
    whole = BEGIN + hours

    def where(along: float, across: float) -> str:
        return at(
            along * np.sin(turn) + across * np.cos(turn),
            along * np.cos(turn) - across * np.sin(turn),
        )

    if kind == "strait":
        far, gap = rng.uniform(40, 90), rng.uniform(0.5, 3)
        return "", (
            f'track = {{ start = ["+0 h", "+2 h"], points = [{{ at = {where(-far, 0)}, box = ["{1.2 * far:.1f} nmi", "{0.8 * far:.1f} nmi"], after = "0 h" }}, '
            f'{{ at = {where(0, 0)}, std = "{gap:.2f} nmi", after = ["{BEGIN + 0.3 * hours:.2f} h", "{BEGIN + 0.6 * hours:.2f} h"] }}, '
            f'{{ at = {where(30, 35)}, radius = "12 nmi", after = ["{whole:.2f} h", "{whole + 4:.2f} h"] }}] }}'
        )
    if kind == "submarine":
        change = f', change = "{rng.uniform(2, 6):.1f} h"' if rng.random() < 0.5 else ""
        keys = f'position = {{ at = {where(0, 0)}, std = "{rng.uniform(2, 8):.2f} nmi" }}\n'
        return (
            keys,
            f'course = {{ course = [20, 340], speed = {{ low = "4 kn", best = "8 kn", high = "12 kn", ratio = 4 }}{change} }}',
        )
    if kind in ("lanes", "yacht"):
        cross = rng.uniform(1.5, 5)
        keys = ""
        if kind == "yacht":
            late = BEGIN + 0.8 * hours
            keys = f'object = "SAILBOAT-3"\ndistress = {{ between = {{ earliest = "+1 h", best = "+{BEGIN} h", latest = "+{late:.2f} h", ratio = 3 }} }}\n'
        return keys, (
            f'voyage = {{ waypoints = [{where(-70, 0)}, {where(0, 0)}, {where(30, 60)}], departure = ["+0 h", "+5 h"], speed = ["6 kn", "14 kn"], '
            f'cross_track = "{cross:.2f} nmi" }}'
        )
    k = rng.uniform(4, 12)
    return "", (
        f'bridge = {{ k = "{k:.2f} nmi/sqrt(h)", points = [{{ at = {where(-60, 10)}, std = "6 nmi", time = ["+0 h", "+3 h"] }}, '
        f'{{ at = {where(80, -15)}, std = "10 nmi", time = ["+{whole:.2f} h", "+{whole + 8:.2f} h"] }}] }}'
    )


def case(number: int, particles: int) -> tuple[Case, None, str, float]:
    """Return a random case, no data, what it is like, and the bound that its effort is to be scaled
    to.
    """
    rng = np.random.Generator(np.random.Philox(key=40_000 + number))
    kind, hours, beside = (
        KINDS[number % len(KINDS)],
        int(rng.integers(6, 21)),
        bool(rng.random() < 0.5),
    )
    keys, how = phase(kind, rng, hours)
    lines = [
        f'title = "{number}: {kind}"\nstart = "2026-06-16T00:00:00Z"\nduration = "{BEGIN + hours} h"\nparticles = {particles}\nmax_lost = 1\nseed = {number + 1}',
        '[output]\nevery = "100 h"\n[coast]\nsource = "none"\n[[current]]\nconstant = { speed = "0.7 kn", toward = 63 }\n[[wind]]\nconstant = { speed = "11 kn", from = 213 }',
        '[uncertainty]\ncurrent = { std = "0.2 m/s", time = "6 h" }\nwind = { std = "2 m/s", time = "12 h" }',
        f'[[scenario]]\nname = "steers"\nweight = 0.7\n{keys}[[scenario.phase]]\n{how}',
    ]
    if beside:
        lines.append(
            f'[[scenario]]\nname = "raft"\nweight = 0.3\nobject = {{ windage = "2 %" }}\nposition = {{ at = {at(8, -5)}, std = "6 nmi" }}'
        )
    lines.append(f'[plan]\nbegin = "+{BEGIN} h"\nparticles = {particles}')
    for u in range(int(rng.integers(2, 4))):
        knots = rng.uniform(12, 25) if u == 1 else rng.uniform(70, 180)
        adrift, under_way = rng.uniform(0.5, 2), rng.uniform(1, 5)
        lines.append(
            f'[[unit]]\nname = "unit {u}"\nbase = {at(*rng.uniform(-40, 40, 2))}\nready = "+{BEGIN + rng.uniform(0, 2):.2f} h"\nsearch_speed = "{knots:.1f} kn"\n'
            f'endurance = "{rng.uniform(2, 6):.2f} h"\ndaylight = false\nsweep_width = "{adrift:.2f} nmi"\nsweep_width_under_way = "{under_way:.2f} nmi"'
        )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "case.toml"
        path.write_text("\n".join(lines) + "\n")
        made = drift.load(path)
    told = f"{kind}{', raft' if beside else ''}, {hours} h, {len(made.units)} units"
    return made, None, told, float(rng.uniform(0.3, 0.9))
