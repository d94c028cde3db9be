"""Errors of winds and currents: the [uncertainty] table, and the defaults.

A default error applies only to a quantity read from gridded model files. For a constant or a table
the user must state the error. docs/errors.md gives the source of each number and the alternatives.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any

from pydantic import BeforeValidator

from drift.case.values import fields
from drift.engine.environment.forcing_spec import ForcingSpec
from drift.engine.motion.errors.forcing_error import (
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
# estuary, three weeks: 0.30 to 0.34 m/s per component, e-folding time 10 to 14 h, correlation 0.07
# to 0.19 after 24 to 48 h. These values give 0.32 m/s, 12 h, and 0.17 (24 h), 0.07 (48 h).
# Their correlation over a distance d of 0.1 to 20 km is exp(-(d / 12.5 km)^1.5) within 0.04
# (docs/drifters.md).
CURRENT = ForcingError(0.31, 11 * HOUR, 0.08, (DEFAULT, DEFAULT, DEFAULT), 12_500.0)
# Between the random error of short forecasts and values used in searches (docs/errors.md).
# The length is a guess: errors of forecast winds go with their weather systems.
WIND = ForcingError(2.0, 12 * HOUR, 0.0, (DEFAULT, DEFAULT, DEFAULT), 100_000.0)
FEWEST, MOST = 3.0, 100.0  # degrees of freedom of a tail
DIFFUSIVITY = 0.0  # [m2/s] none, because the residuals already include motion of all scales


def _tail(value: object) -> float:
    """Return the degrees of freedom of a tail; inf for "none"."""
    if value == "none":
        return math.inf
    known = isinstance(value, int | float) and not isinstance(value, bool)
    if not known or not FEWEST <= value <= MOST:  # type: ignore[operator]
        raise ValueError(
            f'tail {value!r} must be "none" or degrees of freedom, {FEWEST:g} to {MOST:g}: the fewer, '
            "the heavier the tail"
        )
    return float(value)  # type: ignore[arg-type]


class CurrentErrorTable(fields.Table):
    """The error of a current as written: a time-correlated part and a constant bias."""

    std: fields.CurrentError | None = None
    time: fields.Duration | None = None
    bias: fields.CurrentError | None = None
    tail: Annotated[float, BeforeValidator(_tail)] | None = None
    """Degrees of freedom of the error's distribution, Student's, 3 to 100; `"none"`: a normal
    distribution. Each particle's `std` and `bias` then have a factor of its own, drawn once."""
    length: fields.Width | None = None
    """Distance over which the error is correlated, as exp(-(d / length)^1.5): the reach of a
    [[drifter]]'s track and of a [[report]]. Without them it has no effect."""


class WindErrorTable(fields.Table):
    """The error of a wind as written."""

    std: fields.WindError | None = None
    time: fields.Duration | None = None
    length: fields.Width | None = None
    """Distance over which the error is correlated, as for the current."""


def _table(value: Any, none: dict[str, Any], example: str = '{ std = "0.2 m/s" }') -> Any:
    """Replace the word "none" by the table of zero errors; return a table unchanged."""
    if not isinstance(value, str):
        return value
    if value == "none":
        return none
    raise ValueError(f'must be a table, like {example}, or "none", not {value!r}')


class UncertaintyTable(fields.Table):
    """The [uncertainty] table as written; missing keys have defaults."""

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
        lambda value: _table(
            value,
            {"current": "none", "wind": "none", "diffusivity": 0},
            '{ current = { std = "0.2 m/s" } }',
        )
    ),
]


def why_no_default(specs: Sequence[ForcingSpec], used: Sequence[Sequence[str]]) -> str:
    """Return the reason why a quantity has no default error; "" if it has one.

    Args:
        specs: the sources of the quantity.
        used: the names of the sources that each scenario uses.
    """
    gridded = {
        spec.name
        for spec in specs
        if any(part.files or part.dataset is not None for part in spec.parts)
    }
    chosen = {tuple(name for name in names if name in gridded) for names in used} - {()}
    if not chosen:
        return NOWHERE
    if len(chosen) > 1:  # the spread between rival models or members represents the error
        return RIVALS
    return (
        MEMBERS if any(spec.members for spec in specs if spec.name in {*next(iter(chosen))}) else ""
    )


def error(
    table: CurrentErrorTable | WindErrorTable | None, default: ForcingError, reason: str, key: str
) -> ForcingError:
    """Return the error of a quantity: the keys of the case, completed by the default.

    A table with `std` has no bias and no tail unless it states them.

    Args:
        table: the table of the case; None: it has none.
        default: the default error.
        reason: why there is no default (see `silent`); "": there is one.
        key: key of the quantity in [uncertainty], for the message.

    Raises:
        UserError: the table gives no size of the error, and there is no default.
    """
    default_or_none = (
        replace(default, std=0.0, bias=0.0, by=(reason, DEFAULT, reason)) if reason else default
    )
    if table is None:
        return default_or_none
    bias, tail = getattr(table, "bias", None), getattr(table, "tail", None)
    unsized = table.std is None and bias is None
    only_length = table.length is not None and table.time is None and tail is None
    if unsized and default_or_none.std == 0 and not only_length:
        raise UserError(
            f'uncertainty.{key}: has no std, and there is no default ({reason}); give one, or write "none"'
        )
    if bias is None and table.std is not None:
        bias = 0.0
    std, std_by = (
        (default_or_none.std, default_or_none.by[0]) if table.std is None else (table.std, CASE)
    )
    time, time_by = (
        (default_or_none.time, default_or_none.by[1]) if table.time is None else (table.time, CASE)
    )
    bias, bias_by = (default_or_none.bias, default_or_none.by[2]) if bias is None else (bias, CASE)
    length = default.length if table.length is None else table.length
    if tail is None:
        tail = default_or_none.tail if table.std is None else math.inf
    return ForcingError(std, time, bias, (std_by, time_by, bias_by), length, tail)


def no_tail_beside(what: str) -> str:
    """Return the message for a tail in a case whose errors are normal; what: the table of the case."""
    why = {
        "[spill]": "objects of one world share their errors, and these are normal",
        "[[drifter]]": "errors are conditioned on the drifters' tracks as normal ones",
        "[[report]]": "errors are conditioned on the reports as normal ones",
    }
    return f'uncertainty.current.tail: {why[what]}; leave tail out, or write tail = "none" ({what})'


def with_spill_bias(
    current: ForcingError, table: CurrentErrorTable | None, bias: float | None
) -> ForcingError:
    """Return the error of a spill's current, with the spill's own bias if it gives one.

    Args:
        current: the error of the current.
        table: its table in [uncertainty].
        bias: `spill.current_bias` [m/s]; None: not given.

    Raises:
        UserError: both tables give a bias.
    """
    if bias is None:
        return current
    if table is not None and table.bias is not None:
        raise UserError(
            'spill.current_bias: uncertainty.current gives a bias too ("none", or a value); a spill has one bias per '
            "world: give it once"
        )
    return replace(current, bias=bias, by=(*current.by[:2], CASE))
