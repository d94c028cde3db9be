"""One track by detections: the estimate at every time, and the cloud at some."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drift.tracker import detections, path, study
from drift.tracker.detections import Detections
from drift.tracker.following import Clouds, Particles, World
from drift.tracker.path import Path
from drift.tracker.pursuit import Forecast
from drift.tracker.study import Study
from drift.tracker.sweeps import Sweeps
from geo import sphere
from geo.array import Array
from kernels.coast import DeviceCoast

SOON = 1e-6  # [s] so that a sweep as a pursuit begins counts
SAME = 1.0  # [m] within which a pursuit begins where the tracker is


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


def hold(asked: Study, shore: DeviceCoast | None = None, tell: Callable[[float], None] = lambda share: None) -> Held:
    """Return the track by a case's detections, in its first way of following.

    shore: on whose land no particle is, None: anywhere; tell: takes the share that is done.
    """
    found = asked.target
    assert isinstance(found, Detections)
    shown = asked.shown or _shown(asked, found)
    moments = np.unique(np.concatenate([[0.0], study.marks(asked), [asked.end], shown]))
    told = detections.ordered(asked.sensors, found, asked.tracker, moments, _silent_until(asked))
    held = Clouds([World(asked.tracker, told)], asked.methods[:1], asked.size, asked.seed, shore=shore)
    clouds = []
    for number, time in enumerate(shown, 1):
        particles = held.go(time).particles(0, 0, time)
        clouds.append((time, particles if len(particles.weight) else None))
        tell(number / len(shown))
    fields = held.go().fields[0, 0]
    kept = told.row >= 0
    lost = np.unique(fields[:, 9])
    return Held(
        asked, told, told.time[kept], ~told.marked[kept], fields[:, :3], np.arctan2(fields[:, 3], fields[:, 4]),
        fields[:, 5] * sphere.RADIUS, fields[:, 6], tuple(clouds), tuple(lost[np.isfinite(lost)].tolist()),
    )  # fmt: skip


def onward(asked: Study, seed: int, shore: DeviceCoast | None = None) -> Forecast:
    """Return what tells where the cloud's particles go while the tracker pursues them.

    seed: of the cloud's random numbers; shore: on whose land no particle is.
    """
    found, chase = asked.target, asked.pursuit
    assert isinstance(found, Detections)
    assert chase is not None
    own = asked.tracker.at([chase.begin])[0][0]
    joins = path.arc(own, path.vector(*chase.start)) * sphere.RADIUS < SAME

    def forecast(way: Path) -> tuple[Array, Array]:
        known = asked.tracker.time < chase.begin - 1.0
        tracker = asked.tracker
        if joins:
            tracker = Path(np.append(tracker.time[known], way.time), np.vstack([tracker.place[known], way.place]))
        told = detections.ordered(asked.sensors, found, tracker, chase.times, chase.begin + SOON)
        held = Clouds([World(tracker, told)], asked.methods[:1], asked.size, seed, shore=shore)
        clouds = [held.go(time).particles(0, 0, time) for time in chase.times]
        return np.stack([cloud.place for cloud in clouds]), clouds[0].weight

    return forecast


def _silent_until(asked: Study) -> float:
    """Return until when silence counts [s].

    The looks of a pursuit are its own, where no log says where the tracker was meanwhile.
    """
    logged = asked.tracker.time[-1] < asked.end - 1.0
    return asked.end if asked.pursuit is None or logged else min(asked.end, asked.pursuit.begin + SOON)


def _shown(asked: Study, found: Detections) -> tuple[float, ...]:
    """Return the last detection, the end, and the middle between."""
    last = float(found.time[-1])
    return tuple(dict.fromkeys((last, (last + asked.end) / 2, asked.end)))
