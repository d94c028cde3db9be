"""Routes of the form and the map: what they take, and which warm process answers them.

None of them reads or writes a case file: the page sends the text.
"""

import asyncio
import functools
import inspect
import math
import time
from collections.abc import Awaitable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from drift.apps.serve import api, names, shelf
from drift.apps.serve.api import FLAG, NUMBER, TEXT, Operation, Schema, many, or_null, record
from drift.apps.serve.fields import form
from drift.apps.serve.jobs import Limits
from drift.apps.serve.warm import Overtaken, Warm
from drift.engine.motion.objects import everyday, leeway
from geo.errors import UserError
from geo.files import fence

FORCING = (".nc", ".nc4", ".grib", ".grib2", ".grb", ".grb2")  # files that the page offers
COARSEST, FINEST = 5.0, 1e-4  # [deg] detail of a shoreline
MOST_STEPS = 20_000  # detail across a box


# what requests take and answers have, as JSON Schema
CHANGES = many(record(field=TEXT, value=api.ANYTHING)) | {
    "minItems": 1,
    "maxItems": form.MOST_CHANGES,
}
FIELD = record(("value", "read", "in_text"), value=api.ANYTHING, read=api.ANYTHING, in_text=FLAG)
FORM = record(
    fields={"type": "object", "additionalProperties": FIELD},
    unknown=many(TEXT),
    scenarios=api.COUNT,
    spill=FLAG,
)
MESSAGES = record(messages=many(record(message=TEXT, field=or_null(TEXT), line=or_null(api.COUNT))))
BOX = many(NUMBER) | {"minItems": 4, "maxItems": 4}
POINT = many(NUMBER) | {"minItems": 2, "maxItems": 2}
GEOJSON: Schema = {
    "type": "object",
    "properties": {
        "type": {"const": "FeatureCollection"},
        "features": many({"type": "object", "required": ["type", "geometry", "properties"]}),
    },
    "required": ["type", "features"],
}
LIKELY = record(at=POINT, ashore=api.FLAG, share=NUMBER)
PARTICLES = record(lon=many(many(NUMBER)), lat=many(many(NUMBER)), status=many(many(api.COUNT)))
STRETCH = record(
    id=TEXT,
    segment=api.COUNT,
    name=TEXT,
    at=POINT,
    length_km=NUMBER,
    first=or_null(TEXT),
    lines=many(many(POINT)),
)
FOUND = record(name=TEXT, at=POINT, stretch=TEXT, chance=NUMBER, odd=FLAG)
VISIT = record(segment=api.COUNT, name=TEXT, lying=NUMBER, found=NUMBER)
PATROL = record(name=TEXT, team=TEXT, time=TEXT, length_km=NUMBER, found=NUMBER, visits=many(VISIT))
# objects by stretch of coast and time: of all classes and of each, with 80 % ranges
WASHUP = record(
    run=TEXT,
    times=many(TEXT),
    classes=many(TEXT),
    lost=NUMBER,
    ashore=many(many(NUMBER)),
    expected=many(many(many(NUMBER))),
    low=many(many(NUMBER)),
    high=many(many(NUMBER)),
    probability=many(many(NUMBER)),
    number=api.COUNT,
    stretches=many(STRETCH),
    finds=many(FOUND),
    patrols=many(PATROL),
    plan=or_null(record(found=NUMBER, found_se=NUMBER, bound=NUMBER)),
    warnings=many(TEXT),
)
SKETCH = record(
    number=api.COUNT,
    title=TEXT,
    words=TEXT,
    warnings=many(TEXT),
    times=many(TEXT),
    opens=or_null(TEXT),
    areas=GEOJSON,
    likely=many(many(LIKELY)),
    statuses=many(TEXT),
    particles=PARTICLES,
    scenarios=many(record(name=TEXT, probability=many(NUMBER))),
    ashore=many(NUMBER),
    washup=or_null(WASHUP),
)
SOURCE = record(quantity=TEXT, box=BOX, times=many(TEXT))
FORCING_ANSWER = record(("files", "sources"), files=many(TEXT), sources=many(SOURCE))
OBJECT_ADRIFT = record(name=TEXT, description=TEXT, level=api.COUNT, words=many(TEXT))


class Invalid(Exception):
    """A request that is not as the page sends it: status and line."""

    def __init__(self, line: str, status: int = 400) -> None:
        super().__init__(line)
        self.status = status


class FormRoutes:
    """Request handlers of the form, the sketch and the map."""

    def __init__(self, folder: Path, allowed: fence.Fence, limits: Limits, users: int = 1) -> None:
        self.folder = folder
        self.typing = Warm(folder, allowed, limits, users)
        self.sketching = Warm(folder, allowed, limits, users)
        self._warming: asyncio.Task[Any] | None = None
        self._preparing: set[asyncio.Task[Any]] = set()

    def routes(self) -> list[Operation]:
        """Return the routes."""
        typed = {"text": TEXT, "name": api.CASE}
        return [
            post("form", self.form, record(text=TEXT), FORM, True),
            post("form/set", self.set, record(text=TEXT, changes=CHANGES), record(text=TEXT), True),
            post("form/new", self.new, api.NOTHING, record(text=TEXT), True),
            post("check", self.check, record(**typed), MESSAGES, True),
            post("sketch", self.sketch, record(**typed), SKETCH, False),
            post("sketch/cancel", self.cancel, api.NOTHING, api.NOTHING, False),
            post("coast", self.coast, record(box=BOX, step=NUMBER), GEOJSON, True),
            post("forcing", self.forcing, record(file=or_null(TEXT)), FORCING_ANSWER, True),
            post("note", self.note, record(run=TEXT), record(text=TEXT), True),
            Operation("GET", "/api/objects", self.objects, record(objects=many(OBJECT_ADRIFT))),
        ]

    async def close(self) -> None:
        """End the warm processes."""
        if self._warming is not None:
            self._warming.cancel()
            await asyncio.gather(self._warming, return_exceptions=True)
        for task in self._preparing:
            task.cancel()
        await asyncio.gather(*self._preparing, return_exceptions=True)
        await self.typing.close()
        await self.sketching.close()

    async def form(self, body: dict[str, Any]) -> Any:
        """Return what the form shows of a text."""
        return await self.typing.ask("form", text=text_of(body, {"text"}))

    async def set(self, body: dict[str, Any]) -> Any:
        """Return a text with changed fields."""
        text, changes = text_of(body, {"text", "changes"}), body["changes"]
        if (
            not isinstance(changes, list)
            or not 1 <= len(changes) <= form.MOST_CHANGES
            or not all(
                isinstance(one, dict)
                and one.keys() == {"field", "value"}
                and isinstance(one["field"], str)
                for one in changes
            )
        ):
            raise Invalid(f"give 1 to {form.MOST_CHANGES} changes, each with its field and value")
        return await self.typing.ask("set", text=text, changes=changes)

    async def new(self, body: dict[str, Any]) -> Any:
        """Return the text of a new case, and warm the process that makes sketches."""
        check_keys(body, set())
        self._warm_up()
        now = np.datetime64(int(time.time()) // 60 * 60, "s")
        return {"text": form.new_text(now)}

    async def check(self, body: dict[str, Any], guest: bool) -> Any:
        """Return the mistakes of a text, with line and field; without any, prepare its first map.

        Guests make no first map.
        """
        self._warm_up()
        values = {"text": text_of(body, {"text", "name"}), "path": self.path_of(body)}
        told = await self.typing.ask("check", **values)
        if not told["messages"] and not guest:
            task = asyncio.create_task(_silent(self.sketching.prepare(**values)))
            self._preparing.add(task)
            task.add_done_callback(self._preparing.discard)
        return told

    async def sketch(self, body: dict[str, Any], user: str) -> Any:
        """Return a forecast of few particles; it takes the place of the user's one before it."""
        text, path = text_of(body, {"text", "name"}), self.path_of(body)
        return await self.sketching.ask_newest("sketch", user, text=text, path=path)

    async def cancel(self, body: dict[str, Any], user: str) -> Any:
        """Give up the user's sketch that is being made."""
        check_keys(body, set())
        await self.sketching.cancel(user)
        return {}

    async def note(self, body: dict[str, Any]) -> Any:
        """Return a short text about a result, for a message."""
        check_keys(body, {"run"})
        run = body["run"]
        if not isinstance(run, str) or not names.plain(run):
            raise Invalid("give the name of a result of this folder")
        return await self.typing.ask("note", path=str(self.folder / run))

    async def coast(self, body: dict[str, Any]) -> Any:
        """Return the land in a box."""
        check_keys(body, {"box", "step"})
        box, step = body["box"], body["step"]
        if (
            not isinstance(box, list)
            or len(box) != 4
            or not all(is_number(one) for one in (*box, step))
            or not (-540 <= box[0] < box[2] <= 540 and -90 <= box[1] < box[3] <= 90)
            or box[2] - box[0] > 360
            or not FINEST <= step <= COARSEST
            or (box[2] - box[0] + box[3] - box[1]) / step > MOST_STEPS
        ):
            raise Invalid("give a box, [west, south, east, north], and a step, in degrees")
        return await self.typing.ask("coast", box=box, step=step)

    async def forcing(self, body: dict[str, Any]) -> Any:
        """Return the files of winds and currents in the folder, or what one of them covers."""
        check_keys(body, {"file"})
        name = body["file"]
        if name is None:
            return {"files": await self.files_ending(FORCING)}
        if not isinstance(name, str) or not names.plain(name) or not name.lower().endswith(FORCING):
            raise Invalid("give a file of winds or currents of this folder")
        return await self.sketching.ask("forcing", path=str(self.folder / name))

    async def objects(self, request: Request) -> Response:
        """Return the objects that can be adrift, with everyday words for them."""
        return JSONResponse({"objects": _objects()})

    async def files_ending(self, endings: tuple[str, ...]) -> list[str]:
        """Return the names of the files of the folder that end so."""
        entries = await asyncio.to_thread(lambda: list(shelf.entries(self.folder)))
        found = sorted(
            entry.name
            for entry in entries
            if names.plain(entry.name)
            and entry.name.lower().endswith(endings)
            and entry.is_file(follow_symlinks=False)
        )
        return found[: shelf.MOST]

    def path_of(self, body: dict[str, Any]) -> str:
        """Return the path of the case of a text, from whose folder its files are looked for."""
        name = body["name"]
        if not isinstance(name, str) or not names.case(name):
            raise Invalid("give the name of a case")
        return str(self.folder / name)

    async def warmed(self) -> None:
        """Wait until the process that makes sketches has compiled what it needs."""
        self._warm_up()
        assert self._warming is not None
        await asyncio.shield(self._warming)

    def _warm_up(self) -> None:
        if self._warming is None:
            self._warming = asyncio.create_task(_silent(self.sketching.ask("warm")))


async def _silent(work: Awaitable[Any]) -> None:
    """Wait for a request whose answer is no longer needed."""
    try:
        await work
    except (UserError, Overtaken):
        return


def post(path: str, handler: Any, takes: Schema, answers: Schema, reads: bool) -> Operation:
    """Return a route that takes and answers JSON.

    Args:
        path: below /api/.
        handler: takes the body, and if it has parameters of these names, `user`, the user's name,
            and `guest`, whether it is a guest.
        takes, answers: JSON Schema of body and answer.
        reads: whether guests may use it.
    """
    made = answered(handler)
    return Operation("POST", f"/api/{path}", made, answers, takes=takes, reads=reads, mistakes=True)


def answered(handler: Any) -> Any:
    """Return a handler that turns what goes wrong into a status and a line."""
    wanted = inspect.signature(handler).parameters.keys() & {"user", "guest"}

    @functools.wraps(handler)
    async def answer(request: Request) -> Response:
        who = request.scope["who"]
        known = {"user": who.name, "guest": who.guest}
        try:
            told = await handler(request.scope["body"], **{name: known[name] for name in wanted})
            return told if isinstance(told, Response) else JSONResponse(told)
        except Invalid as invalid:
            return JSONResponse({"error": str(invalid)}, invalid.status)
        except asyncio.CancelledError:  # the server ends without waiting for it
            return JSONResponse({"error": "the server ends"}, 503)
        except Overtaken as overtaken:
            return JSONResponse({"error": str(overtaken)}, 409)
        except UserError as error:
            # about the case, not about the request, which a browser would report as an error
            return JSONResponse({"mistakes": list(error.lines)})
        except OSError as error:
            return JSONResponse({"error": f"the folder cannot be read: {error.strerror}"}, 500)

    return answer


def check_keys(body: dict[str, Any], wanted: set[str]) -> None:
    """Reject a request that has not exactly these keys."""
    if body.keys() != wanted:
        raise Invalid(f"give {', '.join(sorted(wanted)) or 'nothing'}")


def text_of(body: dict[str, Any], wanted: set[str]) -> str:
    """Return the text of a request with these keys."""
    check_keys(body, wanted)
    text = body["text"]
    if (
        not isinstance(text, str)
        or "\0" in text
        or any("\ud800" <= one <= "\udfff" for one in text)
    ):
        raise Invalid("this is not text")
    if len(text.encode()) > form.LARGEST:
        raise Invalid(f"a case has at most {form.LARGEST:,} bytes", 413)
    return text


def is_number(value: object) -> bool:
    """Return whether a value is a finite number."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond floating point
        return False


@lru_cache
def _objects() -> list[dict[str, Any]]:
    """Return all leeway classes, each with the everyday words that mean it."""
    classes = tuple(leeway.classes())
    words: dict[str, list[str]] = {name: [] for name in classes}
    for word in everyday.everyday_words():
        meaning = everyday.classes_of_word(word, classes)
        for name in meaning.classes if meaning else ():
            words[name].append(word)
    listed = [
        {
            "name": one.name,
            "description": one.description,
            "level": one.level,
            "words": words[one.name],
        }
        for one in leeway.classes().values()
    ]
    water = leeway.WATER
    return [
        *listed,
        {"name": water.name, "description": water.description, "level": 0, "words": ["water"]},
    ]
