"""The unknowns of a spill before and after its finds: release, biases, sinking, numbers."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from drift.products.files import formats
from drift.spills.worlds import finds
from drift.spills.worlds.worlds import Worlds
from geo import notation
from geo.array import Real

SHARES = (0.1, 0.5, 0.9)


def unknowns_table(
    worlds: Worlds,
    prior: Worlds,
    posterior: finds.Posterior,
    start: np.datetime64,
    kinds: Sequence[str],
) -> dict[str, Any]:
    """Return each unknown's unit, and mean and 10/50/90 % quantiles before and after the finds.

    Args:
        worlds: worlds of the last round, weighted by the finds.
        prior: worlds of the first round.
        posterior: posterior of the worlds and of the numbers of objects.
        start: start of the run, UTC.
        kinds: names of the classes of objects.

    Returns:
        A row for each unknown, by its name.
    """
    rows: dict[str, Any] = {}
    before, after = _columns(prior, start, kinds), _columns(worlds, start, kinds)
    even = np.full(prior.size, 1 / prior.size)
    for name, (unit, values) in before.items():
        if np.isfinite(values).all() and np.ptp(values) > 0:
            rows[name] = {
                "unit": unit,
                "prior": _figures(values, even),
                "posterior": _figures(after[name][1], posterior.weight),
            }
    numbers = posterior.known.numbers
    for name, grid, weight, after_finds in (
        (
            "number of objects",
            numbers.objects.astype(float),
            numbers.objects_prior,
            posterior.objects,
        ),
        ("share destroyed", numbers.destroyed, numbers.destroyed_prior, posterior.destroyed),
    ):
        if grid.size > 1:
            rows[name] = {
                "unit": "1",
                "prior": _figures(grid, weight),
                "posterior": _figures(grid, after_finds),
            }
    return rows


def _columns(
    worlds: Worlds, start: np.datetime64, kinds: Sequence[str]
) -> dict[str, tuple[str, Any]]:
    begin = notation.epoch(start)
    turn = 360 / 2**32
    west = int(worlds.lon[0])
    # without a jump at the antimeridian
    lon = np.subtract(worlds.lon, np.int32(west)) * turn + west * turn
    columns: dict[str, tuple[str, Any]] = {
        "release longitude": ("deg", lon),
        "release latitude": ("deg", worlds.lat * turn),
        "release": ("h after start", (worlds.release - begin) / 3600),
        "factor on windage": ("1", worlds.windage),
        "error of the current, east": ("m/s", worlds.current_east),
        "error of the current, north": ("m/s", worlds.current_north),
        "factor on reporting rates": ("1", worlds.reporting),
    }
    if worlds.loss_begin is not None:
        assert worlds.loss_length is not None
        assert worlds.clock is not None
        for number in range(worlds.loss_begin.shape[1]):
            hours = (worlds.loss_begin[:, number] - begin) / 3600
            columns[f"loss {number + 1}, begin"] = ("h after start", hours)
            length = worlds.loss_length[:, number] / 3600
            columns[f"loss {number + 1}, length"] = ("h", length)
        columns["ship's clock, fast"] = ("min", worlds.clock / 60)
    for k, kind in enumerate(kinds):
        columns[f"time to sink, {kind}"] = ("d", worlds.sinking[:, k] / 86_400)
    return columns


def _figures(values: Real, weight: Real) -> dict[str, float]:
    order = np.argsort(values)
    done = np.cumsum(weight[order]) / weight.sum()
    quantiles = values[order][np.minimum(np.searchsorted(done, SHARES), values.size - 1)]
    figures = {"mean": float(np.average(values, weights=weight))}
    return figures | {f"{share:.0%}": float(q) for share, q in zip(SHARES, quantiles, strict=True)}


def unknowns_csv(rows: dict[str, Any], worlds: float, run: str) -> str:
    """Return the table as CSV.

    Args:
        rows: from `unknowns_table`.
        worlds: effective worlds after the finds.
        run: the run_id, for the last column.

    Returns:
        The text of unknowns.csv.
    """
    figures = ("mean", *(f"{share:.0%}" for share in SHARES))
    lines = [
        {
            "unknown": name,
            "unit": row["unit"],
            **{
                f"{when}_{figure}": row[when][figure]
                for when in ("prior", "posterior")
                for figure in figures
            },
            "effective_worlds": worlds,
        }
        for name, row in rows.items()
    ]
    return formats.csv_rows(lines, run=run, digits=".6g")
