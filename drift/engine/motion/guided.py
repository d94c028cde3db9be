"""Guided particles: their noise is shifted in every step toward debris finds.

drift.evidence.filter.debris.guide computes how far each particle is pulled toward each find. This
module distributes the pull over the errors of current and wind in each step.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from drift.engine.particles.ensemble import Column, Device, Ensemble
from geo.array import Array
from kernels.runtime import rows
from kernels.step import guide as kernel
from kernels.step.advance import Step


def pull_names(finds: int) -> list[tuple[str, str]]:
    """Return the column names of the pulls (east, north), one pair for each find."""
    return [(f"pull_{k}_east", f"pull_{k}_north") for k in range(finds)]


def columns(finds: int) -> tuple[Column, ...]:
    """Return the columns of particles guided by a number of finds; none for 0."""
    if not finds:
        return ()
    pulls = [name for pair in pull_names(finds) for name in pair]
    return (
        *(
            Column(name, np.float32, 0, "", "added to this step's normal", "nudges")
            for name in kernel.NUDGES
        ),
        *(Column(name, np.float32, 0, "1/m", "how far a find guides it") for name in pulls),
    )


@dataclass(frozen=True, eq=False)
class Guided:
    """How far a unit normal in each step displaces a drifting particle by the time of each find."""

    numbers: tuple[int, ...]  # of the step of each row
    until: int  # [s after start] end of the step that holds the last find
    responses: Array  # [m] float32 (finds, steps + 1, 2) of current and wind; the last row is 0

    @property
    def finds(self) -> int:
        """Number of finds."""
        return len(self.responses)

    @cached_property
    def rows(self) -> dict[int, int]:
        """Row of each step number; steps without a row come after the last find."""
        return {number: row for row, number in enumerate(self.numbers)}

    def write_nudges(self, own: Mapping[str, Device], step: Step) -> None:
        """Write the shifts of a step's normal variates from the pulls of particles.

        Args:
            own: columns of an ensemble by name, shape (n,) each.
            step: the step about to be computed.
        """
        row = self.rows.get(step.number, len(self.numbers))
        nudges = rows.whole(own, kernel.NUDGES)
        for number, (east, north) in enumerate(pull_names(self.finds)):
            current, wind = self.responses[number, row]
            pulls = own[east], own[north]
            kernel.nudge(float(current), float(wind), int(number == 0), *pulls, nudges)


def write_nudges(how: Guided | None, ensemble: Ensemble, step: Step) -> None:
    """Write the shifts of a step's normal variates if particles are guided."""
    if how is not None:
        how.write_nudges(ensemble.own, step)
