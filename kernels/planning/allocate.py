"""Expected detections of effort spread over cells, and the marginal gain of effort in each cell.

In each time bin a particle (m of them) is in one cell or in none (-1); each bin has cells of its
own. Effort is by unit and cell.
"""

import numpy as np
import taichi as ti

from kernels.runtime import runtime

HostReals = ti.types.ndarray(dtype=ti.f32, ndim=1)
HostInts = ti.types.ndarray(dtype=ti.i32, ndim=1)

BLOCK = 512


@ti.func
def look(curve: ti.template(), at: ti.f32) -> ti.f32:
    """Return a tabulated curve at `at` steps from its begin: linear in between, constant beyond."""
    last = curve.shape[0] - 1
    k = ti.min(ti.cast(at, ti.i32), last - 1)
    part = ti.min(at - ti.cast(k, ti.f32), 1.0)
    return curve[k] + part * (curve[k + 1] - curve[k])


@ti.func
def _rate(sweep: ti.f32, ratio: ti.f32) -> ti.f32:
    """Return an upper bound of the area swept past a particle [m2/s].

    Head-on, the speeds of sensor and particle add up.
    """
    return sweep * (1.0 + ratio)


@ti.kernel
def _spend(
    bins: ti.i32,
    units: ti.i32,
    steps: ti.f32,
    cell: HostInts,
    density: HostReals,
    sweep: HostReals,
    slowness: HostReals,
    pace: HostReals,
    fall: HostReals,
    scenario: HostInts,
    weight: HostReals,
    value: HostReals,
    slope: HostReals,
    conjugate: HostReals,
    gradient: HostReals,
    sums: HostReals,
):
    scale = ti.cast(conjugate.shape[0] - 1, ti.f32) / slope[0]
    m = weight.shape[0]
    for block in range((m + BLOCK - 1) // BLOCK):
        found, most = 0.0, 0.0
        for i in range(block * BLOCK, ti.min(block * BLOCK + BLOCK, m)):
            c = 0.0
            for t in range(bins):
                k = cell[t * m + i]
                if k >= 0:
                    for u in range(units):
                        r = _rate(
                            sweep[scenario[t * m + i] * units + u], pace[t * m + i] * slowness[u]
                        )
                        c += density[k * units + u] * r
                gradient[t * m + i] = 0.0
                if fall[t * m + i] > 0.0:
                    y = look(slope, c * steps)
                    w = weight[i] * fall[t * m + i]
                    found += w * look(value, c * steps)
                    most += w * look(conjugate, y * scale)
                    gradient[t * m + i] = w * y
            later = 0.0
            for s in range(bins):
                t = bins - 1 - s
                later += gradient[t * m + i]
                gradient[t * m + i] = later
        sums[2 * block], sums[2 * block + 1] = found, most


@ti.kernel
def _gain(
    units: ti.i32,
    squared: ti.template(),
    first: HostInts,
    entry: HostInts,
    sweep: HostReals,
    slowness: HostReals,
    pace: HostReals,
    scenario: HostInts,
    weight: HostReals,
    gradient: HostReals,
    gains: HostReals,
):
    m = weight.shape[0]
    for k in range(first.shape[0] - 1):
        for u in range(units):
            gains[k * units + u] = 0.0
        for e in range(first[k], first[k + 1]):
            i = entry[e] % m
            for u in range(units):
                r = _rate(sweep[scenario[entry[e]] * units + u], pace[entry[e]] * slowness[u])
                if ti.static(squared):
                    gains[k * units + u] += weight[i] * r * r
                else:
                    gains[k * units + u] += gradient[entry[e]] * r


class Field:
    """Particles in cells, and the curve that turns coverage into probability.

    Arrays are held as kernels take them repeatedly: see kernels.runtime.runtime.residents.

    cell: int32 (b, m), -1: none; fastest if neighbouring particles are adjacent; fall: loss of
    value when a particle is found after a bin instead of in it, (b, m) (POS: 1 at the last bin,
    else 0); pace: speed of a particle [m/s] (b, m); scenario: row of `sweep` of each particle,
    (m,), or in each bin (b, m); sweep: sweep width times speed [m2/s] (rows, units); slowness: one
    over the speed of each unit [s/m], 0 if a particle's own speed does not count; curve: value,
    slope and conjugate of drift.planning.search.concave, and its step of coverage.
    """

    def __init__(
        self, cell, cells: int, fall, pace, scenario, weight, sweep, slowness, curve, step: float
    ):
        """Sort the particles by cell."""
        self.bins, self.m = cell.shape
        self.units, self.cells = len(slowness), cells
        flat = np.ascontiguousarray(cell.reshape(-1), np.int32)
        self.step = step
        own = (sweep, slowness, fall, pace, weight, *curve)
        self.sweep, self.slowness, self.fall, self.pace, self.weight, *self.curve = (
            runtime.residents(*(np.ascontiguousarray(v, np.float32).reshape(-1) for v in own))
        )
        rows = np.ascontiguousarray(np.broadcast_to(scenario, cell.shape), np.int32).reshape(-1)
        entry = np.argsort(flat, kind="stable")
        entry = entry[np.searchsorted(flat[entry], 0) :].astype(np.int32)
        first = np.searchsorted(flat[entry], np.arange(cells + 1)).astype(np.int32)
        self.cell, self.scenario, self.entry, self.first = runtime.residents(
            flat, rows, entry, first
        )
        (self.gradient,) = runtime.residents(np.zeros(flat.size, np.float32))
        self.gains = np.zeros(cells * self.units, np.float32)

    def spend(self, density: np.ndarray) -> tuple[float, float]:
        """Return P(f) and the sum of w b*(y) for effort f [s/m2] by cell and unit.

        The slopes w y are stored for `gain`.
        """
        sums = np.zeros(2 * -(-self.m // BLOCK), np.float32)
        (flat,) = runtime.residents(np.ascontiguousarray(density, np.float32).reshape(-1))
        _spend(
            self.bins,
            self.units,
            1 / self.step,
            self.cell,
            flat,
            self.sweep,
            self.slowness,
            self.pace,
            self.fall,
            self.scenario,
            self.weight,
            *self.curve,
            self.gradient,
            sums,
        )
        found, most = sums.astype(np.float64).reshape(-1, 2).sum(axis=0)
        return float(found), float(most)

    def gain(self, squared: bool = False) -> np.ndarray:
        """Return the gain of one more unit of density [s/m2], by cell and unit (cells, units).

        squared: return the sum of mass times squared rate instead.
        """
        _gain(
            self.units,
            squared,
            self.first,
            self.entry,
            self.sweep,
            self.slowness,
            self.pace,
            self.scenario,
            self.weight,
            self.gradient,
            self.gains,
        )
        return self.gains.reshape(self.cells, self.units).astype(np.float64)
