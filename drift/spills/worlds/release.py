"""Draw the particles of each world about that world's release, with that world's unknowns.

Every class of objects has a range of slots, world after world. The ensemble's column `world` holds
the world of each slot.
"""

from typing import Any

import numpy as np

from drift.engine.motion.errors.forcing_error import Errors
from drift.engine.motion.models import drift
from drift.engine.motion.objects.leeway import AIR_IN_WATER
from drift.engine.motion.period import Period
from drift.engine.motion.scenario import TrackPrior
from drift.engine.particles import ensemble as record
from drift.engine.particles import members, partials
from drift.engine.particles.ensemble import Column, Ensemble, Layout
from drift.spills.worlds.records import FEWEST_PARTICLES, Spill
from drift.spills.worlds.releases import track_pieces
from drift.spills.worlds.worlds import Worlds
from geo import sphere
from geo.array import Array, Real
from geo.errors import UserError
from kernels.maths import noise
from kernels.runtime import runtime
from kernels.step import prior as kernel
from kernels.step.coast import DeviceCoast


def particles_per_class(spill: Spill) -> tuple[int, ...]:
    """Return the number of particles of each class in a world.

    It is in proportion to the share of the class, at least a hundredth of all and about ten.
    """
    if spill.counts is not None:
        return spill.counts
    share = np.maximum(
        [kind.share for kind in spill.kinds], max(0.01, FEWEST_PARTICLES / spill.per_world)
    )
    ends = np.rint(np.cumsum(share / share.sum()) * spill.per_world).astype(int)
    return tuple(int(n) for n in np.diff(ends, prepend=0))


def layout_of_worlds(spill: Spill, first: int = 0, last: int | None = None) -> Layout:
    """Return the slots of each class for a range of worlds.

    Args:
        spill: the spill.
        first: number of the first world.
        last: number after the last world; None: all.

    Returns:
        The slots.
    """
    counts = np.array(particles_per_class(spill))
    worlds = (spill.worlds if last is None else last) - first
    bounds = (0, *(int(n) for n in np.cumsum(counts) * worlds))
    numbers = tuple(int(n) for n in (np.cumsum(counts) - counts) * spill.worlds + counts * first)
    return Layout(bounds, numbers, tuple(int(n) for n in counts * partials.WORLDS))


def draw_release(
    spill: Spill, worlds: Worlds, period: Period, errors: Errors, coast: DeviceCoast, seed: int
) -> Ensemble:
    """Draw the ensemble of a spill's worlds; particles of a class have equal weights.

    Args:
        spill: the spill.
        worlds: its worlds.
        period: period of the run.
        errors: error laws of wind and current.
        coast: the coast on the device.
        seed: seed of the run.

    Returns:
        The ensemble.

    Raises:
        UserError: too many objects scattered about a release found no water.
    """
    ensemble, dry = draw_some_worlds(spill, worlds, period, errors, coast, seed)
    check_water(spill, dry)
    return ensemble


def check_water(spill: Spill, dry: Array) -> None:
    """Raise UserError if too many objects found no water.

    dry: number of objects of each class that found none, of all worlds, (classes,).
    """
    for failed, count in zip(dry.tolist(), particles_per_class(spill), strict=True):
        if failed > 0.01 * count * spill.worlds:
            raise UserError(
                f"[spill] release_std: {failed:,} of {count * spill.worlds:,} objects found no "
                "water about their release; make it smaller, or check [coast] source"
            )


def draw_some_worlds(
    spill: Spill,
    worlds: Worlds,
    period: Period,
    errors: Errors,
    coast: DeviceCoast,
    seed: int,
    own: Layout | None = None,
) -> tuple[Ensemble, Array]:
    """Draw the ensemble of some worlds, and count the objects that found no water.

    Args:
        spill: the spill.
        worlds: the worlds.
        period: period of the run.
        errors: error laws of wind and current.
        coast: the coast on the device.
        seed: seed of the run.
        own: slots of each class for these worlds only; None: for all worlds of the spill.

    Returns:
        The ensemble, and the number of objects of each class without water, int64 (classes,).
    """
    counts, own = particles_per_class(spill), own or layout_of_worlds(spill)
    ensemble, key, dry = (
        record.empty(seed, own, columns_of_worlds(worlds)),
        noise.key(seed),
        np.zeros(len(counts), np.int64),
    )
    releases = [
        runtime.upload(x.astype(np.int32))
        for x in (worlds.lon, worlds.lat, worlds.release - period.epoch)
    ]
    track = _track(spill.prior, worlds, period) if isinstance(spill.prior, TrackPrior) else None
    factor = runtime.upload(worlds.windage.astype(np.float32))
    log_weight = np.empty(ensemble.n, np.float32)
    for number, (kind, count, slots) in enumerate(
        zip(spill.kinds, counts, ensemble.slots, strict=True)
    ):
        tries = runtime.upload(np.zeros(2, np.int64))
        places = (ensemble.lon, ensemble.lat, ensemble.release, ensemble.world)
        common = (True, *slots, count, *places, tries, *key)
        if track is None:
            law = (*releases, spill.release_std, spill.release_duration)
            kernel.draw_objects(*common, *law, coast.pack)
        else:
            kernel.draw_lost(*common, *releases[:2], *track, spill.release_std, coast.pack)
        dry[number] = tries.to_numpy()[1]
        drift.draw_leeway(ensemble, slots, key, kind.object)
        if kind.object.immersion is not None:
            kernel.draw_immersion(
                *slots, ensemble.own["down_slope"], *key, *kind.object.immersion, AIR_IN_WATER
            )
        for name in drift.LEEWAY:
            kernel.scale_windage(*slots[:2], ensemble.own[name], ensemble.world, factor)
        if kind.sinking is not None:
            time = runtime.upload(worlds.sinking[:, number].astype(np.float32))
            kernel.draw_sinking(
                *slots,
                ensemble.sink_time,
                ensemble.release,
                ensemble.world,
                *key,
                time,
                kind.sinking.spread,
            )
        drift.draw_errors(ensemble, slots, key, errors.unbiased())
        with np.errstate(divide="ignore"):
            log_weight[slots.first : slots.last] = np.log(kind.share) - np.log(count * spill.worlds)
    copy_world_values(ensemble, worlds)
    # So far `world` counted from the first of these worlds; make it the number in the whole run.
    ensemble.world.from_numpy(ensemble.world.to_numpy() + np.int32(own.numbers[0] // counts[0]))
    ensemble.log_weight.from_numpy(log_weight)
    return ensemble, dry


def _track(prior: TrackPrior, worlds: Worlds, period: Period) -> tuple[Any, ...]:
    """Return the losses of worlds and the ship's track on the device, for kernel.draw_lost."""
    assert worlds.loss_begin is not None
    assert worlds.loss_length is not None
    assert worlds.clock is not None
    lon, lat, east, north, time = track_pieces(prior)
    shares = np.cumsum([loss.share for loss in prior.losses])
    whole = np.floor(time - period.epoch)
    values = (
        (worlds.loss_begin - period.epoch).astype(np.int32).ravel(),
        worlds.loss_length.astype(np.float32).ravel(),
        worlds.clock.astype(np.float32),
        (shares / shares[-1]).astype(np.float32),
        sphere.to_binary(np.degrees(np.stack([lon, lat], axis=1))).ravel(),
        np.stack([east, north], axis=1).astype(np.float32).ravel(),
        whole.astype(np.int32),
        (time - period.epoch - whole).astype(np.float32),
    )
    return tuple(runtime.upload(value) for value in values)


def columns_of_worlds(worlds: Worlds) -> tuple[Column, ...]:
    """Return the columns of the particles of worlds besides the core columns."""
    return drift.COLUMNS if worlds.member is None else (*drift.COLUMNS, members.COLUMN)


def copy_world_values(ensemble: Ensemble, worlds: Worlds) -> None:
    """Copy its world's values to every particle: the current's error and the ensemble member."""
    share(ensemble, worlds.current_east, worlds.current_north)
    if worlds.member is not None:
        ensemble.own[members.COLUMN.name].from_numpy(worlds.member[ensemble.world.to_numpy()])


def share(ensemble: Ensemble, east: Real, north: Real) -> None:
    """Copy the current's error of its world [m/s], (worlds,), to every particle."""
    world = ensemble.world.to_numpy()
    ensemble.own["current_bias_east"].from_numpy(east.astype(np.float32)[world])
    ensemble.own["current_bias_north"].from_numpy(north.astype(np.float32)[world])
