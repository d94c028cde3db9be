"""Warnings about a fixed grid: probability outside it, and cells too coarse for the particles."""

from typing import Any

import numpy as np

from geo import notation

OFF = 0.005  # probability outside the grid from which a warning is given
COARSE = 1.0  # cells per bandwidth of the densest part; with fewer, areas are too large


def fixed_grid_warnings(data: Any) -> list[str]:
    """Return the warnings of a forecast (drift.forecast.products.dataset) on a grid set by the
    user.

    There are none on a grid that follows the particles.
    """
    if "off_grid" not in data:
        return []
    texts, times = [], data["time"].values
    off, wide = data["off_grid"].values, data["cells_per_kernel"].values
    worst = int(np.argmax(off))
    if off[worst] >= OFF:
        texts.append(
            f"output.grid: {notation.percent(off[worst])} of the probability lies outside it at {notation.format_dtg(times[worst])}"
            f"{_others(off >= OFF)}; areas and containment count it, cells do not"
        )
    coarse = np.nan_to_num(wide, nan=np.inf) < COARSE
    if coarse.any():
        at = int(np.argmin(np.where(np.isfinite(wide), wide, np.inf)))
        texts.append(
            f"output.grid: its cells are too coarse for the particles at {notation.format_dtg(times[at])}{_others(coarse)}: "
            f"areas are too large there; a spacing of a {np.ceil(1 / wide[at]):.0f}th would suffice"
        )
    return texts


def _others(which: Any) -> str:
    more = int(np.sum(which)) - 1
    return f" and at {more} more output time{'s' * (more > 1)}" if more else ""
