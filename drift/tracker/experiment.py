"""Many runs of a tracking case side by side, in several ways of following on common random numbers, and their figures."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drift.tracker import following, study
from drift.tracker.figures import Figure, of_times
from drift.tracker.following import Errors
from drift.tracker.study import Study
from geo.array import Array
from geo.notation import KNOT, NMI
from kernels.coast import DeviceCoast

MET = "time to criteria"


@dataclass(frozen=True)
class Outcome:
    """What an experiment came to."""

    study: Study
    figures: tuple[Figure, ...]
    time: Array  # [s] at which figures are taken (times,)
    errors: Errors  # at those times (ways of following, runs, times)
    sweeps: int  # of the first run


def run(asked: Study, shore: DeviceCoast | None = None, tell: Callable[[float], None] = lambda share: None) -> Outcome:
    """Return the figures of an experiment; shore: on whose land nobody is; tell: takes the share that is done."""
    worlds, ways = study.worlds(asked, shore)
    found = following.follow(worlds, asked.methods, asked.size, asked.seed, bool(asked.areas), tell, shore)
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
    at_marks = Errors(*(_at(values, marked) for values in (errors.position, errors.course, errors.speed)))
    moments = study.marks(asked)
    return Outcome(
        asked,
        _figures(asked, errors, times, at_marks, _at(found.level, marked), moments),
        moments,
        at_marks,
        len(worlds[0].sweeps),
    )


def _at(values: Array, marked: Array) -> Array:
    """Return values (ways, runs, rows) at the rows that are marks (runs, rows), of which each run has as many."""
    return np.stack([values[:, k, own] for k, own in enumerate(marked)], axis=1)


def _figures(
    asked: Study, errors: Errors, times: Array, at_marks: Errors, levels: Array, moments: Array
) -> tuple[Figure, ...]:
    inside = (moments >= asked.window[0]) & (moments <= asked.window[1])
    scales = {"position": ("nmi", 1 / NMI), "course": ("deg", np.degrees(1.0)), "speed": ("kn", 1 / KNOT)}
    figures = [
        of_times(f"{name} error", unit, getattr(at_marks, name)[..., inside] * scale)
        for name, (unit, scale) in scales.items()
    ]
    figures.append(Figure("track held", "%", 100 * np.isfinite(at_marks.position[..., inside]).mean(axis=-1)))
    for share in asked.areas:
        inside_it = np.where(np.isfinite(levels), levels < share, np.nan)[..., inside]
        figures.append(of_times(f"in {100 * share:g} % area", "%", 100 * inside_it))
    if asked.criteria is not None:
        near = (errors.position < asked.criteria.position) & (errors.course < asked.criteria.course)
        near &= errors.speed < asked.criteria.speed
        first = np.take_along_axis(np.broadcast_to(times, near.shape), near.argmax(axis=-1)[..., None], axis=-1)[..., 0]
        figures.append(Figure(MET, "min", np.where(near.any(axis=-1), first, np.nan) / 60))
    return tuple(figures)
