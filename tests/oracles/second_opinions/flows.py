"""Flows whose tracks are known: closed forms, or an independent integrator of high order in
float64.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import taichi as ti
from scipy.integrate import solve_ivp

from geo import sphere
from kernels.step.velocity import f32x3

T = ti.template()
DEG = np.pi / 180
AXIS = (40 * DEG, 50 * DEG)  # (lon, lat) of the axis of the solid rotation [rad]
SIN_AXIS, COS_AXIS = float(np.sin(AXIS[1])), float(np.cos(AXIS[1]))
OMEGA = 2 * np.pi / 172_800  # [rad/s] a turn in two days
INERTIAL = 1.2e-4  # [rad/s]
SPEED = 0.8  # [m/s]
GYRE = (-40 * DEG, 35 * DEG, 3 * DEG)  # (lon, lat) of the centre and size [rad]
PSI = 2.0e5  # [m2/s]


@ti.func
def solid_rotation(features: T, sea: T, own: T, lon, lat, fraction):
    """East and north of a rigid rotation about AXIS: v = omega x r."""
    x, y = ti.cast(lon, ti.f32) * ti.f32(sphere.UNIT), ti.cast(lat, ti.f32) * ti.f32(sphere.UNIT)
    d = x - ti.f32(AXIS[0])
    k = ti.f32(OMEGA * sphere.RADIUS)
    u = k * (SIN_AXIS * ti.cos(y) - COS_AXIS * ti.sin(y) * ti.cos(d))
    return f32x3(u, k * COS_AXIS * ti.sin(d), 1.0)


@ti.func
def inertial(features: T, sea: T, own: T, lon, lat, fraction):
    """A velocity that turns clockwise with time; the time of the step comes in as the blend of tile
    0.
    """
    t = sea.scale[4] + sea.scale[5] * fraction
    return f32x3(SPEED * ti.cos(INERTIAL * t), -SPEED * ti.sin(INERTIAL * t), 1.0)


@ti.func
def stommel(features: T, sea: T, own: T, lon, lat, fraction):
    """psi = PSI sin(X)^2 sin(Y), intensified towards the west as Stommel's gyre is; free of
    divergence on the sphere.
    """
    x = (ti.cast(lon, ti.f32) * ti.f32(sphere.UNIT) - ti.f32(GYRE[0])) / ti.f32(GYRE[2])
    lat_rad = ti.cast(lat, ti.f32) * ti.f32(sphere.UNIT)
    y = (lat_rad - ti.f32(GYRE[1])) / ti.f32(GYRE[2])
    k = ti.f32(PSI / (sphere.RADIUS * GYRE[2]))
    e = ti.exp(-0.7 * x)
    u = -k * e * ti.cos(x) * ti.cos(y)
    v = k * e * (-ti.sin(x) - 0.7 * ti.cos(x)) * ti.sin(y) / ti.cos(lat_rad)
    return f32x3(u, v, 1.0)


def _rotated(lon: np.ndarray, lat: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
    """Rodrigues' rotation of unit vectors about AXIS by OMEGA t."""
    r = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    k = np.array(
        [np.cos(AXIS[1]) * np.cos(AXIS[0]), np.cos(AXIS[1]) * np.sin(AXIS[0]), np.sin(AXIS[1])]
    )[:, None]
    a = OMEGA * t
    turned = (
        r * np.cos(a) + np.cross(k, r, axis=0) * np.sin(a) + k * (k * r).sum(0) * (1 - np.cos(a))
    )
    return np.arctan2(turned[1], turned[0]), np.arcsin(turned[2])


def _integrated(
    velocity: Callable, lon: np.ndarray, lat: np.ndarray, t: float
) -> tuple[np.ndarray, np.ndarray]:
    """Dormand and Prince's order 8 in float64 on dlon/dt, dlat/dt."""
    n = lon.size

    def rate(time: float, state: np.ndarray) -> np.ndarray:
        u, v = velocity(state[:n], state[n:], time)
        return np.concatenate([u / (sphere.RADIUS * np.cos(state[n:])), v / sphere.RADIUS])

    end = solve_ivp(rate, (0, t), np.concatenate([lon, lat]), "DOP853", rtol=1e-12, atol=1e-14).y[
        :, -1
    ]
    return end[:n], end[n:]


def _inertial64(lon, lat, t):
    return SPEED * np.cos(INERTIAL * t) + 0 * lon, -SPEED * np.sin(INERTIAL * t) + 0 * lon


def _stommel64(lon, lat, t):
    x, y, k = (lon - GYRE[0]) / GYRE[2], (lat - GYRE[1]) / GYRE[2], PSI / (sphere.RADIUS * GYRE[2])
    e = np.exp(-0.7 * x)
    return -k * e * np.cos(x) * np.cos(y), k * e * (-np.sin(x) - 0.7 * np.cos(x)) * np.sin(
        y
    ) / np.cos(lat)


@dataclass(frozen=True)
class Flow:
    """A velocity function for the kernel, its exact track, where to start [deg], and how long and
    finely to step [s].
    """

    name: str
    velocity: Callable
    exact: Callable
    lon: tuple[float, ...]
    lat: tuple[float, ...]
    duration: int
    steps: dict[str, tuple[int, ...]]


FLOWS = [
    Flow(
        "solid rotation",
        solid_rotation,
        _rotated,
        (43.0, 38.0, 40.0),
        (51.0, 49.0, 47.5),
        172_800,
        {"rk4": (21_600, 14_400, 10_800, 7_200), "rk2": (7_200, 3_600, 1_800)},
    ),
    Flow(
        "inertial oscillation",
        inertial,
        lambda lon, lat, t: _integrated(_inertial64, lon, lat, t),
        (179.99, -20.0, 5.0),
        (60.0, -35.0, 1.0),
        43_200,
        {"rk4": (21_600, 14_400, 10_800), "rk2": (5_400, 2_700, 1_350)},
    ),
    Flow(
        "Stommel gyre",
        stommel,
        lambda lon, lat, t: _integrated(_stommel64, lon, lat, t),
        (-41.0, -39.0, -40.3),
        (36.0, 35.2, 33.8),
        1_036_800,
        {"rk4": (172_800, 129_600, 86_400, 64_800), "rk2": (43_200, 21_600, 10_800)},
    ),
]
