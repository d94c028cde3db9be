"""Many runs of a tracking case side by side, in several ways of following on common random numbers,
and their figures.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drift.tracking.tracker import following, study
from drift.tracking.tracker.figures import Curve, Figure, of_times
from drift.tracking.tracker.following import Errors
from drift.tracking.tracker.study import Study
from geo.array import Array
from geo.notation import KNOT, NMI
from kernels.step.coast import DeviceCoast


@dataclass(frozen=True)
class Outcome:
    """What an experiment came to."""

    study: Study
    figures: tuple[Figure, ...]
    time: Array  # [s] at which figures are taken (times,)
    curves: tuple[Curve, ...]  # errors at those times, and whether areas hold the target
    sweeps: int  # of the first run


def run(
    asked: Study,
    shore: DeviceCoast | None = None,
    tell: Callable[[float], None] = lambda share: None,
) -> Outcome:
    """Return the figures of an experiment; shore: on whose land nobody is; tell: takes the share
    that is done.
    """
    worlds, ways = study.worlds(asked, shore)
    found = following.follow(
        worlds, asked.methods, asked.size, asked.seed, bool(asked.areas), tell, shore
    )
    place, velocity, regular = [], [], []
    for world, way in zip(worlds, ways, strict=True):
        told = world.sweeps.row >= 0
        there = way.at(world.sweeps.time[told])
        fill = found.place.shape[2] - int(told.sum())
        place.append(np.pad(there[0], ((0, fill), (0, 0)), constant_values=np.nan))
        velocity.append(np.pad(there[1], ((0, fill), (0, 0)), constant_values=np.nan))
        time = np.pad(world.sweeps.time[told], (0, fill), constant_values=np.nan)
        regular.append((time, np.pad(world.sweeps.marked[told], (0, fill))))
    errors = following.errors(found, np.stack(place), np.stack(velocity))
    times, marked = (np.stack(part) for part in zip(*regular, strict=True))
    at_marks = Errors(
        *(_at(values, marked) for values in (errors.position, errors.course, errors.speed))
    )
    curves, moments = _curves(asked, at_marks, _at(found.level, marked)), study.marks(asked)
    return Outcome(
        asked,
        _figures(asked, errors, times, curves, moments),
        moments,
        curves,
        len(worlds[0].sweeps),
    )


def _at(values: Array, marked: Array) -> Array:
    """Return values (ways, runs, rows) at the rows that are marks (runs, rows), of which each run
    has as many.
    """
    return np.stack([values[:, k, own] for k, own in enumerate(marked)], axis=1)


def _curves(asked: Study, errors: Errors, levels: Array) -> tuple[Curve, ...]:
    """Return errors at marks, and whether areas hold the target there, by its level."""
    curves = [
        Curve("position error", "nmi", errors.position / NMI),
        Curve("course error", "deg", np.degrees(errors.course)),
        Curve("speed error", "kn", errors.speed / KNOT),
    ]
    for share in asked.areas:
        inside = np.where(np.isfinite(levels), levels < share, np.nan)
        curves.append(Curve(study.in_area(share), "%", 100 * inside, 100 * share))
    return tuple(curves)


def _figures(
    asked: Study, errors: Errors, times: Array, curves: tuple[Curve, ...], moments: Array
) -> tuple[Figure, ...]:
    """Return means over the window, the share of it that a track is held, and the time to criteria,
    by errors at all times.
    """
    inside = (moments >= asked.window[0]) & (moments <= asked.window[1])
    figures = [of_times(curve.name, curve.unit, curve.values[..., inside]) for curve in curves]
    held = np.isfinite(curves[0].values[..., inside])
    figures.insert(3, Figure(study.HELD, "%", 100 * held.mean(axis=-1)))
    if asked.criteria is not None:
        near = (errors.position < asked.criteria.position) & (errors.course < asked.criteria.course)
        near &= errors.speed < asked.criteria.speed
        first = np.take_along_axis(
            np.broadcast_to(times, near.shape), near.argmax(axis=-1)[..., None], axis=-1
        )[..., 0]
        figures.append(Figure(study.MET, "min", np.where(near.any(axis=-1), first, np.inf) / 60))
    return tuple(figures)
