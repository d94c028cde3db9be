"""Routes of downloads: providers of winds and currents, and jobs of `drift fetch`.

The browser names providers of the catalogue, never an address. A warm process reads the text and
says what to download; the job gets a box and a span, never the text. Only that job may ask the
providers' hosts.
"""

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from drift.apps.fetch import catalogue
from drift.apps.fetch.catalogue import Provider
from drift.apps.serve import api, names, shelf
from drift.apps.serve.api import FLAG, TEXT, Operation, Schema, many, or_null, record
from drift.apps.serve.fields import form_sources
from drift.apps.serve.jobs import Download
from drift.apps.serve.routes.form_routes import FormRoutes, Invalid, check_keys, post, text_of
from geo.files import fence

TABLES = "forcing.toml"  # of `drift fetch`
LARGEST_TABLES = 2**16  # [bytes]
# (user, kind, case, digest, download) -> what the page shows of the job
Start = Callable[[str, str, str, str, Download], dict[str, Any]]

PROVIDER = record(
    **dict.fromkeys(("name", "quantity", "title", "resolution", "kind", "license"), TEXT),
    free=FLAG,  # needs no credentials: those are for the command line
)
WANTED = {
    "type": "object",
    "properties": {quantity: or_null(TEXT) for quantity in form_sources.SOURCES},
    "minProperties": 1,
    "additionalProperties": False,
}  # by quantity: the name of a provider; null: the first that has it


class FetchRoutes:
    """Request handlers of downloads."""

    def __init__(
        self, folder: Path, form: FormRoutes, allowed: fence.Fence, start: Start, job: Schema
    ) -> None:
        self.folder, self.form, self.allowed = folder, form, allowed
        self.start, self.job = start, job

    def routes(self) -> list[Operation]:
        """Return the routes; guests may not download."""
        takes = record(text=TEXT, name=api.CASE, wanted=WANTED, size_only=FLAG)
        used, text = record(text=TEXT, files=TEXT), record(text=TEXT)
        listed = record(providers=many(PROVIDER))
        return [
            post("fetch/providers", self.providers, api.NOTHING, listed, True),
            post("fetch", self.fetch, takes, self.job, False),
            post("fetch/use", self.use, used, text, False),
        ]

    async def providers(self, body: dict[str, Any]) -> Any:
        """Return the providers of winds and currents, as `drift fetch --list` has them."""
        check_keys(body, set())
        known = await asyncio.to_thread(catalogue.read_providers)
        shown = ("name", "quantity", "title", "resolution", "kind", "license")
        listed = [
            {key: getattr(one, key) for key in shown} | {"free": _is_free(one)}
            for one in known.values()
            if one.quantity in form_sources.SOURCES
        ]
        return {"providers": listed}

    async def fetch(self, body: dict[str, Any], user: str) -> Any:
        """Start a job that downloads what a text needs, or one that says how much this is."""
        text = text_of(body, {"text", "name", "wanted", "size_only"})
        path = self.form.path_of(body)
        if not isinstance(body["size_only"], bool):
            raise Invalid("size_only is true or false")
        known = await asyncio.to_thread(catalogue.read_providers)
        wanted = _check_wanted(body["wanted"], known)
        told = await self.form.sketching.ask(
            "fetch/area", text=text, path=path, quantities=list(wanted)
        )
        box = ",".join(f"{edge:.6f}" for edge in told["box"])
        arguments = (
            f"--box={box}",
            f"--from={told['begin']}",
            f"--to={told['end']}",
            *(f"--quantity={quantity}" for quantity in wanted),
            *(f"--provider={name}" for name in wanted.values() if name is not None),
        )
        asked = [
            one
            for one in known.values()
            if one.quantity in wanted and wanted[one.quantity] in (None, one.name) and _is_free(one)
        ]
        download = Download(arguments, self._fence(asked))
        kind = "size" if body["size_only"] else "fetch"
        return self.start(user, kind, body["name"], shelf.digest(text.encode()), download)

    async def use(self, body: dict[str, Any]) -> Any:
        """Return a text that reads the files of a download."""
        text, files = text_of(body, {"text", "files"}), body["files"]
        if not isinstance(files, str) or not names.plain(files):
            raise Invalid("give the folder of a download")
        try:
            tables = await asyncio.to_thread(
                names.contents, self.folder, files, TABLES, largest=LARGEST_TABLES
            )
        except OSError:
            raise Invalid(f"{files} has no winds and currents of drift fetch", 404) from None
        return await self.form.typing.ask(
            "fetch/use", text=text, folder=files, tables=tables.decode("utf-8", "replace")
        )

    def _fence(self, asked: list[Provider]) -> fence.Fence:
        """Return what a download may read, ask and write: less than a job on files, but hosts."""
        hosts = {urlsplit(one).netloc.lower() for each in asked for one in each.address}
        own = catalogue.user_file()
        folders = (self.folder, *([own.resolve()] if own.is_file() else []))
        return replace(self.allowed, folders=folders, hosts=frozenset(hosts))


def _is_free(provider: Provider) -> bool:
    return provider.credentials == "none" and bool(provider.address)


def _check_wanted(wanted: Any, known: Mapping[str, Provider]) -> dict[str, str | None]:
    """Return the provider of each quantity, in the order of the form."""
    if not isinstance(wanted, dict) or not wanted or wanted.keys() - form_sources.SOURCES.keys():
        raise Invalid(f"give providers of {' or '.join(form_sources.SOURCES)}")
    for quantity, name in wanted.items():
        if name is None:
            continue
        if not isinstance(name, str) or name not in known or known[name].quantity != quantity:
            raise Invalid(f"{str(name)[:100]} is no provider of {quantity}: see drift fetch --list")
        if not _is_free(known[name]):
            raise Invalid(f"{name} needs credentials: use drift fetch on the command line")
    return {one: wanted[one] for one in form_sources.SOURCES if one in wanted}
