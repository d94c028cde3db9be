"""The proposal for guided particles: a mixture of the prior and of posteriors given finds.

The variable is s, the displacement [m] that the shared unknowns give debris at the times of its
finds, with prior N(0, S). Finds are observed as y = s + error, with an error covariance R that the
proposal may choose.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from geo.array import Array


class Part(NamedTuple):
    """A part of the mixture: the posterior given some of the finds."""

    rows: Array  # components of s for those finds, int (k,)
    error: Array  # [m2] covariance R of their errors, (k, k)


class Proposal:
    """A mixture: a share of the prior N(0, S), and for each part the posterior given its finds."""

    def __init__(self, covariance: Array, parts: Sequence[Part], prior_share: float) -> None:
        """Factorize the covariance.

        Args:
            covariance: S [m2], shape (m, m).
            parts: equally likely besides the prior.
            prior_share: probability of the prior.
        """
        values, vectors = np.linalg.eigh(covariance)
        kept = values > 1e-9 * values[-1]
        self.root = vectors[:, kept] * np.sqrt(values[kept])  # S = root root^T
        self.inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
        self._covariance, self._parts, self._prior = covariance, tuple(parts), prior_share

    def draw(
        self, y: Array, choice: Array, normals: Array, *, prior: bool = True
    ) -> tuple[Array, Array]:
        """Return draws of s, and the logarithm of prior over proposal of each.

        Args:
            y: finds as seen from each particle [m], shape (n, m).
            choice: uniform in [0, 1), which chooses the part, shape (n,).
            normals: standard normals, shape (n, 2 m).
            prior: whether any are drawn from the prior; else the first part has its share.

        Returns:
            s [m], shape (n, m), and log weights, shape (n,), at most -log(prior share).
        """
        m = y.shape[1]
        s = normals[:, : self.root.shape[1]] @ self.root.T
        each = (1 - self._prior) / len(self._parts)
        for number, part in enumerate(self._parts):
            first = self._prior + number * each
            mine = (choice >= first) & ((choice < first + each) | (number == len(self._parts) - 1))
            own = np.flatnonzero(mine if prior or number else mine | (choice < self._prior))
            noise = normals[own][:, m : m + part.rows.size] @ np.linalg.cholesky(part.error).T
            innovation = y[np.ix_(own, part.rows)] + noise - s[np.ix_(own, part.rows)]
            within = self._within(part)
            gain = np.linalg.solve(within, self._covariance[part.rows])  # transposed
            s[own] += innovation @ gain
        ratios = [np.full(len(s), np.log(self._prior))]
        for part in self._parts:
            seen = y[:, part.rows]
            given = _log_normal(seen - s[:, part.rows], part.error)
            ratios.append(np.log(each) + given - _log_normal(seen, self._within(part)))
        return s, -np.logaddexp.reduce(ratios, axis=0)

    def _within(self, part: Part) -> Array:
        """Return the covariance of the observed displacements of a part's finds."""
        return np.asarray(self._covariance[np.ix_(part.rows, part.rows)] + part.error)


def _log_normal(x: Array, covariance: Array) -> Array:
    """Return the log density of a normal about 0, without its constant, (n,)."""
    root = np.linalg.cholesky(covariance)
    white = np.linalg.solve(root, x.T)
    return np.asarray(-0.5 * (white**2).sum(axis=0) - np.log(np.diag(root)).sum())
