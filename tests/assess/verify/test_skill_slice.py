"""Forecasts of the drifter that ships with the tests, against NumPy and closed forms."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from scipy import special

import drift

SLICE = Path(__file__).parents[2] / "data" / "biscay_drifter" / "drifter_6203641.csv"
COLUMNS = {"current_east": "current_east", "current_north": "current_north"}
RADIUS = 6_371_008.8  # [m]
CASE = """
start = "2021-03-05T00:00Z"
duration = "24 h"
coast.source = "none"
{errors}
[[scenario]]
name = "drifter"
object = "water"
position = {{ at = [-2.5, 44.7], error = "100 m" }}
"""


def verified(folder, errors, particles):
    (folder / "case.toml").write_text(CASE.format(errors=errors))
    case = drift.load(folder / "case.toml", along=["current"])
    return drift.verify(
        case, SLICE, columns=COLUMNS, every=48 * 3600, hours=24, error=100.0, particles=particles
    )


def beyond(made):
    """Return how far the drifter went beyond the model at the leads [m], (n, leads, 2)."""
    rows = [row for row in csv.DictReader(SLICE.read_text().splitlines()) if row["current_east"]]
    time = np.array([row["time"][:-1] for row in rows], "datetime64[s]").astype(float)
    lon, lat, u, v = (
        np.array([float(row[key]) for row in rows])
        for key in ("lon", "lat", "current_east", "current_north")
    )
    found = []
    for start in made.start:
        when = start + 60.0 * np.arange(24 * 60 + 1)  # the model between fixes is linear
        east, north = (
            np.concatenate([[0.0], np.cumsum(30.0 * (c[1:] + c[:-1]))])
            for c in (np.interp(when, time, u), np.interp(when, time, v))
        )
        at = [60 * int(lead) for lead in made.leads]
        x, y = np.radians(np.interp(when, time, lon)), np.radians(np.interp(when, time, lat))
        east = (x - x[0]) * np.cos((y + y[0]) / 2) * RADIUS - east
        north = (y - y[0]) * RADIUS - north
        found.append(np.stack([east[at], north[at]], axis=1))
    return np.array(found)


def test_separation_is_that_beyond_the_model(tmp_path):
    made = verified(tmp_path, 'uncertainty = "none"', 500)
    assert made.start.size >= 5
    expected = np.hypot(*np.moveaxis(beyond(made), -1, 0))
    found = made.apart[:, np.searchsorted(made.hours, made.leads)]
    # the mean of 500 starts of 85 m a component, and 10 m for the plane
    assert found == pytest.approx(expected, abs=3 * 85 * math.sqrt(2 / 500) + 10)


def test_scores_are_those_of_the_normal_law(tmp_path):
    """Energy score and log score by their closed forms for the errors of the case."""
    std, memory, bias = 0.12, 9 * 3600.0, 0.05
    errors = 'uncertainty.current = { std = "0.12 m/s", time = "9 h", bias = "0.05 m/s" }'
    count = 4000
    made = verified(tmp_path, errors, count)
    t = 3600 * made.leads
    variance = 2 * std**2 * memory * (t - memory * (1 - np.exp(-t / memory))) + bias**2 * t**2
    variance += 100**2 / (2 * math.log(2))
    square = (beyond(made) ** 2).sum(axis=-1)
    width = np.sqrt(variance)
    rice = width * math.sqrt(math.pi / 2) * special.hyp1f1(-0.5, 1, -square / (2 * variance))
    energy = rice - width * math.sqrt(math.pi) / 2
    # standard errors of both means of distances, as in test_scores.py
    assert made.energy == pytest.approx(energy, abs=3 * 1.9 * width.max() / math.sqrt(count))
    # the kernels widen the law by n^(-1/3) of its variance; of n particles 4 % count at the middle
    wide = variance * (1 + count ** (-1 / 3))
    log = np.log(1e6 / (2 * math.pi * wide)) - square / (2 * wide)
    near = square < 2 * variance
    assert near.any()
    assert made.log[near] == pytest.approx(log[near], abs=3 / math.sqrt(0.04 * count))
