"""Refusals of a run that would lose more than it may, to places without forcing or outside of the domain."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from drift.environment import domain, silence
from drift.environment.environment import Environment
from drift.motion.clock import Clock
from drift.motion.ensemble_spec import EnsembleSpec
from drift.motion.scene import Scene
from drift.particles import ensemble as record
from drift.particles.ensemble import Ensemble
from drift.particles.partials import Blocks
from drift.particles.snapshot import Snapshot
from drift.particles.status import LOST, Status
from geo import notation, sphere
from geo.box import Box
from geo.errors import UserError
from geo.forcing.quantity import needed
from geo.forcing.sources import Source


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
    blocks = ensemble.blocks
    for quantity in needed():
        missing, places = 0.0, []
        for number, (scenario, sources, (first, last)) in enumerate(
            zip(spec.scenarios, where.scenarios, ensemble.scenarios, strict=True)
        ):
            slots = np.arange(first, last)
            x, y, weight = lon[slots], lat[slots], probability[slots]
            everywhere = np.ones(last - first, bool)  # whether all terms have a value there
            for of, term, valid in silence.terms(scene.forcing, number, x, y):
                lost = np.where(valid, 0.0, weight)
                if of == quantity:
                    everywhere &= valid
                missed = blocks.total(lost, slots)
                if of == quantity and missed > 0:
                    share = missed / max(blocks.total(weight, slots), 1e-300)
                    middle = _middle(blocks, x, y, lost, slots)
                    silent = [source for source in sources.of(quantity) if source.name in term.names]
                    away = ", ".join(f'"{source.name}" {_away(source, *middle)}' for source in silent)
                    places.append(
                        f'{share:.0%} of {spec.story} "{scenario.name}", about {notation.position(*middle)}: {away}'
                    )
            missing += blocks.total(np.where(everywhere, 0.0, weight), slots)
        if missing > max_lost:
            summed = any(key[0] == quantity for named in where.scenarios for key in named.added)
            raise UserError(
                f"[[{quantity}]]: {missing:.0%} of the prior lies where there is no {quantity} ({'; '.join(places)}); "
                f"at most {max_lost:.0%} may be lost (max_lost). "
                + ("A sum has no value where one of its terms has none. " if summed else "")
                + f"Add a source, or move the {spec.story}"
            )


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
