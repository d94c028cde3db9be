"""Draws the initial ensemble from the scenarios' priors: time, position and object, in water.

Each scenario has a range of slots, about in proportion to its weight but at least a tenth of an
equal share, so that an unlikely scenario has enough particles. Log weights compensate for it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from drift.engine.motion import guided
from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.errors import buoys
from drift.engine.motion.models import by_name as models
from drift.engine.motion.models.by_name import model_of
from drift.engine.motion.period import Period
from drift.engine.motion.scenario import AreaPrior, PositionPrior, TracklinePrior
from drift.engine.motion.steering import steer
from drift.engine.particles import ensemble as record
from drift.engine.particles import members, partials, resample
from drift.engine.particles.ensemble import Ensemble, Layout, Slots
from drift.engine.particles.status import Status
from geo import sphere
from geo.array import Array
from geo.errors import UserError
from kernels.maths import noise
from kernels.runtime import runtime
from kernels.step import prior as kernel
from kernels.step.coast import DeviceCoast, open_sea

# [m] longest piece of a leg with one course: a great circle turns by less than 0.2 degrees at 45 N
PIECE = 20_000.0


@dataclass(frozen=True)
class Prior:
    """The initial ensemble, and how many positions were drawn for it."""

    ensemble: Ensemble
    tried: Array  # int64 (scenarios, 2): positions drawn, and particles left without water


def layout(spec: EnsembleSpec) -> Layout:
    """Return the layout of slots by scenario for a whole run.

    Raises:
        UserError: if there are fewer particles than scenarios.
    """
    if spec.particles < len(spec.scenarios):
        raise UserError(
            f"particles: {spec.particles} are too few for {len(spec.scenarios)} scenarios; give at least one each"
        )
    bounds = _bounds(spec, counts_of(spec))
    return Layout(bounds, bounds[:-1], (partials.BLOCK,) * len(spec.scenarios))


def empty(spec: EnsembleSpec, own: Layout, *, still: bool = False) -> Ensemble:
    """Return an ensemble with the columns of the scenarios' models, before any draw; still: without
    these columns.
    """
    columns = (
        *(() if still else models.columns(spec.scenarios)),
        *((members.COLUMN,) if spec.members else ()),
    )
    columns = (*columns, *guided.columns(spec.guiding), *buoys.columns(*spec.buoys))
    return record.empty(spec.seed, own, columns)


def draw_ensemble(
    spec: EnsembleSpec, coast: DeviceCoast | None, own: Layout | None = None, *, still: bool = False
) -> Prior:
    """Return the initial ensemble of the scenarios, restricted to water.

    Args:
        spec: of the ensemble.
        coast: on the device; None without one.
        own: layout of a shard; None: the whole run.
        still: leave out the motion models' columns, which take more than half of the time, unless a
            scenario steers.
    """
    whole = layout(spec)
    own = own or whole
    steering = models.steering(spec.scenarios, spec.period, spec.errors)
    still = still and not steering
    ensemble = empty(spec, own, still=still)
    key = noise.key(spec.seed)
    tried: list[tuple[int, int]] = []
    for scenario, slots in zip(spec.scenarios, ensemble.slots, strict=True):
        drawn = failed = 0
        if scenario.prior is not None:
            tries = runtime.upload(np.zeros(2, np.int64))
            DRAWS[type(scenario.prior)](
                scenario.prior, _Draw(spec.period, ensemble, slots, key, tries, coast)
            )
            drawn, failed = (int(x) for x in tries.to_numpy())
        tried.append((drawn, failed))
        if not still:
            model_of(scenario).draw(ensemble, slots, key, scenario, spec.errors)
    begun = np.array(tried)
    if steering:
        begun = begun + steer.draw_targets(ensemble, steering, coast)
    counts = counts_of(spec)
    # number in its scenario
    within = ensemble.places - np.repeat(whole.bounds[:-1], np.diff(own.bounds))
    spare = within >= np.repeat(counts, np.diff(own.bounds))
    log_weight = _log_weights(spec, ensemble, counts, spare)
    if spec.members:
        _assign_members(spec, ensemble, counts, within, log_weight)
    ensemble.log_weight.from_numpy(log_weight)
    if spare.any():
        ensemble.status.from_numpy(
            np.where(spare, int(Status.LEFT), ensemble.status.to_numpy()).astype(np.int32)
        )
    return Prior(ensemble, begun)


def shares_on_land(
    spec: EnsembleSpec, tried: Array, coast: DeviceCoast | None
) -> tuple[float, ...]:
    """Return the share of each scenario's prior that lies on land and was left out.

    Args:
        spec: of the ensemble.
        tried: `Prior.tried`, summed over the run.
        coast: on the device; None without one.

    Raises:
        UserError: if a scenario's prior contains almost no water.
    """
    return tuple(
        _share_on_land(spec, number, many, tried[number], coast)
        for number, many in enumerate(np.diff(layout(spec).bounds).tolist())
    )


def _share_on_land(
    spec: EnsembleSpec, number: int, many: int, tried: Array, coast: DeviceCoast | None
) -> float:
    """Return the share of a scenario's prior on land; raise UserError if it contains almost no
    water.
    """
    drawn, failed = tried
    if failed:
        fault = (
            "its area is too thin to draw from"
            if coast is None
            else "its prior lies on land, or is too thin"
        )
        raise UserError(
            f'scenario "{spec.scenarios[number].name}": {fault}: {failed} of {many} particles found no place '
            "in many tries; move or widen it, or check [coast] source"
        )
    # positions that are copied from another object are not drawn
    return 1.0 - many / float(drawn) if drawn else 0.0


def counts_of(spec: EnsembleSpec) -> list[int]:
    """Return the number of particles of each scenario."""
    if spec.counts is not None:
        return list(spec.counts)
    weights = np.array([scenario.weight for scenario in spec.scenarios])
    share = np.maximum(weights, resample.LEAST_SHARE / weights.size)
    inner = np.rint(np.cumsum(share / share.sum()) * spec.particles).astype(int)
    return [int(x) for x in np.diff(inner, prepend=0)]


def _bounds(spec: EnsembleSpec, counts: list[int]) -> tuple[int, ...]:
    """Return the first slot of each scenario and, last, their number, including spare slots for
    resampling.
    """
    if spec.resampling is not None:
        counts = [resample.METHODS[spec.resampling].slots(n) for n in counts]
    return (0, *(int(x) for x in np.cumsum(counts)))


def _log_weights(spec: EnsembleSpec, ensemble: Ensemble, counts: list[int], spare: Array) -> Array:
    """Return log weights (n,); over the whole run those of a scenario add up to its weight."""
    each = []
    for scenario, count in zip(spec.scenarios, counts, strict=True):
        if count == 0 and scenario.weight > 0:
            raise UserError(
                f'scenario "{scenario.name}" gets none of the {spec.particles} particles; raise particles or lower the '
                "number of scenarios"
            )
        with np.errstate(divide="ignore"):
            each.append(np.log(scenario.weight) - np.log(max(count, 1)))
    return np.where(spare, -np.inf, np.repeat(each, np.diff(ensemble.bounds))).astype(np.float32)


def _assign_members(
    spec: EnsembleSpec, ensemble: Ensemble, counts: list[int], within: Array, log_weight: Array
) -> None:
    """Assign each particle a forcing ensemble member, equally likely in each scenario, in place.

    within: number of each particle in its scenario, (n,).
    """
    many, column = len(spec.members), np.zeros(ensemble.n, np.int32)
    for scenario, (first, last), count in zip(
        spec.scenarios, ensemble.scenarios, counts, strict=True
    ):
        if count < many:
            raise UserError(
                f'scenario "{scenario.name}" gets {count} of the {sum(counts)} particles, which is too few for {many} '
                "members of the ensemble of winds or currents: it needs one for each; raise particles, or plan.particles of a plan"
            )
        own = first + np.flatnonzero(within[first:last] < count)
        ends = members.ends(count, many)
        column[own] = np.searchsorted(ends, within[own], "right")
        share = -np.log(many) - np.log(np.diff(ends, prepend=0))  # members are equally likely
        log_weight[own] += share[column[own]] + np.log(count)
    ensemble.own[members.COLUMN.name].from_numpy(column)


class _Draw(NamedTuple):
    """The inputs, besides its prior, for drawing one scenario's slots."""

    period: Period
    ensemble: Ensemble
    slots: Slots
    key: tuple[int, int]
    tries: Any  # int64 (2,) on the device: positions drawn, slots left without water
    coast: DeviceCoast | None

    @property
    def common(self) -> tuple[Any, ...]:
        """The first arguments of the kernels that draw positions."""
        return self.coast is not None, *self.slots, self.ensemble.lon, self.ensemble.lat

    @property
    def water(self) -> Any:
        """The last argument of these kernels."""
        return (self.coast or open_sea()).pack

    def release(self, first: np.datetime64, last: np.datetime64) -> None:
        """Draw release times, uniform between two times."""
        window = sorted((self.period.elapsed(first), self.period.elapsed(last)))
        kernel.draw_release(*self.slots, self.ensemble.release, *self.key, *window)


def _draw_position(prior: PositionPrior, to: _Draw) -> None:
    """Draw positions about a reported position, and release times."""
    to.release(prior.release_start, prior.release_end)
    lon, lat = (int(sphere.to_binary(np.degrees(x))) for x in (prior.lon, prior.lat))
    nearest, farthest, bearing, sector = 0.0, 0.0, 0.0, 0.0
    if prior.displacement:
        (nearest, farthest), (bearing, end) = (
            prior.displacement.distance,
            prior.displacement.direction,
        )
        sector = end - bearing
    kernel.draw_position(
        *to.common,
        to.tries,
        *to.key,
        lon,
        lat,
        prior.major,
        prior.minor,
        prior.orientation,
        nearest,
        farthest,
        bearing,
        sector,
        to.water,
    )


def _draw_area(prior: AreaPrior, to: _Draw) -> None:
    """Draw positions in an area, and release times."""
    to.release(prior.release_start, prior.release_end)
    vertices, west, south, width, height = _polygon(prior)
    inside = np.array([south, south + height]) * sphere.UNIT
    broadest = 1.0 if inside[0] <= 0 <= inside[1] else float(np.cos(np.abs(inside).min()))
    kernel.draw_area(
        *to.common,
        to.tries,
        *to.key,
        runtime.upload(vertices),
        west,
        south,
        width,
        height,
        broadest,
        to.water,
    )


def _draw_trackline(prior: TracklinePrior, to: _Draw) -> None:
    """Draw positions and release times along a voyage."""
    points, courses, lengths, ends = _pieces(prior)
    mode = -1.0 if prior.mode is None else prior.mode
    voyage = to.period.direction * float((prior.arrival - prior.departure) / np.timedelta64(1, "s"))
    kernel.draw_trackline(
        *to.common,
        to.ensemble.release,
        to.tries,
        *to.key,
        *(runtime.upload(x) for x in (points, courses, lengths, ends)),
        prior.cross_track,
        prior.low,
        prior.high,
        mode,
        to.period.elapsed(prior.departure),
        voyage,
        *_tilt(prior),
        to.water,
    )


def _tilt(prior: TracklinePrior) -> tuple[Any, ...]:
    """Return the arguments of the kernel about a hazard along the voyage."""
    if prior.tilt is None:
        return False, *(runtime.upload(np.zeros(1, np.float32)) for _ in range(4))
    tables = prior.tilt.law, prior.tilt.proposed, prior.tilt.most, prior.tilt.hazard
    return True, *(runtime.upload(table) for table in tables)


DRAWS: dict[type, Callable[[Any, _Draw], None]] = {
    PositionPrior: _draw_position,
    AreaPrior: _draw_area,
    TracklinePrior: _draw_trackline,
}


def _polygon(prior: AreaPrior) -> tuple[Array, int, int, int, int]:
    """Return vertices as binary angles and their bounding box (west, south, width, height)."""
    lon, lat = np.degrees(prior.lon), np.degrees(prior.lat)
    vertices = np.stack([sphere.to_binary(lon), sphere.to_binary(lat)], axis=1)
    west, east = (int(x) for x in np.rint(np.array([lon.min(), lon.max()]) * (sphere.TURN / 360)))
    south, north = int(vertices[:, 1].min()), int(vertices[:, 1].max())
    wrapped = (west + 2**31) % sphere.TURN - 2**31
    return vertices.reshape(-1).astype(np.int32), wrapped, south, east - west, north - south


def _pieces(prior: TracklinePrior) -> tuple[Array, Array, Array, Array]:
    """Return starts (lon, lat binary), courses [rad], lengths [m], and the share of the voyage at
    each end.
    """
    lon, lat = sphere.track(prior.lon, prior.lat, PIECE)
    east, north = sphere.offset(lon[:-1], lat[:-1], lon[1:], lat[1:])
    course, length = np.arctan2(east, north).astype(np.float32), np.hypot(east, north)
    points = sphere.to_binary(np.degrees(np.stack([lon, lat], axis=1)[:-1]))
    return (
        points,
        course,
        length.astype(np.float32),
        (np.cumsum(length) / length.sum()).astype(np.float32),
    )
