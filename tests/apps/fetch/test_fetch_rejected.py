"""Every failure of a download is one line."""

import socket
import time
from collections.abc import Callable
from pathlib import Path

import hostile
import pytest
from ocean_servers import AXES, BEGIN, END, fetched, ocean

from drift.apps.fetch import fetching
from geo.errors import UserError


def wrong(how: Callable[[socket.socket, str], None], when: str) -> hostile.Answer:
    """Return a server that is good except for what ends so."""
    sea = ocean(*AXES["plain"][:2])

    def answer(connection: socket.socket, target: str) -> None:
        if when in target.partition("?")[0]:
            how(connection, target)
        else:
            connection.sendall(hostile.good(sea, target))

    return answer


PAGE = b"<!DOCTYPE html><html><body>Please log in</body></html>"
REFUSALS = {
    "credentials": (
        hostile.always(hostile.http(b"", "401 Unauthorized")),
        ".dds",
        "asks for credentials (401)",
    ),
    "no such name": (
        hostile.always(hostile.http(b"no", "404 Not Found")),
        ".dds",
        "is not there (404)",
    ),
    "down": (
        hostile.always(hostile.http(b"no", "503 Service Unavailable")),
        ".dds",
        "failed (503 Service Unavailable)",
    ),
    "error": (
        hostile.always(hostile.http(b"Error {};", "500 Internal Server Error")),
        ".dds",
        "failed (500",
    ),
    "web page": (
        hostile.always(hostile.http(PAGE, "200 OK", "Content-Type: text/html")),
        ".dds",
        "sent a web page",
    ),
    "half": (
        hostile.always(hostile.http(b"Dataset {" + b" " * 999)[:-500]),
        ".dds",
        "sent an incomplete answer",
    ),
    "no HTTP": (hostile.always(b"\x00\x01 hello"), ".dds", "broke off"),
    "silent": (hostile.silent, ".dds", "did not answer for 0.7 s"),
    "another server": (
        hostile.always(hostile.http(b'{"hello": 1}')),
        ".dds",
        "not as OPeNDAP does",
    ),
    "values fail": (
        hostile.always(hostile.http(b"Error {};", "500 Internal Server Error")),
        ".dods",
        "stopped after 5",
    ),
    "values are a page": (hostile.always(hostile.http(PAGE)), ".dods", "sent a web page"),
}


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(
            kind, marks=[pytest.mark.thorough] * (kind in ("values fail", "values are a page"))
        )
        for kind in REFUSALS
    ],
)
def test_each_failure_is_one_line(tmp_path: Path, kind: str) -> None:
    how, when, message = REFUSALS[kind]
    begin = time.monotonic()
    with hostile.serving(wrong(how, when)) as address, pytest.raises(UserError) as refusal:
        fetched(tmp_path, address, AXES["plain"][2], timeout=0.7 if kind == "silent" else 5.0)
    assert message in str(refusal.value)
    assert len(refusal.value.lines) == 1
    assert not (tmp_path / "out").exists()
    assert time.monotonic() - begin < 60


def test_nobody_there(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as door:
        port = door.getsockname()[1]
    with pytest.raises(
        UserError, match=r"cannot be reached \(.*refused\); stopped after 5 attempts"
    ):
        fetched(tmp_path, f"http://127.0.0.1:{port}/sea", AXES["plain"][2])


@pytest.mark.parametrize(
    ("trouble", "times", "said"),
    [
        (socket.EAI_NONAME, 1, "no host is named sea.invalid"),
        (socket.EAI_AGAIN, 5, "stopped after"),
    ],
)
def test_a_name_that_nobody_has_is_asked_for_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, trouble: int, times: int, said: str
) -> None:
    """A name server that does not answer may answer later; one that says that there is no such name
    will say it again.
    """
    asked = []

    def look_up(*what: object, **_: object) -> object:
        asked.append(what)
        raise socket.gaierror(trouble, "made up")

    monkeypatch.setattr(socket, "getaddrinfo", look_up)
    with pytest.raises(UserError, match=said):
        fetched(tmp_path, "http://sea.invalid/sea", AXES["plain"][2])
    assert len(asked) == times


def test_a_case_is_not_read_where_box_and_times_are_said(tmp_path: Path) -> None:
    """One without a scenario yet, say; a time that counts from its start needs it."""
    case = tmp_path / "half.toml"
    case.write_text('start = "2026-11-21T00:00Z"\n[[scenario]]\n', encoding="utf-8")
    span = "2026-11-21T00:00Z", "2026-11-22T00:00Z"
    box, begin, end = fetching.ordered_span(case, "4,59,7,61", *span)
    assert (box.west, box.north, f"{begin}Z", f"{end}Z") == (
        4,
        61,
        "2026-11-21T00:00:00Z",
        "2026-11-22T00:00:00Z",
    )
    for given in ((None, *span), ("4,59,7,61", None, span[1]), ("4,59,7,61", span[0], "+6 h")):
        with pytest.raises(UserError, match=r"half.toml: scenario 1.name: is missing"):
            fetching.ordered_span(case, *given)


def test_netrc_is_used_and_told_to_nobody(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Name and password of ~/.netrc open the door; neither files nor lines hold them."""
    import base64

    sea, heads = ocean(*AXES["plain"][:2]), []
    token = base64.b64encode(b"ann:sesame").decode()

    def answer(connection: socket.socket, target: str) -> None:
        connection.sendall(hostile.good(sea, target))

    with socket.create_server(("127.0.0.1", 0)) as door:
        import threading

        def accept() -> None:
            while True:
                try:
                    connection, _ = door.accept()
                except OSError:
                    return
                with connection:
                    request = b""
                    while b"\r\n\r\n" not in request and (part := connection.recv(65536)):
                        request += part
                    heads.append(request)
                    target = hostile.unquote(request.split()[1].decode()) if request else ""
                    if f"Basic {token}".encode() in request:
                        answer(connection, target)
                    else:
                        refusal = hostile.http(
                            b"", "401 Unauthorized", 'WWW-Authenticate: Basic realm="sea"'
                        )
                        connection.sendall(refusal)

        threading.Thread(target=accept, daemon=True).start()
        address = f"http://127.0.0.1:{door.getsockname()[1]}/sea"
        (tmp_path / ".netrc").write_text("machine 127.0.0.1 login ann password sesame\n")
        (tmp_path / ".netrc").chmod(0o600)
        got = fetched(tmp_path, address, AXES["plain"][2])
        (tmp_path / ".netrc").write_text("machine 127.0.0.1 login ann password wrong\n")
        with pytest.raises(UserError, match="asks for credentials") as refusal:
            fetched(tmp_path, address, AXES["plain"][2], out=tmp_path / "other")
    assert "wrong" not in str(refusal.value)
    assert all(b"sesame" not in path.read_bytes() for path in got.files)
    assert "sesame" not in "".join(capsys.readouterr())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"end": "2024-03-09T00:00Z"},
            "has 2024-03-01T00:00:00Z to 2024-03-03T23:00:00Z, not all of",
        ),
        ({"begin": "2024-02-01T00:00Z"}, "has 2024-03-01T00:00:00Z to"),
        (
            {"box": (100, 10, 110, 20)},
            "has nothing in this box: its grid goes from -30.00 to 30.00 E",
        ),
        ({"begin": END, "end": BEGIN}, "before it begins"),
        ({"largest": 10.0}, "more than the 10 bytes"),
        ({"providers": ["nobody"]}, "no such provider"),
        ({"quantities": ["wind"], "providers": ["trial"]}, "trial has no wind"),
        ({"box": (4, 61, 7, 59)}, "south must be less than north"),
    ],
)
def test_what_cannot_be_had_is_refused(
    tmp_path: Path, change: dict[str, object], message: str
) -> None:
    with hostile.serving(hostile.speaking_dap(ocean(*AXES["plain"][:2]))) as address:
        how = {"box": AXES["plain"][2], **change}
        with pytest.raises(UserError) as refusal:
            fetched(tmp_path, address, **how)
    assert message in str(refusal.value)
    assert not (tmp_path / "out").exists()
