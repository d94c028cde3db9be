"""A sortie as it is flown: the exposure of each particle, and the weights after its failure.

The exposure to an area is the time inside it. The exposure to legs is the hazard along relative
tracks, or the passes abeam. The exposure to a watch is the time in its zones. All exposures are on
the device, in buffers that are freed when the sortie ends.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from drift.engine.motion import scene
from drift.engine.motion.forcing import Forcing
from drift.engine.motion.scene import Begin
from drift.engine.motion.steering.steer import Helm
from drift.engine.particles import members as dealt
from drift.engine.particles.ensemble import Ensemble
from drift.evidence.filter import markers, patterns
from drift.evidence.filter.detection import laws, sensor_path
from drift.evidence.filter.markers import Marker, Tracked
from drift.evidence.filter.records import Sortie
from geo import notation, sphere
from geo.array import Array
from kernels.evidence import sweep
from kernels.evidence.sweep import Track
from kernels.runtime import runtime
from kernels.steering.pieces import Paths
from kernels.step.advance import Step

Device = Any

CERTAIN = 1 - 1e-12  # highest chance of detection of a watch that has a finite hazard


@dataclass(frozen=True)
class Exposed:
    """The exposure of each particle to a sortie, on the device."""

    # exposure while adrift (n,); for passes abeam, log misses by sweep width factor (factors * n,)
    adrift: Device
    inside: Device | None  # share of the time in its area (n,), if exposure is another quantity
    # exposure while under way (n,); None: nothing steers, or passes abeam are stored in `adrift`
    under_way: Device | None
    passed: Device | None  # number of the leg that last passed each target under way (n,)

    @property
    def columns(self) -> dict[str, Device]:
        """Its columns by name, without those that are None."""
        return {name: column for name, column in vars(self).items() if column is not None}

    def copy(self) -> "Exposed":
        """Return a copy with new device buffers."""
        return Exposed(
            *(None if column is None else runtime.copy(column) for column in vars(self).values())
        )


@dataclass(frozen=True)
class _SharedPath:
    """Scenarios and ensemble members in which the sensor has the same track, and its marker.

    The marker is None if the sensor does not drift.
    """

    scenarios: tuple[int, ...]
    marker: Marker | Tracked | None
    member: int | None = None  # of an ensemble of currents; None: all members


class SortieExposure:
    """One sortie in one run; times are seconds after the run's start."""

    def __init__(
        self,
        sortie: Sortie,
        start: int,
        seas: Sequence[tuple[int, ...]],
        members: Sequence[int] | None = None,
        *,
        steers: bool = False,
    ) -> None:
        """Set up a sortie.

        Args:
            sortie: the sortie.
            start: of the run [s since 1970].
            seas: groups of scenarios with the same current; together they are all scenarios of the
                run.
            members: number of members of each group's current, by default one.
            steers: whether any particle steers.
        """
        self.sortie, self._steers = sortie, steers
        self.begin, self.end = (
            notation.epoch(sortie.start) - start,
            notation.epoch(sortie.end) - start,
        )
        self.factors, self.chances = laws.factors(sortie.shape)
        self._path = sensor_path.of_legs(sortie.legs, start) if sortie.legs else None
        self._place, self._ring = None, None
        if sortie.area is not None:
            lon, lat, self._ring = sensor_path.ring(sortie.area)
            self._place = sensor_path.path_of_fixed_sensor(lon, lat, self.begin, self.end)
        every = tuple(sorted(scenario for sea in seas for scenario in sea))
        self._scenarios = len(every)
        self._paths_by_current = [_SharedPath(every, None)]
        self._reported_paths = (
            self._paths_by_current
        )  # the tracks that are reported; for an ensemble, that of the mean
        self._datum = (0.0, 0.0)
        if sortie.frame == "datum":
            self._drifts(start, seas, members or [1] * len(seas))
        self._exposed_until = self.begin  # the time [s] to which its columns are complete
        self.exposed: Exposed | None = None  # exposure so far; None: not started

    def _drifts(self, start: int, seas: Sequence[tuple[int, ...]], members: Sequence[int]) -> None:
        """Create markers, one for the current of each group of scenarios and of each member."""
        path = self._path or self._place
        assert path is not None
        datum = self._datum = self.sortie.datum or (float(path.lon[0]), float(path.lat[0]))
        if self.sortie.marker is not None:
            self._paths_by_current = self._reported_paths = [
                _SharedPath(
                    self._paths_by_current[0].scenarios,
                    markers.marker_of_track(self.sortie.marker, start),
                )
            ]
            return
        self._paths_by_current, self._reported_paths = [], []
        for sea, many in zip(seas, members, strict=True):
            self._reported_paths.append(_SharedPath(sea, Marker(*datum, self.begin, sea[0])))
            own = [_SharedPath(sea, Marker(*datum, self.begin, sea[0], k), k) for k in range(many)]
            self._paths_by_current += own if many > 1 else self._reported_paths[-1:]

    @property
    def key(self) -> tuple[str, float]:
        """The key that sorties with the same unknown factor of sweep width share."""
        return self.sortie.group, self.sortie.shape

    @property
    def _kind(self) -> int:
        """The kind of its exposure, a constant of kernels.evidence.sweep."""
        if self.sortie.watch:
            return int(sweep.ZONES)
        if self._path is None:
            return int(sweep.INSIDE)
        return int(
            sweep.CUBE if laws.formulas_of(self.sortie.law).detects == "along" else sweep.ABEAM
        )

    def as_flown(self, scenario: int, start: int) -> Sortie:
        """Return the sortie, with the track of its marker in a scenario if it drifts.

        Args:
            scenario: number of the scenario.
            start: of the run [s since 1970].
        """
        marker = next(way.marker for way in self._reported_paths if scenario in way.scenarios)
        return (
            replace(self.sortie, marker=marker.legs(start))
            if isinstance(marker, Marker)
            else self.sortie
        )

    @property
    def markers(self) -> list[Marker]:
        """Its markers without known tracks."""
        every = {
            id(way.marker): way.marker for way in (*self._paths_by_current, *self._reported_paths)
        }.values()
        return [marker for marker in every if isinstance(marker, Marker)]

    def drift(self, forcing: Forcing, elapsed: int, duration: int) -> None:
        """Move its markers over a step; the forcing must be set for the step."""
        for marker in self.markers:
            marker.drift(forcing, elapsed, duration)

    def expose(
        self,
        ensemble: Ensemble,
        begin: Begin,
        helm: Helm | None,
        step: Step,
        until: int,
        keep: bool = True,
        only: Array | None = None,
    ) -> Exposed:
        """Return the exposure of each particle until a time within the step just made.

        Args:
            ensemble: the particles.
            begin: where they began the step.
            helm: what steers them, if anything.
            step: the step.
            until: end of the exposure [s after the run's start].
            keep: whether to update its own columns. Otherwise they stay unchanged, so that an
                output does not cut the legs there.
            only: which particles it exposes, bool (n,); None: all.
        """
        exposed = self.ready(ensemble.n)
        first, last = max(self._exposed_until, step.elapsed, self.begin), min(until, self.end)
        if first >= last:
            return exposed
        if keep:
            self._exposed_until = last
        else:
            exposed = exposed.copy()
        member = (
            dealt.member_of_particles(ensemble)
            if any(way.member is not None for way in self._paths_by_current)
            else None
        )
        for way in self._paths_by_current:
            chosen = only  # bool (n,): slots, if not all of these scenarios
            if member is not None and way.member is not None:
                chosen = member == way.member
                if only is not None:
                    chosen &= only
            for paths in scene.paths(
                ensemble, begin, helm, step, (first, last), way.scenarios, chosen
            ):
                self._expose(ensemble, paths, (first, last), way, exposed)
        return exposed

    def _expose(
        self,
        ensemble: Ensemble,
        paths: Paths,
        span: tuple[float, float],
        way: _SharedPath,
        exposed: Exposed,
    ) -> None:
        """Add the exposure of particles along their paths, between two times of the step."""
        other = exposed.under_way if paths.steers else exposed.adrift
        for kind, track, (table, scale) in self._tracks(span, paths, way):
            column = exposed.adrift if kind == sweep.ABEAM else other
            if kind == sweep.INSIDE and exposed.inside is not None:
                column = exposed.inside
            sweep.expose(
                ensemble,
                paths,
                kind,
                track,
                table,
                scale,
                column,
                self.sortie.ashore,
                self._unit,
                exposed.passed,
            )

    def _tracks(
        self, span: tuple[float, float], paths: Paths, way: _SharedPath
    ) -> Iterator[tuple[int, Track, tuple[Array, Array]]]:
        """Yield the kind of exposure, the track between two times and the kernel's tables.

        There is one entry for its legs and one for its area.
        """
        (first, last), begin, polar = paths.cut(*span), paths.elapsed, paths.polar
        moved = way.marker.where if way.marker else None
        if self._path is not None and self._detects:
            track = self._path.between(first, last, begin, moved, self._datum, polar)
            if track is not None:
                yield self._kind, track, self._tables_under_way if paths.steers else self._tables
        if self._place is not None and self._ring is not None:
            track = self._place.between(first, last, begin, moved, self._datum, polar)
            if track is not None:
                ring = self._ring
                if polar:
                    lon, lat = np.radians(self._place.lon[:1]), self._place.lat[:1]
                    ring = np.stack(
                        sphere.to_pole(lon, lat, ring[::2], ring[1::2]), axis=1
                    ).reshape(-1)
                yield sweep.INSIDE, track, (ring, np.array([1 / (self.end - self.begin)]))

    @property
    def columns(self) -> dict[str, Device]:
        """The columns of its exposure by name; none before it begins and after its end."""
        return {} if self.exposed is None else self.exposed.columns

    def ready(self, n: int) -> Exposed:
        """Return its exposure of n particles; create empty columns on the first call."""
        if self.exposed is None:
            several = len(self.factors) if self._kind == sweep.ABEAM else 1
            apart = self._kind in (sweep.CUBE, sweep.ABEAM) and self._place is not None
            self.exposed = Exposed(
                runtime.empty(n * several),
                runtime.empty(n) if apart else None,
                runtime.empty(n) if self._steers and self._kind != sweep.ABEAM else None,
                runtime.empty(n) if self._steers else None,
            )
        return self.exposed

    @property
    def _detects(self) -> bool:
        """Whether it can detect anything along its legs."""
        return (
            bool(self.sortie.watch) or max((*self.sortie.sweep_width, *self._width_under_way)) > 0
        )

    @property
    def _width_under_way(self) -> tuple[float, ...]:
        return self.sortie.width_under_way or self.sortie.sweep_width

    @cached_property
    def _unit(self) -> Array:
        """The range [m], by scenario, below which finer detail does not matter."""
        if self.sortie.watch:
            return np.full(self._scenarios, min(self.sortie.watch.outer))
        if self._path is None and self.sortie.area is not None:
            return np.full(self._scenarios, math.sqrt(patterns.square_metres(self.sortie.area)) / 4)
        return np.maximum(self._width_under_way, 1.0)

    @cached_property
    def _tables(self) -> tuple[Array, Array]:
        """The kernel's table and scale; the scale is by scenario unless it is the same for all."""
        return self._tables_of(self.sortie.sweep_width)

    @cached_property
    def _tables_under_way(self) -> tuple[Array, Array]:
        """The kernel's table and scale for targets under way."""
        return self._tables_of(self._width_under_way)

    def _tables_of(self, widths: Sequence[float]) -> tuple[Array, Array]:
        if self.sortie.watch:
            watch = self.sortie.watch
            chance = np.minimum(np.array(watch.pod), CERTAIN)
            rate = -np.log1p(-chance) * self.sortie.completed / (self.end - self.begin)
            return np.stack([watch.inner, watch.outer], axis=1).reshape(-1), rate
        width = np.array(widths)[:, None]
        if self._kind == sweep.CUBE:
            return np.zeros(1), width > 0
        ranges, chances = laws.range_curve(self.sortie.law)
        factors = np.where(width > 0, width, 1.0) * self.factors
        return np.stack([ranges, chances], axis=1).reshape(-1), np.where(
            width > 0, 1 / factors, 0.0
        )

    @cached_property
    def growth(self) -> Array | None:
        """How its hazard grows with the factor of the sweep width, (factors,); None: it has none."""
        if self._coefficients[0] != sweep.HAZARD:
            return None
        power = {sweep.ZONES: 0, sweep.INSIDE: 1, sweep.CUBE: 2}[self._kind]
        return np.asarray(self.factors**power)

    def fail(
        self,
        ensemble: Ensemble,
        exposed: Exposed,
        shared: Device | None,
        log_weight: Device,
        keep: bool,
        growth: Array | None,
    ) -> None:
        """Multiply weights by the probability that it has missed each particle, in place.

        Args:
            ensemble: the particles.
            exposed: their exposure.
            shared: the misses so far of all sorties with the same unknown factor of sweep width, as
                kernels.evidence.sweep.fail takes them; None: there were none.
            log_weight: of the particles, changed in place.
            keep: whether `shared`, if any, takes this miss.
            growth: of all these sorties, if it is the same: `shared` is then a sum of hazards.
        """
        meaning, coefficient = self._coefficients
        also = (
            None
            if exposed.under_way is None
            else (exposed.under_way, self._coefficients_under_way[1])
        )
        if max(coefficient.max(), also[1].max() if also else 0.0) > 0:
            sweep.fail(
                ensemble.scenario,
                meaning,
                exposed.adrift,
                coefficient,
                self.chances,
                shared,
                log_weight,
                also,
                keep,
                growth,
            )

    @cached_property
    def _coefficients(self) -> tuple[int, Array]:
        """The meaning of the exposure, and its coefficients (scenarios, factors of sweep width)."""
        return self._coefficients_of(self.sortie.sweep_width, self.sortie.coverage)

    @cached_property
    def _coefficients_under_way(self) -> tuple[int, Array]:
        """The meaning and coefficients of the exposure of targets under way."""
        return self._coefficients_of(
            self._width_under_way, self.sortie.coverage_under_way or self.sortie.coverage
        )

    def _coefficients_of(
        self, widths: Sequence[float], coverages: Sequence[float]
    ) -> tuple[int, Array]:
        sortie, kind = self.sortie, self._kind
        if kind == sweep.ZONES:
            return sweep.HAZARD, np.ones((self._scenarios, 1))
        if kind == sweep.INSIDE:
            coverage = np.array(coverages)[:, None] * self.factors
            if laws.formulas_of(sortie.law).detects == "anywhere":
                return sweep.HAZARD, coverage * sortie.completed
            pod = [laws.pod(sortie.law, own) for own in coverage]
            return sweep.SHARE, np.array(pod) * sortie.completed
        width = np.array(widths)[:, None] * self.factors
        if kind == sweep.CUBE:
            return sweep.HAZARD, width**2 / (4 * math.pi)
        return sweep.MISS, np.repeat(width[:, :1] > 0, len(self.factors), axis=1)

    def searched(self) -> Array:
        """Return the share of the sortie's time that each particle was in its area, float64 (n,).

        A watch has no area: the share is 1 for all particles that came into a zone.
        """
        assert self.exposed is not None
        own = self.exposed
        if self._place is None:
            adrift = own.adrift.to_numpy().reshape(
                len(self.factors) if self._kind == sweep.ABEAM else 1, -1
            )
            seen = adrift.any(axis=0)
            return np.asarray(
                seen if own.under_way is None else seen | own.under_way.to_numpy().astype(bool),
                float,
            )
        if own.inside is not None:
            return np.asarray(own.inside.to_numpy(), np.float64)
        both = (
            own.adrift.to_numpy()
            if own.under_way is None
            else own.adrift.to_numpy() + own.under_way.to_numpy()
        )
        return np.asarray(both, np.float64)
