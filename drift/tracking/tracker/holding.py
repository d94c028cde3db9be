"""One track by detections: estimate and areas at every time, and the cloud at some times."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from drift.tracking.tracker import density, detections, following, path, study
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

SOON = 1e-6  # [s] margin, so that a sweep at the begin of a pursuit counts
SAME = 1.0  # [m] largest distance of a pursuit's begin from the tracker that pursues
SHARES = (0.5, 0.9)  # of the probability, for the reported areas
OTHERS = 9  # further clouds with other random numbers, for comparison


@dataclass(frozen=True)
class Loss:
    """Loss of a track.

    sensors: those whose silence caused it; () if a detection's box was entirely on land.
    """

    time: float  # [s]
    sensors: tuple[Sensor, ...]


@dataclass(frozen=True)
class Shown:
    """The cloud at an output time, and a comparison with OTHERS of other random numbers."""

    time: float  # [s]
    cloud: Particles | None  # None: no track is held
    # [m2] least and largest area of all clouds, by share
    sizes: Mapping[float, tuple[float, float]]
    within: Mapping[float, float]  # mean share of the other clouds that each area contains
    holding: int  # number of other clouds that hold a track


@dataclass(frozen=True)
class Held:
    """A track; columns (n,) at the times of detections, figures and outputs.

    Values are NaN while no track is held.
    """

    study: Study
    sweeps: Sweeps
    time: Array  # [s] ascending
    detected: Array  # whether there was a detection
    place: Array  # unit vectors (n, 3)
    course: Array  # [rad] of the mean velocity
    speed: Array  # [m/s] mean of the particles' speeds
    off: Array  # [rad] root mean square deviation of the particles' courses from `course`
    slower: Array  # [m/s] standard deviation of the particles' speeds
    count: Array  # particles
    # share of the cloud left by the last plots, before it was refilled; NaN: no cloud was held
    left: Array
    drawn: Array  # whether the cloud was repopulated from these plots because too little was left
    # unit vectors (n, 3): the estimate at the last detection, moved on at its mean velocity; NaN
    # before the first
    carried: Array
    # area that contains each of SHARES; {} while no track is held
    areas: tuple[Mapping[float, Region], ...]
    shown: tuple[Shown, ...]
    lost: tuple[Loss, ...]

    def row(self, time: float) -> int:
        """Return the row of a time [s]."""
        return int(np.searchsorted(self.time, time))

    @property
    def anew(self) -> Array:
        """Whether plots repopulated a cloud that had a course from two plots or more, (n,)."""
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
        """Share of the smallest area that contains the estimate, (n,).

        NaN if none does, as for the mean of a ring.
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
    """Return the track by a case's detections, with its first way of following.

    Args:
        asked: the tracking case.
        shore: coast that particles avoid; None: no coast.
        tell: callback that receives the progress, 0 to 1.
    """
    found = asked.target
    assert isinstance(found, Detections)
    shown = asked.shown or _usual(asked, found)
    moments = np.unique(np.concatenate([[0.0], study.marks(asked), [asked.end], shown, found.time]))
    until = _silent_until(asked)
    sweeps = detections.ordered(asked.sensors, found, asked.tracker, moments, until)
    worlds = [World(asked.tracker, sweeps)] * (1 + OTHERS)
    coast, dry = (None, None) if shore is None else (shore.device, shore.dry)
    filters = Clouds(worlds, asked.methods[:1], asked.size, asked.seed, shore=coast)
    areas, clouds, spreads = [], [], []
    for number, time in enumerate(moments, 1):
        own, *others = filters.go(time).clouds(time)
        areas.append(_areas(own, dry))
        spreads.append(_spread(own))
        if time in shown:
            clouds.append(_shown(float(time), own, areas[-1], others, dry))
        tell(number / len(moments))
    fields = filters.go().fields[0, 0]
    off, slower = np.array(spreads).T
    left = np.where(fields[:, 10] < 0, np.nan, fields[:, 10])
    return Held(
        asked,
        sweeps,
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
        following.carry_forward(fields[:, 12:], moments),
        tuple(areas),
        tuple(clouds),
        _losses(asked, found, fields[:, 9], until),
    )


def _areas(cloud: Particles, dry: Callable[[Array, Array], Array] | None) -> Mapping[float, Region]:
    """Return the areas that contain each of SHARES; {} for a cloud without particles."""
    if not len(cloud.weight):
        return {}
    return density.areas(density.surface(cloud.place, cloud.weight, dry), SHARES)


def _spread(cloud: Particles) -> tuple[float, float]:
    """Return the root mean square deviation of courses [rad], and that of speeds [m/s]."""
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
    """Return a cloud and its areas, compared with other clouds."""
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
    """Return the losses of a track.

    time: last loss at each row [s]; until: end of the sweeps whose silence counts [s].
    """
    silent = detections.silences(asked.sensors, found, asked.tracker, until)
    losses = []
    for lost in np.unique(time[np.isfinite(time)]):
        silent_sensors = tuple(
            sensor for sensor, times in zip(asked.sensors, silent, strict=True) if lost in times
        )
        losses.append(Loss(float(lost), silent_sensors))
    return tuple(losses)


def pursues(asked: Study) -> bool:
    """Return True if the tracker itself follows the pursuit's path, not another vessel."""
    chase = asked.pursuit
    if chase is None:
        return False
    own = asked.tracker.at([chase.begin])[0][0]
    return bool(path.arc(own, path.vector(*chase.start)) * sphere.RADIUS < SAME)


def onward(asked: Study, seed: int, shore: DeviceCoast | None = None) -> Forecast:
    """Return a function that forecasts the cloud's particles while the tracker pursues them.

    Args:
        asked: the tracking case.
        seed: of the cloud's random numbers.
        shore: coast that particles avoid; None: no coast.
    """
    found, chase = asked.target, asked.pursuit
    assert isinstance(found, Detections)
    assert chase is not None
    joins = pursues(asked)

    def forecast(way: Path) -> tuple[Array, Array]:
        """Return positions at each step and weights for a path of the tracker."""
        known = asked.tracker.time < chase.begin - 1.0
        tracker = asked.tracker
        if joins:
            tracker = Path(
                np.append(tracker.time[known], way.time),
                np.vstack([tracker.place[known], way.place]),
            )
        sweeps = detections.ordered(asked.sensors, found, tracker, chase.times, chase.begin + SOON)
        filters = Clouds([World(tracker, sweeps)], asked.methods[:1], asked.size, seed, shore=shore)
        clouds = [filters.go(time).particles(0, 0, time) for time in chase.times]
        return np.stack([cloud.place for cloud in clouds]), clouds[0].weight

    return forecast


def _silent_until(asked: Study) -> float:
    """Return until when silence counts [s].

    After the begin of a pursuit its own looks count, unless a log gives the tracker's position.
    """
    return (
        asked.end
        if asked.pursuit is None or asked.logged
        else min(asked.end, asked.pursuit.begin + SOON)
    )


def _usual(asked: Study, found: Detections) -> tuple[float, ...]:
    """Return the default output times: last detection, end, and the middle between."""
    last = float(found.time[-1])
    return tuple(dict.fromkeys((last, (last + asked.end) / 2, asked.end)))
