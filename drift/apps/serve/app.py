"""The pages and the API of the desk, as a Starlette application.

`drift.apps.serve.gate` checks every request first; `drift.apps.serve.server` runs the application.
"""

import asyncio
import mimetypes
import os
import re
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import asynccontextmanager
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Any, BinaryIO

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import BaseRoute, Route
from starlette.types import ASGIApp, Receive, Scope, Send

from drift.apps.serve import api, names, shelf
from drift.apps.serve.api import COUNT, FLAG, NUMBER, TEXT, Operation, many, or_null, record
from drift.apps.serve.charts import Chart
from drift.apps.serve.desk_log import DeskLog
from drift.apps.serve.gate import Gate
from drift.apps.serve.jobs import FETCHES, KINDS, QUICK, Download, Job, Jobs, Limits
from drift.apps.serve.routes.chart_routes import ChartRoutes
from drift.apps.serve.routes.export_routes import ExportRoutes
from drift.apps.serve.routes.fetch_routes import FetchRoutes
from drift.apps.serve.routes.form_routes import FormRoutes, Invalid
from drift.apps.serve.routes.search_routes import SearchRoutes
from drift.apps.serve.routes.spill_routes import SpillRoutes
from drift.apps.serve.users import Secret, User
from drift.apps.serve.webhook import Webhook
from drift.case import file as case_file
from drift.case import template
from geo.files import fence

PAGE = (
    "changes",
    "coverage",
    "charts",
    "desk",
    "editor",
    "export",
    "fetch",
    "files",
    "form",
    "kit",
    "map",
    "people",
    "refine",
    "sources",
)
SEARCH = ("drawn", "plan", "results", "rows", "search", "searches")
SPILL = ("spill", "spills", "washup")
ASSETS = {
    "desk.css": ("drift.apps.serve", "text/css"),
    "objects.svg": ("drift.apps.serve", "image/svg+xml"),
    **{f"{name}.js": ("drift.apps.serve", "text/javascript") for name in (*PAGE, *SEARCH, *SPILL)},
    # the look and the map of report.html
    **dict.fromkeys(("ol.css", "page.css"), ("drift.products.report", "text/css")),
    **{
        f"{name}.js": ("drift.products.report", "text/javascript")
        for name in ("ol", "projection", "graticule", "looks", "tables", "layers")
    },
}
TYPES = {  # of files of runs that a browser shows; it saves all others
    ".png": "image/png",
    ".txt": "text/plain; charset=utf-8",
    ".csv": "text/plain; charset=utf-8",
    ".toml": "text/plain; charset=utf-8",
    ".json": "application/json",
}
# places where OpenLayers writes plain text by innerHTML, which our policy (Trusted Types) forbids:
# where it measures letters, and in the scale line
PLAIN_TEXT = ('innerHTML="M"', "innerElement_.innerHTML=")
CHUNK = 2**18  # [bytes]
LAST_MESSAGES = 1.0  # [s] at the end for messages of the webhook that are on their way


# what requests take and answers have, as JSON Schema
LISTED = record(name=TEXT, title=TEXT)
CASE_ROW = record(name=TEXT, title=TEXT, changed=NUMBER)
RUN = record(
    **dict.fromkeys(("name", "title", "kind", "start", "end", "made", "key"), TEXT),
    took=or_null(NUMBER),
    warnings=many(TEXT),
    report=FLAG,
    files=many(record(name=TEXT, bytes=COUNT)),
)
FOLDER = record(folder=TEXT, cases=many(CASE_ROW), runs=many(RUN), shipped=many(LISTED))
CASE_TEXT = record(name=api.CASE, text=TEXT, digest=api.DIGEST)
JOB = record(
    number=COUNT,
    kind={"enum": [*KINDS, *FETCHES]},
    case=api.CASE,
    digest=api.DIGEST,
    user=TEXT,
    state={"enum": ["waiting", "running", "done", "failed", "cancelled"]},
    out=or_null(TEXT),
    key=or_null(TEXT),
    phase=TEXT,
    share=NUMBER,
    took=or_null(NUMBER),
    lines=many(TEXT),
)
NEW_JOB = record(kind={"enum": list(KINDS)}, case=api.CASE, digest=api.DIGEST)
LOGGED = record(
    **dict.fromkeys(("time", "user", "action"), TEXT),
    **dict.fromkeys(("case", "digest", "result"), or_null(TEXT)),
)
LOG = record(entries=many(LOGGED), trouble=TEXT)
NEWS_ENTRY = record(number=COUNT, **LOGGED["properties"])
NEWS = record(you=TEXT, guest=FLAG, several=FLAG, last=COUNT, entries=many(NEWS_ENTRY))


class Desk:
    """Request handlers for the served folder, the shipped cases, the jobs and the log."""

    def __init__(
        self,
        folder: Path,
        secret: Secret,
        allowed: fence.Fence,
        limits: Limits,
        webhook: Webhook | None,
    ) -> None:
        self.folder, self.secret, self.webhook = folder, secret, webhook
        self.log = DeskLog(folder)
        self.jobs = Jobs(folder, allowed, limits, self.ended)
        self._posting: set[asyncio.Task[None]] = set()

    def routes(self) -> list[Operation]:
        """Return the routes of the API."""
        case, job = "/api/cases/{name}", "/api/jobs/{number:int}/cancel"
        saved = record(name=api.CASE, digest=api.DIGEST)
        to_save = record(text=TEXT, digest=or_null(api.DIGEST))
        jobs = record(jobs=many(JOB))
        copied = record(name=api.CASE)
        return [
            Operation("GET", "/api/folder", self.list_folder, FOLDER),
            Operation("GET", case, self.case, CASE_TEXT),
            Operation("POST", case, self.save, saved, takes=to_save),
            Operation("POST", "/api/shipped/{name}", self.copy_shipped, copied, takes=api.OBJECT),
            Operation("GET", "/api/jobs", self.jobs_all, jobs),
            Operation("POST", "/api/jobs", self.job_new, JOB, takes=NEW_JOB),
            Operation("POST", job, self.job_cancel, JOB, takes=api.OBJECT),
            Operation("GET", "/api/log", self.log_end, LOG),
            Operation("GET", "/api/news/{number:int}", self.news, NEWS),
            Operation("GET", "/runs/{run}/{key}/{name}", self.file, None),
        ]

    async def page(self, request: Request) -> Response:
        """Return the page."""
        return Response(_asset("drift.apps.serve", "desk.html"), media_type="text/html")

    async def asset(self, request: Request) -> Response:
        """Return a style sheet or script of the page."""
        home, kind = ASSETS.get(request.path_params["name"], ("", ""))
        if not home:
            return _error_response(404, "no such file")
        text = _asset(home, request.path_params["name"])
        for written in PLAIN_TEXT:
            text = text.replace(written, written.replace("innerHTML", "textContent"))
        return Response(text, media_type=kind)

    async def list_folder(self, request: Request) -> Response:
        """Return the contents of the folder: cases, results, and shipped cases."""
        try:
            # reading a large summary takes time
            runs = await run_in_threadpool(shelf.runs, self.folder)
            cases = await run_in_threadpool(shelf.cases, self.folder)
        except OSError as error:
            return _error_response(500, f"the folder cannot be read: {error.strerror}")
        shipped = [{"name": name, "title": title} for name, title in _shipped().items()]
        runs = [{**run, "key": self.secret.key(run["name"])} for run in runs]
        folder_name = self.folder.name or str(self.folder)
        return JSONResponse(
            {"folder": folder_name, "cases": cases, "runs": runs, "shipped": shipped}
        )

    async def case(self, request: Request) -> Response:
        """Return the text of a case, and its digest."""
        name = request.path_params["name"]
        try:
            text, digest = (
                shelf.read_case(self.folder, name) if names.case(name) else _raise_not_found()
            )
        except UnicodeDecodeError:
            return _error_response(400, f"{name} is not text in UTF-8")
        except OSError as error:
            return _error_response(
                404, f"{name[:100]} cannot be read: {error.strerror or 'no such case'}"
            )
        return JSONResponse({"name": name, "text": text, "digest": digest})

    async def copy_shipped(self, request: Request) -> Response:
        """Save a copy of a template or a shipped case in the folder, under a free name."""
        name = request.path_params["name"]
        if name not in _shipped():
            return _error_response(404, "no such case")
        text = (
            template.template_text(name)
            if name in template.TEMPLATES
            else _asset("cases", f"{name}.toml")
        )
        try:
            for beside in set(
                re.findall(r'"((?:networks|losses)/[\w.-]+)"', text)
            ):  # the files that it refers to are copied with it
                shelf.lay_beside(
                    self.folder, beside, resources.files("cases").joinpath(beside).read_bytes()
                )
            copied = shelf.save_new(self.folder, name, text)
        except OSError as error:
            return _error_response(500, f"{name} cannot be copied: {error.strerror}")
        self.log.add(_who(request).name, "copied", case=copied)
        return JSONResponse({"name": copied})

    async def save(self, request: Request) -> Response:
        """Save a case; reject it if the file was changed in the meantime."""
        name, body = request.path_params["name"], request.scope["body"]
        text, digest_read = body.get("text"), body.get("digest")
        if (
            body.keys() != {"text", "digest"}
            or not isinstance(text, str)
            or not isinstance(digest_read, str | None)
        ):
            return _error_response(
                400, "give a text and the digest of the version read, null for a new case"
            )
        if not names.case(name):
            letters = f"letters, digits, spaces and . _ - + ( ), at most {names.LONGEST}"
            return _error_response(
                400, f"the name of a case is made of {letters}, and ends in .toml"
            )
        if "\0" in text or any("\ud800" <= letter <= "\udfff" for letter in text):
            return _error_response(400, "this is not text")
        if len(text.encode()) > shelf.LARGEST:
            return _error_response(413, f"a case has at most {shelf.LARGEST:,} bytes")
        try:
            # in a thread: another program may keep the folder locked for seconds
            digest = await run_in_threadpool(shelf.save, self.folder, name, text, digest_read)
        except shelf.Conflict:
            what = (
                "exists already"
                if digest_read is None
                else "was changed in the meantime, by another page or program"
            )
            return _error_response(409, f"{name} {what}; nothing was saved")
        except OSError as error:
            return _error_response(500, f"{name} cannot be saved: {error.strerror}")
        self.log.add(_who(request).name, "saved", case=name, digest=digest)
        return JSONResponse({"name": name, "digest": digest})

    async def jobs_all(self, request: Request) -> Response:
        """Return all jobs."""
        return JSONResponse({"jobs": [self._job(job.summary()) for job in self.jobs.all()]})

    async def job_new(self, request: Request) -> Response:
        """Start a job on a saved case."""
        body = request.scope["body"]
        if body.keys() != {"kind", "case", "digest"} or not all(
            isinstance(value, str) for value in body.values()
        ):
            return _error_response(400, "give kind, case and digest")
        if not re.fullmatch("[0-9a-f]{64}", body["digest"]):
            return _error_response(400, "the digest is that of the case as it was read")
        if body["kind"] not in KINDS or not names.case(body["case"]):
            return _error_response(400, f"kinds are {', '.join(KINDS)}, on a case of this folder")
        user = _who(request).name
        try:
            return JSONResponse(self.start(user, body["kind"], body["case"], body["digest"]))
        except Invalid as invalid:
            return _error_response(invalid.status, str(invalid))

    def start(
        self, user: str, kind: str, case: str, digest: str, download: Download | None = None
    ) -> dict[str, Any]:
        """Start a job, and return what the page shows of it; raise Invalid if too many wait."""
        job = self.jobs.add(kind, case, digest, user, download)
        if job is None:
            raise Invalid("too many jobs are waiting", 429)
        if job.kind not in QUICK:
            self.log.add(user, f"started {job.kind}", case=job.case, digest=job.digest)
        return self._job(job.summary())

    async def job_cancel(self, request: Request) -> Response:
        """Cancel a job."""
        job = self.jobs.get(request.path_params["number"])
        if job is None:
            return _error_response(404, "no such job")
        if not job.over and job.kind not in QUICK:
            self.log.add(_who(request).name, f"cancelled {job.kind}", case=job.case)
        await self.jobs.cancel(job)
        return JSONResponse(self._job(job.summary()))

    def ended(self, job: Job) -> None:
        """Log that a job has ended, and send the message of the webhook."""
        if job.kind in QUICK:
            return
        if job.state != "cancelled":
            action = f"{'finished' if job.state == 'done' else 'failed'} {job.kind}"
            result = job.out if job.state == "done" else None
            self.log.add(job.user, action, case=job.case, digest=job.digest, result=result)
        if self.webhook is not None and job.download is None:
            task = asyncio.create_task(self._post(self.webhook, job))
            self._posting.add(task)
            task.add_done_callback(self._posting.discard)

    async def _post(self, webhook: Webhook, job: Job) -> None:
        """Send the message of a webhook; a failure is logged."""
        content = {
            "kind": job.kind,
            "case": job.case,
            "digest": job.digest,
            "user": job.user,
            "state": job.state,
            "result": job.out if job.state == "done" else None,
            "took": job.took,
        }
        if wrong := await webhook.post(content):
            self.log.add("drift", "webhook failed", case=job.case, result=wrong)

    async def close(self) -> None:
        """End all jobs; what they still have to tell gets little time."""
        await self.jobs.close()
        if self._posting:
            await asyncio.wait(self._posting, timeout=LAST_MESSAGES)
        for task in self._posting:
            task.cancel()

    async def log_end(self, request: Request) -> Response:
        """Return the last entries of the log, the newest first."""
        if _who(request).guest:
            return _error_response(403, "the log is for users; you are a guest")
        try:
            return JSONResponse({"entries": self.log.end(), "trouble": self.log.trouble})
        except OSError as error:
            return _error_response(500, f"the log cannot be read: {error.strerror}")

    async def news(self, request: Request) -> Response:
        """Return what was done since an entry of the log, and who asks."""
        user = _who(request)
        entries = self.log.since(request.path_params["number"])
        if user.guest:  # guests see what changes, not who changes it
            entries = [entry | {"user": ""} for entry in entries]
        return JSONResponse(
            {
                "you": user.name,
                "guest": user.guest,
                "several": len(self.secret.users) > 1,
                "last": self.log.last,
                "entries": entries,
            }
        )

    async def file(self, request: Request) -> Response:
        """Return a file of a run; the gate has checked its key."""
        run, name = request.path_params["run"], request.path_params["name"]
        try:
            handle, size = shelf.file_of_run(self.folder, run, name)
        except OSError:
            return _error_response(404, "no such file of a run")
        suffix = os.path.splitext(name)[1]
        kind = "text/html; charset=utf-8" if name == shelf.REPORT else TYPES.get(suffix)
        headers = {"Content-Length": str(size)}
        if kind is None:
            kind = (
                mimetypes.types_map.get(suffix, "application/octet-stream")
                if suffix != ".html"
                else "text/plain"
            )
            headers["Content-Disposition"] = "attachment"
        response = Pieces(os.fdopen(handle, "rb"), size, headers)
        response.headers["Content-Type"] = kind
        return response

    def _job(self, summary: dict[str, Any]) -> dict[str, Any]:
        return {**summary, "key": self.secret.key(summary["out"]) if summary["out"] else None}


class Pieces(StreamingResponse):
    """Response that sends a file in chunks, and closes it even if the client stops reading."""

    def __init__(self, file: BinaryIO, size: int, headers: dict[str, str]) -> None:
        super().__init__(_file_chunks(file, size), headers=headers)
        self._file = file

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send the response, and close the file at the end."""
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._file.close()


def _file_chunks(file: BinaryIO, size: int) -> Iterator[bytes]:
    while size > 0 and (piece := file.read(min(CHUNK, size))):
        size -= len(piece)
        yield piece


def _who(request: Request) -> User:
    """Return the user of a request, whom the gate has found."""
    user: User = request.scope["who"]
    return user


def _raise_not_found() -> tuple[str, str]:
    raise FileNotFoundError


async def _no_route(request: Request, error: Exception) -> Response:
    """Return the answer to a request that no route takes."""
    status = error.status_code if isinstance(error, HTTPException) else 500
    return _error_response(status, "there is no such address, or not for this method")


async def _broken(request: Request, error: Exception) -> Response:
    """Return the answer to a request that a mistake of the server broke; its trace is printed."""
    return _error_response(500, "this request broke off by a mistake of drift serve; report it")


def _error_response(status: int, line: str) -> Response:
    return JSONResponse({"error": line}, status)


@lru_cache
def _shipped() -> dict[str, str]:
    """Return the titles of templates and shipped cases, by name, templates first."""
    return {
        name: f"a commented case: {words}" for name, words in template.TEMPLATES.items()
    } | dict(case_file.shipped())


@lru_cache
def _asset(home: str, name: str) -> str:
    package = resources.files(home)
    return (
        (package if home == "cases" else package / "assets")
        .joinpath(name)
        .read_text(encoding="utf-8")
    )


def make(
    folder: Path,
    places: tuple[str, ...],
    secret: Secret,
    allowed: fence.Fence,
    limits: Limits,
    webhook: Webhook | None = None,
    charts: Sequence[Chart] = (),
) -> ASGIApp:
    """Return the application behind its gate.

    Args:
        folder: the served folder.
        places: "host:port" that requests must name.
        secret: users of this start, their tokens and cookies, and the keys of runs.
        allowed: files and hosts that jobs may read.
        limits: limits of jobs.
        webhook: where a message goes when a run ends.
        charts: the user's own, for the map.
    """
    desk = Desk(folder, secret, allowed, limits, webhook)
    form = FormRoutes(folder, allowed, limits, len(secret.users))
    search = SearchRoutes(folder, form)
    exports = ExportRoutes(folder, allowed, limits)
    fetches = FetchRoutes(folder, form, allowed, desk.start, JOB)

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        await desk.jobs.open()
        try:
            yield
        finally:
            await form.close()
            await exports.close()
            await desk.close()

    async def openapi(request: Request) -> Response:
        """Return the description of the API."""
        return JSONResponse(api.document(routes))

    routes: list[BaseRoute] = [
        Route("/", desk.page),
        Route("/assets/{name}", desk.asset),
        *desk.routes(),
        *form.routes(),
        *search.routes(),
        *exports.routes(),
        *fetches.routes(),
        *SpillRoutes(folder, form).routes(),
        *ChartRoutes(charts).routes(),
        Operation("GET", "/api/openapi.json", openapi, api.OBJECT),
    ]
    reads = api.open_to_guests(routes)
    broken = {HTTPException: _no_route, Exception: _broken}
    app = Starlette(routes=routes, lifespan=lifespan, exception_handlers=broken)
    return Gate(app, places, secret, reads, lambda user: desk.log.add(user.name, "entered"))
