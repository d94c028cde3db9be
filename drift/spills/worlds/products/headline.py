"""The headline of a spill's report: number of objects ashore at the end, and the worst stretch."""

import xarray as xr

from drift.products.maps import labels
from drift.spills.worlds import washup
from drift.spills.worlds.products.tables import stretch_name
from geo import notation
from geo.notation import NMI

MENTIONED = 0.05  # [objects] least expected number that gets a sentence


def washup_headline(data: xr.Dataset) -> str:
    """Return the sentences at the top of the report of a spill.

    Args:
        data: as drift.spills.worlds.products.dataset.build_washup_dataset returns it.
    """
    at = data.isel(time=-1)
    when = notation.format_dtg(at["time"].values)
    ashore = at.sel(fate="ashore")
    expected, lost = ashore["total"].item(), at["total"].values.sum()
    if expected < MENTIONED:
        return f"By {when}, hardly any of {lost:,.0f} objects is ashore."
    low, _, high = ashore["total_number"].values
    words = f"By {when}, {labels.number(expected)} of {lost:,.0f} objects are expected ashore"
    words += f" ({low:,.0f} to {high:,.0f} with 80 % probability)." if high > low else "."
    worst = at.isel(segment=washup.worst_stretches(data, 1)[0])
    name, near = worst["name"].item(), worst["near"].item()
    place = stretch_name(int(worst["segment"]), name, near)
    away = f", {worst['near_distance'].item() / NMI:.0f} nmi from {near}" if near else ""
    return (
        f"{words} The stretch with most of them, {labels.number(worst['expected'].item())}, is "
        f"{place}{away}."
    )
