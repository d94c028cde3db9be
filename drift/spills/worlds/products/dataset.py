"""The contents of washup.nc: CF-1.11 variables by stretch and output time, and the account."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from drift.engine.particles import weights
from drift.products.files import formats
from drift.products.maps import gazetteer
from geo import notation
from geo.array import Array
from geo.coast.segments import Segments

SHARES = (0.1, 0.5, 0.9)
FATES = ("pending", "afloat", "ashore", "sunk", "gone", "destroyed", "found")
FATES_MEAN = (
    "pending: not yet released; afloat: adrift; gone: left the domain or ran out of forcing; "
    "destroyed: lost at once; found: found and taken away; destroyed and found are included at all times"
)

BY_TIME = ("time", "segment")
GIVEN = "over the simulated spills in which any object arrives there within the run"
# Dimensions, unit and long name by variable. Each has its standard error under name + "_se".
FIGURES: dict[str, tuple[tuple[str, ...], str, str]] = {
    "expected": (BY_TIME, "1", "expected number of objects that lie on the stretch"),
    "probability": (BY_TIME, "1", "probability that at least one object lies on the stretch"),
    "number": (
        ("quantile", *BY_TIME),
        "1",
        "quantile of the number of objects that lie on the stretch",
    ),
    "arrived": (
        BY_TIME,
        "1",
        "expected number of objects that have ever lain on the stretch, without those found",
    ),
    "expected_by_kind": (
        ("kind", *BY_TIME),
        "1",
        "expected number of objects of a class that lie on the stretch",
    ),
    "ever": (
        ("segment",),
        "1",
        "probability that any object not found arrives on the stretch within the run",
    ),
    "first_arrival": (
        ("quantile", "segment"),
        formats.EPOCH,
        f"quantile of the time at which the first arrives, UTC, {GIVEN}",
    ),
    "bulk_arrival": (
        ("quantile", "segment"),
        formats.EPOCH,
        f"quantile of the median time at which the objects of a spill arrive, UTC, {GIVEN}",
    ),
    "total": (("fate", "time"), "1", "expected number of objects by fate"),
    "total_number": (
        ("quantile", "fate", "time"),
        "1",
        "quantile of the number of objects by fate",
    ),
}
SUMMARY = (
    "Objects of a spill on each stretch of coast, and when they arrived: expected numbers, "
    "probabilities and quantiles over simulated spills, with standard errors; and the fates of "
    "all objects."
)
ERROR = "standard error, from the number of worlds and of particles, of the "
ERRORS_MEAN = (
    "errors of means and probabilities allow for worlds that were not sampled "
    "(drift.spills.worlds.estimate.unseen); NaN: too few worlds to judge"
)


def build_washup_dataset(
    figures: Mapping[str, Array],
    segments: Segments,
    touched: Array,
    weight: Array,
    realisations: int,
    outputs: Array,
    start: np.datetime64,
    kinds: Sequence[str],
) -> xr.Dataset:
    """Return figures (see drift.spills.worlds.washup.build_washup) as a dataset.

    Its dimension `segment` is empty if no stretch was touched.

    Args:
        figures: FIGURES and their errors by name, times in [s after start]; those of stretches may
            be missing.
        segments: stretches of coast.
        touched: numbers of the touched stretches in `segments`, (s,).
        weight: weights of the worlds, (W,).
        realisations: number of realisations of each world.
        outputs: output times [s after start], (T,).
        start: start of the run, UTC.
        kinds: names of the classes of objects.

    Returns:
        The contents of washup.nc.
    """
    start = start.astype("datetime64[s]")
    coords = {
        "time": (
            "time",
            (start + outputs.astype("timedelta64[s]")).astype("datetime64[ns]"),
            {"standard_name": "time", "long_name": "time, UTC", "axis": "T"},
        ),
        "start": (
            (),
            start.astype("datetime64[ns]"),
            {"standard_name": "forecast_reference_time", "long_name": "start of the run, UTC"},
        ),
        "segment": (
            "segment",
            touched.astype(np.int32),
            {"long_name": "number of the stretch of coast"},
        ),
        **_places(segments, touched),
        "quantile": (
            "quantile",
            np.array(SHARES),
            {"long_name": "share of the distribution below", "units": "1"},
        ),
        "kind": ("kind", np.array(kinds, object), {"long_name": "class of objects"}),
        "fate": (
            "fate",
            np.array(FATES, object),
            {"long_name": "fate of an object", "comment": FATES_MEAN},
        ),
    }
    sizes = {name: len(coords[name][1]) for name in ("time", "segment", "quantile", "kind", "fate")}
    data = _variables(figures, sizes, notation.epoch(start))
    data["effective_arrivals"] = (
        ("segment",),
        figures.get("effective_arrivals", np.zeros(sizes["segment"])),
        {
            "long_name": "effective number of worlds in which any object arrives on the stretch",
            "units": "1",
        },
    )
    data["world_total"] = (
        ("world", "time", "fate"),
        figures["world_total"],
        {
            "long_name": "number of objects by fate in each world, mean of its realisations",
            "units": "1",
            "comment": "adds up to the world's number of objects",
        },
    )
    data["world_weight"] = (
        ("world",),
        weight,
        {"long_name": "probability of the world", "units": "1"},
    )
    data["effective_worlds"] = (
        (),
        weights.effective(weight),
        {
            "long_name": "effective number of worlds after the finds",
            "units": "1",
            "comment": (
                "worlds are weighted by the finds; forecast.nc also weights each by its mapped "
                "probability at a time"
            ),
        },
    )
    data["realisations"] = (
        (),
        realisations,
        {"long_name": "simulated spills of each world", "units": "1"},
    )
    return xr.Dataset(data, coords, {"summary": SUMMARY})


def _variables(
    figures: Mapping[str, Array], sizes: Mapping[str, int], begin: float
) -> dict[str, tuple[Any, ...]]:
    """Return FIGURES and their errors as variables, zero if missing.

    begin: start of the run [s since 1970].
    """
    data: dict[str, tuple[Any, ...]] = {}
    for name, (dims, unit, words) in FIGURES.items():
        blank = np.zeros([sizes[dim] for dim in dims])
        value, error = figures.get(name, blank), figures.get(f"{name}_se", blank)
        moment = unit == formats.EPOCH
        clock = {"calendar": "standard"} if moment else {}
        data[name] = (
            dims,
            begin + value if moment else value,
            {"long_name": words, "units": unit, **clock, "ancillary_variables": f"{name}_se"},
        )
        data[f"{name}_se"] = (
            dims,
            error,
            {"long_name": ERROR + words, "units": "s" if moment else unit, "comment": ERRORS_MEAN},
        )
    return data


def _places(segments: Segments, touched: Array) -> dict[str, tuple[str, Any, dict[str, Any]]]:
    """Return names, ids, shores, middles, lengths and nearest towns of stretches as coordinates."""
    towns = gazetteer.nearest_towns(segments.lon[touched], segments.lat[touched], segments.land)
    return {
        "name": (
            "segment",
            np.array([segments.name[i] for i in touched], object),
            {"long_name": "name of the stretch"},
        ),
        "stretch_id": (
            "segment",
            np.array(
                [segments.id[i] for i in touched] if segments.id else [""] * len(touched), object
            ),
            {"long_name": "id of the stretch: the geohash of its middle"},
        ),
        "access": (
            "segment",
            np.array([segments.access[i] for i in touched], object),
            {"long_name": "kind of shore"},
        ),
        "lon": (
            "segment",
            segments.lon[touched],
            {
                "standard_name": "longitude",
                "long_name": "longitude of the middle",
                "units": "degrees_east",
            },
        ),
        "lat": (
            "segment",
            segments.lat[touched],
            {
                "standard_name": "latitude",
                "long_name": "latitude of the middle",
                "units": "degrees_north",
            },
        ),
        "length": (
            "segment",
            segments.length[touched],
            {"long_name": "length along the shoreline", "units": "m"},
        ),
        "near": (
            "segment",
            np.array([town.name for town in towns], object),
            {"long_name": "nearest town or harbour on the same land mass, else the nearest of all"},
        ),
        "near_distance": (
            "segment",
            np.array([town.away for town in towns], float),
            {"long_name": "distance from the middle to that town", "units": "m"},
        ),
        "near_across_water": (
            "segment",
            np.array([town.across for town in towns], np.int8),
            {
                "long_name": "whether that town lies on another land mass",
                "flag_values": np.array([0, 1], np.int8),
                "flag_meanings": "same_land_or_not_known across_water",
            },
        ),
    }
