"""Arrays as report.html carries them, against what zlib and base64 of the standard library give
back.
"""

import base64
import zlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drift.products.report import packed


def opened(frame: list[Any], shape: tuple[int, int]) -> np.ndarray:
    """Return a map of bytes: running sums down each column, modulo 256, put where they belong."""
    row, column, rows, columns, text = frame
    steps = np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8).reshape(rows, columns)
    whole = np.zeros(shape, np.uint8)
    whole[row : row + rows, column : column + columns] = (
        np.cumsum(steps, axis=0, dtype=np.uint64) % 256
    )
    return whole


@given(seed=st.integers(0, 2**32 - 1), low=st.floats(-7, -1))
def test_densities_are_told_to_half_a_level(seed: int, low: float) -> None:
    """What is at least 1e-5 of the densest comes back to 10^(5/253/2), and what is less than half a
    level below it is nothing.
    """
    rng = np.random.default_rng(seed)
    values = 3.7e-9 * 10 ** rng.uniform(low, 0, (3, 7, 5))
    values[rng.random(values.shape) < 0.3] = 0.0
    area = rng.uniform(1, 1.1, values.shape[1:])
    told = packed.logarithms(values * area, area)
    # and what float32 adds
    half = 10 ** (0.5 * told["decades"] / (told["levels"] - 1)) * (1 + 1e-5)
    for frame, then in zip(told["frames"], values, strict=True):
        q = opened(frame, then.shape).astype(float)
        back = np.where(
            q > 0,
            told["most"] * 10 ** (told["decades"] * ((q - 1) / (told["levels"] - 1) - 1)),
            0.0,
        )
        seen = then >= told["most"] * 1e-5
        np.testing.assert_array_less(np.abs(np.log(back[seen] / then[seen])), np.log(half))
        assert not back[then < told["most"] * 1e-5 / half].any()


def test_shares_are_told_to_half_a_level() -> None:
    rng = np.random.default_rng(4)
    values = rng.random((2, 6, 9))
    values[0, :2] = np.nan
    values[1, 0], values[1, -1] = 0.992, 0.998  # the rim of a map, which is not cut off
    told = packed.shares(values)
    for frame, then in zip(told["frames"], values, strict=True):
        q = opened(frame, then.shape).astype(float)
        assert ((q > 0) == np.isfinite(then)).all()
        back = 1 - (q - 1) / (told["levels"] - 1)
        assert np.nanmax(np.abs(back - then)) <= 0.5 / (told["levels"] - 1) + 1e-12


@pytest.mark.parametrize("fold", [1, 2, 3])
def test_cells_put_together_keep_the_whole(fold: int) -> None:
    """Sums keep the total, whatever hangs over; the least of a block is of its cells; the axis
    keeps the middle of its blocks.
    """
    rng = np.random.default_rng(2)
    values = rng.random((2, 7, 5))
    assert packed.merge_by_sum(values, fold).sum() == pytest.approx(values.sum(), rel=1e-12)
    blocks = packed.merge_by_minimum(values, fold)
    assert blocks[1, 0, 0] == values[1, :fold, :fold].min()
    axis = packed.axis(np.linspace(10.0, 10.6, 7), fold)
    assert axis["first"] == pytest.approx(10.0 + 0.05 * (fold - 1))
    assert (axis["size"], axis["step"]) == (-(-7 // fold), pytest.approx(0.1 * fold))


def test_few_maps_are_not_put_together_and_many_fit() -> None:
    assert packed.merge_factor(20, 400, 400) == 1
    fold = packed.merge_factor(300, 1500, 1700)
    assert 300 * 1500 * 1700 / fold**2 <= packed.MOST < 300 * 1500 * 1700 / (fold - 1) ** 2
