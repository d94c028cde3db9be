"""A watch by a sensor of the case without a detection, and its effect on weights.

The sensor is a passive sonar or a table of POD. `Listening` has the interface of
drift.evidence.filter.exposure.SortieExposure, and replaces it for sorties with such a sensor.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from drift.engine.motion import scene
from drift.engine.motion.forcing import Forcing
from drift.engine.motion.scene import Begin
from drift.engine.motion.steering.steer import Helm
from drift.engine.particles.ensemble import Ensemble
from drift.evidence.filter.detection import sensor_path
from drift.evidence.filter.markers import Marker
from drift.evidence.filter.records import Sortie
from drift.evidence.sensors import pod_table, unknown
from drift.evidence.sensors.hearing import Receiver
from drift.evidence.sensors.records import PodGrid, Sonar
from geo import notation, sphere
from geo.array import Array
from kernels.evidence import listen, sweep, watch
from kernels.evidence.glimpse import Pods
from kernels.evidence.listen import Laid, Stretch
from kernels.runtime import runtime
from kernels.step.advance import Step

Device = Any

HARDLY = 0.25  # [dB] largest change of the noise within a part of a stretch
MOST_PARTS = 64
# probability of detection above which a particle counts as searched
HEARD = 0.01


@dataclass(frozen=True)
class Silent:
    """State of each particle for a watch, on the device: see kernels.evidence.listen.

    A table of POD only needs the misses.
    """

    log_missed: Device  # (factors * n,)
    edges: Device | None = None  # (STAIRS * factors * n,)
    held: Device | None = None

    @property
    def columns(self) -> dict[str, Device]:
        """Its columns by name, without those that are None."""
        return {name: column for name, column in vars(self).items() if column is not None}

    def copy(self) -> "Silent":
        """Return a copy with new device buffers."""
        return Silent(**{name: runtime.copy(column) for name, column in self.columns.items()})


class Listening:
    """One watch of a sensor in one run; times are seconds after the run's start."""

    growth = None  # its misses are no function of one number for all values of its unknown

    def __init__(self, sortie: Sortie, start: int) -> None:
        """Set up a watch; start: of the run [s since 1970]."""
        assert sortie.sensor is not None
        assert sortie.legs is not None
        self.sortie, self._start = sortie, start
        self.begin, self.end = (
            notation.epoch(sortie.start) - start,
            notation.epoch(sortie.end) - start,
        )
        sees = sortie.sensor.sees
        self._sees = Receiver(sees, sortie.beams) if isinstance(sees, Sonar) else sees
        self.factors, self.chances = unknown.values(sortie.sensor)
        self._path = sensor_path.of_legs(sortie.legs, start)
        self._exposed_until = self.begin  # the time [s] to which its columns are complete
        self.exposed: Silent | None = None  # state so far; None: not started

    @property
    def key(self) -> tuple[str, float]:
        """The key that watches and looks with the same unknown share."""
        assert self.sortie.sensor is not None
        return unknown.key(self.sortie.sensor)

    @property
    def markers(self) -> list[Marker]:
        """Its markers: none, since it does not drift."""
        return []

    def drift(self, forcing: Forcing, elapsed: int, duration: int) -> None:
        """Do nothing: its track is over the ground."""

    def as_flown(self, scenario: int, start: int) -> Sortie:
        """Return the sortie, the same in every scenario."""
        return self.sortie

    @property
    def columns(self) -> dict[str, Device]:
        """The columns of its state by name; none before it begins and after its end."""
        return {} if self.exposed is None else self.exposed.columns

    def ready(self, n: int) -> Silent:
        """Return its state of n particles; create empty columns on the first call."""
        if self.exposed is None:
            columns = listen.columns(n, len(self.factors))
            if isinstance(self._sees, PodGrid):
                columns = {"log_missed": columns["log_missed"]}
            self.exposed = Silent(
                **{name: runtime.upload(column) for name, column in columns.items()}
            )
        return self.exposed

    def expose(
        self,
        ensemble: Ensemble,
        begin: Begin,
        helm: Helm | None,
        step: Step,
        until: int,
        keep: bool = True,
    ) -> Silent:
        """Return its state of each particle until a time within the step just made.

        Args:
            ensemble: the particles.
            begin: where they began the step.
            helm: what steers them, if anything.
            step: the step.
            until: end of the exposure [s after the run's start].
            keep: whether to update its own columns.
        """
        exposed = self.ready(ensemble.n)
        first, last = max(self._exposed_until, step.elapsed, self.begin), min(until, self.end)
        if first >= last:
            return exposed
        if keep:
            self._exposed_until = last
        else:
            exposed = exposed.copy()
        kept = tuple(exposed.columns.values())
        every = range(len(ensemble.scenarios))
        for paths in scene.paths(ensemble, begin, helm, step, (first, last), every):
            low, high = paths.cut(first, last)
            for pods, sonar, stretch in self._stretches(low, high, paths.elapsed):
                if pods is not None:
                    watch.look_along(ensemble, paths, stretch, pods, self.sortie.ashore, kept[0])
                elif sonar is not None:
                    watch.listen_along(ensemble, paths, sonar, kept)
        return exposed

    def _stretches(
        self, first: float, last: float, elapsed: int
    ) -> Iterator[tuple[Pods | None, Laid | None, Stretch]]:
        """Yield the stretches of its track between two times, with their POD table or sonar.

        Times are seconds from `elapsed`.
        """
        track = self._path.between(first, last, elapsed, None, (0.0, 0.0))
        if track is None:
            return
        for k, seeks in enumerate(track.searching):
            whole = Stretch(*track.time[k : k + 2].tolist(), *_places(track.place, k))
            if isinstance(self._sees, PodGrid):
                if seeks:
                    yield (
                        pod_table.tables(self._sees, self._middle(whole, elapsed), self._duration),
                        None,
                        whole,
                    )
                continue
            for stretch, share in self._parts(self._sees, whole, elapsed):
                tables = self._tables(
                    self._sees, stretch, elapsed, track.course[4 * k : 4 * k + 4], share
                )
                if not seeks:
                    tables = tables._replace(gains=np.full(1, -math.inf, np.float32))
                yield None, listen.laid(stretch, tables, self.factors), stretch

    def _parts(
        self, own: Receiver, whole: Stretch, elapsed: int
    ) -> Iterator[tuple[Stretch, float]]:
        """Yield the parts of a stretch in which the noise hardly changes.

        Each comes with its middle as a share of the stretch.
        """
        times = [
            np.datetime64(self._start + elapsed + round(t), "s") for t in (whole.begin, whole.end)
        ]
        many = min(max(math.ceil(own.change(times[0], times[1]) / HARDLY), 1), MOST_PARTS)
        nodes = np.arange(many + 1) / many
        at, way = np.array(whole.place), np.array(whole.to, np.int64) - whole.place
        way[0] = (way[0] + 2**31) % 2**32 - 2**31
        places = at + np.rint(nodes[:, None] * way).astype(np.int64)
        places[:, 0] = (places[:, 0] + 2**31) % 2**32 - 2**31
        seconds = (whole.begin + nodes * (whole.end - whole.begin)).tolist()
        for k in range(many):
            (x, y), (to_x, to_y) = places[k : k + 2].tolist()
            yield Stretch(seconds[k], seconds[k + 1], (x, y), (to_x, to_y)), (k + 0.5) / many

    @property
    def _duration(self) -> float:
        """The duration of the watch [s]."""
        return float(self.end - self.begin)

    def _middle(self, stretch: Stretch, elapsed: int) -> np.datetime64:
        """Return the time of the middle of a stretch, in a step that begins at `elapsed` [s]."""
        return np.datetime64(
            self._start + elapsed + round(0.5 * (stretch.begin + stretch.end)), "s"
        )

    def _tables(
        self, own: Receiver, stretch: Stretch, elapsed: int, course: Array, share: float
    ) -> listen.Tables:
        """Return the tables of a sonar in the middle of a stretch.

        share: position of the middle between the two ends of `course`.
        """
        sensor = self.sortie.sensor
        assert sensor is not None
        lon, lat = (a + 0.5 * sphere.wrap(b - a) for a, b in zip(*_radians(stretch), strict=True))
        heading = sensor.heading
        if sensor.place is None:
            east, north = course[:2] + share * (course[2:] - course[:2])
            heading = math.atan2(east, north)
        return own.tables(float(lon), float(lat), heading, self._middle(stretch, elapsed))

    def fail(
        self,
        ensemble: Ensemble,
        exposed: Silent,
        shared: Device | None,
        log_weight: Device,
        keep: bool,
        growth: Array | None,
    ) -> None:
        """Multiply weights by the probability that it has missed each particle, in place.

        Args:
            ensemble: the particles.
            exposed: their state.
            shared: log misses by value of the unknown, of all watches and looks so far that share
                it; None: there were none.
            log_weight: of the particles, changed in place.
            keep: whether `shared`, if any, takes this miss.
            growth: None, as its misses are no hazards.
        """
        ones = np.ones((len(ensemble.scenarios), len(self.factors)))
        sweep.fail(
            ensemble.scenario,
            sweep.MISS,
            exposed.log_missed,
            ones,
            self.chances,
            shared,
            log_weight,
            keep=keep,
        )

    def searched(self) -> Array:
        """Return which particles it searched, 1 or 0, float64 (n,).

        A particle was searched if its probability of detection is above HEARD.
        """
        assert self.exposed is not None
        chances = np.log(self.chances)[:, None] + self.exposed.log_missed.to_numpy().reshape(
            len(self.factors), -1
        )
        return np.asarray(np.logaddexp.reduce(chances, axis=0) < math.log1p(-HEARD), np.float64)


def _places(place: Array, k: int) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the positions where piece k of a track begins and ends [binary angle]."""
    at = place[2 * k : 2 * k + 4].tolist()
    return (at[0], at[1]), (at[2], at[3])


def _radians(stretch: Stretch) -> tuple[Array, Array]:
    return np.array(stretch.place) * sphere.UNIT, np.array(stretch.to) * sphere.UNIT
