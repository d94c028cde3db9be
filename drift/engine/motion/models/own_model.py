"""A motion model from a user-defined function of current, wind and waves.

It is the drift model (drift.engine.motion.models.drift) with the function in place of leeway. Forcing
errors, random walk and coast are unchanged. The function's parameters are stored in the columns of
the leeway lines.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from drift.engine.motion.errors.forcing_error import Errors
from drift.engine.motion.models import drift
from drift.engine.motion.models.model import Group, Key, Model, Waters
from drift.engine.motion.models.own_motion import MOST, OwnMotion
from drift.engine.motion.scenario import Scenario
from drift.engine.particles.ensemble import Ensemble, Slots
from geo.array import Array
from geo.errors import UserError
from kernels.step import advance as kernel
from kernels.step import own_velocity
from kernels.step import prior as draws

# Columns that hold the parameters, in their order: a user's model does not jibe, so its particles
# stay on the right side.
COLUMNS = ("down_slope", "down_offset", "right_slope", "right_offset")
SPARE = "left_offset"  # leeway column that this model does not read
CURRENTS = (0.0, 1.0, 2.5)  # [m/s] currents in which a function's highest speed is evaluated
DIRECTIONS = np.radians(np.arange(0, 360, 45))
WINDS = 24  # number of wind speeds, from 0 to the highest, for that evaluation
WAVES = (0.0, 0.02)  # Stokes drift as shares of the wind, for that evaluation
LATITUDES = np.radians([-75.0, -45.0, -15.0, 0.1, 15.0, 45.0, 75.0])


def model(own: OwnMotion) -> Model:
    """Return the model of a file; the same model for any parameters, so that one launch moves all
    its scenarios.

    Raises:
        UserError: if the file has changed since it was read, or its function fails.
    """
    return _model(own.path, own.digest, own.by_latitude)


@lru_cache(maxsize=64)
def _model(path: Path, digest: str, by_latitude: bool) -> Model:
    function = own_velocity.load(path, digest)
    return replace(
        drift.DRIFT,
        draw=_draw,
        mover=partial(_mover, own_velocity.in_sea(function, by_latitude)),
        usual=lambda scenario, wind: _fastest(scenario.motion, function, wind, 0.0),
        fastest=lambda scenario, wind, spreads: _fastest(scenario.motion, function, wind, spreads),
    )


def _draw(ensemble: Ensemble, slots: Slots, key: Key, scenario: Scenario, errors: Errors) -> None:
    """Draw each particle's parameters and its initial forcing errors."""
    parameters = scenario.motion.parameters
    for number, (parameter, name) in enumerate(zip(parameters, COLUMNS, strict=False)):
        column, spare = ensemble.own[name], ensemble.own[SPARE]
        draws.draw_object(
            *slots, column, spare, number, *key, parameter.mean, 0.0, parameter.std, 0.0, -np.inf
        )
    drift.draw_errors(ensemble, slots, key, errors)


def _mover(
    velocity: Any, ensemble: Ensemble, group: Group, waters: Waters, direction: int, bend: Any
) -> kernel.Move:
    """Return the function that moves a group of scenarios over a step: see kernels.step.advance."""
    return kernel.mover(
        ensemble,
        group.batch,
        waters.tiles,
        waters.ranges,
        group.terms,
        waters.place,
        direction,
        velocity,
        bend,
        parameters=True,
    )


def _fastest(own: OwnMotion, function: Callable[..., Any], wind: float, spreads: float) -> float:
    """Return the highest speed through the water [m/s] of the function in winds up to `wind` [m/s].

    spreads: number of standard deviations by which parameters vary about their means.
    """
    ways = [
        p.mean + p.std * spreads * np.array([-1.0, 0.0, 1.0] if p.std * spreads else [0.0])
        for p in own.parameters
    ]
    parameters = np.array(list(product(*ways, *[[0.0]] * (MOST - len(ways)))))
    toward = np.column_stack([np.sin(DIRECTIONS), np.cos(DIRECTIONS)])
    currents = np.vstack([speed * toward[:1] for speed in CURRENTS])
    winds = np.vstack([speed * toward for speed in np.linspace(0.0, wind, WINDS)])
    asked = [np.concatenate(row) for row in product(currents, winds, parameters)]
    current, blown, chosen = np.split(np.array(asked), [2, 4], axis=1)
    speeds = [
        _speeds(own, function, (current, blown, share * blown, chosen), latitude)
        for latitude in LATITUDES
        for share in WAVES
    ]
    return float(np.max(speeds))


def _speeds(
    own: OwnMotion,
    function: Callable[..., Any],
    given: tuple[Array, Array, Array, Array],
    latitude: float,
) -> Array:
    """Return speeds through the water [m/s] (n,); raise UserError if one is not a finite number.

    given: the function's current, wind and waves, (n, 2) each, and parameters (n, 4).
    """
    current, wind, _, parameters = given
    try:
        way = own_velocity.through_water(function, own.by_latitude, *given, latitude)
    except Exception as error:  # any error that Taichi raises for a function it cannot compile
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        raise UserError(
            f"{own.path.name}: velocity can't be compiled ({lines[-1] if lines else error}); it must return two numbers, "
            "east and north, as docs/howto/model.md describes"
        ) from error
    speed: Array = np.hypot(way[:, 0], way[:, 1])
    if not np.isfinite(speed).all():
        k = int(np.argmin(np.isfinite(speed)))
        named = ", ".join(
            f"{p.name} {value:g}" for p, value in zip(own.parameters, parameters[k], strict=False)
        )
        raise UserError(
            f"{own.path.name}: velocity is not a finite number in a current of {np.hypot(*current[k]):.3g} m/s and a wind of "
            f"{np.hypot(*wind[k]):.3g} m/s at {np.degrees(latitude):.0f} degrees{', with ' + named if named else ''}"
        )
    return speed
