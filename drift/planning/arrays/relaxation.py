"""Upper bound of the value of any choice of beams, from a concave relaxation.

Let x be 1 for processed beams, else 0, p the probabilities that beams hear a particle, and
h = -log(1 - p). The heard weight satisfies

    sum w (1 - exp(-sum x h)) = sum w (1 - prod (1 - x p)) <= sum w sum x p

for every choice (it is even lower if beams share a level, of which only the best counts). Both
sides are concave in x. So for any mixing share l in [0, 1] of each particle, and any x' in between,

    sum w [l x p + (1 - l) (1 - exp(-x' h) (1 - (x - x') h))] - cost x

is linear in x and at least the value of every choice. Its maximum over the matroid of feasible sets
is found exactly (`manning.best`). That maximum is an upper bound for any x' and l. The method of
Frank and Wolfe (1956, doi:10.1002/nav.3800030109; Jaggi 2013) moves x' to the lowest bound, on the
smooth minimum of both sides. If probabilities are high, that minimum is much tighter than the
exponential alone; with probabilities of 1 the exponential alone gives no bound.
"""

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from drift.planning.arrays import choosing, manning
from drift.planning.arrays.records import Hearing
from geo.array import Real

SURE = 40.0  # hazard of a chance of 1: e^-40 is 4e-18
UP = 1 + 2.0**-22  # factor on hazards, so that single precision never rounds them down
ROUNDING = 1e-11  # rounding error of sums, as a share of the weight
SMOOTH = (0.03, 0.003)  # softness of the minimum, at first and at last
SEARCH = 30  # most bisections of a step length


@dataclass(frozen=True, eq=False)
class Relaxed:
    """The bound, and the shares at which it was found."""

    bound: float
    share: Real  # (slots, beams) 0 to 1
    gap: float  # how far the bound may lie above the maximum of the relaxation


def bound(
    hearing: Hearing, share: Real, *, steps: int, gap: float, soft: tuple[float, float] = SMOOTH
) -> Relaxed:
    """Return an upper bound of the value of any choice of beams.

    Args:
        hearing: the allocation problem.
        share: shares of beams to start with, shape (slots, beams); a feasible point.
        steps: most steps.
        gap: relative duality gap at which the search ends.
        soft: softness of the minimum, at first and at last.
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
        # The linear function at the vertex, its maximum: the constant part, then the slopes.
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
            continue  # the next step has a sharper minimum
        share = share + go * (vertex - share)
        linear, summed = linear + go * (ahead - linear), summed + go * (ahead_summed - summed)
    return Relaxed(least + (ROUNDING + np.exp(-SURE)) * total, at, off)


def _hazards(table: sparse.csr_array) -> sparse.csr_array:
    """Return hazards -log(1 - p) in single precision, rounded up."""
    with np.errstate(divide="ignore"):
        hazards = -np.log1p(-table.data.astype(float))
    data = (np.minimum(hazards, SURE) * UP).astype(np.float32)
    return sparse.csr_array((data, table.indices, table.indptr), table.shape)


def _forward(hearing: Hearing, hazard: list[sparse.csr_array], share: Real) -> tuple[Real, Real]:
    """Return sum x p and sum x h of each particle, shape (particles,)."""
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
    """Return the share of the first of two values in their smooth minimum."""
    return np.asarray(1 / (1 + np.exp(np.clip((linear - curved) / soft, -60, 60))))


def _length(
    hearing: Hearing, here: tuple[Real, Real, Real], there: tuple[Real, Real, Real], soft: float
) -> float:
    """Return the step length, 0 to 1: where the smooth minimum stops rising."""
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
