"""The value of further search from now on: by further days like the last one, or by a plan.

The further days are a rough estimate, neither a plan nor a bound. They are random search with
effort that is divided without limit where it adds most (Koopman 1980, Search and Screening, ch. 3;
Charnes and Cooper 1958), on one fixed map, although the object drifts on. The resulting error is
not known, and is larger than the sampling error, so text and picture show no error.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
import xarray as xr

from drift.engine.motion.scenario import Scenario
from drift.evidence.filter.records import Sortie
from drift.evidence.filter.standing import SearchStatus
from drift.evidence.filter.updates import Update
from drift.evidence.suspend.alive import alive_at, seconds
from drift.forecast.products import dataset
from geo import notation, sphere
from geo.array import Array
from geo.notation import NMI
from geo.polyline import Area

DAY = 86_400.0  # [s]
ACROSS = 80  # cells along the longer side of the map on which further days are computed
DAYS = 7  # most days that are stated
STEPS = 24  # parts of a day; the probability of being alive is that of the middle of each
# shares with a larger sum exceed the effort, whatever the rounding of the sum
ALL = 1 + 1e-9
GONE = 0.005  # probability of being alive below which no further time or day is stated


@dataclass(frozen=True)
class Planned:
    """Planned sorties; the forecast is given that they fail."""

    names: frozenset[str]
    end: np.datetime64  # when the last of them ends


@dataclass(frozen=True)
class Further:
    """The result of searching on until a time, from now; errors are standard errors."""

    until: np.datetime64
    pos: float  # probability that the object is found by then
    pos_error: float
    alive: float  # probability that it is found alive by then
    alive_error: float
    waiting: float  # probability of being alive then and not found


def standard_error(share: Array | float, effective: float) -> Array:
    """Return the standard error of a probability, smoothed so that it is never 0.

    Args:
        share: the probability, any shape.
        effective: number of effective particles.
    """
    smoothed = (np.asarray(share) * effective + 1) / (effective + 2)
    return np.asarray(np.sqrt(smoothed * (1 - smoothed) / (effective + 2)))


def area(sortie: Sortie) -> float:
    """Return the area that a sortie searched [m2], on the plane about its first corner.

    It is NaN for a sortie without an area.
    """
    return float("nan") if sortie.area is None else size(sortie.area)


def size(area: Area) -> float:
    """Return an area [m2] on the plane about its first corner.

    For an area of 100 nmi across, the error is 1 in 10,000.
    """
    lon, lat = np.radians(area.lon), np.radians(area.lat)
    return float(shapely.Polygon(np.column_stack(sphere.offset(lon[0], lat[0], lon, lat))).area)


def effort(sortie: Sortie) -> Array | None:
    """Return the area swept for each scenario's object, W v t [m2], (S,); None for a watch."""
    if sortie.watches:
        return None
    if sortie.legs is not None:
        legs = sortie.legs
        lon, lat = np.radians(legs.lon), np.radians(legs.lat)
        length = sphere.distance(lon[:-1], lat[:-1], lon[1:], lat[1:])
        width = np.array(sortie.sweep_width, float)
        return np.asarray(width * float(np.sum(length[np.array(legs.searching, bool)])))
    assert sortie.area is not None
    return np.asarray(np.array(sortie.coverage, float) * size(sortie.area) * sortie.completed)


def spread(mass: Array, swept: Array, cells: Array) -> Array:
    """Return the shares of an effort by cell (C,) that maximize the POS of random search.

    At the optimum, marginal effort has equal value in all cells that have any, and less in the
    others. The marginal value, and the shares for it, are both found by bisection.

    Args:
        mass: probability by scenario and cell, shape (S, C).
        swept: area swept for each scenario's object [m2], shape (S,).
        cells: areas of the cells [m2], shape (C,).
    """
    kinds, which = np.unique(swept, return_inverse=True)
    if kinds.size < swept.size:  # merge scenarios with the same swept area
        swept, mass = (
            kinds,
            np.array([mass[which == kind].sum(axis=0) for kind in range(kinds.size)]),
        )
    rate = swept[:, None] / cells
    slope = mass * rate
    first = slope.sum(axis=0)  # marginal value of the first effort in a cell

    def shares(worth: float) -> Array:
        found = np.zeros(len(cells))
        some = np.flatnonzero(first > worth)
        steep, fall = slope[:, some], -rate[:, some]
        share = np.zeros(len(some))
        for k in range(1, 41):
            share += 0.5**k * ((steep * np.exp(fall * (share + 0.5**k))).sum(axis=0) > worth)
            if share.sum() > ALL:  # the excess does not matter
                break
        found[some] = share
        return found

    top = float(first.max())
    low, high = np.log(top) - 60.0, np.log(top)
    for _ in range(50):
        middle = (low + high) / 2
        if shares(float(np.exp(middle))).sum() > 1:
            low = middle
        else:
            high = middle
    best = shares(float(np.exp(high)))
    return np.asarray(best / max(best.sum(), 1e-300))


def days(
    mass: Array,
    swept: Array,
    cells: Array,
    alive: Array,
    effective: float,
    until: Sequence[np.datetime64],
) -> tuple[Further, ...]:
    """Return the result of searching on by days; the effort of a day is uniform in time.

    Args:
        mass: probability by scenario and cell, shape (S, C).
        swept: area swept in a day for each scenario's object [m2], shape (S,).
        cells: areas of the cells [m2], shape (C,).
        alive: probability of being alive by scenario in the middle of each of STEPS parts of each
            day and at its end, shape (days, STEPS + 1, S).
        effective: number of effective particles.
        until: end of each day.
    """
    left, by_day = mass.copy(), []
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
        off_map = 1 - float(mass.sum())  # stays unfound
        unfound = left.sum(axis=1) + off_map * mass.sum(axis=1) / max(float(mass.sum()), 1e-300)
        part = saved / pos if pos > 0 else 0.0
        by_day.append(
            Further(
                end, pos, float(error), saved, float(error) * part, float(unfound @ moments[-1])
            )
        )
    return tuple(by_day)


def like_the_last(
    standing: SearchStatus,
    scenarios: Sequence[Scenario],
    start: np.datetime64,
    flown: Sequence[Sortie],
    data: xr.Dataset,
) -> tuple[tuple[Further, ...], str]:
    """Return the result of further days like the last one, and in words how it was computed.

    Args:
        standing: status of the search now.
        scenarios: of the case.
        start: of the run.
        flown: sorties so far.
        data: maps of the forecast.
    """
    day = np.timedelta64(24, "h")
    recent = [sortie for sortie in flown if standing.time - day < sortie.end <= standing.time]
    efforts = [swept for sortie in recent if (swept := effort(sortie)) is not None]
    total = np.sum(efforts, axis=0) if efforts else np.zeros(len(scenarios))
    if not total.any():
        return (), (
            "no sortie with a coverage was flown in the last 24 h: no effort of a further day can be estimated"
        )
    times = data["time"].values.astype("datetime64[s]")
    later = np.flatnonzero(times >= standing.time)
    k = (
        int(later[np.argmin(np.abs(times[later] - (standing.time + day / 2)))])
        if len(later)
        else len(times) - 1
    )
    mass, cells = _coarse(
        data["probability_by_scenario"].values[k].astype(float), data["cell_area"].values
    )
    if not (mass.sum(axis=1) * _mapped(total, standing, data)).any():
        return (), "the sorties of the last 24 h could detect nothing on the map"
    now = seconds(standing.time, start)
    parts = np.append((np.arange(STEPS) + 0.5) / STEPS, 1.0)  # of a day
    alive, until = [], []
    for d in range(DAYS):
        chances = [alive_at(scenarios, standing, now + DAY * (d + part))[0] for part in parts]
        alive.append([chance[:-1] for chance in chances])
        until.append(standing.time + (d + 1) * day)
        if chances[-1][-1] < GONE:
            break
    swept, living = _mapped(total, standing, data), _mapped(np.array(alive), standing, data)
    watches = len(recent) - len(efforts)
    how = (
        f"{len(efforts)} sortie{'s' * (len(efforts) != 1)} of the last 24 h swept {total.max() / NMI**2:,.0f} nmi2. Each further "
        "day has the same effort, as random search, in the best places on the map of "
        f"{notation.format_dtg(times[k])}"
        + (f"; {watches} watch{'es' * (watches != 1)} not counted" if watches else "")
    )
    return days(mass, swept, cells, living, standing.effective, until), how


def _mapped(values: Array, standing: SearchStatus, data: xr.Dataset) -> Array:
    """Return values by scenario (..., S) for the maps; scenarios that share a map are averaged."""
    return dataset.displayed_scenarios(data).means(values, standing.mass.sum(axis=1))


def by_plan(
    standing: SearchStatus,
    plan: Planned,
    updates: Sequence[Update],
    scenarios: Sequence[Scenario],
    start: np.datetime64,
) -> tuple[tuple[Further, ...], str]:
    """Return the result of a plan, and in words how it was computed.

    The result has one entry, at the end of the last sortie.

    Args:
        standing: status of the search before the plan.
        plan: the planned sorties.
        updates: of the execution of the plan.
        scenarios: of the case.
        start: of the run.
    """
    missed, saved = np.ones(len(scenarios) + 1), 0.0
    for update in updates:
        if update.name in plan.names and update.pos is not None:
            found_alive = update.pos if update.alive is None else update.alive
            saved += float(missed[-1]) * float(found_alive[-1])
            missed = missed * (1 - np.asarray(update.pos))
    after = updates[-1].standing
    waiting = float(missed[-1])
    if after is not None:
        waiting *= float(alive_at(scenarios, after, seconds(plan.end, start))[0][-1])
    pos = 1 - float(missed[-1])
    pos_error, alive_error = (
        float(standard_error(share, standing.effective)) for share in (pos, saved)
    )
    further = Further(plan.end, pos, pos_error, saved, alive_error, waiting)
    return (further,), "the plan of plan.txt, as it scores on the case's particles"


def _coarse(mass: Array, area: Array) -> tuple[Array, Array]:
    """Return probability (S, C) and area (C,) of blocks of cells with any probability.

    The area of a block only includes cells with probability: at the coast, the water.

    Args:
        mass: probability, shape (S, ny, nx).
        area: of cells [m2], shape (ny, nx).
    """
    shape = mass.shape[1:]
    side = -(-max(shape) // ACROSS)
    padding = [(0, -length % side) for length in shape]
    blocks = [-(-length // side) for length in shape]

    def sums(values: Array) -> Array:
        padded = np.pad(values, [(0, 0), *padding]).reshape(
            len(values), blocks[0], side, blocks[1], side
        )
        return np.asarray(padded.sum(axis=(2, 4)).reshape(len(values), -1))

    water = sums(np.where(mass.sum(axis=0) > 0, area, 0.0)[None])[0]
    return sums(mass)[:, water > 0], water[water > 0]
