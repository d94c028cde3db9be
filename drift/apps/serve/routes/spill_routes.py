"""Routes of spills: fields of a text, the ship's track, stretches of coast and patrols on the map.

A track is the only thing that they write: under a plain name that is free, into the folder.
"""

from pathlib import Path
from typing import Any

from drift.apps.serve import api
from drift.apps.serve.api import FLAG, NUMBER, TEXT, Operation, Schema, many, or_null, record
from drift.apps.serve.routes.form_routes import (
    POINT,
    WASHUP,
    FormRoutes,
    Invalid,
    check_keys,
    post,
    text_of,
)
from drift.apps.serve.routes.search_routes import ROWS, run_of, save_track

TRACKS = (".gpx", ".csv", ".nc")  # files of a ship's positions
DROPPED = TRACKS
LONGEST_NAME = 1100  # characters of the name of a patrol

# what requests take and answers have, as JSON Schema


def _by_number(one: Schema) -> Schema:
    return {"type": "object", "additionalProperties": one}


PLACED = record(at=POINT, off_shore=or_null(NUMBER), mistake=or_null(TEXT))
SPILL = record(
    **ROWS,
    shapes=record(
        track=many(POINT),
        losses=many(record(points=many(POINT), period=TEXT)),
        finds=_by_number(PLACED),
        patrols=_by_number(record(points=many(POINT))),
        teams=_by_number(record(at=POINT, reach=NUMBER)),
    ),
)


class SpillRoutes:
    """Request handlers of spills."""

    def __init__(self, folder: Path, form: FormRoutes) -> None:
        self.folder, self.form = folder, form

    def routes(self) -> list[Operation]:
        """Return the routes; guests may not save a track."""
        turned = record(text=TEXT, spill=FLAG)
        track = record(name=TEXT, text=TEXT)
        kept = record(run=TEXT, patrol=TEXT, text=TEXT)
        return [
            post("spill", self.spill, record(text=TEXT, name=api.CASE), SPILL, True),
            post("spill/turn", self.turn, turned, record(text=TEXT), True),
            post("spill/tracks", self.tracks, api.NOTHING, record(files=many(TEXT)), True),
            post("spill/track", self.save_track, track, record(name=TEXT), False),
            post("washup", self.washup, record(run=TEXT), WASHUP, True),
            post("washup/keep", self.keep, kept, record(text=TEXT, name=TEXT), True),
        ]

    async def spill(self, body: dict[str, Any]) -> Any:
        """Return the spill of a text: its fields, and what a map shows of them."""
        text = text_of(body, {"text", "name"})
        return await self.form.typing.ask("spill", text=text, path=self.form.path_of(body))

    async def turn(self, body: dict[str, Any]) -> Any:
        """Return the text of a search as that of a spill, or the other way."""
        text = text_of(body, {"text", "spill"})
        if not isinstance(body["spill"], bool):
            raise Invalid("spill is true or false")
        return await self.form.typing.ask("spill/turn", text=text, spill=body["spill"])

    async def tracks(self, body: dict[str, Any]) -> Any:
        """Return the files of the folder that may hold a ship's positions."""
        check_keys(body, set())
        return {"files": await self.form.files_ending(TRACKS)}

    async def save_track(self, body: dict[str, Any]) -> Any:
        """Save a ship's track (a netCDF file in base64) in the folder, if its name is free."""
        return await save_track(self.folder, body, DROPPED)

    async def washup(self, body: dict[str, Any]) -> Any:
        """Return the stretches of coast of a result, its finds and its planned patrols."""
        check_keys(body, {"run"})
        return await self.form.sketching.ask("washup", **run_of(body, self.folder))

    async def keep(self, body: dict[str, Any]) -> Any:
        """Return a text with a planned patrol as one that was carried out."""
        text = text_of(body, {"run", "patrol", "text"})
        patrol = body["patrol"]
        if not isinstance(patrol, str) or len(patrol) > LONGEST_NAME:
            raise Invalid("give the name of a patrol")
        run = run_of(body, self.folder)
        return await self.form.typing.ask("washup/keep", **run, patrol=patrol, text=text)
