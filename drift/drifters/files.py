"""A verification as a table, as netCDF, and in numbers. Writes no file."""

from typing import Any

import numpy as np
import xarray as xr

from drift.drifters import text as verification_text
from drift.drifters.verification import Verification
from drift.output import formats
from geo import notation


def numbers(made: Verification) -> dict[str, Any]:
    """Return the summary's numbers: shares held, separations and skill, each with its clustered standard error."""

    def estimate(found: Any) -> dict[str, Any]:
        return {"mean": found.mean, "standard_error": found.error, "count": found.count}

    columns = np.searchsorted(made.hours, made.leads)
    return {
        "forecasts": made.skill.size,
        "drifters": list(made.names),
        "skill": {**estimate(made.mean(made.skill)), "median": float(np.median(made.skill))},
        "leads": [
            {
                "hours": float(hours),
                "held": {f"{share:.0%}": estimate(made.held(lead, share)) for share in made.shares},
                "separation_m": {**estimate(made.mean(made.apart[:, k])), "median": float(np.median(made.apart[:, k]))},
                "persistence_m": estimate(made.mean(made.waiting[:, k])),
                "rank_along": estimate(made.mean(made.along[:, lead])),
                "rank_across": estimate(made.mean(made.across[:, lead])),
            }
            for lead, (hours, k) in enumerate(zip(made.leads, columns, strict=True))
        ],
        "lost": float(made.lost.mean()),
        "notes": list(made.notes),
        "in_short": verification_text.headline(made),
    }


def table(made: Verification, run: str) -> str:
    """Return a row for each forecast and lead as CSV; run: its run_id, in the last column."""
    header = ["drifter", "start", "lead_h", "lon", "lat", "separation_m", "persistence_m", "way_m", "spread_m",
              "containment", "rank_along", "rank_across", "skill", "lost", "run_id"]  # fmt: skip
    rows = []
    columns = np.searchsorted(made.hours, made.leads)
    for n in range(made.skill.size):
        for lead, k in enumerate(columns):
            metres = [f"{values[n, k]:.1f}" for values in (made.apart, made.waiting, made.way, made.spread)]
            shares = [f"{values[n, lead]:.4f}" for values in (made.containment, made.along, made.across)]
            rows.append([
                made.names[made.drifter[n]], notation.iso(np.datetime64(int(made.start[n]), "s")), f"{made.leads[lead]:g}",
                f"{made.lon[n, k]:.6f}", f"{made.lat[n, k]:.6f}", *metres, *shares, f"{made.skill[n]:.4f}",
                f"{made.lost[n]:.4f}", run,
            ])  # fmt: skip
    return formats.csv_text(header, rows)


def dataset(made: Verification) -> xr.Dataset:
    """Return everything by forecast, point in time and lead."""

    def metres(values: Any, words: str) -> Any:
        return ("forecast", "hours"), values, {"long_name": words, "units": "m"}

    def share(values: Any, words: str) -> Any:
        return ("forecast", "lead"), values, {"long_name": words, "units": "1"}

    return xr.Dataset(
        {
            "drifter": ("forecast", np.array(made.names, dtype=object)[made.drifter], {"long_name": "name of the drifter"}),
            "start": ("forecast", made.start.astype("datetime64[s]").astype("datetime64[ns]"), {"long_name": "start of the forecast, UTC"}),
            "drifter_lon": (("forecast", "hours"), made.lon, {"long_name": "longitude of the drifter", "units": "degrees_east"}),
            "drifter_lat": (("forecast", "hours"), made.lat, {"long_name": "latitude of the drifter", "units": "degrees_north"}),
            "separation": metres(made.apart, "distance of the mean position from the drifter"),
            "persistence": metres(made.waiting, "distance of the start from the drifter"),
            "way": metres(made.way, "way of the drifter since the start"),
            "spread": metres(made.spread, "root mean square distance of the particles from their mean"),
            "containment": share(made.containment, "share of the smallest area that holds the drifter"),
            "rank_along": share(made.along, "share of the probability behind the drifter, along the forecast drift"),
            "rank_across": share(made.across, "share of the probability to the left of the drifter"),
            "skill": ("forecast", made.skill, {"long_name": "skill (Liu and Weisberg 2011)", "units": "1"}),
            "lost": ("forecast", made.lost, {"long_name": "probability on no map at the end", "units": "1"}),
        },
        {
            "hours": ("hours", made.hours.astype(float), {"long_name": "time after the start", "units": "h"}),
            "lead": ("lead", made.leads.astype(float), {"long_name": "time after the start", "units": "h"}),
        },
        {"comment": verification_text.headline(made)},
    )  # fmt: skip
