"""Set of targets under way: the current that carries them off their dead-reckoned track.

A vessel that steers by dead reckoning heads and moves through the water as its itinerary says, and
the current at its true position carries it in addition: dX/dt = velocity through the water +
current(X, t). Its course is a compass course: at a higher latitude than reckoned, the same distance
east spans more longitude. The set is held constant over a step, at its value in the step's middle
(the explicit midpoint rule, of order 2).
"""

from typing import Any

import numpy as np
import taichi as ti

from kernels.maths import noise, sphere
from kernels.runtime import batch, rows, runtime
from kernels.runtime.batch import Batch
from kernels.steering import steer
from kernels.steering.steer import Own
from kernels.step import errors, life
from kernels.step.coast import Ints, Reals
from kernels.step.sample import Ranges, Sea, Tiles, members_of, sample
from kernels.step.velocity import CURRENT_FROM, CURRENT_TO

f32x2 = ti.types.vector(2, ti.f32)


@ti.kernel
def _feel(
    members: ti.template(),
    listed: ti.template(),
    first: ti.i32,
    last: ti.i32,
    slots: Ints,
    shift: Ints,
    columns: steer.Columns,
    error_rows: Reals,
    member: Ints,
    sea: Sea,
    lon: Ints,
    lat: Ints,
    east: Reals,
    north: Reals,
    std: ti.f32,
    memory: ti.f32,
    seed0: ti.u32,
    seed1: ti.u32,
    elapsed: ti.i32,
    duration: ti.i32,
    step: ti.i32,
    middle: ti.i32,
):
    for j in range(first, last):
        i = batch.slot(listed, slots, j)
        end = elapsed + duration
        begin, until = ti.max(elapsed, steer.departure(columns, i)), ti.min(end, columns.release[i])
        if steer.under_way(columns, i, end) and begin < until:
            dt = ti.cast(until - begin, ti.f32)
            n = columns.lon.shape[0]  # a row's length
            east_at, bias_at = errors.CURRENT_ERROR * n + i, errors.CURRENT_BIAS * n + i
            old = f32x2(error_rows[east_at], error_rows[east_at + n])
            error, since = old, ti.cast(begin - elapsed, ti.f32)
            if middle == 1:
                w = noise.noise_words(
                    seed0, seed1, noise.STREAM_FELT, i + shift[columns.scenario[i]], step
                )
                own_std = std * error_rows[errors.CURRENT_SCALE * n + i]
                new = errors.transition(
                    old, own_std, errors.kept(memory, dt), noise.normals(w[0], w[1])
                )
                error_rows[east_at], error_rows[east_at + n] = new[0], new[1]
                error, since = 0.5 * (old + new), since + 0.5 * dt
            fraction = since / ti.cast(duration, ti.f32)
            among = 0
            if ti.static(members):
                among = member[i]
            r = sample(
                members,
                sea,
                0,
                sea.ranges[CURRENT_FROM],
                sea.ranges[CURRENT_TO],
                lon[i],
                lat[i],
                fraction,
                among,
            )
            u, v = r[0] + error[0] + error_rows[bias_at], r[1] + error[1] + error_rows[bias_at + n]
            per_metre = ti.f32(1.0 / (sphere.RADIUS * sphere.UNIT))
            secant = 1.0 / sphere.cos_lat(lat[i])
            lon_at, lat_at = Own.SET_RATE_LON * n + i, Own.SET_RATE_LAT * n + i
            through = east[i] - columns.steer_real[lon_at] / (per_metre * secant)
            so_far = columns.steer_real[lat_at] * ti.cast(middle * (until - begin) // 2, ti.f32)
            set_lat = columns.steer_whole[Own.SET_LAT * n + i]
            reckoned = lat[i] - set_lat - ti.cast(ti.round(so_far), ti.i32)
            wider = through * (secant - 1.0 / sphere.cos_lat(reckoned))
            if r[2] > 0.5:
                columns.steer_real[lon_at] = (u * secant + wider) * per_metre
                columns.steer_real[lat_at] = v * per_metre
            elif middle == 1:
                columns.status[i], columns.status_since[i] = life.OUTSIDE, begin


def feel(
    columns,
    own: Batch,
    plan,
    seed: int,
    coast,
    error,
    tiles: Tiles,
    ranges: Ranges,
    std: float,
    memory: float,
    step: Any,
) -> None:
    """Write the velocity of each target's set for the step to be made; advance its current error.

    A target at a position without current data becomes OUTSIDE: it has no forcing.

    Args:
        columns: by name, those of kernels.steering.steer.COLUMNS; updated.
        own: the slots of steering targets.
        plan: see kernels.steering.steer.
        seed: of the run.
        coast: the coast; None: open sea.
        error: by name, the columns of errors.ROWS [m/s], float32 (n,), and of members if the tiles
            have any; updated.
        tiles: of the current over the step.
        ranges: first and last tile by quantity.
        std: standard deviation of a component of the current's error [m/s].
        memory: decorrelation time of the current's error [s].
        step: the step to be made.
    """
    for middle in (0, 1):
        lon, lat = runtime.copy(columns["lon"]), runtime.copy(columns["lat"])
        velocity = (
            runtime.upload(np.zeros(lon.shape[0], np.float32)),
            runtime.upload(np.zeros(lon.shape[0], np.float32)),
        )
        steer.inside(
            columns,
            own,
            plan,
            seed,
            None,
            coast,
            step,
            (lon, lat),
            step.elapsed,
            0,
            0,
            velocity,
            middle,
        )
        _feel(
            tiles.members > 1,
            *own.launched,
            steer.packed(columns),
            rows.whole(error, errors.ROWS),
            members_of(error, tiles),
            tiles.sea(ranges),
            lon,
            lat,
            *velocity,
            std,
            memory,
            *noise.key(seed),
            step.elapsed,
            step.duration,
            step.number,
            middle,
        )
