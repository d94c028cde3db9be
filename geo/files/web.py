"""Requests to web servers, limited in time and size, with a one-line message for every failure.

Names and passwords come only from ~/.netrc, are sent only to the machine named there, and appear in
no message.
"""

import functools
import http.client
import netrc
import socket
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

from geo.errors import UserError
from geo.files import fence

# EAI_AGAIN is not among them: it is a temporary failure
NO_NAME = {socket.EAI_NONAME, getattr(socket, "EAI_NODATA", socket.EAI_NONAME)}
BLOCK = 2**16  # [bytes] read at once
SAFE = ("127.0.0.1", "localhost", "::1")  # hosts to which a password may be sent unencrypted


class TemporaryError(Exception):
    """A temporary failure: the server is down, slow, or sent an incomplete answer."""


def get_address(address: str, timeout: float, most: int) -> bytes:
    """Return the complete answer of an address.

    Args:
        address: to request.
        timeout: longest wait for the server's next bytes [s]; the whole answer may take ten times
            as long.
        most: largest answer [bytes].

    Raises:
        UserError: a permanent failure.
        Passing: a temporary failure.
    """
    until = time.monotonic() + 10 * timeout
    full_address, address = address, address.partition("?")[0]  # in messages
    with _open_answer(full_address, timeout) as answer:
        length = answer.headers.get("Content-Length")
        content = bytearray()
        while block := answer.read1(BLOCK):
            content += block
            if len(content) > most:
                raise UserError(
                    f'"{address}" sends more than the {most:,} bytes that this can have'
                )
            if time.monotonic() > until:
                raise TemporaryError(
                    f'"{address}" sends too slowly: {len(content):,} bytes in {10 * timeout:g} s'
                )
    if length is not None and length.isdecimal() and len(content) != int(length):
        raise TemporaryError(
            f'"{address}" sent an incomplete answer: {len(content):,} of {int(length):,} bytes'
        )
    if content[:512].lstrip().lower().startswith((b"<!doctype html", b"<html")):
        raise UserError(
            f'"{address}" sent a web page in place of data: it may ask for a login, or be under repair'
        )
    return bytes(content)


@contextmanager
def _open_answer(address: str, timeout: float) -> Iterator[Any]:
    """Yield the answer of a server, or raise an error with a one-line message."""
    request = urllib.request.Request(address, headers={"User-Agent": "casp-drift"})
    address = address.partition("?")[0]
    _authorize(request)
    try:
        with _opener().open(request, timeout=timeout) as answer:
            yield answer
    except urllib.error.HTTPError as error:
        error.close()
        raise _status_error(address, error.code, error.reason) from None
    except TimeoutError:
        raise TemporaryError(f'"{address}" did not answer for {timeout:g} s') from None
    except urllib.error.URLError as error:
        if isinstance(error.reason, TimeoutError):
            raise TemporaryError(f'"{address}" did not answer for {timeout:g} s') from None
        if isinstance(error.reason, socket.gaierror) and error.reason.errno in NO_NAME:
            host = urlsplit(request.full_url).hostname
            raise UserError(
                f'"{address}": no host is named {host}, or this computer is offline'
            ) from None
        raise TemporaryError(f'"{address}" cannot be reached ({error.reason})') from None
    except http.client.IncompleteRead as error:
        raise TemporaryError(
            f'"{address}" sent an incomplete answer: {len(error.partial):,} bytes, then no more'
        ) from None
    except (OSError, http.client.HTTPException, ValueError) as error:
        raise TemporaryError(f'"{address}" broke off ({error or type(error).__name__})') from None


class _Redirects(urllib.request.HTTPRedirectHandler):
    """Follow redirects to hosts that may be asked, with the credentials of the new host."""

    def redirect_request(self, *arguments: Any) -> urllib.request.Request | None:
        """Return the request to the new address."""
        request = super().redirect_request(*arguments)
        if request is not None:
            fence.check_address(request.full_url)
            _authorize(request)
        return request


@functools.cache
def _opener() -> urllib.request.OpenerDirector:
    """Return the opener of addresses; its cookies last as long as the process."""
    return urllib.request.build_opener(_Redirects, urllib.request.HTTPCookieProcessor)


def _status_error(address: str, status: int, reason: str) -> Exception:
    host = urlsplit(address).hostname
    if status in (401, 403):
        return UserError(
            f'"{address}" asks for credentials ({status}): put those of machine {host} into ~/.netrc'
        )
    if status in (404, 410):
        return UserError(
            f'"{address}" is not there ({status}): no such dataset, or its times are no longer offered'
        )
    if status == 413:
        return UserError(
            f'"{address}" rejects the request as too large (413): ask for a smaller box or a shorter span'
        )
    if status == 429 or status >= 500:
        return TemporaryError(f'"{address}" failed ({status} {reason})')
    return UserError(f'"{address}" rejects the request ({status} {reason})')


def _authorize(request: urllib.request.Request) -> None:
    """Add the credentials that ~/.netrc has for the request's host, if any.

    They are not sent on to the target of a redirect.
    """
    import base64

    if request.type != "https" and request.host.partition(":")[0] not in SAFE:
        return
    try:
        found = netrc.netrc().authenticators(urlsplit(request.full_url).hostname or "")
    except (OSError, netrc.NetrcParseError):
        return
    if found is not None and found[2] is not None:
        token = base64.b64encode(f"{found[0]}:{found[2]}".encode()).decode()
        request.add_unredirected_header("Authorization", f"Basic {token}")
