"""What a text, a number or a full disk must not do: break a request, or end the process of all."""

import fcntl
import json
import os
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from desks import Server

from drift.apps.serve.answers import process
from geo.errors import UserError

DIGITS = "1" + "0" * 400  # beyond floating point
HUGE: dict[str, tuple[str, str]] = {
    "a step": ("coast", f'{{"box": [0, 0, 1, 1], "step": {DIGITS}}}'),
    "a box": ("coast", f'{{"box": [0, 0, {DIGITS}, 1], "step": 0.1}}'),
    "a place": ("result/value", f'{{"run": "a", "scenario": null, "time": 0, "at": [{DIGITS}, 0]}}'),
    "an angle": ("plan/pos", f'{{"run": "a", "moves": {{"A": {{"at": [1, 2], "turned": {DIGITS}}}}}}}'),
    "no field": ("form/set", '{"text": "", "changes": [{"field": ["title"], "value": 1}]}'),
}  # fmt: skip


@pytest.mark.parametrize("name", HUGE)
def test_numbers_beyond_floating_point(served: Server, name: str) -> None:
    path, body = HUGE[name]
    status, _, data = served.ask("POST", f"/api/{path}", body.encode())
    assert status == 400, data


VALUES = ("nan", "inf", "-inf", "1e999", f"0x{'f' * 16}", f"0x{'f' * 9000}", "[nan, inf]")
TEXTS = {
    "a title": "title = {}",
    "a number": "[spill]\nobjects = {}",
    "rows of a class": "[spill]\nclass = {}",
    "a share": "[spill]\nobjects = 5\n[[spill.class]]\nshare = {}",
    "finds": "find = {}",
    "a place of a find": "[[find]]\nat = {}\nradius = {}",
    "a start": "start = {}\n[[sortie]]\nstart = {}",
    "a wind": "[[wind]]\nconstant = {{ speed = {}, from = {} }}",
}


def line_of(do: str, text: str) -> str:
    """The line that the process answers."""
    request = {"id": 1, "do": do, "text": text, "path": "/nowhere/case.toml", "spill": True}
    return process._line(1, process._answer(request, threading.Event()))


@pytest.mark.parametrize("where", TEXTS)
def test_numbers_that_json_has_not(where: str) -> None:
    """Such a value stays in the text, and the form shows the others; the check has its mistakes."""

    def refused(name: str) -> Any:
        raise AssertionError(name)

    for value in (*VALUES, "1", "true", "[[]]"):
        text = "particles = 500\n" + TEXTS[where].replace("{}", value).replace("{{", "{").replace("}}", "}")  # fmt: skip
        for do in ("form", "spill", "search", "check", "spill/turn"):
            told = json.loads(line_of(do, text), parse_constant=refused)
            if do == "spill/turn":
                assert told.keys() <= {"id", "answer", "error"}
                continue
            assert "answer" in told, (do, text[:80], told)
            if do == "form":
                assert told["answer"]["fields"]["particles"]["value"] == 500
            if do == "check":
                assert told["answer"]["messages"]


def test_a_title_that_is_no_text() -> None:
    fields = {value: json.loads(line_of("form", f"title = {value}"))["answer"]["fields"] for value in VALUES[:6]}  # fmt: skip
    assert all(one["title"] == {"in_text": True} for one in fields.values())


def test_what_nobody_thought_of_is_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """The process answers the next request; only a lack of memory ends it."""

    given: list[BaseException] = []

    def broken(request: Any, tell: Any) -> Any:
        raise given.pop()

    monkeypatch.setitem(process.ANSWERS, "form", broken)
    for error in (KeyError("secret"), RecursionError(), UserError("a line"), OSError(5, "secret")):
        given.append(error)
        told = json.loads(line_of("form", ""))
        assert told.keys() == {"id", "error"}
        assert "secret" not in told["error"]
    monkeypatch.setitem(process.ANSWERS, "form", lambda request, tell: {"value": float("nan")})
    assert "cannot show" in json.loads(line_of("form", ""))["error"]
    monkeypatch.setitem(process.ANSWERS, "form", broken)
    given.append(MemoryError())
    with pytest.raises(MemoryError):
        line_of("form", "")


def test_a_broken_request_is_a_line_of_json(
    served: Server, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """With all headers, as any other answer."""

    def broken(*_: Any) -> Any:
        raise RuntimeError("secret")

    monkeypatch.setattr("drift.apps.serve.desk_log.DeskLog.end", broken)
    status, headers, data = served.ask("GET", "/api/log")
    assert (status, list(json.loads(data))) == (500, ["error"])
    assert b"secret" not in data
    assert headers["content-security-policy"].startswith("default-src 'none'")
    capfd.readouterr()


def test_a_locked_folder_holds_up_nobody_else(served: Server) -> None:
    """While a save waits for another program, the server answers the others."""
    handle = os.open(served.folder, os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    told: list[int] = []
    body = {"text": "title = 1", "digest": None}
    waiting = threading.Thread(
        target=lambda: told.append(served.ask("POST", "/api/cases/locked.toml", body)[0])
    )
    waiting.start()
    time.sleep(0.2)
    assert served.ask("GET", "/api/news/0")[0] == 200
    assert told == []
    os.close(handle)
    waiting.join()
    assert told == [200]
    assert Path(served.folder / "locked.toml").read_text() == "title = 1"


def test_a_full_disk(served: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    """A track that cannot be saved gets its own message, and nothing of it is left."""

    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    before = sorted(os.listdir(served.folder))
    monkeypatch.setattr(os, "fsync", full)
    body = {"name": "ais.csv", "text": "time,lon,lat\n"}
    status, _, data = served.ask("POST", "/api/spill/track", body)
    line = "ais.csv cannot be saved: No space left on device"
    assert (status, json.loads(data)) == (500, {"error": line})
    assert sorted(os.listdir(served.folder)) == before
