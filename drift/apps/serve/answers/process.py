"""The warm process of the desk: it answers requests on a text, with drift imported already.

It runs in the fence of jobs (`drift.apps.cli.tethered`), but can write only into its own temporary
folder. Each request is a line of JSON on standard input, each answer a line on the original
standard output. Nothing here trusts a text: one that makes this process hang or crash costs this
process, which the server replaces (`drift.apps.serve.warm`).
"""

import contextlib
import json
import os
import queue
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely

from drift.apps.serve.answers import (
    note_answers,
    plan_answers,
    result_answers,
    search_answers,
    spill_answers,
    washup_answers,
)
from drift.apps.serve.fields import form, mistakes
from drift.case import file as case_file
from geo import sphere
from geo.box import Box
from geo.coast import gshhg, shore
from geo.errors import UserError

PARTICLES = 10_000  # of a sketch
AHEAD = 200  # particles of the one that is made ahead, to compile what its case needs
DRAWN = 2000  # of them, on the map
AREAS = "[50, 75, 95]"
MOST_OUTPUTS = 9  # of a sketch: the maps of many outputs take most of its time
OVERLONG = 300  # characters of a message
NOT_SHOWN = "this has a number that the page cannot show (nan, inf or of many digits); change it"
Times = npt.NDArray[np.datetime64]

# what a case that has searches needs besides; kernels are compiled by what they take
WARM_SEARCH = """
[[scenario]]
name = "raft"
object = "LIFE-RAFT-DB-10"
trackline = { waypoints = ["50 00N 005 30W", "50 06N 005 50W"], speed = "6 kn", cross_track = "1 nmi" }

[[sortie]]
start = "+3 h"
speed = "80 kn"
sweep_width = "0.5 nmi"
pattern = { kind = "parallel", centre = "50 00N 005 30W", length = "6 nmi", width = "4 nmi", spacing = "1 nmi" }
"""


class Cancelled(Exception):
    """The request was cancelled."""


def answer_requests() -> None:
    """Answer requests until standard input ends; then end this process at once."""
    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what libraries print must not mix with answers
    requests: queue.Queue[dict[str, Any]] = queue.Queue()
    cancelled = threading.Event()
    threading.Thread(target=_read_requests, args=(requests, cancelled), daemon=True).start()
    while True:
        request = requests.get()
        cancelled.clear()
        out.write(_line(request["id"], _answer(request, cancelled)) + "\n")
        out.flush()


def _line(number: int, answer: Mapping[str, Any]) -> str:
    """Return an answer as JSON, or an error if it has a number that JSON cannot hold."""
    try:
        return json.dumps({"id": number, **answer}, allow_nan=False)
    except (ValueError, RecursionError):
        return json.dumps({"id": number, "error": NOT_SHOWN})


def _read_requests(requests: queue.Queue[dict[str, Any]], cancelled: threading.Event) -> None:
    for line in sys.stdin.buffer:
        request = json.loads(line)
        if request == "cancel":
            cancelled.set()
        else:
            requests.put(request)
    os._exit(0)


def _answer(request: Mapping[str, Any], cancelled: threading.Event) -> dict[str, Any]:
    """Return {"answer": ...}, or {"error": lines} for what the user can correct."""

    def tell(phase: str, share: float) -> None:
        if cancelled.is_set():
            raise Cancelled

    try:
        return {"answer": ANSWERS[request["do"]](request, tell)}
    except UserError as error:
        return {"error": "\n".join(line[:OVERLONG] for line in error.lines)}
    except Cancelled:
        return {"cancelled": True}
    except MemoryError:  # what is left may not be enough for the next request
        raise
    except Exception as error:  # a text must not cost the others this process
        kind = type(error).__name__
        return {"error": f"the desk cannot work on this ({kind}): see what drift check says of it"}


Tell = Callable[[str, float], None]


def _form(request: Mapping[str, Any], tell: Tell) -> dict[str, Any]:
    return form.read_fields(request["text"])


def _set(request: Mapping[str, Any], tell: Tell) -> dict[str, Any]:
    return {"text": form.set_fields(request["text"], request["changes"])}


def _check(request: Mapping[str, Any], tell: Tell) -> dict[str, Any]:
    """Return the mistakes of a text, each with its line and its field, as far as these are known."""
    path, text = Path(request["path"]), request["text"]
    try:
        case_file.load_text(path, text)
    except UserError as error:
        lines = [line.removeprefix(f"{path.name}: ")[:OVERLONG] for line in error.lines]
        return {"messages": [mistakes.message_of(line, text) for line in lines]}
    return {"messages": []}


def _sketch(request: Mapping[str, Any], tell: Tell) -> dict[str, Any]:
    """Return the forecast of a few particles, as the map of the desk shows it."""
    from drift.engine.particles.status import Status
    from drift.forecast.products import headline
    from drift.pipeline import flow
    from drift.products.files import geojson

    job, opens = _open_sketch(request, tell)
    case, result = job.case, flow.forecast_job(job)
    data, tracks = result.forecast.data, result.trajectories
    times = [f"{time.astype('datetime64[s]')}Z" for time in data["time"].values]
    areas = [
        result_answers.feature_of_area(contour, f"{contour.time.astype('datetime64[s]')}Z")
        for contour in result.forecast.contours
    ]
    lon, lat = (sphere.to_degrees(one).round(4) for one in (tracks.lon, tracks.lat))
    return {
        "title": case.title,
        "number": case.particles,
        **result_answers.probabilities(data, len(times)),
        "words": washup_answers.words_of_sketch(result) or headline.forecast_headline(data, opens),
        "warnings": list(result.summary["warnings"]),
        "times": times,
        "opens": None if opens is None else f"{opens.astype('datetime64[s]')}Z",
        "areas": geojson.collection(areas, {}),
        "likely": [result_answers.likely_at(data.isel(time=k)) for k in range(len(times))],
        "statuses": [status.name.lower() for status in sorted(Status)],
        "particles": {
            "lon": lon.T.tolist(),
            "lat": lat.T.tolist(),
            "status": tracks.status.T.astype(int).tolist(),
        },
        "washup": washup_answers.washup_of_sketch(result),
    }


def _open_sketch(
    request: Mapping[str, Any], tell: Tell, particles: int = PARTICLES
) -> tuple[Any, np.datetime64 | None]:
    """Return the job (`drift.pipeline.run_options.Job`) of a first map, and when that opens."""
    from drift.apps.serve.answers import sketch_waters
    from drift.pipeline import run_options

    path, text = Path(request["path"]), request["text"]
    few = {"particles": str(particles)}
    if "spill" in form.parse_text(text):
        few = washup_answers.SKETCH
    overrides = {**few, "output.trajectories": str(DRAWN), "output.areas": AREAS}
    case = case_file.load_text(path, text, overrides)
    opens = case.opens if case.opens is not None else present(case.outputs, _now())
    case = replace(case, outputs=few_outputs(case.outputs, opens))
    region = sketch_waters.region_of(case)
    return run_options.open_job(case, run_options.Options(report=tell), region), opens


def _prepare(request: Mapping[str, Any], tell: Tell) -> dict[str, Any]:
    """Read and compile what the first map of a text needs, up to its maps.

    It is asked for while a text is typed: mistakes are not its business.
    """
    from drift.apps.serve.answers import sketch_waters
    from drift.pipeline import flow

    def stop_at_maps(phase: str, share: float) -> None:
        tell(phase, share)
        if phase == "map":
            raise _Prepared

    with contextlib.suppress(UserError, _Prepared):
        job, _ = _open_sketch(request, stop_at_maps, AHEAD)
        if sketch_waters.read_ahead(job.case, job.where, tell):
            flow.forecast_job(job)
    return {}


class _Prepared(Exception):
    """What a first map needs is ready."""


def _now() -> np.datetime64:
    """Return the present [UTC]."""
    return np.datetime64(datetime.now(UTC).replace(tzinfo=None), "s")


def present(outputs: Times, now: np.datetime64) -> np.datetime64 | None:
    """Return the output nearest to the present; None if that is before the first or after the last.

    Args:
        outputs: in order of the run, shape (n,).
        now: the present.
    """
    if not outputs.min() <= now <= outputs.max():
        return None
    nearest: np.datetime64 = outputs[int(np.argmin(np.abs(outputs - now)))]
    return nearest


def few_outputs(outputs: Times, opens: np.datetime64 | None) -> Times:
    """Return at most MOST_OUTPUTS of a case's output times: first, last, `opens`, and some between.

    Args:
        outputs: in order of the run, shape (n,).
        opens: time that the map shows first; None: the last.
    """
    most = MOST_OUTPUTS - (opens is not None)
    kept = np.zeros(outputs.size, bool)
    kept[np.linspace(0, outputs.size - 1, most).round().astype(int)] = True
    return outputs[kept | (outputs == opens)] if opens is not None else outputs[kept]


def _coast(request: Mapping[str, Any], tell: Tell) -> dict[str, Any]:
    """Return the land in a box as GeoJSON, without detail below a step."""
    from drift.products.files import geojson

    west, south, east, north = request["box"]
    step = request["step"]
    box = Box(west, south, east, north)
    polygons = gshhg.near(box)
    edges = shapely.bounds(polygons)
    large = np.maximum(edges[:, 2] - edges[:, 0], edges[:, 3] - edges[:, 1]) > step
    land = shapely.simplify(shore.clip(polygons[large], box), step / 2, preserve_topology=False)
    parts = shapely.get_parts(land)
    drawn = [
        {"type": "Polygon", "coordinates": [np.round(ring.coords, 5).tolist() for ring in rings]}
        for one in parts[~shapely.is_empty(parts)]
        if (rings := [one.exterior, *one.interiors])
    ]
    return geojson.collection([geojson.feature(shape, {}) for shape in drawn], {})


def _forcing(request: Mapping[str, Any], tell: Tell) -> dict[str, Any]:
    """Return what a file of winds or currents covers."""
    from geo.files import fence
    from geo.forcing import describe

    path = request["path"]
    fence.check(path)
    found = []
    for source in describe.open_quantities([path], None):
        box, times = source.grid.box, np.asarray(source.times)
        found.append(
            {
                "quantity": source.quantity,
                "box": [box.west, box.south, box.east, box.north],
                "times": [f"{t.astype('datetime64[s]')}Z" for t in times[[0, -1]]]
                if times.size
                else [],
            }
        )
    return {"sources": found}


def _export(request: Mapping[str, Any], tell: Tell) -> dict[str, Any]:
    """Return a result as one file; only the process of exports imports what that needs."""
    from drift.apps.serve.answers import export_answers

    return export_answers.export(request)


def _warm(request: Mapping[str, Any], tell: Tell) -> dict[str, Any]:
    """Compile what a sketch needs, with small cases of its own."""
    for text in warm_texts():
        with contextlib.suppress(UserError):
            _sketch({"path": "warm.toml", "text": text}, tell)
    return {}


def warm_texts() -> tuple[str, str]:
    """Return a case with a typed wind and current, and the same with the errors of a model's.

    Only these have a bias, and kernels are compiled without the terms that a case does not have.
    """
    text = form.set_fields(
        form.new_text(np.datetime64("2026-11-21T18:30", "s")),
        [
            {"field": "scenario.0.object", "value": "PIW-1"},
            {"field": "scenario.0.position.at", "value": "50 00N 005 30W"},
            {"field": "scenario.0.position.error", "value": "1 nmi"},
            {"field": "wind", "value": {"kind": "constant", "speed": "15 kn", "from": 235}},
            {"field": "current", "value": {"kind": "constant", "speed": "1 kn", "toward": 75}},
        ],
    )
    typed = 'current = {std = "0.3 m/s", time = "11 h"'
    modelled = text.replace(typed, f'{typed}, bias = "0.1 m/s"')
    return text + WARM_SEARCH, modelled + WARM_SEARCH


ANSWERS: dict[str, Callable[[Mapping[str, Any], Tell], dict[str, Any]]] = {
    "form": _form,
    "set": _set,
    "check": _check,
    "sketch": _sketch,
    "prepare": _prepare,
    "coast": _coast,
    "forcing": _forcing,
    "note": lambda request, tell: note_answers.note(request),
    "export": _export,
    "warm": _warm,
    "search": lambda request, tell: search_answers.search(request),
    "spill": lambda request, tell: spill_answers.spill(request),
    "spill/turn": lambda request, tell: {"text": form.turn(request["text"], request["spill"])},
    "washup": lambda request, tell: washup_answers.washup(request),
    "washup/keep": lambda request, tell: washup_answers.keep_patrol(request),
    "plan": lambda request, tell: plan_answers.plan(request),
    "plan/pos": lambda request, tell: plan_answers.pos(request),
    "plan/keep": lambda request, tell: plan_answers.keep(request),
    "result": lambda request, tell: result_answers.result(request),
    "result/value": lambda request, tell: result_answers.value(request),
}
