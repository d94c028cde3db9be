"""Routes of the user's own charts: which there are, and their tiles."""

import base64
from collections.abc import Sequence

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from drift.apps.serve.api import COUNT, NUMBER, TEXT, Operation, many, or_null, record
from drift.apps.serve.charts import Chart

CHART = record(name=TEXT, attribution=TEXT, least=COUNT, most=COUNT, bounds=or_null(many(NUMBER)))
# one transparent point, where a chart has no tile: to a browser a missing file is an error
NOTHING = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNgYGBgAAAABQABeqhXUAAAAABJRU5E"
    "rkJggg=="
)
TILE = "/api/charts/{number:int}/{zoom:int}/{column:int}/{row:int}"


class ChartRoutes:
    """Request handlers of charts."""

    def __init__(self, charts: Sequence[Chart]) -> None:
        self.charts = charts

    def routes(self) -> list[Operation]:
        """Return the routes."""
        return [
            Operation("GET", "/api/charts", self.list_charts, record(charts=many(CHART))),
            Operation("GET", TILE, self.tile, None),
        ]

    async def list_charts(self, request: Request) -> Response:
        """Return the user's charts."""
        listed = [
            {
                "name": one.name,
                "attribution": one.attribution,
                "least": one.least,
                "most": one.most,
                "bounds": one.bounds,
            }
            for one in self.charts
        ]
        return JSONResponse({"charts": listed})

    async def tile(self, request: Request) -> Response:
        """Return the image of a tile, as tiles are numbered on the web: rows from the north."""
        number, zoom, column, row = (
            request.path_params[name] for name in ("number", "zoom", "column", "row")
        )
        if number >= len(self.charts) or zoom > self.charts[number].most:
            return JSONResponse({"error": "no such chart, or not so large"}, 404)
        found = await run_in_threadpool(self.charts[number].tile, zoom, column, row)
        kind, data = found or ("image/png", NOTHING)
        return Response(data, media_type=kind)
