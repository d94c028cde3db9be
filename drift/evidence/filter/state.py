"""What the filter keeps of every particle besides the ensemble; resampling copies it too."""

from dataclasses import dataclass, replace
from typing import Any

from geo.array import Array
from kernels.runtime import runtime


@dataclass(eq=False)
class History:
    """Effects of the evidence so far on each particle, on the host; None: no effect yet.

    Columns are replaced, not written into: an output may still refer to the old values.
    """

    # float64 (n,): log weight by all positive evidence, as if no sortie had been flown
    unsearched: Array
    # float32 (n,): product over sorties of the share of time that none searched the particle
    never: Array | None = None
    lineage: Array | None = None  # int32 (n,): initial particle from which it descends
    ancestors: Array | None = None  # int32 (n,): its ancestor at the last output
    # float64 (2 * groups * n,): estimated source frequency of each group of tones
    tones: Array | None = None

    @property
    def columns(self) -> dict[str, Array]:
        """Its columns by name, without those that are None."""
        return {name: column for name, column in vars(self).items() if column is not None}

    def inherit(self, ancestors: Array) -> None:
        """Copy each ancestor's values into its offspring; ancestors: slots, (n,)."""
        for name, column in self.columns.items():
            setattr(self, name, column.reshape(-1, len(ancestors))[:, ancestors].ravel())


@dataclass(eq=False)
class ReportGroup:
    """Reports that share an unknown: a factor of sweep width, or an error of their sensors."""

    chances: Array  # probability of each value of the unknown
    last: int  # [s after start] time of its last report
    # (values,): its reports are sorties, whose hazards are all proportional to this; None: they are not
    growth: Array | None = None
    # On the device; None: no report yet. With `growth` (n,) the sum of hazards so far; otherwise
    # (values * n,) the log probability of all reports so far.
    missed: Any = None

    @property
    def columns(self) -> dict[str, Any]:
        """Its column by name, if it exists."""
        return {} if self.missed is None else {"missed": self.missed}

    def ready(self, n: int) -> Any:
        """Return its column for n particles; create it on the first call."""
        if self.missed is None:
            self.missed = runtime.empty(n * (len(self.chances) if self.growth is None else 1))
        return self.missed

    def copy(self) -> "ReportGroup":
        """Return a copy with a new device buffer."""
        missed = None if self.missed is None else runtime.copy(self.missed)
        return replace(self, missed=missed)
