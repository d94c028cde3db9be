"""Security checks of every request to the desk, and security headers of every answer.

The server listens on the loopback only, but any page of any site can send it requests. So a request
must name our address (against DNS rebinding), come from our own page if it changes anything, and
carry a secret of this start: a cookie that opening the printed address sets, or, from other
programs, the token itself (Authorization: Bearer). Guests may read, not change. Files of runs are
requested without either, by a key in their address: their pages are isolated (CSP sandbox), as
scripts in a folder from somebody else must not act for the user.
"""

import asyncio
import hmac
import json
from collections.abc import Callable
from typing import Any
from urllib.parse import parse_qs

from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from drift.apps.serve.users import Secret, User

LARGEST = 2 * 2**20  # [bytes] most of a body: a case of a megabyte with its escapes
PATIENCE = 10.0  # [s] within which a body must arrive
LONGEST = 2000  # [bytes] most of a path and a query
RUNS = "/runs/"
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; form-action 'none'; "
    "base-uri 'none'; frame-ancestors 'none'; require-trusted-types-for 'script'; trusted-types 'none'"
)
RUN_POLICY = (  # policy for files of runs: scripts run in an origin of their own, without requests
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


class Refused(Exception):
    """A rejected request: HTTP status and message."""

    def __init__(self, status: int, line: str) -> None:
        super().__init__(line)
        self.status = status


class Gate:
    """ASGI application that passes requests on after the checks.

    places: "host:port" that requests must name, our own first. secret: that of this start. reads:
    paths of POST requests that change nothing. entered: called when a user opens the printed address.
    """

    def __init__(
        self,
        app: ASGIApp,
        places: tuple[str, ...],
        secret: Secret,
        reads: frozenset[str] = frozenset(),
        entered: Callable[[User], None] = lambda user: None,
    ) -> None:
        self._app, self._places, self._secret = app, places, secret
        self._reads, self._entered = reads, entered
        # browsers send cookies to every port of a host
        self._cookie = f"drift-{places[0].rpartition(':')[2]}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or pass it on with scope["body"], and its user as scope["who"]."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":  # no websockets
            await send({"type": "websocket.close", "code": 1008})
            return
        isolated = scope["path"].startswith(RUNS)

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                security_headers = {
                    **HEADERS,
                    "Content-Security-Policy": RUN_POLICY if isolated else POLICY,
                }
                other_headers = [
                    (n, v)
                    for n, v in message["headers"]
                    if n.lower() not in {k.lower().encode() for k in security_headers}
                ]
                message["headers"] = [
                    *other_headers,
                    *((n.lower().encode(), v.encode()) for n, v in security_headers.items()),
                ]
            await send(message)

        try:
            answer = self._entry(scope)
            if answer is None:
                if scope["method"] == "POST":
                    scope["body"] = await self._body(scope, receive)
                await self._app(scope, receive, send_with_headers)
                return
        except Refused as refused:
            answer = JSONResponse({"error": str(refused)}, refused.status, {"Connection": "close"})
        await answer(scope, receive, send_with_headers)

    def _entry(self, scope: Scope) -> Response | None:
        """Return the answer to an opened printed address, or None to pass a request on.

        Raises Refused for a request that fails a check.
        """
        if len(scope.get("raw_path") or b"") + len(scope["query_string"]) > LONGEST:
            raise Refused(414, "the address is too long")
        places = _header_values(scope, b"host")
        if len(places) != 1 or places[0].lower() not in self._places:
            raise Refused(421, "the request names another host than this server")
        method, path = scope["method"], scope["path"]
        if method not in {"GET", "HEAD", "POST"}:
            raise Refused(405, "only GET, HEAD and POST are allowed")
        if method != "POST" and path == "/" and scope["query_string"]:
            return self._let_in(scope)
        site = _header_values(scope, b"sec-fetch-site")
        if method == "POST":
            self._refuse_foreign(scope, site)
        if path.startswith(RUNS):
            self._refuse_without_key(scope, site)
            return None
        if site and site not in (["same-origin"], ["none"]):
            raise Refused(403, "requested from another site")
        user = self._user(scope)
        if user is None:
            raise Refused(
                401, "open the address that drift serve printed: it contains the key of this start"
            )
        if user.guest and method == "POST" and path not in self._reads:
            raise Refused(403, f"{user.name} is a guest here: guests may read, but not change")
        scope["who"] = user
        return None

    def _let_in(self, scope: Scope) -> Response:
        """Exchange the token of the printed address for a cookie."""
        tokens = parse_qs(scope["query_string"].decode("latin-1")).get("token", [])
        user = self._secret.by_token(tokens[0]) if len(tokens) == 1 else None
        if user is None:
            raise Refused(
                401,
                "open the address that drift serve printed last: this key is from another start",
            )
        self._entered(user)
        answer = RedirectResponse("/", 303)
        answer.set_cookie(self._cookie, user.cookie, httponly=True, samesite="strict", path="/")
        return answer

    def _refuse_foreign(self, scope: Scope, site: list[str]) -> None:
        """Reject a request that changes something but is not from our own page."""
        origin = _header_values(scope, b"origin")
        ours = [f"http://{place}" for place in self._places]
        if origin and (
            len(origin) != 1
            or origin[0] not in ours
            or origin[0] != f"http://{_header_values(scope, b'host')[0]}"
        ):
            raise Refused(403, "sent from another site")
        # a browser always says where a change comes from; a token of another program stands for it
        said = origin or site or _header_values(scope, b"authorization")
        if site not in ([], ["same-origin"]) or not said:
            raise Refused(403, "sent from another site")

    def _refuse_without_key(self, scope: Scope, site: list[str]) -> None:
        """Reject a request for a run's file without its key, or from within a foreign page."""
        parts = scope["path"].split("/")
        if scope["method"] == "POST" or len(parts) != 5:
            raise Refused(404, "no such file")
        if not hmac.compare_digest(parts[3].encode(), self._secret.key(parts[2]).encode()):
            raise Refused(
                401, "this link is from an earlier start of the server: open the run from the list"
            )
        if site not in ([], ["same-origin"], ["none"]) and _header_values(
            scope, b"sec-fetch-mode"
        ) != ["navigate"]:
            raise Refused(403, "requested from another site")

    def _user(self, scope: Scope) -> User | None:
        """Return the user of a request's token, or without one of its cookie."""
        if given := _header_values(scope, b"authorization"):
            kind, _, token = given[0].partition(" ")
            one = len(given) == 1 and kind.lower() == "bearer"
            return self._secret.by_token(token.strip()) if one else None
        cookies = [
            part.strip().partition("=")
            for line in _header_values(scope, b"cookie")
            for part in line.split(";")
        ]
        found = [
            self._secret.by_cookie(value) for name, _, value in cookies if name == self._cookie
        ]
        return next((user for user in found if user is not None), None)

    async def _body(self, scope: Scope, receive: Receive) -> dict[str, Any]:
        """Return the JSON object of a body; raise Refused if it is invalid, too large or slow."""
        kind = _header_values(scope, b"content-type")
        if [one.replace(" ", "").lower() for one in kind] not in (
            ["application/json"],
            ["application/json;charset=utf-8"],
        ):
            raise Refused(415, "only JSON is accepted")
        length = _header_values(scope, b"content-length")
        if (
            _header_values(scope, b"transfer-encoding")
            or len(length) != 1
            or not (length[0].isascii() and length[0].isdecimal())
        ):
            raise Refused(411, "a body needs its length")
        if int(length[0][:12]) > LARGEST:
            raise Refused(413, f"a body has at most {LARGEST:,} bytes")
        try:
            data = await asyncio.wait_for(_read_body(receive), PATIENCE)
        except TimeoutError:
            raise Refused(408, "the body did not arrive in time") from None
        try:
            content = json.loads(data)
        except (ValueError, RecursionError):
            raise Refused(400, "the body is not JSON") from None
        if not isinstance(content, dict):
            raise Refused(400, "the body is not a JSON object")
        return content


async def _read_body(receive: Receive) -> bytes:
    data = b""
    while True:
        message = await receive()
        if message["type"] != "http.request":
            raise Refused(400, "the connection was closed")
        data += bytes(message.get("body", b""))
        if len(data) > LARGEST:
            raise Refused(413, f"a body has at most {LARGEST:,} bytes")
        if not message.get("more_body"):
            return data


def _header_values(scope: Scope, name: bytes) -> list[str]:
    return [value.decode("latin-1") for key, value in scope["headers"] if key == name]
