"""Specifications of the winds and currents of a run.

They come from files, a dataset in memory, a constant, a table, or an analytic flow. Constants and
tables are on-scene reports. Nothing is opened here; geo.forcing.sources does that.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Report:
    """A vector by time, as reported on scene: UTC times, strictly increasing, true east and north
    [m/s].
    """

    times: tuple[np.datetime64, ...]
    east: tuple[float, ...]
    north: tuple[float, ...]


@dataclass(frozen=True)
class Slices:
    """The user's interpretation of a source's times.

    Either the first time and the interval, in place of a file's own; or the time zone, ahead of
    UTC, and the position of the time stamp in the interval of a mean.
    """

    start: np.datetime64 | None = None  # [s] UTC
    every: np.timedelta64 | None = None  # [s]
    zone: str | None = None
    stamp: str | None = None


@dataclass(frozen=True)
class ForcingSpec:
    """One source of a quantity; exactly one of files, dataset, constant, table, analytic and each
    is given.
    """

    name: str
    quantity: str
    files: tuple[str, ...] = ()  # absolute paths of existing files, or URLs
    dataset: str | None = None  # name of an xarray.Dataset in memory
    constant: tuple[float, float] | None = None  # true east, north [m/s]
    table: Report | None = None
    analytic: str | None = None
    # parameters of the built-in flow, SI
    parameters: Mapping[str, float] = field(default_factory=dict)
    variables: Mapping[str, str] | None = None
    units: str | None = None
    depth: float | None = None  # [m]
    steady: bool = False
    times: Slices | None = None  # used in place of the files' own
    fill: int = 3  # cells filled from wet neighbours toward the coast
    plausible: bool = False  # the user confirms the speeds in the files
    timeout: float = 60.0  # [s] to wait for an answer from the server of an address
    add: bool = False  # added to the value of the sources without `add`
    # Whether its files, or its dataset, are members of an ensemble; or the name of the dimension
    # along which members lie.
    members: bool | str = False
    # the files of each entry of a list, or each file of a single pattern
    entries: tuple[tuple[str, ...], ...] = ()
    # the members of an ensemble that are separate sources
    each: tuple["ForcingSpec", ...] = ()

    @property
    def parts(self) -> tuple["ForcingSpec", ...]:
        """Return its members if each is a separate source, otherwise itself."""
        return self.each or (self,)


Forcing = Mapping[str, tuple[ForcingSpec, ...]]  # sources by quantity, each in order of priority


def options(spec: ForcingSpec) -> dict[str, Any]:
    """Return the arguments for `geo.forcing.sources.open_source` on how to read a source's
    files.
    """
    return {
        "variables": spec.variables,
        "units": spec.units,
        "times": _times(spec.times) if spec.times else None,
        "steady": spec.steady,
        "depth": spec.depth,
        "plausible": spec.plausible,
        "timeout": spec.timeout,
        "members": spec.members,
        "entries": spec.entries,
    }


def _times(said: Slices) -> dict[str, Any]:
    given = {"start": said.start, "interval": said.every, "zone": said.zone, "stamp": said.stamp}
    return {key: value for key, value in given.items() if value is not None}
