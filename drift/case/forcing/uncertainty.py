"""How wrong winds and currents may be: the [uncertainty] table, and what holds where a case is
silent.

A default holds for a quantity that is read from gridded files of a model, and for no other: whoever
types a constant, or a table, knows how sure it is. Where each number comes from, and what to do
instead, is in docs/errors.md.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any

from pydantic import BeforeValidator

from drift.case.values import fields
from drift.engine.environment.forcing_spec import ForcingSpec
from drift.engine.motion.forcing_error import (
    CASE,
    DEFAULT,
    HOUR,
    MEMBERS,
    NOWHERE,
    RIVALS,
    ForcingError,
)
from geo.errors import UserError

# Residuals of two regional ocean models against 218 drifters (248 tracks) of MEOPAR-TREX 2020, one
# estuary, three weeks: 0.30 to 0.34 m/s a component, e-folding after 10 to 14 h, correlated by 0.07
# to 0.19 after 24 to 48 h. These have 0.32 m/s, 12 h, and 0.17 (24 h), 0.07 (48 h).
CURRENT = ForcingError(0.31, 11 * HOUR, 0.08, (DEFAULT, DEFAULT, DEFAULT))
# Between the random error of short forecasts and what searches have used (docs/errors.md).
WIND = ForcingError(2.0, 12 * HOUR, 0.0, (DEFAULT, DEFAULT, DEFAULT))
DIFFUSIVITY = 0.0  # [m2/s] none, as the residuals hold the motion of all scales already


class CurrentErrorTable(fields.Table):
    """The error of a current as written: what changes with a time, and what lasts."""

    std: fields.CurrentError | None = None
    time: fields.Duration | None = None
    bias: fields.CurrentError | None = None


class WindErrorTable(fields.Table):
    """The error of a wind as written."""

    std: fields.WindError | None = None
    time: fields.Duration | None = None


def _table(value: Any, none: dict[str, Any]) -> Any:
    """Return a table as it is, and the word "none" as the table that says so."""
    if not isinstance(value, str):
        return value
    if value == "none":
        return none
    raise ValueError(f'must be a table, or "none", not {value!r}')


class UncertaintyTable(fields.Table):
    """The [uncertainty] table as written; what it leaves out holds by default."""

    current: Annotated[
        CurrentErrorTable | None,
        BeforeValidator(lambda value: _table(value, {"std": 0, "bias": 0})),
    ] = None
    """The current's error, or `"none"`."""
    wind: Annotated[
        WindErrorTable | None, BeforeValidator(lambda value: _table(value, {"std": 0}))
    ] = None
    """The wind's error, or `"none"`."""
    diffusivity: fields.Diffusivity | None = None


Uncertainty = Annotated[
    UncertaintyTable,
    BeforeValidator(
        lambda value: _table(value, {"current": "none", "wind": "none", "diffusivity": 0})
    ),
]


def silent(specs: Sequence[ForcingSpec], used: Sequence[Sequence[str]]) -> str:
    """Return why no default holds for a quantity, "" where one does.

    used: the names of the sources of each scenario.
    """
    gridded = {
        spec.name
        for spec in specs
        if any(part.files or part.dataset is not None for part in spec.parts)
    }
    chosen = {tuple(name for name in names if name in gridded) for names in used} - {()}
    if not chosen:
        return NOWHERE
    if len(chosen) > 1:  # rivals, or members of an ensemble as scenarios, are spread by themselves
        return RIVALS
    return (
        MEMBERS if any(spec.members for spec in specs if spec.name in {*next(iter(chosen))}) else ""
    )


def error(
    table: CurrentErrorTable | WindErrorTable | None, default: ForcingError, reason: str, key: str
) -> ForcingError:
    """Return the error of a quantity: what the case says of it, and for the rest the default.

    reason: why no default holds, see `silent`. A table with a std states how large the error is: it
    has no bias but a stated one. Raises UserError where a table says nothing.
    """
    held = replace(default, std=0.0, bias=0.0, by=(reason, DEFAULT, reason)) if reason else default
    if table is None:
        return held
    bias = getattr(table, "bias", None)
    if table.std is None and bias is None and held.std == 0:
        raise UserError(
            f'uncertainty.{key}: has no std, and none holds by default ({reason}); give one, or write "none"'
        )
    if bias is None and table.std is not None:
        bias = 0.0
    std, std_by = (held.std, held.by[0]) if table.std is None else (table.std, CASE)
    time, time_by = (held.time, held.by[1]) if table.time is None else (table.time, CASE)
    bias, bias_by = (held.bias, held.by[2]) if bias is None else (bias, CASE)
    return ForcingError(std, time, bias, (std_by, time_by, bias_by))


def in_spill(
    current: ForcingError, table: CurrentErrorTable | None, bias: float | None
) -> ForcingError:
    """Return the error of a spill's current; bias: what its own key says [m/s], None if nothing.

    Raises UserError where [uncertainty] says so as well.
    """
    if bias is None:
        return current
    if table is not None and table.bias is not None:
        raise UserError(
            'spill.current_bias: uncertainty.current says the same ("none", or a bias): a bias is of the world in a '
            "spill; give it once"
        )
    return replace(current, bias=bias, by=(*current.by[:2], CASE))
