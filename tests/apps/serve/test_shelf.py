"""Files that drift serve lists, reads and saves, and spellings that reach no other."""

import errno
import os
import shutil
import threading
import urllib.parse
from pathlib import Path

import pytest
from desks import NASTY, Server, finished
from places import ROOT

import drift
from drift.apps.cli import commands
from drift.apps.serve import jobs, names, shelf

GOOD = {"text": "title = 1", "digest": None}
WAYS_OUT = (
    "../secret.toml", "..%2fsecret.toml", "..%2Fsecret.toml", "%2e%2e/secret.toml", "%2e%2e%2fsecret.toml", "..%5csecret.toml", "..\\secret.toml",
    "%252e%252e%252fsecret.toml", "....//secret.toml", "./../secret.toml", "%c0%ae%c0%ae%c0%afsecret.toml", "..%00/secret.toml", "case.toml%00.toml",
    "%00secret.toml", "%2fetc%2fpasswd", "//etc/passwd", "done%2f..%2f..%2fsecret.toml", "link.toml", ".hidden.toml", "%20.toml", "-x.toml",
    "nul.toml", "COM1.toml", "aux.x.toml", "C:secret.toml", "case.toml:stream", "case.toml.", "case.toml%20", "pipe.toml", "folder.toml", "x" * 101 + ".toml",
    "~root.toml", "%e2%80%ae.toml", "case.TOML%0a", "done", "%ff.toml", "*.toml", "case.txt",
)  # fmt: skip


@pytest.mark.parametrize("way", WAYS_OUT)
def test_no_spelling_reads_another_file(served: Server, way: str) -> None:
    status, _, data = served.ask("GET", f"/api/cases/{way}")
    assert status in (400, 404), data
    assert b'secret"' not in data


@pytest.mark.parametrize(
    "way", [way for way in WAYS_OUT if way not in ("link.toml", "pipe.toml", "folder.toml")]
)
def test_no_spelling_writes_another_file(served: Server, way: str) -> None:
    before = {path: path.stat().st_mtime_ns for path in served.folder.parent.rglob("*")}
    status, _, data = served.ask("POST", f"/api/cases/{way}", GOOD)
    assert status in (400, 404, 405), data
    assert {path: path.stat().st_mtime_ns for path in served.folder.parent.rglob("*")} == before


@pytest.mark.parametrize("name", ["link.toml", "pipe.toml", "folder.toml"])
def test_what_is_in_the_way_is_not_followed(served: Server, name: str) -> None:
    assert served.ask("POST", f"/api/cases/{name}", GOOD)[0] == 409
    assert served.ask("POST", f"/api/cases/{name}", {"text": "x", "digest": shelf.digest(b'title = "secret"')})[0] in (409, 500)  # fmt: skip
    assert (served.folder.parent / "secret.toml").read_text() == 'title = "secret"'


@pytest.mark.parametrize(
    ("run", "name", "status"),
    [
        ("done", "report.html", 200), ("done", "a.txt", 200), ("done", "manifest.json", 200), ("done", "extra.txt", 404), ("done", "..", 404),
        ("done", "%2e%2e%2fcase.toml", 404), ("linked", "report.html", 404), ("..", "secret.toml", 404), (".", "case.toml", 404),
        ("done%2f..%2f..", "secret.toml", 404), ("half", "report.html", 404), ("folder", "x", 404), ("", "case.toml", 404),
    ],
)  # fmt: skip
def test_of_a_run_only_what_its_manifest_names(
    served: Server, run: str, name: str, status: int
) -> None:
    key = served.secret.key(urllib.parse.unquote(run))
    assert served.ask("GET", f"/runs/{run}/{key}/{name}", Cookie=None)[0] in (
        {200} if status == 200 else {404, 401}
    )


def test_a_file_behind_a_linked_folder_is_not_opened(served: Server) -> None:
    with pytest.raises(OSError, match=r"Not a directory|symbolic links"):
        names.open_inside(served.folder, "linked", "report.html")
    os.close(names.open_inside(served.folder, "done", "report.html"))


def test_the_list_holds_whole_runs_and_cases_of_the_folder(served: Server) -> None:
    told = served.json("GET", "/api/folder")
    assert [run["name"] for run in told["runs"]] == ["done"]
    assert told["runs"][0]["title"] == NASTY
    titles = {case["name"]: case["title"] for case in told["cases"]}
    assert titles == {"case.toml": "trial", "nasty.toml": NASTY}
    assert len(told["shipped"]) >= 10
    assert [one["name"] for one in told["shipped"]][:4] == [
        "position",
        "passage",
        "spill",
        "search",
    ]


@pytest.mark.parametrize("name", ["a.toml", "Bergen båt 2.toml", "x_1-b (2)+.toml"])
def test_plain_names_are_taken(name: str) -> None:
    assert names.case(name)


@pytest.mark.parametrize(
    "name", ["a", "a" * 100, "a.b.c", "console.toml", "com", "com12", "lpt.x", "an con", "x-"]
)
def test_what_only_looks_like_no_name_is_one(name: str) -> None:
    assert names.plain(name)


@pytest.mark.parametrize(
    "name",
    [
        "", "a" * 101, ".", "..", ".a", "-a", " a", "+a", "a..b", "a/b", "a\\b", "a:b", "a*", "a?", 'a"', "a<b", "a|b", "a~1", "a%2e", "a\n",
        "a\n.toml", "a\0", "a\t", "a.", "a.toml.", "a.toml ", "a.toml. ", "a .", "con", "PRN", "Aux.toml", "nul.a.toml", "Com1", "com9.toml", "lpt0.x",
    ],
)  # fmt: skip
def test_names_that_some_system_takes_for_others_are_none(name: str) -> None:
    """Windows leaves out dots and spaces at the end, and has devices (Microsoft, Naming Files,
    Paths, and Namespaces).
    """
    assert not names.plain(name)
    assert not names.case(name)


def test_a_file_is_read_to_its_last_byte_or_not_at_all(tmp_path: Path) -> None:
    """And what is no file is none, however it is reached."""
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "a.txt").write_bytes(b"0123456789")
    assert names.contents(tmp_path, "inner", "a.txt", largest=10) == b"0123456789"
    with pytest.raises(OSError, match="it has more than") as refused:
        names.contents(tmp_path, "inner", "a.txt", largest=9)
    assert refused.value.errno == errno.EFBIG
    for parts in (
        ("inner",),
        ("inner", "b.txt"),
        ("inner", "a.txt", "a.txt"),
        ("..", tmp_path.name, "inner", "a.txt"),
    ):
        with pytest.raises(OSError, match=r"No such|directory"):
            names.open_inside(tmp_path, *parts)


@pytest.mark.parametrize(
    ("text", "title"),
    [
        ('title = "a"', "a"), ("# x\ntitle='b \\\\ c'", "b \\\\ c"), ('title = "\\u00e5 \\"x\\""', 'å "x"'), ('title = "\\U0001F6A2"', "\\U0001F6A2"), ('title = "open', ""),
        ("title = 3", ""), ("x" * 1000, ""), ("a." * 400_000 + "a = 1\ntitle = 'late'", "late"),
    ],
)  # fmt: skip
def test_titles_are_found_without_reading_toml(tmp_path: Path, text: str, title: str) -> None:
    """A key of 400,000 parts would hold the server for hours."""
    (tmp_path / "x.toml").write_text(text, encoding="utf-8")
    assert [case["title"] for case in shelf.cases(tmp_path)] == [title]


def test_two_writers_lose_nothing(served: Server) -> None:
    path = "/api/cases/two.toml"
    first = served.json("POST", path, {"text": "a = 1\n", "digest": None})["digest"]
    assert served.ask("POST", path, {"text": "b", "digest": None})[0] == 409  # it is there already
    second = served.json("POST", path, {"text": "a = 2\n", "digest": first})["digest"]
    status, _, data = served.ask("POST", path, {"text": "a = 3\n", "digest": first})
    assert (status, b"was changed in the meantime" in data) == (409, True)
    assert served.json("GET", path) == {"name": "two.toml", "text": "a = 2\n", "digest": second}
    assert not [one for one in served.folder.iterdir() if one.name.endswith(".part")]
    (served.folder / "two.toml").unlink()
    # taken away meanwhile
    assert served.ask("POST", path, {"text": "a = 3\n", "digest": second})[0] == 409


def test_many_writers_at_once_one_wins(served: Server) -> None:
    status: list[int] = []
    begun = served.json("POST", "/api/cases/race.toml", {"text": "", "digest": None})["digest"]
    threads = [threading.Thread(target=lambda k=k: status.append(served.ask("POST", "/api/cases/race.toml", {"text": f"k = {k}", "digest": begun})[0])) for k in range(8)]  # fmt: skip
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20)
    assert sorted(status) == [200] + [409] * 7
    (served.folder / "race.toml").unlink()


@pytest.mark.parametrize(
    "summary",
    [
        '{"wall_time_s": {"a": NaN}}', '{"wall_time_s": {"a": Infinity}}', f'{{"wall_time_s": {{"a": 1{"0" * 400}}}}}',
        '{"title": "\\ud800"}', '{"title": "x", "warnings": ["\\udfff"]}', '{"date_created": "\\ud800"}',
    ],
)  # fmt: skip
def test_a_hostile_entry_leaves_the_list_to_the_others(served: Server, summary: str) -> None:
    finished(served.folder / "bad", summary_json=summary)
    (served.folder / "bad.toml").write_text(r'title = "\ud800"', encoding="utf-8")
    try:
        told = served.json("GET", "/api/folder")
    finally:
        shutil.rmtree(served.folder / "bad")
        (served.folder / "bad.toml").unlink()
    assert "done" in {run["name"] for run in told["runs"]}
    assert {"bad.toml", "case.toml"} <= {case["name"] for case in told["cases"]}


@pytest.mark.parametrize("share", ["NaN", "-1", "1e999", "1" + "0" * 400, "[" * 50_000, '"x"'])
def test_progress_that_is_none_is_left_out(share: str) -> None:
    job = jobs.Job(1, "run", "case.toml", "0" * 64)
    jobs._take(job, f'{jobs.MARK}{{"phase": "drift", "share": 0.5}}')
    jobs._take(job, f'{jobs.MARK}{{"phase": "\\ud800", "share": {share}}}')
    jobs._take(job, f'{jobs.MARK}{{"phase": "\\ud800drift", "share": 0.75}}')
    assert (job.phase, job.share, list(job.lines)) == ("drift", 0.75, [])


def test_a_story_is_what_drift_new_writes(served: Server, tmp_path: Path) -> None:
    assert served.json("POST", "/api/shipped/passage", {})["name"] == "passage.toml"
    assert commands.main(["new", "passage", str(tmp_path / "own.toml")]) == 0
    assert (served.folder / "passage.toml").read_bytes() == (tmp_path / "own.toml").read_bytes()


def test_a_copy_of_a_shipped_case_brings_its_network(served: Server) -> None:
    assert (
        served.json("POST", "/api/shipped/medsearch_transit", {})["name"]
        == "medsearch_transit.toml"
    )
    assert (
        served.json("POST", "/api/shipped/medsearch_transit", {})["name"]
        == "medsearch_transit-2.toml"
    )
    assert drift.load(served.folder / "medsearch_transit.toml").title
    for name in (
        "medsearch_transit.toml",
        "medsearch_transit-2.toml",
        "networks/mediterranean.toml",
    ):
        (served.folder / name).unlink()
    (served.folder / "networks").rmdir()
    (served.folder / "networks").symlink_to(served.folder.parent)
    assert served.ask("POST", "/api/shipped/medsearch_transit", {})[0] == 500
    (served.folder / "networks").unlink()


def test_a_copy_of_a_shipped_case_brings_its_losses(served: Server) -> None:
    assert served.json("POST", "/api/shipped/sound_channel", {})["name"] == "sound_channel.toml"
    assert (served.folder / "losses" / "sargasso.nc").read_bytes() == (
        ROOT / "cases" / "losses" / "sargasso.nc"
    ).read_bytes()
    assert drift.load(served.folder / "sound_channel.toml").named_sensors
