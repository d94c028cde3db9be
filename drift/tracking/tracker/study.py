"""A tracking case: its target, tracker, sensors and ways of following, and its worlds."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from drift.tracking.tracker import following, sweeps
from drift.tracking.tracker.detections import Detections
from drift.tracking.tracker.following import World
from drift.tracking.tracker.path import Path
from drift.tracking.tracker.pursuit import Pursuit
from drift.tracking.tracker.records import Behaviour, Plan, Sensor, Tracker
from geo.array import Array
from kernels.step.coast import DeviceCoast


@dataclass(frozen=True)
class Criteria:
    """Largest errors of an estimate for the target to count as found."""

    position: float  # [m]
    course: float  # [rad]
    speed: float  # [m/s]


@dataclass(frozen=True)
class Scene:
    """The true target; if it acts, each run draws its own path."""

    way: Path
    radiates: Plan | None = None
    interval: float = 1.2  # [s] of its radar's sweeps
    acts: Behaviour | None = None  # it begins as `way` does, and then acts


@dataclass(frozen=True)
class Study:
    """A tracking case."""

    name: str  # of the case file
    text: str  # of the case file, with changed values
    title: str
    start: np.datetime64
    end: float  # [s] after the start
    every: float  # [s] between times at which figures are taken
    size: int  # particles of a cloud
    seed: int
    runs: int
    tracker: Path
    target: Scene | Detections  # the true target of an experiment, or recorded detections
    sensors: tuple[Sensor, ...]
    methods: tuple[Tracker, ...]  # ways of following
    window: tuple[float, float] = (0.0, np.inf)  # [s] over which figures are averaged
    criteria: Criteria | None = None
    # shares of the probability whose areas are tested for containing the target
    areas: tuple[float, ...] = ()
    shown: tuple[float, ...] = ()  # [s] when the cloud is drawn and its areas are reported
    # with detections only: a path to meet the target, or to avoid it
    pursuit: Pursuit | None = None
    # published values by way of following and figure
    published: dict[str, dict[str, float]] = field(default_factory=dict)
    minds_land: bool = True  # whether particles avoid land
    # whether `tracker` is a recorded log or track, not a planned path
    logged: bool = False
    files: tuple[str, ...] = ()  # files that were read


AFTER = 0.5  # [s]
MET, HELD = "time to criteria", "track held"  # figures of a run
CARRIED = "carried position error"  # of the last detection's estimate, carried forward


def figures(areas: Sequence[float], criteria: bool) -> list[str]:
    """Return the names of the figures of each run.

    Args:
        areas: shares of the probability whose areas are evaluated.
        criteria: whether the time to criteria is a figure.
    """
    area_names = [in_area(share) for share in areas]
    return [
        *(f"{what} error" for what in ("position", "course", "speed")),
        HELD,
        CARRIED,
        *area_names,
        *([MET] if criteria else []),
    ]


def in_area(share: float) -> str:
    """Return the name of the figure of how often the area of a share contains the target."""
    return f"in {100 * share:g} % area"


def marks(study: Study) -> Array:
    """Return the times at which figures are taken [s]."""
    return np.round(study.every * np.arange(1, int(study.end / study.every + 1e-9) + 1), 6)


def worlds(study: Study, shore: DeviceCoast | None = None) -> tuple[list[World], list[Path]]:
    """Return the worlds of all runs, and the target's path in each.

    All are the same if the target does not act.

    Args:
        study: the tracking case.
        shore: coast that an acting target avoids; None: no coast.
    """
    scene = study.target
    assert isinstance(scene, Scene)
    times = _times(study, scene)
    if scene.acts is None:
        ways = [scene.way]
    else:
        # Add a moment after each mark. Otherwise the course at a mark would be that to the next
        # sweep, including acts in between.
        moments = np.unique(
            np.round(np.concatenate([marks(study), marks(study) + AFTER, *times]), 6)
        )
        ways = following.wanders(
            scene.way, scene.acts, study.tracker, moments, study.runs, study.seed, shore
        )
    made = [_world(study, way, times) for way in ways]
    return (made, ways) if len(ways) == study.runs else (made * study.runs, ways * study.runs)


def _times(study: Study, scene: Scene) -> list[Array]:
    """Return the times of each sensor's sweeps [s]."""
    emissions = sweeps.emitted(scene.radiates, scene.interval, study.end)
    return [sweeps.times(sensor, study.end, emissions) for sensor in study.sensors]


def _world(study: Study, target: Path, times: list[Array]) -> World:
    """Return the world of one run."""
    parts = [
        sweeps.of_sensor(sensor, moments, study.tracker, target.at(moments)[0])
        for sensor, moments in zip(study.sensors, times, strict=True)
    ]
    record_detections = study.criteria is not None
    return World(
        study.tracker,
        sweeps.ordered([*parts, sweeps.marks(marks(study), target)], record_detections),
    )
