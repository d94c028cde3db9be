"""Occupancy maps, against exact Bayes of a walk from cell to cell."""

import numpy as np
import pytest

from drift.tracking.tracker import occupancy

RATE = 0.37


def chain(rows: int, columns: int) -> np.ndarray:
    """Return the probabilities to go from cell to cell: a quarter of the rate to each neighbour
    there is, else it stays.
    """
    to = np.zeros((rows * columns,) * 2)
    for i in range(rows):
        for j in range(columns):
            for a, b in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)):
                if 0 <= a < rows and 0 <= b < columns:
                    to[a * columns + b, i * columns + j] = RATE / 4
            to[i * columns + j, i * columns + j] = 1 - to[:, i * columns + j].sum()
    return to


def test_a_map_is_the_posterior_of_a_walk_that_looks_did_not_find() -> None:
    """Paths are counted: the chance of every look to find nothing, and of where the target then is."""
    shape, rng = (4, 5), np.random.default_rng(8)
    step = chain(*shape)
    found = occupancy.seen(shape, (1, 2))
    joint, missed = found.ravel().copy(), 1.0
    for _ in range(12):
        found = occupancy.spread(found, RATE)
        joint = step @ joint
        visible = rng.random(shape) < 0.2
        found, culled = occupancy.unseen(found, visible)
        joint = np.where(visible.ravel(), 0.0, joint)
        missed *= 1 - culled
        np.testing.assert_allclose(found.ravel(), joint / joint.sum(), rtol=1e-12)
        assert missed == pytest.approx(joint.sum(), rel=1e-12)


def test_what_spreads_is_kept_whole_and_even_in_the_end() -> None:
    found = occupancy.seen((5, 7), (0, 6))
    for _ in range(4000):
        found = occupancy.spread(found, 1.0 if _ % 2 else 0.8)
    np.testing.assert_allclose(found, 1 / 35, rtol=1e-9)


def test_what_cannot_be_is_refused() -> None:
    found = occupancy.seen((2, 2), (0, 1))
    with pytest.raises(ValueError, match="no probability is left"):
        occupancy.unseen(found, np.array([[False, True], [False, False]]))
    with pytest.raises(ValueError, match=r"rate 1\.5 must be 0 to 1"):
        occupancy.spread(found, 1.5)
