"""A sortie as it is flown: what its sensor has done to each particle so far, and what its failure does to weights.

An area counts the time inside it, legs the hazard along relative tracks or the passes abeam, a watch the time in its zones.
All of it is kept on the device, in columns that go when the sortie is over.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from drift import detection, markers, paths
from drift.ensemble import Ensemble
from drift.forcing import Forcing
from drift.markers import Marker, Tracked
from drift.sortie import Sortie
from kernels import runtime, sweep

Array = npt.NDArray[Any]
Device = Any

CERTAIN = 1 - 1e-12  # a watch's chance of detection of which a hazard can be told


class Flown:
    """One sortie in one run; times are seconds after the run's start."""

    def __init__(self, sortie: Sortie, start: int, scenarios: int) -> None:
        """Make ready; start: of the run [s since 1970]."""
        self.sortie = sortie
        self.begin, self.end = (
            int(t.astype("datetime64[s]").astype(np.int64)) - start for t in (sortie.start, sortie.end)
        )
        self.factors, self.chances = detection.factors(sortie.shape)
        self._scenarios = range(scenarios)
        self._path = paths.of_legs(sortie.legs, start) if sortie.legs else None
        self._place, self._ring = None, None
        if sortie.area is not None:
            lon, lat, self._ring = paths.ring(sortie.area)
            self._place = paths.standing(lon, lat, self.begin, self.end)
        self._markers: list[Marker | Tracked] | None = None
        if sortie.frame == "datum":
            self._markers = _markers(sortie, start, self.begin, self._path or self._place, scenarios)
        self._exposure: Device = None
        self._searched: Device = None

    @property
    def _kind(self) -> int:
        """What its exposure adds up."""
        if self.sortie.watch:
            return int(sweep.ZONES)
        if self._path is None:
            return int(sweep.INSIDE)
        return int(sweep.CUBE if self.sortie.law.kind == "inverse_cube" else sweep.ABEAM)

    @property
    def columns(self) -> list[Device]:
        """What it keeps on the device, each a whole number of n long."""
        return [column for column in (self._exposure, self._searched) if column is not None]

    def as_flown(self, scenario: int, start: int) -> Sortie:
        """Return the sortie, with the track of its marker in a scenario if it drifts; start: of the run [s since 1970]."""
        marker = self._markers[scenario] if self._markers else None
        return replace(self.sortie, marker=marker.legs(start)) if isinstance(marker, Marker) else self.sortie

    def drift(self, forcing: Forcing, elapsed: int, duration: int) -> None:
        """Take its markers over a step, for which the forcing is set."""
        for marker in self._markers or ():
            marker.drift(forcing, elapsed, duration)

    def expose(
        self, ensemble: Ensemble, before: tuple[Device, Device], step: tuple[int, int], begin: int, end: int
    ) -> None:
        """Add what it does from begin to end, within the step (elapsed, duration) that the ensemble has just made."""
        begin, end = max(begin, self.begin), min(end, self.end)
        if begin >= end:
            return
        kind = self._kind
        if self._exposure is None:
            self._exposure = runtime.empty(ensemble.n * (len(self.factors) if kind == sweep.ABEAM else 1))
            if kind in (sweep.CUBE, sweep.ABEAM) and self._place is not None:
                self._searched = runtime.empty(ensemble.n)
        for scenario, slots in enumerate(ensemble.scenarios):
            shift = self._markers[scenario].shift if self._markers else None
            if self._path is not None and (self.sortie.watch or self.sortie.sweep_width[scenario] > 0):
                track = self._path.between(begin, end, step[0], shift)
                if track is not None:
                    sweep.expose(ensemble, slots, before, *step, kind, track, *self._tables(scenario), self._exposure)
            if self._place is not None:
                track = self._place.between(begin, end, step[0], shift)
                column = self._exposure if self._path is None else self._searched
                assert track is not None
                assert self._ring is not None
                sweep.expose(ensemble, slots, before, *step, sweep.INSIDE, track, self._ring, np.zeros(1), column)

    def _tables(self, scenario: int) -> tuple[Array, Array]:
        """Return the kernel's table and scale for the objects of a scenario."""
        if self.sortie.watch:
            watch = self.sortie.watch
            chance = np.minimum(np.array(watch.pod), CERTAIN)
            rate = -np.log1p(-chance) * self.sortie.completed / (self.end - self.begin)
            return np.stack([watch.inner, watch.outer], axis=1).reshape(-1), rate
        if self._kind == sweep.CUBE:
            return np.zeros(1), np.zeros(1)
        ranges, chances = detection.table(self.sortie.law)
        return np.stack([ranges, chances], axis=1).reshape(-1), 1 / (self.sortie.sweep_width[scenario] * self.factors)

    def forget(self) -> None:
        """Give back the columns that it keeps on the device."""
        self._exposure = self._searched = None

    def fail(self, ensemble: Ensemble, shared: Device, log_weight: Device) -> None:
        """Multiply weights by the chance that it has missed each particle so far, in place.

        shared: logs of the misses so far of all sorties that share its unknown factor of sweep width.
        """
        if self._exposure is None:
            return
        for scenario, slots in enumerate(ensemble.scenarios):
            meaning, coefficient = self._coefficients(scenario)
            if coefficient.max() > 0:
                sweep.fail(slots, meaning, self._exposure, coefficient, self.chances, shared, log_weight)

    def _coefficients(self, scenario: int) -> tuple[int, Array]:
        """Return what the exposure means, and what to multiply it by, by factor of the sweep width."""
        sortie, kind, span = self.sortie, self._kind, self.end - self.begin
        if kind == sweep.ZONES:
            return sweep.HAZARD, np.ones(1, np.float32)
        if kind == sweep.INSIDE:
            coverage = sortie.coverage[scenario] * self.factors
            if sortie.law.kind == "random":
                return sweep.HAZARD, (coverage * sortie.completed / span).astype(np.float32)
            share = detection.pod(sortie.law, coverage) * sortie.completed / span
            return sweep.SHARE, share.astype(np.float32)
        width = sortie.sweep_width[scenario] * self.factors
        if kind == sweep.CUBE:
            return sweep.HAZARD, (width**2 / (4 * math.pi)).astype(np.float32)
        return sweep.MISS, np.full(len(width), float(width[0] > 0), np.float32)

    def searched(self) -> Array:
        """Return the share of its time that each particle was where it searched, float64 (n,).

        That is its area; of what has none, a watch, all that came into a zone.
        """
        if self._place is None:
            exposed = self._exposure.to_numpy().reshape(len(self.factors) if self._kind == sweep.ABEAM else 1, -1)
            return np.asarray(exposed.any(axis=0), np.float64)
        column = self._searched if self._searched is not None else self._exposure
        return np.asarray(column.to_numpy(), np.float64) / (self.end - self.begin)


def _markers(sortie: Sortie, start: int, begin: int, path: paths.Path | None, scenarios: int) -> list[Marker | Tracked]:
    """Return the markers that a sortie's pattern drifts with, one a scenario."""
    assert path is not None
    lon, lat = sortie.datum or (float(path.lon[0]), float(path.lat[0]))
    if sortie.marker is not None:
        return [markers.tracked(sortie.marker, (lon, lat), start)] * scenarios
    return [Marker(lon, lat, begin, scenario) for scenario in range(scenarios)]
