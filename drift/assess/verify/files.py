"""A verification as a CSV table, as netCDF, and as numbers for summary.json."""

from typing import Any

import numpy as np
import xarray as xr

from drift.assess.verify import text as verification_text
from drift.assess.verify.verification import Verification
from drift.products.files import formats
from drift.tracking.tracks.clusters import Estimate
from geo.array import Array

Variable = tuple[tuple[str, ...], Array, dict[str, str]]  # dimensions, values and attributes

SUMMARY = (
    "Forecasts of real drifters from many starts, compared with their tracks: separation, spread, "
    "areas that held them, ranks, skill, energy and log score."
)


def summary_of_verification(result: Verification) -> dict[str, Any]:
    """Return shares held, separations, ranks and scores for summary.json, with standard errors."""

    def numbers_of(estimate: Estimate) -> dict[str, Any]:
        return {"mean": estimate.mean, "standard_error": estimate.error, "count": estimate.count}

    columns = np.searchsorted(result.hours, result.leads)
    return {
        "forecasts": result.skill.size,
        "left_out": dict(result.left_out),
        "drifters": list(result.names),
        "skill": {
            **numbers_of(result.mean(result.skill)),
            "median": float(np.median(result.skill)),
        },
        "skill_unclipped": numbers_of(result.mean(result.unclipped)),
        "skill_unclipped_of_staying": numbers_of(result.mean(result.staying)),
        "leads": [
            {
                "hours": float(hours),
                "held": {
                    f"{share:.0%}": numbers_of(result.held(lead, share)) for share in result.shares
                },
                "separation_m": {
                    **numbers_of(result.mean(result.apart[:, k])),
                    "median": float(np.median(result.apart[:, k])),
                },
                "persistence_m": numbers_of(result.mean(result.waiting[:, k])),
                "energy_score_m": numbers_of(result.mean(result.energy[:, lead])),
                "log_score_per_km2": {
                    **numbers_of(result.mean(result.log[:, lead])),
                    "median": float(np.median(result.log[:, lead])),
                },
                "aground": numbers_of(result.mean(result.aground[:, k], share=True)),
                "ashore": float(result.ashore[:, k].mean()),
                "rank_along": numbers_of(result.mean(result.along[:, lead])),
                "rank_across": numbers_of(result.mean(result.across[:, lead])),
            }
            for lead, (hours, k) in enumerate(zip(result.leads, columns, strict=True))
        ],
        "lost": float(result.lost.mean()),
        "notes": list(result.notes),
        "in_short": verification_text.headline(result),
    }


def verification_csv(result: Verification, run: str) -> str:
    """Return a row for each forecast and lead as CSV; run: the run_id, for the last column."""
    columns = np.searchsorted(result.hours, result.leads)
    rows = [
        {
            "drifter": result.names[result.drifter[n]],
            "start": np.datetime64(int(result.start[n]), "s"),
            "lead_h": f"{result.leads[lead]:g}",
            "lon": f"{result.lon[n, k]:.6f}",
            "lat": f"{result.lat[n, k]:.6f}",
            "separation_m": f"{result.apart[n, k]:.1f}",
            "persistence_m": f"{result.waiting[n, k]:.1f}",
            "way_m": f"{result.way[n, k]:.1f}",
            "spread_m": f"{result.spread[n, k]:.1f}",
            "aground": f"{result.aground[n, k]:d}",
            "ashore": f"{result.ashore[n, k]:.4f}",
            "containment": f"{result.containment[n, lead]:.4f}",
            "rank_along": f"{result.along[n, lead]:.4f}",
            "rank_across": f"{result.across[n, lead]:.4f}",
            "energy_score_m": f"{result.energy[n, lead]:.1f}",
            "log_score_per_km2": f"{result.log[n, lead]:.4f}",
            "skill": f"{result.skill[n]:.4f}",
            "skill_unclipped": f"{result.unclipped[n]:.4f}",
            "lost": f"{result.lost[n]:.4f}",
        }
        for n in range(result.skill.size)
        for lead, k in enumerate(columns)
    ]
    return formats.csv_rows(rows, run=run)


def verification_dataset(result: Verification) -> xr.Dataset:
    """Return a verification as a dataset over forecast, hours after the start, and lead."""

    def hourly(values: Array, long_name: str, units: str) -> Variable:
        return ("forecast", "hours"), values, {"long_name": long_name, "units": units}

    def metres(values: Array, long_name: str) -> Variable:
        return hourly(values, long_name, "m")

    def position(values: Array, axis: str, units: str) -> Variable:
        dims, values, words = hourly(values, f"{axis} of the drifter", units)
        return dims, values, {"standard_name": axis, **words}

    def share(values: Array, long_name: str, units: str = "1") -> Variable:
        return ("forecast", "lead"), values, {"long_name": long_name, "units": units}

    names = np.array(result.names, dtype=object)[result.drifter]
    since = {"standard_name": "forecast_period", "long_name": "time after the start", "units": "h"}
    starts = result.start.astype("datetime64[s]").astype("datetime64[ns]")
    return xr.Dataset(
        {
            "drifter": ("forecast", names, {"long_name": "name of the drifter"}),
            "start": (
                "forecast",
                starts,
                {
                    "standard_name": "forecast_reference_time",
                    "long_name": "start of the forecast, UTC",
                },
            ),
            "drifter_lon": position(result.lon, "longitude", "degrees_east"),
            "drifter_lat": position(result.lat, "latitude", "degrees_north"),
            "separation": metres(result.apart, "distance of the mean position from the drifter"),
            "persistence": metres(result.waiting, "distance of the start from the drifter"),
            "way": metres(result.way, "path length of the drifter since the start"),
            "spread": metres(
                result.spread, "root mean square distance of the particles from their mean"
            ),
            "aground": hourly(
                result.aground.astype(np.int8),
                "whether the drifter is aground: 0 afloat, 1 aground",
                "1",
            ),
            "ashore": hourly(
                result.ashore, "share of the probability on the map that is ashore", "1"
            ),
            "containment": share(
                result.containment, "share of the smallest area that holds the drifter"
            ),
            "rank_along": share(
                result.along,
                "share of the probability behind the drifter, along the forecast drift",
            ),
            "rank_across": share(
                result.across, "share of the probability to the left of the drifter"
            ),
            "energy_score": share(result.energy, "energy score of the particles", "m"),
            "log_score": share(
                result.log, "logarithm of the density of the particles per km2 at the drifter"
            ),
            "skill_unclipped": (
                "forecast",
                result.unclipped,
                {"long_name": "skill without a lower limit", "units": "1"},
            ),
            "skill": (
                "forecast",
                result.skill,
                {"long_name": "skill (Liu and Weisberg 2011)", "units": "1"},
            ),
            "lost": (
                "forecast",
                result.lost,
                {"long_name": "probability on no map at the end", "units": "1"},
            ),
        },
        {
            "hours": ("hours", result.hours.astype(float), since),
            "lead": ("lead", result.leads.astype(float), since),
            "time": (
                ("forecast", "hours"),
                starts[:, None] + (result.hours * 3600).astype("timedelta64[s]"),
                {"standard_name": "time", "long_name": "time, UTC"},
            ),
        },
        {
            "summary": SUMMARY,
            "comment": f"{verification_text.headline(result)}{verification_text.left_out(result)}",
        },
    )
