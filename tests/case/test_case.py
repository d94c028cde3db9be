"""The case file: what it turns into."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from places import DATA, ROOT
from raft_case import CASE, load, with_prior

from drift.case import file as case_file
from drift.engine.environment.forcing_spec import Slices
from drift.engine.motion.objects import leeway
from drift.engine.motion.scenario import AreaPrior, PositionPrior, TracklinePrior
from geo import sphere
from geo.box import Box
from geo.errors import UserError


def test_case_in_si(tmp_path: Path) -> None:
    found = load(tmp_path)
    assert found.title == "A test"
    assert found.start == np.datetime64("2026-11-21T18:30:00")
    assert found.end == np.datetime64("2026-11-22T18:30:00")
    assert (found.direction, found.particles, found.seed, found.max_lost) == (1, 1000, 1, 0.2)
    assert (found.step, found.scheme, found.tolerance) == (None, "rk4", 20.0)
    assert found.forcing["current"][0].constant == pytest.approx(
        (
            0.8 * 1852 / 3600 * math.cos(math.radians(30)),
            -0.8 * 1852 / 3600 * math.sin(math.radians(30)),
        )
    )
    # Wind from 240 degrees blows toward 60.
    assert found.forcing["wind"][0].constant == pytest.approx(
        (
            12 * 1852 / 3600 * math.sin(math.radians(60)),
            12 * 1852 / 3600 * math.cos(math.radians(60)),
        )
    )
    only = found.scenarios[0]
    assert (only.weight, only.sources) == (
        1.0,
        {"current": ("set",), "wind": ("report",), "stokes": ()},
    )
    assert only.jibe_rate == pytest.approx(0.04 / 3600)
    assert isinstance(only.prior, PositionPrior)
    assert (only.prior.lon, only.prior.lat) == pytest.approx(
        (math.radians(-88.25), math.radians(27 + 30.5 / 60))
    )
    assert only.prior.major == only.prior.minor == 5 * 1852
    assert only.prior.release_start == only.prior.release_end == found.start


def test_outputs_are_in_order_of_the_run_with_both_ends(tmp_path: Path) -> None:
    hours = np.timedelta64(3600, "s")
    forward = load(tmp_path, output__every="'7 h'")
    assert ((forward.outputs - forward.start) / hours).tolist() == [0, 7, 14, 21, 24]
    chosen = load(tmp_path, output__times='["+13 h", "212030ZNOV26", "+13 h"]')
    assert ((chosen.outputs - chosen.start) / hours).tolist() == [0, 2, 13, 24]
    backward = load(tmp_path, direction="backward", output__every="'10 h'")
    assert backward.direction == -1
    assert ((backward.outputs - backward.start) / hours).tolist() == [0, -10, -20, -24]


def test_backward_with_an_end(tmp_path: Path) -> None:
    text = CASE.replace('duration = "24 h"', 'end = "201830ZNOV26"\ndirection = "backward"')
    found = load(tmp_path, text)
    assert (found.direction, found.end) == (-1, np.datetime64("2026-11-20T18:30:00"))


@pytest.mark.parametrize(
    ("error", "major", "minor", "orientation"),
    [
        ('std = ["6 nmi", "3 nmi"]\norientation = 30', 6 * 1852, 3 * 1852, 30),
        ('std = ["3 nmi", "6 nmi"]\norientation = 30', 6 * 1852, 3 * 1852, 120),
        # 1 - exp(-k^2/2) = p: k = 1.17741 for 50 %, 2.44775 for 95 % (circular and elliptical
        # normal, tables)
        ('error = "3 nmi"', 3 * 1852 / 1.177410, 3 * 1852 / 1.177410, 0),
        (
            'ellipse = { major = "4 km", minor = "1 km", orientation = 75 }',
            4000 / 1.177410,
            1000 / 1.177410,
            75,
        ),
        (
            'ellipse = { major = "4 km", minor = "1 km", orientation = 75, probability = 0.95 }',
            4000 / 2.447747,
            1000 / 2.447747,
            75,
        ),
    ],
)
def test_errors_of_a_position(
    tmp_path: Path, error: str, major: float, minor: float, orientation: float
) -> None:
    prior = load(tmp_path, CASE.replace('std = "5 nmi"', error)).scenarios[0].prior
    assert isinstance(prior, PositionPrior)
    assert (prior.major, prior.minor) == pytest.approx((major, minor), rel=1e-6)
    assert math.degrees(prior.orientation) == pytest.approx(orientation)


def test_displacement_and_unknown_time(tmp_path: Path) -> None:
    text = (
        CASE
        + 'until = "+3 h"\ndisplacement = { distance = ["2 nmi", "10 nmi"], direction = [350, 20] }\n'
    )
    prior = load(tmp_path, text).scenarios[0].prior
    assert isinstance(prior, PositionPrior)
    assert prior.displacement is not None
    assert prior.displacement.distance == (2 * 1852, 10 * 1852)
    assert np.degrees(prior.displacement.direction) == pytest.approx([350, 380])
    assert prior.release_end - prior.release_start == np.timedelta64(3, "h")


def test_area_over_the_antimeridian_has_no_jump(tmp_path: Path) -> None:
    text = with_prior(
        '[scenario.area]\npolygon = ["10S 179E", "10S 178W", "12S 179W", "13S 178E", "10S 179E"]\n'
    )
    prior = load(tmp_path, text).scenarios[0].prior
    assert isinstance(prior, AreaPrior)
    assert np.degrees(prior.lon) == pytest.approx([179, 182, 181, 178])
    assert np.degrees(prior.lat) == pytest.approx([-10, -10, -12, -13])


def test_trackline_lasts_as_long_as_its_legs(tmp_path: Path) -> None:
    text = with_prior(
        '[scenario.trackline]\nwaypoints = ["27N 88W", "28N 88W", "28N 87W"]\nspeed = "8 kn"\ncross_track = "2 nmi"\n'
    )
    prior = load(tmp_path, text).scenarios[0].prior
    assert isinstance(prior, TracklinePrior)
    # One degree of a meridian, and the chord formula for one degree of the parallel of 28 N.
    parallel = 2 * math.asin(math.cos(math.radians(28)) * math.sin(math.radians(0.5)))
    seconds = sphere.RADIUS * (math.radians(1) + parallel) / (8 * 1852 / 3600)
    assert (prior.arrival - prior.departure).astype(int) == pytest.approx(seconds, abs=1)
    assert (prior.low, prior.high, prior.mode) == (0, 1, None)
    assert (prior.release_start, prior.release_end) == (prior.departure, prior.arrival)

    between = (
        load(tmp_path, text + 'distress = { between = ["+3 h", "+9 h"] }\n').scenarios[0].prior
    )
    assert isinstance(between, TracklinePrior)
    assert (between.low, between.high) == pytest.approx((3 * 3600 / seconds, 9 * 3600 / seconds))
    assert (between.release_end - between.release_start).astype(int) == pytest.approx(
        6 * 3600, abs=1
    )
    peaked = (
        load(tmp_path, text + "distress = { triangular = { mode = 0.6 } }\n").scenarios[0].prior
    )
    assert isinstance(peaked, TracklinePrior)
    assert peaked.mode == 0.6


def test_objects(tmp_path: Path) -> None:
    def drifter(value: str) -> leeway.Drifter:
        return load(tmp_path, CASE.replace('"LIFE-RAFT-DB-10"', value)).scenarios[0].object

    own = drifter(
        '{ downwind = { slope = "3 %", offset = "1 cm/s", std = "5 cm/s" }, right = { slope = 0.02 }, left = { slope = -0.01 } }'
    )
    assert (own.down.slope, own.down.offset, own.down.std) == pytest.approx((0.03, 0.01, 0.05))
    assert (own.right.slope, own.left.slope) == (0.02, -0.01)
    sail = drifter('{ windage = "3 %", spread = "0.5 %" }')
    assert (sail.down.slope, sail.down.slope_std, sail.down.offset_std) == pytest.approx(
        (0.03, 0.005, 0)
    )
    assert not sail.jibes
    assert not drifter('"water"').uses_wind


def test_weights_are_normalised_and_sources_chosen(tmp_path: Path) -> None:
    text = CASE.replace(
        "[[wind]]",
        '[[current]]\nname = "rival"\nconstant = { east = 0.1, north = -0.3 }\n\n[[wind]]',
    )
    text += '[[scenario]]\nname = "other"\nweight = 3\nobject = "water"\ncurrents = ["rival"]\n'
    text += "[scenario.position]\nat = [-88, 27]\nerror = 100\n"
    one, other = load(tmp_path, text).scenarios
    assert (one.weight, other.weight) == (0.25, 0.75)
    assert (one.sources["current"], other.sources["current"]) == (("set", "rival"), ("rival",))
    assert other.jibe_rate == 0


def test_table_by_time(tmp_path: Path) -> None:
    rows = '[{ time = "+0 h", speed = "10 kn", from = 270 }, { time = "221830ZNOV26", speed = "20 kn", from = 0 }]'
    table = (
        load(
            tmp_path, CASE.replace('constant = { speed = "12 kn", from = 240 }', f"table = {rows}")
        )
        .forcing["wind"][0]
        .table
    )
    assert table is not None
    assert table.times[1] - table.times[0] == np.timedelta64(24, "h")
    assert table.east == pytest.approx((10 * 1852 / 3600, 0), abs=1e-12)
    assert table.north == pytest.approx((0, -20 * 1852 / 3600), abs=1e-12)


def test_files_relative_and_through_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "data"
    folder.mkdir()
    for name in ("b.nc", "a.nc", "c.txt"):
        (folder / name).touch()
    current = '[[current]]\nfiles = {}\nsteady = true\nvariables = {{ east = "u", north = "v" }}\n[[wind]]'
    names = [str(folder / "a.nc"), str(folder / "b.nc")]
    for written in ('"data/*.nc"', '["${SOME_DATA}/a.nc", "data/b.nc"]'):
        monkeypatch.setenv("SOME_DATA", str(folder))
        found = load(tmp_path, CASE.replace("[[wind]]", current.format(written))).forcing[
            "current"
        ][1]
        assert (list(found.files), found.name, found.steady) == (names, "current 2", True)
        assert found.variables == {"east": "u", "north": "v"}
    far = load(
        tmp_path, CASE.replace("[[wind]]", current.format('"https://host/dap/x.nc"'))
    ).forcing["current"][1]
    assert far.files == ("https://host/dap/x.nc",)
    timed = current.format('"data/a.nc"').replace(
        "steady = true", 'times = { start = "+1 h", every = "6 h" }'
    )
    times = load(tmp_path, CASE.replace("[[wind]]", timed)).forcing["current"][1].times
    assert times == Slices(np.datetime64("2026-11-21T19:30:00"), np.timedelta64(21_600, "s"))
    for text, meant in (
        ('{ zone = "-06:00" }', Slices(zone="-06:00")),
        ('{ stamp = "start", zone = "UTC" }', Slices(zone="UTC", stamp="start")),
    ):
        own = current.format('"data/a.nc"').replace("steady = true", f"times = {text}")
        assert load(tmp_path, CASE.replace("[[wind]]", own)).forcing["current"][1].times == meant
    for text, words in (
        ('{ start = "+1 h" }', "start and every go together"),
        ('{ start = "+1 h", every = "1 h", zone = "UTC" }', "zone applies to the file's own times"),
        ("{ }", "give start and every, or zone, or stamp"),
        ('{ zone = "CST" }', 'zone "CST": allowed are "UTC" and hours ahead of UTC'),
        ('{ stamp = "noon" }', "stamp"),
    ):
        own = current.format('"data/a.nc"').replace("steady = true", f"times = {text}")
        with pytest.raises(UserError, match=words):
            load(tmp_path, CASE.replace("[[wind]]", own))


def test_domain_over_the_antimeridian(tmp_path: Path) -> None:
    text = CASE + '[domain]\nwest = "170 30E"\nsouth = -20\neast = "175W"\nnorth = "10 15.0S"\n'
    assert load(tmp_path, text).domain == Box(170.5, -20, 185, -10.25)


def test_uncertainty_and_clock(tmp_path: Path) -> None:
    text = (
        CASE + '[uncertainty]\nwind = { std = "1.5 m/s", time = "6 h" }\ndiffusivity = "10 m2/s"\n'
    )
    found = load(tmp_path, text, clock__step="10 min", clock__scheme="rk2")
    assert (found.wind_error.std, found.wind_error.time, found.current_error.std) == (
        1.5,
        21_600,
        0,
    )
    assert (found.diffusivity, found.step, found.scheme) == (10, 600, "rk2")


def test_overrides_are_toml_and_are_kept(tmp_path: Path) -> None:
    found = load(
        tmp_path,
        scenario__0__position__std='["2 nmi", "1 nmi"]',
        scenario__0__position__orientation="45",
    )
    assert isinstance(found.scenarios[0].prior, PositionPrior)
    assert found.scenarios[0].prior.minor == 1852
    assert "# --set scenario.0.position.orientation=45" in found.text


def test_a_folder_hides_no_shipped_case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "overdue_boat").mkdir()
    assert case_file.load("overdue_boat").title.startswith("Overdue boat")
    (tmp_path / "mine").mkdir()
    with pytest.raises(UserError, match='no case "mine": neither a file nor a shipped case'):
        case_file.load("mine")
    (tmp_path / "mine.toml").write_text("")
    with pytest.raises(UserError, match=r'no case "mine"; did you mean the file "mine\.toml"'):
        case_file.load("mine")


@pytest.mark.parametrize(
    ("typed", "meant"), [("overdue_baot", "overdue_boat"), ("fiel.toml", "file.toml")]
)
def test_a_name_typed_wrong_gets_the_nearest(
    typed: str, meant: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The name proposed is that of a case, of those shipped or of the files beside."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file.toml").write_text(case_file.load("overdue_boat").text)
    with pytest.raises(UserError, match=f'no case "{typed}"; did you mean "{meant}"'):
        case_file.load(typed)
    assert case_file.load(meant).title.startswith("Overdue boat")


def test_shipped_cases_are_valid(monkeypatch: pytest.MonkeyPatch) -> None:
    data = DATA
    names = [name for name, title in case_file.shipped() if title]
    with_data = {
        "norkyst_raft",
        "washington_piw",
        "biscay_drifter",
        "paria_boat",
        "paria",
        "washington_drums",
    }
    assert with_data | {"overdue_boat", "gulf_containers"} <= set(names)
    for name in names if data.is_dir() else ["overdue_boat"]:
        monkeypatch.setenv("DRIFT_DATA", str(data))
        found = case_file.load(name)
        assert math.isclose(math.fsum(s.weight for s in found.scenarios), 1)
        assert any(value is not None for value in found.expect.model_dump().values())


def test_records_are_frozen(tmp_path: Path) -> None:
    found: Any = load(tmp_path)
    with pytest.raises(AttributeError):
        found.seed = 2


def test_the_example_of_the_documentation_is_a_case(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "spill.md").read_text(encoding="utf-8")
    example = text.split("```toml\n")[1].split("```")[0]
    head = 'start = "1973-11-01T12:00Z"\nduration = "10 d"\n[[current]]\nanalytic = "gulf"\n[[wind]]\nanalytic = "breeze"\n'
    (tmp_path / "case.toml").write_text(head + example)
    spill = case_file.load(tmp_path / "case.toml").spill
    assert spill is not None
    assert [kind.name for kind in spill.kinds] == ["drum", "box"]
    assert spill.finds[0].by == "patrol 1"
