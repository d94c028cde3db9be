"""Where particles are inside a step that ended with them adrift: a Brownian bridge about the way of their drift.

The way of the drift alone would make the cloud of a random walk too narrow there.
"""

import numpy as np
import taichi as ti

from kernels import curve, noise, sphere
from kernels.coast import Coast, DeviceCoast, Ints, Reals, first_crossing, open_sea


@ti.kernel
def _between(
    coastal: ti.template(),
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
        # From a place inside the step the way leads on along the rest of the curve.
        off = curve.off_chord(own, whole[i]) - (1.0 - share[i]) * curve.off_chord(own, since[i])
        dlon = ti.cast(end_lon[i] - x, ti.f32) * share[i] + off[0]
        dlat = ti.cast(end_lat[i] - y, ti.f32) * share[i] + off[1]
        line_lon, line_lat = ti.cast(ti.round(dlon), ti.i32), ti.cast(ti.round(dlat), ti.i32)
        move_lon, move_lat = line_lon, line_lat
        if spread[i] > 0.0:
            w = noise.words(seed0, seed1, noise.STREAM_BRIDGE, slot[i], moment)
            n = noise.normals(w[0], w[1]) * (spread[i] * ti.f32(1.0 / (sphere.RADIUS * sphere.UNIT)))
            move_lon = ti.cast(ti.round(dlon + n[0] / sphere.cos_lat(y)), ti.i32)
            move_lat = ti.cast(ti.round(dlat + n[1]), ti.i32)
        if ti.static(coastal):
            hit, x_end, y_end = 1, x, y
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
) -> tuple[np.ndarray, np.ndarray]:
    """Return (lon, lat) [binary angle], shape (n,), at a share of the way from begin to end, in water.

    bend: of each particle's way in the step (kernels.curve), float32 (4 n,); the shares of that way at which `begin`
    lies and at which it is asked for, (n,) each. spread [m]: standard deviation of a component there; 0 keeps to the drift. slot: of each in the whole run,
    (n,); slot and moment are the key of its noise.
    """
    lon, lat = begin[0].copy(), begin[1].copy()
    shares = (share, *bend, spread)
    arrays = (lon, lat, *end, *(values.astype(np.float32) for values in shares), slot.astype(np.int32))
    _between(coast is not None, *arrays, *noise.key(seed), moment, (coast or open_sea()).pack)
    return lon, lat
