"""The scene of a run, constant during the run: forcing, motion of each scenario, domain and
coast.
"""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from drift.engine.motion import guided
from drift.engine.motion.errors import buoys as on_scene
from drift.engine.motion.errors.buoys import Buoys
from drift.engine.motion.forcing import Forcing
from drift.engine.motion.guided import Guided
from drift.engine.motion.models.model import Group, Model, Motion, Waters
from drift.engine.motion.steering.steer import Helm, Steering
from drift.engine.particles import life
from drift.engine.particles.ensemble import Device, Ensemble
from drift.engine.particles.status import Status
from geo import sphere
from geo.array import Array
from kernels.maths import noise
from kernels.maths.noise import Purpose
from kernels.runtime import batch, runtime
from kernels.steering import pieces
from kernels.steering.pieces import Paths
from kernels.step import advance as kernel
from kernels.step import coast as device_coast
from kernels.step import curve, sample
from kernels.step.bridge import Inside
from kernels.step.sample import Ranges, ordered

# particle steps per launch: about a second, so that a run can be interrupted between launches
AT_ONCE = 20_000_000
SHARERS = 7  # key of what shares the errors of buoys, beside those of movers, among the cached


class Begin(NamedTuple):
    """Where the particles of an ensemble began a step, on the device."""

    # binary angle, int32 (n,): where they were when what steers had been moved, so where each went
    # adrift
    lon: Device
    lat: Device
    # the steering columns at the begin of the step; None: nothing steers
    helm: Mapping[str, Device] | None
    # each track's deviation from its chord: see kernels.step.curve, float32 (4 n,)
    bend: Device
    polar: bool = False  # whether the domain contains a pole


class Kept(NamedTuple):
    """Sampled positions of particles at a time inside a step, on the host."""

    lon: Array  # int32 binary angle (n,)
    lat: Array
    since: int  # [s]


@dataclass(frozen=True)
class Scene:
    """The inputs of motion shared by all scenarios: forcing, models and their terms, domain and
    coast.
    """

    forcing: Forcing
    motions: tuple[Motion, ...]  # of each scenario once it is adrift
    place: kernel.Surroundings
    steering: Steering | None = None  # how scenarios steer before that; None: no steering
    guided: Guided | None = None  # how noise is shifted toward finds; None: not guided
    buoys: Buoys | None = None  # drifting buoys on scene; None: there are none

    def advance(
        self,
        ensemble: Ensemble,
        low: int,
        high: int,
        step: kernel.Step,
        keep: bool = False,
        count: int = 1,
    ) -> Begin | None:
        """Move all slots over one step, in place: first steering targets until their distress, then
        drift.

        Args:
            ensemble: to move.
            low: begin of the step [s since 1970], in calendar time.
            high: its end.
            step: its time, length and noise key.
            keep: whether to return where the particles began the step.
            count: number of consecutive steps to move, with `keep` off: see `at_once` and
                Forcing.same_slices.
        """
        self.forcing.set(low, high, count)
        helm, at_helm = self.helm(ensemble), None
        if helm:
            helm.feel(self.forcing, step)
            at_helm = helm.keep() if keep else None
            helm.move(step, note=keep)
        moves, bend = self._movers(ensemble, step.direction, keep)
        begin = (
            Begin(
                runtime.copy(ensemble.lon),
                runtime.copy(ensemble.lat),
                at_helm,
                bend,
                self.place.polar,
            )
            if keep
            else None
        )
        guided.write_nudges(self.guided, ensemble, step)
        key = id(self), id(ensemble), SHARERS
        on_scene.write_shared(self.buoys, ensemble, step, self.forcing.movers, key)
        for move in moves:
            move(step, count)
        return begin

    def at_once(self, ensemble: Ensemble) -> int:
        """Return the most steps that one call of `advance` should make; results do not depend on
        it.
        """
        if self.steering is not None or self.buoys is not None:  # they are asked about every step
            return 1
        most: int = min(sample.MOST, AT_ONCE // max(ensemble.n, 1))
        return max(1, most)

    def helm(self, ensemble: Ensemble) -> Helm | None:
        """Return the steering of an ensemble, cached; None if nothing steers."""
        if self.steering is None:
            return None
        key = id(self), id(ensemble), 0
        if key not in self.forcing.movers or self.forcing.movers[key][0][2] is not ensemble.layout:
            helm_of = Helm(ensemble, self.steering, self.place.domain, self.place.coast)
            self.forcing.movers[key] = (self, ensemble, ensemble.layout), helm_of
        helm: Helm = self.forcing.movers[key][1]
        return helm

    def _movers(
        self, ensemble: Ensemble, direction: int, keep: bool
    ) -> tuple[tuple[kernel.Move, ...], Device]:
        """Return the move function of each group, and the device array for track curvature if
        `keep`.

        They are cached for a layout of the ensemble until the forcing is closed.
        """
        key = id(self), id(ensemble), 2 * direction + int(keep)
        if key not in self.forcing.movers or self.forcing.movers[key][0][2] is not ensemble.layout:
            bend = runtime.empty(4 * ensemble.n) if keep else None
            movers = tuple(
                model.mover(
                    ensemble, group, Waters(self.forcing.tiles, ranges, self.place), direction, bend
                )
                for model, ranges, group in self.groups(ensemble)
            )
            # They are kept alive, because an id() may be reused.
            self.forcing.movers[key] = (self, ensemble, ensemble.layout), (movers, bend)
        made: tuple[tuple[kernel.Move, ...], Device] = self.forcing.movers[key][1]
        return made

    def groups(self, ensemble: Ensemble) -> list[tuple[Model, Ranges, Group]]:
        """Return the groups of an ensemble's scenarios: same model, same forcing tiles.

        Scenarios that never go adrift are in no group.
        """
        together: dict[tuple[Model, tuple[int, ...]], list[int]] = {}
        for number, (ranges, motion) in enumerate(
            zip(self.forcing.ranges, self.motions, strict=True)
        ):
            if self.steering and not self.steering.adrift(number):
                continue
            together.setdefault((motion.model, ordered(ranges)), []).append(number)
        return [
            (
                model,
                self.forcing.ranges[own[0]],
                Group(ensemble.batch(own), tuple(self.motions[k].terms for k in own)),
            )
            for (model, _), own in together.items()
        ]

    def seas(self, quantity: str) -> list[tuple[int, ...]]:
        """Return groups of scenario numbers that use the same sources of a quantity."""
        together: dict[tuple[int, int], tuple[int, ...]] = {}
        for number, ranges in enumerate(self.forcing.ranges):
            together[ranges[quantity]] = (*together.get(ranges[quantity], ()), number)
        return list(together.values())

    def without_buoys(self) -> "Scene":
        """Return the scene without drifting buoys, for steps other than those of its clock."""
        return replace(self, buoys=None, place=self.place._replace(shares=False))

    def without_noise(self) -> "Scene":
        """Return the scene without random motion, steering and refloating.

        Steering is left out because it is exact for any step size. Particles on the shore stay or
        slide. Random terms are zero, so that the kernel is mostly that of the run, which need not
        be compiled twice; errors that particles have already count, unless they are set to zero.
        """
        beach = kernel.Beach(slides=self.place.beach.slides)
        place = self.place._replace(
            beach=beach,
            sinks=False,
            divergence=False,
            still=True,
            guided=False,
            shares=False,
            changes=(),
        )
        return replace(self, place=place, steering=None, guided=None, buoys=None)

    def between(
        self,
        ensemble: Ensemble,
        begin: Begin,
        kept: Kept | None,
        step: kernel.Step,
        time: int,
        start: int,
    ) -> tuple[Array, Array]:
        """Return lon, lat [binary angle] (n,) of an ensemble's particles at a time inside the last
        step.

        Args:
            ensemble: after the step.
            begin: where its particles began the step.
            kept: positions sampled earlier inside the step, on which these are conditioned; None:
                none.
            step: the step.
            time: inside the step [s after the run's start].
            start: of the run [s since 1970].
        """
        end, since = step.elapsed + step.duration, kept.since if kept else step.elapsed
        moment = (start + step.direction * time) % 2**31
        purpose = Purpose.DEBRIS_BRIDGE if self.place.debris else Purpose.RUN
        seed = noise.seed_for(ensemble.seed, purpose, self.place.debris)
        places = self._from(ensemble, begin, kept)
        inside = Inside(*places, begin.bend, step.elapsed, end, since, time, seed, moment)
        for model in dict.fromkeys(model for model, _ in self.motions):
            terms = tuple(terms if own is model else None for own, terms in self.motions)
            model.between(ensemble, terms, self.place, inside)
        lon, lat = (column.to_numpy() for column in places)
        helm = self.helm(ensemble)
        if helm and begin.helm:
            steers = np.isin(
                ensemble.scenario.to_numpy(), self.steering.scenarios if self.steering else ()
            )
            own = kept or Kept(begin.helm["lon"].to_numpy(), begin.helm["lat"].to_numpy(), since)
            there = helm.inside(begin.helm, (own.lon, own.lat), since, step, time, moment)
            mine = steers & (time < ensemble.release.to_numpy())
            lon, lat = (
                np.where(mine, new, old) for new, old in zip(there, (lon, lat), strict=True)
            )
        return lon, lat

    def _from(self, ensemble: Ensemble, begin: Begin, kept: Kept | None) -> tuple[Device, Device]:
        """Return copies of the positions at the begin of the step, or of those in `kept`:
        lon, lat.
        """
        if kept is None:
            return runtime.copy(begin.lon), runtime.copy(begin.lat)
        known = ensemble.release.to_numpy() <= kept.since
        lon = runtime.upload(np.where(known, kept.lon, begin.lon.to_numpy()))
        return lon, runtime.upload(np.where(known, kept.lat, begin.lat.to_numpy()))

    def velocity(
        self, ensemble: Ensemble, begin: Begin, step: kernel.Step, time: int
    ) -> tuple[Array, Array]:
        """Return (east, north) [m/s] over ground of particles at a time inside the last step, (n,).

        Drifting particles have their drift velocity at that time plus the mean random displacement
        rate of the step. Particles at rest have none.
        """
        lives, end = life.read_lives(ensemble), step.elapsed + step.duration
        left, finish = lives.way(step.elapsed, end)
        status = lives.at(time)
        lon, lat = begin.lon.to_numpy(), begin.lat.to_numpy()
        apart = sphere.offset(
            lon * sphere.UNIT,
            lat * sphere.UNIT,
            ensemble.lon.to_numpy() * sphere.UNIT,
            ensemble.lat.to_numpy() * sphere.UNIT,
        )
        off_lon, off_lat = curve.slopes(begin.bend.to_numpy(), lives.share(step.elapsed, end, time))
        if begin.polar:
            off = sphere.from_pole(lon * sphere.UNIT, lat, off_lon, off_lat)
        else:
            metres = sphere.UNIT * sphere.RADIUS
            off = off_lon * metres * np.cos(lat * sphere.UNIT), off_lat * metres
        moving = (status == Status.ADRIFT) & (finish > left)
        lasting = np.maximum(finish - left, 1)
        east, north = (
            np.where(moving, (way + more) / lasting, 0.0)
            for way, more in zip(apart, off, strict=True)
        )
        helm = self.helm(ensemble)
        if helm and begin.helm:
            steers = status == Status.UNDER_WAY
            own = helm.velocity(begin.helm, step, time)
            east, north = (
                np.where(steers, new, old) for new, old in zip(own, (east, north), strict=True)
            )
        return east, north


def paths(
    ensemble: Ensemble,
    begin: Begin,
    helm: Helm | None,
    step: kernel.Step,
    span: tuple[float, float],
    scenarios: Sequence[int],
    chosen: Array | None = None,
) -> Iterator[Paths]:
    """Yield particle paths in the last step for sensors: of steering targets, then of drifting
    particles.

    Drifting particles move straight in each piece of the step; there are paths for each piece.

    Args:
        ensemble: of n particles, after the step.
        begin: where they began the step.
        helm: steers the targets; None: nothing does.
        step: with the number of its pieces.
        span: times between which paths are wanted [s after the run's start].
        scenarios: numbers of the scenarios wanted.
        chosen: which particles of these are wanted, bool, shape (n,); None: all.
    """
    steered = helm.paths(begin.helm, step, scenarios, chosen) if helm and begin.helm else None
    if steered:
        yield steered
    drifts = [number for number in scenarios if helm is None or number in helm.adrift]
    own = ensemble.batch(drifts) if chosen is None else batch.among(ensemble.batch(drifts), chosen)
    if own.first == own.last:
        return
    before: tuple[Device, Device] | None = None
    for low, high in itertools.pairwise(curve.edges(step.elapsed, step.duration, step.pieces)):
        if high <= span[0] or low >= span[1]:
            continue
        if before is None:
            before = _positions_at(ensemble, begin, step, low)
        after = _positions_at(ensemble, begin, step, high)
        yield pieces.straight(
            ensemble, own, before, after, low, high - low, step.number, begin.polar
        )
        before = after


def _positions_at(
    ensemble: Ensemble, begin: Begin, step: kernel.Step, time: int
) -> tuple[Device, Device]:
    """Return lon, lat [binary angle] of drifting particles at a time of the step, on the device."""
    if time == step.elapsed:
        return begin.lon, begin.lat
    if time == step.elapsed + step.duration:
        return ensemble.lon, ensemble.lat
    places: tuple[Device, Device] = curve.places(
        ensemble, (begin.lon, begin.lat), begin.bend, step.elapsed, step.duration, time, begin.polar
    )
    return places


def land_of(
    scene: Scene,
) -> Callable[[npt.NDArray[Any], npt.NDArray[Any]], npt.NDArray[np.bool_]] | None:
    """Return a function that tells which points [binary angles] lie on land, computed on the
    device; None without a coast.
    """
    coast = scene.place.coast
    return None if coast is None else lambda lon, lat: ~device_coast.wet(coast, lon, lat)
