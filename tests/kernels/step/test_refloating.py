"""Refloating: half-lives, the drift off a beach, object and debris. Closed forms."""

from pathlib import Path

import numpy as np
import pytest
import trial_case
from straight_shores import EVERYWHERE, METRE, T0, drift_on, jagged, land

import drift
from drift.engine.motion import simulate
from drift.engine.motion.clock import Clock
from drift.engine.motion.forcing import Forcing, Sources
from drift.engine.motion.models.drift import COLUMNS, DRIFT
from drift.engine.motion.models.model import Motion
from drift.engine.motion.scene import Scene
from drift.engine.particles import ensemble as record
from drift.engine.particles.status import Status
from geo import sphere
from geo.forcing import sources
from kernels.step import advance as kernel
from kernels.step import coast as device_coast


@pytest.mark.thorough
@pytest.mark.parametrize("step", [900, 1800, 3600])
def test_refloating_has_its_half_life_and_waits_for_a_drift_off_the_beach(step: int) -> None:
    n, half = 20_000, 6 * 3600
    beach = kernel.Beach(half / np.log(2), 100.0)
    shore = land(jagged(0.01))
    hours = np.arange(-1, 26)

    def drifted(after: float):
        times = (T0 + 3600 * hours).astype("datetime64[s]")
        east = np.where(hours <= 2, 0.1, after)
        ensemble = record.empty(3, (0, n), COLUMNS)
        ensemble.lon.fill(int(sphere.to_binary(-100 * METRE)))
        scene = Scene(
            Forcing(
                [Sources({"current": (sources.uniform_field("current", times, east, 0 * east),)})],
                1,
            ),
            (Motion(DRIFT, kernel.Physics()),),
            kernel.Surroundings(EVERYWHERE, device_coast.upload(shore), beach),
        )
        outputs = np.array([7200, 36_000, 86_400])
        moments = list(simulate.run(ensemble, scene, Clock(T0, 86_400, 1, step), outputs))
        scene.forcing.close()
        return ensemble, [(m.status == Status.ASHORE).mean() for m in moments]

    # Onto the beach for two hours and a half (landing after 100 m / 0.1 m/s = 1000 s), then off it:
    # those whose wait is over leave at once, the others one by one.
    ensemble, ashore = drifted(-0.1)
    assert ashore[0] == 1
    for share, time in zip(ashore[1:], (36_000, 86_400), strict=True):
        expected = 0.5 ** ((time - 1000) / half)
        assert share == pytest.approx(expected, abs=4.5 * np.sqrt(expected / n))
    free = ensemble.status.to_numpy() == Status.ADRIFT
    assert (ensemble.lon.to_numpy()[free] * (360 / sphere.TURN) < -99 * METRE).all()
    # Always onto the beach: nobody leaves.
    assert drifted(0.1)[1] == [1, 1, 1]


@pytest.mark.thorough
def test_object_and_debris_land_and_refloat_each_by_its_own_chance() -> None:
    """From one place by walks of their own: who lands, when, and how long it stays there; noise in
    common would correlate.
    """
    n = 20_000
    landed, first, waits = [], [], []
    for debris in (0, 1, 2):
        beach = kernel.Beach(3600 / np.log(2), 100.0)
        walk = {"physics": kernel.Physics(diffusivity=60.0), "beach": beach, "debris": debris}
        one, _ = drift_on(
            land(jagged(0.004)), (0.0, 0.0), n, (-450 * METRE, 0.1), 1800, 1800, **walk
        )
        landed.append(one.status.to_numpy() == Status.ASHORE)
        first.append(one.status_since.to_numpy())

        def ashore(ensemble: record.Ensemble) -> None:
            """Let all have landed at the start, on the edge that the first one would meet."""
            ensemble.status.fill(int(Status.ASHORE))
            ensemble.edge.fill(int(one.edge.to_numpy()[landed[-1]][0]))  # noqa: B023 - called at once
            ensemble.lon.from_numpy(np.full(n, one.lon.to_numpy()[landed[-1]][0]))  # noqa: B023
            ensemble.lat.from_numpy(np.full(n, one.lat.to_numpy()[landed[-1]][0]))  # noqa: B023

        # nothing, by the kernel that is compiled already
        walk["physics"] = kernel.Physics(diffusivity=1e-9)
        back, _ = drift_on(
            land(jagged(0.004)), (-0.3, 0.0), n, (0.0, 0.1), 7200, 1800, prepare=ashore, **walk
        )
        waits.append(back.moving_since.to_numpy().astype(float))
    assert 0.1 < np.mean(landed) < 0.9
    assert np.abs(np.corrcoef(landed) - np.eye(3)).max() < 4.5 / np.sqrt(n)
    for a, b in ((0, 1), (0, 2), (1, 2)):
        both = landed[a] & landed[b]
        assert abs(np.corrcoef(first[a][both], first[b][both])[0, 1]) < 4.5 / np.sqrt(both.sum())
    assert 0.7 < np.mean(np.array(waits) > 0) < 0.8  # 2 h at a half-life of 1 h
    assert np.abs(np.corrcoef(waits) - np.eye(3)).max() < 4.5 / np.sqrt(n)


@pytest.mark.thorough
def test_half_of_refloating_under_diffusion_does_not_depend_on_the_step() -> None:
    """An offing of fixed length makes the chance of going ashore again exp(-u d / D), not a matter
    of the step.
    """
    found = []
    for step in (450, 3600):
        ensemble, _ = drift_on(
            land(jagged(0.01)),
            (-0.1, 0.0),
            20_000,
            (-50 * METRE, 0.1),
            172_800,
            step,
            physics=kernel.Physics(diffusivity=20.0),
            beach=kernel.Beach(10 * 3600 / np.log(2), 100.0),
        )
        found.append((ensemble.status.to_numpy() == Status.ASHORE).mean())
    print(found)
    assert np.ptp(found) < 2 * 4.5 * np.sqrt(0.1 / 20_000)


def test_a_half_life_is_the_time_after_which_half_is_afloat(tmp_path: Path) -> None:
    """From the case's words to what lies ashore: an even hazard whose half-life they state, so of
    mean half-life / ln 2.
    """
    n, half, hours = 20_000, 4.0, 10.0
    ebb = [{"time": f"+{h} h", "speed": "1 m/s", "toward": 90 if h < 2 else 270} for h in range(12)]
    coast = {"source": "land.geojson", "behaviour": "refloat", "half_life": f"{half:g} h"}
    (tmp_path / "land.geojson").write_text(
        '{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", '
        '"coordinates": [[[0, -2], [2, -2], [2, 2], [0, 2], [0, -2]]]}}]}'
    )
    case = trial_case.load(
        tmp_path,
        duration=f"{hours:g} h",
        particles=n,
        output={"every": "2 h"},
        clock={"step": "15 min"},
        coast=coast,
        current={"table": ebb},
        scenario={"position": {"at": [-0.01, 0.1], "std": "0 m"}},
    )
    probability = drift.run(case).forecast.data["status_probability"]
    ashore = [float(probability[k, Status.ASHORE]) for k in range(probability.sizes["time"])]
    landed = (
        0.01 / METRE / 3600
    )  # [h] at 1 m/s; the current leads off from 1.5 h on, and then all go whose wait is over
    for k in (1, 3, 5):
        exact = 0.5 ** ((2.0 * k - landed) / half)
        step = exact * np.log(2) / half * 0.25  # a wait ends with a step of a quarter of an hour
        assert abs(ashore[k] - exact) < 4.5 * np.sqrt(exact * (1 - exact) / n) + step
