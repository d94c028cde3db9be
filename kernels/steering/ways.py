"""Paths of steering targets: rhumb lines, great circles, and Brownian bridges about great circles.

Nunez, Singham and Atkinson 2020, doi:10.1080/01605682.2019.1570806, give the bridge in the plane.
On a sphere of radius R the same distribution holds along the path. Across it, great circles from
one place converge again: the deviation of a bridge from X at t to P at T has variance K^2 dt sin(b)
sin(a - b) / ((a - b) sin(a)) after dt, where a is the angle from X to P and b = a (T - t - dt) / (T
- t) the remaining angle. Both distributions are exact for any dt.
"""

import taichi as ti

from kernels.maths import angles, sphere

f32x2 = ti.types.vector(2, ti.f32)

SHORT = 1e-3  # [rad] shorter paths count as flat: the curvature's share of a variance is below 1e-6


@ti.func
def rhumb(lon: ti.i32, lat: ti.i32, course: ti.f32, distance: ti.f32):
    """Return (lon, lat) [binary angle] after a distance [m] on a constant course [rad from north].

    Longitude grows with the mean of 1 / cos(lat) along the path, by Simpson's rule: for 500 km at
    60 degrees the error is 1e-5 of the distance. A path across a pole ends on it.
    """
    arc = distance * ti.f32(1.0 / (sphere.RADIUS * sphere.UNIT))
    quarter = ti.cast(sphere.QUARTER, ti.f32) - 64.0
    s, c = angles.sincos(course)
    rise = ti.min(ti.max(arc * c, -quarter - ti.cast(lat, ti.f32)), quarter - ti.cast(lat, ti.f32))
    end, middle = lat + ti.cast(ti.round(rise), ti.i32), lat + ti.cast(ti.round(0.5 * rise), ti.i32)
    secant = (
        1.0 / sphere.cos_lat(lat) + 4.0 / sphere.cos_lat(middle) + 1.0 / sphere.cos_lat(end)
    ) * ti.f32(1.0 / 6.0)
    east = ti.cast(ti.round(arc * s * secant), ti.i64)
    return lon + ti.cast(east, ti.i32), end


@ti.func
def toward(
    lon: ti.i32,
    lat: ti.i32,
    to_lon: ti.i32,
    to_lat: ti.i32,
    dt: ti.f32,
    rest: ti.f32,
    k: ti.f32,
    normal: f32x2,
):
    """Return (lon, lat) [binary angle] dt [s] later, on a path that lasts dt + rest [s].

    The path ends at (to_lon, to_lat). k [m/sqrt(s)]: K of the bridge; 0: the target keeps to the
    great circle. normal: two standard normal numbers, along and across the path.
    """
    share = dt / (dt + rest)
    x, y = lon, lat
    a = ti.f32(0.0)
    # First along the path, then off it: in a loop, so that the long formulas are compiled once.
    for stage in range(2 if k > 0.0 and rest > 0.0 else 1):
        way = sphere.offset(x, y, to_lon, to_lat)
        length = ti.sqrt(way[0] * way[0] + way[1] * way[1])
        east, north = share * way[0], share * way[1]
        if stage == 0:
            a = length * ti.f32(1.0 / sphere.RADIUS)
        else:
            b = a * (1.0 - share)
            across = 1.0 - share
            if a > SHORT:
                across = angles.sin(b) * angles.sin(a - b) / ((a - b) * angles.sin(a))
            along = k * ti.sqrt(dt * (1.0 - share)) * normal[0]
            aside = k * ti.sqrt(dt * ti.max(across, 0.0)) * normal[1]
            ahead = f32x2(0.0, 1.0)
            if length > 1.0:
                ahead = way / length
            east, north = along * ahead[0] + aside * ahead[1], along * ahead[1] - aside * ahead[0]
        x, y = sphere.exponential(x, y, east, north)
    return x, y
