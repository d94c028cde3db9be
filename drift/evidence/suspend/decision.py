"""The basis of a decision to suspend: survival, areas searched, and the value of further search.

All probabilities are given that nothing has been found. Standard errors are sampling errors;
survival times are far less certain.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from drift.engine.motion.scenario import Scenario
from drift.engine.particles.status import ON_MAP
from drift.evidence.filter.standing import SearchStatus
from drift.evidence.filter.updates import (
    Update,
    Updates,
    displayed_scenarios_of,
    merge_unlikely_scenarios,
)
from drift.evidence.suspend import further as searching_on
from drift.evidence.suspend.alive import HOUR, alive_at, basis, seconds
from drift.evidence.suspend.further import GONE, Further, Planned
from drift.forecast import likeliest
from drift.forecast.effective import Count
from geo.array import Array

AHEAD = (0, 3, 6, 12, 24, 36, 48, 72, 96, 120, 168, 240, 336, 480, 720)  # [h] from now
CURVE = 160  # times of the curve


@dataclass(frozen=True)
class Suspension:
    """The basis of a decision; S scenarios, T times.

    Arrays of S + 1 end with all scenarios together.
    """

    now: np.datetime64  # of the last sortie or contact
    scenarios: tuple[str, ...]
    prior: Array  # (S,) probability of each scenario at the beginning
    share: Array  # (S,) probability of each scenario now
    bases: tuple[str | None, ...]  # (S,) survival times, in words; None: none, counts as alive
    times: Array  # (T,) datetime64, of the curve; from the earliest release
    alive: Array  # (T, S + 1) probability of being alive
    alive_error: Array  # (T, S + 1)
    # time, alive, alive_error at round times from now
    ahead: tuple[tuple[np.datetime64, Array, Array], ...]
    # sorties flown, and the area of each [m2], NaN without one
    sorties: tuple[tuple[Update, float], ...]
    cumulative: Array  # (S + 1,) POS of all sorties so far
    never: Array  # (S + 1,) probability of never having been in a searched area
    effective: float  # number of effective particles
    # a planned search, or days of effort as flown; empty: no effort to extrapolate
    further: tuple[Further, ...]
    how: str  # how `further` was computed
    # whether `further` is a plan, with drifting particles; otherwise days on a fixed map
    planned: bool

    @property
    def mortal(self) -> bool:
        """Whether any scenario has survival times."""
        return any(basis is not None for basis in self.bases)

    @property
    def count(self) -> Count:
        """Number of effective particles."""
        return Count(self.effective)

    def error(self, share: Array | float) -> Array:
        """Return the standard error of a probability."""
        return searching_on.standard_error(share, self.effective)


def build_decision(
    scenarios: Sequence[Scenario],
    start: np.datetime64,
    begun: SearchStatus,
    updates: Updates | None,
    data: xr.Dataset,
    plan: Planned | None = None,
) -> Suspension:
    """Return the basis of a decision to suspend.

    Args:
        scenarios: of the case.
        start: of the run.
        begun: status of the search before any update.
        updates: of the run; with a plan, those of its execution.
        data: maps of the forecast.
        plan: the planned sorties, which are not yet flown.
    """
    planned = plan.names if plan else frozenset()
    every = updates.all if updates else ()
    past = [update for update in every if update.kind != "sortie" or update.name not in planned]
    standing = past[-1].standing if past and past[-1].standing is not None else begun
    flown = {s.name: s for s in (updates.sorties if updates else ()) if s.name not in planned}
    searched = [update for update in past if update.kind == "sortie"]
    cumulative = searched[-1].cumulative if searched else None
    now = seconds(standing.time, start)
    hours = _hours_ahead(scenarios, standing, now)
    times, alive, alive_error = _curve(scenarios, standing, start, hours[-1])
    if plan:
        further, how = searching_on.by_plan(standing, plan, every, scenarios, start)
    else:
        further, how = searching_on.like_the_last(
            standing, scenarios, start, list(flown.values()), data
        )
    suspension = Suspension(
        now=standing.time,
        scenarios=tuple(scenario.name for scenario in scenarios),
        prior=begun.mass.sum(axis=1),
        share=standing.mass.sum(axis=1),
        bases=tuple(basis(scenario) for scenario in scenarios),
        times=times,
        alive=alive,
        alive_error=alive_error,
        ahead=tuple(
            (standing.time + np.timedelta64(h, "h"), *alive_at(scenarios, standing, now + HOUR * h))
            for h in hours
        ),
        sorties=tuple((u, searching_on.area(flown[u.name])) for u in searched if u.name in flown),
        cumulative=np.zeros(len(scenarios) + 1)
        if cumulative is None
        else np.asarray(cumulative, float),
        never=standing.never,
        effective=standing.effective,
        further=further,
        how=how,
        planned=plan is not None,
    )
    return _merge_unlikely(suspension, updates)


def _merge_unlikely(suspension: Suspension, updates: Updates | None) -> Suspension:
    """Return the basis with the likeliest scenarios alone and all others merged into one.

    With few scenarios, it is unchanged.
    """
    shown = (
        displayed_scenarios_of(updates)
        if updates
        else likeliest.likeliest_scenarios(suspension.prior)
    )
    if not shown.rest:
        return suspension
    weight, cumulative = suspension.share, suspension.cumulative
    if updates:
        names = {update.name for update, _ in suspension.sorties}
        flown = [
            u
            for u in merge_unlikely_scenarios(updates).all
            if u.name in names and u.cumulative is not None
        ]
        cumulative = np.asarray(flown[-1].cumulative) if flown else np.zeros(shown.size + 1)

    def mean(values: Array) -> Array:
        return np.concatenate([shown.means(values[..., :-1], weight), values[..., -1:]], axis=-1)

    def error(values: Array) -> Array:
        """Errors of scenarios are independent: their weighted squares add up."""
        parts = shown.sums((values[..., :-1] * weight) ** 2)
        return np.concatenate(
            [np.sqrt(parts) / np.maximum(shown.sums(weight), 1e-300), values[..., -1:]], axis=-1
        )

    return replace(
        suspension,
        scenarios=tuple(shown.names(suspension.scenarios)),
        prior=shown.sums(suspension.prior),
        share=shown.sums(suspension.share),
        bases=(
            *(suspension.bases[k] for k in shown.alone),
            _basis([suspension.bases[k] for k in shown.rest]),
        ),
        alive=mean(suspension.alive),
        alive_error=error(suspension.alive_error),
        ahead=tuple((time, mean(chance), error(wrong)) for time, chance, wrong in suspension.ahead),
        cumulative=cumulative,
        never=mean(suspension.never),
    )


def _basis(bases: Sequence[str | None]) -> str | None:
    """Return the survival times of several scenarios in words, None if none has any."""
    known = {words for words in bases if words is not None}
    without = sum(words is None for words in bases)
    if not known:
        return None
    words = known.pop() if len(known) == 1 else f"{len(known)} different survival times"
    return f"{words}; {without} of them have none: persons there stay alive" if without else words


def _hours_ahead(scenarios: Sequence[Scenario], standing: SearchStatus, now: float) -> list[int]:
    """Return the hours of AHEAD at which the probability of being alive still falls noticeably.

    now: [s after start].
    """
    alive = [float(alive_at(scenarios, standing, now + HOUR * h)[0][-1]) for h in AHEAD]
    falls = [
        h
        for h, chance, before in zip(AHEAD[1:], alive[1:], alive[:-1], strict=True)
        if chance >= GONE and before - chance >= GONE / 10
    ]
    return [0, *[h for h in AHEAD[1:] if h <= max(falls, default=0)]]


def _curve(
    scenarios: Sequence[Scenario], standing: SearchStatus, start: np.datetime64, last: int
) -> tuple[Array, Array, Array]:
    """Return times (T,), the probability of being alive at each, and its error (T, S + 1).

    The times run from the first release to the hour of AHEAD that follows `last` [h from now].
    """
    now = seconds(standing.time, start)
    end = HOUR * max(min([h for h in AHEAD if h > last], default=last), 6)
    first = min(float(standing.release[standing.mass > 0].min()), now)
    at = np.linspace(first, now + end, CURVE)
    alive, error = zip(*(alive_at(scenarios, standing, t) for t in at), strict=True)
    times = start.astype("datetime64[s]") + np.rint(at).astype("timedelta64[s]")
    return times, np.array(alive), np.array(error)


def summary_of_decision(suspension: Suspension) -> dict[str, Any]:
    """Return the basis of the decision for the summary."""
    return {
        "now": suspension.now,
        "alive": [
            {"time": time, "probability": float(alive[-1]), "standard_error": float(error[-1])}
            for time, alive, error in suspension.ahead
        ]
        if suspension.mortal
        else None,
        "never_searched": float(suspension.never[-1]),
        "effective_particles": suspension.effective,
        "further": [
            {
                "until": end.until,
                "pos": end.pos,
                "pos_se": end.pos_error,
                "found_alive": end.alive,
                "found_alive_se": end.alive_error,
            }
            for end in suspension.further
        ],
        "further_from": suspension.how,
    }


def off_map(data: xr.Dataset) -> float:
    """Return the probability of particles on no map at the end of the run.

    They have left the domain or the forcing, have sunk, or are not released.
    """
    status = data["status_probability"].isel(time=-1)
    shown = [code.name.lower() for code in ON_MAP if code.name.lower() in status["status"].values]
    return float(status.sum()) - float(status.sel(status=shown).sum())
