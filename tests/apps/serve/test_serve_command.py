"""The command drift serve: ports and folders that it cannot use are one line."""

import errno
import os
import socket
import sys
from contextlib import closing
from pathlib import Path

import pytest

import drift
from drift.apps.cli import commands
from drift.apps.serve import server
from geo.errors import UserError
from geo.files import fence


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


def test_each_name_gets_an_address(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each has a token of its own; names and webhooks that are none are a line."""
    import uvicorn

    monkeypatch.setattr(uvicorn.Server, "run", lambda self, sockets: None)
    said: list[str] = []
    drift.serve(tmp_path, user=["ANNA"], guest=["PRESS"], browser=False, say=said.append)
    lines = "\n".join(said).splitlines()
    found = [line.split("?token=") for line in lines if "?token=" in line]
    assert [words.split(":")[0] for words, _ in found] == ["ANNA", "PRESS (guest)"]
    assert len({token for _, token in found}) == 2
    assert all(len(token) >= 43 for _, token in found)
    with pytest.raises(UserError, match="a name has letters"):
        drift.serve(tmp_path, user=["<"], browser=False)
    with pytest.raises(UserError, match="give an address like"):
        drift.serve(tmp_path, webhook="nowhere", browser=False)
