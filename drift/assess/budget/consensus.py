"""Consensus of models: how many members of an ensemble, or rival scenarios, agree on a place.

Each model has its own containment areas, from its own particles. A cell's count is the number of
models whose own area contains it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from drift.case.record import Case
from drift.engine.environment.environment import Environment
from drift.engine.particles.snapshot import Snapshot
from drift.forecast import build
from drift.forecast.build import Forecast
from drift.products.files import formats
from geo import notation
from geo.array import Array
from geo.notation import NMI


@dataclass(frozen=True)
class Consensus:
    """How many models agree.

    whole: the forecast of all models together, on the grid of the counts. count: number of models
    whose own area contains the cell, (times, shares, nlat, nlon).
    """

    what: str  # the models in words: "members", "scenarios"
    names: tuple[str, ...]
    whole: Forecast
    count: Array

    def area(self, time: int, share: int, least: int) -> float:
        """Return the area [m2] of the cells in the areas of at least some models.

        Args:
            time: index of the time.
            share: index of the share.
            least: number of models.
        """
        inside = self.count[time, share] >= least
        return float(self.whole.data["cell_area"].values[inside].sum())

    def held(self, time: int, share: int, least: int) -> float:
        """Return the probability, by all models together, in the cells of `area`."""
        inside = self.count[time, share] >= least
        return float(self.whole.data["probability"].values[time][inside].sum())


def models_of(
    case: Case, where: Environment
) -> tuple[str, tuple[str, ...], Callable[[Snapshot], Array]] | None:
    """Return what a case's models are, their names, and which of them each particle drifts in.

    None if the case has a single model. Rival scenarios are models if they have different sources.
    """
    if len(where.members) > 1:

        def member(snapshot: Snapshot) -> Array:
            assert snapshot.member is not None
            return snapshot.member

        return "members", tuple(where.members), member
    likely = [k for k, scenario in enumerate(case.scenarios) if scenario.weight > 0]
    sources = [dict(case.scenarios[k].sources) for k in likely]
    if len(likely) > 1 and any(own != sources[0] for own in sources):
        number = np.full(len(case.scenarios), -1)
        number[likely] = np.arange(len(likely))
        names = tuple(case.scenarios[k].name for k in likely)
        return "scenarios", names, lambda snapshot: np.asarray(number[snapshot.scenario])
    return None


def find_consensus(
    snapshots: Sequence[Snapshot],
    what: str,
    names: tuple[str, ...],
    model_of: Callable[[Snapshot], Array],
    **options: Any,
) -> Consensus:
    """Return how many models agree at each output.

    Args:
        snapshots: the particles at each time.
        what: the models in words.
        names: of the models.
        model_of: returns the number of the model of each particle, (n,).
        **options: `scenarios`, `is_land` and `shares` of `drift.forecast.build.build_forecast`.
    """
    grid = build.grid_of(snapshots, len(options["scenarios"]))
    whole = build.build_forecast(snapshots, grid=grid, **options)
    shares = np.array(whole.shares)
    count = np.zeros((len(snapshots), len(shares), grid.nlat, grid.nlon), np.int32)
    for number in range(len(names)):
        own = [_of_model(snapshot, model_of(snapshot) == number) for snapshot in snapshots]
        contained = build.build_forecast(own, grid=grid, **options).data["containment"].values
        count += contained[:, None] <= shares[:, None, None]
    return Consensus(what, names, whole, count)


def _of_model(snapshot: Snapshot, own: Array) -> Snapshot:
    """Return a snapshot in which only the particles of one model have probability."""
    probability = np.where(own, snapshot.probability, 0.0)
    return replace(snapshot, probability=probability / probability.sum())


def consensus_csv(found: Consensus, run: str) -> str:
    """Return the areas by how many models agree as CSV; run: the run_id, for the last column."""
    many = len(found.names)
    rows = [
        {
            "time": time,
            "area_percent": notation.hundredths(share),
            "models": least,
            "of": many,
            "area_nmi2": found.area(t, s, least) / NMI**2,
            "probability": found.held(t, s, least),
        }
        for t, time in enumerate(found.whole.data["time"].values)
        for s, share in enumerate(found.whole.shares)
        for least in range(1, many + 1)
    ]
    return formats.csv_rows(rows, run=run, digits=".6g")


def consensus_dataset(found: Consensus) -> xr.Dataset:
    """Return the counts on their grid, with the probability of all models together."""
    kept = ("probability", "cell_area", "lat_bnds", "lon_bnds")
    data = found.whole.data[[name for name in kept if name in found.whole.data]]
    words = {
        "long_name": f"number of {found.what} whose own area of the share contains the cell",
        "units": "1",
        "comment": f"of {len(found.names)}: {', '.join(found.names)}",
    }
    shares = found.whole.data["share"]
    return data.assign(models=(("time", "share", "lat", "lon"), found.count, words)).assign_coords(
        share=shares
    )


def consensus_in_words(found: Consensus) -> str:
    """Return the areas on which all, half and any of the models agree at the last time."""
    many = len(found.names)
    last = len(found.whole.data["time"]) - 1
    parts = []
    for s, share in enumerate(found.whole.shares):
        sizes = [found.area(last, s, least) / NMI**2 for least in (many, -(-many // 2), 1)]
        words = "all {:,.0f}, half {:,.0f}, any {:,.0f} nmi2".format(*sizes)
        parts.append(f"{notation.hundredths(share)} % area of {words}")
    return f"of {many} {found.what}: {'; '.join(parts)}"
