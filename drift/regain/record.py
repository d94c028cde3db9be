"""What is known of a contact that was lost."""

from collections.abc import Mapping
from dataclasses import dataclass

from drift.tracker.density import Region
from drift.tracker.holding import Held


@dataclass(frozen=True)
class Regained:
    """A track, and the areas of its cloud at the times shown."""

    held: Held
    areas: tuple[
        tuple[float, Mapping[float, Region]], ...
    ]  # [s] and what holds each share; none where the track is lost
