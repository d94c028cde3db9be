"""The result of a comparison of two cases."""

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
    times: tuple[np.datetime64, ...]  # output times that both have
    rows: tuple[Difference, ...]  # by time, those of the whole run last
    data: xr.Dataset  # contents of compare.nc: see drift.assess.compare.dataset
    step: int  # [s]
    plans: tuple[Plan, Plan] | None = None  # plan of the next search of each, if requested
    notes: tuple[str, ...] = ()  # why some random numbers are not common

    def __repr__(self) -> str:
        """Return a short description."""
        return (
            f'<Contrast "{self.title}"\n  {len(self.times)} outputs, {len(self.rows)} figures in '
            "differences, maps in data, results in a and b>"
        )

    @property
    def differences(self) -> pandas.DataFrame:
        """All figures of A and B with their differences and standard errors (sampling only), in SI.

        Rows are by time (UTC), those of the whole run last; a and b are NaN where only the
        difference is meaningful. The column `unit` holds the unit.
        """
        columns = [field.name for field in fields(Difference)]
        frame = pandas.DataFrame(
            [[getattr(row, name) for name in columns] for row in self.rows], columns=columns
        )
        return frame.astype({"time": "datetime64[ns]"}).rename(columns={"error": "standard_error"})

    @property
    def names(self) -> tuple[str, str]:
        """Names of A and B: their titles; if these are equal, the changes of B, or the files."""
        a, b = self.a.case, self.b.case
        if a.title != b.title:
            return a.title, b.title
        own = Counter(_changes(b.text)) - Counter(_changes(a.text))
        if a.path == b.path or a.text == b.text:
            return "as it is", ", ".join(own) or "the same"
        parts = 1 if a.path.name != b.path.name else 2  # with the folder
        files = ["/".join(case.path.parts[-parts:]) for case in (a, b)]
        return files[0], ", ".join([files[1], *own])

    @property
    def given(self) -> tuple[str, str]:
        """The evidence by which each case weights its particles or worlds, like "2 finds".

        It is "nothing" without evidence.
        """
        return _evidence_in_words(self.a.case), _evidence_in_words(self.b.case)

    @property
    def title(self) -> str:
        """Title of the comparison."""
        a, b = self.names
        title = self.a.case.title
        return f"{b} against {a}" if a == title else f"{title}: {b}"

    def at(self, time: np.datetime64, quantity: str) -> list[Difference]:
        """Return the differences of a quantity at one output time."""
        return [row for row in self.rows if row.time == time and row.quantity == quantity]

    @property
    def of_run(self) -> list[Difference]:
        """Differences of the run as a whole: of sorties, plans and stretches."""
        return [row for row in self.rows if row.quantity in OF_RUN]


def _evidence_in_words(case: Case) -> str:
    """Return the number of finds, patrols, sorties, contacts and sensors of a case in words."""
    if case.spill:
        counts = {"find": len(case.spill.finds), "patrol": len(case.spill.patrols)}
    else:
        counts = {
            "sortie": len(case.sorties),
            "contact": len(case.contacts),
            "sensor": len(case.sensors.telling),
        }
    return (
        " and ".join(
            f"{count} {name}{'s' * (count > 1)}" for name, count in counts.items() if count
        )
        or "nothing"
    )


def _changes(text: str) -> list[str]:
    """Return the overrides of a case (`--set`), as drift.case.file appends them to its text."""
    mark = "# --set "  # drift.case.file
    return [line.removeprefix(mark) for line in text.splitlines() if line.startswith(mark)]
