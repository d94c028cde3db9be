"""What is known of a contact that was lost."""

from collections.abc import Mapping
from dataclasses import dataclass

from drift.tracker.density import Region
from drift.tracker.holding import Held
from drift.tracker.pursuit import Pursued
from geo.array import Array


@dataclass(frozen=True)
class Chased:
    """A path, and the share of another cloud, which its plans have not seen, that it meets by each of its looks."""

    found: Pursued
    judged: Array


@dataclass(frozen=True)
class Regained:
    """A track, the areas of its cloud at the times shown, and a path on which to meet or to avoid it."""

    held: Held
    areas: tuple[
        tuple[float, Mapping[float, Region]], ...
    ]  # [s] and what holds each share; none where the track is lost
    chased: Chased | None = None
