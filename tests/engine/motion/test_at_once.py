"""Steps that one launch makes together end as they do one by one, to the bit."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import drift
from drift.engine.motion import scene, simulate
from drift.engine.motion.clock import Clock
from drift.engine.motion.forcing import Forcing, Sources
from drift.engine.motion.models.drift import COLUMNS, DRIFT, LEEWAY
from drift.engine.motion.models.model import Motion
from drift.engine.motion.scene import Scene
from drift.engine.particles import ensemble as record
from drift.engine.particles.ensemble import Ensemble
from drift.engine.particles.status import Status
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast.shore import Shore
from geo.forcing import sources
from kernels.runtime import runtime
from kernels.step import advance as kernel
from kernels.step import coast as device_coast

EVERYWHERE = kernel.Domain(-(2**31), -(2**30), 2**32 - 1, 2**31)
START, STEP, N = 1_000_300, 600, 1003
PHYSICS = kernel.Physics(0.21, 17_000.0, 1.3, 23_000.0, 31.0, 2.3e-5)
OUTPUTS = (4100, 9_300, 30_000)


def particles() -> Ensemble:
    """Return particles to the west of an island, with leeway, releases and times of sinking of
    their own.
    """
    random, ensemble = np.random.default_rng(5), record.empty(77, (0, N), COLUMNS)
    own = {name: random.uniform(0.003, 0.06, N) for name in LEEWAY}
    own |= {"lon": random.uniform(-7e6, -5.4e6, N), "lat": random.uniform(1.1e6, 3.6e6, N)}
    own |= {"side": random.choice([-1, 1], N), "release": random.integers(-500, 5000, N)}
    own["sink_time"] = random.integers(0, 90_000, N)
    for name, values in own.items():
        column = ensemble.columns[name]
        column.from_numpy(values.astype(column.to_numpy().dtype))
    return ensemble


def world(direction: int, place: dict[str, Any]) -> Scene:
    """Return winds and currents that turn every few steps, before an island."""
    rows = np.datetime64(START - 40_000, "s") + 2700 * np.arange(40).astype("timedelta64[s]")
    k = np.arange(40)
    seas = {
        "current": (
            sources.uniform_field(
                "current", rows, 0.4 * np.cos(k), 0.3 * np.sin(0.7 * k), name="c"
            ),
        ),
        "wind": (sources.constant_field("wind", direction * 6.1, direction * 4.7),),
    }
    island = shapely.Polygon([(-0.44, 0.1), (-0.25, 0.12), (-0.27, 0.31), (-0.42, 0.37)])
    land = Shore(np.array([island], object), "test", (), Box(-1.5, -1.5, 1.5, 1.5))
    coast = device_coast.upload(shoreline.build_coast(land, Box(-1.2, -1, 1, 1)))
    return Scene(
        Forcing([Sources(seas)], direction),
        (Motion(DRIFT, PHYSICS),),
        kernel.Surroundings(EVERYWHERE, coast, **place),
    )


def moved(direction: int, place: dict[str, Any]) -> tuple[dict[str, np.ndarray], int]:
    """Return all that a run leaves, by name, and how often it advanced its particles."""
    ensemble, surroundings = particles(), world(direction, place)
    counts: list[int] = []
    advance = Scene.advance

    def counted(*args: Any, **more: Any) -> Any:
        counts.append(more.get("count", 1))
        return advance(*args, **more)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Scene, "advance", counted)
        # not between slices: the parts of that step are made by themselves
        cut = START + direction * 7250
        clock = Clock(START, OUTPUTS[-1], direction, STEP, breaks=(cut,))
        moments = list(simulate.run(ensemble, surroundings, clock, np.array(OUTPUTS)))
    surroundings.forcing.close()
    assert sum(counts) == len(list(clock.steps()))
    left = {name: column.to_numpy() for name, column in ensemble.columns.items()}
    for k, moment in enumerate(moments):
        left |= {f"{name} {k}": getattr(moment, name) for name in ("lon", "lat", "status")}
    return left, len(counts)


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize(
    "place",
    [
        pytest.param({}, marks=pytest.mark.thorough),
        {
            "beach": kernel.Beach(5000.0, 100.0),
            "sinks": True,
            "divergence": True,
            "scheme": "midpoint",
        },
        {"beach": kernel.Beach(slides=True)},
    ],
    ids=["stays for good", "refloats", "slides"],
)
def test_steps_made_together_end_as_one_by_one(
    place: dict[str, Any], direction: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    runtime.start()
    together, few = moved(direction, place)
    monkeypatch.setattr(scene, "AT_ONCE", 1)
    alone, many = moved(direction, place)
    assert few < 0.6 * many
    slides = place.get("beach", kernel.Beach()).slides
    assert slides or 0.02 < (alone["status"] == Status.ASHORE).mean() < 0.95
    for name, values in alone.items():
        assert np.array_equal(values, together[name], equal_nan=True), name


CASE = """
start = "2026-11-21T00:00Z"
duration = "12 h"
particles = 3000
seed = 5
output.every = "6 h"
clock.step = "15 min"
resampling = { below = 0.9 }
[coast]
source = "none"
[[current]]
constant = { speed = "0.4 kn", toward = 70 }
[[wind]]
constant = { speed = "8 m/s", from = 260 }
[uncertainty]
diffusivity = "10 m2/s"
current = { std = "0.1 m/s", time = "6 h", bias = "0.05 m/s" }
wind = { std = "1.1 m/s", time = "9 h" }
[[scenario]]
name = "a"
object = { windage = "3 %" }
position = { at = [-0.03, 0.02], std = ["2000 m", "800 m"], orientation = 30 }
"""
SEEN = """
[[contact]]
name = "strobe"
time = "+3.1 h"
position = { at = [0.03, 0.03], std = "3000 m" }
"""
FOUND = """
[[contact]]
name = "oar"
time = "+6.1 h"
of = { windage = "4 %" }
position = { at = [0.11, 0.05], std = "200 m" }
"""


@pytest.mark.parametrize(
    "contact",
    [
        pytest.param(SEEN, id="a sighting"),
        pytest.param(FOUND, id="debris that guides particles", marks=pytest.mark.thorough),
    ],
)
def test_a_search_is_not_asked_while_nothing_happens(
    contact: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its updates, copies and particles are those of a run that asks it about every step."""
    (tmp_path / "case.toml").write_text(CASE + contact)
    case = drift.load(tmp_path / "case.toml")
    asked: list[object] = []
    together = drift.run(case)
    monkeypatch.setattr(scene, "AT_ONCE", 1)
    monkeypatch.setattr(
        "drift.evidence.filter.filter.SearchFilter.rests", lambda own, step: asked.append(step)
    )
    alone = drift.run(case)
    assert len(asked) == 48
    assert together.particles.equals(alone.particles)
    assert together.updates is not None
    assert alone.updates is not None
    for one, other in zip(together.updates.all, alone.updates.all, strict=True):
        np.testing.assert_equal((one.name, one.posterior), (other.name, other.posterior))
        assert one.resampled
        assert one.ess_resampled == other.ess_resampled
    for name in ("mean_lon", "containment_area", "effective_particles"):
        assert together.forecast.data[name].equals(alone.forecast.data[name]), name
