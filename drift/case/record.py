"""The case as the rest of the program knows it: a frozen record, validated, in SI and UTC."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from drift.case.expect import Expect
from drift.engine.environment.environment_spec import Coast
from drift.engine.environment.forcing_spec import Forcing, ForcingSpec
from drift.engine.motion.forcing_error import Errors, ForcingError
from drift.engine.motion.period import Period
from drift.engine.motion.scenario import Scenario
from drift.evidence.filter.records import Contact, PlanSpec, Resampling, Sensors, Sortie, Unit
from drift.evidence.sensors.records import Processing, Sensor, Tow
from drift.spills.worlds.records import Spill
from geo import notation
from geo.box import Box
from geo.cells import Cells


@dataclass(frozen=True)
class Depth:
    """Where the depths come from that tell where boats have too little water."""

    file: str  # absolute path
    variable: str | None = None  # None: the only one on latitude and longitude
    positive: Literal["up", "down"] | None = None  # None: as the file says


@dataclass(frozen=True, repr=False)
class Case:
    """A validated case.

    Times are datetime64[s] UTC; start is where the run begins, end where it stops.
    """

    title: str
    path: Path
    text: str  # the file as read, with the overrides as comments
    start: np.datetime64
    end: np.datetime64
    direction: int  # +1, or -1 for a backward run, whose end is before its start
    particles: int
    seed: int
    max_lost: float
    outputs: NDArray[np.datetime64]  # in order of the run, start and end included
    trajectories: int
    areas: tuple[float, ...]  # shares of the probability whose areas are made, ascending
    grid: Cells | None  # of all outputs; None: cells follow the particles
    step: int | None  # [s], positive also in a backward run; None: choose it
    scheme: Literal["rk2", "rk4"]
    tolerance: float  # [m] a day
    domain: Box | None
    coast: Coast
    forcing: Forcing
    current_error: ForcingError
    wind_error: ForcingError
    diffusivity: float  # [m2/s]
    diffusivity_by: str  # whether the case says so, or a default: drift.case.forcing.uncertainty
    scenarios: tuple[Scenario, ...]  # of a spill: one a class of objects, all with its prior
    spill: Spill | None
    sorties: tuple[Sortie, ...]  # by start
    contacts: tuple[Contact, ...]  # by time
    units: tuple[Unit, ...]
    plan: PlanSpec
    resampling: Resampling
    expect: Expect
    sensors: Sensors = field(default_factory=Sensors)  # looks, fields, barriers, lines
    # all of [[sensor]] by name, in use or not
    named_sensors: Mapping[str, Sensor] = field(default_factory=dict)
    about: Mapping[str, str] = field(default_factory=dict)  # attributes that every file is to carry
    tows: tuple[Tow, ...] = ()  # ships that tow arrays, which a plan may place
    processing: Processing | None = None  # beams of arrays that a plan allocates to processors
    depth: Depth | None = None  # where boats have too little water
    # absolute paths of all files, and folders of files, that it names besides addresses
    inputs: tuple[str, ...] = ()
    counts: tuple[int, ...] | None = None  # particles of each scenario; None: by their weights
    # the output that map.png and the report show first; None: the last
    opens: np.datetime64 | None = None
    # as read, overrides included
    tables: Mapping[str, Any] = field(default_factory=dict, repr=False, compare=False)

    def __repr__(self) -> str:
        """Return what it is, in three lines; help(drift.Case) lists all of it."""
        stories = ", ".join(one.name for one in self.scenarios[:4]) + ", .." * (
            len(self.scenarios) > 4
        )
        seen = ", ".join(
            f"{len(many)} {name}{'s' * (len(many) > 1)}"
            for name, many in (
                ("sortie", self.sorties),
                ("contact", self.contacts),
                ("unit", self.units),
            )
            if many
        )
        return "\n".join(
            (
                f'<drift.Case "{self.title}" of {self.path.name}',
                f"  {notation.iso(self.start)} to {notation.iso(self.end)}, {len(self.outputs)} outputs, "
                f"{self.particles:,} particles, seed {self.seed}",
                f"  {len(self.scenarios)} scenario{'s' * (len(self.scenarios) > 1)}: {stories}{seen and f'; {seen}'}>",
            )
        )

    @property
    def sources(self) -> tuple[ForcingSpec, ...]:
        """All sources of forcing, and in place of an ensemble's the sources of its members."""
        return tuple(
            part
            for spec in itertools.chain.from_iterable(self.forcing.values())
            for part in spec.parts
        )

    @property
    def period(self) -> Period:
        """When the run begins and ends."""
        return Period(self.start, self.end, self.direction)

    @property
    def errors(self) -> Errors:
        """How wrong the forcing may be."""
        return Errors(self.current_error, self.wind_error, self.diffusivity)
