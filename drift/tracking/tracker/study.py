"""What a tracking case asks: who is followed by whom, in which ways, and its worlds."""

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
    """How near an estimate must be for the target to count as found."""

    position: float  # [m]
    course: float  # [rad]
    speed: float  # [m/s]


@dataclass(frozen=True)
class Scene:
    """The target as it is, or begins; where it acts, each run draws its way."""

    way: Path
    radiates: Plan | None = None
    interval: float = 1.2  # [s] of its radar's sweeps
    acts: Behaviour | None = None  # it begins as `way` does, and then acts


@dataclass(frozen=True)
class Study:
    """A tracking case."""

    name: str  # of its file
    text: str  # the file, with what was changed in it
    title: str
    start: np.datetime64
    end: float  # [s] after the start
    every: float  # [s] between times at which figures are taken
    size: int  # particles of a cloud
    seed: int
    runs: int
    tracker: Path
    target: Scene | Detections  # as it is, or what was detected of it
    sensors: tuple[Sensor, ...]
    methods: tuple[Tracker, ...]  # ways of following
    window: tuple[float, float] = (0.0, np.inf)  # [s] over which figures are averaged
    criteria: Criteria | None = None
    # shares of the probability whose areas are asked whether they hold the target
    areas: tuple[float, ...] = ()
    shown: tuple[float, ...] = ()  # [s] when the cloud is drawn and its areas are told
    # of detections: a path on which to meet the target, or to avoid it
    pursuit: Pursuit | None = None
    # by way of following and figure
    published: dict[str, dict[str, float]] = field(default_factory=dict)
    minds_land: bool = True  # whether particles keep to the water
    # whether `tracker` is where a log or a track says it was, not where it is said to go
    logged: bool = False
    files: tuple[str, ...] = ()  # that were read


AFTER = 0.5  # [s]
MET, HELD = "time to criteria", "track held"  # figures of a run


def figures(areas: Sequence[float], criteria: bool) -> list[str]:
    """Return the names of what is taken of each run; areas: shares, criteria: whether a time to
    them is asked for.
    """
    held = [in_area(share) for share in areas]
    return [
        *(f"{what} error" for what in ("position", "course", "speed")),
        HELD,
        *held,
        *([MET] if criteria else []),
    ]


def in_area(share: float) -> str:
    """Return what it is called how often the area of a share holds the target."""
    return f"in {100 * share:g} % area"


def marks(study: Study) -> Array:
    """Return the times at which figures are taken [s]."""
    return np.round(study.every * np.arange(1, int(study.end / study.every + 1e-9) + 1), 6)


def worlds(study: Study, shore: DeviceCoast | None = None) -> tuple[list[World], list[Path]]:
    """Return the worlds of all runs, and the target's way in each; where it does not act, all are
    one.

    shore: off which a target keeps that acts.
    """
    scene = study.target
    assert isinstance(scene, Scene)
    times = _times(study, scene)
    if scene.acts is None:
        ways = [scene.way]
    else:
        # A moment after each mark, too: else its course there would be the way to the next sweep,
        # acts and all.
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
    parts = [
        sweeps.of_sensor(sensor, moments, study.tracker, target.at(moments)[0])
        for sensor, moments in zip(study.sensors, times, strict=True)
    ]
    told = study.criteria is not None
    return World(study.tracker, sweeps.ordered([*parts, sweeps.marks(marks(study), target)], told))
