"""When targets under way go adrift, by a hazard along each target's own track.

The law of a target's distress says whether it goes adrift before it arrives, and before the run
ends; that stays. When it does so is drawn again, with a density in proportion to the law times the
hazard where the target is then. Its track must be settled at its departure (drift.engine.motion.steering.itinerary.unsettled).

The targets go along their tracks once before the run, on a lattice of times that depends on the case
alone. In a cell between two of these times the hazard is linear and the law uniform. Each cell
replaces the one chosen so far with its share of the sum until then (Chao 1982, Biometrika 69,
doi:10.1093/biomet/69.3.653), so one pass suffices. Every target draws for itself, by its slot.
"""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import numpy as np

from drift.engine.motion.steering import steer
from drift.engine.motion.steering.itinerary import (
    Between,
    Itinerary,
    Part,
    Rate,
    Spread,
    Ways,
    latest,
)
from drift.engine.motion.steering.steer import Helm, Steering
from drift.engine.particles.ensemble import NEVER, Ensemble, Slots
from drift.engine.particles.status import Status
from geo import notation, sphere
from geo.array import Array
from geo.errors import UserError
from kernels.runtime import rows, runtime
from kernels.steering import distress as kernel
from kernels.steering import steer as steering_kernel
from kernels.step.advance import Step
from kernels.step.coast import DeviceCoast

CELLS = 512  # of the time in which distress is possible

# Hazards (n,) at a time [s since 1970] and places [binary angle]; NaN where there is no value.
HazardAt = Callable[[int, Array, Array], Array]
OpenHazard = Callable[[], AbstractContextManager[HazardAt]]


def draw_again(
    ensemble: Ensemble,
    steering: Steering,
    scenario: int,
    name: str,
    hazard: OpenHazard,
    coast: DeviceCoast | None,
) -> None:
    """Draw the times of distress of a scenario's targets again, by a hazard, in place.

    Args:
        ensemble: as kernels.steering.steer.born leaves it.
        steering: itineraries of the run.
        scenario: number of the scenario.
        name: of the scenario, for messages.
        hazard: opens the hazard.
        coast: on the device; None without one.

    Raises:
        UserError: the hazard has no value on a track, or is 0 all along one.
    """
    itinerary, slots = steering.itineraries[scenario], ensemble.slots[scenario]
    assert itinerary is not None
    if slots.last == slots.first:
        return
    law = _law(ensemble, slots, steering, itinerary)
    edges = _lattice(steering, itinerary)
    if edges.size < 2:
        return  # its distress comes after the run, or at one known time
    release = ensemble.release.to_numpy()
    own = release[slots.first : slots.last].astype(np.float64)
    total, lawful = np.zeros(own.size), np.zeros(own.size)
    chosen, over = own.copy(), np.full(own.size, np.inf)
    place = f'scenario "{name}".hazard'
    with hazard() as hazard_at:
        before, begin = np.full(own.size, np.nan), float(edges[0])
        widest = float(np.diff(edges).max())
        nodes = _rehearsed(ensemble, steering, scenario, edges, coast)
        for cell, (end, lon, lat, over) in enumerate(nodes):
            # the hazard is wanted at both ends of each cell in which distress is possible
            last = np.minimum(over, law.latest)
            near = np.flatnonzero((end + widest >= law.earliest) & (end - widest <= last))
            now = np.full(own.size, np.nan)
            if near.size:
                now[near] = hazard_at(steering.period.epoch + int(end), lon[near], lat[near])
            low, high = np.maximum(begin, law.earliest), np.minimum(end, last)
            inside = np.flatnonzero(high > low) if cell > 0 else np.zeros(0, np.int64)
            if inside.size:
                low, high = low[inside], high[inside]
                slope = (now[inside] - before[inside]) / (end - begin)
                first, final = (before[inside] + slope * (time - begin) for time in (low, high))
                if np.isnan(slope).any():
                    k = inside[int(np.argmax(np.isnan(slope)))]
                    x, y = (float(sphere.to_degrees(angle[k])) for angle in (lon, lat))
                    when = notation.format_dtg(steering.period.time(int(end)))
                    raise UserError(
                        f"{place} has no value about {notation.position(x, y)} on {when}, on the track "
                        "of a target; give a file or winds that cover it, or set hazard.outside"
                    )
                share = law.share(inside, high) - law.share(inside, low)
                mass = share * (first + final) / 2
                total[inside] += mass
                lawful[inside] += share
                u = kernel.draw_uniforms(tuple(slots), ensemble.seed, cell)[inside]
                taken = u[:, 0] * total[inside] < mass
                part = _linear(first[taken], final[taken], u[taken, 1])
                chosen[inside[taken]] = low[taken] + part * (high - low)[taken]
            begin, before = float(end), now
    goes = (own < over) & (own <= edges[-1]) & (lawful > 0)
    if (goes & (total == 0)).any():
        count = int((goes & (total == 0)).sum())
        raise UserError(
            f"{place} is 0 all along the tracks of {count:,} of {own.size:,} targets, which go adrift "
            "by their distress; give a hazard above 0 there, such as hazard.deeper or hazard.outside"
        )
    time = np.clip(np.rint(chosen), np.ceil(law.earliest), np.minimum(over - 1, edges[-1]))
    release[slots.first : slots.last] = np.where(goes, time, own).astype(np.int32)
    ensemble.release.from_numpy(release)


def _linear(first: Array, last: Array, u: Array) -> Array:
    """Return numbers in (0, 1) of a density that is linear from `first` to `last`."""
    root = np.sqrt(first**2 + u * (last**2 - first**2))
    return np.asarray(u * (first + last) / (first + root))


@dataclass(frozen=True)
class _Law:
    """The law of the distress of each target; times [s after the run's start], (n,)."""

    earliest: Array
    latest: Array
    share: Callable[[Array, Array], Array]  # cumulated, up to a constant, of targets at times


def _law(ensemble: Ensemble, slots: Slots, steering: Steering, itinerary: Itinerary) -> _Law:
    """Return the laws of a scenario's targets."""
    own = slice(slots.first, slots.last)
    departure = ensemble.columns["departure"].to_numpy()[own].astype(np.float64)
    match itinerary.distress:
        case Between(earliest, after):
            begin = float(steering.period.elapsed(earliest))
            low, high = begin + after.low, begin + after.high
            return _Law(
                np.maximum(departure, low),
                np.full(departure.size, high),
                lambda targets, time: _cumulated(after, time - begin),
            )
        case Rate(rate):
            endless = np.full(departure.size, np.inf)
            return _Law(
                departure,
                endless,
                lambda targets, time: -np.exp(-rate * (time - departure[targets])),
            )
        case Part(part):
            speed = ensemble.columns["speed"].to_numpy()[own].astype(np.float64)
            lasting = _length(itinerary) / speed
            return _Law(
                departure + part.low * lasting,
                departure + part.high * lasting,
                lambda targets, time: _cumulated(
                    part, (time - departure[targets]) / lasting[targets]
                ),
            )
    raise AssertionError("no distress")  # drift.case.scenario.scenario


def _cumulated(spread: Spread, value: Array) -> Array:
    """Return the cumulated distribution of a truncated triangle."""
    span = max(spread.high - spread.low, np.finfo(float).tiny)
    x, peak = np.clip((value - spread.low) / span, 0.0, 1.0), (spread.mode - spread.low) / span
    rising = x**2 / max(peak, np.finfo(float).tiny)
    falling = 1 - (1 - x) ** 2 / max(1 - peak, np.finfo(float).tiny)
    flat = 2 / (1 + spread.ratio)
    return np.asarray(flat * x + (1 - flat) * np.where(x < peak, rising, falling))


def _length(itinerary: Itinerary) -> float:
    """Return the length [m] of the first phase, along the middles of its way points."""
    first = itinerary.phases[0]
    assert isinstance(first, Ways)
    return sum(point.distance for point in first.points[1:])


def _lattice(steering: Steering, itinerary: Itinerary) -> Array:
    """Return the ends of the cells [s after the run's start], whole, (at most CELLS + 1,)."""
    period, first, distress = steering.period, itinerary.phases[0], itinerary.distress
    begin, end = 0.0, float(period.duration)
    if isinstance(first, Ways):
        start = period.elapsed(first.start)
        begin = max(begin, start + first.after.low + latest(first.points[0].time, -6.0))
        alone = len(itinerary.phases) == 1 or isinstance(distress, Part)
        if first.points[-1].time is None and alone and first.speed.low > 0:
            slowest = _length(itinerary) / first.speed.low + 60.0  # times are whole seconds
            end = min(end, start + first.after.high + slowest)
    if isinstance(distress, Between):
        after = period.elapsed(distress.earliest)
        begin = max(begin, after + distress.after.low)
        end = min(end, after + distress.after.high)
    if end <= begin:
        return np.zeros(0)
    return np.unique(np.rint(np.linspace(begin, end, CELLS + 1)))


def _rehearsed(
    ensemble: Ensemble, steering: Steering, scenario: int, edges: Array, coast: DeviceCoast | None
) -> Iterator[tuple[float, Array, Array, Array]]:
    """Yield times, places [binary angle] there, and when targets stopped (inf: not yet), (n,)."""
    helm = Helm(ensemble, steering, steer.EVERYWHERE, coast, (scenario,))
    slots = ensemble.slots[scenario]
    own = slice(slots.first, slots.last)
    columns: dict[str, Any] = rows.rebuilt(
        steer.columns(ensemble), lambda name, array: runtime.copy(array)
    )
    columns["release"].from_numpy(np.full(ensemble.n, NEVER, np.int32))
    move = steering_kernel.mover(
        columns, helm.batch, helm.plan, ensemble.seed, steer.EVERYWHERE, helm.coast
    )
    time = 0
    for number, end in enumerate(edges.astype(int)):
        if end > time:
            move(Step(number, time, int(end) - time, 1))
            time = int(end)
        status, since = (columns[name].to_numpy()[own] for name in ("status", "status_since"))
        stopped = (status == int(Status.ARRIVED)) | (status == int(Status.AGROUND))
        lon, lat = (columns[name].to_numpy()[own] for name in ("lon", "lat"))
        yield float(end), lon, lat, np.where(stopped, since, np.inf)
