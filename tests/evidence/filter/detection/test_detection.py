"""Laws of detection against integrals of their lateral range curves."""

import re
import tomllib

import numpy as np
import pytest
from pydantic import ValidationError
from scipy import integrate

from drift.case.search.sensor import SensorTable
from drift.evidence.filter.detection import laws
from drift.evidence.filter.records import Law
from drift.planning.search import concave

OF_EACH_KIND = {
    "random": Law("random"),
    "inverse_cube": Law("inverse_cube"),
    "definite_range": Law("definite_range"),
    "m_beta": Law("m_beta", beta=0.37),
    "curve": Law("curve", ranges=(0.0, 250.0, 700.0), chances=(0.85, 0.7, 0.2)),
}


@pytest.mark.parametrize("kind", laws.LAWS)
def test_a_law_is_written_as_a_case_file_reads_it(kind: str) -> None:
    """And is what its functions say: a lateral range curve has the integral 1, a POD is that of its
    coverage.
    """
    law = OF_EACH_KIND[kind]
    text = tomllib.loads(f"law = {laws.formulas_of(law).written(law)}")
    assert SensorTable.model_validate(text).law == law
    for chance in (0.0, 0.11, 0.3):
        assert float(laws.pod(law, laws.coverage_of(law, chance))) == pytest.approx(
            chance, abs=1e-11
        )
    if laws.formulas_of(law).detects == "abeam":
        ranges, chances = laws.range_curve(law)
        assert 2 * np.trapezoid(chances, ranges) == pytest.approx(1, rel=1e-12)
    else:
        with pytest.raises(ValueError, match="no lateral range curve"):
            laws.range_curve(law)
    h = np.linspace(0.01, 6, 50)
    assert (np.diff(laws.formulas_of(law).cap(law, h)) >= 0).all()


def test_a_law_is_added_by_one_entry(monkeypatch: pytest.MonkeyPatch) -> None:
    """A triangle, sure at no range and blind beyond W: the case file knows it, the bound holds it,
    a plan can be written.
    """
    triangle = laws.Formulas(
        detects="abeam",
        # not its own: any that the bound can hold
        pod=lambda _, c: np.where(c <= 1, c - c**2 / 6, 1.0),
        # 2 times the integral over r of min(-log r, h) below 1
        cap=lambda _, h: 2 * (1 - np.exp(-h)),
        lateral=lambda _: (np.array([0.0, 1.0]), np.array([1.0, 0.0])),
    )
    monkeypatch.setitem(laws.LAWS, "triangle", triangle)
    law = SensorTable.model_validate({"law": "triangle"}).law
    assert law == Law("triangle")
    assert laws.formulas_of(law).written(law) == '"triangle"'
    with pytest.raises(
        ValidationError,
        match=re.escape('did you mean "triangle"? Allowed: "random", "inverse_cube", '),
    ):
        SensorTable.model_validate({"law": "triangel"})
    # b(C) = int e^-h min(h, 2 C (1 - e^-h)) dh, in closed form at a coverage so low that the second
    # is always the less
    assert float(concave.most([law], np.array([0.25]))[0]) == pytest.approx(0.25, rel=2e-5)


def test_a_curve_is_as_wide_as_its_integral_on_both_sides() -> None:
    law = Law("curve", ranges=(0.0, 250.0, 700.0, 1300.0), chances=(0.85, 0.7, 0.2, 0.0))

    def chance(x: float) -> float:
        return float(np.interp(abs(x), law.ranges, law.chances, right=0.0))

    width = integrate.quad(chance, -1300, 1300, points=[-700, -250, 0, 250, 700])[0]
    assert laws.curve_sweep_width(law) == pytest.approx(width, rel=1e-9)
    # Few sweeps find what passes: at a spacing of two widths of the curve no point is seen twice.
    assert laws.pod(law, width / 2600) == pytest.approx(width / 2600, rel=1e-3)
    # At a spacing of 900 m a point is seen by up to three of them.
    place = (np.arange(9000) + 0.5) / 10
    missed = np.prod(
        [
            1 - np.interp(np.abs(place - k * 900), law.ranges, law.chances, right=0.0)
            for k in range(-2, 4)
        ],
        axis=0,
    )
    assert laws.pod(law, width / 900) == pytest.approx(1 - missed.mean(), abs=1e-3)
