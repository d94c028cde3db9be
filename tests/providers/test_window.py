"""Which rows and columns a box needs, against every node asked by itself."""

import numpy as np
import pytest

from drift.providers import window
from geo.box import Box

MARGIN = 1.5  # cells that are taken beyond the box


def around(lon: np.ndarray, west: float) -> np.ndarray:
    """Return longitudes as degrees east of a meridian, in [0, 360)."""
    return (lon - west) % 360


@pytest.mark.parametrize("down", [False, True], ids=["ascending", "descending"])
@pytest.mark.parametrize("kind", ["regional", "global", "closed"])
@pytest.mark.parametrize("seed", range(12))
def test_columns_are_those_of_the_box(seed: int, kind: str, down: bool) -> None:
    random = np.random.default_rng([seed, len(kind), down])
    step = float(random.choice([0.25, 1.0, 2.5]))
    first = float(random.uniform(-180, 200))
    many = {"regional": int(60 / step), "global": round(360 / step), "closed": round(360 / step) + 1}[kind]
    lon = first + step * np.arange(many)
    # A closed axis has its first meridian twice: the box lies about it.
    west = first + float(random.uniform(-20, {"regional": 50, "global": 350, "closed": 2}[kind]))
    box = Box(west, -11.3, west + float(random.uniform(3, 30)), 17.9)
    lat = np.arange(-80, 80.1, 2.0)
    if down:
        lon, lat = lon[::-1], lat[::-1]
    found = window.along_axes(lon, lat, box)
    wanted = around(lon, box.west - MARGIN * step) <= box.east - box.west + 2 * MARGIN * step
    if not wanted.any():
        assert found is None
        return
    assert found is not None
    columns = np.concatenate([np.arange(*run) for run in found.runs])
    taken = np.concatenate([lon[slice(*run)] + turn for run, turn in zip(found.runs, found.turns, strict=True)])
    assert found.shape == (found.rows[1] - found.rows[0], columns.size)
    assert found.turns[0] == 0  # they begin as the file has them
    np.testing.assert_allclose(np.diff(taken), -step if down else step, atol=1e-9)  # and run on without a jump
    everyone = {round(float(x) % 360, 6) % 360 for x in lon[wanted]}
    assert {round(float(x) % 360, 6) % 360 for x in lon[columns]} == everyone  # each meridian, and once
    assert columns.size == len(everyone)
    rows = lat[slice(*found.rows)]
    assert rows.tolist() == [y for y in lat if box.south - 2 * MARGIN <= y <= box.north + 2 * MARGIN]
    left = box.west + (taken.min() - box.west + 180) % 360 - 180  # of all turns, that nearest to the box
    assert found.whole == (left <= box.west and left + np.ptp(taken) >= box.east)


@pytest.mark.parametrize(("south", "north", "whole"), [(-79, 79, True), (-79, 85, False), (-85, 10, False)])
def test_a_box_that_is_higher_than_the_grid(south: float, north: float, whole: bool) -> None:
    found = window.along_axes(np.arange(0, 360, 2.0), np.arange(-80, 80.1, 2.0), Box(10, south, 20, north))
    assert found is not None
    assert found.whole == whole


def test_the_whole_circle() -> None:
    found = window.along_axes(np.arange(0, 360, 10.0), np.arange(-80, 80.1, 10.0), Box(-180, -70, 180, 70))
    assert found == window.Window((0, 17), ((0, 36),), (0.0,), True)
