"""How many particles of each leeway class drift upwind, and how far on average, with and without
the cut of slopes.

    python benchmarks/upwind.py [PARTICLES]

Per class and wind speed: the share of particles whose downwind speed is negative and the mean
downwind speed [cm/s], by the normal law -> by the one cut at slope 0 (docs/leeway.md), as our
kernel draws it; only classes with a share above 0.05 % somewhere.
"""

import argparse

import numpy as np
import smallest

from drift.engine.motion.models.drift import COLUMNS
from drift.engine.motion.objects import leeway
from drift.engine.particles import ensemble as record
from kernels.maths.noise import key
from kernels.runtime import runtime
from kernels.step import prior as kernel

WINDS = (2, 5, 10, 20)  # [m/s]


def speeds(line: leeway.Line, least: float, particles: int) -> np.ndarray:
    """Return downwind speeds [m/s] of particles of a line at each wind speed, shape (4, n)."""
    e = record.empty(1, (0, particles), COLUMNS)
    figures = line.slope, line.offset, line.slope_std, line.offset_std
    kernel.draw_object(
        0, particles, 0, e.own["down_slope"], e.own["down_offset"], 0, *key(1), *figures, least
    )
    return (
        np.outer(WINDS, e.own["down_slope"].to_numpy().astype(float))
        + e.own["down_offset"].to_numpy()
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("particles", nargs="?", type=int, default=1_000_000)
    particles = smallest.parse(parser, particles=1000).particles
    runtime.start()
    print("| class | slopes < 0 | " + " | ".join(f"{wind} m/s" for wind in WINDS) + " |")
    print("|---|" + "---|" * (len(WINDS) + 1))
    for name, drifter in leeway.classes().items():
        line = drifter.down
        before, after = (speeds(line, least, particles) for least in (-np.inf, 0.0))
        old, new = ((which < 0).mean(axis=1) for which in (before, after))
        if max(old) < 0.0005:
            continue
        cells = [
            f"{p:.1%} -> {q:.1%}; {100 * a:.2f} -> {100 * b:.2f}"
            if abs(a - b) > 5e-5
            else f"{p:.1%}; {100 * a:.2f}"
            for p, q, a, b in zip(old, new, before.mean(axis=1), after.mean(axis=1), strict=True)
        ]
        cut = (np.diff(before[[0, 2]], axis=0) < 0).mean()
        print(f"| {name} | {cut:.2%} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
