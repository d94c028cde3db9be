"""A release found backward from finds at sea, and the closed form of its law."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import stats

from drift.case import file as case_file
from drift.case.record import Case
from drift.engine.environment.environment import Environment
from drift.engine.motion.forcing import Sources
from drift.pipeline import run_setup
from drift.spills.backtrack import backward
from geo import sphere
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast.segments import Segments
from geo.forcing.sources import Source
from geo.grids.grid import Grid
from kernels.step import advance as kernel

BOX = Box(-1.4, -1.4, 1.4, 1.4)
EVERYWHERE = kernel.Domain(-(2**31), -(2**30), 2**32 - 1, 2**31)
DEGREE = np.radians(sphere.RADIUS)  # [m] at the equator
CONVERGENCE = 1.0e-5  # [1/s] -du/dx = -dv/dy
HUB = (20_000.0, -9_000.0)  # [m] (x, y) where the flow converges
T0 = 1_795_000_000 // 3600 * 3600
HOUR = 3600


def converging() -> Source:
    """u = -k (x - HUB), linear in lon and lat: bilinear sampling adds no error."""
    grid = Grid(-1.5, -1.5, 0.5, 0.5, 7, 7)
    lon, lat = np.meshgrid(grid.lon, grid.lat)
    flow = np.stack(
        [-CONVERGENCE * (lon * DEGREE - HUB[0]), -CONVERGENCE * (lat * DEGREE - HUB[1])], axis=-1
    )
    field = np.ascontiguousarray(flow, np.float32)
    return Source(
        "current",
        "converging",
        grid,
        np.empty(0, "datetime64[s]"),
        lambda i: field,
        0.0,
        (),
        "converging",
    )


START = np.datetime64(T0, "s")
SPREAD, BIAS, RADIUS, DIFFUSIVITY, SCATTER = 20_000.0, 0.06, 1_000.0, 50.0, 300.0
WINDOW = 24 * HOUR
# [s], [m] east and north: two finds
SEEN = ((40 * HOUR, 12_400.0, -2_900.0), (30 * HOUR, 7_500.0, 200.0))
SPILL = f"""
start = "{np.datetime_as_string(START)}Z"
duration = "120 h"
seed = 5
clock.step = "30 min"
uncertainty.diffusivity = "{DIFFUSIVITY} m2/s"
[[current]]
name = "converging"
constant = {{ east = "0 m/s", north = "0 m/s" }}
[spill]
objects = 2
worlds = 50
windage_bias = 0
current_bias = "{BIAS} m/s"
release_std = "{SCATTER} m"
position = {{ at = [0.0, 0.0], std = "{SPREAD} m", until = "+{WINDOW // HOUR} h" }}
[[spill.class]]
name = "drum"
object = "water"
"""


def at_sea(seconds: int, x: float, y: float) -> str:
    return (
        f'\n[[find]]\nat = [{x / DEGREE}, {y / DEGREE}]\ntime = "+{seconds / HOUR} h"\nat_sea = true\n'
        f'radius = "{RADIUS} m"\n'
    )


def case_of(tmp_path: Path, text: str) -> Case:
    file = tmp_path / "spill.toml"
    file.write_text(text, encoding="utf-8")
    return case_file.load(file)


def environment(source: Source, coast: shoreline.Coast | None = None) -> Environment:
    forcing = (Sources({"current": (source,)}),)
    return Environment(BOX, forcing, forcing, (source,), coast, ())


@dataclass(frozen=True)
class Exact:
    """Means of x, y [m] and release [s], and standard deviations."""

    mean: np.ndarray
    std: np.ndarray


def exact(finds: tuple[tuple[int, float, float], ...], shared: bool = True) -> Exact:
    """Return the posterior by closed form: Gaussian in (x0, bias) given the release, which is
    summed over.

    dx = (-k (x - hub) + b) dt + sqrt(2 D) dW. shared: finds have the same b; otherwise each has its
    own.
    """
    times = (np.arange(2000) + 0.5) * WINDOW / 2000
    log_weight, moments = np.zeros(times.size), np.zeros((2, 2, times.size))  # axis; mean, variance
    for axis in range(2):
        for n, t in enumerate(times):
            age = np.array([seen - t for seen, _, _ in finds])
            if (age <= 0).any():
                log_weight[n] = -np.inf
                continue
            keep = np.exp(-CONVERGENCE * age)
            drawn = np.array([seen[1 + axis] for seen in finds])
            gain = (1 - keep) / CONVERGENCE
            noise = DIFFUSIVITY * (1 - keep**2) / CONVERGENCE + RADIUS**2 + (keep * SCATTER) ** 2
            of_bias = BIAS**2 * (np.outer(gain, gain) if shared else np.diag(gain**2))
            covariance = SPREAD**2 * np.outer(keep, keep) + of_bias + np.diag(noise)
            apart = drawn - HUB[axis] * (1 - keep)
            log_weight[n] += stats.multivariate_normal.logpdf(
                apart, np.zeros(len(finds)), covariance
            )
            pull = np.linalg.solve(covariance, SPREAD**2 * keep)
            moments[axis, :, n] = pull @ apart, SPREAD**2 - pull @ (SPREAD**2 * keep)
    share = np.exp(log_weight - log_weight.max())
    share /= share.sum()
    place = (moments[:, 0] * share).sum(1)
    variance = ((moments[:, 1] + moments[:, 0] ** 2) * share).sum(1) - place**2
    time = (times * share).sum()
    spread = np.sqrt([*variance, ((times - time) ** 2 * share).sum()])
    return Exact(np.array([*place, time]), spread)


def figures(found: backward.Origin) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return mean (x, y [m], release [s after start]), its standard error, and standard deviations."""
    mean = np.array([found.mean[0] * DEGREE, found.mean[1] * DEGREE, found.mean[2] - T0])
    return mean, np.array(found.error), np.array(found.std)


RUN = {"worlds": 500, "per_find": 60, "cells": 40, "times": 12}


def origin(
    case: Case, where: Environment, cut: Segments | None, stretch: list[int], **fine: int
) -> backward.Origin:
    """Return where a case's spill may have come from; fine: the resolution."""
    assert case.spill is not None
    spec, clock = run_setup.ensemble_spec(case), run_setup.clock_spec(case)
    return backward.estimate_origin(
        case.spill, spec, clock, where, cut, stretch, backward.Resolution(**fine)
    )
