"""Requests to drift serve that are rejected: strangers, bodies, keys and jobs, over real
connections on the loopback.
"""

import asyncio
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import small_case
from desks import NASTY, Server

from drift.apps.serve import gate, jobs, names, shelf

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
