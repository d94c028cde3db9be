"""What the warm process answers about a result: a short text for a message or e-mail."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from drift.apps.serve import names, shelf
from drift.forecast import mapped
from drift.forecast.products import headline
from drift.products.maps import labels
from geo import notation
from geo.errors import UserError
from geo.files import fence

FORECAST = "forecast.nc"


def note(request: Mapping[str, Any]) -> dict[str, Any]:
    """Return the text: title, most likely place, areas, warnings and the run.

    Args:
        request: the path of a result as `path`.
    """
    path = Path(request["path"])
    try:
        handle, _ = shelf.file_of_run(path.parent, path.name, FORECAST)  # no pipe, no link
        with open(handle, "rb"):
            fence.check_open(handle, path / FORECAST)
        content = json.loads(
            names.contents(path.parent, path.name, shelf.SUMMARY, largest=shelf.LARGEST_SUMMARY)
        )
        opens = content.get("opens")
        with xr.open_dataset(path / FORECAST) as data:
            lines = _lines(data, None if opens is None else np.datetime64(opens.rstrip("Z"), "s"))
        title, run, warnings = content["title"], content["run_id"], content.get("warnings", [])
    except (OSError, LookupError, ValueError, TypeError, AttributeError, RecursionError):
        raise UserError(f"{path.name}: is not a result with a forecast") from None
    lines = [title, *lines, *(f"Warning: {line}" for line in warnings), f"Run {run} of casp-drift."]
    return {"text": "\n".join(str(line) for line in lines) + "\n"}


def _lines(data: xr.Dataset, opens: np.datetime64 | None) -> list[str]:
    """Return the sentences of the report, and the size of each area at the same time."""
    at = data.isel(time=mapped.opening_output(data, opens))
    areas = [
        f"{notation.percent(float(share), 0)} in {labels.number(float(area) / notation.NMI**2)} nmi²"
        for share, area in zip(at["share"].values, at["containment_area"].values, strict=True)
        if np.isfinite(area)
    ]
    when = notation.format_dtg(at["time"].values)
    lon, lat = float(at["mean_lon"]), float(at["mean_lat"])
    lines = [headline.forecast_headline(data, opens)]
    lines += [f"Areas at {when}: {', '.join(areas)}."] if areas else []
    lines += [f"Mean position: {notation.position(lon, lat)}."] if np.isfinite(lon) else []
    return lines
