"""User-defined velocities: a function in a Python file that replaces leeway.

Loading the file executes it: it is trusted as much as this program.
"""

import hashlib
import inspect
import sys
from collections.abc import Callable
from importlib import util
from pathlib import Path
from typing import Any

import numpy as np
import taichi as ti

from geo.array import Array
from geo.errors import UserError
from kernels.step.coast import Reals
from kernels.step.features import CURRENT, STOKES, WIND
from kernels.step.velocity import CURRENT_FROM, STOKES_FROM, WIND_FROM, forcing_at

FUNCTION = "velocity"  # name of the function in the file
RADIANS = np.pi / 2**31  # radians per unit of binary angle
COLUMNS = 10  # arguments of the function: current, wind, waves (two each), parameters (four)

f32x2 = ti.types.vector(2, ti.f32)
f32x3 = ti.types.vector(3, ti.f32)
f32x4 = ti.types.vector(4, ti.f32)


def load(path: Path, digest: str) -> Callable[..., Any]:
    """Return the function of a user's file, compiled for kernels.

    Args:
        path: of the file.
        digest: SHA-256 of its bytes, part of its module's name: a changed file becomes another
            module.

    Raises:
        UserError: the file has changed, or executing it fails.
    """
    try:
        same = hashlib.sha256(path.read_bytes()).hexdigest() == digest
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}; the case names it as its drift model") from None
    if not same:
        raise UserError(f"{path.name} has changed since the case was read; read the case again")
    name = f"drift_model_{digest[:16]}"
    spec = util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = util.module_from_spec(spec)
    sys.modules[name] = module  # the compiler looks up the function's names there
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:  # whatever a user's file raises
        del sys.modules[name]
        words = " ".join(str(error).split())
        raise UserError(
            f"{path.name}: running it failed: {type(error).__name__}: {words}"
        ) from error
    for own, value in list(vars(module).items()):
        if (
            inspect.isfunction(value)
            and value.__module__ == name
            and not hasattr(value, "_is_taichi_function")
        ):
            setattr(module, own, ti.func(value))
    return getattr(module, FUNCTION)


@ti.func
def _asked(
    function: ti.template(),
    by_latitude: ti.template(),
    current: f32x2,
    wind: f32x2,
    waves: f32x2,
    parameters: f32x4,
    latitude: ti.f32,
):
    """Return the result of a user's function; latitude [rad], if the function takes it."""
    if ti.static(by_latitude):
        return function(current, wind, waves, parameters, latitude)
    else:
        return function(current, wind, waves, parameters)


def in_sea(function: Callable[..., Any], by_latitude: bool) -> Any:
    """Return a velocity field, as kernels.step.advance.mover takes it, from a user's function.

    by_latitude: whether the function takes the latitude [rad] besides current, wind, waves and
    parameters. Errors of the forcing are added to the current and the wind that the function
    receives.
    """

    @ti.func
    def velocity(
        features: ti.template(),
        sea: ti.template(),
        own: ti.template(),
        lon: ti.i32,
        lat: ti.i32,
        fraction: ti.f32,
    ) -> f32x3:
        current, wind = f32x2(own.error[0], own.error[1]), f32x2(own.error[2], own.error[3])
        waves, valid = f32x2(0.0), 1.0
        if ti.static(features & CURRENT):
            c = forcing_at(features, sea, own, CURRENT_FROM, lon, lat, fraction)
            current, valid = current + f32x2(c[0], c[1]), c[2]
        if ti.static(features & STOKES):
            s = forcing_at(features, sea, own, STOKES_FROM, lon, lat, fraction)
            waves, valid = f32x2(s[0], s[1]), valid * s[2]
        if ti.static(features & WIND):
            w = forcing_at(features, sea, own, WIND_FROM, lon, lat, fraction)
            wind, valid = wind + f32x2(w[0], w[1]), valid * w[2]
        latitude = ti.cast(lat, ti.f32) * ti.f32(RADIANS)
        way = _asked(function, by_latitude, current, wind, waves, own.line, latitude)
        return f32x3(way[0], way[1], valid)

    return velocity


@ti.kernel
def _through(
    function: ti.template(), by_latitude: ti.template(), given: Reals, way: Reals, latitude: ti.f32
):
    for i in range(way.shape[0] >> 1):
        row = [given[COLUMNS * i + k] for k in ti.static(range(COLUMNS))]
        current, wind, waves = f32x2(row[0], row[1]), f32x2(row[2], row[3]), f32x2(row[4], row[5])
        parameters = f32x4(row[6], row[7], row[8], row[9])
        got = _asked(function, by_latitude, current, wind, waves, parameters, latitude)
        two = f32x2(0.0)
        two = got  # fails unless the result is a vector of two numbers
        way[2 * i], way[2 * i + 1] = got[0] - current[0], two[1] - current[1]


def through_water(
    function: Callable[..., Any],
    by_latitude: bool,
    current: Array,
    wind: Array,
    waves: Array,
    parameters: Array,
    latitude: float,
) -> Array:
    """Return the velocity relative to the current [m/s] (n, 2) of a user's function.

    Args:
        function: as `load` returns it.
        by_latitude: whether it takes the latitude.
        current: [m/s] east, north (n, 2).
        wind: [m/s] east, north (n, 2).
        waves: Stokes drift [m/s] east, north (n, 2).
        parameters: (n, 4).
        latitude: [rad].
    """
    given = np.hstack([current, wind, waves, parameters]).astype(np.float32)
    way = np.zeros((len(given), 2), np.float32)
    _through(function, by_latitude, given.ravel(), way.ravel(), latitude)
    return way.astype(np.float64)
