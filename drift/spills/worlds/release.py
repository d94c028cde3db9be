"""The objects of a spill: each world's particles, drawn about that world's release.

They move as that world's unknowns say.

Every class of objects has a range of slots, world after world; a slot's world stands in the
ensemble's column.
"""

import numpy as np

from drift.engine.motion import drift
from drift.engine.motion.forcing_error import Errors
from drift.engine.motion.leeway import AIR_IN_WATER
from drift.engine.motion.period import Period
from drift.engine.particles import ensemble as record
from drift.engine.particles import members, partials
from drift.engine.particles.ensemble import Column, Ensemble, Layout
from drift.spills.worlds.records import FEWEST_PARTICLES, Spill
from drift.spills.worlds.worlds import Worlds
from geo.array import Array, Real
from geo.errors import UserError
from kernels.maths import noise
from kernels.runtime import runtime
from kernels.step import prior as kernel
from kernels.step.coast import DeviceCoast


def per_world(spill: Spill) -> tuple[int, ...]:
    """Return the particles of each class in a world.

    They are in proportion to its share, at least a hundredth of all and about ten.
    """
    if spill.counts is not None:
        return spill.counts
    share = np.maximum(
        [kind.share for kind in spill.kinds], max(0.01, FEWEST_PARTICLES / spill.per_world)
    )
    ends = np.rint(np.cumsum(share / share.sum()) * spill.per_world).astype(int)
    return tuple(int(n) for n in np.diff(ends, prepend=0))


def layout(spill: Spill, first: int = 0, last: int | None = None) -> Layout:
    """Return which slots belong to which class, of the worlds from number `first` to before `last`;
    by default of all.
    """
    counts = np.array(per_world(spill))
    many = (spill.worlds if last is None else last) - first
    bounds = (0, *(int(n) for n in np.cumsum(counts) * many))
    numbers = tuple(int(n) for n in (np.cumsum(counts) - counts) * spill.worlds + counts * first)
    return Layout(bounds, numbers, tuple(int(n) for n in counts * partials.WORLDS))


def draw_release(
    spill: Spill, worlds: Worlds, period: Period, errors: Errors, coast: DeviceCoast, seed: int
) -> Ensemble:
    """Return the ensemble of a spill's worlds, each class of equal weight within.

    Raises UserError when objects scattered about a release find no water.
    """
    ensemble, dry = drawn(spill, worlds, period, errors, coast, seed)
    check(spill, dry)
    return ensemble


def check(spill: Spill, dry: Array) -> None:
    """Refuse a spill whose objects find no water; dry: how many of each class did not, of all
    worlds, (classes,).
    """
    for failed, count in zip(dry.tolist(), per_world(spill), strict=True):
        if failed > 0.01 * count * spill.worlds:
            raise UserError(
                f"[spill] release_std: {failed:,} of {count * spill.worlds:,} objects found no water about their "
                "release; make it smaller, or check [coast] source"
            )


def drawn(
    spill: Spill,
    worlds: Worlds,
    period: Period,
    errors: Errors,
    coast: DeviceCoast,
    seed: int,
    own: Layout | None = None,
) -> tuple[Ensemble, Array]:
    """Return the ensemble of some worlds, and how many objects of each class found no water, int64
    (classes,).

    own: which slots belong to which class, of these worlds alone; by default of all worlds.
    """
    counts, own = per_world(spill), own or layout(spill)
    ensemble, key, dry = (
        record.empty(seed, own, columns(worlds)),
        noise.key(seed),
        np.zeros(len(counts), np.int64),
    )
    where = [
        runtime.upload(x.astype(np.int32))
        for x in (worlds.lon, worlds.lat, worlds.release - period.epoch)
    ]
    factor = runtime.upload(worlds.windage.astype(np.float32))
    log_weight = np.empty(ensemble.n, np.float32)
    for number, (kind, count, slots) in enumerate(
        zip(spill.kinds, counts, ensemble.slots, strict=True)
    ):
        tries = runtime.upload(np.zeros(2, np.int64))
        kernel.draw_objects(
            True,
            *slots,
            count,
            ensemble.lon,
            ensemble.lat,
            ensemble.release,
            ensemble.world,
            tries,
            *key,
            *where,
            spill.release_std,
            spill.release_duration,
            coast.pack,
        )
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
    belong(ensemble, worlds)
    # Until here a slot's world is its number among those that are here.
    ensemble.world.from_numpy(ensemble.world.to_numpy() + np.int32(own.numbers[0] // counts[0]))
    ensemble.log_weight.from_numpy(log_weight)
    return ensemble, dry


def columns(worlds: Worlds) -> tuple[Column, ...]:
    """Return the columns that the particles of worlds have besides the core."""
    return drift.COLUMNS if worlds.member is None else (*drift.COLUMNS, members.COLUMN)


def belong(ensemble: Ensemble, worlds: Worlds) -> None:
    """Give every particle what its world has: the error of the current, and its member of an
    ensemble.
    """
    share(ensemble, worlds.current_east, worlds.current_north)
    if worlds.member is not None:
        ensemble.own[members.COLUMN.name].from_numpy(worlds.member[ensemble.world.to_numpy()])


def share(ensemble: Ensemble, east: Real, north: Real) -> None:
    """Give every particle the error of the current that its world has drawn [m/s], shape (worlds,)."""
    world = ensemble.world.to_numpy()
    ensemble.own["current_bias_east"].from_numpy(east.astype(np.float32)[world])
    ensemble.own["current_bias_north"].from_numpy(north.astype(np.float32)[world])
