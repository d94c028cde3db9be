"""The order of the integrator is measured, on flows whose tracks are known."""

import numpy as np
import pytest
from flows import FLOWS, Flow

from drift.engine.motion.models.drift import COLUMNS
from drift.engine.particles import ensemble as record
from geo import sphere
from geo.grids.grid import Grid
from kernels.step import advance as kernel
from kernels.step.sample import Tiles

EVERYWHERE = kernel.Domain(-(2**31), -(2**30), 2**32 - 1, 2**31)


def end_of(
    flow: Flow, scheme: str, step: int, direction: int = 1, start=None
) -> tuple[np.ndarray, np.ndarray]:
    """Return where the kernel leads (lon, lat) [rad]."""
    lon, lat = start or (sphere.to_binary(flow.lon), sphere.to_binary(flow.lat))
    ensemble = record.empty(1, (0, lon.size), COLUMNS)
    ensemble.lon.from_numpy(lon)
    ensemble.lat.from_numpy(lat)
    tiles = Tiles([Grid(0, 0, 1, 1, 2, 2)])
    for k in range(flow.duration // step):
        t = k * step if direction > 0 else flow.duration - k * step
        tiles.blend([(t, t + direction * step)])
        clock = kernel.Step(k, k * step, step, direction)
        none: dict[str, tuple[int, int]] = {}
        slots = (0, lon.size, 0)
        kernel.advance(
            ensemble,
            slots,
            tiles,
            none,
            kernel.Physics(),
            clock,
            kernel.Surroundings(EVERYWHERE, scheme=scheme),
            flow.velocity,
        )
    return ensemble.lon.to_numpy(), ensemble.lat.to_numpy()


def errors(flow: Flow, scheme: str) -> np.ndarray:
    start = np.radians(flow.lon), np.radians(flow.lat)
    exact = flow.exact(*start, flow.duration)
    result = []
    for step in flow.steps[scheme]:
        lon, lat = end_of(flow, scheme, step)
        result.append(sphere.distance(lon * sphere.UNIT, lat * sphere.UNIT, *exact).max())
    return np.array(result)


@pytest.mark.parametrize("flow", FLOWS, ids=lambda f: f.name)
@pytest.mark.parametrize(("scheme", "order"), [("rk4", 4), ("rk2", 2)])
def test_order(flow: Flow, scheme: str, order: int) -> None:
    """Slope of log error over log step: at least the declared order less 0.3 (a flow may be kinder:
    inertial is).
    """
    found = errors(flow, scheme)
    slope = np.polyfit(np.log(flow.steps[scheme]), np.log(found), 1)[0]
    print(flow.name, scheme, found, slope)
    assert slope > order - 0.3


@pytest.mark.parametrize("flow", FLOWS, ids=lambda f: f.name)
def test_there_and_back(flow: Flow) -> None:
    """A backward run is the same code with a negative step: it returns within the error and the
    rounding.
    """
    step = flow.steps["rk4"][-1] // 4
    there = end_of(flow, "rk4", step)
    lon, lat = end_of(flow, "rk4", step, -1, there)
    start = np.radians(flow.lon), np.radians(flow.lat)
    assert sphere.distance(lon * sphere.UNIT, lat * sphere.UNIT, *start).max() < 5.0
