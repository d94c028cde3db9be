"""What a comparison of two cases found."""

from collections import Counter
from dataclasses import dataclass, fields

import numpy as np
import pandas
import xarray as xr

from drift.assess.compare.units import Difference
from drift.case.record import Case
from drift.pipeline.result import Result
from drift.planning.search.records import Plan

# quantities of the run as a whole
OF_RUN = ("POS", "cumulative POS", "POS of the next plan", "ashore")


@dataclass(frozen=True, repr=False)
class Contrast:
    """Two results on common random numbers, and their differences."""

    a: Result
    b: Result
    times: tuple[np.datetime64, ...]  # outputs of both
    rows: tuple[Difference, ...]  # by time, those of the whole run last
    data: xr.Dataset  # what compare.nc holds: see drift.assess.compare.dataset
    step: int  # [s]
    plans: tuple[Plan, Plan] | None = None  # the next search of each, where that was asked for
    notes: tuple[str, ...] = ()  # what keeps the random numbers from being common

    def __repr__(self) -> str:
        """Return what it is, in a few lines."""
        return (
            f'<Contrast "{self.title}"\n  {len(self.times)} outputs, {len(self.rows)} figures in differences, maps in data, '
            "results in a and b>"
        )

    @property
    def differences(self) -> pandas.DataFrame:
        """Every figure of A, of B, their difference and its standard error, by chance alone, in the
        row's `unit` (SI).

        Rows are by time (UTC), those of the whole run last; a and b are NaN where only the
        difference has a meaning.
        """
        columns = [field.name for field in fields(Difference)]
        frame = pandas.DataFrame(
            [[getattr(row, name) for name in columns] for row in self.rows], columns=columns
        )
        return frame.astype({"time": "datetime64[ns]"}).rename(columns={"error": "standard_error"})

    @property
    def names(self) -> tuple[str, str]:
        """What A and B are called: their titles; or, of one file, what was changed in B alone."""
        a, b = self.a.case, self.b.case
        if a.title != b.title:
            return a.title, b.title
        own = Counter(_changes(b.text)) - Counter(_changes(a.text))
        return "as it is", ", ".join(own) or "the same"

    @property
    def given(self) -> tuple[str, str]:
        """What each case's figures are given, because it weighs its particles or worlds: "2 finds";
        "nothing".
        """
        return _given(self.a.case), _given(self.b.case)

    @property
    def title(self) -> str:
        """What is compared."""
        a, b = self.names
        title = self.a.case.title
        return f"{b} against {a}" if a == title else f"{title}: {b}"

    def at(self, time: np.datetime64, quantity: str) -> list[Difference]:
        """Return the differences of a quantity at an output."""
        return [row for row in self.rows if row.time == time and row.quantity == quantity]

    @property
    def of_run(self) -> list[Difference]:
        """Those that are of the run as a whole: sorties and stretches."""
        return [row for row in self.rows if row.quantity in OF_RUN]


def _given(case: Case) -> str:
    """Return what weighs the particles or worlds of a case."""
    if case.spill:
        told = {"find": len(case.spill.finds), "patrol": len(case.spill.patrols)}
    else:
        told = {
            "sortie": len(case.sorties),
            "contact": len(case.contacts),
            "sensor": len(case.sensors.telling),
        }
    return (
        " and ".join(f"{count} {name}{'s' * (count > 1)}" for name, count in told.items() if count)
        or "nothing"
    )


def _changes(text: str) -> list[str]:
    """Return what was changed in a case after its file was read."""
    mark = "# --set "  # drift.case.file
    return [line.removeprefix(mark) for line in text.splitlines() if line.startswith(mark)]
