"""Noise that guides particles toward finds: projections of it, and nudges added to it.

A guided particle's errors of current and wind keep the numbers of their streams (kernels.noise), to
whose standard normals a shift is added. drift.search.guide chooses the shift, and weighs the particle
for it. Here the normals of all steps are summed, each times how far it moves what drifts by the time
of a find; and the shift of one step is computed from a particle's pull toward each find.
"""

from collections.abc import Mapping
from typing import Any

import taichi as ti

from kernels import noise, runtime
from kernels.coast import Ints, Reals

# Columns of an ensemble: what is added to the present step's normals [1].
NUDGES = ("nudge_current_east", "nudge_current_north", "nudge_wind_east", "nudge_wind_north")

f32x2 = ti.types.vector(2, ti.f32)


def nudges_of(columns: Mapping[str, Any], guided: bool) -> tuple[Any, ...]:
    """Return the columns of nudges, float32 (n,), where particles are guided; else ones never read, (1,)."""
    if guided:
        return tuple(columns[name] for name in NUDGES)
    unread = runtime.empty(1, ti.f32)
    return (unread,) * len(NUDGES)


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
        numbers: of the step of each row, the key of its noise, shape (steps,).
        steps: number of rows.
        finds: number of finds.
        responses: metres that a unit normal of the current's and of the wind's error moves what
            drifts by the time of a find, flat, shape (finds * (steps + 1) * 2,).
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
def nudge(
    current: ti.f32,
    wind: ti.f32,
    begin: ti.i32,
    east: Reals,
    north: Reals,
    current_east: Reals,
    current_north: Reals,
    wind_east: Reals,
    wind_north: Reals,
):
    """Write what one find adds to the normals of one step, or add it where another find has begun.

    Args:
        current: response of the current's error in this step [m].
        wind: response of the wind's error in it [m].
        begin: 1: write; 0: add to the present values.
        east: pull of each particle toward the find [1/m], shape (n,).
        north: its other component.
        current_east: written: shift of the current's normals, shape (n,).
        current_north: its other component.
        wind_east: written: shift of the wind's normals, shape (n,).
        wind_north: its other component.
    """
    for i in range(east.shape[0]):
        old = ti.Vector([current_east[i], current_north[i], wind_east[i], wind_north[i]])
        if begin == 1:
            old = ti.Vector([0.0, 0.0, 0.0, 0.0])
        current_east[i], current_north[i] = old[0] + current * east[i], old[1] + current * north[i]
        wind_east[i], wind_north[i] = old[2] + wind * east[i], old[3] + wind * north[i]
