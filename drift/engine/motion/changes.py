"""Changes of state of particles on the way: their columns, waits, states and survival.

kernels.step.change makes the changes. State 0 is the object as it went adrift, state k + 1 what
change k of its scenario leads to.
"""

import itertools
from collections.abc import Sequence

import numpy as np

from drift.engine.motion.objects.leeway import Drifter, Line
from drift.engine.motion.scenario import UNCHANGED, Change, Scenario, Survival
from drift.engine.motion.steering.itinerary import Spread
from drift.engine.particles.ensemble import Column, Ensemble, Slots
from geo.array import Array
from kernels.maths import noise
from kernels.step import change as kernel

STATE = "state"  # column of the present state
LEAST = -1e30  # least slope of a line whose slopes may have any sign
NEVER = 3e9  # [s] later than any change
NO_LAW = Spread(0.0, 0.0, 0.0)


def columns(changes: Sequence[Change]) -> tuple[Column, ...]:
    """Return the columns of a scenario with changes: rows after those of the leeway lines."""
    if not changes:
        return ()
    own = [Column(STATE, np.float32, 0, "", "what has become of the object: 0 unchanged", "leeway")]
    for number in range(1, len(changes) + 1):
        came = "when the change to this state came"
        wait = "how long, or for how much hazard, it waits for this change"
        own.append(Column(f"changed_{number}", np.float32, NEVER, "s", came, "leeway"))
        own.append(Column(f"wait_{number}", np.float32, NEVER, "s", wait, "leeway"))
    return tuple(own)


def rows(changes: Sequence[Change]) -> tuple[tuple[float, ...], ...]:
    """Return the changes of a scenario as kernels.step.change reads them."""
    return tuple(_row(one) for one in changes)


def _row(one: Change) -> tuple[float, ...]:
    still = Line()
    new = one.object or Drifter("", "", still, still, still)
    comes = kernel.BY_WIND if one.wind else kernel.AT_RATE
    if one.time is not None:
        comes = kernel.AFTER if one.after else kernel.AT
    keeps = 0.0 if one.object else one.leeway
    lines: list[float] = []
    for line in (new.down, new.right, new.left):
        least = 0.0 if line is new.down and line.slope >= 0 else LEAST
        lines += [line.slope, line.offset, line.slope_std, line.offset_std, least]
    leaves = sum(1 << state for state in one.leaves)
    return (leaves, comes, one.rate, *(one.wind or (0.0, 1.0)), float(one.sinks), keeps, *lines)


def draw(ensemble: Ensemble, slots: Slots, key: tuple[int, int], changes: Sequence[Change]) -> None:
    """Draw the waits of a scenario's particles for its changes."""
    for number, one in enumerate(changes):
        _draw_wait(ensemble, slots, key, number, one, 0)


def _draw_wait(
    ensemble: Ensemble, slots: Slots, key: tuple[int, int], number: int, one: Change, time: int
) -> None:
    law, mean = one.time or NO_LAW, 0.0
    if one.time is None:
        mean = 1.0 if one.wind else 1.0 / one.rate
    shape = law.low, law.high, law.mode, 2 / (1 + law.ratio)
    kernel.draw_wait(slots, ensemble.own[f"wait_{number + 1}"], key, number, time, mean, shape)


def draw_again(ensemble: Ensemble, scenarios: Sequence[Scenario], time: int) -> None:
    """Draw the waits for changes that come at a rate again, after resampling.

    Such a wait has no memory, so that copies may wait each for itself. Times that were drawn are
    those of the copies too.

    Args:
        ensemble: resampled, with its new layout.
        scenarios: of the run.
        time: of the resampling [s after start].
    """
    key = noise.key(ensemble.seed)
    for scenario, slots in zip(scenarios, ensemble.slots, strict=True):
        for number, one in enumerate(scenario.changes):
            if not one.memoryless or slots.first == slots.last:
                continue
            _draw_wait(ensemble, slots, key, number, one, max(time, 1))


def any_changes(scenarios: Sequence[Scenario]) -> bool:
    """Return whether the state of any scenario's object may change."""
    return any(scenario.changes for scenario in scenarios)


def state_at(ensemble: Ensemble, time: float, *, afloat: Sequence[Scenario] = ()) -> Array:
    """Return the state of each particle at a time up to the end of the last step, int (n,).

    The column of the state is that at the end of the step, which may be later. afloat: scenarios of
    the run; then, of those that have sunk, the last state before.
    """
    state, latest = np.zeros(ensemble.n, np.int64), np.full(ensemble.n, -np.inf)
    scenario = ensemble.scenario.to_numpy()
    for number in itertools.takewhile(
        lambda number: f"changed_{number}" in ensemble.own, itertools.count(1)
    ):
        came = ensemble.own[f"changed_{number}"].to_numpy()
        now = (came <= time) & (came >= latest)
        if afloat:
            sinks = [len(own.changes) >= number and own.changes[number - 1].sinks for own in afloat]
            now &= ~np.array(sinks)[scenario]
        state, latest = np.where(now, number, state), np.where(now, came, latest)
    return state


def names_of(scenarios: Sequence[Scenario]) -> tuple[str, ...]:
    """Return the names of all states of some scenarios, each once: the unchanged one first."""
    return tuple(dict.fromkeys([UNCHANGED, *(c.name for s in scenarios for c in s.changes)]))


def numbered(scenarios: Sequence[Scenario]) -> Array:
    """Return the number of each scenario's states among `names_of`, int (scenarios, states); -1:
    the scenario has no such state.
    """
    names, most = names_of(scenarios), max(len(scenario.changes) for scenario in scenarios)
    table = np.full((len(scenarios), most + 1), -1)
    for row, scenario in zip(table, scenarios, strict=True):
        own = (UNCHANGED, *(one.name for one in scenario.changes))
        row[: len(own)] = [names.index(name) for name in own]
    return table


def survival_clocks(
    ensemble: Ensemble, scenarios: Sequence[Scenario], time: float
) -> tuple[Array, Array]:
    """Return from when each particle's survival time counts, and which of its scenario's it is.

    The probability of being alive at a time is the product over the survival times that have held
    so far, each for as long as it held. The release returned is the one from which the present
    survival time alone has that probability at `time`. Without a change of survival it is the
    release.

    Args:
        ensemble: with the columns of changes.
        scenarios: of the run.
        time: [s after start].

    Returns:
        Times of release [s after start], float64 (n,), and indices in `Scenario.survivals`, (n,).
    """
    release = ensemble.release.to_numpy().astype(np.float64)
    law = np.zeros(ensemble.n, np.int64)
    for scenario, slots in zip(scenarios, ensemble.slots, strict=True):
        given = [number for number, one in enumerate(scenario.survivals) if one is not None]
        if len(given) < 2:
            continue
        own = slice(slots.first, slots.last)
        began = np.stack(
            [
                (ensemble.own[f"changed_{number}"].to_numpy() if number else release)[own]
                for number in given
            ]
        ).astype(np.float64)
        release[own], chosen = _present_law(
            [one for one in scenario.survivals if one is not None], began, time
        )
        law[own] = np.array(given)[chosen]
    return release, law


def _present_law(laws: Sequence[Survival], began: Array, time: float) -> tuple[Array, Array]:
    """Return `survival_clocks` of particles by when each of some survival times began to hold.

    began: [s after start], (laws, n); the first one's is the release.
    """
    from scipy import special  # imported here: it takes a third of a second

    log_alive = np.zeros(began.shape[1])
    for law, start in zip(laws, began, strict=True):
        until = np.minimum(np.where(began > start, began, np.inf).min(axis=0), time)
        lasts = np.maximum(until - start, 0.0)
        with np.errstate(divide="ignore"):
            log_alive += np.log(law.alive(lasts))
    present = np.where(began <= time, began, -np.inf).argmax(axis=0)
    # at most 1 - 1e-16: a clock of no age has no logarithm
    z = -special.ndtri(np.clip(np.exp(log_alive), 1e-300, 1 - 1e-16))
    medians, spreads = np.array([[law.median, law.spread] for law in laws])[present].T
    release = np.where(present > 0, time - medians * spreads**z, began[0])
    return release, present
