"""Merged normal distributions, against the product of their densities."""

import numpy as np
import pytest
from scipy import stats

from drift.tracking.tracker import gaussians
from drift.tracking.tracker.gaussians import Gaussian

FIRST = gaussians.observed(-310.0, 840.0, 420.0, 130.0, np.radians(37))
SECOND = gaussians.observed(150.0, 520.0, 510.0, 90.0, np.radians(118))


def moments(*some: Gaussian) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and covariance of the product of densities, by sums over a fine grid."""
    at = np.linspace(-4000, 4000, 1601)
    points = np.stack(np.meshgrid(at, at), axis=-1)
    p = np.prod(
        [stats.multivariate_normal(one.mean, one.covariance).pdf(points) for one in some], axis=0
    )
    p /= p.sum()
    mean = np.einsum("ij,ijk->k", p, points)
    return mean, np.einsum("ij,ijk,ijl->kl", p, points - mean, points - mean)


@pytest.mark.thorough
def test_a_merged_distribution_is_the_product_in_any_order() -> None:
    third = gaussians.observed(-80.0, 700.0, 300.0, 250.0, np.radians(165))
    mean, covariance = moments(FIRST, SECOND, third)
    for one, two, three in ((FIRST, SECOND, third), (third, FIRST, SECOND), (SECOND, third, FIRST)):
        found = gaussians.merged(gaussians.merged(one, two), three)
        np.testing.assert_allclose(found.mean, mean, rtol=1e-9)
        np.testing.assert_allclose(found.covariance, covariance, rtol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 20.0, 89.0, 90.0, 135.0, 179.0])
def test_axes_are_those_that_were_given_in_every_quadrant(angle: float) -> None:
    """The density falls as along the axis as a normal one of its deviation does: by exp(-1/2) at
    one of it.
    """
    found = gaussians.observed(100.0, -40.0, 420.0, 130.0, np.radians(angle))
    assert gaussians.axes(found) == pytest.approx((420.0, 130.0, np.radians(angle)), abs=1e-6)
    law = stats.multivariate_normal(found.mean, found.covariance)
    along = np.array([np.sin(np.radians(angle)), np.cos(np.radians(angle))])
    assert law.pdf(found.mean + 420 * along) / law.pdf(found.mean) == pytest.approx(np.exp(-0.5))
    across = np.array([along[1], -along[0]])
    assert law.pdf(found.mean + 130 * across) / law.pdf(found.mean) == pytest.approx(np.exp(-0.5))


def test_two_sights_across_each_other_are_better_than_either() -> None:
    """The example of Stroupe et al., Figure 4: the merged ellipse is smaller than both on every
    axis.
    """
    both = gaussians.axes(gaussians.merged(FIRST, SECOND))
    assert both.major < 130 / np.sin(np.radians(81)) + 1
    assert both.minor < 90


@pytest.mark.parametrize(
    "covariance", [[[1.0, 2.0], [2.0, 1.0]], [[1.0, 0.5], [0.1, 1.0]], [[0.0, 0.0], [0.0, 1.0]]]
)
def test_what_is_no_covariance_is_refused(covariance: list[list[float]]) -> None:
    with pytest.raises(ValueError, match="is no covariance"):
        Gaussian(np.zeros(2), np.array(covariance))
