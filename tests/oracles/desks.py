"""A desk (`drift serve`) on a free port of the loopback, and a client that can lie to it."""

import http.client
import json
import re
import socket
import threading
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import jsonschema
import uvicorn

from drift.apps.serve import app, charts, jobs, server, users, webhook
from drift.products.files import manifest

NASTY = "</script><img src=x onerror=alert(1)>"


class Contract:
    """The API's description: what is asked and answered must be as it says, by jsonschema."""

    def __init__(self, document: Any) -> None:
        self.document = document
        self._paths = [
            (re.compile(re.sub(r"\\{\w+\\}", "[^/]+", re.escape(path))), operations)
            for path, operations in document["paths"].items()
        ]

    def operation(self, method: str, path: str) -> Any:
        """Return the description of what a request asks for; None if there is none."""
        found = [one for pattern, one in self._paths if pattern.fullmatch(path)]
        return found[0].get(method.lower()) if found else None

    def check(self, method: str, path: str, status: int, sent: bytes, got: bytes) -> None:
        """Hold a request and its answer against the description."""
        told = self.operation(method, path)
        if told is None or path.startswith("/runs/"):
            return
        if status == 200 and method == "POST":
            self._valid(told["requestBody"], json.loads(sent))
        self._valid(told["responses"]["200" if status == 200 else "default"], json.loads(got))

    def _valid(self, part: Any, content: Any) -> None:
        schema = part["content"]["application/json"]["schema"]
        whole = schema | {"components": self.document["components"]}
        jsonschema.Draft202012Validator(whole).validate(content)


class Server:
    """A desk on a free port, and a client that can lie to it."""

    def __init__(
        self,
        folder: Path,
        limits: jobs.Limits = jobs.Limits(),  # noqa: B008
        *,
        people: tuple[users.User, ...] = (),
        hook: webhook.Webhook | None = None,
        chart: tuple[charts.Chart, ...] = (),
    ) -> None:
        self.folder, self.secret = folder, users.Secret(*[people] if people else [])
        self._contract: Contract | None = None
        self.socket = socket.socket()
        self.socket.bind(("127.0.0.1", 0))
        self.port = self.socket.getsockname()[1]
        self.host = f"127.0.0.1:{self.port}"
        allowed = server._fence(folder, [], ["thredds.example.org"])
        places = (self.host, f"localhost:{self.port}")
        made = app.make(folder, places, self.secret, allowed, limits, hook, chart)
        self.routes = made._app.routes  # what the gate passes on
        self._uvicorn = uvicorn.Server(server.configured(made))
        self._thread = threading.Thread(target=self._uvicorn.run, kwargs={"sockets": [self.socket]})

    def __enter__(self) -> "Server":
        self._thread.start()
        until(lambda: self._uvicorn.started, 20)
        self._contract = Contract(self.json("GET", "/api/openapi.json"))
        return self

    def __exit__(self, *_: object) -> None:
        self._uvicorn.should_exit = True
        self._thread.join(30)
        assert not self._thread.is_alive()
        self.socket.close()

    @property
    def own(self) -> dict[str, str]:
        """What our own page sends."""
        return {
            "Host": self.host, "Cookie": f"drift-{self.port}={self.secret.cookie}", "Origin": f"http://{self.host}",
            "Sec-Fetch-Site": "same-origin", "Content-Type": "application/json",
        }  # fmt: skip

    def ask(
        self, method: str, path: str, body: Any = None, **changes: str | None
    ) -> tuple[int, dict[str, str], bytes]:
        """Return status, headers and body; changes: of our own headers, None to leave one out."""
        data = (
            body if isinstance(body, bytes) else json.dumps({} if body is None else body).encode()
        )
        headers = self.own | {name.replace("_", "-"): value for name, value in changes.items()}
        if method == "POST":
            headers = {"Content-Length": str(len(data))} | headers
        lines = [
            f"{method} {path} HTTP/1.1",
            *(f"{name}: {value}" for name, value in headers.items() if value is not None),
        ]
        with closing(socket.create_connection(("127.0.0.1", self.port), 120)) as line:
            line.sendall("\r\n".join([*lines, "Connection: close", "", ""]).encode("latin-1") + (data if method == "POST" else b""))  # fmt: skip
            answer = http.client.HTTPResponse(line, method=method)
            answer.begin()
            given = {name.lower(): value for name, value in answer.getheaders()}
            got = answer.read()
        image = given.get("content-type", "").startswith("image/")
        file = "content-disposition" in given or image
        if self._contract is not None and method in ("GET", "POST") and not file:
            self._contract.check(method, path, answer.status, data, got)
        return answer.status, given, got

    @property
    def contract(self) -> Contract:
        """The description of the API."""
        assert self._contract is not None
        return self._contract

    def json(self, method: str, path: str, body: Any = None) -> Any:
        """Return what our own page would get."""
        status, _, data = self.ask(method, path, body)
        assert status == 200, data
        return json.loads(data)

    def job(self, number: int) -> Any:
        """Return a job as it is now."""
        return next(job for job in self.json("GET", "/api/jobs")["jobs"] if job["number"] == number)


def until(happened: Any, seconds: float) -> Any:
    """Wait until something is true, at most so long."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if found := happened():
            return found
        time.sleep(0.05)
    raise AssertionError(f"not in {seconds} s")


def mistakes(page: Any) -> int:
    """Return the number of mistakes that the form shows; that a case lies in the past is none."""
    shown: int = page.locator("#form .beside, #messages .wrong").count()
    return shown


def on_map(page: Any, value: str) -> Any:
    """Return what the module of the page's map has: an expression of `sea`, its exports."""
    return page.evaluate(f"import('/assets/map.js').then((sea) => {value})")


def finished(place: Path, title: str = "a run", **files: str) -> None:
    """Lay a whole result of a run into a folder."""
    place.mkdir()
    summary = {"title": title, "run": {"start": "2026-11-21T00:00:00", "end": "2026-11-22T00:00:00"}, "warnings": [title], "date_created": "2026-11-22T10:00:00Z", "wall_time_s": {"drift": 2.0}}  # fmt: skip
    held = {"summary.json": json.dumps(summary), "report.html": f"<title>{NASTY}</title>", **{k.replace("_", "."): v for k, v in files.items()}}  # fmt: skip
    for name, text in held.items():
        (place / name).write_text(text, encoding="utf-8")
    listed = manifest.manifest_of("run", [place / name for name in held])
    (place / manifest.NAME).write_text(manifest.manifest_text(listed), encoding="utf-8")


def check_strangers(served: Server, path: str, body: dict[str, Any]) -> None:
    """Who has no cookie, comes from another page or names another host is turned away."""
    for changes in ({"Cookie": None}, {"Origin": "http://evil.example"}, {"Host": "evil.example"}):
        assert served.ask("POST", f"/api/{path}", body, **changes)[0] in (401, 403, 421)
    assert served.ask("GET", f"/api/{path}")[0] == 405
