"""Many runs of a tracking case side by side, in several ways of following on common random numbers, and their figures."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from drift.tracker import following, study
from drift.tracker.following import Errors
from drift.tracker.study import Study
from geo.array import Array
from geo.notation import KNOT, NMI

QUANTILES = (0.1, 0.5, 0.9)
MET = "time to criteria"


@dataclass(frozen=True)
class Figure:
    """A number of each run, in every way of following."""

    name: str
    unit: str
    values: Array  # (ways of following, runs); NaN: that run has none

    def mean(self) -> Array:
        """Return the mean over the runs that have one (ways of following,)."""
        return _over(np.nanmean, self.values)

    def error(self) -> Array:
        """Return the standard error of the mean (ways of following,); NaN of fewer than two runs."""
        many = np.isfinite(self.values).sum(axis=1)
        spread = np.array(
            [np.nanstd(row, ddof=1) if n > 1 else np.nan for row, n in zip(self.values, many, strict=True)]
        )
        return np.asarray(spread / np.sqrt(np.maximum(many, 1)))

    def quantiles(self) -> Array:
        """Return the QUANTILES over the runs that have one (ways of following, quantiles)."""
        return np.stack([_over(partial(np.nanquantile, q=share), self.values) for share in QUANTILES], axis=1)

    def missing(self) -> Array:
        """Return in how many runs there is none (ways of following,)."""
        return np.asarray(np.isnan(self.values).sum(axis=1))


@dataclass(frozen=True)
class Outcome:
    """What an experiment came to."""

    study: Study
    figures: tuple[Figure, ...]
    time: Array  # [s] at which figures are taken (times,)
    errors: Errors  # at those times (ways of following, runs, times)
    sweeps: int  # of the first run


def run(asked: Study, tell: Callable[[float], None] = lambda share: None) -> Outcome:
    """Return the figures of an experiment; tell: takes the share that is done."""
    worlds, ways = study.worlds(asked)
    found = following.follow(worlds, asked.methods, asked.size, asked.seed, tell)
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
    return Outcome(asked, _figures(asked, errors, times, at_marks, moments), moments, at_marks, len(worlds[0].sweeps))


def _at(values: Array, marked: Array) -> Array:
    """Return values (ways, runs, rows) at the rows that are marks (runs, rows), of which each run has as many."""
    return np.stack([values[:, k, own] for k, own in enumerate(marked)], axis=1)


def _figures(asked: Study, errors: Errors, times: Array, at_marks: Errors, moments: Array) -> tuple[Figure, ...]:
    inside = (moments >= asked.window[0]) & (moments <= asked.window[1])
    scales = {"position": ("nmi", 1 / NMI), "course": ("deg", np.degrees(1.0)), "speed": ("kn", 1 / KNOT)}
    figures = [
        Figure(f"{name} error", unit, _over(np.nanmean, getattr(at_marks, name)[..., inside]) * scale)
        for name, (unit, scale) in scales.items()
    ]
    figures.append(Figure("track held", "%", 100 * np.isfinite(at_marks.position[..., inside]).mean(axis=-1)))
    if asked.criteria is not None:
        near = (errors.position < asked.criteria.position) & (errors.course < asked.criteria.course)
        near &= errors.speed < asked.criteria.speed
        first = np.take_along_axis(np.broadcast_to(times, near.shape), near.argmax(axis=-1)[..., None], axis=-1)[..., 0]
        figures.append(Figure(MET, "min", np.where(near.any(axis=-1), first, np.nan) / 60))
    return tuple(figures)


def _over(reduce: Callable[[Array], Array], values: Array) -> Array:
    """Return a mean or quantile over the last axis of what is no NaN; NaN where all are."""
    flat = values.reshape(-1, values.shape[-1])
    rows = [reduce(row) if np.isfinite(row).any() else np.nan for row in flat]
    return np.asarray(rows, np.float64).reshape(values.shape[:-1])
