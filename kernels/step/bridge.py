"""Positions inside a step: a Brownian bridge around the drift's path, ending at the step's end.

Positions on the drift's path alone would make the cloud of a random walk too narrow there.
"""

from typing import Any, NamedTuple

import numpy as np
import taichi as ti

from kernels.maths import noise, sphere
from kernels.runtime import runtime
from kernels.step import curve, life
from kernels.step.coast import POLEWARD, Coast, DeviceCoast, Ints, Reals, first_crossing, open_sea


class Inside(NamedTuple):
    """A time inside the last step, and the particles' positions at an earlier time in it."""

    # [binary angle] positions at `since`, int32 (n,) on the device; updated to those at `time`
    lon: Any
    lat: Any
    # departure of each path of the whole step from its chord (kernels.step.curve), float32 (4 n,),
    # on the device
    bend: Any
    begin: int  # [s after the run's start] of the step
    end: int
    since: int
    time: int
    seed: int
    moment: int  # together with seed and slot, the key of the noise at that time


@ti.func
def _covered(left: ti.i32, finish: ti.i32, time: ti.i32) -> ti.f32:
    """Return the share, 0 to 1, of a path from `left` to `finish` [s] that is covered by a time."""
    lasting = ti.cast(ti.max(finish - left, 1), ti.f32)
    return ti.min(ti.max(ti.cast(time - left, ti.f32) / lasting, 0.0), 1.0)


@ti.func
def _starts(begin: ti.i32, finish: ti.i32, release: ti.i32, moving_since: ti.i32) -> ti.i32:
    """Return when [s] a particle begins to move after `begin`; finish: when it stops."""
    left = ti.max(begin, release)
    if moving_since < finish:
        left = ti.max(left, moving_since)
    return left


@ti.kernel
def _between(
    coastal: ti.template(),
    polar: ti.template(),
    lon: Ints,
    lat: Ints,
    end_lon: Ints,
    end_lat: Ints,
    status: Ints,
    release: Ints,
    status_since: Ints,
    moving_since: Ints,
    scenario: Ints,
    bend: Reals,
    diffusivity: Reals,
    shift: Ints,
    begin: ti.i32,
    end: ti.i32,
    since: ti.i32,
    time: ti.i32,
    seed0: ti.u32,
    seed1: ti.u32,
    moment: ti.i32,
    coast: Coast,
):
    for i in range(lon.shape[0]):
        spreads = diffusivity[scenario[i]]
        if spreads >= 0.0:
            finish = end
            if status[i] != life.ADRIFT:
                finish = ti.min(status_since[i], end)
            first = _starts(begin, finish, release[i], moving_since[i])
            left = _starts(since, finish, release[i], moving_since[i])
            share = _covered(left, finish, time)
            spread = 0.0
            if status[i] == life.ADRIFT:
                spread = ti.sqrt(
                    2.0
                    * spreads
                    * share
                    * (1.0 - share)
                    * ti.cast(ti.max(finish - left, 1), ti.f32)
                )
            x, y = lon[i], lat[i]
            own = curve.f32x4([bend[4 * i + k] for k in ti.static(range(4))])
            # From a position inside the step, the track continues along the rest of the curve.
            off = curve.off_chord(own, _covered(first, finish, time))
            off -= (1.0 - share) * curve.off_chord(own, _covered(first, finish, since))
            way = curve.inside(polar, x, y, end_lon[i], end_lat[i], share, off)
            x_line, y_line = curve.end_of_way(polar, x, y, way)
            line_lon, line_lat = x_line - x, y_line - y
            move_lon, move_lat = line_lon, line_lat
            if spread > 0.0:
                w = noise.noise_words(
                    seed0, seed1, noise.STREAM_BRIDGE, i + shift[scenario[i]], moment
                )
                n = noise.normals(w[0], w[1]) * spread
                if ti.static(not polar):
                    n *= ti.f32(1.0 / (sphere.RADIUS * sphere.UNIT))
                    n[0] /= sphere.cos_lat(y)
                x_line, y_line = curve.end_of_way(polar, x, y, way + n)
                move_lon, move_lat = x_line - x, y_line - y
            if ti.static(coastal):
                hit, x_end, y_end = 1, x, y
                if ti.static(polar):
                    if ti.min(ti.abs(y), ti.abs(y_line)) > POLEWARD:
                        hit, x_end, y_end = 0, x_line, y_line
                for _ in range(2):
                    if hit == 1:
                        hit, x_end, y_end, _p, _e = first_crossing(x, y, move_lon, move_lat, coast)
                        # If it hits the coast, use the drift alone; if that hits a cape, stop in
                        # the water before it.
                        move_lon, move_lat = line_lon, line_lat
                lon[i], lat[i] = x_end, y_end
            else:
                lon[i], lat[i] = x + move_lon, y + move_lat


def between(
    ensemble: Any,
    inside: Inside,
    diffusivity: np.ndarray,
    shift: Any,
    coast: DeviceCoast | None,
    polar: bool = False,
) -> None:
    """Move positions from a time inside the last step to a later one, in place, keeping to water.

    Args:
        ensemble: a drift.engine.particles.ensemble.Ensemble, after the step.
        inside: the times and the positions.
        diffusivity: [m2/s] by scenario; negative: leave its particles where they are.
        shift: from slots to their numbers in the whole run, by scenario (kernels.runtime.batch).
        coast: the coast; None: open sea.
        polar: whether the domain holds a pole.
    """
    e, own = ensemble, inside
    columns = (
        e.lon,
        e.lat,
        e.status,
        e.release,
        e.status_since,
        e.moving_since,
        e.scenario,
        own.bend,
    )
    table = runtime.upload(np.asarray(diffusivity, np.float32))
    times = own.begin, own.end, own.since, own.time
    key = *noise.key(own.seed), own.moment
    _between(
        coast is not None,
        polar,
        own.lon,
        own.lat,
        *columns,
        table,
        shift,
        *times,
        *key,
        (coast or open_sea()).pack,
    )
