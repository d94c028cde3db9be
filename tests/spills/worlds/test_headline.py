"""The sentences on top of a spill's report."""

import numpy as np
import pytest
import xarray as xr

from drift.spills.worlds.products.headline import washup_headline


def washup(
    ashore: float, numbers: tuple[float, float, float], near: str = "Vlieland"
) -> xr.Dataset:
    """Return two times and three stretches, of which the last has most; 60 objects were lost."""
    total = np.array([[0.0, ashore], [60.0, 60.0 - ashore]])
    return xr.Dataset(
        {
            "total": (("fate", "time"), total),
            "total_number": (
                ("fate", "time", "quantile"),
                np.array([[(0, 0, 0), numbers]] * 2, float),
            ),
            "expected": (("time", "segment"), np.array([[9.0, 0, 0], [1.25, 2.5, 7.5]])),
            "arrived": (("time", "segment"), np.array([[9.0, 0, 0], [1.5, 3.0, 8.0]])),
            "name": ("segment", np.array(["one", "two", "Oost"], object)),
            "near": ("segment", np.array(["a", "b", near], object)),
            "near_distance": ("segment", np.array([1e3, 2e3, 20_372.0])),
        },
        {
            "time": np.array(["2019-01-01T22:00", "2019-01-03T06:30"], "datetime64[ns]"),
            "fate": ["ashore", "afloat"],
            "segment": np.array([4, 5, 9], np.int32),
        },
    )


def test_it_says_how_many_lie_ashore_and_where_most_of_them_do() -> None:
    assert washup_headline(washup(11.31, (4, 11, 19))) == (
        "By 030630ZJAN19, 11.3 of 60 objects are expected ashore (4 to 19 with 80 % probability). "
        "The stretch with most of them, 7.50, is Oost, 11 nmi from Vlieland."
    )


@pytest.mark.parametrize(
    ("near", "end"), [("", "is Oost."), ("Vlieland", "is Oost, 11 nmi from Vlieland.")]
)
def test_one_number_has_no_span_and_no_town_is_made_up(near: str, end: str) -> None:
    words = washup_headline(washup(11.25, (11, 11, 11), near))
    assert "are expected ashore. The stretch" in words
    assert words.endswith(end)


def test_where_nothing_is_ashore_it_says_so() -> None:
    assert (
        washup_headline(washup(0.04, (0, 0, 0)))
        == "By 030630ZJAN19, hardly any of 60 objects is ashore."
    )
