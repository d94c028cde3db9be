"""A bound on every choice of beams: the maximum of a concave function that no choice exceeds.

Let x be 1 for beams that are processed, else 0, p a particle's chances and h = -log(1 - p). The
weight that is heard is

    sum w (1 - exp(-sum x h)) = sum w (1 - prod (1 - x p)) <= sum w sum x p

for every choice (no more where beams share a level, of which the best alone counts), and both sides
are concave in x. So for any shares l in [0, 1], one a particle, and any x' in between

    sum w [l x p + (1 - l) (1 - exp(-x' h) (1 - (x - x') h))] - cost x

is linear in x, nowhere below what a choice is worth, and its maximum over the matroid of beams that
processors can work on at the same time is found exactly (`manning.best`). That is the bound,
whatever x' and l are; the method of Frank and Wolfe (1956, doi:10.1002/nav.3800030109; Jaggi 2013)
moves x' to where it is lowest, on the smooth minimum of both sides. The lesser of both is much the
tighter relaxation where chances are high: with chances of 1 the exponential alone says nothing.
"""

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from drift.planning.arrays import choosing, manning
from drift.planning.arrays.records import Hearing
from geo.array import Real

SURE = 40.0  # hazard of a chance of 1: e^-40 is 4e-18
UP = 1 + 2.0**-22  # by which hazards are raised before they are kept in single precision
ROUNDING = 1e-11  # share of the weight that sums may be off
SMOOTH = (0.03, 0.003)  # softness of the minimum, at first and at last
SEARCH = 30  # halvings of a step


@dataclass(frozen=True, eq=False)
class Relaxed:
    """The bound, and where it was found."""

    bound: float
    share: Real  # (slots, beams) 0 to 1
    gap: float  # by how much the bound may be above the maximum of the relaxation


def bound(
    hearing: Hearing, share: Real, *, steps: int, gap: float, soft: tuple[float, float] = SMOOTH
) -> Relaxed:
    """Return a bound on every choice.

    share: (slots, beams) to begin with, of beams that processors can work on together. steps: at
    the most. gap: share of the bound at which it ends. soft: softness of the minimum, at first and
    at last.
    """
    weight, total = hearing.weight, float(hearing.weight.sum())
    hazard = [_hazards(table) for table in hearing.chance]
    crews = [hearing.crew(slot) for slot in range(hearing.slots)]
    linear, summed = _forward(hearing, hazard, share)
    least, at, off = np.inf, share.copy(), np.inf
    for step in range(steps):
        width = soft[0] * (soft[1] / soft[0]) ** (step / max(steps - 1, 1))
        missed = np.exp(-summed)
        mixed = _first(linear, 1 - missed, width)
        slope = np.stack(
            [
                table @ (weight * mixed) + h @ (weight * (1 - mixed) * missed)
                for table, h in zip(hearing.chance, hazard, strict=True)
            ]
        )
        slope -= hearing.cost
        vertex = np.zeros_like(share)
        for slot, crew in enumerate(crews):
            vertex[slot, list(manning.best(slope[slot], hearing.array, crew))] = 1
        # The linear function at the vertex, which is its maximum: what is constant, and the slopes.
        constant = float(np.dot(weight, (1 - mixed) * (1 - missed - missed * summed)))
        above = constant + float((slope * vertex).sum())
        here = float(np.dot(weight, np.minimum(linear, 1 - missed))) - float(
            (hearing.cost * share).sum()
        )
        if above < least:
            least, at, off = above, share.copy(), max(above - here, 0.0)
        if above - here <= gap * max(abs(above), 1e-12 * total):
            break
        ahead, ahead_summed = _forward(hearing, hazard, vertex)
        go = _length(hearing, (linear, summed, share), (ahead, ahead_summed, vertex), width)
        if go == 0:
            continue  # until the minimum is sharper
        share = share + go * (vertex - share)
        linear, summed = linear + go * (ahead - linear), summed + go * (ahead_summed - summed)
    return Relaxed(least + (ROUNDING + np.exp(-SURE)) * total, at, off)


def _hazards(table: sparse.csr_array) -> sparse.csr_array:
    """Return hazards -log(1 - p), no lower than they are, in single precision."""
    with np.errstate(divide="ignore"):
        hazards = -np.log1p(-table.data.astype(float))
    data = (np.minimum(hazards, SURE) * UP).astype(np.float32)
    return sparse.csr_array((data, table.indices, table.indptr), table.shape)


def _forward(hearing: Hearing, hazard: list[sparse.csr_array], share: Real) -> tuple[Real, Real]:
    """Return sum x p and sum x h of each particle, (particles,)."""
    linear, summed = np.zeros(len(hearing.weight)), np.zeros(len(hearing.weight))
    for slot, row in enumerate(share):
        used = np.flatnonzero(row)
        if len(used) * 4 > hearing.beams:
            linear += hearing.chance[slot].T @ row
            summed += hazard[slot].T @ row
            continue
        for beam in used.tolist():
            at, chance = choosing.row(hearing, slot, beam)
            part = slice(hazard[slot].indptr[beam], hazard[slot].indptr[beam + 1])
            linear[at] += row[beam] * chance
            summed[at] += row[beam] * hazard[slot].data[part]
    return linear, summed


def _first(linear: Real, curved: Real, soft: float) -> Real:
    """Return the share of the first of two in their smooth minimum."""
    return np.asarray(1 / (1 + np.exp(np.clip((linear - curved) / soft, -60, 60))))


def _length(
    hearing: Hearing, here: tuple[Real, Real, Real], there: tuple[Real, Real, Real], soft: float
) -> float:
    """Return how far to go, 0 to 1: to where the smooth minimum no longer rises."""
    ahead, ahead_summed = there[0] - here[0], there[1] - here[1]
    price = float((hearing.cost * (there[2] - here[2])).sum())

    def rises(go: float) -> bool:
        missed = np.exp(-(here[1] + go * ahead_summed))
        mixed = _first(here[0] + go * ahead, 1 - missed, soft)
        return (
            float(np.dot(hearing.weight, mixed * ahead + (1 - mixed) * missed * ahead_summed))
            > price
        )

    if not rises(0.0):
        return 0.0
    low, high = 0.0, 1.0
    if rises(1.0):
        return 1.0
    for _ in range(SEARCH):
        if high - low < 0.02 * high:
            break
        middle = (low + high) / 2
        low, high = (middle, high) if rises(middle) else (low, middle)
    return (low + high) / 2
