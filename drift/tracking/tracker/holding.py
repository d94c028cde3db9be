"""One track by detections: the estimate and its areas at every time, and the cloud at some."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from drift.tracking.tracker import density, detections, path, study
from drift.tracking.tracker.density import Region
from drift.tracking.tracker.detections import Detections
from drift.tracking.tracker.following import Clouds, Particles, World
from drift.tracking.tracker.path import Path
from drift.tracking.tracker.pursuit import Forecast
from drift.tracking.tracker.records import Sensor
from drift.tracking.tracker.shore import Shoreline
from drift.tracking.tracker.study import Study
from drift.tracking.tracker.sweeps import Sweeps
from geo import sphere
from geo.array import Array
from kernels.step.coast import DeviceCoast

SOON = 1e-6  # [s] so that a sweep as a pursuit begins counts
SAME = 1.0  # [m] within which a pursuit begins where the tracker is
SHARES = (0.5, 0.9)  # of the probability, of the areas told
OTHERS = 9  # clouds beside the one that is told, of other random numbers


@dataclass(frozen=True)
class Loss:
    """When a track was lost, and to whose sweeps that found nothing; to none's where a detection
    was all on land.
    """

    time: float  # [s]
    sensors: tuple[Sensor, ...]


@dataclass(frozen=True)
class Shown:
    """The cloud at a time that is shown, and what OTHERS of other random numbers make of the same
    detections.
    """

    time: float  # [s]
    cloud: Particles | None  # None: no track is held
    # [m2] least and largest area of all clouds, by share
    sizes: Mapping[float, tuple[float, float]]
    within: Mapping[
        float, float
    ]  # share of the others that each area holds; of a cloud like them as much as of its own
    holding: int  # of the others that hold a track


@dataclass(frozen=True)
class Held:
    """A track; columns (n,), at the times of detections, of figures and those shown, NaN while none
    is held.
    """

    study: Study
    sweeps: Sweeps
    time: Array  # [s] ascending
    detected: Array  # whether there was a detection
    place: Array  # unit vectors (n, 3)
    course: Array  # [rad] of the mean velocity
    speed: Array  # [m/s] mean of the particles' speeds
    off: Array  # [rad] root mean square of what the particles' courses differ from that
    slower: Array  # [m/s] standard deviation of their speeds
    count: Array  # particles
    # share of the cloud that the plots of the last time left, before it was filled; NaN: none was
    # held
    left: Array
    drawn: Array  # whether it was drawn again from them, as too little was left of what was held
    # that hold each of SHARES; none while no track is held
    areas: tuple[Mapping[float, Region], ...]
    shown: tuple[Shown, ...]
    lost: tuple[Loss, ...]

    def row(self, time: float) -> int:
        """Return the row of a time [s]."""
        return int(np.searchsorted(self.time, time))

    @property
    def anew(self) -> Array:
        """Whether plots had a cloud drawn again that knew of a course by two plots or more (n,)."""
        rows = np.flatnonzero(self.detected)
        found = np.zeros(len(self.time), bool)
        found[rows[1:]] = (
            self.drawn[rows[1:]]
            & ~np.isnan(self.left[rows[:-1]])
            & ~np.isnan(self.place[rows[1:], 0])
        )
        return found

    @cached_property
    def within(self) -> Array:
        """Return the share of the smallest area that the estimate lies in (n,);

        NaN: in none, as the mean of a ring does.
        """
        found = np.full(len(self.time), np.nan)
        for k, regions in enumerate(self.areas):
            around = [
                share
                for share, region in regions.items()
                if density.holds(region, self.place[k : k + 1])[0]
            ]
            found[k] = min(around, default=np.nan)
        return found


def hold(
    asked: Study, shore: Shoreline | None = None, tell: Callable[[float], None] = lambda share: None
) -> Held:
    """Return the track by a case's detections, in its first way of following.

    shore: on whose land no particle is, None: anywhere; tell: takes the share that is done.
    """
    found = asked.target
    assert isinstance(found, Detections)
    shown = asked.shown or _usual(asked, found)
    moments = np.unique(np.concatenate([[0.0], study.marks(asked), [asked.end], shown, found.time]))
    until = _silent_until(asked)
    told = detections.ordered(asked.sensors, found, asked.tracker, moments, until)
    worlds = [World(asked.tracker, told)] * (1 + OTHERS)
    coast, dry = (None, None) if shore is None else (shore.device, shore.dry)
    held = Clouds(worlds, asked.methods[:1], asked.size, asked.seed, shore=coast)
    areas, clouds, spreads = [], [], []
    for number, time in enumerate(moments, 1):
        own, *others = held.go(time).clouds(time)
        areas.append(_areas(own, dry))
        spreads.append(_spread(own))
        if time in shown:
            clouds.append(_shown(float(time), own, areas[-1], others, dry))
        tell(number / len(moments))
    fields = held.go().fields[0, 0]
    off, slower = np.array(spreads).T
    left = np.where(fields[:, 10] < 0, np.nan, fields[:, 10])
    return Held(
        asked,
        told,
        moments,
        np.isin(moments, found.time),
        fields[:, :3],
        np.arctan2(fields[:, 3], fields[:, 4]),
        fields[:, 5] * sphere.RADIUS,
        off,
        slower,
        fields[:, 6],
        left,
        fields[:, 11] > 0,
        tuple(areas),
        tuple(clouds),
        _losses(asked, found, fields[:, 9], until),
    )


def _areas(cloud: Particles, dry: Callable[[Array, Array], Array] | None) -> Mapping[float, Region]:
    """Return the areas that hold each of SHARES; none of a cloud without particles."""
    if not len(cloud.weight):
        return {}
    return density.areas(density.surface(cloud.place, cloud.weight, dry), SHARES)


def _spread(cloud: Particles) -> tuple[float, float]:
    """Return the root mean square of what courses differ from that of the mean velocity [rad], and
    the standard deviation of speeds [m/s].
    """
    w = cloud.weight
    if not len(w):
        return np.nan, np.nan
    course = path.course(w @ cloud.place, w @ cloud.velocity)
    off = sphere.wrap(path.course(cloud.place, cloud.velocity) - course)
    speed = np.linalg.norm(cloud.velocity, axis=1) * sphere.RADIUS
    return float(np.sqrt(w @ off**2)), float(np.sqrt(w @ (speed - w @ speed) ** 2))


def _shown(
    time: float,
    own: Particles,
    areas: Mapping[float, Region],
    others: Sequence[Particles],
    dry: Callable[[Array, Array], Array] | None,
) -> Shown:
    """Return a cloud and its areas beside those of others."""
    others = [cloud for cloud in others if len(cloud.weight)]
    each = [regions for regions in (areas, *(_areas(cloud, dry) for cloud in others)) if regions]
    sizes = {share: [regions[share].area for regions in each] for share in SHARES} if each else {}
    within = {
        share: np.mean([cloud.weight[density.holds(region, cloud.place)].sum() for cloud in others])
        for share, region in areas.items()
        if others
    }
    return Shown(
        time,
        own if areas else None,
        {share: (min(size), max(size)) for share, size in sizes.items()},
        within,
        len(others),
    )


def _losses(asked: Study, found: Detections, time: Array, until: float) -> tuple[Loss, ...]:
    """Return when a track was lost; time: when it was lost last, at each row [s]; until: when
    silence counts [s].
    """
    silent = detections.silences(asked.sensors, found, asked.tracker, until)
    told = []
    for lost in np.unique(time[np.isfinite(time)]):
        who = tuple(
            sensor for sensor, times in zip(asked.sensors, silent, strict=True) if lost in times
        )
        told.append(Loss(float(lost), who))
    return tuple(told)


def pursues(asked: Study) -> bool:
    """Return whether the tracker itself goes the path that is asked for, and no other vessel."""
    chase = asked.pursuit
    if chase is None:
        return False
    own = asked.tracker.at([chase.begin])[0][0]
    return bool(path.arc(own, path.vector(*chase.start)) * sphere.RADIUS < SAME)


def onward(asked: Study, seed: int, shore: DeviceCoast | None = None) -> Forecast:
    """Return what tells where the cloud's particles go while the tracker pursues them.

    seed: of the cloud's random numbers; shore: on whose land no particle is.
    """
    found, chase = asked.target, asked.pursuit
    assert isinstance(found, Detections)
    assert chase is not None
    joins = pursues(asked)

    def forecast(way: Path) -> tuple[Array, Array]:
        known = asked.tracker.time < chase.begin - 1.0
        tracker = asked.tracker
        if joins:
            tracker = Path(
                np.append(tracker.time[known], way.time),
                np.vstack([tracker.place[known], way.place]),
            )
        told = detections.ordered(asked.sensors, found, tracker, chase.times, chase.begin + SOON)
        held = Clouds([World(tracker, told)], asked.methods[:1], asked.size, seed, shore=shore)
        clouds = [held.go(time).particles(0, 0, time) for time in chase.times]
        return np.stack([cloud.place for cloud in clouds]), clouds[0].weight

    return forecast


def _silent_until(asked: Study) -> float:
    """Return until when silence counts [s].

    The looks of a pursuit are its own, where no log says where the tracker was meanwhile.
    """
    return (
        asked.end
        if asked.pursuit is None or asked.logged
        else min(asked.end, asked.pursuit.begin + SOON)
    )


def _usual(asked: Study, found: Detections) -> tuple[float, ...]:
    """Return the last detection, the end, and the middle between."""
    last = float(found.time[-1])
    return tuple(dict.fromkeys((last, (last + asked.end) / 2, asked.end)))
