"""The environment that a run asks for: sources of forcing, coast, and domain."""

import itertools
from dataclasses import dataclass
from typing import Literal

from drift.engine.environment.forcing_spec import Forcing, ForcingSpec
from geo.box import Box


@dataclass(frozen=True)
class Coast:
    """The source of the shoreline ("gshhg", "none" or an absolute path) and its effect on
    particles.
    """

    source: str
    behaviour: Literal["strand", "refloat", "slide"]
    # [s] half-life of stranding before a particle refloats; 0: it stays ashore
    half_life: float = 0.0
    offing: float = 0.0  # [m] distance from the beach at which it refloats
    lakes: bool | str = False  # True: lakes count as water; or the absolute path of a file of lakes


@dataclass(frozen=True)
class EnvironmentSpec:
    """The environment to open for a run, and how much probability may be lost where it
    lacks data.
    """

    forcing: Forcing
    coast: Coast
    domain: Box | None  # particles outside have departed; None: everything within reach
    max_lost: float

    @property
    def sources(self) -> tuple[ForcingSpec, ...]:
        """All sources."""
        return tuple(itertools.chain.from_iterable(self.forcing.values()))
