"""Cases in which an object changes its state on the way, and columns of their particles."""

from pathlib import Path
from typing import Any

import numpy as np
import trial_case
from filtered import run

import drift
from drift.engine.particles.ensemble import Ensemble

HOUR = 3600.0
FAR = 3.5  # standard errors
W, TOWARD = 17.0, np.radians(69.0)  # the steady wind: speed [m/s], direction
KEEL = {"downwind": {"slope": "3 %"}, "name": "keel down"}
HULL = {"downwind": {"slope": "1.1 %"}, "name": "keel up"}
PLAIN = {
    "particles": 4000,
    "wind": {"constant": {"speed": "17 m/s", "from": 249}},
    "current": {"constant": {"speed": "0 kn", "toward": 0}},
    "uncertainty": {"current": {"std": 0}, "wind": {"std": 0}},
}


def case(folder: Path, changes: list[dict[str, Any]], *more: str, **tables: Any) -> drift.Case:
    """Return a trial case with changes of state, without errors of the forcing."""
    own = {**PLAIN, **tables}
    own["scenario"] = {"object": KEEL, "change": changes, **tables.get("scenario", {})}
    return trial_case.load(folder, *more, **own)


def end_of(folder: Path, changes: list[dict[str, Any]], *more: str, **tables: Any) -> Ensemble:
    """Return the particles at the end of such a case."""
    return run(case(folder, changes, *more, **tables))[1]


def column(ensemble: Ensemble, name: str) -> np.ndarray:
    """Return a column in float64, (n,)."""
    return np.asarray(ensemble.columns[name].to_numpy(), np.float64)


def within(share: float, wanted: float, many: int) -> bool:
    """Whether a share of `many` lies within FAR standard errors of a probability."""
    return bool(abs(share - wanted) <= FAR * np.sqrt(wanted * (1 - wanted) / many))
