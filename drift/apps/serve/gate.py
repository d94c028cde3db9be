"""What every request must pass before the desk looks at it, and what every answer says.

The server listens on the loopback alone, but every page of every site can send it requests. So a
request must name our address (against names that are rebound to it), come from our own page where
it changes anything, and carry the secret of this start, as a cookie that the printed address set.
Files of runs are asked for without the cookie, by a key in their address: their pages run apart
(CSP sandbox), because scripts in a folder that somebody sent must not act for the user.
"""

import asyncio
import hashlib
import hmac
import json
import secrets
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import parse_qs

from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LARGEST = 2 * 2**20  # [bytes] of a body: a case of a megabyte with its escapes
PATIENCE = 10.0  # [s] for a body to come
LONGEST = 2000  # [bytes] of a path and a query
RUNS = "/runs/"
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; form-action 'none'; "
    "base-uri 'none'; frame-ancestors 'none'; require-trusted-types-for 'script'; trusted-types 'none'"
)
APART = (  # of files of runs: scripts run, but in an origin of their own, and can ask for nothing
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; form-action 'none'; "
    "base-uri 'none'; frame-ancestors 'none'; sandbox allow-scripts allow-downloads"
)
HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Embedder-Policy": "require-corp",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=(), usb=(), serial=()",
    "Cache-Control": "no-store",
}


@dataclass(frozen=True)
class Secret:
    """What only those know to whom this start of the server was shown."""

    token: str = field(default_factory=lambda: secrets.token_urlsafe(32))
    cookie: str = field(default_factory=lambda: secrets.token_urlsafe(32))

    def key(self, run: str) -> str:
        """Return the key of a run's files, which opens no other's."""
        return hmac.new(self.cookie.encode(), run.encode(), hashlib.sha256).hexdigest()


class Refused(Exception):
    """A request that goes no further: a status and a line."""

    def __init__(self, status: int, line: str) -> None:
        super().__init__(line)
        self.status = status


class Gate:
    """An application behind the gate.

    places: "host:port" as requests must name it, the first one ours; secret: of this start.
    """

    def __init__(self, app: ASGIApp, places: tuple[str, ...], secret: Secret) -> None:
        self._app, self._places, self._secret = app, places, secret
        # browsers send cookies to every port of a host
        self._cookie = f"drift-{places[0].rpartition(':')[2]}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or pass it on with its body read: scope["body"]."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":  # no websockets
            await send({"type": "websocket.close", "code": 1008})
            return
        apart = scope["path"].startswith(RUNS)

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = {**HEADERS, "Content-Security-Policy": APART if apart else POLICY}
                given = [
                    (n, v)
                    for n, v in message["headers"]
                    if n.lower() not in {k.lower().encode() for k in own}
                ]
                message["headers"] = [
                    *given,
                    *((n.lower().encode(), v.encode()) for n, v in own.items()),
                ]
            await send(message)

        try:
            answer = self._entry(scope)
            if answer is None:
                if scope["method"] == "POST":
                    scope["body"] = await self._body(scope, receive)
                await self._app(scope, receive, guarded)
                return
        except Refused as refused:
            answer = JSONResponse({"error": str(refused)}, refused.status, {"Connection": "close"})
        await answer(scope, receive, guarded)

    def _entry(self, scope: Scope) -> Response | None:
        """Return the answer to who opens the printed address, None for who may go on; raise
        Refused.
        """
        if len(scope.get("raw_path") or b"") + len(scope["query_string"]) > LONGEST:
            raise Refused(414, "the address is too long")
        places = _each(scope, b"host")
        if len(places) != 1 or places[0].lower() not in self._places:
            raise Refused(421, "this server is not what the address says")
        method, path = scope["method"], scope["path"]
        if method not in {"GET", "HEAD", "POST"}:
            raise Refused(405, "only GET, HEAD and POST are answered")
        if method != "POST" and path == "/" and scope["query_string"]:
            return self._let_in(scope)
        site = _each(scope, b"sec-fetch-site")
        if method == "POST":
            self._refuse_foreign(scope, site)
        if path.startswith(RUNS):
            self._refuse_without_key(scope, site)
            return None
        if site and site not in (["same-origin"], ["none"]):
            raise Refused(403, "asked from another site")
        if not self._known(scope):
            raise Refused(
                401, "open the address that drift serve printed: it holds the key of this start"
            )
        return None

    def _let_in(self, scope: Scope) -> Response:
        """Turn the token of the printed address into a cookie."""
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [])
        if len(given) != 1 or not hmac.compare_digest(
            given[0].encode(), self._secret.token.encode()
        ):
            raise Refused(
                401, "open the address that drift serve printed last: this key is of another start"
            )
        answer = RedirectResponse("/", 303)
        answer.set_cookie(
            self._cookie, self._secret.cookie, httponly=True, samesite="strict", path="/"
        )
        return answer

    def _refuse_foreign(self, scope: Scope, site: list[str]) -> None:
        """Refuse what changes something and is not from our own page."""
        origin = _each(scope, b"origin")
        ours = [f"http://{place}" for place in self._places]
        if origin and (
            len(origin) != 1
            or origin[0] not in ours
            or origin[0] != f"http://{_each(scope, b'host')[0]}"
        ):
            raise Refused(403, "sent from another site")
        if site not in ([], ["same-origin"]) or not (origin or site):
            raise Refused(403, "sent from another site")

    def _refuse_without_key(self, scope: Scope, site: list[str]) -> None:
        """Refuse a file of a run without its key, and use of one by another page than as a page of
        its own.
        """
        parts = scope["path"].split("/")
        if scope["method"] == "POST" or len(parts) != 5:
            raise Refused(404, "no such file")
        if not hmac.compare_digest(parts[3].encode(), self._secret.key(parts[2]).encode()):
            raise Refused(401, "this key is of another start: open the run from the list")
        if site not in ([], ["same-origin"], ["none"]) and _each(scope, b"sec-fetch-mode") != [
            "navigate"
        ]:
            raise Refused(403, "asked from another site")

    def _known(self, scope: Scope) -> bool:
        cookies = [
            part.strip().partition("=")
            for line in _each(scope, b"cookie")
            for part in line.split(";")
        ]
        ours = [value for name, _, value in cookies if name == self._cookie]
        return any(
            hmac.compare_digest(value.encode(), self._secret.cookie.encode()) for value in ours
        )

    async def _body(self, scope: Scope, receive: Receive) -> dict[str, Any]:
        """Return the JSON object of a body; raise Refused for anything else, too much of it, or too
        slow.
        """
        kind = _each(scope, b"content-type")
        if [one.replace(" ", "").lower() for one in kind] not in (
            ["application/json"],
            ["application/json;charset=utf-8"],
        ):
            raise Refused(415, "only JSON is taken")
        length = _each(scope, b"content-length")
        if (
            _each(scope, b"transfer-encoding")
            or len(length) != 1
            or not (length[0].isascii() and length[0].isdecimal())
        ):
            raise Refused(411, "a body needs its length")
        if int(length[0][:12]) > LARGEST:
            raise Refused(413, f"a body has at most {LARGEST:,} bytes")
        try:
            data = await asyncio.wait_for(_whole(receive), PATIENCE)
        except TimeoutError:
            raise Refused(408, "the body did not come in time") from None
        try:
            held = json.loads(data)
        except (ValueError, RecursionError):
            raise Refused(400, "the body is not JSON") from None
        if not isinstance(held, dict):
            raise Refused(400, "the body is no JSON object")
        return held


async def _whole(receive: Receive) -> bytes:
    data = b""
    while True:
        message = await receive()
        if message["type"] != "http.request":
            raise Refused(400, "the connection ended")
        data += bytes(message.get("body", b""))
        if len(data) > LARGEST:
            raise Refused(413, f"a body has at most {LARGEST:,} bytes")
        if not message.get("more_body"):
            return data


def _each(scope: Scope, name: bytes) -> list[str]:
    return [value.decode("latin-1") for key, value in scope["headers"] if key == name]
