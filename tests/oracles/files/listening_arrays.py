"""Arrays that listen: losses and noise in closed form, and the comparison with the sonar equation.

How far a log weight may be off is stated in decibels: as far as that of a sonar that is TOLERANCE
better or worse. Noise and the array's heading are those of the middle of a part, in which the noise
changes by a quarter of a decibel (0.13); tables are those of the array's middle place (0.05 here),
bearings are laid out to a tenth of a degree (0.02), and the rule of parts and the oracle's own
times leave the rest.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from sonars import Sonar, Way, louder

TOLERANCE = 0.25  # [dB]
ROUNDING = 2e-5  # of float32 in logs of weights
RAFT = """
[[current]]
constant = { speed = "0 kn", toward = 0 }
[[scenario]]
name = "raft"
object = "water"
position = { at = [-30.0, 36.0], std = "25 nmi" }
"""
RANGES = np.arange(0, 120_001.0, 2000.0)
RADIALS, SIDES, AROUND = (np.arange(0, 360, by, float) for by in (30, 15, 45))
NOISE = np.array(
    [
        [70, 73, 71, 75, 72, 70, 74, 69.0],
        [72, 75, 74, 75, 73, 71, 75, 70.0],
        [69, 70, 74, 77, 72, 75, 70, 69.0],
    ]
)


def losses(number: int, radials: np.ndarray = RADIALS) -> np.ndarray:
    """Return losses of a place, with a convergence zone: those of no two bearings and no two places
    are the same.
    """
    spread = 60 + (11 + number) * np.log10(1 + RANGES / 1000)
    zone = 9 * np.exp(-(((RANGES - 55_000 - 5000 * number) / 5000) ** 2))
    turned = np.sin(np.radians(radials + 40 * number))[:, None] * np.minimum(RANGES / 3e4, 1)
    return np.round(spread - zone + 4 * turned, 3)


def array(*places: tuple[float, float], radials: np.ndarray = RADIALS, **more: Any) -> Sonar:
    """Return a sonar whose port side is not like its starboard side."""
    gain = np.round(4 + 5 * np.cos(np.radians(SIDES - 50)) + 2 * np.sin(np.radians(3 * SIDES)), 3)
    own: dict[str, Any] = {
        "places": places, "radials": radials, "ranges": RANGES, "hours": (0.0, 2.5, 6.0), "around": AROUND, "noise": NOISE,
        "loss": np.stack([losses(k, radials) for k in range(max(len(places), 1))]), "sides": SIDES, "gain": gain,
        "levels": {"raft": 140.0},
    }  # fmt: skip
    return Sonar(**own | more)


def agree(
    found: np.ndarray,
    expected: Callable[[Sonar], np.ndarray],
    sonar: Sonar,
    tolerance: float = TOLERANCE,
) -> float:
    """Hold logs of weights against those expected of a sonar; return the worst deviation [1]."""
    better, worse = (expected(louder(sonar, more)) for more in (tolerance, -tolerance))
    off = found - expected(sonar)
    assert np.all(found > better - ROUNDING), (better - found).max()
    assert np.all(found < worse + ROUNDING), (found - worse).max()
    return float(np.abs(off).max())


TURN = Way((0.7, 2.9, 5.4), ((-30.3, 35.8), (-30.0, 36.1), (-29.6, 36.0)))
PLACES = (-30.5, 35.6), (-29.2, 35.7), (-29.9, 36.6)


def towed(sonar: Sonar, way: Way = TURN, more: str = "") -> str:
    return f'[[sortie]]\nname = "w"\nwaypoints = {way.text()}\nwatch = {{ sensor = "{sonar.name}" }}\n{more}'


# What moves past a sonar that stands: by scenario, where it is and how loud.
CURRENT = (1.3, 63.0)  # [kn] toward
PORTS = ((-30.9, 35.7), (-30.35, 36.15), (-29.7, 35.9))
STEAD = (-30.2, 35.75)
MOVING = f"""
[[current]]
constant = {{ speed = "{CURRENT[0]} kn", toward = {CURRENT[1]} }}
[[scenario]]
name = "raft"
object = "water"
position = {{ at = [-30.0, 36.0], std = "15 nmi", time = "+0 h", until = "+4 h" }}
[[scenario]]
name = "steady"
position = {{ at = [-30.5, 36.0], std = "10 nmi" }}
[[scenario.phase]]
course.course = 127
course.speed = "9 kn"
[[scenario]]
name = "voyage"
[[scenario.phase]]
[scenario.phase.voyage]
waypoints = {[list(at) for at in PORTS]}
departure = ["+0 h", "+2.5 h"]
speed = "15 kn"
[[scenario]]
name = "yacht"
object = "water"
distress = {{ between = ["+0.5 h", "+5 h"] }}
[[scenario.phase]]
[scenario.phase.voyage]
waypoints = {[list(at) for at in PORTS]}
departure = ["+0 h", "+1 h"]
speed = "7 kn"
"""
LEVELS = {
    "raft": 141.0,
    "steady": [(3, 121.0), (12, 143.0)],
    "voyage": [(5, 118.0), (10, 131.0), (20, 140.0)],
    "yacht": [(0, 150.0), (1, 139.0), (6, 131.0), (9, 137.0)],
}
WATCH = '[[sortie]]\nname = "w"\nstart = "+0.3 h"\nend = "+5.6 h"\nwatch = { sensor = "ears" }\n'
LOOK = '[[look]]\nname = "x"\ntime = "+3.3 h"\nsees = "nothing"\nsensor = "ears"\n'


def everything(tmp_path: Path, unknown: float = 3.0) -> str:
    """Return what moves, two watches that share an unknown and a look."""
    ears = array(at=STEAD, heading=205.0, levels=LEVELS, unknown=unknown, group="both")
    towed_one = array(*PLACES, name="tail", levels=LEVELS, unknown=unknown, group="both")
    return (
        MOVING
        + ears.text(tmp_path)
        + towed_one.text(tmp_path)
        + WATCH
        + towed(towed_one).replace('"w"', '"t"')
        + LOOK
    )
