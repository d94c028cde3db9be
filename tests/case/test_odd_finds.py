"""Finds and patrols of a spill that only the coast can reject, or that are possible but odd and
called so.
"""

import json
import math
from pathlib import Path
from typing import Any

import pytest
from island_spill import (
    AT,
    BOX,
    DRUM,
    EAST,
    FIND,
    PATROL,
    SPILL,
    TEN,
    patrols,
    refused_run,
    run,
    total,
    written,
)

from drift.apps.cli.commands import main
from drift.case import file as case_file
from drift.pipeline import flow
from drift.spills.worlds import evidence

pytestmark = pytest.mark.usefixtures("coarse_maps")  # no number is read off a map


@pytest.fixture(scope="module")
def stretches(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Names of all stretches of the island."""
    after = flow.run(case_file.load(written(tmp_path_factory.mktemp("plain")))).aftermath
    assert after is not None
    return list(after.segments.name)


def test_a_find_on_open_sea(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """0.2 degrees of longitude off the western shore at 27.2 N: 0.2 * 111.195 km * cos(27.2) = 19.8
    km.
    """
    line = refused_run(tmp_path, capsys, FIND + 'name = "box 7"\nat = [-88.2, 27.2]\n' + TEN)
    for word in (
        "box 7",
        "27-12.0N 088-12.0W",
        "19.8 km off the coast",
        "27-12.0N 088-00.0W",
        "within 3 km",
        "at_sea",
    ):
        assert word in line


def test_a_find_far_inland(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """0.14 degrees of longitude from the eastern shore at 27.2 N: 13.8 km."""
    line = refused_run(tmp_path, capsys, FIND + "at = [-87.84, 27.2]\n" + TEN)
    for word in ("find 1", "13.8 km inland", "27-12.0N 087-42.0W", "within 3 km", "move it"):
        assert word in line
    assert "at_sea" not in line


@pytest.mark.parametrize(
    "shore",
    [
        {"type": "LineString", "coordinates": [[-88, 27], [-87.7, 27.4]]},
        {"type": "Point", "coordinates": [-88, 27]},
        {"type": "FeatureCollection", "features": []},
    ],
)
def test_a_shoreline_without_polygons(
    shore: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = refused_run(tmp_path, capsys, shore=shore)
    for word in ("shore.geojson", "holds no land polygon", "give polygons of land", '"gshhg"'):
        assert word in line


@pytest.mark.thorough
def test_a_shoreline_that_crosses_itself_is_repaired_and_that_is_said(tmp_path: Path) -> None:
    """A bow tie: two triangles that meet in the middle; its western one still catches what comes."""
    bow = {
        "type": "Polygon",
        "coordinates": [[[-88, 27], [-87.7, 27.4], [-87.7, 27], [-88, 27.4], [-88, 27]]],
    }
    result = flow.run(case_file.load(written(tmp_path, shore=bow)))
    assert (
        "1 of 1 shoreline polygons crossed themselves and were repaired"
        in result.summary["coast"]["notes"]
    )
    assert total(result.summary["spill"], "ashore") > 10


def test_a_domain_with_no_coast(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    domain = "[domain]\nwest = -95\neast = -94\nsouth = 25\nnorth = 26\n"
    line = refused_run(tmp_path, capsys, domain, spill=SPILL.replace("-88.1, 27.2", "-94.5, 25.5"))
    for word in (
        "no coast in its domain",
        "-95.00..-94.00 E",
        "25.00..26.00 N",
        "[domain]",
        "[coast] source",
    ):
        assert word in line


def test_a_stretch_that_is_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = refused_run(tmp_path, capsys, FIND + 'stretch = "27-10.9N 087-42.0E"\n' + TEN)
    assert 'find 1: no stretch "27-10.9N 087-42.0E"' in line
    assert f'nearest is "{EAST}"' in line
    line = refused_run(tmp_path, capsys, PATROL + TEN + "detection = 0.5\n")
    assert 'patrol "walk": no stretch "west"' in line


def test_a_find_where_the_patrol_did_not_go(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = refused_run(
        tmp_path, capsys, patrols([EAST], 0.5, walk="+10 h") + FIND + AT + 'by = "walk"\n'
    )
    assert (
        'find 1: found by patrol "walk" on stretch "27-11.2N 088-00.0W", where that patrol did not go'
        in line
    )


def test_a_patrol_between_places_off_the_coast(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = (
        '[[patrol]]\nname = "walk"\nbetween = [[-88.3, 27.1], [-88.3, 27.3]]\ndetection = 0.5\n'
        + TEN
    )
    line = refused_run(tmp_path, capsys, given)
    assert 'patrol "walk": no stretch has its middle within 3 km' in line


def test_a_find_at_sea_on_land(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = refused_run(tmp_path, capsys, FIND + "at = [-87.85, 27.2]\nat_sea = true\n" + TEN)
    for word in ("find 1", "27-12.0N 087-51.0W", "not at sea but on land", "at_sea"):
        assert word in line


def test_a_release_on_land(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = refused_run(tmp_path, capsys, spill=SPILL.replace("-88.1, 27.2", "-87.9, 27.2"))
    for word in ("position.at", "27-12.0N 087-54.0W lies on land", "27-12.0N 088-00.0W"):
        assert word in line


def test_stretches_whose_kind_of_shore_has_no_rate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = [[-88.0, 27.1], [-88.0, 27.3]]
    feature = {"type": "Feature", "geometry": {"type": "LineString", "coordinates": line}}
    feature["properties"] = {"name": "Long Beach", "access": "harbour"}
    (tmp_path / "named.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": [feature]})
    )
    spill = SPILL.replace('"4 km"', '"4 km"\nfile = "named.geojson"')
    path = written(tmp_path, spill=spill)
    assert main(["run", str(path), "--out", str(tmp_path / "out")]) == 2
    message = capsys.readouterr().err
    assert 'stretch "Long Beach": its kind of shore "harbour" has no reporting rate' in message
    assert "town, road, wild" in message
    assert not (tmp_path / "out").exists()


@pytest.mark.thorough
@pytest.mark.parametrize(
    "find",
    [
        f'stretch = "{EAST}"\n' + TEN,  # in the lee, where no particle of any world comes
        AT + 'time = "+2 min"\n',  # before the first can arrive
        AT + 'by_time = "+2 min"\n',
        'at = [-88.3, 27.45]\nat_sea = true\nradius = "200 m"\ntime = "+2 h"\n',
        'at = [10, 50]\nat_sea = true\ntime = "+2 h"\n',  # in another ocean
    ],
)
def test_a_find_where_nothing_comes_is_called_odd(find: str, tmp_path: Path) -> None:
    spill = run(tmp_path, FIND + find)
    (told,) = spill["finds"]
    assert told["odd"]
    assert told["probability_beforehand"] < 0.001
    assert total(spill, "found") == pytest.approx(1)
    assert spill["effective_worlds"] > 59  # it tells no world from another


def test_an_odd_find_leaves_numbers_in_the_files(tmp_path: Path) -> None:
    path = written(tmp_path, FIND + f'stretch = "{EAST}"\n' + TEN)
    assert main(["run", str(path), "--out", str(tmp_path / "out")]) == 0
    for name in (
        "summary.json",
        "washup.csv",
        "washup_times.csv",
        "totals.csv",
        "unknowns.csv",
        "washup.geojson",
    ):
        assert "nan" not in (tmp_path / "out" / name).read_text().lower()
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["spill"]["finds"][0]["odd"]


def test_nothing_comes_ashore_and_yet_one_was_found(tmp_path: Path) -> None:
    """The current leads away from the island."""
    path = written(tmp_path, FIND + AT + TEN)
    path.write_text(
        path.read_text().replace("toward = 90", "toward = 270").replace("from = 270", "from = 90")
    )
    result = flow.run(case_file.load(path))
    assert result.summary["spill"]["finds"][0]["odd"]
    assert total(result.summary["spill"], "ashore") == 0


def test_all_sunk_and_yet_one_was_found(tmp_path: Path) -> None:
    spill = run(tmp_path, FIND + AT + TEN, classes=DRUM + 'sinking = { half_life = "1 s" }\n')
    assert spill["finds"][0]["odd"]
    assert total(spill, "sunk") > 10


@pytest.mark.parametrize("count", [2, 20])
def test_identical_finds(count: int, tmp_path: Path) -> None:
    """Two at one place and time are two objects; with twenty of twenty nothing is left."""
    spill = run(tmp_path, (FIND + AT + TEN) * count)
    assert total(spill, "found") == pytest.approx(count)
    if count == 20:
        assert total(spill, "destroyed") == 0
        assert total(spill, "ashore") == 0


@pytest.mark.thorough
def test_finds_that_may_all_be_false(tmp_path: Path) -> None:
    """More of them than objects: no error, for some must then be false."""
    spill = run(tmp_path, (FIND + AT + TEN + "false = 0.1\n") * 22)
    assert 10 < total(spill, "found") <= 20


@pytest.mark.thorough
def test_two_hundred_finds(tmp_path: Path) -> None:
    given = (
        SPILL.replace("objects = 20", "objects = 240")
        .replace("[0, 0.3]", "0")
        .replace('"1 h"', "0")
    )
    spill = run(tmp_path, (FIND + AT + TEN) * 200, spill=given)
    assert total(spill, "found") == pytest.approx(200)
    assert spill["effective_worlds"] < 50
    assert "spill.worlds" in spill["warning"]
    assert len(spill["finds"]) == 200


@pytest.mark.parametrize("lon", [180.0, -180.0, 179.999, -179.999])
def test_finds_at_the_antimeridian(lon: float, tmp_path: Path) -> None:
    """A shore along 180 degrees: either spelling is the same stretch, and no odd one."""
    shore = {
        "type": "Polygon",
        "coordinates": [[[180, 27], [180.3, 27], [180.3, 27.4], [180, 27.4], [180, 27]]],
    }
    given = SPILL.replace("-88.1, 27.2", "179.9, 27.2")
    spill = run(tmp_path, FIND + f"at = [{lon}, 27.2]\n" + TEN, spill=given, shore=shore)
    (told,) = spill["finds"]
    assert told["stretch"] == f"stretch {told['segment']}, 27-11.6N 180-00.0W"
    assert told["number"] == 1
    assert not told["odd"]


def test_a_find_beyond_the_antimeridian_is_measured_across_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """0.05 degrees of longitude inside the shore at 27.2 N: 4.9 km."""
    shore = {
        "type": "Polygon",
        "coordinates": [[[180, 27], [180.3, 27], [180.3, 27.4], [180, 27.4], [180, 27]]],
    }
    given = SPILL.replace("-88.1, 27.2", "179.9, 27.2")
    line = refused_run(
        tmp_path, capsys, FIND + "at = [-179.95, 27.2]\n" + TEN, spill=given, shore=shore
    )
    assert "4.9 km inland" in line


def test_a_certain_patrol_that_found_nothing_where_others_may_lie(
    stretches: list[str], tmp_path: Path
) -> None:
    """Sweeping the lee, where nothing comes, changes nothing."""
    spill = run(tmp_path, patrols([EAST], 1.0, walk="+10 h"))
    assert spill["effective_worlds"] > 59
    assert total(spill, "ashore") > 10


def test_a_certain_patrol_that_found_all(stretches: list[str], tmp_path: Path) -> None:
    """Twenty of twenty found by a sweep of the whole island: none is left anywhere."""
    finds = (FIND + AT + 'by = "walk"\n') * 20
    spill = run(tmp_path, patrols(stretches, 1.0, walk="+11 h") + finds)
    assert total(spill, "found") == pytest.approx(20)
    assert total(spill, "ashore") == total(spill, "destroyed") == 0


def test_release_duration_beyond_the_run(tmp_path: Path) -> None:
    """Objects go adrift over a day, the run lasts half of it: half are not yet, and that is in the
    account.
    """
    spill = run(tmp_path, spill=SPILL.replace('"1 h"', '"1 d"'))
    assert 0.4 < total(spill, "pending") / (20 - total(spill, "destroyed")) < 0.6


def test_the_grid_of_destroyed_shares_stays_inside_its_range(tmp_path: Path) -> None:
    spill = case_file.load(written(tmp_path)).spill
    assert spill is not None
    shares = evidence._number_priors(spill).destroyed
    assert 0 < shares.min() < shares.max() < 0.3
    assert math.isclose(shares.mean(), 0.15)


def test_a_certain_patrol_that_found_nothing_where_all_lie(
    stretches: list[str], tmp_path: Path
) -> None:
    spill = run(
        tmp_path, patrols(stretches, 1.0, walk="+11 h"), spill=SPILL.replace("[0, 0.3]", "0")
    )
    assert spill["warning"] is not None


def test_a_find_by_a_certain_patrol_after_another(stretches: list[str], tmp_path: Path) -> None:
    given = patrols(stretches, 1.0, first="+10 h", second="+11 h") + FIND + AT + 'by = "second"\n'
    run(tmp_path, given, spill=SPILL.replace("[0, 0.3]", "0"))


def test_a_find_where_nothing_comes_that_may_be_false_is_false(tmp_path: Path) -> None:
    spill = run(tmp_path, FIND + f'stretch = "{EAST}"\nfalse = 0.2\n' + TEN)
    assert total(spill, "found") < 0.2


@pytest.mark.thorough
def test_early_particles_of_worlds_that_the_finds_rule_out(tmp_path: Path) -> None:
    """At the start only few are adrift: all of worlds that sixty finds make next to impossible."""
    given = (
        SPILL.replace("objects = 20", "objects = 600")
        .replace("[0, 0.3]", "0")
        .replace("worlds = 60", "worlds = 50")
    )
    run(tmp_path, (FIND + AT + TEN) * 60, spill=given, classes=DRUM + BOX)
