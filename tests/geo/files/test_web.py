"""Questions to web servers, against servers on this machine: bounds in time and size, words,
passwords and other addresses.
"""

import base64
import socket
import time
import urllib.request
from pathlib import Path

import hostile
import pytest
from pace import Watch

from geo.errors import UserError
from geo.files import fence, web

ANN = f"Basic {base64.b64encode(b'ann:sesame').decode()}"


@pytest.fixture(autouse=True)
def known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A netrc with names and passwords of two machines."""
    monkeypatch.setenv("HOME", str(tmp_path))
    lines = (
        f"machine {machine} login ann password sesame\n"
        for machine in ("sea.example.org", "127.0.0.1")
    )
    (tmp_path / ".netrc").write_text("".join(lines))
    (tmp_path / ".netrc").chmod(0o600)


def test_an_answer_that_drips_is_given_up() -> None:
    def drip(connection: socket.socket, target: str) -> None:
        connection.sendall(b"HTTP/1.1 200 OK\r\n\r\n")
        for _ in range(200):
            connection.sendall(b".")
            time.sleep(0.03)

    with hostile.serving(drip) as address:
        watch = Watch()
        with pytest.raises(web.TemporaryError, match="sends too slowly"):
            web.get_address(address, 0.1, 10_000)
        assert watch.seconds() < 4  # 1 s; 6 s to the end of the answer


def test_an_answer_may_be_so_large_and_no_larger() -> None:
    with hostile.serving(
        lambda connection, target: connection.sendall(hostile.http(b"x" * 50))
    ) as address:
        assert web.get_address(address, 5.0, 50) == b"x" * 50
        with pytest.raises(UserError, match="more than the 49 bytes"):
            web.get_address(address, 5.0, 49)


@pytest.mark.parametrize(
    ("status", "passing", "words"),
    [
        (400, False, "rejects the request"), (401, False, "asks for credentials"), (403, False, "asks for credentials"),
        (404, False, "is not there"), (410, False, "is not there"), (413, False, "request as too large"),
        (429, True, "failed"), (500, True, "failed"), (503, True, "failed"),
    ],
)  # fmt: skip
def test_what_stays_and_what_may_pass(status: int, passing: bool, words: str) -> None:
    with hostile.serving(
        lambda connection, target: connection.sendall(hostile.http(b"", f"{status} No"))
    ) as address:
        with pytest.raises((web.TemporaryError, UserError), match=words) as refused:
            web.get_address(address, 5.0, 100)
        assert isinstance(refused.value, web.TemporaryError) == passing


@pytest.mark.parametrize(
    ("address", "told"),
    [
        ("https://sea.example.org/x", True),
        ("http://sea.example.org/x", False),  # anybody on the way could read it
        ("http://127.0.0.1:8080/x", True),
        ("https://other.example.org/x", False),
    ],
)
def test_passwords_go_to_their_machine_and_not_in_the_clear(
    address: str, told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[urllib.request.Request] = []

    class Opener:
        def open(self, request: urllib.request.Request, timeout: float) -> None:
            asked.append(request)
            raise OSError("that is enough")

    monkeypatch.setattr(web, "_opener", Opener)
    with pytest.raises(web.TemporaryError, match="that is enough"):
        web.get_address(address, 1.0, 10)
    assert asked[0].get_header("Authorization") == (ANN if told else None)


def test_a_redirect_leads_nowhere_that_may_not_be_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[str] = []

    def second(connection: socket.socket, target: str) -> None:
        seen.append(target)
        connection.sendall(hostile.http(b"secret"))

    with hostile.serving(second) as away:
        redirect = hostile.http(b"", "302 Found", f"Location: {away}")
        with hostile.serving(lambda connection, target: connection.sendall(redirect)) as address:
            assert web.get_address(address, 5.0, 100) == b"secret"
            host = address.split("/")[2]
            monkeypatch.setenv(fence.NAME, fence.fence_text(fence.Fence((), frozenset({host}))))
            seen.clear()
            with pytest.raises(UserError, match="may not be asked"):
                web.get_address(address, 5.0, 100)
    assert not seen
