"""A message to an address, given at the start only, when a run ends."""

import asyncio
import contextlib
import http.client
import json
import re
import threading
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from geo.errors import UserError

TIMEOUT = 10.0  # [s] to connect, and for the first bytes of an answer
THREAD = "webhook"
STATUS = re.compile(rb"HTTP/1\.[01] (\d{3})")


@dataclass(frozen=True)
class Webhook:
    """Where a message goes."""

    secure: bool
    host: str
    port: int | None
    target: str  # path and query

    async def post(self, content: dict[str, Any]) -> str:
        """Send a message; return what went wrong, "" for nothing.

        Its thread does not hold up the end of the server, as one of `asyncio.to_thread` would.
        """
        loop = asyncio.get_running_loop()
        done: asyncio.Future[str] = loop.create_future()

        def tell(wrong: str) -> None:
            if not done.cancelled():
                done.set_result(wrong)

        def work() -> None:
            wrong = self._post(json.dumps(content).encode())
            with contextlib.suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(tell, wrong)

        threading.Thread(target=work, name=THREAD, daemon=True).start()
        return await done

    def _post(self, body: bytes) -> str:
        kind = http.client.HTTPSConnection if self.secure else http.client.HTTPConnection
        connection = kind(self.host, self.port, timeout=TIMEOUT)
        headers = {"Content-Type": "application/json", "User-Agent": "drift", "Connection": "close"}
        try:
            connection.request("POST", self.target, body, headers)
            # only the status is read: no redirect is followed, and an answer without end costs nothing
            answer = connection.sock.recv(64)
        except TimeoutError:
            return f"no answer within {TIMEOUT:g} s"
        except (OSError, http.client.HTTPException) as error:
            return f"not sent: {error.strerror if isinstance(error, OSError) else error}"
        finally:
            connection.close()
        found = STATUS.match(answer)
        if found is None:
            return "the answer is not HTTP"
        return "" if found[1].startswith(b"2") else f"the answer was {found[1].decode()}"


def parse(address: str) -> Webhook:
    """Return the webhook of an address; raise UserError if it is not one."""
    try:
        parts = urlsplit(address)
        port = parts.port
    except ValueError:
        parts, port = urlsplit(""), None
    plain = address.isascii() and address.isprintable() and " " not in address
    if (
        parts.scheme not in ("http", "https")
        or not parts.hostname
        or not plain
        or "@" in parts.netloc
    ):
        # without the address itself, which may contain a key
        raise UserError("--webhook: give an address like https://host/path, without a user in it")
    target = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
    return Webhook(parts.scheme == "https", parts.hostname, port, target)
