"""The case as a frozen, validated record in SI units and UTC, used by the rest of the program."""

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
from drift.engine.motion.errors.buoys import BuoyTrack, PointReport
from drift.engine.motion.errors.forcing_error import Errors, ForcingError
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
    """The bathymetry file that shows where the water is too shallow for boats."""

    file: str  # absolute path
    variable: str | None = None  # None: the only variable on latitude and longitude
    positive: Literal["up", "down"] | None = None  # None: from the file's metadata


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
    areas: tuple[float, ...]  # probabilities of the containment areas, ascending
    grid: Cells | None  # of all outputs; None: the grid follows the particles
    step: int | None  # [s], positive also in a backward run; None: choose it
    scheme: Literal["rk2", "rk4"]
    tolerance: float  # [m] a day
    domain: Box | None
    coast: Coast
    forcing: Forcing
    current_error: ForcingError
    wind_error: ForcingError
    diffusivity: float  # [m2/s]
    diffusivity_by: str  # source of the value, the case or a default (case.forcing.uncertainty)
    scenarios: tuple[Scenario, ...]  # of a spill: one per class of objects, all with its prior
    spill: Spill | None
    sorties: tuple[Sortie, ...]  # by start
    contacts: tuple[Contact, ...]  # by time
    units: tuple[Unit, ...]
    plan: PlanSpec
    resampling: Resampling
    expect: Expect
    sensors: Sensors = field(default_factory=Sensors)  # looks, fields, barriers, lines
    # all [[sensor]] tables by name, used or not
    named_sensors: Mapping[str, Sensor] = field(default_factory=dict)
    about: Mapping[str, str] = field(default_factory=dict)  # attributes for every output file
    drifters: tuple[BuoyTrack, ...] = ()  # drifting buoys on scene
    reports: tuple[PointReport, ...] = ()  # winds and currents reported on scene
    tows: tuple[Tow, ...] = ()  # ships that tow arrays, which a plan may place
    processing: Processing | None = None  # beams of arrays that a plan allocates to processors
    depth: Depth | None = None  # bathymetry, for boats
    # absolute paths of all input files and folders; no addresses
    inputs: tuple[str, ...] = ()
    counts: tuple[int, ...] | None = None  # particles of each scenario; None: by their weights
    # time of map.png and of the report's first map; None: the last output
    opens: np.datetime64 | None = None
    # the case file's tables as read, with overrides
    tables: Mapping[str, Any] = field(default_factory=dict, repr=False, compare=False)

    def __repr__(self) -> str:
        """Return the title, period, size and scenarios; help(drift.Case) lists all attributes."""
        names = ", ".join(one.name for one in self.scenarios[:4]) + ", .." * (
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
                f"  {len(self.scenarios)} scenario{'s' * (len(self.scenarios) > 1)}: {names}{seen and f'; {seen}'}>",
            )
        )

    @property
    def sources(self) -> tuple[ForcingSpec, ...]:
        """All forcing sources; an ensemble is replaced by the sources of its members."""
        return tuple(
            part
            for spec in itertools.chain.from_iterable(self.forcing.values())
            for part in spec.parts
        )

    @property
    def period(self) -> Period:
        """The start, end and direction of the run."""
        return Period(self.start, self.end, self.direction)

    @property
    def errors(self) -> Errors:
        """The errors of the forcing."""
        return Errors(self.current_error, self.wind_error, self.diffusivity)
