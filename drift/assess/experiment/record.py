"""What an experiment came to, of whatever kind of case."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from drift.tracking.tracker.experiment import Outcome
from drift.tracking.tracker.figures import Figure


@dataclass(frozen=True)
class Experiment:
    """Figures of many runs in several ways, which share their random numbers."""

    title: str
    text: str  # of the case, and what was asked besides
    seed: int
    runs: int
    about: str  # of each run, in a few words
    ways: tuple[str, ...]
    figures: tuple[Figure, ...]
    published: Mapping[str, Mapping[str, float]] = field(default_factory=dict)  # by way and figure
    tracking: Outcome | None = None  # of a tracking case, with errors over time
    files: tuple[str, ...] = ()  # that the case read
