"""Several people at one desk: tokens, guests, the log, and the description of the interface."""

import json
import os
import stat
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import small_case
from desks import Server
from openapi_spec_validator import validate

from drift.apps.serve import desk_log, users
from geo.errors import UserError

ANNA, BEN, PRESS = users.User("ANNA"), users.User("BEN"), users.User("PRESS", guest=True)
NEW = {"text": "title = 1", "digest": None}
BARE: dict[str, str | None] = dict.fromkeys(("Cookie", "Origin", "Sec_Fetch_Site"))


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("several")
    (folder / "case.toml").write_text(small_case.STEADY, encoding="utf-8")
    with Server(folder.resolve(), people=(ANNA, BEN, PRESS)) as one:
        yield one


def bearer(user: users.User) -> dict[str, str | None]:
    """What a program of a user sends."""
    return BARE | {"Authorization": f"Bearer {user.token}"}


def cookie(served: Server, user: users.User) -> dict[str, str | None]:
    return {"Cookie": f"drift-{served.port}={user.cookie}"}


def log_of(served: Server) -> list[dict[str, Any]]:
    lines = (served.folder / desk_log.NAME).read_text(encoding="utf-8").splitlines()
    return [json.loads(line) for line in lines]


WRONG = {
    "empty": "Bearer ",
    "no word": "",
    "another start's": f"Bearer {users.User().token}",
    "in another case": f"Bearer {ANNA.token.swapcase()}",
    "its beginning": f"Bearer {ANNA.token[:-1]}",
    "with a tail": f"Bearer {ANNA.token}x",
    "the cookie": f"Bearer {ANNA.cookie}",
    "a name": "Bearer ANNA",
    "another way": f"Basic {ANNA.token}",
    "two at once": f"Bearer {ANNA.token}, Bearer {BEN.token}",
    "letters beyond ASCII": "Bearer \xe9\xff",
    "two headers": f"Bearer {ANNA.token}\r\nAuthorization: Bearer {ANNA.token}",
}


@pytest.mark.parametrize("which", WRONG)
def test_a_wrong_token_is_none(running: Server, which: str) -> None:
    """Also with the right cookie: the token alone counts."""
    for more in (BARE, cookie(running, ANNA)):
        changes = more | {"Authorization": WRONG[which]}
        assert running.ask("GET", "/api/folder", **changes)[0] == 401
        status = running.ask("POST", "/api/cases/x.toml", NEW, **changes)[0]
        assert status in (401, 403)
    assert not (running.folder / "x.toml").exists()


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, 200),
        ({"Authorization": f"bearer  {ANNA.token}"}, 200),
        ({"Host": "evil.example"}, 421),
        ({"Origin": "http://evil.example"}, 403),
        ({"Sec_Fetch_Site": "cross-site"}, 403),
        ({"Content_Type": "text/plain"}, 415),
        ({"Content_Length": None}, 411),
    ],
)
def test_a_program_with_a_token(running: Server, changes: dict[str, str], expected: int) -> None:
    """It needs no cookie and no origin, but a foreign origin or host is rejected as ever."""
    given = bearer(ANNA) | changes
    status = running.ask("POST", "/api/forcing", {"file": None}, **given)[0]
    assert status == expected
    assert running.ask("OPTIONS", "/api/forcing", None, **given)[0] in (405, 421)


def test_a_guest_changes_nothing(running: Server) -> None:
    """Of all POST requests of the interface only those that change nothing are open to a guest."""
    before = sorted(one.name for one in running.folder.iterdir())
    refused, taken = set(), set()
    for path, operations in running.contract.document["paths"].items():
        if "post" not in operations:
            continue
        asked = path.replace("{name}", "case.toml").replace("{number}", "1")
        for who in (bearer(PRESS), cookie(running, PRESS)):
            status, _, data = running.ask("POST", asked, {}, **who)
            if operations["post"]["x-guests"]:
                taken.add(path)
                assert status in (200, 400)
            else:
                refused.add(path)
                line = "PRESS is a guest here: guests may read, but not change"
                assert (status, json.loads(data)) == (403, {"error": line})
    assert {"/api/cases/{name}", "/api/jobs", "/api/jobs/{number}/cancel", "/api/shipped/{name}", "/api/sketch"} <= refused  # fmt: skip
    assert {"/api/form", "/api/check", "/api/coast"} <= taken
    assert sorted(one.name for one in running.folder.iterdir()) == before
    for path in ("/", "/api/folder", "/api/cases/case.toml", "/api/jobs"):
        assert running.ask("GET", path, **bearer(PRESS))[0] == 200
    assert running.ask("GET", "/api/log", **bearer(PRESS))[0] == 403


def test_what_one_does_the_others_learn(running: Server) -> None:
    """Who it was, in the log and in the news; guests learn what, not who."""

    def news(user: users.User, after: int) -> Any:
        return json.loads(running.ask("GET", f"/api/news/{after}", **bearer(user))[2])

    last = news(BEN, 0)["last"]
    status, _, data = running.ask("POST", "/api/cases/new.toml", NEW, **cookie(running, ANNA))
    assert status == 200
    digest = json.loads(data)["digest"]
    (entry,) = news(BEN, last)["entries"]
    told = {key: entry[key] for key in ("user", "action", "case", "digest", "result")}
    expected = {"user": "ANNA", "action": "saved", "case": "new.toml", "digest": digest, "result": None}  # fmt: skip
    assert told == expected
    assert log_of(running)[-1].items() >= expected.items()
    assert abs(time.time() - time.mktime(time.strptime(entry["time"], "%Y-%m-%dT%H:%M:%SZ")) + time.timezone) < 60  # fmt: skip
    assert news(PRESS, last)["entries"][0]["user"] == ""
    assert news(BEN, entry["number"])["entries"] == []
    assert (news(BEN, 0)["you"], news(PRESS, 0)["guest"]) == ("BEN", True)
    # both have read it: the second one to save gets an error, and the text of the first stays
    for user, text, expected_status in ((BEN, "title = 'b'", 200), (ANNA, "title = 'a'", 409)):
        body = {"text": text, "digest": digest}
        status = running.ask("POST", "/api/cases/new.toml", body, **bearer(user))[0]
        assert status == expected_status
    assert (running.folder / "new.toml").read_text(encoding="utf-8") == "title = 'b'"
    assert [one["user"] for one in log_of(running)[-2:]] == ["ANNA", "BEN"]
    shown = json.loads(running.ask("GET", "/api/log", **bearer(BEN))[2])["entries"]
    assert shown == log_of(running)[: -desk_log.SHOWN - 1 : -1]


def test_jobs_have_their_users(running: Server) -> None:
    body = {"kind": "run", "case": "case.toml", "digest": "0" * 64}  # of another version: it fails
    job = json.loads(running.ask("POST", "/api/jobs", body, **bearer(BEN))[2])
    assert job["user"] == "BEN"
    end = time.monotonic() + 10
    while log_of(running)[-1]["action"] != "failed run":
        assert time.monotonic() < end
        time.sleep(0.02)
    lines = log_of(running)[-2:]
    assert [(one["user"], one["action"]) for one in lines] == [("BEN", "started run"), ("BEN", "failed run")]  # fmt: skip


def test_the_log_is_not_a_file_of_the_page(running: Server) -> None:
    """It is the owner's alone, has no token, and each address is entered by its own user."""
    status, headers, _ = running.ask("GET", f"/?token={BEN.token}", Cookie=None)
    assert (status, BEN.cookie in headers["set-cookie"]) == (303, True)
    assert (log_of(running)[-1]["user"], log_of(running)[-1]["action"]) == ("BEN", "entered")
    place = running.folder / desk_log.NAME
    assert stat.S_IMODE(place.stat().st_mode) == 0o600
    words = place.read_text(encoding="utf-8")
    for user in (ANNA, BEN, PRESS):
        assert user.token not in words
        assert user.cookie not in words
    for path in (f"/{desk_log.NAME}", f"/api/cases/{desk_log.NAME}", f"/assets/{desk_log.NAME}"):
        assert running.ask("GET", path, **bearer(ANNA))[0] == 404
    key = running.secret.key(".")
    assert running.ask("GET", f"/runs/./{key}/{desk_log.NAME}", **bearer(ANNA))[0] in (401, 404)


def test_a_log_that_is_damaged_or_a_trap(tmp_path: Path) -> None:
    """A half line stays apart, other lines are left out; a link is not followed, and work goes on."""
    place = tmp_path / desk_log.NAME
    place.write_bytes(b'{"time": "x", "user": 1, "action": ""}\n[]\n\xff\n{"time": "half')
    log = desk_log.DeskLog(tmp_path)
    log.add("ANNA", "saved", case="a.toml")
    assert [entry["case"] for entry in log.end()] == ["a.toml"]
    assert place.read_bytes().startswith(b'{"time": "x"')
    place.write_bytes(b"x" * desk_log.END + b"\n")
    for k in range(desk_log.SHOWN + 5):
        log.add("BEN", f"did {k}")
    shown = [entry["action"] for entry in log.end()]
    assert shown == [f"did {k}" for k in range(desk_log.SHOWN + 4, 4, -1)]
    place.unlink()
    (tmp_path / "other").write_text("safe", encoding="utf-8")
    place.symlink_to(tmp_path / "other")
    log.add("ANNA", "saved", case="b.toml")
    assert "cannot be written" in log.trouble
    assert (tmp_path / "other").read_text(encoding="utf-8") == "safe"
    assert log.since(0)[-1]["case"] == "b.toml"
    place.unlink()
    os.mkfifo(place)  # who opens it waits for one who reads
    log.add("ANNA", "saved")
    assert "cannot be written" in log.trouble


def test_another_program_in_the_log_is_noticed(tmp_path: Path) -> None:
    """A line that is added, one rewritten with the same length and times, and the file removed."""
    log, place = desk_log.DeskLog(tmp_path), tmp_path / desk_log.NAME

    def rewritten() -> None:
        before = place.stat()
        place.write_bytes(place.read_bytes().replace(b"ANNA", b"ANNE"))
        os.utime(place, ns=(before.st_atime_ns, before.st_mtime_ns))

    def added() -> None:
        place.write_bytes(place.read_bytes() + b'{"time": "x", "user": "EVE", "action": "saved"}\n')

    for k, change in enumerate((added, rewritten, place.unlink)):
        log.add("ANNA", f"did {k}")
        log.add("ANNA", f"did {k} more")
        time.sleep(0.02)  # longer than a tick of the clock of files
        change()
        log.add("BEN", f"saw {k}")
        log.add("BEN", f"saw {k} again")
    told = [(one["user"], one["action"]) for one in log.since(0)]
    for k in range(3):
        before = told.index(("ANNA", f"did {k} more"))
        assert told[before + 1 : before + 3] == [("drift", desk_log.FOREIGN), ("BEN", f"saw {k}")]
    assert sum(action == desk_log.FOREIGN for _, action in told) == 3
    time.sleep(0.02)
    added()
    assert [one["action"] for one in log.end()[:2]] == [desk_log.FOREIGN, "saved"]


@pytest.mark.thorough
def test_the_description_is_whole_and_valid(running: Server) -> None:
    """It is valid OpenAPI 3.1, has every route but the page's own, and the check notices a lie."""
    document = running.contract.document
    validate(document)
    told = {(path, method) for path, operations in document["paths"].items() for method in operations}  # fmt: skip
    routes = {
        (route.path.replace(":int", ""), method.lower())
        for route in running.routes
        for method in route.methods - {"HEAD"}
        if route.path not in ("/", "/assets/{name}")
    }
    assert told == routes
    for method, path, sent, got in (("GET", "/api/jobs", b"", b'{"jobs": [{}]}'), ("POST", "/api/check", b"{}", b'{"messages": []}')):  # fmt: skip
        with pytest.raises(jsonschema.ValidationError):
            running.contract.check(method, path, 200, sent, got)


def test_fifty_clients_at_once(running: Server) -> None:
    """All are answered, and each asks for three things."""
    told: list[int] = []

    def client() -> None:
        for path in ("/api/news/0", "/api/folder", "/api/jobs"):
            told.append(running.ask("GET", path, **bearer(ANNA))[0])

    clients = [threading.Thread(target=client) for _ in range(50)]
    for one in clients:
        one.start()
    for one in clients:
        one.join()
    assert told == [200] * 150


@pytest.mark.parametrize(
    ("given", "guests", "line"),
    [
        (["ANNA", "ANNA"], [], "is given twice"),
        (["ANNA"], ["ANNA"], "is given twice"),
        ([""], [], "a name has letters"),
        (["x" * 41], [], "at most 40"),
        (["ANNA "], [], "a name has letters"),
        ([], ["<b>"], '--guest "<b>": a name has'),
        (["a\nb"], [], "a name has letters"),
    ],
)
def test_names_that_are_none(given: list[str], guests: list[str], line: str) -> None:
    with pytest.raises(UserError, match=line):
        users.users_of(given, guests)


def test_who_is_there_by_default() -> None:
    """One user; guests alone do not shut the owner out."""
    assert [(one.name, one.guest) for one in users.users_of([], [])] == [("user", False)]
    both = users.users_of([], ["PRESS"])
    assert [(one.name, one.guest) for one in both] == [("user", False), ("PRESS", True)]
    secrets = {value for one in both for value in (one.token, one.cookie)}
    assert len(secrets) == 4
