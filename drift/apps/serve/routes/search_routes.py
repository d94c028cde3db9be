"""Routes of the searches: fields and patterns of a text, GPX files, plans and results on the map.

A GPX file is the only thing that they write: under a plain name that is free, into the folder. All
that is computed is computed by the warm processes of the form.
"""

import asyncio
import base64
from pathlib import Path
from typing import Any

from drift.apps.serve import api, names, shelf
from drift.apps.serve.api import NUMBER, TEXT, Operation, Schema, many, or_null, record
from drift.apps.serve.fields import search_fields
from drift.apps.serve.routes.form_routes import (
    GEOJSON,
    LIKELY,
    PARTICLES,
    POINT,
    FormRoutes,
    Invalid,
    check_keys,
    is_number,
    post,
    text_of,
)

GPX, NETCDF = ".gpx", ".nc"
MARKS = (b"CDF\x01", b"CDF\x02", b"CDF\x05", b"\x89HDF\r\n\x1a\n")  # that netCDF files begin with
LARGEST_TRACK = 2**20  # [bytes]
HEAD = 4096  # characters in which a GPX file says that it is one
MOST_MOVES = 100
LONGEST_LABEL = 20  # characters of the name of a sub-area
LONGEST_SCENARIO = 300

# what requests take and answers have, as JSON Schema
MOVE = record(at=POINT, turned=NUMBER)
POINTS = many(POINT)
ROW = record(values=api.OBJECT, in_text=many(TEXT))
SEARCHED = {
    "outline": or_null(POINTS),
    "legs": many(record(searching=api.FLAG, points=POINTS)),
    "start": TEXT,
    "end": TEXT,
    "period": TEXT,
    "track_nmi": NUMBER,
    "legs_number": api.COUNT,
    "pod": or_null(NUMBER),
}
SEEN = record(shape={"enum": ["point", "region", "line"]}, points=POINTS)
# rows of searches and of spills
ROWS: dict[str, Schema] = {
    "rows": record(**dict.fromkeys(search_fields.TABLES, many(ROW))),
    **dict.fromkeys(search_fields.SINGLE, ROW),
}
SEARCHES = record(
    **ROWS,
    shapes=record(
        sortie={"type": "object", "additionalProperties": record(**SEARCHED)},
        contact={"type": "object", "additionalProperties": many(SEEN)},
        unit={"type": "object", "additionalProperties": POINT},
    ),
    search_objects=many(TEXT),
)
AREA: dict[str, Schema] = SEARCHED | {
    "name": TEXT,
    "unit": TEXT,
    "centre": POINT,
    "orientation": NUMBER,
    "length_nmi": NUMBER,
    "width_nmi": NUMBER,
    "place": TEXT,
    "notes": many(TEXT),
    "pos": NUMBER,
}
PLAN = record(
    run=TEXT,
    areas=many(record(**AREA)),
    total=NUMBER,
    objective=TEXT,
    bound=or_null(NUMBER),
    warnings=many(TEXT),
)
MOVED_PLAN = record(
    run=TEXT,
    areas=many(record(**AREA, as_planned=NUMBER)),
    total=NUMBER,
    as_planned=NUMBER,
    by_scenario={"type": "object", "additionalProperties": or_null(NUMBER)},
    took_ms=NUMBER,
)
SCENARIO = record(name=TEXT, probability=many(NUMBER))
RESULT = record(
    times=many(TEXT),
    opens=or_null(TEXT),
    scenarios=many(SCENARIO),
    areas=GEOJSON,
    words=TEXT,
    likely=many(many(LIKELY)),
    ashore=many(NUMBER),
    statuses=many(TEXT),
    particles=PARTICLES,
)
VALUE = record(per_nmi2=NUMBER, within=or_null(NUMBER))


class SearchRoutes:
    """Request handlers of the step "Search", of plans on the map and of results on the map."""

    def __init__(self, folder: Path, form: FormRoutes) -> None:
        self.folder, self.form = folder, form

    def routes(self) -> list[Operation]:
        """Return the routes; guests may not save a track, nor have moves computed."""
        run: Schema = {"run": TEXT}
        moves = {"moves": {"type": "object", "additionalProperties": MOVE}}
        kept = record(**run, **moves, area=TEXT, text=TEXT)
        scenario = {"scenario": or_null(TEXT)}
        value = record(**run, **scenario, time=api.COUNT, at=POINT)
        text = record(text=TEXT, name=api.CASE)
        track = record(name=TEXT, text=TEXT)
        return [
            post("search", self.search, text, SEARCHES, True),
            post("search/tracks", self.tracks, api.NOTHING, record(files=many(TEXT)), True),
            post("search/gpx", self.save_track, track, record(name=TEXT), False),
            post("plan", self.plan, record(**run), PLAN, True),
            post("plan/pos", self.pos, record(**run, **moves), MOVED_PLAN, False),
            post("plan/keep", self.keep, kept, record(text=TEXT, name=TEXT), True),
            post("result", self.result, record(**run, **scenario), RESULT, True),
            post("result/value", self.value, value, VALUE, True),
        ]

    async def search(self, body: dict[str, Any]) -> Any:
        """Return the searches of a text: their fields, patterns and shapes."""
        text = text_of(body, {"text", "name"})
        return await self.form.typing.ask("search", text=text, path=self.form.path_of(body))

    async def tracks(self, body: dict[str, Any]) -> Any:
        """Return the GPX files of the folder."""
        check_keys(body, set())
        return {"files": await self.form.files_ending((GPX,))}

    async def save_track(self, body: dict[str, Any]) -> Any:
        """Save a GPX file in the folder, under its name if that is free."""
        return await save_track(self.folder, body, (GPX,))

    async def plan(self, body: dict[str, Any]) -> Any:
        """Return the sub-areas of a plan."""
        check_keys(body, {"run"})
        return await self.form.typing.ask("plan", **run_of(body, self.folder))

    async def pos(self, body: dict[str, Any]) -> Any:
        """Return the POS of a plan with moved sub-areas."""
        check_keys(body, {"run", "moves"})
        run, moves = run_of(body, self.folder), _moves(body)
        await self.form.warmed()  # else a move may wait for it
        return await self.form.sketching.ask("plan/pos", **run, moves=moves)

    async def keep(self, body: dict[str, Any]) -> Any:
        """Return a text with a sub-area of a plan as one more sortie."""
        text = text_of(body, {"run", "moves", "area", "text"})
        area = body["area"]
        if not isinstance(area, str) or len(area) > LONGEST_LABEL:
            raise Invalid("give the name of a sub-area")
        return await self.form.typing.ask(
            "plan/keep", **run_of(body, self.folder), moves=_moves(body), area=area, text=text
        )

    async def result(self, body: dict[str, Any]) -> Any:
        """Return the scenarios of a result, and the areas of one of them."""
        check_keys(body, {"run", "scenario"})
        return await self.form.sketching.ask(
            "result", **run_of(body, self.folder), scenario=_scenario(body)
        )

    async def value(self, body: dict[str, Any]) -> Any:
        """Return the probability at a place of a result."""
        check_keys(body, {"run", "scenario", "time", "at"})
        time = body["time"]
        if not isinstance(time, int) or isinstance(time, bool) or not 0 <= time < 10**6:
            raise Invalid("give the number of an output")
        return await self.form.sketching.ask(
            "result/value",
            **run_of(body, self.folder),
            scenario=_scenario(body),
            time=time,
            at=_position(body["at"]),
        )


def run_of(body: dict[str, Any], folder: Path) -> dict[str, str]:
    """Return the folder and the name of the result of a request."""
    run = body["run"]
    if not isinstance(run, str) or not names.plain(run):
        raise Invalid("give a result of this folder")
    return {"folder": str(folder), "run": run}


async def save_track(folder: Path, body: dict[str, Any], endings: tuple[str, ...]) -> Any:
    """Save a track in a folder, under its name if that is free.

    Args:
        folder: the served folder.
        body: `name` and `text` of the file; the text of a netCDF file is base64.
        endings: that its name may have; a GPX file has <gpx at its head, a netCDF file its mark.
    """
    text = text_of(body, {"name", "text"})
    name = body["name"]
    if not isinstance(name, str) or not names.plain(name) or not name.lower().endswith(endings):
        letters = f"letters, digits, spaces and . _ - + ( ), at most {names.LONGEST}"
        ends = " or ".join(endings)
        raise Invalid(f"the name of a track is made of {letters}, and ends in {ends}")
    data = _decoded(name, text) if name.lower().endswith(NETCDF) else text.encode()
    if len(data) > LARGEST_TRACK:
        raise Invalid(f"a track has at most {LARGEST_TRACK:,} bytes", 413)
    if name.lower().endswith(GPX) and (
        "<gpx" not in text[:HEAD] or "<!DOCTYPE" in text or "<!ENTITY" in text
    ):
        raise Invalid(f"{name} is not a GPX file: it needs <gpx at its head, and no DOCTYPE")
    try:
        await asyncio.to_thread(shelf.save_bytes, folder, name, data, None)
    except shelf.Conflict:
        raise Invalid(f"{name} exists already; nothing was saved", 409) from None
    except OSError as error:
        raise Invalid(f"{name} cannot be saved: {error.strerror}", 500) from None
    return {"name": name}


def _decoded(name: str, text: str) -> bytes:
    """Return the bytes of a netCDF file that was sent in base64."""
    try:
        data = base64.b64decode(text, validate=True)
    except ValueError:
        raise Invalid(f"{name}: a netCDF file is sent in base64") from None
    if not data.startswith(MARKS):
        raise Invalid(f"{name} is not a netCDF file: it begins with neither CDF nor HDF")
    return data


def _scenario(body: dict[str, Any]) -> str | None:
    scenario = body["scenario"]
    if scenario is not None and not (
        isinstance(scenario, str) and 0 < len(scenario) <= LONGEST_SCENARIO
    ):
        raise Invalid("give the name of a scenario, or null")
    if scenario is not None and any("\ud800" <= one <= "\udfff" for one in scenario):
        raise Invalid("this is not text")
    return scenario


def _moves(body: dict[str, Any]) -> dict[str, Any]:
    """Return the moves of a request, by the name of a sub-area."""
    moves = body["moves"]
    if not isinstance(moves, dict) or len(moves) > MOST_MOVES:
        raise Invalid(f"give at most {MOST_MOVES} moves, by the name of a sub-area")
    for name, move in moves.items():
        if len(name) > LONGEST_LABEL or any("\ud800" <= one <= "\udfff" for one in name):
            raise Invalid("give moves by the name of a sub-area")
        if not isinstance(move, dict) or move.keys() != {"at", "turned"}:
            raise Invalid("give of each move at and turned")
        _position(move["at"])
        if not is_number(move["turned"]) or abs(move["turned"]) > 360:
            raise Invalid("turned is an angle in degrees, from -360 to 360")
    return moves


def _position(at: Any) -> list[float]:
    if (
        not isinstance(at, list)
        or len(at) != 2
        or not all(is_number(one) for one in at)
        or not (abs(at[0]) <= 540 and abs(at[1]) <= 89)
    ):
        raise Invalid("a place is [longitude, latitude] in degrees")
    return at
