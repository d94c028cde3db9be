"""What a run asks of its surroundings: sources of forcing, a coast, and the box that it stays in."""

import itertools
from dataclasses import dataclass
from typing import Literal

from drift.engine.environment.forcing_spec import Forcing, ForcingSpec
from geo.box import Box


@dataclass(frozen=True)
class Coast:
    """Where the shoreline comes from ("gshhg", "none" or an absolute path) and what it does to a
    particle.
    """

    source: str
    behaviour: Literal["strand", "refloat", "slide"]
    # [s] of lying ashore before it is afloat again; 0: it lies there for good
    half_life: float = 0.0
    offing: float = 0.0  # [m] off the beach where it is afloat again
    lakes: bool | str = False  # water; or the absolute path of a file of lakes


@dataclass(frozen=True)
class EnvironmentSpec:
    """What is to be opened for a run, and how much of the probability may be lost to what it lacks."""

    forcing: Forcing
    coast: Coast
    domain: Box | None  # outside which a particle has left; None: all that can be reached
    max_lost: float

    @property
    def sources(self) -> tuple[ForcingSpec, ...]:
        """All sources."""
        return tuple(itertools.chain.from_iterable(self.forcing.values()))
