"""The route of exports: a result in the format of another program, as one file.

A process of its own makes them, so that no first map waits for an animation. It writes nothing into
the folder.
"""

import base64
from pathlib import Path
from typing import Any
from urllib.parse import quote

from starlette.responses import Response

from drift.apps.serve import names
from drift.apps.serve.api import TEXT, Operation, record
from drift.apps.serve.jobs import Limits
from drift.apps.serve.routes.form_routes import Invalid, answered, check_keys
from drift.apps.serve.warm import Warm
from geo.files import fence

# as in export_answers, which the server does not import: Matplotlib and xarray come with it
FORMATS = ("mail", "kml", "kmz", "gpx", "geojson", "geotiff", "rtz", "gif", "sitrep")
TYPES = {
    ".zip": "application/zip",
    ".kml": "application/vnd.google-earth.kml+xml",
    ".kmz": "application/vnd.google-earth.kmz",
    ".gpx": "application/gpx+xml",
    ".geojson": "application/geo+json",
    ".gif": "image/gif",
}


class ExportRoutes:
    """The request handler of exports."""

    def __init__(self, folder: Path, allowed: fence.Fence, limits: Limits) -> None:
        self.folder = folder
        self.exporting = Warm(folder, allowed, limits)

    def routes(self) -> list[Operation]:
        """Return the route; guests have nothing computed."""
        takes = record(run=TEXT, format={"enum": list(FORMATS)})
        made = answered(self.export)
        return [Operation("POST", "/api/export", made, None, takes=takes, mistakes=True)]

    async def close(self) -> None:
        """End the process."""
        await self.exporting.close()

    async def export(self, body: dict[str, Any]) -> Any:
        """Return a result as a file of another format, or as one to mail."""
        check_keys(body, {"run", "format"})
        run, kind = body["run"], body["format"]
        if not isinstance(run, str) or not names.plain(run):
            raise Invalid("give a result of this folder")
        if not isinstance(kind, str) or kind not in FORMATS:
            raise Invalid(f"formats are {', '.join(FORMATS)}")
        told = await self.exporting.ask("export", folder=str(self.folder), run=run, format=kind)
        suffix = str(told["suffix"])
        name = f"{run}{suffix}"
        headers = {"Content-Disposition": f"attachment; filename*=UTF-8''{quote(name, safe='')}"}
        media = TYPES.get(suffix[suffix.rfind(".") :], "application/octet-stream")
        return Response(base64.b64decode(told["content"]), headers=headers, media_type=media)
