"""A sortie as it is flown: what its sensor has done to each particle, and what its failure does to weights.

An area counts the time inside it, legs the hazard along relative tracks or the passes abeam, a watch the time in its
zones. All of it is kept on the device, in columns that go when the sortie is over.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from drift.motion.forcing import Forcing
from drift.particles.ensemble import Ensemble
from drift.search import laws, markers, sensor_path
from drift.search.markers import Marker, Tracked
from drift.search.records import Sortie
from geo import notation
from geo.array import Array
from kernels import runtime, sweep

Device = Any

CERTAIN = 1 - 1e-12  # highest chance of detection of a watch that has a finite hazard


class SortieExposure:
    """One sortie in one run; times are seconds after the run's start."""

    def __init__(self, sortie: Sortie, start: int, seas: Sequence[tuple[int, ...]]) -> None:
        """Make ready.

        start: of the run [s since 1970]; seas: scenarios that see the same current, together, all of the run's.
        """
        self.sortie = sortie
        self.begin, self.end = notation.epoch(sortie.start) - start, notation.epoch(sortie.end) - start
        self.factors, self.chances = laws.factors(sortie.shape)
        self._path = sensor_path.of_legs(sortie.legs, start) if sortie.legs else None
        self._place, self._ring = None, None
        if sortie.area is not None:
            lon, lat, self._ring = sensor_path.ring(sortie.area)
            self._place = sensor_path.standing(lon, lat, self.begin, self.end)
        every = tuple(sorted(scenario for sea in seas for scenario in sea))
        self._scenarios = len(every)
        # Scenarios in which the sensor goes the same way, and what moves it there besides; all where it does not drift.
        self._ways: list[tuple[tuple[int, ...], Marker | Tracked | None]] = [(every, None)]
        self._datum = (0.0, 0.0)
        if sortie.frame == "datum":
            self._datum, self._ways = self._drifting(start, seas)
        self._seen = self.begin  # the time [s] up to which its columns count
        self.columns: list[Device] = []  # exposure; where that is another quantity, also the share of time in its area

    def _drifting(
        self, start: int, seas: Sequence[tuple[int, ...]]
    ) -> tuple[tuple[float, float], list[tuple[tuple[int, ...], Marker | Tracked | None]]]:
        """Return where a drifting frame begins (lon, lat) [deg], and its ways: a marker drifts with the current."""
        path = self._path or self._place
        assert path is not None
        datum = self.sortie.datum or (float(path.lon[0]), float(path.lat[0]))
        if self.sortie.marker is not None:
            return datum, [(self._ways[0][0], markers.tracked(self.sortie.marker, start))]
        return datum, [(scenarios, Marker(*datum, self.begin, scenarios[0])) for scenarios in seas]

    @property
    def _kind(self) -> int:
        """What its exposure adds up."""
        if self.sortie.watch:
            return int(sweep.ZONES)
        if self._path is None:
            return int(sweep.INSIDE)
        return int(sweep.CUBE if laws.of(self.sortie.law).detects == "along" else sweep.ABEAM)

    def as_flown(self, scenario: int, start: int) -> Sortie:
        """Return the sortie, with the track of its marker in a scenario if it drifts.

        start: of the run [s since 1970].
        """
        marker = next(marker for scenarios, marker in self._ways if scenario in scenarios)
        return replace(self.sortie, marker=marker.legs(start)) if isinstance(marker, Marker) else self.sortie

    def drift(self, forcing: Forcing, elapsed: int, duration: int) -> None:
        """Take its markers over a step, for which the forcing is set."""
        for _, marker in self._ways:
            if marker is not None:
                marker.drift(forcing, elapsed, duration)

    def expose(
        self, ensemble: Ensemble, before: tuple[Device, Device], step: tuple[int, int], until: int, keep: bool = True
    ) -> list[Device]:
        """Return its columns with what it does until a time within the step (elapsed, duration) that was just made.

        keep: whether its own columns change. They stay as they were for one who merely looks, so that its legs are not
        cut there.
        """
        if not self.columns:
            several = len(self.factors) if self._kind == sweep.ABEAM else 1
            self.columns = [runtime.empty(ensemble.n * several)]
            if self._kind in (sweep.CUBE, sweep.ABEAM) and self._place is not None:
                self.columns.append(runtime.empty(ensemble.n))
        begin, end = max(self._seen, step[0], self.begin), min(until, self.end)
        if begin >= end:
            return self.columns
        columns = self.columns if keep else [runtime.copy(column) for column in self.columns]
        if keep:
            self._seen = end
        share = np.array([1 / (self.end - self.begin)])
        for scenarios, marker in self._ways:
            own, moved = ensemble.batch(scenarios), marker.where if marker else None
            if self._path is not None and self._looks:
                track = self._path.between(begin, end, step[0], moved, self._datum)
                if track is not None:
                    sweep.expose(ensemble, own, before, *step, self._kind, track, *self._tables, columns[0])
            if self._place is not None:
                track = self._place.between(begin, end, step[0], moved, self._datum)
                sweep.expose(ensemble, own, before, *step, sweep.INSIDE, track, self._ring, share, columns[-1])
        return columns

    @property
    def _looks(self) -> bool:
        """Whether there is anything that it may see along its path."""
        return bool(self.sortie.watch) or max(self.sortie.sweep_width) > 0

    @cached_property
    def _tables(self) -> tuple[Array, Array]:
        """The kernel's table and scale, the latter by scenario unless it is the same for all."""
        if self.sortie.watch:
            watch = self.sortie.watch
            chance = np.minimum(np.array(watch.pod), CERTAIN)
            rate = -np.log1p(-chance) * self.sortie.completed / (self.end - self.begin)
            return np.stack([watch.inner, watch.outer], axis=1).reshape(-1), rate
        width = np.array(self.sortie.sweep_width)[:, None]
        if self._kind == sweep.CUBE:
            return np.zeros(1), width > 0
        ranges, chances = laws.table(self.sortie.law)
        factors = np.where(width > 0, width, 1.0) * self.factors
        return np.stack([ranges, chances], axis=1).reshape(-1), np.where(width > 0, 1 / factors, 0.0)

    def fail(self, ensemble: Ensemble, columns: list[Device], shared: Device, log_weight: Device) -> None:
        """Multiply weights by the chance that it has missed each particle, in place.

        columns: its exposure of them. shared: logs of the misses so far of all sorties that share its unknown factor of
        sweep width.
        """
        meaning, coefficient = self._coefficients
        if coefficient.max() > 0:
            sweep.fail(ensemble.scenario, meaning, columns[0], coefficient, self.chances, shared, log_weight)

    @cached_property
    def _coefficients(self) -> tuple[int, Array]:
        """What the exposure means, and what to multiply it by, (scenarios, factors of the sweep width)."""
        sortie, kind = self.sortie, self._kind
        if kind == sweep.ZONES:
            return sweep.HAZARD, np.ones((self._scenarios, 1))
        if kind == sweep.INSIDE:
            coverage = np.array(sortie.coverage)[:, None] * self.factors
            if laws.of(sortie.law).detects == "anywhere":
                return sweep.HAZARD, coverage * sortie.completed
            pod = [laws.pod(sortie.law, own) for own in coverage]
            return sweep.SHARE, np.array(pod) * sortie.completed
        width = np.array(sortie.sweep_width)[:, None] * self.factors
        if kind == sweep.CUBE:
            return sweep.HAZARD, width**2 / (4 * math.pi)
        return sweep.MISS, np.repeat(width[:, :1] > 0, len(self.factors), axis=1)

    def searched(self) -> Array:
        """Return the share of its time that each particle was where it searched, float64 (n,).

        That is in its area; of a watch, which has none, the share is 1 of all that came into a zone.
        """
        if self._place is None:
            exposed = self.columns[0].to_numpy().reshape(len(self.factors) if self._kind == sweep.ABEAM else 1, -1)
            return np.asarray(exposed.any(axis=0), np.float64)
        return np.asarray(self.columns[-1].to_numpy(), np.float64)
