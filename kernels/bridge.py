"""Where particles are inside a step that ended with them adrift: a Brownian bridge about the way of their drift.

The way of the drift alone would make the cloud of a random walk too narrow there.
"""

import numpy as np
import taichi as ti

from kernels import curve, noise, sphere
from kernels.coast import POLEWARD, Coast, DeviceCoast, Ints, Reals, first_crossing, open_sea


@ti.kernel
def _between(
    coastal: ti.template(),
    polar: ti.template(),
    lon: Ints,
    lat: Ints,
    end_lon: Ints,
    end_lat: Ints,
    share: Reals,
    bend: Reals,
    since: Reals,
    whole: Reals,
    spread: Reals,
    slot: Ints,
    seed0: ti.u32,
    seed1: ti.u32,
    moment: ti.i32,
    coast: Coast,
):
    for i in range(lon.shape[0]):
        x, y = lon[i], lat[i]
        own = curve.f32x4([bend[4 * i + k] for k in ti.static(range(4))])
        # From a position inside the step the track continues along the rest of the curve.
        off = curve.off_chord(own, whole[i]) - (1.0 - share[i]) * curve.off_chord(own, since[i])
        way = curve.inside(polar, x, y, end_lon[i], end_lat[i], share[i], off)
        x_line, y_line = curve.moved(polar, x, y, way)
        line_lon, line_lat = x_line - x, y_line - y
        move_lon, move_lat = line_lon, line_lat
        if spread[i] > 0.0:
            w = noise.words(seed0, seed1, noise.STREAM_BRIDGE, slot[i], moment)
            n = noise.normals(w[0], w[1]) * spread[i]
            if ti.static(not polar):
                n *= ti.f32(1.0 / (sphere.RADIUS * sphere.UNIT))
                n[0] /= sphere.cos_lat(y)
            x_line, y_line = curve.moved(polar, x, y, way + n)
            move_lon, move_lat = x_line - x, y_line - y
        if ti.static(coastal):
            hit, x_end, y_end = 1, x, y
            if ti.static(polar):
                if ti.min(ti.abs(y), ti.abs(y_line)) > POLEWARD:
                    hit, x_end, y_end = 0, x_line, y_line
            for _ in range(2):
                if hit == 1:
                    hit, x_end, y_end, _p, _e = first_crossing(x, y, move_lon, move_lat, coast)
                    # If it hits, keep to the drift; where that leads round a cape, to the water before it.
                    move_lon, move_lat = line_lon, line_lat
            lon[i], lat[i] = x_end, y_end
        else:
            lon[i], lat[i] = x + move_lon, y + move_lat


def between(
    begin: tuple[np.ndarray, np.ndarray],
    end: tuple[np.ndarray, np.ndarray],
    share: np.ndarray,
    bend: tuple[np.ndarray, np.ndarray, np.ndarray],
    spread: np.ndarray,
    slot: np.ndarray,
    seed: int,
    moment: int,
    coast: DeviceCoast | None,
    polar: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (lon, lat) [binary angle], shape (n,), at a share of the way from begin to end, in water.

    bend: of each particle's way in the step (kernels.curve), float32 (4 n,); the shares of that way at which `begin`
    lies and at which it is asked for, (n,) each. spread [m]: standard deviation of a component there; 0 keeps to the
    drift. slot: of each in the whole run, (n,); slot and moment are the key of its noise. polar: whether the domain
    holds a pole.
    """
    lon, lat = begin[0].copy(), begin[1].copy()
    shares = (share, *bend, spread)
    arrays = (lon, lat, *end, *(values.astype(np.float32) for values in shares), slot.astype(np.int32))
    _between(coast is not None, polar, *arrays, *noise.key(seed), moment, (coast or open_sea()).pack)
    return lon, lat
