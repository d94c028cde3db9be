"""Items of report.html for a forecast: maps by time, areas, tracks, strandings, and status
shares.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from drift.engine.particles.status import Status
from drift.forecast import coastal, mapped
from drift.forecast.build import Forecast
from drift.forecast.products import headline, layers
from drift.forecast.tracks import Trajectories
from drift.products.files import geojson
from drift.products.report import leaves
from drift.products.report.leaves import Leaf
from geo import notation, sphere
from geo.notation import NMI


def forecast_leaves(
    forecast: Forecast, tracks: Trajectories, opens: np.datetime64 | None
) -> list[Leaf]:
    """Return the report items of a forecast and its subsample; opens: the time shown first."""
    data = forecast.data
    stories = {"All scenarios": data["probability"].values}
    if data.sizes["scenario"] > 1:
        by_story = data["probability_by_scenario"]
        names = [str(name) for name in data.get("mapped_scenario", data["scenario"]).values]
        stories |= {name: by_story.values[:, k] for k, name in enumerate(names)}
    outputs = [data.isel(time=k) for k in range(data.sizes["time"])]
    tops = [layers.scale_top(at) / 100 / NMI**2 for at in outputs]
    lon = sphere.to_degrees(tracks.lon)
    return [
        leaves.headline_leaf(headline.forecast_headline(data, opens)),
        leaves.maps_leaf(
            "Probability",
            data["time"].values,
            data["lon"].values,
            data["lat"].values,
            stories,
            data["cell_area"].values,
            tops,
            containment=data["containment"].values,
            shown=mapped.SHOWN,
            pale=_mostly_ashore(data),
        ),
        leaves.shapes_leaf(
            "Areas",
            "contours.geojson",
            "area",
            when=leaves.AT,
            frame=True,
            told=[
                ("level", "Holds", "share"),
                ("area_nmi2", "Area", "nmi2"),
                ("effective_particles", "Effective particles", "count"),
            ],
        ),
        leaves.points_leaf(
            "Ashore at the end",
            "ashore.csv",
            "ashore",
            since="first_time",
            weight="probability_ashore",
            shown="effective_worlds" not in data,
            told=[
                ("position", "Position", "words"),
                ("probability_ashore", "Probability", "share"),
                ("first_time", "By", "time"),
            ],
        ),
        *_on_coast(forecast, outputs),
        leaves.sample_leaf(
            "Tracks of a sample",
            tracks.time,
            lon,
            sphere.to_degrees(tracks.lat),
            tracks.status,
            [status.name.lower() for status in sorted(Status)],
            tracks.scenario,
        ),
        leaves.track_leaf("Datum", "track.csv", "datum_lon", "datum_lat", "datum", shown=False),
        leaves.track_leaf("Mean position", "track.csv", "mean_lon", "mean_lat", "mean"),
        leaves.table_leaf(
            "By time",
            _columns(data),
            file="track.csv",
            by_time="time",
            note="Press a row to see its map.",
            unfolded=True,
        ),
    ]


def _mostly_ashore(data: Any) -> list[bool]:
    """Return at which times more is ashore than adrift; the map then shows the coast first."""
    status = data["status_probability"]
    more = status.sel(status="ashore") > status.sel(status="adrift")
    return [bool(one) for one in more.values]


def _on_coast(forecast: Forecast, outputs: Sequence[Any]) -> list[Leaf]:
    """Return the coast inside each area by time, where outlines disappear under the shoreline."""
    drawn = [
        geojson.feature(
            geojson.lines([lines]),
            {
                "time": notation.iso(at["time"].values[()]),
                "level": share,
                "coast_nmi": coastal.coast_length(at, share) / NMI,
            },
        )
        for at in outputs
        for share, lines in sorted(
            coastal.coast_lines_by_share(at, forecast.shares).items(), reverse=True
        )
    ]
    told = [
        ("level", "Coast, of the area that holds", "share"),
        ("coast_nmi", "Its length, about, nmi", "number"),
    ]
    # A spill reports stretches of coast instead.
    shown = "effective_worlds" not in forecast.data
    return (
        [
            leaves.features_leaf(
                "Areas on the coast", drawn, "coast", when=leaves.AT, told=told, shown=shown
            )
        ]
        if drawn
        else []
    )


def _columns(data: Any) -> list[tuple[str, str, str]]:
    """Return the columns of track.csv that apply to this run."""
    held = [notation.hundredths(share) for share in data["share"].values]
    ever = data["status_probability"].values.max(axis=0) > 0
    status = [str(name) for name, there in zip(data["status"].values, ever, strict=True) if there]
    counts = {
        "effective_particles": "Effective particles",
        "effective_worlds": "Effective worlds on the map",
    }
    return [
        ("time", "Time", "time"),
        ("mean_position", "Mean position", "words"),
        ("datum_position", "Datum", "words"),
        *((f"area_{share}_nmi2", f"{share} % area", "nmi2") for share in held),
        *((f"probability_{name}", name.replace("_", " ").capitalize(), "share") for name in status),
        *((name, header, "count") for name, header in counts.items() if name in data),
    ]
