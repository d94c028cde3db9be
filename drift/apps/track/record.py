"""Records of `drift track`: the track, and the path to regain contact."""

from dataclasses import dataclass

from drift.tracking.tracker.holding import Held
from drift.tracking.tracker.pursuit import Pursued
from geo.array import Array


@dataclass(frozen=True)
class Chased:
    """A path, and its score on a check cloud that was not used to plan it.

    judged: share of the check cloud within reach by each look.
    """

    found: Pursued
    judged: Array  # NaN: the other cloud has lost the track


@dataclass(frozen=True)
class Failed:
    """The reason why there is no path."""

    why: str


@dataclass(frozen=True)
class Regained:
    """An estimated track with its areas, and the path to meet or avoid the target, if requested."""

    held: Held
    chased: Chased | Failed | None = None
