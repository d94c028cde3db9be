"""The results of an experiment."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from drift.tracking.tracker.experiment import Outcome
from drift.tracking.tracker.figures import Figure


@dataclass(frozen=True)
class Experiment:
    """Figures of many runs in several variants that share their random numbers."""

    title: str
    text: str  # text of the case, and the changes of each variant
    seed: int
    runs: int
    about: str  # size of each run, in a few words
    ways: tuple[str, ...]  # names of the variants, or of the methods of a tracking case
    figures: tuple[Figure, ...]
    # published values by method and figure
    published: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    tracking: Outcome | None = None  # errors over time; None unless it is a tracking case
    files: tuple[str, ...] = ()  # files that the case read
