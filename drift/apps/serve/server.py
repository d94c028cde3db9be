"""The server of the desk: its address, its limits, and what it prints."""

import errno
import os
import socket
import webbrowser
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

from drift.apps.serve.charts import open_chart
from drift.apps.serve.jobs import GIB, Limits
from drift.apps.serve.users import Secret, users_of
from drift.apps.serve.webhook import parse as parse_webhook
from geo.errors import UserError
from geo.files import fence
from kernels.runtime import devices, drivers

HOST, PORT = "127.0.0.1", 8765
NEXT = 20  # ports that are tried after PORT
CONNECTIONS = 100  # most at once
REASONS = {
    errno.EADDRINUSE: "is in use",
    errno.EACCES: "needs privileges, as most below 1024 do",
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
    user: Sequence[str] = (),
    guest: Sequence[str] = (),
    webhook: str | None = None,
    chart: Sequence[str | os.PathLike[str]] = (),
    browser: bool = True,
    say: Callable[[str], object] = print,
) -> None:
    """Serve a folder of cases and results as a page for this machine's browser, until interrupted.

    Args:
        folder: folder of the cases and results; its jobs write nowhere else.
        host: address to listen on; by default only this machine can connect.
        port: None: 8765 or the next free one.
        allow: files and folders, besides the served one and that of DRIFT_DATA, that cases may
            read.
        allow_host: hosts that cases may open addresses at, "host" or "host:port".
        hours: longest time that a job may run [h].
        memory: most memory that a job may use [GiB]; None: that of the machine.
        backend: where particles of jobs are computed, as for `drift.run`.
        user: names of users; each gets an address of their own. (): one user.
        guest: names of guests, who may read but not change.
        webhook: address that gets a message when a run ends.
        chart: charts for the map: MBTiles or PMTiles files of images.
        browser: whether the browser is opened.
        say: prints a line.

    Raises:
        UserError: the folder, the port, the backend, a name, a chart or the webhook cannot be used,
            or the extra `serve` is not installed.
    """
    try:
        import uvicorn

        from drift.apps.serve import app as desk_app
    except ImportError as error:
        raise UserError(
            f"drift serve needs {error.name}; pip install -e '.[serve]' in the folder of drift's "
            "source"
        ) from None
    root = _folder(folder)
    allowed = _fence(root, allow, allow_host)
    if backend in devices.CARDS:
        devices.usable(drivers.ask(backend))
    limits = replace(_limits(hours, memory), backend=backend)
    secret = Secret(users_of(user, guest))
    hook = None if webhook is None else parse_webhook(webhook)
    charts = [open_chart(path) for path in chart]
    listener = _listen(host, port)
    with listener:
        bound_port = listener.getsockname()[1]
        host_in_url = f"[{host}]" if ":" in host else host
        host_names = (
            ["127.0.0.1", "localhost"]
            if host in ("127.0.0.1", "localhost")
            else [host_in_url.lower()]
        )
        places = [
            f"{name}:{bound_port}" for name in dict.fromkeys([host_in_url.lower(), *host_names])
        ]
        app = desk_app.make(root, tuple(places), secret, allowed, limits, hook, charts)
        addresses = [
            f"http://{host_in_url}:{bound_port}/?token={one.token}" for one in secret.users
        ]
        if host not in LOOPBACK:
            say(
                f"drift: warning: other machines can reach {host}: anyone with an address below "
                "can work here as its user, "
                "and the connection is not encrypted"
            )
        opening = [
            f"{one.name}{' (guest)' if one.guest else ''}: {address}"
            for one, address in zip(secret.users, addresses, strict=True)
        ]
        listed = "\n".join(opening) if len(opening) > 1 or user else f"Open {addresses[0]}"
        say(f"Serving {root}\n{listed}\nCtrl-C ends it, and every run with it")
        if browser:
            webbrowser.open(addresses[0])
        uvicorn.Server(configured(app)).run(sockets=[listener])


def configured(app: Any) -> Any:
    """Return uvicorn's configuration: no log, as it would contain the token, and short timeouts."""
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
            f'folder "{str(folder)[:300]}": does not exist; create it, or name another'
        ) from None
    if not place.is_dir():
        raise UserError(f'"{folder}" is not a folder; name the one that contains your cases')
    if not os.access(place, os.R_OK | os.W_OK | os.X_OK):
        raise UserError(f'folder "{folder}": cannot be read and written; name another')
    return place


def _fence(
    folder: Path, allow: Sequence[str | os.PathLike[str]], hosts: Sequence[str]
) -> fence.Fence:
    """Return the files and hosts that jobs may read; they write into the served folder only."""
    folders = [folder, Path(str(resources.files("cases"))).resolve()]
    if data := os.environ.get("DRIFT_DATA"):
        folders.append(Path(data).resolve())
    for path in allow:
        try:
            folders.append(Path(path).expanduser().resolve(strict=True))
        except (OSError, RuntimeError, ValueError):
            raise UserError(f'--allow "{str(path)[:300]}": does not exist') from None
    for host in hosts:
        if not fence.PLACE.fullmatch(host):
            raise UserError(
                f'--allow-host "{host[:300]}": is not a host, like thredds.met.no or localhost:8080'
            )
    return fence.Fence(
        tuple(folders), frozenset(host.lower() for host in hosts), writable=(folder,)
    )


def _limits(hours: float, memory: float | None) -> Limits:
    """Return the limits of a job."""
    if not 0 < hours < float("inf"):
        raise UserError(f"--hours {hours:g}: must be more than 0")
    if memory is not None and not LEAST_MEMORY <= memory < float("inf"):
        raise UserError(
            f"--memory {memory:g}: must be at least {LEAST_MEMORY:g} (GiB), which a small run needs"
        )
    if memory is None:
        try:
            memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / GIB
        except (AttributeError, ValueError, OSError):  # Windows has no such limit
            memory = float("inf")
    return Limits(hours, memory)


def _listen(host: str, port: int | None) -> socket.socket:
    """Return a listening socket, on the given port or on the first free one from PORT."""
    if port is not None and not 1 <= port <= 65535:
        raise UserError(f"--port {port}: must be from 1 to 65535")
    try:
        found: Any = socket.getaddrinfo(host, port or PORT, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        raise UserError(f'--host "{host[:300]}": no such host') from None
    family, kind, protocol, _, address = found[0]
    # requests name the address that they are sent to, so it must be known
    if address[0] in ("0.0.0.0", "::"):
        raise UserError(
            f"--host {host}: name one address or name of this machine, which the browser will use"
        )
    for number in [port] if port is not None else range(PORT, PORT + NEXT + 1):
        listener = socket.socket(family, kind, protocol)
        try:
            if os.name == "posix":
                listener.setsockopt(
                    socket.SOL_SOCKET, socket.SO_REUSEADDR, 1
                )  # allows a port that was just closed, not one in use
            listener.bind((address[0], number, *address[2:]))
            listener.listen(128)
            return listener
        except OSError as error:
            listener.close()
            if error.errno not in {errno.EADDRINUSE, errno.EACCES} or port is not None:
                reason = REASONS.get(error.errno or 0, f"cannot be used ({error.strerror})")
                raise UserError(
                    f"port {number} of {host} {reason}; give another with --port"
                ) from None
    raise UserError(
        f"ports {PORT} to {PORT + NEXT} of {host} are not available; give another with --port"
    )
