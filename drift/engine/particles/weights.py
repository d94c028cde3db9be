"""Weights, log weights, evidence and effective sample sizes on the host, in float64."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drift.engine.particles import partials
from drift.engine.particles.columns import Columns
from drift.engine.particles.partials import Blocks, Partial
from geo.array import Array


def relative(log_weight: Array, top: float | None = None) -> Array:
    """Return weights, float64, scaled so that the largest is 1, or in units of exp(top)."""
    unit = float(log_weight.max()) if top is None else top
    return np.asarray(np.exp(log_weight.astype(np.float64) - unit))


def shares(log_weight: Array) -> Array:
    """Return log weights (n,) as probabilities, float64, that add up to 1."""
    weight = relative(log_weight)
    return np.asarray(weight / weight.sum())


def effective(weight: Array) -> float:
    """Return the effective sample size of weights (n,) of any scale, not all 0 (Kish 1965, sec.
    11.2).
    """
    return float(weight.sum() ** 2 / (weight**2).sum())


def _of_families(
    code: Array, many: int, weight: Array, family: Array, blocks: Blocks
) -> tuple[Array, Array]:
    """Return the code and the summed weight of each pair of family and code, (k,) each.

    Args:
        code: codes from 0 to many - 1, (n,).
        many: the number of codes.
        weight: of each particle, (n,).
        family: number of the initial particle from which each descends, int (n,).
        blocks: of these particles.
    """
    return families(many, [runs_of_families(code, many, weight, family, blocks)])


def runs_of_families(
    code: Array, many: int, weight: Array, family: Array, blocks: Blocks
) -> tuple[Array, Array]:
    """Return one part's input to `families`: pairs of family and code, and their summed weights."""
    # siblings occupy adjacent slots, so there are few runs
    return blocks.runs(family.astype(np.int64) * many + code, weight)


def families(many: int, runs: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Return the result of `_of_families` from the runs of all parts."""
    pair, mass = (np.concatenate(column) for column in zip(*runs, strict=True))
    pairs, which = np.unique(pair, return_inverse=True)
    return pairs % many, np.bincount(which, mass, len(pairs))


@dataclass(frozen=True)
class WeightSums:
    """Sums of all weights by block, each in units of the block's largest weight."""

    top: Array  # (k,) largest log weight of each block
    part: Partial  # sums of weights and of their squares, (k, 1, 2)

    def _scaled(self, top: Array) -> Partial:
        """Return the sums in units of exp(top); top has shape (k,) or ()."""
        scale = np.exp(
            np.where(np.isfinite(self.top), self.top, -np.inf)
            - np.where(np.isfinite(top), top, 0.0)
        )
        sums = self.part.sums * np.stack([scale, scale**2], axis=-1)[:, None, :]
        return Partial(self.part.scenarios, self.part.scenario, self.part.number, sums)

    @property
    def largest(self) -> float:
        """The largest log weight; -inf if there are no particles."""
        return float(self.top.max(initial=-np.inf))

    @property
    def log_sums(self) -> Array:
        """Log of the summed weight of each scenario, (scenarios,); -inf where it is 0."""
        top = np.full(self.part.scenarios, -np.inf)
        np.maximum.at(top, self.part.scenario, self.top)
        with np.errstate(divide="ignore"):
            sums = np.log(self._scaled(top[self.part.scenario]).by_scenario[:, 0, 0])
        return np.where(np.isfinite(top), top + sums, top)

    @property
    def log_sum(self) -> float:
        """Log of the sum of all weights; -inf if it is 0."""
        top = self.largest
        return (
            float(top + np.log(self._scaled(np.asarray(top)).total[0, 0]))
            if np.isfinite(top)
            else top
        )

    @property
    def scenarios(self) -> Array:
        """The probability of each scenario, (scenarios,)."""
        return np.asarray(np.exp(self.log_sums - self.log_sum))

    @property
    def ess(self) -> float:
        """The effective sample size (Kong 1992)."""
        total, squares = self._scaled(self.top.max()).total[0]
        return float(total**2 / squares)


def sum_weights(log_weight: Array, blocks: Blocks) -> WeightSums:
    """Return the sums of weights by block from log weights (n,)."""
    logs = log_weight.astype(np.float64)
    top = np.maximum.reduceat(logs, blocks.first) if blocks.first.size else np.empty(0)
    own = np.repeat(np.where(np.isfinite(top), top, 0.0), np.diff(blocks.first, append=blocks.n))
    weight = np.exp(logs - own)
    return WeightSums(top, blocks.partial(weight, weight**2))


def merge_weight_sums(parts: Sequence[WeightSums]) -> WeightSums:
    """Return the sums of weights of all parts (at least one)."""
    order = np.argsort(np.concatenate([one.part.number for one in parts]), kind="stable")
    top = np.concatenate([one.top for one in parts])[order]
    return WeightSums(top, partials.merge_partials([one.part for one in parts]))


class Unit(NamedTuple):
    """The scale in which the weights of all particles add up to 1."""

    top: float  # the largest log weight
    total: float  # sum of all weights, in units of the largest

    def shares(self, log_weight: Array) -> Array:
        """Return the probabilities of particles from their log weights, float64."""
        return np.asarray(relative(log_weight, self.top) / self.total)


def normalising_scale(columns: Columns, name: str) -> Unit:
    """Return the scale that normalises a column of log weights."""
    top = max(float(logs.max()) for _, logs in columns.parts(name))
    sums = [blocks.partial(relative(logs, top)) for blocks, logs in columns.parts(name)]
    return Unit(top, float(partials.merge_partials(sums).total[0, 0]))


def normalised(log_weight: Array, blocks: Blocks) -> Array:
    """Return the weights of all particles as probabilities, float64 (n,), that add up to 1."""
    weight = relative(log_weight)
    return np.asarray(weight / blocks.total(weight))
