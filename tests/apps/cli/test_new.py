"""Cases to begin with: each is accepted as it is written, runs, and replaces no file."""

import re
from pathlib import Path

import pytest

import drift
from drift.apps.cli import commands as cli
from drift.case import template
from drift.case.tracking import tracking

PAINTS = False
SMALL = {"spill": ["--set", "spill.worlds=100", "--set", "duration=1 d"]}


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("story", "runs"),
    [
        *(
            pytest.param(
                story, False, marks=[pytest.mark.thorough] * (story in ("passage", "spill"))
            )
            for story in template.TEMPLATES
            if story != "search"
        ),
        *(
            pytest.param(story, True, marks=[pytest.mark.thorough] * (story != "search"))
            for story in template.TEMPLATES
        ),
    ],
)
def test_a_template_is_accepted_as_it_is_and_runs(
    story: str,
    runs: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["new", story]) == 0
    assert capsys.readouterr().out.endswith(f"Next: drift check {story}.toml\n")
    assert cli.main(["check", f"{story}.toml"]) == 0
    assert "ready to run" in capsys.readouterr().out
    if not runs:
        return
    assert (
        cli.main(["run", f"{story}.toml", "--quiet", *SMALL.get(story, ["--set", "particles=500"])])
        == 0
    )
    assert drift.results(f"{story}-forecast")


@pytest.mark.thorough
def test_a_template_of_a_contact_is_tracked_and_its_path_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As it is, and with all that is commented out of whole tables."""
    monkeypatch.chdir(tmp_path)
    (story,) = template.TRACKED
    assert cli.main(["new", story]) == 0
    assert capsys.readouterr().out.endswith(f"Next: drift check {story}.toml\n")
    given = Path(f"{story}.toml")
    assert cli.main(["check", str(given)]) == 0
    assert "ready to run" in capsys.readouterr().out
    assert cli.main(["track", str(given), "--set", "particles=300"]) == 0
    assert "lost" not in capsys.readouterr().out.replace(tracking.load(given).title, "")
    assert sorted(path.name for path in Path("contact-track").iterdir()) == [
        "manifest.json", "summary.json", "track.csv", "track.gpx", "track.png", "track_areas.geojson",
    ]  # fmt: skip
    whole = re.sub(
        r"^# (?=\[|name = |reach = |range_|bearing_|sweep = |begin = |speed = |step = )",
        "",
        given.read_text(),
        flags=re.MULTILINE,
    )
    assert whole.count("# [") == 0
    given.write_text(whole)
    assert cli.main(["track", str(given), "--set", "particles=300", "--out", "two"]) == 0
    assert "path             by 2" in capsys.readouterr().out
    assert Path("two/path.gpx").exists()


@pytest.mark.parametrize("story", template.TEMPLATES)
def test_tables_that_are_commented_out_are_accepted_too(story: str, tmp_path: Path) -> None:
    """Those of whole tables, from a "# [[" on: what a planner uncomments must not be the first
    mistake.
    """
    words, inside = [], False
    for line in template.template_text(story).splitlines():
        inside = line.startswith("# [[") or (inside and line.startswith("# "))
        words.append(
            line.removeprefix("# ") if inside and re.match(r"# (\[\[|\w+ = )", line) else line
        )
    path = tmp_path / "case.toml"
    path.write_text("\n".join(words))
    case = drift.load(path)
    assert case.title
    assert (
        path.read_text() == template.template_text(story).rstrip("\n")
        or case.contacts
        or case.spill
        or len(case.scenarios) > 1
    )


@pytest.mark.parametrize(
    ("words", "refusal"),
    [
        (("search",), "search.toml: exists already and is not replaced"),
        (("flight",), 'no template "flight"; there are: position ('),
        (("spill", "nowhere/spill.toml"), "cannot be written (No such file or directory)"),
        (("spill", "spill.txt"), "a case file ends in .toml"),
        (("spill", "a\0b.toml"), "cannot be written (embedded null byte)"),
        (("spill", "a" * 300 + ".toml"), "cannot be written (File name too long)"),
    ],
)
def test_refusals_are_a_line_and_write_nothing(
    words: tuple[str, ...], refusal: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    (tmp_path / "search.toml").write_text("mine")
    assert cli.main(["new", *words]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert refusal in err
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [
        ("search.toml", "mine")
    ]
