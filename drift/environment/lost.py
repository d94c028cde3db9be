"""Refusals of a run that would lose more than it may, to places without forcing or outside of the domain."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from drift.environment import domain, silence
from drift.environment.environment import Environment
from drift.motion.clock import Clock
from drift.motion.ensemble_spec import EnsembleSpec
from drift.motion.forcing import Term
from drift.motion.scene import Scene
from drift.particles import ensemble as record
from drift.particles import members
from drift.particles.ensemble import Ensemble
from drift.particles.partials import Blocks
from drift.particles.snapshot import Snapshot
from drift.particles.status import LOST, Status
from geo import notation, sphere
from geo.box import Box
from geo.errors import UserError
from geo.forcing.quantity import needed
from geo.forcing.sources import Source

MANY = 10  # scenarios of which a refusal tells


def check_prior(
    spec: EnsembleSpec, where: Environment, max_lost: float, ensemble: Ensemble, scene: Scene, clock: Clock
) -> None:
    """Refuse a prior of which more than a share lies where there is no forcing, or outside the domain."""
    low, high, _ = next(clock.steps())
    scene.forcing.set(low, high)
    lon, lat = ensemble.lon.to_numpy(), ensemble.lat.to_numpy()
    # What is released later may find a value where a source has none yet, so the run itself judges it.
    probability = np.where(ensemble.release.to_numpy() <= clock.step, record.probability(ensemble), 0.0)
    _check_domain(where.box, max_lost, ensemble, probability)
    blocks, seas, member = ensemble.blocks, _seas(scene), members.of(ensemble)
    for quantity in needed():
        missing, places = 0.0, []
        for sea in seas:
            slots = np.concatenate([np.arange(*ensemble.scenarios[number]) for number in sea])
            x, y, weight = lon[slots], lat[slots], probability[slots]
            own = None if member is None else member[slots]
            everywhere = np.ones(slots.size, bool)  # whether all terms have a value there
            for of, term, valid in silence.terms(scene.forcing, sea[0], x, y, own):
                if of == quantity:
                    everywhere &= valid
                    lost = np.where(valid, 0.0, weight)
                    places += _without(spec, where, ensemble, quantity, term, sea, (x, y, weight, lost, slots))
            missing += blocks.total(np.where(everywhere, 0.0, weight), slots)
        if missing > max_lost:
            summed = any(key[0] == quantity for named in where.scenarios for key in named.added)
            raise UserError(
                f"[[{quantity}]]: {missing:.0%} of the prior lies where there is no {quantity} ({_some(places)}); "
                f"at most {max_lost:.0%} may be lost (max_lost). "
                + ("A sum has no value where one of its terms has none. " if summed else "")
                + f"Add a source, or move the {spec.story}"
            )


def _seas(scene: Scene) -> list[tuple[int, ...]]:
    """Return the numbers of scenarios that see the same sources of all quantities that are needed, together."""
    together: dict[tuple[Any, ...], list[int]] = {}
    for number, ranges in enumerate(scene.forcing.ranges):
        together.setdefault(tuple(ranges[quantity] for quantity in needed()), []).append(number)
    return [tuple(sea) for sea in together.values()]


def _without(
    spec: EnsembleSpec,
    where: Environment,
    ensemble: Ensemble,
    quantity: str,
    term: Term,
    sea: tuple[int, ...],
    prior: tuple[npt.NDArray[Any], ...],
) -> list[tuple[int, str]]:
    """Return numbers of the scenarios of a sea that lie where a term has no value, and in words how much, and where.

    prior: of the sea's slots lon, lat [binary angle], the probability, what of it has no value, and the slots.
    """
    x, y, weight, lost, slots = prior
    if not lost.any():
        return []
    found, blocks = [], ensemble.blocks
    missed, whole = blocks.partial(lost, weight, slots=slots).by_scenario[:, 0].T
    for number in (number for number in sea if missed[number] > 0):
        first, last = ensemble.scenarios[number]
        own = (slots >= first) & (slots < last)
        middle = _middle(blocks, x[own], y[own], lost[own], slots[own])
        silent = [source for source in where.scenarios[number].of(quantity) if source.name in term.names]
        away = ", ".join(f'"{source.name}" {_away(source, *middle)}' for source in silent)
        share, name = missed[number] / max(whole[number], 1e-300), spec.scenarios[number].name
        found.append((number, f'{share:.0%} of {spec.story} "{name}", about {notation.position(*middle)}: {away}'))
    return found


def _some(places: list[tuple[int, str]]) -> str:
    """Return what is lost of each scenario, in their order; of many only the first."""
    words = [text for _, text in sorted(places, key=lambda place: place[0])]
    return "; ".join([*words[:MANY], f"and {len(words) - MANY} more"] if len(words) > MANY else words)


def check_end(
    where: Environment, max_lost: float, ensemble: Ensemble, scene: Scene, clock: Clock, end: Snapshot
) -> None:
    """Refuse a run that has lost more than a share of the probability by its end."""
    by_status = end.blocks.table(end.status, len(Status), end.probability)
    lost = {status: float(by_status[status]) for status in LOST}
    if sum(lost.values()) <= max_lost:
        return
    box, silent = where.box, silence.in_words(silence.lost(scene.forcing, clock, ensemble, end))
    raise UserError(
        f"{sum(lost.values()):.0%} of the probability was lost by the end: {lost[Status.OUTSIDE]:.0%} ran out of "
        f"forcing{f' (no value: {silent})' if silent else ''}, {lost[Status.LEFT]:.0%} left the domain "
        f"({box.west:.2f}..{box.east:.2f} E, {box.south:.2f}..{box.north:.2f} N); at most {max_lost:.0%} may be "
        "(max_lost). Shorten the run, add a source, or widen [domain]"
    )


def _check_domain(box: Box, max_lost: float, ensemble: Ensemble, probability: npt.NDArray[Any]) -> None:
    """Refuse a prior of which more than a share lies outside the domain."""
    west, south, width, height = domain.binary(box)
    lon, lat = ensemble.lon.to_numpy().astype(np.int64), ensemble.lat.to_numpy().astype(np.int64)
    beyond = ((lon - west) % sphere.TURN > width) | (lat < south) | (lat > south + height)
    lost = np.where(beyond, probability, 0.0)
    share = ensemble.blocks.total(lost)
    if share <= max_lost:
        return
    x, y = _middle(ensemble.blocks, ensemble.lon.to_numpy(), ensemble.lat.to_numpy(), lost)
    raise UserError(
        f"[domain]: {share:.0%} of the prior lies outside it, about {notation.position(x, y)}, from where it is "
        f"{_edge(box, x, y)} to its edge ({box.west:.2f}..{box.east:.2f} E {box.south:.2f}..{box.north:.2f} N); "
        f"at most {max_lost:.0%} may be lost (max_lost). Widen [domain], or leave it out"
    )


def _middle(
    blocks: Blocks,
    lon: npt.NDArray[np.int32],
    lat: npt.NDArray[np.int32],
    weight: npt.NDArray[Any],
    slots: npt.NDArray[Any] | None = None,
) -> tuple[float, float]:
    """Return the weighted mean position (lon, lat) [deg] of particles [binary angles].

    It is the direction of their mean vector. slots: of these particles, by default all.
    """
    x, y = lon * sphere.UNIT, lat * sphere.UNIT
    vector = np.cos(y) * np.cos(x), np.cos(y) * np.sin(x), np.sin(y)
    mean = [blocks.total(weight * part, slots) for part in vector]
    middle = math.atan2(mean[1], mean[0]), math.atan2(mean[2], math.hypot(mean[0], mean[1]))
    return math.degrees(middle[0]), math.degrees(middle[1])


def _away(source: Source, lon: float, lat: float) -> str:
    """Return how far and in which direction the domain of a source lies from a point [deg].

    A value that is missing inside the domain is land or a gap.
    """
    grid = source.grid
    if source.domain is None:
        box = grid.box
        if (lon - box.west) % 360 <= box.east - box.west and box.south <= lat <= box.north:
            return "has no value there (land, or missing)"
        return f"begins {_edge(box, lon, lat)}"
    row, column = np.nonzero(source.domain)
    x, y = grid.lon[column], grid.lat[row]
    apart = sphere.distance(np.radians(lon), np.radians(lat), np.radians(x), np.radians(y))
    near = int(np.argmin(apart))
    if apart[near] < np.radians(max(grid.dlon, grid.dlat)) * sphere.RADIUS:
        return "has no value there (land, or missing)"
    return f"begins {notation.toward(lon, lat, float(x[near]), float(y[near]))}"


def _edge(box: Box, lon: float, lat: float) -> str:
    """Return how far and in which direction the edge of a box is from a point [deg].

    The result is right to about a thousandth of the box's size.
    """
    share = np.linspace(0, 1, 1001)
    x, y = box.west + share * (box.east - box.west), box.south + share * (box.north - box.south)
    x, y = (
        np.concatenate([x, x, 0 * y + box.west, 0 * y + box.east]),
        np.concatenate([0 * x + box.south, 0 * x + box.north, y, y]),
    )
    near = int(np.argmin(sphere.distance(np.radians(lon), np.radians(lat), np.radians(x), np.radians(y))))
    return notation.toward(lon, lat, float(x[near]), float(y[near]))
