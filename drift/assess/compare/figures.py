"""Figures of a run at one output time, each with the influence of every sampling unit on it."""

from typing import Any

import numpy as np

from drift.assess.compare.units import Figure, SamplingUnits, sum_by_unit
from drift.engine.particles.snapshot import Snapshot, mapped
from drift.engine.particles.status import Status
from drift.forecast import containment
from drift.forecast.build import Forecast
from geo import notation, sphere
from geo.array import Array

SHIFT = ("mean, east", "mean, north")  # quantities relative to the mean position of the first run

Figures = dict[tuple[str, str, str], Figure]  # by quantity, name and unit


def status_shares(snapshot: Snapshot, names: tuple[str, ...], units: SamplingUnits) -> Figures:
    """Return the probability of each status, and of each of several scenarios (`names`)."""
    unit, p = units.of(snapshot), snapshot.probability

    def share(selected: Array) -> Figure:
        value = float(p[selected].sum())
        return Figure(value, sum_by_unit(unit, p * (selected - value), units))

    found = {("status", s.name.lower(), "1"): share(snapshot.status == s) for s in Status}
    if len(names) > 1:
        found |= {
            ("scenario", name, "1"): share(snapshot.scenario == k) for k, name in enumerate(names)
        }
    return found


def mean_position(snapshot: Snapshot, units: SamplingUnits, origin: tuple[float, float]) -> Figures:
    """Return how far the mean position is east and north of an origin (lon, lat) [deg], in [m].

    It is the vector mean of the mapped particles. The influence of a particle is its share of the
    sum of vectors, in the tangent plane of the mean.
    """
    unit, weight = units.of(snapshot), np.where(mapped(snapshot), snapshot.probability, 0.0)
    if not weight.any():
        unknown = Figure(np.nan, np.zeros(units.size))
        return {(name, "all", "m"): unknown for name in SHIFT}
    vectors = np.stack(sphere.vector(snapshot.lon * sphere.UNIT, snapshot.lat * sphere.UNIT))
    x, y, z = total = vectors @ weight
    lon, lat = np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    north = np.array([-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)])
    away = sphere.offset(np.radians(origin[0]), np.radians(origin[1]), lon, lat)
    scale = sphere.RADIUS / float(np.sqrt(total @ total))
    return {
        (name, "all", "m"): Figure(
            float(apart), sum_by_unit(unit, weight * (along @ vectors) * scale, units)
        )
        for name, apart, along in zip(SHIFT, away, (east, north), strict=True)
    }


def area_figures(
    snapshot: Snapshot, forecast: Forecast, time: int, units: SamplingUnits
) -> Figures:
    """Return the containment areas [m2] of the case's shares at an output (`time`: its index).

    The area of share s consists of the densest cells, cut at the density t where they hold s of the
    probability. A particle inside lets the cut rise, one outside lets it fall. The influence is its
    weight times (s - inside) / t (generalised quantiles: Einmahl and Mason 1992,
    doi:10.1214/aos/1176348670).
    """
    unit, weight = units.of(snapshot), np.where(mapped(snapshot), snapshot.probability, 0.0)
    at = forecast.data.isel(time=time)
    found: Figures = {}
    degrees = 360.0 / sphere.TURN
    inside = containment.containment_at(
        forecast.data, at["time"].values, snapshot.lon * degrees, snapshot.lat * degrees
    )
    total = float(weight.sum())
    for share, size in zip(at["share"].values, at["containment_area"].values, strict=True):
        influence = np.zeros(units.size)
        if np.isfinite(size) and total > 0:
            pull = (
                weight
                / total
                * (share - (inside <= share))
                / (_edge_density(at, float(share)) / total)
            )
            influence = sum_by_unit(unit, pull, units)
        found["area", f"{notation.hundredths(share)} %", "m2"] = Figure(float(size), influence)
    return found


def _edge_density(at: Any, share: float) -> float:
    """Return the density [1/m2] at the edge of the area of a share, at one output of a forecast."""
    containment_of_cell, p = (
        at["containment"].values.ravel().astype(np.float64),
        at["probability"].values.ravel().astype(np.float64),
    )
    cells = p > 0
    order = np.argsort(containment_of_cell[cells], kind="stable")
    density = p[cells] / at["cell_area"].values.ravel()[cells]
    return float(
        np.exp(np.interp(share, containment_of_cell[cells][order], np.log(density[order])))
    )
