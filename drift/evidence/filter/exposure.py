"""A sortie as it is flown: what its sensor has done to each particle, and what its failure does to
weights.

An area counts the time inside it, legs the hazard along relative tracks or the passes abeam, a
watch the time in its zones. All of it is kept on the device, in buffers that are freed when the
sortie ends.
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
    """What a sortie has done to each particle, on the device."""

    # exposure while it was adrift (n,); logs of misses by factor of the sweep width (factors * n,)
    adrift: Device
    inside: Device | None  # share of the time in its area (n,), where exposure is another quantity
    # exposure while it was under way (n,); None: nothing steers, or passes have been written
    under_way: Device | None
    passed: Device | None  # number of the leg on which a target under way has last been passed (n,)

    @property
    def columns(self) -> dict[str, Device]:
        """Its columns by name."""
        return {name: column for name, column in vars(self).items() if column is not None}

    def copy(self) -> "Exposed":
        """Return a copy."""
        return Exposed(
            *(None if column is None else runtime.copy(column) for column in vars(self).values())
        )


@dataclass(frozen=True)
class _Way:
    """Where a sensor goes the same way, and what moves it there besides; None: it does not drift."""

    scenarios: tuple[int, ...]
    marker: Marker | Tracked | None
    member: int | None = None  # of an ensemble of currents; None: in all of them


class SortieExposure:
    """One sortie in one run; times are seconds after the run's start."""

    def __init__(
        self,
        sortie: Sortie,
        start: int,
        seas: Sequence[tuple[int, ...]],
        members: Sequence[int] | None = None,
    ) -> None:
        """Make ready.

        start: of the run [s since 1970]; seas: scenarios that see the same current, together, all
        of the run's; members: of each sea's current, by default one.
        """
        self.sortie = sortie
        self.begin, self.end = (
            notation.epoch(sortie.start) - start,
            notation.epoch(sortie.end) - start,
        )
        self.factors, self.chances = laws.factors(sortie.shape)
        self._path = sensor_path.of_legs(sortie.legs, start) if sortie.legs else None
        self._place, self._ring = None, None
        if sortie.area is not None:
            lon, lat, self._ring = sensor_path.ring(sortie.area)
            self._place = sensor_path.standing(lon, lat, self.begin, self.end)
        every = tuple(sorted(scenario for sea in seas for scenario in sea))
        self._scenarios = len(every)
        self._ways = [_Way(every, None)]
        self._shown = self._ways  # the ways that are told: of an ensemble that of its mean
        self._datum = (0.0, 0.0)
        if sortie.frame == "datum":
            self._drifts(start, seas, members or [1] * len(seas))
        self._seen = self.begin  # the time [s] up to which its columns count
        self.exposed: Exposed | None = None  # what it has done to each particle; None: nothing yet

    def _drifts(self, start: int, seas: Sequence[tuple[int, ...]], members: Sequence[int]) -> None:
        """Make ready to drift with a marker, which goes with the current of each sea, and of each
        of its members.
        """
        path = self._path or self._place
        assert path is not None
        datum = self._datum = self.sortie.datum or (float(path.lon[0]), float(path.lat[0]))
        if self.sortie.marker is not None:
            self._ways = self._shown = [
                _Way(self._ways[0].scenarios, markers.tracked(self.sortie.marker, start))
            ]
            return
        self._ways, self._shown = [], []
        for sea, many in zip(seas, members, strict=True):
            self._shown.append(_Way(sea, Marker(*datum, self.begin, sea[0])))
            own = [_Way(sea, Marker(*datum, self.begin, sea[0], k), k) for k in range(many)]
            self._ways += own if many > 1 else self._shown[-1:]

    @property
    def key(self) -> tuple[str, float]:
        """What sorties have in common that share an unknown factor of sweep width."""
        return self.sortie.group, self.sortie.shape

    @property
    def _kind(self) -> int:
        """What its exposure adds up."""
        if self.sortie.watch:
            return int(sweep.ZONES)
        if self._path is None:
            return int(sweep.INSIDE)
        return int(
            sweep.CUBE if laws.formulas_of(self.sortie.law).detects == "along" else sweep.ABEAM
        )

    def as_flown(self, scenario: int, start: int) -> Sortie:
        """Return the sortie, with the track of its marker in a scenario if it drifts.

        start: of the run [s since 1970].
        """
        marker = next(way.marker for way in self._shown if scenario in way.scenarios)
        return (
            replace(self.sortie, marker=marker.legs(start))
            if isinstance(marker, Marker)
            else self.sortie
        )

    @property
    def markers(self) -> list[Marker]:
        """The markers with which it drifts and whose tracks are not known."""
        every = {id(way.marker): way.marker for way in (*self._ways, *self._shown)}.values()
        return [marker for marker in every if isinstance(marker, Marker)]

    def drift(self, forcing: Forcing, elapsed: int, duration: int) -> None:
        """Take its markers over a step, for which the forcing is set."""
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
    ) -> Exposed:
        """Return what it has done to each particle until a time within the step that was just made.

        begin: where particles began the step; helm: what steers them. keep: whether its own columns
        change. They stay as they were for one who merely looks, so that its legs are not cut there.
        """
        self.ready(ensemble, helm is not None)
        assert self.exposed is not None
        first, last = max(self._seen, step.elapsed, self.begin), min(until, self.end)
        if first >= last:
            return self.exposed
        exposed = self.exposed if keep else self.exposed.copy()
        if keep:
            self._seen = last
        member = (
            dealt.member_of_particles(ensemble)
            if any(way.member is not None for way in self._ways)
            else None
        )
        for way in self._ways:
            chosen = None  # which slots of all, where it is not all of these scenarios
            if member is not None and way.member is not None:
                chosen = member == way.member
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
        way: _Way,
        exposed: Exposed,
    ) -> None:
        """Add its exposure of particles along their paths, between two times of the step."""
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
        self, span: tuple[float, float], paths: Paths, way: _Way
    ) -> Iterator[tuple[int, Track, tuple[Array, Array]]]:
        """Yield the kind of exposure, the track between two times and the tables, for its path and
        for its area.
        """
        (first, last), begin, polar = paths.cut(*span), paths.elapsed, paths.polar
        moved = way.marker.where if way.marker else None
        if self._path is not None and self._looks:
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

    def ready(self, ensemble: Ensemble, steers: bool) -> Exposed:
        """Return what it has done to particles, nothing as yet; steers: whether any of them steer."""
        if self.exposed is None:
            several = len(self.factors) if self._kind == sweep.ABEAM else 1
            apart = self._kind in (sweep.CUBE, sweep.ABEAM) and self._place is not None
            self.exposed = Exposed(
                runtime.empty(ensemble.n * several),
                runtime.empty(ensemble.n) if apart else None,
                runtime.empty(ensemble.n) if steers and self._kind != sweep.ABEAM else None,
                runtime.empty(ensemble.n) if steers else None,
            )
        return self.exposed

    @property
    def _looks(self) -> bool:
        """Whether there is anything that it may see along its path."""
        return (
            bool(self.sortie.watch) or max((*self.sortie.sweep_width, *self._width_under_way)) > 0
        )

    @property
    def _width_under_way(self) -> tuple[float, ...]:
        return self.sortie.width_under_way or self.sortie.sweep_width

    @cached_property
    def _unit(self) -> Array:
        """The range [m], by scenario, below which nothing finer matters to it."""
        if self.sortie.watch:
            return np.full(self._scenarios, min(self.sortie.watch.outer))
        if self._path is None and self.sortie.area is not None:
            return np.full(self._scenarios, math.sqrt(patterns.square_metres(self.sortie.area)) / 4)
        return np.maximum(self._width_under_way, 1.0)

    @cached_property
    def _tables(self) -> tuple[Array, Array]:
        """The kernel's table and scale, the latter by scenario unless it is the same for all."""
        return self._tables_of(self.sortie.sweep_width)

    @cached_property
    def _tables_under_way(self) -> tuple[Array, Array]:
        """The same for targets under way."""
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

    def fail(
        self, ensemble: Ensemble, exposed: Exposed, shared: Device, log_weight: Device
    ) -> None:
        """Multiply weights by the chance that it has missed each particle, in place.

        exposed: what it has done to them. shared: logs of the misses so far of all sorties that
        share its unknown factor of sweep width.
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
            )

    @cached_property
    def _coefficients(self) -> tuple[int, Array]:
        """What the exposure means, and what to multiply it by, (scenarios, factors of the sweep
        width).
        """
        return self._coefficients_of(self.sortie.sweep_width, self.sortie.coverage)

    @cached_property
    def _coefficients_under_way(self) -> tuple[int, Array]:
        """The same for targets under way."""
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
        """Return the share of its time that each particle was where it searched, float64 (n,).

        That is in its area; of a watch, which has none, the share is 1 of all that came into a
        zone.
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
