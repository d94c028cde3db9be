"""Position inside a step: the cubic of a Runge-Kutta step, as a departure from its chord.

Let k1 and k4 be the displacements over the whole step at the velocity of its first and its last
stage, and M the displacement of the step. The continuous extension of third order of the classical
scheme (Zennaro 1986, doi:10.1090/S0025-5718-1986-0815835-4; Hairer, Norsett and Wanner 1993, II.6)
is the cubic Hermite interpolant with the end slopes k1 and k4. With d0 = k1 - M and d1 = k4 - M it
departs from the chord, at a share s of the path, by

    b(s) = s (1 - s)^2 d0 - s^2 (1 - s) d1

It costs no further stage. If the forcing is linear in time and uniform in space, it is exact.

A `bend` is (d0 lon, d0 lat, d1 lon, d1 lat) [binary angle units]. In a domain with a pole, chords
are great circles and a bend is (d0 east, d0 north, d1 east, d1 north) [m], rotated to the meridian
of 0: see kernels.maths.sphere.meridian.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import taichi as ti

from kernels.maths import sphere
from kernels.runtime import launch, runtime
from kernels.step import life
from kernels.step.coast import Ints, Reals

MOST = 4.0 / 27.0  # the largest value of s (1 - s)^2
CHORD = 5.0  # [m] a path that departs from its chord by less counts as straight

Inside = Callable[[tuple[Any, Any], int, int, int], tuple[np.ndarray, np.ndarray]]
f32x2 = ti.types.vector(2, ti.f32)
f32x4 = ti.types.vector(4, ti.f32)


def edges(elapsed: int, duration: int, pieces: int) -> list[int]:
    """Return the begin of each straight piece of a step and, last, its end [s after the start]."""
    return [elapsed + duration * k // pieces for k in range(pieces + 1)]


@ti.func
def off_chord(bend: f32x4, share: ti.f32) -> f32x2:
    """Return the departure (lon, lat) of a path from its chord at a share of it.

    It is in binary angle units.
    """
    a, b = share * (1.0 - share) * (1.0 - share), share * share * (1.0 - share)
    return f32x2(a * bend[0] - b * bend[2], a * bend[1] - b * bend[3])


@ti.func
def _slope_off_chord(bend: f32x4, share: ti.f32) -> f32x2:
    """Return the derivative of `off_chord` by the share."""
    a, b = (1.0 - share) * (1.0 - 3.0 * share), share * (2.0 - 3.0 * share)
    return f32x2(a * bend[0] - b * bend[2], a * bend[1] - b * bend[3])


@ti.func
def cut_short(bend: f32x4, part: ti.f32) -> f32x4:
    """Return the bend of a track that ends after a part of the step."""
    end, slope = off_chord(bend, part), _slope_off_chord(bend, part)
    return f32x4(
        part * bend[0] - end[0],
        part * bend[1] - end[1],
        part * slope[0] - end[0],
        part * slope[1] - end[1],
    )


@ti.func
def bulge(bend: f32x4) -> f32x2:
    """Return an upper bound of the (lon, lat) distance of a track from its chord.

    It is at most 1.2 times the true maximum.
    """
    return MOST * f32x2(ti.abs(bend[0]) + ti.abs(bend[2]), ti.abs(bend[1]) + ti.abs(bend[3]))


@ti.func
def pieces(bend: f32x4, c: ti.f32, most: ti.i32) -> ti.i32:
    """Return the number of pieces of a path so that each is straight within CHORD.

    c: cosine of the latitude; most: upper bound of the number.
    """
    off = bulge(bend) * ti.f32(sphere.RADIUS * sphere.UNIT)
    far = ti.sqrt(off[0] * off[0] * c * c + off[1] * off[1])
    return ti.min(ti.max(ti.cast(ti.ceil(ti.sqrt(far * ti.f32(1.0 / CHORD))), ti.i32), 1), most)


def slopes(bend: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return `_slope_off_chord` on the host: lon, lat, (n,); bend: (4 n,), share: (n,)."""
    each = bend.astype(np.float64).reshape(-1, 4)
    a, b = (1.0 - share) * (1.0 - 3.0 * share), share * (2.0 - 3.0 * share)
    return a * each[:, 0] - b * each[:, 2], a * each[:, 1] - b * each[:, 3]


@ti.func
def inside(
    polar: ti.template(),
    lon: ti.i32,
    lat: ti.i32,
    to_lon: ti.i32,
    to_lat: ti.i32,
    share: ti.f32,
    off: f32x2,
) -> f32x2:
    """Return the displacement of a path from (lon, lat) at a share of it.

    off: its departure from its chord there. Both are (lon, lat) [binary angle units], in a domain
    with a pole (east, north) [m].
    """
    led = f32x2(ti.cast(to_lon - lon, ti.f32), ti.cast(to_lat - lat, ti.f32)) * share + off
    if ti.static(polar):
        led = sphere.offset(lon, lat, to_lon, to_lat) * share + sphere.carried_on(
            off, sphere.meridian(lon, lat)
        )
    return led


@ti.func
def end_of_way(polar: ti.template(), lon: ti.i32, lat: ti.i32, way: f32x2):
    """Return (lon, lat) after a displacement as `inside` returns it."""
    x, y = lon, lat
    if ti.static(polar):
        x, y = sphere.exponential(lon, lat, way[0], way[1])
    else:
        x, y = lon + ti.cast(ti.round(way[0]), ti.i32), lat + ti.cast(ti.round(way[1]), ti.i32)
    return x, y


@ti.kernel
def _places(
    polar: ti.template(),
    before_lon: Ints,
    before_lat: Ints,
    lon: Ints,
    lat: Ints,
    bend: Reals,
    status: Ints,
    release: Ints,
    status_since: Ints,
    moving_since: Ints,
    elapsed: ti.i32,
    duration: ti.i32,
    time: ti.i32,
    at_lon: Ints,
    at_lat: Ints,
):
    for i in range(lon.shape[0]):
        times = life.behind(
            status[i], release[i], status_since[i], moving_since[i], elapsed, duration
        )
        left, finish = times[1], times[2]
        share = ti.cast(time - left, ti.f32) / ti.max(ti.cast(finish - left, ti.f32), 1.0)
        x, y = before_lon[i], before_lat[i]
        if share >= 1.0:
            x, y = lon[i], lat[i]
        elif share > 0.0:
            off = off_chord(f32x4([bend[4 * i + k] for k in ti.static(range(4))]), share)
            x, y = end_of_way(polar, x, y, inside(polar, x, y, lon[i], lat[i], share, off))
        at_lon[i], at_lat[i] = x, y


def places(
    ensemble: Any,
    before: tuple[Any, Any],
    bend: Any,
    elapsed: int,
    duration: int,
    time: int,
    polar: bool = False,
) -> tuple[Any, Any]:
    """Return the positions of drifting particles at a time inside the last step, without noise.

    The noise inside the step is that of kernels.step.bridge.

    Args:
        ensemble: a drift.engine.particles.ensemble.Ensemble of n particles, after the step.
        before: lon and lat at the begin of the step [binary angle, int32], on the device, shape
            (n,) each.
        bend: of each particle's path, float32 on the device, shape (4 n,).
        elapsed: begin of the step [s after the run's start].
        duration: of the step [s].
        time: [s after the run's start].
        polar: whether the domain holds a pole.

    Returns:
        lon and lat [binary angle, int32], on the device, shape (n,) each.
    """
    e, at = ensemble, (runtime.empty(ensemble.n, ti.i32), runtime.empty(ensemble.n, ti.i32))
    _places(
        polar,
        *before,
        e.lon,
        e.lat,
        bend,
        e.status,
        e.release,
        e.status_since,
        e.moving_since,
        elapsed,
        duration,
        time,
        *at,
    )
    return at


def bind_places(ensemble: Any, bend: Any, polar: bool) -> Inside:
    """Return `places` for repeated calls with one ensemble, on the host: a sixth of the time.

    Args:
        ensemble: as for `places`.
        bend: as for `places`.
        polar: as for `places`.

    Returns:
        A function of (before, elapsed, duration, time), as `places` takes them, which returns lon
        and lat [binary angle, int32], shape (n,) each.
    """
    e = ensemble
    begin, at = (tuple(runtime.empty(e.n, ti.i32) for _ in range(2)) for _ in range(2))
    columns = e.lon, e.lat, bend, e.status, e.release, e.status_since, e.moving_since
    args = (polar, *begin, *columns, 0, 0, 0, *at)
    launched = launch.bind(_places, args, ("elapsed", "duration", "time"))

    def inside(
        before: tuple[Any, Any], elapsed: int, duration: int, time: int
    ) -> tuple[np.ndarray, np.ndarray]:
        for own, given in zip(begin, before, strict=True):
            runtime.copy(given, into=own)
        launched(elapsed, duration, time)
        return at[0].to_numpy(), at[1].to_numpy()

    return inside
