"""Many runs of a tracking case, with several trackers on common random numbers."""

from collections.abc import Callable
from dataclasses import dataclass, fields

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
    """The results of an experiment."""

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
    """Return the figures of an experiment.

    Args:
        asked: the tracking case.
        shore: coast that particles avoid; None: no coast.
        tell: callback that receives the progress, 0 to 1.
    """
    worlds, ways = study.worlds(asked, shore)
    found = following.follow(
        worlds, asked.methods, asked.size, asked.seed, bool(asked.areas), tell, shore
    )
    place, velocity, regular = [], [], []
    for world, way in zip(worlds, ways, strict=True):
        recorded = world.sweeps.row >= 0
        there = way.at(world.sweeps.time[recorded])
        fill = found.place.shape[2] - int(recorded.sum())
        place.append(np.pad(there[0], ((0, fill), (0, 0)), constant_values=np.nan))
        velocity.append(np.pad(there[1], ((0, fill), (0, 0)), constant_values=np.nan))
        time = np.pad(world.sweeps.time[recorded], (0, fill), constant_values=np.nan)
        regular.append((time, np.pad(world.sweeps.marked[recorded], (0, fill))))
    times, marked = (np.stack(part) for part in zip(*regular, strict=True))
    errors = following.errors(found, times, np.stack(place), np.stack(velocity))
    at_marks = Errors(*(_at(getattr(errors, one.name), marked) for one in fields(Errors)))
    curves, moments = _curves(asked, at_marks, _at(found.level, marked)), study.marks(asked)
    return Outcome(
        asked,
        _figures(asked, errors, times, curves, moments),
        moments,
        curves,
        len(worlds[0].sweeps),
    )


def _at(values: Array, marked: Array) -> Array:
    """Return values (ways, runs, rows) at the marked rows (runs, rows) of each run."""
    return np.stack([values[:, k, own] for k, own in enumerate(marked)], axis=1)


def _curves(asked: Study, errors: Errors, levels: Array) -> tuple[Curve, ...]:
    """Return errors at marks, and whether areas contain the target there."""
    curves = [
        Curve("position error", "nmi", errors.position / NMI),
        Curve("course error", "deg", np.degrees(errors.course)),
        Curve("speed error", "kn", errors.speed / KNOT),
        Curve(study.CARRIED, "nmi", errors.carried / NMI),
    ]
    for share in asked.areas:
        inside = np.where(np.isfinite(levels), levels < share, np.nan)
        curves.append(Curve(study.in_area(share), "%", 100 * inside, 100 * share))
    return tuple(curves)


def _figures(
    asked: Study, errors: Errors, times: Array, curves: tuple[Curve, ...], moments: Array
) -> tuple[Figure, ...]:
    """Return means over the window, the share of it with a track, and the time to criteria."""
    inside = (moments >= asked.window[0]) & (moments <= asked.window[1])
    figures = [of_times(curve.name, curve.unit, curve.values[..., inside]) for curve in curves]
    finite = np.isfinite(curves[0].values[..., inside])
    figures.insert(3, Figure(study.HELD, "%", 100 * finite.mean(axis=-1)))
    if asked.criteria is not None:
        near = (errors.position < asked.criteria.position) & (errors.course < asked.criteria.course)
        near &= errors.speed < asked.criteria.speed
        first = np.take_along_axis(
            np.broadcast_to(times, near.shape), near.argmax(axis=-1)[..., None], axis=-1
        )[..., 0]
        figures.append(Figure(study.MET, "min", np.where(near.any(axis=-1), first, np.inf) / 60))
    return tuple(figures)
