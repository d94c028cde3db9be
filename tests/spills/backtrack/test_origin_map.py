"""The picture of a release: that it is drawn everywhere, the same each time, and says what the grid
says.
"""

import re
import socket

import numpy as np
import pytest
import shapely
from matplotlib.collections import LineCollection
from matplotlib.text import Text
from PIL import Image

from drift.products.maps import page
from drift.products.maps.imprint import Imprint, Setting
from drift.products.maps.marks import Mark
from drift.spills.backtrack import map as origin_map
from drift.spills.backtrack.backward import Origin
from geo import sphere

# or whatever else a picture must not be believed of
WRONG = "NO ERROR of current and wind in this forecast"

START = 122_000_400  # 1973-11-13T01:00Z [s since 1970]
HOUR = 3600
SPREAD = 4_000.0  # [m] of the posterior, a circular normal
NMI = 1852.0


def release(lon, lat, cells=(61, 45), times=12, effective=130.0):
    """Return a normal posterior about 3 km north of a place, in a uniform prior of cells of 1 km;
    later is less likely.
    """
    degree = np.radians(sphere.RADIUS)
    x = 1000.0 * (np.arange(cells[0]) - (cells[0] - 1) / 2)
    y = 1000.0 * (np.arange(cells[1]) - (cells[1] - 1) / 2)
    hours = START + HOUR * np.arange(times)
    later = 0.8 ** np.arange(times)
    place = np.exp(-(x**2 + (y[:, None] - 3000.0) ** 2) / (2 * SPREAD**2))
    chance = later[:, None, None] * place
    prior = np.ones(chance.shape)
    return Origin(
        lon=lon + x / (degree * np.cos(np.radians(lat))),
        lat=lat + y / degree,
        time=hours.astype("datetime64[s]"),
        prior=prior / prior.sum(),
        probability=chance / chance.sum(),
        mean=(lon, lat + 3000 / degree, float((hours * later).sum() / later.sum())),
        std=(SPREAD, SPREAD, 10_000.0),
        error=(300.0, 400.0, 900.0),
        worlds=500,
        effective=effective,
    )


def finds(lon, lat, count):
    return [
        Mark(lon + 0.02 * k, lat - 0.3, f"{100 + k} find of a thing, 15{k:02d}16Z")
        for k in range(1, count + 1)
    ]


@pytest.fixture
def seen(monkeypatch):
    """Collect the figures when they are saved."""
    figures = []
    save = page.save
    monkeypatch.setattr(
        page, "save", lambda canvas, *a, **k: (figures.append(canvas.figure), save(canvas, *a, **k))
    )
    return figures


def words(figure):
    return [text.get_text() for text in figure.findobj(Text)]


@pytest.mark.parametrize(
    ("lon", "lat", "cells", "times", "count"),
    [
        (-95.0, 29.0, (61, 45), 12, 5),
        (179.9, -17.5, (61, 45), 12, 5),
        (-180.1, 66.0, (61, 45), 24, 15),
        (20.0, 80.0, (61, 45), 3, 0),
        (5.1, 60.3, (1, 1), 1, 1),
        (5.1, 60.3, (40, 1), 2, 2),
    ],
)
@pytest.mark.thorough
def test_anywhere_and_with_a_single_cell(
    tmp_path, monkeypatch, seen, lon, lat, cells, times, count
):
    monkeypatch.setattr(socket, "socket", lambda *_: pytest.fail("a picture downloads nothing"))
    land = shapely.box(lon - 0.5, lat - 0.6, lon + 0.5, lat - 0.3)
    origin_map.plot_origin(
        release(lon, lat, cells, times),
        tmp_path / "origin.png",
        Setting(
            Imprint("A test " * 30, footer="casp-drift " * 40, caution=WRONG),
            polygons=lambda box: [land],
            marks=finds((lon + 180) % 360 - 180, lat, count),
        ),
    )
    with Image.open(tmp_path / "origin.png") as picture:
        assert picture.size == (1638, 1162)
    said = words(seen[0])
    assert said.count(origin_map.CAVEAT) == 1
    assert said.count("500 worlds, effective 130") == 1
    assert WRONG in said
    for k in range(1, count + 1):
        assert said.count(str(100 + k)) == 1  # on the map
    listed = [text for text in said if re.fullmatch(r"\d+ find of a thing, \d+Z", text)]
    assert len(listed) == (count if count <= 12 else 11)
    assert ("and 4 more" in said) == (count == 15)
    assert ("Released at 130100ZNOV1973, as given" in said) == (times == 1)


def test_figures_are_those_of_a_normal_release(tmp_path, seen):
    """A circular normal holds 1 - exp(-r^2 / 2 s^2); areas and radii are known to a cell in 70 and
    in 4.
    """
    setting = Setting(Imprint("T"), marks=finds(179.9, -17.5, 2))
    origin_map.plot_origin(release(179.9, -17.5), tmp_path / "origin.png", setting)
    said = words(seen[0])
    for share, name in ((50, "Half within"), (90, "90 % within")):
        radius = SPREAD * np.sqrt(-2 * np.log1p(-share / 100)) / NMI
        (area,) = (float(text.split()[3]) for text in said if text.startswith(f"{share} % area"))
        assert area == pytest.approx(np.pi * radius**2, rel=0.04)
        away = float(said[said.index(name) + 1].split()[0])
        assert away == pytest.approx(radius, abs=1000 / NMI)
    assert "17-28.4S 179-54.0E" in said
    assert "0.270 nmi (0.500 km), 0.250 h" in said
    # 0.8^k an hour from half an hour before START: the time before which a share lies, linear
    # within an hour.
    reached = np.concatenate([[0], np.cumsum(0.8 ** np.arange(12))]) / (0.8 ** np.arange(12)).sum()
    for share in (10, 50, 90):
        minutes = round(60 * (np.interp(share / 100, reached, np.arange(13)) + 0.5) - 1e-9)
        at = next(text for text in said if text.startswith(f"{share} %: before"))
        shown = int(at[-12:-10]) * 60 + int(at[-10:-8])
        assert abs(shown - minutes) <= 1, (at, minutes)


@pytest.mark.parametrize("lon", [-95.0, 179.9])
def test_outlines_enclose_the_areas_that_they_name(tmp_path, seen, lon):
    """Lines on the map, in Mercator's metres, enclose 2 pi s^2 ln 2 and 2 pi s^2 ln 10 to the width
    of half a cell.
    """
    lat = -17.5
    origin_map.plot_origin(release(lon, lat), tmp_path / "origin.png", Setting(Imprint("T")))
    ax = seen[0].axes[0]
    sizes = sorted(
        shapely.Polygon(path.vertices).area * np.cos(np.radians(lat)) ** 2
        for lines in ax.findobj(LineCollection)
        if lines.get_zorder() == 3
        for path in lines.get_paths()
    )
    for size, share in zip(sizes, (0.5, 0.9), strict=False):
        radius = np.sqrt(size / np.pi)
        assert radius == pytest.approx(SPREAD * np.sqrt(-2 * np.log1p(-share)), abs=500)
    # The prior's line runs between the outermost cells and those beyond.
    assert 60 * 44 < sizes[2] / 1e6 < 62 * 46


def test_few_effective_worlds_are_warned_of(tmp_path, seen):
    origin_map.plot_origin(
        release(-95.0, 29.0, effective=3.2), tmp_path / "origin.png", Setting(Imprint("T"))
    )
    assert any(text.startswith("ONLY 3 OF 500 WORLDS ARE EFFECTIVE: ") for text in words(seen[0]))
    chart = seen[0].axes[0]
    wanted, drawn = chart.get_position(original=True), chart.get_position()
    # the frame fits the room that the banner leaves
    np.testing.assert_allclose(drawn.bounds, wanted.bounds, atol=1e-3)


def test_the_same_release_gives_the_same_bytes(tmp_path):
    origin, land = release(179.9, -17.5), shapely.box(179.5, -18.0, 180.5, -17.8)
    for name in ("one.png", "two.png"):
        setting = Setting(
            Imprint("T", attributes={"run_id": "abc-s1"}),
            lambda box: [land],
            finds(179.9, -17.5, 3),
        )
        origin_map.plot_origin(origin, tmp_path / name, setting)
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()
    with Image.open(tmp_path / "one.png") as picture:
        assert picture.text["run_id"] == "abc-s1"
