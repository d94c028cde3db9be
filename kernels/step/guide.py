"""Guided noise: shifts of the random errors that steer particles towards reported finds.

A guided particle's errors of current and wind keep the numbers of their streams
(kernels.maths.noise), to whose standard normals a shift is added.
drift.evidence.filter.debris.guide chooses the shift and corrects the particle's weight for it.
`project` sums the normals of all steps, each multiplied by the displacement that it causes by the
time of a find; `nudge` computes the shift of one step from a particle's pull towards each find.
"""

from collections.abc import Mapping
from typing import Any

import taichi as ti

from kernels.maths import noise
from kernels.runtime import rows, runtime
from kernels.step.coast import Ints, Reals

# Columns of an ensemble in the rows of one array: shifts of the present step's normals [1].
NUDGES = ("nudge_current_east", "nudge_current_north", "nudge_wind_east", "nudge_wind_north")

f32x2 = ti.types.vector(2, ti.f32)


def nudges_of(columns: Mapping[str, Any], guided: bool) -> Any:
    """Return the array of nudges, float32 (4 n,); a placeholder (1,) without guided particles."""
    return rows.whole(columns, NUDGES) if guided else runtime.empty(1, ti.f32)


@ti.kernel
def project(
    first: ti.i32,
    last: ti.i32,
    number: ti.i32,
    begins: Ints,
    numbers: Ints,
    steps: ti.i32,
    finds: ti.i32,
    responses: Reals,
    sums: Reals,
    seed0: ti.u32,
    seed1: ti.u32,
):
    """Sum the normals of particles' errors over the steps of a run, each times its response.

    Args:
        first: first slot.
        last: slot after the last one.
        number: number of the first slot in the whole run, the key of its noise.
        begins: row of the first step in which each particle drifts, shape (n,).
        numbers: number of each row's step, the key of its noise, shape (steps,).
        steps: number of rows.
        finds: number of finds.
        responses: displacement [m] of a drifting particle by the time of a find, per unit normal of
            the current's and of the wind's error, flat, shape (finds * (steps + 1) * 2,).
        sums: written: sums (east, north) [m] by particle and find, flat, shape (n * finds * 2,).
        seed0: first word of the run's key.
        seed1: second word of it.
    """
    for i in range(first, last):
        slot = number + i - first
        for m in range(2 * finds):
            sums[2 * finds * i + m] = 0.0
        for k in range(begins[i], steps):
            a = noise.further(seed0, seed1, noise.STREAM_STEP, slot, numbers[k], 0)
            b = noise.further(seed0, seed1, noise.STREAM_WIND, slot, numbers[k], 0)
            current, wind = noise.normals(a[2], a[3]), noise.normals(b[0], b[1])
            for f in range(finds):
                row = 2 * ((steps + 1) * f + k)
                moved = responses[row] * current + responses[row + 1] * wind
                sums[2 * (finds * i + f)] += moved[0]
                sums[2 * (finds * i + f) + 1] += moved[1]


@ti.kernel
def nudge(current: ti.f32, wind: ti.f32, begin: ti.i32, east: Reals, north: Reals, nudges: Reals):
    """Write or add the shift that one find causes in the normals of one step.

    Args:
        current: response of the current's error in this step [m].
        wind: response of the wind's error in it [m].
        begin: 1: write; 0: add to the present values.
        east: east component of each particle's pull towards the find [1/m], shape (n,).
        north: its north component.
        nudges: updated: shifts of the current's and the wind's normals, shape (4 n,) in rows
            NUDGES.
    """
    n = east.shape[0]
    for i in range(n):
        pull = ti.Vector([current * east[i], current * north[i], wind * east[i], wind * north[i]])
        for k in ti.static(range(4)):
            old = nudges[k * n + i]
            if begin == 1:
                old = 0.0
            nudges[k * n + i] = old + pull[k]
