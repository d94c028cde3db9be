"""The message to an address when a run ends, and the examples for other programs."""

import asyncio
import json
import os
import re
import shutil
import socket
import subprocess
import threading
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import small_case
from desks import Server, until

from drift.apps.serve import desk_log, users, webhook
from geo.errors import UserError

DOCS = Path(__file__).parents[3] / "docs" / "serve.md"


class Listener:
    """A server on the loopback that takes one request after the other, and gives one answer."""

    def __init__(self, answer: bytes | None) -> None:
        self.answer, self.requests = answer, list[bytes]()
        self._socket = socket.socket()
        self._socket.bind(("127.0.0.1", 0))
        self._socket.listen()
        self.address = f"http://127.0.0.1:{self._socket.getsockname()[1]}"
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        while True:
            try:
                line, _ = self._socket.accept()
            except OSError:
                return
            data = b""
            while b"}" not in data and (piece := line.recv(65536)):
                data += piece
            self.requests.append(data)
            if self.answer is None:
                threading.Event().wait(2)
            else:
                line.sendall(self.answer)
            line.close()

    def close(self) -> None:
        self._socket.close()


def test_a_run_that_ends_is_told(tmp_path: Path) -> None:
    (tmp_path / "case.toml").write_text(small_case.STEADY, encoding="utf-8")
    people = (users.User("ANNA"),)
    with closing(Listener(b"HTTP/1.1 204 No Content\r\n\r\n")) as there:
        hook = webhook.parse(f"{there.address}/hook?key=SECRET")
        with Server(tmp_path.resolve(), people=people, hook=hook) as served:
            body = {"kind": "run", "case": "case.toml", "digest": "0" * 64}
            served.json("POST", "/api/jobs", body)
            until(lambda: there.requests, 10)
    head, _, content = there.requests[0].partition(b"\r\n\r\n")
    assert head.startswith(b"POST /hook?key=SECRET HTTP/1.1\r\n")
    told = json.loads(content)
    expected = {"kind": "run", "case": "case.toml", "user": "ANNA", "state": "failed", "result": None}  # fmt: skip
    assert told.items() >= expected.items()
    assert "SECRET" not in (tmp_path / desk_log.NAME).read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("answer", "line"),
    [
        (b"HTTP/1.1 200 OK\r\n\r\n" + b"x" * 100_000, ""),
        (b"HTTP/1.1 500 Oh\r\n\r\n", "the answer was 500"),
        (b"gopher", "the answer is not HTTP"),
        (b"", "the answer is not HTTP"),
        (None, "no answer within 0.2 s"),
    ],
)
def test_what_an_answer_is_taken_for(
    answer: bytes | None, line: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(webhook, "TIMEOUT", 0.2)
    with closing(Listener(answer)) as there:
        assert asyncio.run(webhook.parse(there.address).post({})) == line


@pytest.mark.thorough
def test_a_silent_address_does_not_hold_up_the_end(tmp_path: Path) -> None:
    """The server ends although no answer comes; the thread that still waits is no reason to stay."""
    (tmp_path / "case.toml").write_text(small_case.STEADY, encoding="utf-8")
    with closing(socket.socket()) as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()  # who connects waits for an answer
        hook = webhook.parse(f"http://127.0.0.1:{silent.getsockname()[1]}/")
        with Server(tmp_path.resolve(), hook=hook) as served:
            body = {"kind": "run", "case": "case.toml", "digest": "0" * 64}
            served.json("POST", "/api/jobs", body)
            silent.settimeout(10)
            line, _ = silent.accept()
            begun = time.monotonic()
        assert time.monotonic() - begun < webhook.TIMEOUT / 2
        line.close()
    waiting = [one for one in threading.enumerate() if one.name == webhook.THREAD]
    assert all(one.daemon for one in waiting)


def test_no_redirect_is_followed() -> None:
    with closing(Listener(b"HTTP/1.1 200 OK\r\n\r\n")) as other:
        moved = f"HTTP/1.1 307 Moved\r\nLocation: {other.address}/\r\n\r\n".encode()
        with closing(Listener(moved)) as there:
            assert asyncio.run(webhook.parse(there.address).post({})) == "the answer was 307"
        assert other.requests == []


def test_nobody_there(tmp_path: Path) -> None:
    """Work goes on, and the log has a line."""
    with closing(socket.socket()) as taken:
        taken.bind(("127.0.0.1", 0))
        hook = webhook.parse(f"http://127.0.0.1:{taken.getsockname()[1]}/SECRET")
        (tmp_path / "case.toml").write_text(small_case.STEADY, encoding="utf-8")
        with Server(tmp_path.resolve(), hook=hook) as served:
            body = {"kind": "run", "case": "case.toml", "digest": "0" * 64}
            served.json("POST", "/api/jobs", body)
            log = tmp_path / desk_log.NAME
            until(lambda: "webhook failed" in log.read_text(encoding="utf-8"), 10)
            assert served.json("GET", "/api/folder")["cases"]
    words = log.read_text(encoding="utf-8")
    assert "Connection refused" in words
    assert "SECRET" not in words


@pytest.mark.parametrize(
    "address",
    ["", "x", "ftp://a/", "file:///etc/passwd", "http://", "http://a:x/", "http://user:word@a/", "http://a/ b", "http://a/\r\nHost: b", "http://é/"],
)  # fmt: skip
def test_addresses_that_are_none(address: str) -> None:
    with pytest.raises(UserError, match=r"^--webhook: give an address like https://host/path"):
        webhook.parse(address)


@pytest.mark.thorough
def test_the_examples_with_curl(tmp_path: Path) -> None:
    """Those of docs/serve.md, in order; each answers with what its comment says."""
    if shutil.which("curl") is None:
        pytest.skip("curl is not installed")
    blocks = re.findall(r"```bash\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.DOTALL)
    commands = [line for block in blocks for line in block.splitlines() if line[:4] == "curl"]
    told: list[Any] = []
    with Server(tmp_path.resolve(), people=(users.User("ANNA"),)) as served:
        own = {"ADDRESS": f"http://{served.host}", "TOKEN": served.secret.token}
        for command in commands:
            done = subprocess.run(
                ["bash", "-c", command], env=os.environ | own, capture_output=True, timeout=90
            )
            told.append(json.loads(done.stdout))
    folder, saved, read, mistakes, jobs, log = told
    assert folder["cases"] == []
    assert read == {"name": "from_curl.toml", "text": 'title = "From curl"\n', "digest": saved["digest"]}  # fmt: skip
    assert mistakes["messages"]
    assert jobs == {"jobs": []}
    assert [(one["user"], one["action"], one["case"]) for one in log["entries"]] == [("ANNA", "saved", "from_curl.toml")]  # fmt: skip
