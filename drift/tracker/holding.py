"""One track by detections: the estimate at every time, and the cloud at some."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drift.tracker import detections, study
from drift.tracker.detections import Detections
from drift.tracker.following import Clouds, Particles, World
from drift.tracker.study import Study
from drift.tracker.sweeps import Sweeps
from geo import sphere
from geo.array import Array


@dataclass(frozen=True)
class Held:
    """A track; columns (n,), at detections and at the case's times, NaN while none is held."""

    study: Study
    sweeps: Sweeps
    time: Array  # [s]
    detected: Array  # whether there was a detection
    place: Array  # unit vectors (n, 3)
    course: Array  # [rad] of the mean velocity
    speed: Array  # [m/s] mean of the particles' speeds
    count: Array  # particles
    clouds: tuple[tuple[float, Particles | None], ...]  # at the times shown [s]; None: no track is held
    lost: tuple[float, ...]  # [s] when the track was lost


def hold(asked: Study, tell: Callable[[float], None] = lambda share: None) -> Held:
    """Return the track by a case's detections, in its first way of following; tell: takes the share that is done."""
    found = asked.target
    assert isinstance(found, Detections)
    shown = asked.shown or _shown(asked, found)
    moments = np.unique(np.concatenate([[0.0], study.marks(asked), [asked.end], shown]))
    told = detections.ordered(asked.sensors, found, asked.tracker, moments, asked.end)
    held = Clouds([World(asked.tracker, told)], asked.methods[:1], asked.size, asked.seed)
    clouds = []
    for number, time in enumerate(shown, 1):
        particles = held.go(time).particles(0, 0, time)
        clouds.append((time, particles if len(particles.weight) else None))
        tell(number / len(shown))
    fields = held.go().fields[0, 0]
    kept = told.row >= 0
    gone = np.isnan(fields[:, 0])
    since = np.flatnonzero(gone[1:] & ~gone[:-1]) + 1
    return Held(
        asked, told, told.time[kept], ~told.marked[kept], fields[:, :3], np.arctan2(fields[:, 3], fields[:, 4]),
        fields[:, 5] * sphere.RADIUS, fields[:, 6], tuple(clouds), tuple(float(t) for t in told.time[kept][since]),
    )  # fmt: skip


def _shown(asked: Study, found: Detections) -> tuple[float, ...]:
    """Return the last detection, the end, and the middle between."""
    last = float(found.time[-1])
    return tuple(dict.fromkeys((last, (last + asked.end) / 2, asked.end)))
