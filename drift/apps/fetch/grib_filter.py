"""Subsets from the GRIB filter of NOMADS: one request per time, answered by a GRIB file of the box.

https://nomads.ncep.noaa.gov (Grib Filter). Each time comes from the latest run that contains it:
past times from the runs of their day, future times from the newest run.
"""

import hashlib
import json
import warnings
from datetime import datetime
from functools import partial
from pathlib import Path
from urllib.parse import quote, urlencode

import numpy as np

from drift.apps.fetch.order import Order, Part, Shipment
from geo.errors import UserError
from geo.files import dataset, web
from geo.files.web import TemporaryError

HOUR = np.timedelta64(3600, "s")
TOGETHER = 12  # times in one part
MARGIN = 0.5  # [deg] around the box: two cells of GFS
CELL = 0.25  # [deg] of GFS
PACKED = 2.0  # [bytes] most per value in packed GRIB, as GFS packs winds
LARGEST = 200_000_000  # [bytes] most for one time; the whole globe has 4 MB


def ship(order: Order) -> Shipment:
    """Return the shipment of an order, without a request: the filter describes nothing.

    Raises UserError if the provider does not cover the span.
    """
    first, last = order.provider.span(order.asked)
    if order.begin < first or order.end > last:
        raise UserError(
            f"{order.provider.name} has about {first}Z to {last}Z, not all of {order.begin}Z to {order.end}Z: "
            "ask for another span (--from, --to) or provider"
        )
    requests = _requests(order)
    box = order.box.grown(MARGIN, MARGIN)
    nodes = ((box.east - box.west) / CELL + 1) * ((box.north - box.south) / CELL + 1)
    parts = []
    for start in range(0, len(requests), TOGETHER):
        piece = requests[start : start + TOGETHER]
        key = hashlib.sha256(
            json.dumps([order.provider.name, [a for _, a in piece]]).encode()
        ).hexdigest()
        times = np.array([t for t, _ in piece], "datetime64[s]")
        size = 2 * PACKED * nodes * len(piece)
        addresses = [a for _, a in piece]
        parts.append(Part(key, partial(_make, addresses, order), times, size))
    return Shipment(order, tuple(parts), ("size estimated: the filter does not report it",))


def _requests(order: Order) -> list[tuple[np.datetime64, str]]:
    """Return the times that an order needs, each with the address of its request."""
    runs = order.provider.runs
    assert runs is not None
    every = int(runs["every"]) * HOUR
    newest = _round_down(order.asked - int(runs["delay"]) * HOUR, every)
    found = []
    time = _round_down(order.begin, HOUR)
    while True:
        run = min(_round_down(time, every), newest)
        lead = int((time - run) / HOUR)
        step = next((step for until, step in runs["steps"] if lead <= until), None)
        if step is None:
            raise UserError(f"{order.provider.name}: {time}Z is beyond the end of its last run")
        if lead % step == 0:
            found.append((time, _address(order, run, lead)))
            if time >= order.end:
                return found
        elif not found:
            time -= 2 * HOUR  # back to a time that the run contains
        time += HOUR


def _round_down(time: np.datetime64, every: np.timedelta64) -> np.datetime64:
    """Return a time rounded down to a multiple of an interval since midnight."""
    day = time.astype("datetime64[D]").astype("datetime64[s]")
    return np.datetime64(day + (time - day) // every * every, "s")


def _address(order: Order, run: np.datetime64, lead: int) -> str:
    provider, box = order.provider, order.box.grown(MARGIN, MARGIN)
    assert provider.runs is not None
    of_run = datetime.fromisoformat(str(run))
    query = {
        "dir": of_run.strftime(provider.runs["folder"]),
        "file": of_run.strftime(provider.runs["file"]).format(lead=lead),
        **{f"var_{name}": "on" for name in provider.variables},
        f"lev_{provider.runs['level']}": "on",
        "subregion": "",
        "leftlon": f"{box.west:.2f}",
        "rightlon": f"{box.east:.2f}",
        "toplat": f"{box.north:.2f}",
        "bottomlat": f"{box.south:.2f}",
    }
    return f"{provider.address[0]}?{urlencode(query, quote_via=quote)}"


def _make(addresses: list[str], order: Order, path: Path) -> None:
    """Download the fields of some times and write them as one netCDF file."""
    gathered = path.with_suffix(".grib2")
    try:
        with open(gathered, "wb") as file:
            for one in addresses:
                content = web.get_address(one, order.timeout, LARGEST)
                if not content.startswith(b"GRIB"):
                    raise UserError(f'"{one}" sent no GRIB: {_start(content)}')
                if not content.endswith(b"7777"):
                    raise TemporaryError(f'"{one}" sent half a message')
                file.write(content)
        try:
            with (
                warnings.catch_warnings(),
                dataset.open_one(str(gathered), order.provider.quantity) as data,
            ):
                warnings.simplefilter("ignore")
                data.to_netcdf(path, engine="netcdf4")
        except UserError as error:
            raise TemporaryError(
                f"{order.provider.name} sent GRIB that cannot be read: {error}"
            ) from None
    finally:
        gathered.unlink(missing_ok=True)


def _start(content: bytes) -> str:
    return " ".join(content[:80].decode("ascii", "replace").split()) or "nothing"
