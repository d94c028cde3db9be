"""Laws of detection against integrals of their lateral range curves."""

import numpy as np
import pytest
from scipy import integrate

from drift.search import laws
from drift.search.records import Law


def test_a_curve_is_as_wide_as_its_integral_on_both_sides() -> None:
    law = Law("curve", ranges=(0.0, 250.0, 700.0, 1300.0), chances=(0.85, 0.7, 0.2, 0.0))

    def chance(x: float) -> float:
        return float(np.interp(abs(x), law.ranges, law.chances, right=0.0))

    width = integrate.quad(chance, -1300, 1300, points=[-700, -250, 0, 250, 700])[0]
    assert laws.swept(law) == pytest.approx(width, rel=1e-9)
    # Few sweeps find what passes: at a spacing of two widths of the curve no point is seen twice.
    assert laws.pod(law, width / 2600) == pytest.approx(width / 2600, rel=1e-3)
    # At a spacing of 900 m a point is seen by up to three of them.
    place = (np.arange(9000) + 0.5) / 10
    missed = np.prod(
        [1 - np.interp(np.abs(place - k * 900), law.ranges, law.chances, right=0.0) for k in range(-2, 4)], axis=0
    )
    assert laws.pod(law, width / 900) == pytest.approx(1 - missed.mean(), abs=1e-3)
