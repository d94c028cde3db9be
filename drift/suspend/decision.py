"""What a decision to suspend a search rests on: who may still be alive, what has been searched, what another day could add.

All is given that nothing has been found. Standard errors are of the particles alone, not of the survival times, which
are less sure than these. The further days are a rough figure, neither a plan nor a bound: random search, its effort
divided without limit where it adds most (Koopman 1980, Search and Screening, ch. 3; Charnes and Cooper 1958), on one
map, which is held while the object drifts on. What that does to them is not known, and is more than what the particles
do: their text and picture bear no error. Within a scenario, when the object went adrift is taken to tell nothing of
where it is.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
import xarray as xr

from drift.forecast.effective import Count
from drift.motion.scenario import Scenario
from drift.search.records import Sortie
from drift.search.standing import Standing
from drift.search.updates import Update, Updates
from geo import sphere
from geo.array import Array
from geo.polyline import Area

HOUR, DAY = 3600.0, 86_400.0  # [s]
ACROSS = 80  # cells along the longer side of the map on which further days are reckoned
DAYS = 7  # that are told at most
STEPS = 24  # of a day, within each of which the chance of being alive is that of its middle
GONE = 0.005  # probability of being alive under which a further time or day is told no more
AHEAD = (0, 3, 6, 12, 24, 36, 48, 72, 96, 120, 168, 240, 336, 480, 720)  # [h] from now that are told
CURVE = 160  # times of the curve


@dataclass(frozen=True)
class Planned:
    """Sorties that are still to be flown, where the forecast is that of their failure."""

    names: frozenset[str]
    end: np.datetime64  # when the last of them ends


@dataclass(frozen=True)
class Further:
    """What searching on until a time would come to, counted from now; errors are standard errors."""

    until: np.datetime64
    pos: float  # probability that the object is found by then
    pos_error: float
    alive: float  # and that it is found alive
    alive_error: float
    waiting: float  # probability of being alive then and not found


@dataclass(frozen=True)
class Suspension:
    """All that is told. Arrays by scenario have one more entry, of all together; T times."""

    now: np.datetime64  # of the last sortie or contact
    scenarios: tuple[str, ...]
    prior: Array  # (S,) probability of each scenario at the beginning
    share: Array  # (S,) and now
    bases: tuple[str | None, ...]  # (S,) survival times, in words; None: not told, counts as alive
    times: Array  # (T,) datetime64, of the curve; from when the first may have gone adrift
    alive: Array  # (T, S + 1) probability of being alive
    alive_error: Array
    ahead: tuple[tuple[np.datetime64, Array, Array], ...]  # round times from now, the same there
    sorties: tuple[tuple[Update, float], ...]  # what was flown, and the area of each [m2], NaN without one
    cumulative: Array  # (S + 1,) POS of all sorties so far
    never: Array  # (S + 1,) probability of having been where no sortie searched
    effective: float  # particles that it stands on
    further: tuple[Further, ...]  # a planned search, or days of effort as flown; empty: nothing to go by
    how: str  # what `further` is made from
    planned: bool  # it is a plan, on particles that drift on: not days on a map that is held
    standing: Standing

    @property
    def mortal(self) -> bool:
        """Whether any scenario has survival times."""
        return any(basis is not None for basis in self.bases)

    @property
    def count(self) -> Count:
        """How many particles it stands on."""
        return Count(self.effective)

    def error(self, share: Array | float) -> Array:
        """Return the standard error of a probability seen in the particles that count, not of 0 where it is 0 or 1."""
        known = (np.asarray(share) * self.effective + 1) / (self.effective + 2)
        return np.asarray(np.sqrt(known * (1 - known) / (self.effective + 2)))


def build(
    scenarios: Sequence[Scenario],
    start: np.datetime64,
    begun: Standing,
    updates: Updates | None,
    data: xr.Dataset,
    plan: Planned | None = None,
) -> Suspension:
    """Return what a decision rests on; begun: how the search stood before any update; data: the forecast's maps.

    With a plan, updates are those of its execution: what is flown by it is still to come.
    """
    planned = plan.names if plan else frozenset()
    every = updates.all if updates else ()
    known = [update for update in every if update.kind == "contact" or update.name not in planned]
    here = known[-1].standing if known and known[-1].standing is not None else begun
    sorties = updates.sorties if updates else ()
    flown = {sortie.name: sortie for sortie in sorties if sortie.name not in planned}
    done = [update for update in known if update.kind == "sortie"]
    last = done[-1].cumulative if done else None
    names = tuple(scenario.name for scenario in scenarios)
    told = Suspension(
        now=here.time,
        scenarios=names,
        prior=begun.mass.sum(axis=1),
        share=here.mass.sum(axis=1),
        bases=tuple(basis(scenario) for scenario in scenarios),
        times=np.array([]),
        alive=np.array([]),
        alive_error=np.array([]),
        ahead=(),
        sorties=tuple((update, area(flown[update.name])) for update in done if update.name in flown),
        cumulative=np.zeros(len(names) + 1) if last is None else np.asarray(last, float),
        never=here.never,
        effective=here.effective,
        further=(),
        how="",
        planned=plan is not None,
        standing=here,
    )
    now = _seconds(here.time, start)
    chances = [float(alive_at(scenarios, here, now + HOUR * h)[0][-1]) for h in AHEAD]
    falls = [
        h
        for h, p, before in zip(AHEAD[1:], chances[1:], chances[:-1], strict=True)
        if p >= GONE and before - p >= GONE / 10
    ]
    ahead = [0, *[h for h in AHEAD[1:] if h <= max(falls, default=0)]]
    end = HOUR * max(min([h for h in AHEAD if h > ahead[-1]], default=ahead[-1]), 6)
    first = min(float(here.release[here.mass > 0].min()), now)
    seconds = np.linspace(first, now + end, CURVE)
    curve = [alive_at(scenarios, here, t) for t in seconds]
    further, how = _planned(told, plan, every, scenarios, start) if plan else _days(told, scenarios, start, flown, data)
    return replace(
        told,
        times=start.astype("datetime64[s]") + np.rint(seconds).astype("timedelta64[s]"),
        alive=np.array([mean for mean, _ in curve]),
        alive_error=np.array([error for _, error in curve]),
        ahead=tuple((told.now + np.timedelta64(h, "h"), *alive_at(scenarios, here, now + HOUR * h)) for h in ahead),
        further=further,
        how=how,
    )


def numbers(told: Suspension) -> dict[str, Any]:
    """Return what the summary holds of it."""
    return {
        "now": told.now,
        "alive": [{"time": t, "probability": float(p[-1]), "standard_error": float(e[-1])} for t, p, e in told.ahead]
        if told.mortal
        else None,
        "never_searched": float(told.never[-1]),
        "effective_particles": told.effective,
        "further": [
            {
                "until": one.until,
                "pos": one.pos,
                "pos_se": one.pos_error,
                "found_alive": one.alive,
                "found_alive_se": one.alive_error,
            }
            for one in told.further
        ],
        "further_from": told.how,
    }


def alive_at(scenarios: Sequence[Scenario], here: Standing, time: float) -> tuple[Array, Array]:
    """Return the probability of being alive at a time [s after start] by scenario and of all, and its standard error."""
    chance = np.ones_like(here.mass)
    for s, scenario in enumerate(scenarios):
        if scenario.survival:
            chance[s] = scenario.survival.alive(time - here.release[s])
    mass = np.concatenate([here.mass, np.zeros((1, here.mass.shape[1]))])
    found, error = np.ones(len(mass)), np.zeros(len(mass))
    for s in range(len(mass)):
        m, c = (mass[s], chance[s]) if s < len(scenarios) else (here.mass.ravel(), chance.ravel())
        if m.sum() > 0:
            found[s] = m @ c / m.sum()
            error[s] = np.sqrt(m @ (c - found[s]) ** 2 / m.sum() / max(here.effective * m.sum(), 1.0))
    return found, error


def off_map(data: xr.Dataset) -> float:
    """Return the probability at the end of the run that is on no map: it left the domain or the forcing, sank, or is not released."""
    status = data["status_probability"].isel(time=-1)
    return float(status.sum()) - float(status.sel(status=["adrift", "ashore"]).sum())


def area(sortie: Sortie) -> float:
    """Return the area that a sortie searched [m2], on the plane about its middle; NaN for a watch."""
    return NAN if sortie.area is None else size(sortie.area)


NAN = float("nan")


def size(one: Area) -> float:
    """Return an area [m2] on the plane about its first corner; 100 nmi across it is 1 in 10,000 off."""
    lon, lat = np.radians(one.lon), np.radians(one.lat)
    return float(shapely.Polygon(np.column_stack(sphere.offset(lon[0], lat[0], lon, lat))).area)


def effort(sortie: Sortie) -> Array | None:
    """Return the area that a sortie swept for the object of each scenario, W v t [m2], (S,); None for a watch."""
    width = np.array(sortie.sweep_width, float)
    if sortie.watch is not None:
        return None
    if sortie.legs is not None:
        legs = sortie.legs
        lon, lat = np.radians(legs.lon), np.radians(legs.lat)
        length = sphere.distance(lon[:-1], lat[:-1], lon[1:], lat[1:])
        return np.asarray(width * float(np.sum(length[np.array(legs.searching, bool)])))
    assert sortie.area is not None
    return np.asarray(np.array(sortie.coverage, float) * size(sortie.area) * sortie.completed)


def spread(mass: Array, swept: Array, cells: Array) -> Array:
    """Return which share of an effort each cell gets, (C,), so that random search over all finds most.

    mass: probability by scenario and cell, (S, C). swept: area swept for each scenario's object, (S,) [m2]. cells:
    their areas [m2], (C,). What another share would find is the same wherever any is spent, and nowhere more: both by
    halving intervals.
    """
    rate = swept[:, None] / cells

    def gain(share: Array) -> Array:
        return np.asarray((mass * rate * np.exp(-rate * share)).sum(axis=0))

    def shares(worth: float) -> Array:
        low, high = np.zeros(len(cells)), np.ones(len(cells))
        for _ in range(40):
            middle = (low + high) / 2
            more = gain(middle) > worth
            low, high = np.where(more, middle, low), np.where(more, high, middle)
        return np.where(gain(np.zeros(len(cells))) > worth, low, 0.0)

    top = float(gain(np.zeros(len(cells))).max())
    low, high = np.log(top) - 60.0, np.log(top)
    for _ in range(50):
        middle = (low + high) / 2
        if shares(float(np.exp(middle))).sum() > 1:
            low = middle
        else:
            high = middle
    found = shares(float(np.exp(high)))
    return np.asarray(found / max(found.sum(), 1e-300))


def days(
    mass: Array, swept: Array, cells: Array, alive: Array, effective: float, until: Sequence[np.datetime64]
) -> tuple[Further, ...]:
    """Return what searching on by days comes to, the effort of each day spent evenly over it.

    mass, swept, cells: as in `spread`, swept in a day. alive: probability of being alive by scenario in the middle of
    each of STEPS parts of each day and at its end, (days, STEPS + 1, S). until: end of each day.
    """
    left, found = mass.copy(), []
    pos = saved = 0.0
    for moments, end in zip(alive, until, strict=True):
        rate = swept[:, None] / cells * spread(left, swept, cells)
        before = left
        for k in range(1, STEPS + 1):
            after = left * np.exp(-rate * k / STEPS)
            saved += float((before - after).sum(axis=1) @ moments[k - 1])
            before = after
        left = before
        pos = float((mass - left).sum())
        missed = np.divide(left, mass, out=np.ones_like(mass), where=mass > 0)
        error = np.sqrt(max(float((mass * (1 - missed) ** 2).sum()) - pos**2, 0.0) / effective)
        none = 1 - float(mass.sum())  # what is on no map stays unfound
        rest = left.sum(axis=1) + none * mass.sum(axis=1) / max(float(mass.sum()), 1e-300)
        part = saved / pos if pos > 0 else 0.0
        found.append(Further(end, pos, float(error), saved, float(error) * part, float(rest @ moments[-1])))
    return tuple(found)


def _days(
    told: Suspension, scenarios: Sequence[Scenario], start: np.datetime64, flown: dict[str, Sortie], data: xr.Dataset
) -> tuple[tuple[Further, ...], str]:
    """Return what days like the last one would add, and how that was reckoned."""
    day = np.timedelta64(24, "h")
    recent = [sortie for sortie in flown.values() if told.now - day < sortie.end <= told.now]
    swept = [found for sortie in recent if (found := effort(sortie)) is not None]
    total = np.sum(swept, axis=0) if swept else np.zeros(len(scenarios))
    if not total.any():
        return (
            (),
            "no sortie with a coverage was flown in the last 24 h: nothing says how much another day could search",
        )
    times = data["time"].values.astype("datetime64[s]")
    later = np.flatnonzero(times >= told.now)
    k = int(later[np.argmin(np.abs(times[later] - (told.now + day / 2)))]) if len(later) else len(times) - 1
    mass, cells = _coarse(data["probability_by_scenario"].values[k].astype(float), data["cell_area"].values)
    if not (mass.sum(axis=1) * total).any():
        return (), "nothing is on the map that the sorties of the last 24 h could see"
    now = _seconds(told.now, start)
    middle = (np.arange(STEPS) + 0.5) / STEPS
    moments = np.append(middle, 1.0)
    alive, until = [], []
    for d in range(DAYS):
        here = [alive_at(scenarios, told.standing, now + DAY * (d + u))[0] for u in moments]
        alive.append([chances[:-1] for chances in here])
        until.append(told.now + (d + 1) * day)
        if here[-1][-1] < GONE:
            break
    watched = len(recent) - len(swept)
    how = (
        f"{len(swept)} sortie{'s' * (len(swept) != 1)} of the last 24 h swept {total.max() / 1852**2:,.0f} nmi2: as much on each "
        f"further day, as random search, spread without limit where it adds most on the map of {np.datetime_as_string(times[k], 'm')}Z"
        + (f"; {watched} watch{'es' * (watched != 1)} not counted" if watched else "")
    )
    return days(mass, total, cells, np.array(alive), told.effective, until), how


def _planned(
    told: Suspension, plan: Planned, every: Sequence[Update], scenarios: Sequence[Scenario], start: np.datetime64
) -> tuple[tuple[Further, ...], str]:
    """Return what a plan adds, by the execution of it: one entry, at the end of its last sortie."""
    missed, saved = np.ones(len(scenarios) + 1), 0.0
    for update in every:
        if update.name in plan.names and update.pos is not None:
            found = update.pos if update.alive is None else update.alive
            saved += float(missed[-1]) * float(found[-1])
            missed = missed * (1 - np.asarray(update.pos))
    after = every[-1].standing
    waiting = float(missed[-1])
    if after is not None:
        waiting *= float(alive_at(scenarios, after, _seconds(plan.end, start))[0][-1])
    pos = 1 - float(missed[-1])
    error = [float(told.error(share)) for share in (pos, saved)]
    return (
        Further(plan.end, pos, error[0], saved, error[1], waiting),
    ), "the plan of plan.txt, as it scores on the case's particles"


def _coarse(mass: Array, area: Array) -> tuple[Array, Array]:
    """Return probability (S, C) and area (C,) of blocks of cells of which any holds probability."""
    shape = mass.shape[1:]
    side = -(-max(shape) // ACROSS)
    room = [(0, -length % side) for length in shape]
    blocks = [-(-length // side) for length in shape]

    def sums(values: Array) -> Array:
        padded = np.pad(values, [(0, 0), *room]).reshape(len(values), blocks[0], side, blocks[1], side)
        return np.asarray(padded.sum(axis=(2, 4)).reshape(len(values), -1))

    cells = sums(np.where(mass.sum(axis=0) > 0, area, 0.0)[None])[
        0
    ]  # of a block at the coast, the water that can hold it
    coarse = sums(mass)
    return coarse[:, cells > 0], cells[cells > 0]


def basis(scenario: Scenario) -> str | None:
    """Return a scenario's survival times in words; None where none are told."""
    life = scenario.survival
    if life is None:
        return None
    return f"median {life.median / HOUR:.3g} h, factor {life.spread:.3g} of a standard deviation ({life.basis})"


def _seconds(time: np.datetime64, start: np.datetime64) -> float:
    return float((time - start) / np.timedelta64(1, "s"))
