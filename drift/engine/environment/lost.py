"""Rejects runs that lose more probability than allowed where there is no forcing or outside the
domain.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from drift.engine.environment import domain, silence
from drift.engine.environment.environment import Environment
from drift.engine.environment.silence import AtEnd
from drift.engine.motion.clock import Clock
from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.forcing import Term
from drift.engine.motion.scene import Scene
from drift.engine.particles import members, partials
from drift.engine.particles.ensemble import Ensemble
from drift.engine.particles.partials import PART, Blocks, Partial
from drift.engine.particles.status import LOST, Status
from geo import notation, sphere
from geo.array import Array
from geo.box import Box
from geo.errors import UserError
from geo.forcing.quantity import required_quantities
from geo.forcing.sources import Source

MANY = 10  # scenarios listed in an error message


@dataclass(frozen=True)
class Lacking:
    """Prior probability outside the domain or without forcing, of a run or of one shard.

    Each sum holds the weight and the weighted unit vectors of the positions, by block: see
    `_sums_with_positions`.
    """

    weight: Partial  # of all particles, (1,)
    beyond: Partial  # outside the domain
    # by quantity: where at least one of its terms has no value, (1,)
    missing: Mapping[str, Partial]
    # By quantity, number of the scenario group (see _scenarios_by_sources) and of the term in it: where
    # the term has no value; and the weight of all particles that use it, (1,).
    silent: Mapping[tuple[str, int, int], tuple[Partial, Partial]]


def prior_without_forcing(box: Box, ensemble: Ensemble, scene: Scene, clock: Clock) -> Lacking:
    """Return the part of an initial ensemble that lacks forcing at the start of the run."""
    low, high, _ = next(clock.steps())
    scene.forcing.set(low, high)
    lon, lat, release, logs = (
        column.to_numpy()
        for column in (ensemble.lon, ensemble.lat, ensemble.release, ensemble.log_weight)
    )
    member = members.member_of_particles(ensemble)
    parts = []
    for blocks, (first, last) in ensemble.blocks.cuts(PART):
        own = slice(first, last)
        weight = np.exp(logs[own].astype(np.float64))
        # Particles released later may find a value where a source has none yet; `check_end` covers
        # them.
        now = np.where(release[own] <= clock.step, weight, 0.0)
        parts.append(
            _lacking(
                box,
                scene,
                blocks,
                weight,
                _Begun(lon[own], lat[own], now, None if member is None else member[own]),
            )
        )
    return merged(parts)


class _Begun(NamedTuple):
    """Initial positions [binary angle] and weights, (n,); the weight is 0 for later releases."""

    lon: Array
    lat: Array
    weight: Array
    member: Array | None  # forcing ensemble member of each; None: no ensemble


def _lacking(box: Box, scene: Scene, blocks: Blocks, whole: Array, begun: _Begun) -> Lacking:
    """Return the part of some blocks of particles that lacks forcing; whole: weights, (n,)."""
    west, south, width, height = domain.binary(box)
    x, y = begun.lon.astype(np.int64), begun.lat.astype(np.int64)
    beyond = np.flatnonzero(((x - west) % sphere.TURN > width) | (y < south) | (y > south + height))
    scenario = np.repeat(blocks.scenario, np.diff(blocks.first, append=blocks.n))
    missing: dict[str, list[Partial]] = {quantity: [] for quantity in required_quantities()}
    silent: dict[tuple[str, int, int], tuple[Partial, Partial]] = {}
    for number, sea in enumerate(_scenarios_by_sources(scene)):
        slots = np.flatnonzero(np.isin(scenario, sea))
        seen = blocks.partial(begun.weight[slots], slots=slots)
        # where a term has no value
        lacks = {quantity: np.zeros(slots.size, bool) for quantity in required_quantities()}
        lon, lat = begun.lon[slots], begun.lat[slots]
        member = None if begun.member is None else begun.member[slots]
        for k, (quantity, _, valid) in enumerate(
            silence.terms(scene.forcing, sea[0], lon, lat, member)
        ):
            lacks[quantity] |= ~valid
            silent[quantity, number, k] = _sums_with_positions(blocks, begun, slots[~valid]), seen
        for quantity, there in lacks.items():
            missing[quantity].append(blocks.partial(begun.weight[slots[there]], slots=slots[there]))
    together = {
        quantity: replace(parts[0], sums=np.sum([part.sums for part in parts], axis=0))
        for quantity, parts in missing.items()
    }
    return Lacking(
        blocks.partial(whole), _sums_with_positions(blocks, begun, beyond), together, silent
    )


def merged(parts: Sequence[Lacking]) -> Lacking:
    """Return the sums of all shards."""
    first, merge = parts[0], partials.merge_partials
    return Lacking(
        merge([part.weight for part in parts]),
        merge([part.beyond for part in parts]),
        {key: merge([part.missing[key] for part in parts]) for key in first.missing},
        {
            key: (
                merge([part.silent[key][0] for part in parts]),
                merge([part.silent[key][1] for part in parts]),
            )
            for key in first.silent
        },
    )


def check_prior(
    spec: EnsembleSpec, where: Environment, max_lost: float, scene: Scene, lacks: Lacking
) -> None:
    """Raise UserError if more than a share of the prior is without forcing or outside the
    domain.
    """
    whole = float(lacks.weight.total[0, 0])
    _check_domain(where.box, max_lost, lacks.beyond.total[0] / whole)
    for quantity, partial in lacks.missing.items():
        missing = float(partial.total[0, 0]) / whole
        if missing > max_lost:
            places = []
            for (of, sea, k), sums in lacks.silent.items():
                if of == quantity:
                    numbers = _scenarios_by_sources(scene)[sea]
                    term = [
                        term
                        for own in required_quantities()
                        for term in scene.forcing.terms[numbers[0]][own]
                    ][k]
                    places += _losses_by_scenario(spec, where, quantity, term, numbers, *sums)
            summed = any(key[0] == quantity for named in where.scenarios for key in named.added)
            raise UserError(
                f"[[{quantity}]]: {notation.percent(missing)} of the prior lies where there is no {quantity} ({_list_losses(places)}); "
                f"at most {notation.hundredths(max_lost)} % may be lost (max_lost). "
                + ("A sum has no value where one of its terms has none. " if summed else "")
                + f"Add a source, or move the {spec.story}"
            )


def _scenarios_by_sources(scene: Scene) -> list[tuple[int, ...]]:
    """Return groups of scenario numbers that use the same sources of all required quantities."""
    together: dict[tuple[Any, ...], list[int]] = {}
    for number, ranges in enumerate(scene.forcing.ranges):
        together.setdefault(
            tuple(ranges[quantity] for quantity in required_quantities()), []
        ).append(number)
    return [tuple(sea) for sea in together.values()]


def _losses_by_scenario(
    spec: EnsembleSpec,
    where: Environment,
    quantity: str,
    term: Term,
    sea: tuple[int, ...],
    lacks: Partial,
    seen: Partial,
) -> list[tuple[int, str]]:
    """Return the scenarios of a group with particles where a term has no value: number, and share
    and place as text.
    """
    found = []
    for number in sea:
        (lost, *vector), whole = lacks.by_scenario[number, 0], seen.by_scenario[number, 0, 0]
        if not lost > 0:
            continue
        middle = _middle(vector)
        silent = [
            source for source in where.scenarios[number].of(quantity) if source.name in term.names
        ]
        away = ", ".join(
            f'"{source.name}" {_where_source_begins(source, *middle)}' for source in silent
        )
        share, name = lost / max(whole, 1e-300), spec.scenarios[number].name
        found.append(
            (
                number,
                f'{notation.percent(share)} of {spec.story} "{name}", about {notation.position(*middle)}: {away}',
            )
        )
    return found


def _list_losses(places: list[tuple[int, str]]) -> str:
    """Return the text of losses by scenario, in their order; of many only the first."""
    words = [text for _, text in sorted(places, key=lambda place: place[0])]
    return "; ".join(
        [*words[:MANY], f"and {len(words) - MANY} more"] if len(words) > MANY else words
    )


def check_end(
    where: Environment,
    max_lost: float,
    scene: Scene,
    clock: Clock,
    status: Array,
    ends: Callable[[], Iterable[AtEnd]],
) -> None:
    """Raise UserError if a run has lost more than a share of the probability by its end.

    Args:
        where: of the run.
        max_lost: largest share allowed.
        scene: of the run.
        clock: of the run.
        status: probability of each status, (statuses,).
        ends: returns the particles at the end, part by part.
    """
    lost = {of: float(status[of]) for of in LOST}
    if sum(lost.values()) <= max_lost:
        return
    box, silent = where.box, silence.in_words(silence.lost(scene.forcing, clock, ends))
    raise UserError(
        f"{notation.percent(sum(lost.values()))} of the probability was lost by the end: {notation.percent(lost[Status.OUTSIDE])} ran out of "
        f"forcing{f' (no value: {silent})' if silent else ''}, {notation.percent(lost[Status.LEFT])} left the domain "
        f"({box.west:.2f}..{box.east:.2f} E, {box.south:.2f}..{box.north:.2f} N); at most {notation.hundredths(max_lost)} % is "
        "allowed (max_lost). Shorten the run, add a source, or widen [domain]"
    )


def _check_domain(box: Box, max_lost: float, beyond: Array) -> None:
    """Raise UserError if more than a share of a prior is outside the domain; beyond: that share's
    sums.
    """
    share, *vector = beyond
    if share <= max_lost:
        return
    x, y = _middle(vector)
    raise UserError(
        f"[domain]: {notation.percent(share)} of the prior lies outside it, about {notation.position(x, y)}, from where it is "
        f"{_edge(box, x, y)} to its edge ({box.west:.2f}..{box.east:.2f} E {box.south:.2f}..{box.north:.2f} N); "
        f"at most {notation.hundredths(max_lost)} % may be lost (max_lost). Widen [domain], or leave it out"
    )


def _sums_with_positions(blocks: Blocks, begun: _Begun, slots: Array) -> Partial:
    """Return the sums of the weights of some slots, and of the weighted unit vectors of their
    positions, (4,).
    """
    x, y, own = begun.lon[slots] * sphere.UNIT, begun.lat[slots] * sphere.UNIT, begun.weight[slots]
    return blocks.partial(
        own, own * np.cos(y) * np.cos(x), own * np.cos(y) * np.sin(x), own * np.sin(y), slots=slots
    )


def _middle(vector: Sequence[float]) -> tuple[float, float]:
    """Return the position (lon, lat) [deg] in the direction of a vector."""
    east, north, up = vector
    return math.degrees(math.atan2(north, east)), math.degrees(
        math.atan2(up, math.hypot(east, north))
    )


def _where_source_begins(source: Source, lon: float, lat: float) -> str:
    """Return the distance and direction from a point [deg] to the domain of a source, as text.

    A value missing inside the domain is land or a gap.
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
    return f"begins {notation.distance_and_direction(lon, lat, float(x[near]), float(y[near]))}"


def _edge(box: Box, lon: float, lat: float) -> str:
    """Return the distance and direction from a point [deg] to the edge of a box, as text.

    It is accurate to about a thousandth of the box's size.
    """
    share = np.linspace(0, 1, 1001)
    x, y = box.west + share * (box.east - box.west), box.south + share * (box.north - box.south)
    x, y = (
        np.concatenate([x, x, 0 * y + box.west, 0 * y + box.east]),
        np.concatenate([0 * x + box.south, 0 * x + box.north, y, y]),
    )
    near = int(
        np.argmin(sphere.distance(np.radians(lon), np.radians(lat), np.radians(x), np.radians(y)))
    )
    return notation.distance_and_direction(lon, lat, float(x[near]), float(y[near]))
