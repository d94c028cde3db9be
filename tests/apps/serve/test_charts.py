"""Charts of the user's own: what is read, what is sent, and files that are not as they should be."""

import gzip
import sqlite3
from pathlib import Path

import chart_files
import pytest
from desks import Server

from drift.apps.serve import charts, users
from geo.errors import UserError

RED, BLUE = chart_files.image((200, 0, 0)), chart_files.image((0, 0, 200), "jpeg")
WEBP = chart_files.image((0, 90, 0), "webp")
TILES = {(0, 0, 0): RED, (1, 0, 0): BLUE, (1, 1, 1): WEBP}
MADE = {"name": "Sound", "attribution": "<a href='https://x'>&copy; The <b>Office</b></a>"}


@pytest.fixture
def both(tmp_path: Path) -> dict[str, charts.Chart]:
    """The same tiles in both kinds of file."""
    return {
        "MBTiles": charts.open_chart(
            chart_files.mbtiles(tmp_path / "a.mbtiles", TILES, format="png", **MADE)
        ),
        "PMTiles": charts.open_chart(chart_files.pmtiles(tmp_path / "b.pmtiles", TILES, **MADE)),
    }


@pytest.mark.parametrize("kind", ["MBTiles", "PMTiles"])
def test_tiles_are_those_of_the_file_by_rows_from_the_north(
    both: dict[str, charts.Chart], kind: str
) -> None:
    chart = both[kind]
    assert (chart.name, chart.attribution) == ("Sound", "© The Office")
    assert (chart.least, chart.most) == (0, 1)
    assert chart.tile(0, 0, 0) == ("image/png", RED)
    assert chart.tile(1, 0, 0) == ("image/jpeg", BLUE)
    assert chart.tile(1, 1, 1) == ("image/webp", WEBP)
    for absent in ((1, 1, 0), (1, 0, 1), (1, 2, 0), (1, 0, 2), (2, 0, 0), (40, 0, 0)):
        assert chart.tile(*absent) is None


def test_bounds_are_those_of_the_file_unless_they_enclose_nothing(tmp_path: Path) -> None:
    for k, (given, expected) in enumerate(
        {
            "-6.5,49.2,-4.25,50.75": (-6.5, 49.2, -4.25, 50.75),
            "170,-20,-170,-10": None,  # across 180 E
            "0,0,0,0": None,
            "nan,0,1,1": None,
            "1,2,3": None,
        }.items()
    ):
        path = chart_files.mbtiles(tmp_path / f"{k}.mbtiles", TILES, bounds=given)
        assert charts.open_chart(path).bounds == expected
    assert charts.open_chart(path).name == "4"  # a chart without a name has that of its file


def test_only_images_are_sent(tmp_path: Path) -> None:
    """A tile of markup, one that is too large, and one that is no bytes are none."""
    hostile = {
        (1, 0, 0): b"<svg xmlns='http://www.w3.org/2000/svg' onload='alert(1)'/>",
        (1, 0, 1): b"<html>",
        (1, 1, 0): b"RIFF\0\0\0\0WAVE",
        (1, 1, 1): RED + bytes(charts.LARGEST),
    }
    chart = charts.open_chart(chart_files.mbtiles(tmp_path / "a.mbtiles", hostile))
    for key in hostile:
        assert chart.tile(*key) is None
    with sqlite3.connect(tmp_path / "a.mbtiles") as file:
        file.execute("INSERT INTO tiles VALUES (0, 0, 0, 'text')")
    file.close()
    assert charts.open_chart(tmp_path / "a.mbtiles").tile(0, 0, 0) is None


def test_a_view_is_a_table_too_and_one_that_never_ends_is_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Images of many tiles are often kept once, behind a view (MBTiles 1.3)."""
    monkeypatch.setattr(charts, "PATIENCE", 0.2)
    path = chart_files.mbtiles(tmp_path / "a.mbtiles", TILES)
    with sqlite3.connect(path) as file:
        file.execute("ALTER TABLE tiles RENAME TO images")
        file.execute("CREATE VIEW tiles AS SELECT * FROM images")
    file.close()
    assert charts.open_chart(path).tile(0, 0, 0) == ("image/png", RED)
    with sqlite3.connect(path) as file:
        file.execute("DROP VIEW tiles")
        endless = "WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL SELECT k + 1 FROM n)"
        columns = "k AS zoom_level, k AS tile_column, k AS tile_row, zeroblob(9) AS tile_data"
        file.execute(f"CREATE VIEW tiles AS {endless} SELECT {columns} FROM n")
    file.close()
    with pytest.raises(UserError, match=r"is damaged \(interrupted\)"):
        charts.open_chart(path)


def test_a_directory_that_unpacks_to_too_much_is_no_tile(tmp_path: Path) -> None:
    path = chart_files.pmtiles(tmp_path / "a.pmtiles", TILES)
    whole = path.read_bytes()
    begin, length = (int.from_bytes(whole[k : k + 8], "little") for k in (8, 16))
    listed = gzip.decompress(whole[begin : begin + length])
    opened = charts.open_chart(path)
    for more, expected in ((0, ("image/png", RED)), (charts.LONGEST, None)):
        root = gzip.compress(listed + bytes(more))  # the same tiles, and nothing behind them
        place = len(whole).to_bytes(8, "little"), len(root).to_bytes(8, "little")
        path.write_bytes(whole[:8] + b"".join(place) + whole[24:] + root)
        assert opened.tile(0, 0, 0) == expected


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (None, r"cannot be read \(No such file or directory\)"),
        (b"", "is neither MBTiles nor PMTiles 3"),
        (b"PMTiles\x02" + bytes(200), "is neither MBTiles nor PMTiles 3"),
        (b"PMTiles\x03" + bytes(20), "is damaged"),
        (b"PMTiles\x03" + bytes(200), "is damaged"),
        (b"SQLite format 3\0" + bytes(2000), "is damaged"),
    ],
)
def test_what_is_no_chart_is_one_line(tmp_path: Path, content: bytes | None, told: str) -> None:
    path = tmp_path / "chart"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(UserError, match=told) as refused:
        charts.open_chart(path)
    assert str(refused.value).startswith(f'chart "{path}": ')
    assert "--chart" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_vector_charts_and_other_tiles_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"is a vector chart; .*convert it to PNG tiles"):
        charts.open_chart(chart_files.mbtiles(tmp_path / "a.mbtiles", TILES, format="pbf"))
    with pytest.raises(UserError, match="is a vector chart"):
        charts.open_chart(chart_files.pmtiles(tmp_path / "a.pmtiles", TILES, "mvt"))
    with pytest.raises(UserError, match='tiles of the kind "avif"; they must be png, jpg or webp'):
        charts.open_chart(chart_files.pmtiles(tmp_path / "b.pmtiles", TILES, "avif"))
    with pytest.raises(UserError, match="its images are packed once more"):
        charts.open_chart(chart_files.pmtiles(tmp_path / "c.pmtiles", TILES, packed=2))
    with pytest.raises(UserError, match="holds no tiles"):
        charts.open_chart(chart_files.mbtiles(tmp_path / "b.mbtiles", {}))


def test_the_page_gets_tiles_and_nothing_else(
    tmp_path: Path, both: dict[str, charts.Chart]
) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    people = (users.User("Ada"), users.User("guest", guest=True))
    with Server(folder.resolve(), people=people, chart=tuple(both.values())) as served:
        told = served.json("GET", "/api/charts")["charts"]
        assert [one["name"] for one in told] == ["Sound", "Sound"]
        assert told[1]["bounds"] == [-180, -85, 180, 85]
        for number in (0, 1):
            status, headers, data = served.ask("GET", f"/api/charts/{number}/1/0/0")
            assert (status, headers["content-type"], data) == (200, "image/jpeg", BLUE)
            # where the chart has nothing, a transparent image: to a browser a missing one is an error
            status, headers, data = served.ask("GET", f"/api/charts/{number}/1/1/0")
            assert (status, headers["content-type"], len(data) < 100) == (200, "image/png", True)
        for wrong in ("2/0/0/0", "0/2/0/0", "0/-1/0/0", "0/0/0/x", f"0/0/0/{'9' * 400}/1"):
            assert served.ask("GET", f"/api/charts/{wrong}")[0] == 404
        assert served.ask("GET", "/api/charts/0/0/0/0", Cookie=None)[0] == 401
