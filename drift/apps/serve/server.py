"""The server of the desk: where it listens, what it prints, and its end."""

import errno
import os
import socket
import webbrowser
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

from drift.apps.serve.jobs import GIB, Limits
from geo.errors import UserError
from geo.files import fence
from kernels.runtime import devices, drivers

HOST, PORT = "127.0.0.1", 8765
NEXT = 20  # ports that are tried after PORT
CONNECTIONS = 100  # at most at once
REASONS = {
    errno.EADDRINUSE: "is in use",
    errno.EACCES: "is not yours to take, as those below 1024 mostly are not",
}
HOURS, LEAST_MEMORY = 12.0, 2.0  # [h], [GiB]
LOOPBACK = {"127.0.0.1", "localhost", "::1"}


def serve(
    folder: str | os.PathLike[str] = ".",
    *,
    host: str = HOST,
    port: int | None = None,
    allow: Sequence[str | os.PathLike[str]] = (),
    allow_host: Sequence[str] = (),
    hours: float = HOURS,
    memory: float | None = None,
    backend: str = "cpu",
    browser: bool = True,
    say: Callable[[str], object] = print,
) -> None:
    """Serve a folder of cases and results as a page for this machine's browser, until interrupted.

    Args:
        folder: of the cases and results; its jobs write nowhere else.
        host: where it listens, this machine alone by default.
        port: None: 8765 or the next free one.
        allow: files and folders, besides the served one and that of DRIFT_DATA, that cases may
            read.
        allow_host: hosts of addresses that cases may ask, "host" or "host:port".
        hours: the most that a job may take [h].
        memory: the most that a job may take [GiB]; None: what the machine has.
        backend: where particles of jobs move, as for `drift.run`.
        browser: whether it is opened.
        say: prints a line.

    Raises:
        UserError: the folder, the port or the backend cannot be used, or the extra `serve` is not
            installed.
    """
    try:
        import uvicorn

        from drift.apps.serve import app as desk_app
        from drift.apps.serve.gate import Secret
    except ImportError as error:
        raise UserError(
            f"drift serve needs {error.name}; pip install -e '.[serve]' where drift lies"
        ) from None
    place = _folder(folder)
    allowed = _allowed(place, allow, allow_host)
    if backend in devices.CARDS:
        devices.usable(drivers.ask(backend))
    limits = replace(_limits(hours, memory), backend=backend)
    listening = _listen(host, port)
    with listening:
        number = listening.getsockname()[1]
        shown = f"[{host}]" if ":" in host else host
        called = (
            ["127.0.0.1", "localhost"] if host in ("127.0.0.1", "localhost") else [shown.lower()]
        )
        places = [f"{name}:{number}" for name in dict.fromkeys([shown.lower(), *called])]
        secret = Secret()
        app = desk_app.make(place, tuple(places), secret, allowed, limits)
        address = f"http://{shown}:{number}/?token={secret.token}"
        if host not in LOOPBACK:
            say(
                f"drift: warning: {host} can be reached from other machines: who has the address below works here as you, "
                "and the line is not encrypted"
            )
        say(f"Serving {place}\nOpen {address}\nCtrl-C ends it, and every run with it")
        if browser:
            webbrowser.open(address)
        uvicorn.Server(configured(app)).run(sockets=[listening])


def configured(app: Any) -> Any:
    """Return uvicorn's configuration for an application: no log, which would hold the token, and no
    patience.
    """
    import uvicorn

    return uvicorn.Config(
        app,
        loop="asyncio",
        http="h11",
        ws="none",
        interface="asgi3",
        lifespan="on",
        log_level="error",
        access_log=False,
        server_header=False,
        proxy_headers=False,
        limit_concurrency=CONNECTIONS,
        timeout_keep_alive=15,
        timeout_graceful_shutdown=3,
        h11_max_incomplete_event_size=16384,
    )


def _folder(folder: str | os.PathLike[str]) -> Path:
    """Return the real path of a folder that can be read and written."""
    try:
        place = Path(folder).resolve(strict=True)
    except (OSError, RuntimeError, ValueError):
        raise UserError(
            f'folder "{str(folder)[:300]}": is not there; make it, or name another'
        ) from None
    if not place.is_dir():
        raise UserError(f'"{folder}" is no folder; name the one that holds your cases')
    if not os.access(place, os.R_OK | os.W_OK | os.X_OK):
        raise UserError(f'folder "{folder}": cannot be read and written; name another')
    return place


def _allowed(
    folder: Path, allow: Sequence[str | os.PathLike[str]], hosts: Sequence[str]
) -> fence.Fence:
    """Return what cases may read; results are written into the served folder."""
    folders = [folder, Path(str(resources.files("cases"))).resolve()]
    if data := os.environ.get("DRIFT_DATA"):
        folders.append(Path(data).resolve())
    for path in allow:
        try:
            folders.append(Path(path).expanduser().resolve(strict=True))
        except (OSError, RuntimeError, ValueError):
            raise UserError(f'--allow "{str(path)[:300]}": is not there') from None
    for host in hosts:
        if not fence.PLACE.fullmatch(host):
            raise UserError(
                f'--allow-host "{host[:300]}": is no host, like thredds.met.no or localhost:8080'
            )
    return fence.Fence(
        tuple(folders), frozenset(host.lower() for host in hosts), writable=(folder,)
    )


def _limits(hours: float, memory: float | None) -> Limits:
    """Return the most that a job may take."""
    if not 0 < hours < float("inf"):
        raise UserError(f"--hours {hours:g}: is more than 0")
    if memory is not None and not LEAST_MEMORY <= memory < float("inf"):
        raise UserError(
            f"--memory {memory:g}: is {LEAST_MEMORY:g} (GiB) at least, which a small run takes"
        )
    if memory is None:
        try:
            memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / GIB
        except (AttributeError, ValueError, OSError):  # Windows has no such limit
            memory = float("inf")
    return Limits(hours, memory)


def _listen(host: str, port: int | None) -> socket.socket:
    """Return a socket that listens, on the given port or from PORT on the first free one."""
    if port is not None and not 1 <= port <= 65535:
        raise UserError(f"--port {port}: is from 1 to 65535")
    try:
        found: Any = socket.getaddrinfo(host, port or PORT, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        raise UserError(f'--host "{host[:300]}": no such host') from None
    family, kind, protocol, _, address = found[0]
    # a request names the address that it was sent to: it must be known
    if address[0] in ("0.0.0.0", "::"):
        raise UserError(
            f"--host {host}: name one address or name of this machine, under which it will be asked"
        )
    for number in [port] if port is not None else range(PORT, PORT + NEXT + 1):
        listening = socket.socket(family, kind, protocol)
        try:
            if os.name == "posix":
                listening.setsockopt(
                    socket.SOL_SOCKET, socket.SO_REUSEADDR, 1
                )  # takes a port that was just left, not one in use
            listening.bind((address[0], number, *address[2:]))
            listening.listen(128)
            return listening
        except OSError as error:
            listening.close()
            if error.errno not in {errno.EADDRINUSE, errno.EACCES} or port is not None:
                reason = REASONS.get(error.errno or 0, f"cannot be used ({error.strerror})")
                raise UserError(
                    f"port {number} of {host} {reason}; give another with --port"
                ) from None
    raise UserError(
        f"ports {PORT} to {PORT + NEXT} of {host} cannot be taken; give another with --port"
    )
