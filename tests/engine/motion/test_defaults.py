"""Errors where a case is silent: for which sources they hold, what the word "none" and half a table
do, and where a run prints them.
"""

import itertools
import json
import re
from pathlib import Path

import numpy as np
import pytest
import writers
import xarray as xr
from silent_case import HEAD, RAFT, load

import drift
from drift.apps.check import check
from drift.apps.cli.commands import main
from drift.case.forcing import uncertainty
from drift.engine.motion.errors.forcing_error import ForcingError
from drift.pipeline import run_metadata
from drift.products.files import drawing
from drift.products.maps import page
from geo.errors import UserError

PAINTS = False
SEARCH = 'particles = 500\ncoast.source = "none"\n'
SPILL = """
[spill]
objects = 20
worlds = 100
position = { at = "59 00N 004 00E", std = "1 nmi" }
class = [{ name = "box", share = 1, object = { windage = "3 %" } }]
"""
# A current and a wind of every kind, and whether it comes from gridded files: data sets and
# addresses are such, too.
KINDS = {
    "file": ('files = "sea.nc"', True),
    "dataset": ('dataset = "sea"', True),
    "address": ('files = "http://127.0.0.1:9/sea.nc"', True),
    "constant": ("constant = { east = 0.3, north = -0.2 }", False),
    "table": (
        'table = [{ time = "+0 h", east = 0.3, north = 1 }, { time = "+3 h", east = 0.1, north = 2 }]',
        False,
    ),
    "built in": ('analytic = "{flow}"', False),
}
# Component residuals of two regional ocean models against 248 drifters, pooled: least and most of
# the two.
TOTAL, FOLDING, KEPT = (0.30, 0.34), (10.0, 14.0), {24.0: (0.07, 0.19), 48.0: (0.07, 0.19)}


def sources(
    folder: Path, current: str = "file", wind: str = "constant", head: str = HEAD + SEARCH
) -> str:
    if not (folder / "sea.nc").exists():
        writers.regular(folder / "sea.nc")
    texts = (
        KINDS[current][0].replace("{flow}", "gulf"),
        KINDS[wind][0].replace("{flow}", "breeze"),
    )
    return head + "".join(
        f"[[{name}]]\n{text}\n" for name, text in zip(("current", "wind"), texts, strict=True)
    )


def three(error: ForcingError) -> tuple[float, float, float]:
    return error.std, error.time / 3600, error.bias


@pytest.mark.parametrize("subject", [RAFT, SPILL])
def test_a_default_holds_for_what_is_read_from_gridded_files_and_for_nothing_else(
    tmp_path, subject
) -> None:
    for current, wind in itertools.product(KINDS, KINDS):
        text = (
            sources(tmp_path, current, wind, HEAD if subject is SPILL else HEAD + SEARCH) + subject
        )
        found = load(tmp_path, text)
        assert three(found.current_error) == (
            (0.31, 11.0, 0.08) if KINDS[current][1] else (0.0, 11.0, 0.0)
        )
        assert three(found.wind_error) == ((2.0, 12.0, 0.0) if KINDS[wind][1] else (0.0, 12.0, 0.0))
        assert found.diffusivity == 0
        if found.spill:
            assert found.spill.current_bias == found.current_error.bias


def test_a_backward_run_has_the_same_defaults_and_one_without_wind_none_of_it(tmp_path) -> None:
    found = load(tmp_path, sources(tmp_path, wind="file") + RAFT, direction='"backward"')
    assert (three(found.current_error), three(found.wind_error)) == (
        (0.31, 11.0, 0.08),
        (2.0, 12.0, 0.0),
    )
    swimmer = load(tmp_path, sources(tmp_path, wind="file") + RAFT, scenario__0__object='"water"')
    assert (swimmer.current_error.std, swimmer.wind_error.std) == (0.31, 0.0)


def test_the_wind_of_debris_has_its_error_though_the_object_feels_none(tmp_path) -> None:
    text = sources(tmp_path, wind="file") + RAFT
    for debris, std in (("PIW-1", 2.0), ("water", 0.0)):
        seen = f'[[contact]]\nname = "seen"\ntime = "+2 h"\nposition = {{ at = [4.2, 59.1], std = "3 nmi" }}\nof = "{debris}"\n'
        found = load(tmp_path, text + seen, scenario__0__object='"water"')
        assert found.wind_error.std == std


def test_the_default_of_the_current_is_what_was_measured() -> None:
    """The law (1 - b) exp(-t / T) + b, held against the ranges that the residuals gave."""
    std, time, bias = three(uncertainty.CURRENT)
    variance = std**2 + bias**2

    def kept(hours: float) -> float:
        return (std**2 * np.exp(-hours / time) + bias**2) / variance

    assert TOTAL[0] <= np.sqrt(variance) <= TOTAL[1]
    assert kept(FOLDING[0]) >= np.exp(-1) >= kept(FOLDING[1])
    for hours, (least, most) in KEPT.items():
        assert least <= kept(hours) <= most


NONE = (0.0, 0.0)


@pytest.mark.parametrize(
    ("key", "value", "current", "wind"),
    [
        ("uncertainty", '"none"', NONE, 0.0),
        ("uncertainty.current", '"none"', NONE, 2.0),
        ("uncertainty.wind", '"none"', (0.31, 0.08), 0.0),
        ("uncertainty", "{}", (0.31, 0.08), 2.0),
        ("uncertainty.diffusivity", '"3 m2/s"', (0.31, 0.08), 2.0),
        ("uncertainty.current.std", '"0.2 m/s"', (0.2, 0.0), 2.0),  # it says how large the error is
        ("uncertainty.current.bias", '"0.15 m/s"', (0.31, 0.15), 2.0),
        ("uncertainty.current", '{ std = "0.2 m/s", bias = "0.05 m/s" }', (0.2, 0.05), 2.0),
        ("uncertainty.current", '{ std = 0, bias = "0.05 m/s" }', (0.0, 0.05), 2.0),
        ("uncertainty.current.time", '"20 h"', (0.31, 0.08), 2.0),
        ("uncertainty.wind.std", '"3.5 m/s"', (0.31, 0.08), 3.5),
    ],
)
def test_what_a_case_says_holds_and_the_rest_by_default(
    tmp_path, key, value, current, wind
) -> None:
    text = sources(tmp_path, wind="file") + RAFT
    (tmp_path / "trial.toml").write_text(text)
    found = drift.load(tmp_path / "trial.toml", {key: value})
    assert (found.current_error.std, found.current_error.bias, found.wind_error.std) == (
        *current,
        wind,
    )
    hours = 20 if key.endswith("time") else 11
    assert (found.current_error.time, found.wind_error.time) == (hours * 3600, 12 * 3600)
    assert found.diffusivity == (3 if "diffusivity" in key else 0)


def test_a_stated_error_holds_whatever_the_source(tmp_path) -> None:
    stated = '[uncertainty]\ncurrent = { std = "0.2 m/s", time = "7 h", bias = "0.1 m/s" }\nwind = { std = "1.5 m/s" }\n'
    for kind in KINDS:
        found = load(tmp_path, sources(tmp_path, kind, kind) + stated + RAFT)
        assert (three(found.current_error), three(found.wind_error)) == (
            (0.2, 7.0, 0.1),
            (1.5, 12.0, 0.0),
        )


def test_rivals_have_no_default(tmp_path) -> None:
    """Sources between which scenarios differ spread by themselves; sources by priority in all of
    them do not.
    """
    more = '[[current]]\nname = "{}"\nfiles = "sea.nc"\n'
    text = sources(tmp_path, "constant") + more.format("a") + more.format("b")
    second = RAFT.replace("raft", "second")

    def std(first: str, other: str) -> float:
        return load(tmp_path, text + RAFT + first + second + other).current_error.std

    assert std('currents = ["a"]\n', 'currents = ["b"]\n') == 0
    assert std('currents = ["a", "b"]\n', 'currents = ["b", "a"]\n') == 0
    assert std('currents = ["a", "b"]\n', 'currents = ["a", "b"]\n') == 0.31
    assert std('currents = ["a"]\n', 'currents = ["current 1"]\n') == 0.31
    assert std('currents = ["current 1"]\n', 'currents = ["current 1"]\n') == 0
    stated = load(
        tmp_path,
        text + RAFT + 'currents = ["a"]\n' + second + 'currents = ["b"]\n',
        uncertainty__current='{ std = "0.2 m/s" }',
    )
    assert stated.current_error.std == 0.2


def test_the_bias_of_a_spill_is_given_once(tmp_path) -> None:
    text = sources(tmp_path, head=HEAD) + SPILL
    found = load(tmp_path, text, spill__current_bias='"0.12 m/s"')
    assert three(found.current_error) == (0.31, 11.0, 0.12)
    assert found.spill is not None
    assert found.spill.current_bias == 0.12
    found = load(tmp_path, text, uncertainty__current__bias='"0.05 m/s"')
    assert found.spill is not None
    assert found.spill.current_bias == 0.05
    for other in (
        {"uncertainty__current__bias": "0.05"},
        {"uncertainty": '"none"'},
        {"uncertainty__current": "none"},
    ):
        with pytest.raises(
            UserError, match=r"^trial.toml: spill.current_bias: [^\n]*give it once$"
        ):
            load(tmp_path, text, spill__current_bias='"0.12 m/s"', **other)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        (
            "uncertainty",
            '"off"',
            r"uncertainty: must be a table, like { current = { std = \"0.2 m/s\" } }, or \"none\", not 'off'",
        ),
        (
            "uncertainty.current",
            '"off"',
            r"uncertainty\.current: must be a table, like { std = \"0.2 m/s\" }, or \"none\", not 'off'",
        ),
        ("uncertainty.wind", "3", r"uncertainty\.wind: must be a table, not 3"),
        (
            "uncertainty.wind.time",
            '"6 h"',
            r"uncertainty\.wind: has no std, and there is no default \(not from model",
        ),
        ("uncertainty.wind.bias", '"1 m/s"', r"uncertainty\.wind: unknown key \"bias\""),
        ("uncertainty.diffusivity", '"none"', r"uncertainty\.diffusivity: "),
        ("uncertainty.current.bias", '"2.6 m/s"', r"uncertainty\.current\.bias: .*at most 2\.5"),
    ],
)
def test_what_is_no_error_is_refused_in_a_line(tmp_path, key, value, message) -> None:
    (tmp_path / "trial.toml").write_text(sources(tmp_path) + RAFT)
    with pytest.raises(UserError, match=message) as refusal:
        drift.load(tmp_path / "trial.toml", {key: value})
    # An error of which nothing that is known is given has no std besides.
    assert len(refusal.value.lines) == 1 + ("bias" in key and "wind" in key)


STATED = {"uncertainty.wind": '{ std = "2 m/s" }'}
SMALL = {"uncertainty.current": '{ std = "0 m/s", bias = "0.1 m/s" }'}


@pytest.mark.parametrize(
    ("object", "changes", "banner"),
    [
        ("water", {}, ""),
        ("water", {"uncertainty": "none"}, "NO ERROR of current in this forecast"),
        ("raft", {"uncertainty": "none"}, "NO ERROR of current and wind in this forecast"),
        ("raft", {"uncertainty.wind": "none"}, "NO ERROR of wind in this forecast"),
        ("raft", {"uncertainty.current": "none"}, "NO ERROR of current and wind in this forecast"),
        ("raft", STATED | {"uncertainty.current": "none"}, "NO ERROR of current in this forecast"),
        ("raft", STATED | SMALL, ""),
        ("raft", STATED, ""),
        ("raft", {}, "NO ERROR of wind in this forecast"),  # which is typed
    ],
)
def test_winds_and_currents_without_an_error_stand_on_a_banner(
    tmp_path, object, changes, banner
) -> None:
    text = sources(tmp_path) + (
        RAFT if object == "raft" else RAFT.replace('{ windage = "3 %" }', '"water"')
    )
    (tmp_path / "trial.toml").write_text(text)
    assert run_metadata.caution_banner(drift.load(tmp_path / "trial.toml", changes)) == banner


def test_the_errors_that_a_warning_names_end_it(tmp_path) -> None:
    """It stands in the results and in what check prints, and "none" accepts that there is none."""
    typed = sources(tmp_path, current="constant") + RAFT
    warning = drift.run(load(tmp_path, typed)).summary["warnings"][0]
    assert warning.startswith("this forecast takes its current and wind as exact")
    assert check.check(load(tmp_path, typed))["errors, note 1"] == warning
    stated = re.search(r"as (current = .*}) and (wind = .*});", warning).groups()
    mended = load(tmp_path, f"{typed}\n[uncertainty]\n" + "\n".join(stated))
    assert (mended.current_error.std, mended.wind_error.std) == (0.3, 2.0)
    assert not run_metadata.caution_banner(mended)
    for accepted in (mended, load(tmp_path, typed, uncertainty="none")):
        assert not run_metadata.case_warnings(accepted)


@pytest.mark.parametrize(
    ("old", "new", "exact"),
    [
        # a diffusivity and members stand for the error of the current
        (RAFT, f'{RAFT}[uncertainty]\ndiffusivity = "3 m2/s"\n', "wind"),
        (
            KINDS["constant"][0],
            f"members = [{{ {KINDS['constant'][0]} }}, {{ constant = {{ east = 0, north = 1 }} }}]",
            "wind",
        ),
        ('{ windage = "3 %" }', '"water"', "current"),  # which feels no wind
    ],
)
def test_only_what_is_felt_and_has_no_other_spread_is_warned_of(tmp_path, old, new, exact) -> None:
    text = sources(tmp_path, current="constant") + RAFT
    (warning,) = run_metadata.case_warnings(load(tmp_path, text.replace(old, new, 1)))
    assert warning.startswith(f"this forecast takes its {exact} as exact,")


@pytest.mark.thorough
def test_check_run_files_and_every_picture_say_which_errors_were_used(
    tmp_path, capsys, monkeypatch
) -> None:
    feet: dict[str, list[str]] = {}
    saved = page.save

    def watched(canvas, path, *rest, **more) -> None:
        feet[path.name] = [text.get_text() for text in canvas.figure.texts]
        saved(canvas, path, *rest, **more)

    monkeypatch.setattr(page, "save", watched)
    monkeypatch.setattr(drawing, "MOST", 1)  # what a copy of the process draws is not seen here
    sortie = '[[sortie]]\nname = "s"\nstart = "+1 h"\nend = "+2 h"\nlaw = "random"\npod = 0.1\n'
    sortie += "area = { polygon = [[3.9, 58.9], [4.1, 58.9], [4.1, 59.1], [3.9, 59.1]] }\n"
    text = sources(tmp_path) + RAFT + sortie
    told = {
        "": "current 0.31 m/s over 11 h and 0.08 m/s that lasts (default); no error of the wind (not from model files; state one in [uncertainty])",
        "none": "no error of the current (case); no error of the wind (case)",
        '{ current = { std = "0.2 m/s" }, diffusivity = 4 }': "current 0.2 m/s over 11 h (case, time by default); no error of the "
        "wind (not from model files; state one in [uncertainty]); diffusivity 4 m2/s (case)",
    }
    (tmp_path / "trial.toml").write_text(text)
    for written, words in told.items():
        more = ["--set", f"uncertainty={written}"] if written else []
        assert main(["check", str(tmp_path / "trial.toml"), *more]) == 0
        assert words in capsys.readouterr().out
    words, out = told["none"], tmp_path / "out"
    assert (
        main(["run", str(tmp_path / "trial.toml"), "--out", str(out), "--set", "uncertainty=none"])
        == 0
    )
    assert words in capsys.readouterr().out
    assert {"map.png", "snapshots.png", "search.png", "evidence.png"} <= feet.keys()
    for texts in feet.values():
        assert any(line.startswith(f"Errors: {words[:40]}") for line in texts), texts
        assert "NO ERROR of current and wind in this forecast" in texts  # on a banner
    with xr.open_dataset(out / "forecast.nc") as data:
        assert data.attrs["uncertainty"] == words
    summary = json.loads((out / "summary.json").read_text())["uncertainty"]
    nothing = {"std_m_s": 0.0, "time_s": 39_600.0, "bias_m_s": 0.0}
    assert summary["current"] == {
        **nothing,
        "by": {"std": "case", "time": "default", "bias": "case"},
    }
    assert (summary["told"], summary["diffusivity"]) == (words, {"m2_s": 0.0, "by": "case"})
    by_default = drift.run(drift.load(tmp_path / "trial.toml", {"sortie": "[]"})).summary[
        "uncertainty"
    ]
    assert by_default["current"] == {
        "std_m_s": 0.31, "time_s": 39_600.0, "bias_m_s": 0.08, "by": dict.fromkeys(("std", "time", "bias"), "default"),
    }  # fmt: skip
    assert by_default["wind"]["by"]["std"] == "not from model files"
