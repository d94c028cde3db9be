"""What is known of a contact that was lost."""

from dataclasses import dataclass

from drift.tracking.tracker.holding import Held
from drift.tracking.tracker.pursuit import Pursued
from geo.array import Array


@dataclass(frozen=True)
class Chased:
    """A path, and the share of another cloud, which its plans have not seen, that it meets by each
    of its looks.
    """

    found: Pursued
    judged: Array  # NaN: the other cloud has lost the track


@dataclass(frozen=True)
class Failed:
    """That there is no path."""

    why: str


@dataclass(frozen=True)
class Regained:
    """A track with its areas, and a path on which to meet or to avoid it, if one was asked for."""

    held: Held
    chased: Chased | Failed | None = None
