"""The picture of a washup: that it is drawn everywhere, the same each time, and shows what it must,
in grey too.
"""

import socket

import numpy as np
import pytest
import shapely
from matplotlib.patches import BoxStyle
from matplotlib.text import Text
from PIL import Image

from drift.engine.particles.status import Status
from drift.products.maps import page
from drift.products.maps.imprint import Imprint, Setting
from drift.products.maps.marks import Mark
from drift.spills.worlds import washup
from drift.spills.worlds.fates import FOREVER, Fates, Realisation, Stays
from drift.spills.worlds.products import map as washup_map
from drift.spills.worlds.products import tables as washup_tables
from geo.coast.segments import Segments

# or whatever else a picture must not be believed of
WRONG = "NO ERROR of current and wind in this forecast"

START = np.datetime64("1973-11-21T18:00:00")


def coast(lon, lat, count):
    """Return stretches of 0.1 degrees along a coast that zigzags eastward from a place, and its
    land.
    """
    x = lon + 0.1 * np.arange(count + 1)
    y = lat + 0.03 * (np.arange(count + 1) % 2)
    lines = np.array(
        [shapely.LineString([(x[i], y[i]), (x[i + 1], y[i + 1])]) for i in range(count)], object
    )
    middle = (x[:-1] + 0.05 + 180) % 360 - 180
    land = shapely.Polygon([*zip(x, y, strict=True), (x[-1], lat + 0.5), (x[0], lat + 0.5)])
    names = tuple(f"Beach {i}, a long name that nobody ever said aloud" for i in range(count))
    where = Segments(names, np.full(count, 1e4), middle, np.full(count, lat + 0.015), np.arange(count), lines,
                     ("wild",) * count)  # fmt: skip
    return where, land


def spill(where, touched, worlds=50, each=8):
    """Return the washup of objects that come to one of the touched stretches each, most to the
    first, over two days.
    """
    rng = np.random.default_rng(6)
    n = worlds * each
    segment = np.full(n, -1)
    if len(touched):
        share = 0.6 ** np.arange(len(touched))
        segment = rng.choice([-1, *touched], n, p=np.append(0.3, 0.7 * share / share.sum()))
    slot = np.flatnonzero(segment >= 0)
    stays = np.stack(
        [slot, segment[slot], rng.integers(20_000, 170_000, len(slot)), np.full(len(slot), FOREVER)]
    )
    fates = Fates(
        worlds=worlds,
        world=np.repeat(np.arange(worlds), each).astype(np.int32),
        kind=np.zeros(n, np.int32),
        release=np.zeros(n, np.int32),
        ended=np.full(n, FOREVER, np.int32),
        ending=np.where(segment >= 0, Status.ASHORE, Status.ADRIFT).astype(np.int32),
        stays=Stays(*stays.astype(np.int32)),
    )
    nothing = np.zeros(worlds, np.int32)
    return washup.build_washup(
        [(fates, [Realisation(np.ones(n, np.int32), nothing, nothing)])],
        where,
        np.full(worlds, 1 / worlds),
        np.arange(1, 9) * 21_600,
        START,
    )


def words(monkeypatch):
    """Collect every text that is on a figure when it is saved, those in a circle in brackets."""
    found = []
    save = page.save

    def listen(canvas, *args, **kwargs):
        for text in canvas.figure.findobj(Text):
            box = text.get_bbox_patch()
            round_one = box is not None and isinstance(box.get_boxstyle(), BoxStyle.Circle)
            found.append(f"({text.get_text()})" if round_one else text.get_text())
        save(canvas, *args, **kwargs)

    monkeypatch.setattr(page, "save", listen)
    return found


@pytest.mark.parametrize(
    ("lon", "lat", "touched"),
    [
        (-95.0, 29.0, range(30)),
        (179.0, -17.5, range(20)),
        (-181.2, 66.0, range(25)),
        (20.0, 80.0, range(12)),
        (5.1, 60.3, [7]),
    ],
)
@pytest.mark.thorough
def test_anywhere_and_with_a_single_stretch(tmp_path, monkeypatch, lon, lat, touched):
    monkeypatch.setattr(socket, "socket", lambda *_: pytest.fail("a picture downloads nothing"))
    said = words(monkeypatch)
    where, land = coast(lon, lat, 30)
    washup_map.plot_washup(
        spill(where, list(touched)),
        where,
        tmp_path / "washup.png",
        Setting(
            Imprint("A test " * 30, footer="casp-drift " * 40, caution=WRONG),
            polygons=lambda box: [land],
            marks=[Mark(lon + 1.5, lat - 0.4, "Release 21/1800Z")],
        ),
    )
    with Image.open(tmp_path / "washup.png") as picture:
        assert picture.size == (1820, 1316)
    for rank in range(1, 1 + min(len(touched), 10)):
        assert said.count(f"({rank})") == 3  # on both maps and in the chart
    assert "(11)" not in said
    assert said.count("Release 21/1800Z") == 2
    assert WRONG in said
    assert any(text.startswith("Washup by 231800ZNOV1973") for text in said)
    assert any(text.startswith("50 worlds, effective 50") for text in said)
    assert any("ashore" in text and "afloat" in text for text in said)


def test_none_ashore(tmp_path, monkeypatch):
    said = words(monkeypatch)
    where, land = coast(179.5, -17.0, 9)
    washup_map.plot_washup(
        spill(where, []),
        where,
        tmp_path / "washup.png",
        Setting(Imprint("T"), polygons=lambda box: [land]),
    )
    assert (
        "None of the 50 simulated spills puts any object ashore by 231800ZNOV1973 (1973-11-23T18:00:00Z, UTC)"
        in said
    )
    assert WRONG not in said


@pytest.mark.thorough
def test_the_same_spill_gives_the_same_bytes(tmp_path):
    where, land = coast(-95.0, 29.0, 12)
    made = spill(where, list(range(12)))
    setting = Setting(Imprint("T", attributes={"run_id": "abc-s1"}), polygons=lambda box: [land])
    for name in ("one.png", "two.png"):
        washup_map.plot_washup(made, where, tmp_path / name, setting)
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()
    with Image.open(tmp_path / "one.png") as picture:
        assert picture.text["run_id"] == "abc-s1"


def test_colours_run_with_lightness_alone():
    # Relative luminance of sRGB (Rec. 709) falls all along the scale: in grey print more is darker,
    # everywhere
    colours = washup_map._dark_is_more()
    rgb = colours(np.arange(colours.N))[:, :3]
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    assert (np.diff(linear @ [0.2126, 0.7152, 0.0722]) < 0).all()


def test_the_worst_come_first():
    where, _ = coast(-95.0, 29.0, 12)
    made = spill(where, [5, 2, 9])
    worst = washup.worst_stretches(made)
    assert made["segment"].values[worst].tolist() == [5, 2, 9]
    assert washup.worst_stretches(made, 1).tolist() == worst[:1].tolist()


def test_all_afloat_again(tmp_path, monkeypatch):
    said = words(monkeypatch)
    where, _ = coast(-95.0, 29.0, 12)
    made = spill(where, [5, 2, 9])
    for name in ("expected", "probability", "number"):
        made[name][..., -1, :] = 0
    washup_map.plot_washup(made, where, tmp_path / "washup.png", Setting(Imprint("T")))
    assert said.count("(3)") == 3
    assert "0-0-0" in said


def test_numbers_of_stretches_are_those_of_the_table(tmp_path, monkeypatch):
    """A stretch that is too rare to be drawn keeps its number: those after it bear theirs of
    washup.csv.
    """
    said = words(monkeypatch)
    where, land = coast(-95.0, 29.0, 12)
    worlds, each = 300, 8
    n = worlds * each
    segment = np.full(n, -1)
    segment[::2] = 4
    # all objects of one world: more are expected than on the next, with a third of the probability
    segment[:8] = 7
    segment[np.array([20, 30, 40]) * each + 1] = 9
    slot = np.flatnonzero(segment >= 0)
    stays = np.stack(
        [slot, segment[slot], np.full(len(slot), 30_000), np.full(len(slot), FOREVER)]
    ).astype(np.int32)
    fates = Fates(worlds, np.repeat(np.arange(worlds), each).astype(np.int32), *(np.zeros(n, np.int32),) * 2,
                  np.full(n, FOREVER, np.int32), np.where(segment >= 0, Status.ASHORE, 0).astype(np.int32), Stays(*stays))  # fmt: skip
    nothing = np.zeros(worlds, np.int32)
    one = Realisation(np.ones(n, np.int32), nothing, nothing)
    made = washup.build_washup(
        [(fates, [one])], where, np.full(worlds, 1 / worlds), np.array([40_000]), START
    )
    washup_map.plot_washup(
        made, where, tmp_path / "washup.png", Setting(Imprint("T"), polygons=lambda box: [land])
    )
    table = washup_tables.stretch_columns(made)
    assert dict(zip(table["segment"].tolist(), table["rank"].tolist(), strict=True)) == {
        4: 1,
        7: 2,
        9: 3,
    }
    assert [text for text in said if text in ("(1)", "(2)", "(3)")] == ["(1)", "(3)"] * 3


@pytest.mark.thorough
def test_what_is_planned_is_shown_near_and_listed_alone(tmp_path, monkeypatch):
    """A map of all of a long coast shows no patrol: what is framed and listed is what is patrolled,
    numbered as in the tables.
    """
    said = words(monkeypatch)
    where, land = coast(-95.0, 29.0, 12)
    made = spill(where, [4, 5, 9])
    table = washup_tables.stretch_columns(made)
    ranks = dict(zip(table["segment"].tolist(), table["rank"].tolist(), strict=True))
    walked = [washup_map.Patrolled("east", np.datetime64("1973-11-22T09:30:00"), 0.65, [9])]
    setting, finds = Setting(Imprint("T"), polygons=lambda box: [land]), [Mark(-94.6, 29.0, "far")]
    for near, count in ((False, 3), (True, 1)):
        said.clear()
        patrols = washup_map.Patrols(walked, near=near)
        washup_map.plot_washup(
            made, where, tmp_path / "near.png", setting, finds=finds, patrols=patrols
        )
        assert said.count(f"({ranks[9]})") == 3  # on both maps, and in the table
        assert sum(text in ("(1)", "(2)", "(3)") for text in said) == 3 * count
        assert ("▲far" in said) == (not near)


@pytest.mark.thorough
def test_finds_bear_their_numbers_and_patrols_are_drawn(tmp_path, monkeypatch):
    said = words(monkeypatch)
    where, land = coast(-95.0, 29.0, 12)
    when = np.datetime64("1973-11-22T09:30:00")
    found = [Mark(-94.6, 29.0, "1"), Mark(-94.2, 29.0, "2")]
    walked = [
        washup_map.Patrolled("east", when, 0.65, [10, 11]),
        washup_map.Patrolled("west", when, 0.4, [0]),
    ]
    setting, patrols = (
        Setting(Imprint("T"), polygons=lambda box: [land]),
        washup_map.Patrols(walked),
    )
    washup_map.plot_washup(
        spill(where, [4, 5]), where, tmp_path / "with.png", setting, finds=found, patrols=patrols
    )
    for text in ("▲1", "▲2"):
        assert said.count(text) == 2  # on both maps
    assert (
        said.count("east\n220930Z 65 %")
        == said.count("west\n220930Z 40 %")
        == said.count("patrolled")
        == 1
    )
    band = np.array([0x4F, 0xA3, 0xD1]) * 0.55
    with Image.open(tmp_path / "with.png") as picture:
        colours = np.asarray(picture.convert("RGB")).reshape(-1, 3).astype(float)
    on_sea = np.abs(colours - band - 0.45 * np.array([0xF4, 0xF7, 0xF9])).max(axis=1) < 2
    assert on_sea.sum() > 200
    said.clear()
    washup_map.plot_washup(
        spill(where, [4, 5]), where, tmp_path / "without.png", setting, finds=found
    )
    assert "patrolled" not in said


def test_stretches_without_a_name_are_called_by_their_number():
    assert (
        washup_tables.stretch_name(12, "29-02.8N 090-52.6W", "29-02.8N 090-52.6W")
        == "stretch 12, 29-02.8N 090-52.6W"
    )
    assert washup_tables.stretch_name(12, "Long beach", "29-02.8N 090-52.6W") == "Long beach"
