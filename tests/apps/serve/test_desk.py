"""drift serve against attacks: every refusal, over real connections on the loopback."""

import asyncio
import errno
import http.client
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.parse
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import hostile_netcdf
import pytest
import small_case
from desks import NASTY, Server, finished, until
from places import ROOT

import drift
from drift.apps.cli import commands
from drift.apps.serve import gate, jobs, names, server, shelf
from geo.errors import UserError
from geo.files import fence, landlock

# minutes of work, to be cancelled
LONG = 'particles = 200000\nduration = "240 h"\nclock.step = "60 s"'
SLOW = small_case.STEADY.replace("particles = 500", "").replace('duration = "6 h"', LONG)


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    outer = tmp_path_factory.mktemp("outer")
    folder = outer / "folder"
    folder.mkdir()
    (outer / "secret.toml").write_text('title = "secret"', encoding="utf-8")
    (folder / "case.toml").write_text(small_case.STEADY, encoding="utf-8")
    (folder / "nasty.toml").write_text(f'title = "{NASTY}"', encoding="utf-8")
    (folder / ".hidden.toml").write_text("title = 1", encoding="utf-8")
    (folder / "link.toml").symlink_to(outer / "secret.toml")
    os.mkfifo(folder / "pipe.toml")  # who opens it waits for one who writes
    (folder / "folder.toml").mkdir()
    finished(folder / "done", NASTY, a_txt="words", b_html="<script>alert(1)</script>", c_nc="x")
    (folder / "done" / "extra.txt").write_text("no manifest names it", encoding="utf-8")
    finished(folder / "half")
    (folder / "half" / "report.html").unlink()
    finished(outer / "elsewhere")
    (folder / "linked").symlink_to(outer / "elsewhere")
    with Server(folder.resolve()) as one:
        yield one


@pytest.fixture
def served(running: Server) -> Iterator[Server]:
    """The server; what a test leaves in its folder is removed."""
    before = set(running.folder.iterdir())
    yield running
    for path in set(running.folder.iterdir()) - before:
        shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()


# --- who may ask -----------------------------------------------------------------------------------------------------

GOOD = {"text": "title = 1", "digest": None}
STRANGERS: dict[str, tuple[str, str, Any, dict[str, str | None], int]] = {
    "no cookie": ("GET", "/api/folder", None, {"Cookie": None}, 401),
    "no cookie, the page": ("GET", "/", None, {"Cookie": None}, 401),
    "no cookie, a script": ("GET", "/assets/desk.js", None, {"Cookie": None}, 401),
    "no cookie, to change": ("POST", "/api/cases/x.toml", GOOD, {"Cookie": None}, 401),
    "a wrong cookie": ("GET", "/api/folder", None, {"Cookie": "drift=x"}, 401),
    "a cookie of letters beyond ASCII": ("GET", "/api/folder", None, {"Cookie": "drift-1=\xe9"}, 401),
    "a wrong token": ("GET", "/?token=wrong", None, {"Cookie": None}, 401),
    "a token beyond ASCII": ("GET", "/?token=%C3%A9%FF", None, {"Cookie": None}, 401),
    "no token but a query": ("GET", "/?x=1", None, {}, 401),
    "a name rebound to us": ("GET", "/api/folder", None, {"Host": "evil.example:{port}"}, 421),
    "our name without its port": ("GET", "/api/folder", None, {"Host": "127.0.0.1"}, 421),
    "our name with another port": ("GET", "/api/folder", None, {"Host": "127.0.0.1:1"}, 421),
    "our name with a tail": ("GET", "/api/folder", None, {"Host": "127.0.0.1:{port}.evil.example"}, 421),
    "zero for our name": ("GET", "/api/folder", None, {"Host": "0.0.0.0:{port}"}, 421),
    "another site's form": ("POST", "/api/cases/x.toml", GOOD, {"Origin": "http://evil.example", "Sec-Fetch-Site": "cross-site"}, 403),
    "another site, an old browser": ("POST", "/api/cases/x.toml", GOOD, {"Origin": "http://evil.example", "Sec-Fetch-Site": None}, 403),
    "another port of this machine": ("POST", "/api/cases/x.toml", GOOD, {"Origin": "http://127.0.0.1:1", "Sec-Fetch-Site": "same-site"}, 403),
    "a page in a sandbox": ("POST", "/api/cases/x.toml", GOOD, {"Origin": "null", "Sec-Fetch-Site": "cross-site"}, 403),
    "our other name": ("POST", "/api/cases/x.toml", GOOD, {"Origin": "http://localhost:{port}", "Sec-Fetch-Site": None}, 403),
    "https for http": ("POST", "/api/cases/x.toml", GOOD, {"Origin": "https://127.0.0.1:{port}"}, 403),
    "nobody says from where": ("POST", "/api/cases/x.toml", GOOD, {"Origin": None, "Sec-Fetch-Site": None}, 403),
    "asked for by hand": ("POST", "/api/cases/x.toml", GOOD, {"Sec-Fetch-Site": "none"}, 403),
    "another site reads": ("GET", "/api/folder", None, {"Sec-Fetch-Site": "cross-site"}, 403),
    "another port reads": ("GET", "/api/folder", None, {"Sec-Fetch-Site": "same-site"}, 403),
    "a form": ("POST", "/api/cases/x.toml", GOOD, {"Content-Type": "application/x-www-form-urlencoded"}, 415),
    "text, as without a question before": ("POST", "/api/cases/x.toml", GOOD, {"Content-Type": "text/plain"}, 415),
    "no type": ("POST", "/api/cases/x.toml", GOOD, {"Content-Type": None}, 415),
    "another letter code": ("POST", "/api/cases/x.toml", GOOD, {"Content-Type": "application/json; charset=utf-7"}, 415),
    "a huge body": ("POST", "/api/cases/x.toml", b"{}", {"Content-Length": "99999999999999"}, 413),
    "a body in pieces": ("POST", "/api/cases/x.toml", b"2\r\n{}\r\n0\r\n\r\n", {"Content-Length": None, "Transfer-Encoding": "chunked"}, 411),
    "a body that is no JSON": ("POST", "/api/cases/x.toml", b"{", {}, 400),
    "a body that is a list": ("POST", "/api/cases/x.toml", [], {}, 400),
    "a body of brackets": ("POST", "/api/cases/x.toml", b"[" * 100_000, {}, 400),
    "a body not in UTF-8": ("POST", "/api/cases/x.toml", b'{"text": "\xff\xfe"}', {}, 400),
    "a text of half letters": ("POST", "/api/cases/x.toml", {"text": "\ud800", "digest": None}, {}, 400),
    "a text with a zero": ("POST", "/api/cases/x.toml", {"text": "\0", "digest": None}, {}, 400),
    "another key": ("POST", "/api/cases/x.toml", {**GOOD, "path": "/etc"}, {}, 400),
    "a number for a text": ("POST", "/api/cases/x.toml", {"text": 1, "digest": None}, {}, 400),
    "too long a text": ("POST", "/api/cases/x.toml", {"text": "x" * (2**20 + 1), "digest": None}, {}, 413),
    "a command that is none": ("POST", "/api/jobs", {"kind": "verify", "case": "case.toml", "digest": ""}, {}, 400),
    "a command with options": ("POST", "/api/jobs", {"kind": "run --overwrite", "case": "case.toml", "digest": ""}, {}, 400),
    "an option for a case": ("POST", "/api/jobs", {"kind": "run", "case": "--out=x.toml", "digest": ""}, {}, 400),
    "a way out for a case": ("POST", "/api/jobs", {"kind": "run", "case": "../secret.toml", "digest": ""}, {}, 400),
    "to delete": ("DELETE", "/api/cases/case.toml", None, {}, 405),
    "to put": ("PUT", "/api/cases/case.toml", None, {}, 405),
    "a question before a foreign request": ("OPTIONS", "/api/folder", None, {"Origin": "http://evil.example"}, 405),
    "too long an address": ("GET", "/" + "x" * 3000, None, {}, 414),
    "a job that is not there": ("POST", "/api/jobs/99/cancel", {}, {}, 404),
    "a case that does not ship": ("POST", "/api/shipped/..%2F..%2Fetc", {}, {}, 404),
}  # fmt: skip


@pytest.mark.parametrize("attack", STRANGERS)
def test_who_may_not(served: Server, attack: str) -> None:
    method, path, body, changes, expected = STRANGERS[attack]
    filled = {
        name: value and value.replace("{port}", str(served.port)) for name, value in changes.items()
    }
    before = sorted(served.folder.iterdir())
    status, headers, data = served.ask(method, path, body, **filled)
    assert status == expected, data
    assert not any(name.startswith("access-control") for name in headers)
    assert headers["x-content-type-options"] == "nosniff"
    assert sorted(served.folder.iterdir()) == before
    assert served.secret.token.encode() not in data


def test_the_token_becomes_a_cookie_that_scripts_and_other_sites_do_not_have(
    served: Server,
) -> None:
    status, headers, _ = served.ask("GET", f"/?token={served.secret.token}", Cookie=None)
    assert (status, headers["location"]) == (303, "/")
    parts = {part.strip().lower() for part in headers["set-cookie"].split(";")[1:]}
    assert {"httponly", "samesite=strict", "path=/"} <= parts
    assert served.secret.token not in headers["set-cookie"]
    assert served.ask("GET", "/", Cookie=headers["set-cookie"].split(";")[0])[0] == 200


def test_every_answer_says_what_a_browser_may_do_with_it(served: Server) -> None:
    for path in ("/", "/assets/desk.js", "/api/folder", "/nowhere", "/api/cases/no.toml"):
        headers = served.ask("GET", path)[1]
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert (
            headers["cross-origin-opener-policy"]
            == headers["cross-origin-resource-policy"]
            == "same-origin"
        )
        assert headers["cache-control"] == "no-store"
        for rule in ("default-src 'none'", "script-src 'self'", "frame-ancestors 'none'", "base-uri 'none'", "form-action 'none'"):  # fmt: skip
            assert rule in headers["content-security-policy"]
        assert "unsafe" not in headers["content-security-policy"]
        assert "server" not in headers


def test_two_hosts_are_none(served: Server) -> None:
    """Of two such headers a proxy might believe the one and we the other; h11 refuses them before
    we do.
    """
    status, _, _ = served.ask("GET", f"/api/folder HTTP/1.1\r\nHost: {served.host}\r\nX: y", None)
    assert status in (400, 421)


def test_a_slow_body_is_given_up(served: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gate, "PATIENCE", 0.3)
    assert served.ask("POST", "/api/cases/x.toml", b"{", Content_Length="10")[0] == 408


LEAST = b'{"text": ""}'


def through_the_gate(
    pieces: list[bytes], told: int, ends: bool = True, more: dict[str, str] | None = None
) -> tuple[int, int, Any]:
    """Return the status, how many pieces of a body were taken, and what was passed on; told: its
    length as its header has it.
    """
    secret, taken, passed, answer = gate.Secret(), [], [], []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        passed.append(scope["body"])
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def receive() -> dict[str, Any]:
        taken.append(len(taken))
        if len(taken) > len(pieces):
            return {"type": "http.disconnect"}
        return {
            "type": "http.request",
            "body": pieces[taken[-1]],
            "more_body": not ends or len(taken) < len(pieces),
        }

    async def send(message: dict[str, Any]) -> None:
        answer.append(message)

    headers = {
        "host": "127.0.0.1:8123", "origin": "http://127.0.0.1:8123", "cookie": f"drift-8123={secret.cookie}",
        "content-type": "application/json", "content-length": str(told),
    }  # fmt: skip
    scope = {
        "type": "http", "method": "POST", "path": "/api/jobs", "raw_path": b"/api/jobs", "query_string": b"",
        "headers": [(name.encode(), value.encode()) for name, value in [*headers.items(), *(more or {}).items()]],
    }  # fmt: skip
    asyncio.run(gate.Gate(app, ("127.0.0.1:8123",), secret)(scope, receive, send))
    return answer[0]["status"], len(taken), passed


@pytest.mark.parametrize("many", [1, 7])
@pytest.mark.parametrize("more", [0, 1])
def test_a_body_is_as_long_as_what_comes_not_as_it_says(many: int, more: int) -> None:
    """Two MiB are taken, in pieces too, and not one letter more: the server before us may be
    another one day.
    """
    text = b'{"text": "' + b"x" * (2 * 2**20 + more - len(LEAST)) + b'"}'
    step = -(-len(text) // many)
    status, _, passed = through_the_gate(
        [text[k : k + step] for k in range(0, len(text), step)], told=17
    )
    assert status == (413 if more else 200)
    assert len(passed) == (not more)


def test_of_a_body_without_end_no_more_is_taken_than_is_allowed() -> None:
    piece = b" " * 700_000
    assert through_the_gate([piece] * 40, told=17)[:2] == (413, 3)


@pytest.mark.parametrize(
    "more", [{"transfer-encoding": "chunked"}, {"content-length": "12"}, {"content-length": "9"}]
)
def test_a_body_of_two_lengths_has_none(more: dict[str, str]) -> None:
    """Whatever stands before us may have believed the other one."""
    assert through_the_gate([LEAST], told=12, more=more) == (411, 0, [])


def test_a_body_that_breaks_off_is_none() -> None:
    assert through_the_gate([LEAST], told=17, ends=False) == (400, 2, [])
    assert through_the_gate([LEAST[:5], LEAST[5:]], told=17) == (200, 2, [{"text": ""}])


def test_a_part_of_a_key_is_no_key(served: Server) -> None:
    """Neither an empty value of our own cookie, nor the beginning of the right one, nor of the
    token.
    """
    secret = served.secret
    for value in ("", "x", secret.cookie[:-1], f"{secret.cookie}x", secret.token):
        assert served.ask("GET", "/api/folder", Cookie=f"drift-{served.port}={value}")[0] == 401
    for value in ("", "x", secret.token[:-1], f"{secret.token}x", secret.cookie):
        assert served.ask("GET", f"/?token={value}", Cookie=None)[0] == 401
    for value in ("x", secret.key("done")[:-1], secret.key("half")):
        assert served.ask("GET", f"/runs/done/{value}/report.html")[0] == 401


@pytest.mark.parametrize("digest", ["", "\ud800", "x" * 64, "a" * 65, "a" * 1_000_000])
def test_a_digest_that_is_none_asks_for_nothing(served: Server, digest: str) -> None:
    before = served.json("GET", "/api/jobs")
    assert (
        served.ask("POST", "/api/jobs", {"kind": "check", "case": "case.toml", "digest": digest})[0]
        == 400
    )
    assert served.json("GET", "/api/jobs") == before


def test_too_many_jobs_are_refused(served: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jobs, "MOST_WAITING", 0)
    assert (
        served.ask("POST", "/api/jobs", {"kind": "run", "case": "case.toml", "digest": "0" * 64})[0]
        == 429
    )


# --- which files are meant -------------------------------------------------------------------------------------------

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


def test_pages_of_runs_stand_apart(served: Server) -> None:
    """Their scripts run in an origin of their own: they can neither ask us for anything nor see our
    page.
    """
    path = f"/runs/done/{served.secret.key('done')}/report.html"
    status, headers, data = served.ask("GET", path, Cookie=None)
    policy = headers["content-security-policy"]
    assert (status, headers["content-type"], data) == (
        200,
        "text/html; charset=utf-8",
        f"<title>{NASTY}</title>".encode(),
    )
    assert "sandbox allow-scripts allow-downloads" in policy
    for method in ("GET", "HEAD"):  # browsers send the cookie along
        assert served.ask(method, path)[1]["content-security-policy"] == policy
    assert "allow-same-origin" not in policy
    assert "default-src 'none'" in policy
    assert headers["cross-origin-resource-policy"] == "same-origin"
    # a key opens one run
    assert served.ask("GET", path.replace("/done/", "/half/"), Cookie=None)[0] == 401
    assert served.ask("GET", path, Sec_Fetch_Site="cross-site", Sec_Fetch_Mode="no-cors")[0] == 403
    # its own links
    assert served.ask("GET", path, Sec_Fetch_Site="cross-site", Sec_Fetch_Mode="navigate")[0] == 200
    assert served.ask("POST", path, {})[0] == 404
    for name, kind, saved in (("b.html", "text/plain", True), ("a.txt", "text/plain; charset=utf-8", False), ("c.nc", "application/x-netcdf", True)):  # fmt: skip
        headers = served.ask("GET", path.replace("report.html", name))[1]
        assert headers["content-type"].startswith(kind)
        assert ("content-disposition" in headers) == saved
    assert served.ask("HEAD", path)[2] == b""


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


# --- saving ----------------------------------------------------------------------------------------------------------


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


# --- jobs ------------------------------------------------------------------------------------------------------------


def ask_for(served: Server, kind: str, name: str, text: str) -> Any:
    digest = served.json("POST", f"/api/cases/{name}", {"text": text, "digest": None})["digest"]
    return served.json("POST", "/api/jobs", {"kind": kind, "case": name, "digest": digest})[
        "number"
    ]


def over(served: Server, number: int) -> Any:
    return until(
        lambda: (job := served.job(number))["state"] in ("done", "failed", "cancelled") and job, 120
    )


OUTSIDE = ("/etc/passwd", "../secret.toml", "/etc/*", "*/../../*.toml", "linked/summary.json", "link.toml", "http://169.254.169.254/x", "file:///etc/passwd", "${HOME}/x.nc")  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("kind", [pytest.param("check", marks=pytest.mark.thorough), "run"])
def test_a_case_reads_nothing_outside(served: Server, kind: str) -> None:
    """Every way of naming it is refused, a line each, where files are opened: in the process of the
    job.
    """
    sources = "".join(
        f"[[current]]\nname = 'c{k}'\nfiles = '{written}'\n" for k, written in enumerate(OUTSIDE)
    )
    text = small_case.STEADY.replace("[[wind]]", f"{sources}[[wind]]").replace('coast.source = "none"', 'coast.source = "/etc/passwd"\ncoast.lakes = "link.toml"')  # fmt: skip
    job = over(served, ask_for(served, kind, f"out-{kind}.toml", text))
    told = "\n".join(job["lines"])
    assert job["state"] == "failed"
    for k in range(len(OUTSIDE)):
        line = next(line for line in job["lines"] if f'current "c{k}"' in line)
        assert "outside the folders" in line or "may not be" in line
    assert os.environ["HOME"] not in told
    assert "root:" not in told
    assert not (served.folder / f"out-{kind}-forecast").exists()


@pytest.mark.thorough
def test_a_shoreline_outside_is_refused_too(served: Server) -> None:
    text = small_case.STEADY.replace('coast.source = "none"', 'coast.source = "../secret.toml"')
    job = over(served, ask_for(served, "check", "shore.toml", text))
    assert job["state"] == "failed"
    assert "outside the folders" in "\n".join(job["lines"])


@pytest.mark.skipif(not landlock.version(), reason="this system has no Landlock")
@pytest.mark.thorough
def test_no_current_is_taken_from_a_file_that_a_file_names(served: Server) -> None:
    """A netCDF-4 file in the folder with its values in one outside: the kernel refuses the job what
    the library asks for.
    """
    hostile_netcdf.secret(served.folder.parent / "values.bin", "storage")
    hostile_netcdf.write(
        served.folder / "current.nc", "storage", served.folder.parent / "values.bin"
    )
    job = over(served, ask_for(served, "check", "hostile.toml", small_case.CASE))
    assert job["state"] == "failed"
    assert "cannot read slice 0 of uo (NetCDF: HDF error)" in job["lines"][-1]


@pytest.mark.thorough
def test_a_run_tells_progress_and_ends_in_a_report(
    served: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No file is overwritten, and no module in the folder is imported.

    A numpy.py among the cases would run as the user, also where the server was started there by
    `python -m drift`.
    """
    monkeypatch.syspath_prepend(str(served.folder))
    (served.folder / "numpy.py").write_text("raise SystemExit('owned')", encoding="utf-8")
    finished(served.folder / "good-forecast")
    job = over(
        served,
        ask_for(served, "run", "good.toml", small_case.STEADY.replace('"trial"', f'"{NASTY}"')),
    )
    (served.folder / "numpy.py").unlink()
    assert (job["state"], job["out"]) == ("done", "good-forecast-2"), "\n".join(job["lines"])
    assert job["phase"]  # it did tell
    status, _, data = served.ask(
        "GET", f"/runs/good-forecast-2/{job['key']}/report.html", Cookie=None
    )
    assert (status, b"Content-Security-Policy" in data) == (200, True)
    assert NASTY.encode() not in data
    told = served.json("GET", "/api/folder")["runs"]
    assert next(run for run in told if run["name"] == "good-forecast-2")["kind"] == "forecast"


def test_a_case_changed_after_it_was_asked_for_does_not_run(served: Server) -> None:
    digest = served.json(
        "POST", "/api/cases/later.toml", {"text": small_case.STEADY, "digest": None}
    )["digest"]
    (served.folder / "later.toml").write_text("title = 1", encoding="utf-8")
    job = over(
        served,
        served.json("POST", "/api/jobs", {"kind": "run", "case": "later.toml", "digest": digest})[
            "number"
        ],
    )
    assert (job["state"], "was changed after" in job["lines"][-1]) == ("failed", True)


@pytest.mark.thorough
def test_one_run_at_a_time_and_a_cancelled_one_leaves_nothing(served: Server) -> None:
    first = ask_for(served, "run", "slow.toml", SLOW)
    second = ask_for(served, "run", "second.toml", small_case.STEADY)
    checked = ask_for(served, "check", "third.toml", small_case.STEADY)
    until(lambda: served.job(first)["phase"] == "drift", 120)
    assert served.job(second)["state"] == "waiting"
    assert over(served, checked)["state"] == "done"  # a check need not wait
    assert served.job(first)["state"] == "running"
    assert served.json("POST", f"/api/jobs/{first}/cancel", {})["state"] == "cancelled"
    assert over(served, second)["state"] == "done"
    assert not (served.folder / "slow-forecast").exists()
    assert not [
        path.name
        for path in served.folder.iterdir()
        if path.name.startswith(".") and path.name != ".hidden.toml"
    ]


def test_of_two_servers_that_save_the_same_case_one_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both have read it before either writes, if nothing keeps them apart."""
    digest = shelf.save(tmp_path, "case.toml", small_case.STEADY, None)
    read, both = names.contents, threading.Barrier(2)

    def slowly(*given: Any, **options: Any) -> bytes:
        data = read(*given, **options)
        with suppress(threading.BrokenBarrierError):
            both.wait(0.3)
        return data

    monkeypatch.setattr(names, "contents", slowly)
    told: list[str] = []

    def save(text: str) -> None:
        try:
            shelf.save(tmp_path, "case.toml", text, digest)
            told.append(text)
        except shelf.Conflict:
            told.append("conflict")

    savers = [threading.Thread(target=save, args=(f"title = '{name}'",)) for name in ("a", "b")]
    for saver in savers:
        saver.start()
    for saver in savers:
        saver.join()
    assert sorted(told)[0] == "conflict"
    assert (tmp_path / "case.toml").read_text(encoding="utf-8") == sorted(told)[1]


def ended(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    does: str,
    limits: jobs.Limits,
    cancel: str = "",
    kind: str = "check",
) -> jobs.Job:
    """Return a job, once it is over, whose process does something else; cancel: a line of its log
    upon which it is.
    """

    async def carried_out() -> jobs.Job:
        waiting = jobs.Jobs(folder, fence.Fence((folder,)), limits)
        await waiting.open()
        job = waiting.add(kind, "case.toml", shelf.read_case(folder, "case.toml")[1])
        assert job is not None
        for _ in range(300):
            if job.over:
                break
            if cancel and any(line.startswith(cancel) for line in job.lines):
                await waiting.cancel(job)
            await asyncio.sleep(0.05)
        await waiting.close()
        return job

    monkeypatch.setattr(jobs, "START", does)
    (folder / "case.toml").write_text(small_case.STEADY, encoding="utf-8")
    return asyncio.run(carried_out())


def test_a_job_works_in_an_empty_folder_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where Python and libraries look for files of theirs there are none that a case's owner has
    put there.
    """
    tells = "import os, tempfile; print(os.getcwd(), os.listdir(), tempfile.gettempdir()); (lambda memory: None)"
    job = ended(tmp_path, monkeypatch, tells, jobs.Limits())
    place, listed, scratch = job.lines[0].split()
    assert (job.state, listed, scratch) == ("done", "[]", place)
    assert not Path(place).is_relative_to(tmp_path)
    assert not Path(place).is_relative_to(Path.cwd())
    assert not Path(place).exists()  # any more


@pytest.mark.parametrize(
    ("kind", "backend", "given"),
    [("run", "auto", True), ("run", "cpu", False), ("check", "auto", False)],
)
def test_a_job_is_given_the_backend_that_is_served(
    kind: str, backend: str, given: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tells = "import sys; print(' '.join(sys.argv[1:])); (lambda memory: None)"
    job = ended(tmp_path, monkeypatch, tells, jobs.Limits(backend=backend), kind=kind)
    assert job.lines[0].endswith("--backend auto") == given
    assert ("--backend" in job.lines[0]) == given


def test_the_processes_of_a_job_end_with_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By force where they do not end by themselves, also those that the job's process started."""
    deaf = "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); import time"
    starts = f"import sys, subprocess; print('pid', subprocess.Popen([sys.executable, '-c', '{deaf}; time.sleep(60)']).pid)"
    monkeypatch.setattr(jobs, "GRACE", 1.0)
    job = ended(
        tmp_path,
        monkeypatch,
        f"{deaf}; {starts}; time.sleep(60); (lambda memory: None)",
        jobs.Limits(),
        "pid",
    )
    assert job.state == "cancelled"
    until(lambda: not _runs(int(job.lines[0].split()[1])), 10)


def _runs(process: int) -> bool:
    """Whether a process is there, and not only waits for its end to be taken note of."""
    told = Path(f"/proc/{process}/stat")
    try:
        os.kill(process, 0)
        return not told.exists() or told.read_text().rpartition(")")[2].split()[0] != "Z"
    except (ProcessLookupError, FileNotFoundError):
        return False


FATES = {  # what a process does, and what its log ends with
    "it takes too long": ("import time; time.sleep(60); (lambda memory: None)", "after the limit of 0.0005 h; drift serve --hours"),
    "a library crashes": ("import os; os.kill(os.getpid(), 11); (lambda memory: None)", "a library crashed (SIGSEGV); try"),
    "it is killed": ("import os; os.kill(os.getpid(), 9); (lambda memory: None)", "by SIGKILL, as happens when memory"),
    "it asks for too much": (
        "from drift.apps.cli import commands, tethered; commands._dispatch = lambda argv: bytearray(2**33); tethered.main",
        "not enough memory (",
    ),
    "Taichi asks for too much": (
        "from drift.apps.cli import commands, tethered; import numpy as np; from kernels.runtime import runtime; import taichi as ti; "
        "commands._dispatch = lambda argv: (runtime.start(threads=1), ti.ndarray(ti.f32, 2**30)); tethered.main",
        "not enough memory ([host_memory_pool",
    ),
}  # fmt: skip


@pytest.mark.parametrize("fate", FATES)
def test_a_job_that_takes_too_much_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fate: str
) -> None:
    does, line = FATES[fate]
    most = jobs.Limits(hours=0.0005 if "long" in fate else 1.0, memory=2.0)
    monkeypatch.syspath_prepend(ROOT)
    job = ended(tmp_path, monkeypatch, does, most)
    assert job.state == "failed"
    assert line in job.lines[-1], job.lines
    assert "Traceback" not in "\n".join(job.lines)


# --- the command -----------------------------------------------------------------------------------------------------


def started(folder: Path, *options: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-m", "drift", "serve", str(folder), "--no-browser", *options],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT,
    )  # fmt: skip


def children() -> dict[int, int]:
    """Return the parent of each process."""
    found = {}
    for place in Path("/proc").glob("[0-9]*"):
        try:
            found[int(place.name)] = int((place / "stat").read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
    return found


@pytest.mark.thorough
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are not listed here")
@pytest.mark.parametrize(
    "how", [signal.SIGKILL, pytest.param(signal.SIGTERM, marks=pytest.mark.thorough)]
)
def test_no_run_outlives_the_server(tmp_path: Path, how: signal.Signals) -> None:
    (tmp_path / "slow.toml").write_text(SLOW, encoding="utf-8")
    with started(tmp_path) as process:
        assert process.stdout is not None
        shown = [process.stdout.readline() for _ in range(3)]
        token = shown[1].split("token=")[1].strip()
        port = int(shown[1].split("/?")[0].rpartition(":")[2])
        line = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
        line.request("GET", f"/?token={token}")
        answer = line.getresponse()
        answer.read()
        own = {"Cookie": answer.headers["Set-Cookie"].split(";")[0], "Origin": f"http://127.0.0.1:{port}", "Content-Type": "application/json"}  # fmt: skip
        body = {"kind": "run", "case": "slow.toml", "digest": shelf.digest(SLOW.encode())}
        line.request("POST", "/api/jobs", json.dumps(body), own)
        assert line.getresponse().read()
        run = until(
            lambda: [child for child, parent in children().items() if parent == process.pid], 30
        )
        time.sleep(3.0)  # into its imports, or further
        process.send_signal(how)
        process.wait(30)
        line.close()
    until(lambda: not any(Path(f"/proc/{pid}").exists() and "Z" not in Path(f"/proc/{pid}/stat").read_text().split()[2] for pid in run), 25)  # fmt: skip
    assert not (tmp_path / "slow-forecast").exists()


def test_a_job_that_tells_nothing_ends_with_the_server_too() -> None:
    """One that tells progress meets a closed pipe; one that waits for a file or an address would go
    on.
    """
    silent = "import time; from drift.apps.cli import commands, tethered; commands.leave = lambda: time.sleep(60); tethered.main()"
    with subprocess.Popen(
        [sys.executable, "-c", silent], stdin=subprocess.PIPE, cwd=ROOT
    ) as process:
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(2)  # it goes on as long as its input does
        assert process.stdin is not None
        process.stdin.close()
        assert process.wait(20) in (-signal.SIGTERM, 128 + signal.SIGTERM)


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert commands.main(["serve", "--no-browser", *words]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    return error


def test_refusals_of_the_command_are_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with closing(socket.socket()) as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        assert "is in use" in refused(capsys, str(tmp_path), "--port", str(taken.getsockname()[1]))
    assert "does not exist" in refused(capsys, str(tmp_path / "nowhere"))
    (tmp_path / "file").write_text("", encoding="utf-8")
    assert "is not a folder" in refused(capsys, str(tmp_path / "file"))
    assert "from 1 to 65535" in refused(capsys, str(tmp_path), "--port", "70000")
    assert "name one address" in refused(capsys, str(tmp_path), "--host", "0.0.0.0")
    assert "no such host" in refused(capsys, str(tmp_path), "--host", "no such host")
    assert "does not exist" in refused(capsys, str(tmp_path), "--allow", str(tmp_path / "nowhere"))
    for option, value in (
        ("--hours", "0"),
        ("--hours", "nan"),
        ("--memory", "0.1"),
        ("--memory", "inf"),
    ):
        assert f"{option} {value}: must be" in refused(capsys, str(tmp_path), option, value)
    assert "is not a host" in refused(capsys, str(tmp_path), "--allow-host", "http://x/")


def test_a_port_that_is_not_ours_is_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The superuser may take any: the system's answer is made up.

    Without --port, the next one is tried.
    """

    def refuse(one: socket.socket, address: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(socket.socket, "bind", refuse)
    with pytest.raises(
        UserError,
        match=r"^port 80 of 127.0.0.1 needs privileges, as most below 1024 do; give another with port$",
    ):
        drift.serve(tmp_path, port=80)
    with pytest.raises(UserError, match=r"ports 8765 to 8785 of 127.0.0.1 are not available"):
        drift.serve(tmp_path)


def test_a_folder_that_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The superuser may write anywhere: the system's answer is made up."""
    monkeypatch.setattr(os, "access", lambda path, how: False)
    with pytest.raises(UserError, match="cannot be read and written"):
        drift.serve(tmp_path)


def test_the_next_free_port_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    with closing(socket.socket()) as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        monkeypatch.setattr(server, "PORT", taken.getsockname()[1])
        with closing(server._listen("127.0.0.1", None)) as found:
            assert server.PORT < found.getsockname()[1] <= server.PORT + server.NEXT


def test_without_its_library_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    with pytest.raises(UserError, match=r"pip install -e '\.\[serve\]'"):
        drift.serve(tmp_path)


def test_what_is_allowed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "data").mkdir()
    monkeypatch.setenv("DRIFT_DATA", str(tmp_path / "data"))
    allowed = server._fence(tmp_path / "x", [tmp_path], ["THREDDS.example.org"])
    assert {tmp_path / "data", tmp_path / "x", tmp_path} <= set(allowed.folders)
    assert isinstance(allowed, fence.Fence)
    assert allowed.hosts == {"thredds.example.org"}
