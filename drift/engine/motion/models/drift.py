"""The drift model: current, Stokes drift, leeway, and the errors of each.

Breivik and Allen 2008, doi:10.1016/j.jmarsys.2007.02.010; docs/leeway.md, docs/errors.md. Every
particle has its own three leeway lines, its own side of the wind, and its current values of the
current and wind errors.
"""

import math
from typing import Any

import numpy as np

from drift.engine.motion import changes
from drift.engine.motion.errors.forcing_error import Errors, ForcingError
from drift.engine.motion.models.model import Group, Key, Model, Waters
from drift.engine.motion.objects.leeway import Drifter
from drift.engine.motion.scenario import Scenario
from drift.engine.particles.ensemble import Column, Ensemble, Slots
from kernels.runtime import rows
from kernels.step import advance as kernel
from kernels.step import bridge
from kernels.step import errors as errors_of
from kernels.step import prior as draws
from kernels.step.advance import Physics
from kernels.step.bridge import Inside

LEEWAY = kernel.LEEWAY
ERRORS = errors_of.ROWS  # columns of errors of the forcing
_MEANING = {
    "current_error": "Ornstein-Uhlenbeck error of the current now",
    "wind_error": "Ornstein-Uhlenbeck error of the wind now",
    "current_bias": "constant error of the current: its own, or in a spill its world's",
}
_SCALE = Column(
    "current_scale", np.float32, 1, "", "factor of its errors of the current: their tail", "errors"
)
COLUMNS = (
    Column("side", np.int32, 1, "", "+1 drifts to the right of the wind, -1 to the left"),
    *(
        Column(
            name,
            np.float32,
            0,
            "" if "slope" in name else "m/s",
            "leeway line: speed per wind speed, or offset",
            "leeway",
        )
        for name in LEEWAY
    ),
    *(
        Column(
            name,
            np.float32,
            0,
            "m/s",
            "the same, north" if name.endswith("north") else _MEANING[name[:-5]],
            "errors",
        )
        for name in ERRORS
        if name != _SCALE.name
    ),
    _SCALE,
)


def _physics(errors: Errors, scenario: Scenario) -> Physics:
    """Return a scenario's physics; an error with zero standard deviation is off."""
    current, wind = (
        errors.current,
        errors.wind if scenario.uses_wind else ForcingError(0.0, 1.0),
    )
    return Physics(
        current.std,
        current.time,
        wind.std,
        wind.time,
        errors.diffusivity,
        scenario.jibe_rate,
        float(current.tailed),
    )


def _draw_objects(
    ensemble: Ensemble, slots: Slots, key: Key, scenario: Scenario, errors: Errors
) -> None:
    """Draw each particle's leeway, its waits for changes of state, and its initial errors of current
    and wind.
    """
    draw_leeway(ensemble, slots, key, scenario.object)
    changes.draw(ensemble, slots, key, scenario.changes)
    draw_errors(ensemble, slots, key, errors)


def draw_leeway(ensemble: Ensemble, slots: Slots, key: Key, drifter: Drifter) -> None:
    """Draw each particle's leeway lines and its first side of the wind.

    A particle's downwind slope is negative only if its line's slope is.
    """
    own = ensemble.own
    for number, name in enumerate(("down", "right", "left")):
        line = getattr(drifter, name)
        slope, offset = own[f"{name}_slope"], own[f"{name}_offset"]
        least = 0.0 if name == "down" and line.slope >= 0 else -np.inf
        draws.draw_object(
            *slots,
            slope,
            offset,
            number,
            *key,
            line.slope,
            line.offset,
            line.slope_std,
            line.offset_std,
            least,
        )
    draws.draw_side(*slots, own["side"], *key)


def draw_errors(ensemble: Ensemble, slots: Slots, key: Key, errors: Errors) -> None:
    """Draw each particle's initial errors of current and wind, its bias, and its scale."""
    for number, (name, std) in enumerate(
        (
            ("current_error", errors.current.std),
            ("wind_error", errors.wind.std),
            ("current_bias", errors.current.bias),
        )
    ):
        east, north = ensemble.own[f"{name}_east"], ensemble.own[f"{name}_north"]
        draws.draw_error(*slots, east, north, number, *key, std)
    if errors.current.tailed:
        error_rows = rows.whole(ensemble.own, ERRORS)
        errors_of.draw_scales(*slots, error_rows, *key, errors.current.tail)


def mover(
    ensemble: Ensemble, group: Group, waters: Waters, direction: int, bend: Any
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
        bend=bend,
    )


def between(
    ensemble: Ensemble,
    terms: tuple[Physics | None, ...],
    place: kernel.Surroundings,
    inside: Inside,
) -> None:
    """Move positions to a time inside a step by a Brownian bridge about the drift.

    The variance of a component at share s of a track that takes T is 2 D s (1 - s) T.
    """
    diffusivity = np.array([term.diffusivity if term else -1.0 for term in terms])
    shift = ensemble.batch(range(len(terms))).shift
    bridge.between(ensemble, inside, diffusivity, shift, place.coast, place.polar)


def longest(errors: Errors) -> dict[str, float]:
    """Return the longest step [s] that each error process allows: a sixth of its decorrelation
    time.
    """
    return {
        f"a sixth of the decorrelation time of the {name}'s errors": error.time / 6
        if error.std > 0
        else np.inf
        for name, error in (("current", errors.current), ("wind", errors.wind))
    }


def usual(drifter: Drifter, wind: float) -> float:
    """Return an object's typical speed through the water in a wind [m/s], from its steepest leeway
    line.
    """
    return max(abs(line.slope) for line in (drifter.down, drifter.right, drifter.left)) * wind


def fastest(drifter: Drifter, wind: float, spreads: float) -> float:
    """Return the speed through the water [m/s] that no particle of an object exceeds in a wind
    [m/s].

    spreads: number of standard deviations of the leeway lines that are drawn.
    """
    line = max(
        (abs(line.slope) + spreads * line.slope_std) * wind
        + abs(line.offset)
        + spreads * line.offset_std
        for line in (drifter.down, drifter.right, drifter.left)
    )
    return line * math.sqrt(2)  # down and across the wind


DRIFT: Model = Model(
    forced=True,
    columns=COLUMNS,
    terms=_physics,
    draw=_draw_objects,
    mover=mover,
    between=between,
    longest=longest,
    usual=lambda scenario, wind: max(usual(one, wind) for one in scenario.objects),
    fastest=lambda scenario, wind, spreads: max(
        fastest(one, wind, spreads) for one in scenario.objects
    ),
)
