"""Tracks of a subsample of the particles, for particles.nc: CF trajectories with common times."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from drift.engine.particles.status import AT_REST, LOST, Status
from drift.forecast.build import Forecast
from drift.products.files import formats
from geo import notation, sphere
from geo.array import Array
from geo.forcing.quantity import QUANTITIES


@dataclass(frozen=True)
class Trajectories:
    """A subsample's tracks, free of NaN: a particle that has stopped stays where it stopped."""

    time: Array  # datetime64, (t,)
    slot: Array  # int, (m,): number of the particle
    scenario: Array  # int, (m,)
    lon: Array  # int32 binary angle, (m, t)
    lat: Array  # int32 binary angle, (m, t)
    status: Array  # drift.engine.particles.status.Status, (m, t)
    weight: Array  # probability of the particle [1], (m, t)
    # Each int32 (m,), -1 where there is none; None: not known. Times count from the start of the
    # run in its direction.
    release: Array | None = None  # [s]
    ended: Array | None = None  # [s], when it went ashore, outside the forcing or left the domain
    edge: Array | None = None  # of the shoreline, where it went ashore
    scalars: Mapping[str, Array] = field(default_factory=dict)  # of the forcing, each (m, t)


def dataset(tracks: Trajectories, forecast: Forecast) -> xr.Dataset:
    """Return a subsample's tracks as CF trajectories with common times, (trajectory, time)."""
    codes = np.array([int(s) for s in Status], np.int8)
    by_time = ("trajectory", "time")
    names = [str(name) for name in forecast.data["scenario"].values]
    around = float(forecast.data["lon"][0]) - 180
    # no jump at the antimeridian
    lon = sphere.east_of_degrees(sphere.to_degrees(tracks.lon), around)
    return xr.Dataset(
        {
            "status": (
                by_time,
                tracks.status.astype(np.int8),
                {
                    "long_name": "fate of the particle",
                    "flag_values": codes,
                    "flag_meanings": " ".join(s.name.lower() for s in Status),
                },
            ),
            "weight": (
                by_time,
                tracks.weight.astype(np.float64),
                {
                    "long_name": "particle's probability",
                    "units": "1",
                    "comment": "after resampling, tracks are those of the last particles' ancestors: to use "
                    "whole tracks, given all evidence, take the weight at the last time",
                },
            ),
            "scenario": (
                "trajectory",
                tracks.scenario.astype(np.int32),
                {
                    "long_name": "scenario",
                    "flag_values": np.arange(len(names), dtype=np.int32),
                    "flag_meanings": " ".join(_flags(names)),
                },
            ),
            **_events(tracks),
            **{
                name: (
                    by_time,
                    values.astype(np.float32),
                    {"long_name": QUANTITIES[name].spoken, "units": QUANTITIES[name].unit},
                )
                for name, values in tracks.scalars.items()
            },
        },
        {
            "trajectory": (
                "trajectory",
                tracks.slot.astype(np.int64),
                {"cf_role": "trajectory_id", "long_name": "number of the particle"},
            ),
            "time": (
                "time",
                tracks.time.astype("datetime64[ns]"),
                {"standard_name": "time", "long_name": "time, UTC", "axis": "T"},
            ),
            "lon": (
                by_time,
                lon,
                {"standard_name": "longitude", "long_name": "longitude", "units": "degrees_east"},
            ),
            "lat": (
                by_time,
                sphere.to_degrees(tracks.lat),
                {"standard_name": "latitude", "long_name": "latitude", "units": "degrees_north"},
            ),
        },
        {
            "featureType": "trajectory",
            "summary": "Tracks of a subsample of the particles of a forecast: position, status and "
            "its weight, at each output time.",
        },
    )


def _flags(names: Sequence[str]) -> list[str]:
    """Return names as unique words for CF's flag_meanings, made of letters, digits and
    _-.+@ only.
    """
    words: list[str] = []
    for name in names:
        plain = word = re.sub(r"[^\w.+@-]", "_", "_".join(name.split()))
        number = 1
        while word in words:
            number += 1
            word = f"{plain}_{number}"
        words.append(word)
    return words


def _events(tracks: Trajectories) -> dict[str, tuple[str, Array, dict[str, str]]]:
    """Return variables of each trajectory's release time, end time and shoreline edge,
    where known.
    """
    variables: dict[str, tuple[str, Array, dict[str, str]]] = {}
    direction = -1 if tracks.time[-1] < tracks.time[0] else 1
    halted = np.isin(tracks.status[:, -1], (*AT_REST, *LOST))

    # Times are written as numbers, for xarray cannot encode times that are all NaT.
    clock = {"units": formats.EPOCH, "calendar": "standard"}
    begin = notation.epoch(tracks.time[0])

    def times(seconds: Array, happened: Array) -> Array:
        return np.where(
            happened & (seconds >= 0), begin + direction * seconds.astype(np.float64), np.nan
        )

    if tracks.release is not None:
        released = times(tracks.release, np.ones(len(tracks.slot), bool))
        variables["time_released"] = (
            "trajectory",
            released,
            {"long_name": "time of release, UTC", **clock},
        )
    if tracks.ended is not None:
        words = {
            "long_name": "time of going ashore, out of the forcing or out of the domain, UTC; see status",
            **clock,
        }
        variables["time_ended"] = ("trajectory", times(tracks.ended, halted), words)
    if tracks.edge is not None:
        words = {
            "long_name": "edge of the run's shoreline where it went ashore",
            "units": "1",
            "comment": "-1: not ashore",
        }
        variables["coast_edge"] = ("trajectory", tracks.edge.astype(np.int32), words)
    return variables
