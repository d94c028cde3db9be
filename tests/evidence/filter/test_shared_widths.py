"""Sorties that share an unknown factor of their sweep widths, of one kind and of several."""

import dataclasses
import math

import numpy as np
import pytest
from filtered import SQUARE, STILL, flown, hours, legs, load, run
from scipy import special

from drift.evidence.filter.records import Law, Sortie
from geo.polyline import Area

WEST, MIDDLE, EAST, SOUTH, NORTH = 179.9, 180.0, 180.1, 59.9, 60.1
SHAPE = 4.0  # of the factor's gamma distribution
# A weight is a sum of logs of up to 7 in float32, in which each update rounds some times.
TOLERANCE = 2**-24 * 8 * 8


def _over(name, west, law, shape):
    """Return a sortie over an area from a longitude on; its coverage is 0.7."""
    place = Area((west, EAST, EAST, west), (SOUTH, SOUTH, NORTH, NORTH))
    return Sortie(
        name, "", hours(0.2), hours(0.9), law, (1.0,), shape, "one", area=place, coverage=(0.7,)
    )


def _along(name, offset, shape, begin=0.1):
    """Return a sortie along a leg, by the inverse cube law; offset: of the leg [m]."""
    track = legs([(-4000, offset), (6000, offset + 900.0)], begin, 20.0)
    return dataclasses.replace(
        flown(name, track, Law("inverse_cube"), 900.0), shape=shape, group="one"
    )


# By kind: the two sorties, and the miss of the second at a factor, of its log miss at a factor of 1.
KINDS = {
    "two legs": (
        lambda shape: [_along("a", 100, shape), _along("b", 2000, shape, 0.2)],
        lambda factor, alone: np.exp(factor**2 * alone),
    ),
    "two areas": (
        lambda shape: [
            _over("a", WEST, Law("random"), shape),
            _over("b", MIDDLE, Law("random"), shape),
        ],
        lambda factor, alone: np.exp(factor * alone),
    ),
    "leg after an area": (
        lambda shape: [_along("a", 100, shape, 1.0), _over("b", WEST, Law("random"), shape)],
        lambda factor, alone: np.exp(factor * alone),
    ),
    "leg and swept area": (
        lambda shape: [_along("a", 100, shape), _over("b", MIDDLE, Law("inverse_cube"), shape)],
        lambda factor, alone: np.where(
            alone < -0.1, 1 - special.erf(np.sqrt(np.pi) / 2 * 0.7 * factor), 1.0
        ),
    ),
}


@pytest.mark.parametrize("kind", KINDS)
def test_two_misses_that_share_a_sweep_width(tmp_path, kind):
    """By SciPy's Gauss-Laguerre sum of what each alone misses of each particle if the width is
    known: a hazard along legs grows with the square of the width, one over an area in proportion,
    and the POD of a swept area by its own law.
    """
    sorties, second = KINDS[kind]

    def logs(some):
        _, ensemble, _ = run(load(tmp_path, STILL + SQUARE, sorties=tuple(some)))
        return ensemble.log_weight.to_numpy().astype(float) - math.log(1 / 1000)

    alone = [logs([one]) for one in sorties(math.inf)]
    nodes, chances = special.roots_genlaguerre(16, SHAPE - 1)
    factor, power = (nodes / SHAPE)[:, None], 1 if kind == "two areas" else 2
    miss = np.exp(factor**power * alone[0]) * second(factor, alone[1])
    assert max(own.min() for own in alone) < -0.3
    assert max(own.max() for own in alone) > -0.9
    np.testing.assert_allclose(
        logs(sorties(SHAPE)), np.log(chances / chances.sum() @ miss), atol=TOLERANCE
    )
