"""Effective numbers of particles or worlds, and warnings where they are low.

Every file and picture takes these numbers from here. The effective sample size is one over the sum
of squared shares (Kong 1992; Kish 1965, sec. 11.2). Resampled copies count as the particle from
which they descend, because copies add no information. Objects of one world of a spill share all its
unknowns, so a spill counts worlds.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from drift.engine.particles import partials, weights
from drift.engine.particles.partials import Blocks, Partial
from drift.forecast import likeliest
from geo import notation
from geo.array import Array

FEW = {"particles": 200.0, "worlds": 50.0}  # effective numbers below which figures are rough
SLACK = 1e-6  # relative rounding error of a number
PART = 0.05  # share of the probability on the map above which a part has its own warning
# Warnings start once this share of all eventual releases has happened; until then maps report the
# share that is missing.
RELEASED = 0.99
PARTS = {"adrift": "of those adrift", "ashore": "of those ashore"}


@dataclass(frozen=True)
class Count:
    """An effective number, and the number drawn; None: unknown."""

    number: float
    of: int | None = None
    what: str = "particles"  # the unit counted: "particles" or "worlds"

    @property
    def few(self) -> bool:
        """Whether the number is too low for reliable figures; False for 0, which has no figures."""
        return 0 < self.number < FEW[self.what] * (1 - SLACK)

    @property
    def words(self) -> str:
        """The count in words, as "4 of 100,000 particles are effective"."""
        number = max(round(self.number), 1)
        number = min(number, math.ceil(FEW[self.what]) - 1) if self.few else number
        many = f"{number:,} of {self.of:,} {self.what}" if self.of else f"{number:,} {self.what}"
        many = many if self.of or number > 1 else f"1 {self.what[:-1]}"
        return f"{many} {'is' if number == 1 else 'are'} effective"


class Effective:
    """Effective sample sizes by code, 0 to many - 1, accumulated part by part over the
    particles.
    """

    def __init__(self, many: int = 1) -> None:
        """Start with no particles."""
        self._many = many
        self._sums: list[Partial] = []
        self._runs: list[tuple[Array, Array]] = []

    def add(
        self, weight: Array, blocks: Blocks, code: Array | None = None, family: Array | None = None
    ) -> None:
        """Add the probabilities (n,) of a part; family: particles of one family and code count as
        one.
        """
        if family is None:
            self._sums.append(blocks.partial(weight, weight**2, code=code, many=self._many))
        else:
            own = np.zeros(len(weight), np.int64) if code is None else code
            self._runs.append(weights.runs_of_families(own, self._many, weight, family, blocks))

    def join(self, others: Iterable["Effective"]) -> "Effective":
        """Return the sizes of these particles and those of others, in their order."""
        joined = Effective(self._many)
        for one in (self, *others):
            joined._sums += one._sums
            joined._runs += one._runs
        return joined

    @property
    def numbers(self) -> Array:
        """The effective sample size of each code, (many,); 0 where there are no particles."""
        if self._runs:
            of, mass = weights.families(self._many, self._runs)
            top = np.zeros(self._many)
            np.maximum.at(top, of, mass)
            # squares of the smallest weights would underflow
            mass = mass / np.where(top > 0, top, 1.0)[of]
            total, squares = np.bincount(of, mass, self._many), np.bincount(of, mass**2, self._many)
        else:
            total, squares = partials.merge_partials(self._sums).total.T
        return of_sums(total, squares)


def of_sums(total: Array, squares: Array) -> Array:
    """Return effective sample sizes from sums of weights and of squared weights; 0 where both are
    0.
    """
    return np.asarray(
        np.divide(total**2, squares, out=np.zeros(np.shape(total)), where=squares > 0)
    )


def number(weight: Array, family: Array | None = None) -> float:
    """Return the effective sample size of weights (n,) of any scale; 0 if there are none.

    family: int (n,), not negative; a family counts as one particle with its summed weight.
    """
    if not len(weight) or weight.max() <= 0:
        return 0.0
    counted = Effective()
    # Squares of the smallest weights would underflow.
    counted.add(weight / weight.max(), partials.whole(len(weight)), family=family)
    return float(counted.numbers[0])


def effective_by_code(code: Array, many: int, weight: Array, family: Array | None = None) -> Array:
    """Return the effective sample size of each code 0 to many - 1, (many,); family: as in
    `number`.
    """
    counted = Effective(many)
    counted.add(weight, partials.whole(len(weight)), code, family)
    return counted.numbers


def sentence(count: Count, when: str = "", rough: str = "areas and shares are rough") -> str:
    """Return a sentence that warns of a low count; when: "after ..." or "at ..."."""
    return f"only {count.words}{when and f' {when}'}: {rough}"


def banner(count: Count, rough: str = "the areas are rough", when: str = "") -> str:
    """Return a picture's warning of a low count; when: the time of its map with the lowest
    count.
    """
    return f"ONLY {count.words.upper()}{when and f' at {when}'}: {rough}"


def effective_at(data: Any, time: int, particles: int | None = None) -> Count:
    """Return the effective count of a forecast's map at an output.

    It counts worlds if they are few, otherwise particles.

    Args:
        data: of drift.forecast.products.dataset.
        time: index of the output.
        particles: number drawn.
    """
    if "effective_worlds" in data:
        worlds = data["effective_worlds"]
        count = Count(float(worlds.values[time]), int(worlds.attrs["worlds"]), "worlds")
        if count.few:
            return count
    return Count(float(data["effective_particles"].values[time]), particles)


def fewest(data: Any, outputs: Iterable[int], particles: int | None = None) -> tuple[Count, int]:
    """Return the lowest effective count among the maps of some outputs, and its output.

    Outputs with an empty map are skipped.
    """
    counts = [(effective_at(data, int(i), particles), int(i)) for i in outputs]
    shown = [pair for pair in counts if pair[0].number > 0]
    return min(
        shown,
        key=lambda pair: pair[0].number / FEW[pair[0].what],
        default=(Count(0.0, particles), 0),
    )


def parts(data: Any, time: int) -> list[str]:
    """Return warnings of the parts of a map with few effective particles: adrift, ashore, a
    scenario.

    The list is empty where the whole map has few.
    """
    if effective_at(data, time).few:
        return []
    output = data.isel(time=time)
    mapped = float(output["probability"].sum())
    sentences = []
    statuses = zip(
        output["status"].values,
        output["status_probability"].values,
        output["status_effective"].values,
        strict=True,
    )
    named = [
        (PARTS[str(name)], float(p), float(n)) for name, p, n in statuses if str(name) in PARTS
    ]
    rough = [
        (name, share, n) for name, share, n in named if share >= PART * mapped and Count(n).few
    ]
    # the classes of a spill are not scenarios
    if output.sizes["scenario"] > 1 and "effective_worlds" not in data:
        shares = output["probability_by_scenario"].sum(["lat", "lon"]).values
        alone = list(likeliest.likeliest_scenarios(data["scenario_probability"].values).alone)
        names, counts = output["scenario"].values[alone], output["scenario_effective"].values[alone]
        of = [
            (str(a), float(b), float(c))
            for a, b, c in zip(names, shares[: len(alone)], counts, strict=True)
        ]
        stories = [story for story in of if story[1] >= PART * mapped and Count(story[2]).few]
        if len(stories) == 1:
            rough += [(f'of scenario "{stories[0][0]}"', *stories[0][1:])]
        elif stories:  # one line for them all
            name, _, n = min(stories, key=lambda story: story[2])
            rough += [
                (
                    f'of scenario "{name}"{_others(len(stories) - 1)}',
                    sum(share for _, share, _ in stories),
                    n,
                )
            ]
    for name, share, n in rough:
        sentences.append(
            f"{sentence(Count(n), name, 'figures of this part are rough')} ({100 * share:.0f} % of the probability)"
        )
    return sentences


def _others(many: int) -> str:
    return f", and few of {many} other{'s' if many > 1 else ''}"


def effective_warnings(
    data: Any, particles: int, since: np.datetime64 | None = None, left: float = 0.0
) -> list[str]:
    """Return a forecast's warnings of outputs, and of parts at its end, with few effective
    particles.

    since, left: where `left` effective particles from a time on have been reported already, later
    outputs are mentioned only if they have fewer than half as many.
    """
    sentences = []
    times = data["time"].values
    few = [i for i in range(released(data), len(times)) if effective_at(data, i, particles).few]
    if few:
        counts = [effective_at(data, i, particles) for i in few]
        worst = min(range(len(few)), key=lambda k: counts[k].number)
        already = since is not None and all(_at_or_after(times, i, since) for i in few)
        if not already or counts[worst].number < 0.5 * left:
            others = (
                f" and few at {len(few) - 1} more output time{'s' * (len(few) > 2)}"
                if len(few) > 1
                else ""
            )
            sentences.append(
                sentence(counts[worst], f"at {notation.format_dtg(times[few[worst]])}{others}")
            )
    return sentences + parts(data, len(times) - 1)


def released(data: Any) -> int:
    """Return the first output by which all but 1 - RELEASED of the eventual releases have happened.

    Return 0 if nothing is ever released.
    """
    status = [str(name) for name in data["status"].values]
    share = 1 - data["status_probability"].values[:, status.index("pending")]
    return int(np.argmax(share >= RELEASED * share.max()))


def _at_or_after(times: Array, i: int, moment: np.datetime64) -> bool:
    """Whether an output is at a time or after it, in the direction of the run."""
    return bool(times[i] >= moment if times[-1] >= times[0] else times[i] <= moment)
