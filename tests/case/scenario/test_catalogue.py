"""An agency's own catalogue of leeway classes: its figures, its errors, and where its names count."""

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import trial_case

import drift
from drift.apps.cli import commands
from drift.case.scenario import catalogue
from drift.engine.motion.objects import leeway
from drift.pipeline import run_metadata, run_setup
from geo.errors import UserError

RIB = {
    "name": "PATROL-RIB",
    "text": "Rigid inflatable boat of 7 m, engine up",
    "downwind": {"slope": "3.1 %", "offset": "2 cm/s", "std": "4.2 cm/s"},
    "right": {"slope": "1.2 %", "offset": "-1.5 cm/s", "std": "3 cm/s"},
    "left": {"slope": "-0.9 %", "offset": "-1 cm/s", "std": "3.3 cm/s"},
    "measured": "indirect",
    "source": "Trials off Bodo, 2019",
}
BOAT = {**RIB, "name": "Seine boat", "measured": "direct", "warning": "three runs only"}
WIND = {"wind": {"constant": {"speed": "12 kn", "from": 210}}}
LEEWAY = {"catalogue": "our classes.toml"}


def write(folder: Path, *classes: dict[str, Any], more: str = "") -> Path:
    path = folder / "our classes.toml"
    tables = ["\n".join(["[[class]]", *trial_case._rows(own)]) for own in classes]
    path.write_text("\n".join([*tables, more, ""]), encoding="utf-8")
    return path


def load(folder: Path, name: Any, **tables: Any) -> drift.Case:
    return trial_case.load(
        folder, **{**WIND, "leeway": LEEWAY, "scenario": {"object": name}} | tables
    )


def refused(folder: Path, *classes: dict[str, Any], more: str = "") -> list[str]:
    """Return the lines with which a case of a catalogue is refused, without the case's name."""
    write(folder, *classes, more=more)
    with pytest.raises(UserError) as error:
        load(folder, "water")
    return [line.removeprefix("case.toml: ") for line in error.value.lines]


def test_figures_are_those_of_the_file_in_si(tmp_path: Path) -> None:
    write(tmp_path, RIB, BOAT)
    rib = load(tmp_path, "patrol-rib").scenarios[0].object
    lines = [(line.slope, line.offset, line.std) for line in (rib.down, rib.right, rib.left)]
    want = [(0.031, 0.02, 0.042), (0.012, -0.015, 0.03), (-0.009, -0.01, 0.033)]
    assert lines == [pytest.approx(line) for line in want]
    assert (rib.name, rib.description) == (RIB["name"], RIB["text"])
    assert (rib.measured, rib.stokes, rib.source, rib.warning) == (
        *("indirect", "inside", RIB["source"]),
        "",
    )
    boat = load(tmp_path, "SEINE BOAT").scenarios[0].object
    assert (boat.name, boat.measured, boat.stokes) == ("Seine boat", "direct", "added")
    assert boat.jibes
    # shipped classes are there as well
    assert load(tmp_path, "PIW-1").scenarios[0].object == leeway.find_class("PIW-1")


def test_a_class_without_crosswind_lines_drifts_downwind(tmp_path: Path) -> None:
    write(tmp_path, {key: one for key, one in RIB.items() if key not in ("right", "left")})
    rib = load(tmp_path, "PATROL-RIB").scenarios[0].object
    assert rib.right == rib.left == leeway.Line()
    assert not rib.jibes


def test_a_spill_a_family_and_debris_name_its_classes(tmp_path: Path) -> None:
    write(tmp_path, RIB, BOAT)
    fix = {"time": "+3 h", "position": {"at": "27 30N 088 00W", "error": "5 nmi"}}
    case = load(tmp_path, "PATROL-RIB", contact=[{**fix, "of": "Seine boat"}])
    assert case.contacts[0].drifter is not None
    assert case.contacts[0].drifter.name == "Seine boat"
    (tmp_path / "bearings.csv").write_text(
        "time,lon,lat,bearing\n2026-11-21T02:00Z,088 18W,27 24N,70\n2026-11-21T03:00Z,088 18W,27 30N,80\n"
    )
    series = {"file": "bearings.csv", "std": "5 deg", "far": "60 nmi"}
    case = load(tmp_path, "water", contact=[{"bearings": series, "of": "PATROL-RIB"}])
    assert {one.drifter.name for one in case.contacts if one.drifter} == {"PATROL-RIB"}
    family = {
        "name": "boats",
        "axis": {"kind": {"key": "object", "values": ["PATROL-RIB", "Seine boat"]}},
        "scenario": {"position": {"at": "27 30N 088 00W", "std": "1 nmi"}},
    }
    text = trial_case.text(**{**WIND, "leeway": LEEWAY, "scenario": None, "family": [family]})
    (tmp_path / "case.toml").write_text(text)
    objects = [one.object.name for one in drift.load(tmp_path / "case.toml").scenarios]
    assert objects == ["PATROL-RIB", "Seine boat"]
    kind = {"name": "boats", "object": "PATROL-RIB"}
    spill = {
        "position": {"at": "27 30N 088 00W", "std": "1 nmi"},
        "objects": 40,
        "worlds": 50,
        "per_world": 10,
        "class": [kind],
    }
    parts = {"scenario": None, "particles": None, "coast": {"source": "gshhg"}, "spill": spill}
    text = trial_case.text(**{**WIND, "leeway": LEEWAY, **parts})
    (tmp_path / "case.toml").write_text(text)
    assert [one.object.name for one in drift.load(tmp_path / "case.toml").scenarios] == [
        "PATROL-RIB"
    ]


def test_an_unknown_class_is_refused_with_the_nearest_of_the_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path, RIB)
    with pytest.raises(UserError) as error:
        load(tmp_path, "PATROL-RIP")
    (line,) = error.value.lines
    assert 'scenario "raft".object: no leeway class "PATROL-RIP"; nearest is "PATROL-RIB"' in line
    # the command that the message names lists the class, from any folder
    command = shlex.split(line.partition("See: ")[2])
    assert command[:3] == ["drift", "objects", "--catalogue"]
    assert Path(command[3]) == path
    assert commands.main(command[1:]) == 0
    printed = capsys.readouterr().out
    assert "PATROL-RIB" in printed
    assert "LIFE-RAFT-DB-10" in printed
    assert "PATROL-RIB: Trials off Bodo, 2019; measured: indirect" in " ".join(printed.split())


def test_objects_are_searched_in_the_file_and_given_to_programs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path, RIB, BOAT)
    assert commands.main(["objects", "seine", "--catalogue", str(path)]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "Seine boat: Trials off Bodo, 2019; measured: direct. three runs only" in printed
    assert "Stokes drift of a case is added to the lines of Seine boat" in printed
    assert commands.main(["objects", "spaceship", "--catalogue", str(path)]) == 2
    assert "list all: drift objects --catalogue" in capsys.readouterr().err
    assert commands.main(["objects", "--catalogue", str(tmp_path / "none.toml")]) == 2
    assert 'catalogue "none.toml": cannot be read: No such file' in capsys.readouterr().err


def test_a_changed_catalogue_is_another_input_and_another_case(tmp_path: Path) -> None:
    path = write(tmp_path, RIB)
    case = load(tmp_path, "PATROL-RIB")
    assert case.inputs == (str(path),)
    where = run_setup.open_for(case)
    before = {
        **run_metadata.file_attributes(case, where),
        "coast": {"source": "none"},
        "forcing": [
            {"quantity": s.quantity, "name": s.name, "fingerprint": s.fingerprint}
            for s in where.sources
        ],
        "inputs": [run_metadata.input_file(str(path))],
        "run": {"case_digest": run_metadata.case_digest.digest(case)},
    }
    assert run_metadata.changed_inputs(case, where, before) == []
    write(tmp_path, {**RIB, "downwind": {"slope": "3.2 %", "std": "4.2 cm/s"}})
    changed = run_metadata.changed_inputs(drift.load(case.path), where, before)
    assert changed == ["the case", "the files"]


def test_a_warning_of_a_class_is_reported(tmp_path: Path) -> None:
    write(tmp_path, RIB, BOAT)
    told = drift.check(load(tmp_path, "Seine boat"))
    assert told["leeway, note 1"] == "object Seine boat: three runs only"
    assert "(Trials off Bodo, 2019; measured: direct)" in told['scenario "raft"']
    assert not any(name.startswith("leeway") for name in drift.check(load(tmp_path, "PATROL-RIB")))


def without(*keys: str) -> dict[str, Any]:
    return {key: value for key, value in RIB.items() if key not in keys}


@pytest.mark.parametrize(
    ("own", "words"),
    [
        (without("downwind", "right", "left"), 'class "PATROL-RIB".downwind: is missing'),
        (without("left"), 'class "PATROL-RIB": give both right and left, or neither'),
        (without("source"), 'class "PATROL-RIB".source: is missing'),
        (without("measured"), 'class "PATROL-RIB".measured: is missing'),
        ({**RIB, "measured": "guessed"}, "'guessed' is not allowed; write 'direct', 'indirect'"),
        ({**RIB, "stokes": "half"}, "'half' is not allowed; write 'inside' or 'added'"),
        ({**RIB, "downwind": {"slope": "3 %"}}, 'class "PATROL-RIB".downwind.std: is missing'),
        (
            {**RIB, "downwind": {"slope": "3 %", "std": "-2 cm/s"}},
            r"class \"PATROL-RIB\".downwind.std: .*-2 cm/s.* at least 0",
        ),
        (
            {**RIB, "downwind": {"slope": "0.031 %", "std": "4 cm/s"}},
            r"slope 0.031 % is below 0.2 %, .*: was \"3.1 %\" meant; if it is right, add plausible = true",
        ),
        (
            {**RIB, "downwind": {"slope": 3.1, "std": "4 cm/s"}},
            r"class \"PATROL-RIB\".downwind.slope: .*3.1.* at most 0.5",
        ),
        (
            {**RIB, "downwind": {"slope": "31 %", "std": "4 cm/s"}},
            "downwind slope 31 % is more than 15 % of the wind; if it is right, add plausible = true",
        ),
        (
            {**RIB, "downwind": {"slope": "-3 %", "std": "4 cm/s"}},
            "downwind slope -3 % must be 0 to 50 %: no object drifts upwind",
        ),
        (
            {**RIB, "right": {"slope": "1 %", "offset": -2, "std": 6.1}},
            'right offset -200 cm/s is more than 50 cm/s: a bare number is in m/s; was "-2 cm/s" meant',
        ),
        (
            {**RIB, "right": {"slope": "1 %", "std": 6.1}},
            'right std 610 cm/s is more than 50 cm/s: a bare number is in m/s; was "6.1 cm/s" meant',
        ),
        (
            {**RIB, "left": {"slope": "0.9 %", "offset": "-1 cm/s", "std": "3 cm/s"}},
            "left line leads to the other side, by 8 cm/s in a wind of 10 m/s: leeway to the right "
            "is positive, to the left negative; if it is right, add plausible = true",
        ),
        ({**RIB, "name": "piw-1"}, 'class "piw-1": a shipped class has this name'),
        ({**RIB, "name": "Water"}, 'class "Water": a shipped class has this name'),
        ({**RIB, "lines": 3}, 'class "PATROL-RIB": unknown key "lines"'),
    ],
)
def test_mistakes_of_a_class(tmp_path: Path, own: dict[str, Any], words: str) -> None:
    pattern = words if "\\" in words else re.escape(words)
    lines = refused(tmp_path, own)
    assert all(line.startswith('catalogue "our classes.toml": ') for line in lines)
    assert [line for line in lines if re.search(pattern, line)], lines


def test_what_is_implausible_is_accepted_as_it_stands(tmp_path: Path) -> None:
    odd = {"slope": "31 %", "std": "60 cm/s"}
    write(tmp_path, {**RIB, "downwind": odd, "plausible": True})
    assert load(tmp_path, "PATROL-RIB").scenarios[0].object.down.slope == 0.31


def test_a_remedy_for_a_slope_written_as_a_share_works(tmp_path: Path) -> None:
    (line,) = refused(tmp_path, {**RIB, "downwind": {"slope": "0.031 %", "std": "4 cm/s"}})
    meant = re.search(r'was "([^"]*)" meant', line)
    assert meant is not None
    write(tmp_path, {**RIB, "downwind": {"slope": meant[1], "std": "4 cm/s"}})
    assert load(tmp_path, "PATROL-RIB").scenarios[0].object.down.slope == pytest.approx(0.031)


def test_mistakes_of_the_file(tmp_path: Path) -> None:
    place = 'catalogue "our classes.toml": '
    assert refused(tmp_path, RIB, {**BOAT, "name": "patrol-rib"}) == [
        f'{place}class "patrol-rib": two classes have this name; give each its own'
    ]
    assert refused(tmp_path, more="class = []")[0].startswith(f"{place}class: ")
    assert refused(tmp_path, more="[[class")[0].startswith(f"{place}not valid TOML")
    assert refused(tmp_path, more="[class]\nname = 'x'")[0].startswith(f"{place}class: must be a")
    (tmp_path / "our classes.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(UserError, match="is not text in UTF-8"):
        load(tmp_path, "water")


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(UserError) as error:
        load(tmp_path, "PATROL-RIB", start="2026-11-21")
    lines = error.value.lines
    assert any('leeway.catalogue: no file "our classes.toml"; looked for' in one for one in lines)
    # the case's other mistakes are told at once, but not names that the file may have
    assert len(lines) == 2
    assert any("start" in one for one in lines)


def test_a_key_of_the_table_that_is_wrong(tmp_path: Path) -> None:
    write(tmp_path, RIB)
    for key, value, words in (
        ("stokes", "none", "leeway.stokes: 'none' is not allowed; write 'inside' or 'added'"),
        ("catalogue", 3, "leeway.catalogue: must be a valid string; given 3"),
        ("catalog", "x", 'leeway: unknown key "catalog"; did you mean "catalogue"?'),
    ):
        with pytest.raises(UserError) as error:
            load(tmp_path, "water", leeway={key: value})
        (line,) = error.value.lines
        assert words in line


def test_a_catalogue_outside_the_served_folder_is_not_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path, RIB)
    (tmp_path / "served").mkdir()
    monkeypatch.setenv(
        "DRIFT_FENCE", f'{{"folders": ["{tmp_path / "served"}"], "hosts": [], "writable": []}}'
    )
    with pytest.raises(UserError, match="outside the folders that may be read here"):
        catalogue.read_catalogue(path)
