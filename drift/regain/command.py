"""A contact that was lost, from its detections to the files: `drift track` and `drift.track`."""

import os
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from drift import version
from drift.case import tracking
from drift.environment import coastline
from drift.environment.environment_spec import Coast
from drift.maps.imprint import Imprint
from drift.output import formats, writer
from drift.regain import chapter
from drift.regain.record import Chased, Regained
from drift.tracker import density, holding, pursuit, shore
from drift.tracker.detections import Detections
from drift.tracker.study import Study
from geo import sphere
from geo.array import Array
from geo.box import Box
from geo.errors import UserError
from kernels import noise, runtime
from kernels.coast import DeviceCoast

SHARES = (0.5, 0.9)  # of the probability, of the areas told


def track(
    name: str | os.PathLike[str], out: str | os.PathLike[str] | None = None, *,
    changes: Mapping[str, str] | None = None, backend: str = "cpu", threads: int | None = None, overwrite: bool = False,
    tell: Callable[[str, float], None] = lambda phase, share: None,
) -> Regained:  # fmt: skip
    """Return the track of a target by the detections there are, and its areas.

    name: of a tracking case with `detections`, or its file. out: a folder for the track, its areas and a picture, all or
    none. changes: as --set has them. tell: takes what is being done, and the share of it that is done. Raises UserError
    for all that the user can mend.
    """
    folder = None if out is None else Path(out)
    if folder is not None:
        writer.check_folder(folder, overwrite, (*chapter.FILES, *chapter.PATHS, *chapter.PICTURES))
    asked = tracking.load(name, changes)
    if not isinstance(asked.target, Detections):
        raise UserError(
            f'"{asked.name}" has a [target], no detections: drift experiment {asked.name}, or give detections = "file.csv"'
        )
    land = coastline.lands(None, Coast("gshhg", "strand"))
    runtime.start(backend, threads)
    with runtime.alone():
        coast = shore.of_study(asked)
        held = holding.hold(asked, None if coast is None else coast.device, partial(tell, "following"))
        chased = _chased(asked, land, None if coast is None else coast.device, tell)
    tell("areas", 0.0)
    dry = None if coast is None else coast.dry
    areas = tuple(
        (time, {} if cloud is None else density.areas(density.surface(cloud.place, cloud.weight, dry), SHARES))
        for time, cloud in held.clouds
    )
    found = Regained(held, areas, chased)
    if folder is not None:
        tell("writing", 0.0)
        _write(found, folder, backend, overwrite, land)
    return found


def _chased(
    asked: Study, land: Callable[[Box], Any], coast: DeviceCoast | None, tell: Callable[[str, float], None]
) -> Chased | None:
    """Return the path that a case asks for; raise UserError where there is none."""
    chase = asked.pursuit
    if chase is None:
        return None
    tell("path", 0.0)

    def closed(lon: Array, lat: Array, half: float) -> Array:
        lon = sphere.near_degrees(lon, float(np.degrees(chase.start[0])))
        high = np.degrees(1.05 * half / sphere.RADIUS)  # meridians converge: squares are a little turned
        wide = high / np.maximum(np.cos(np.radians(lat)), 0.01)
        reach = Box(
            float((lon - wide).min()), float((lat - high).min()), float((lon + wide).max()), float((lat + high).max())
        )
        shapes = shapely.STRtree(list(land(reach)))
        shut = np.zeros(lon.size, bool)
        for turn in (-360.0, 0.0, 360.0):
            squares = shapely.box(lon + turn - wide, lat - high, lon + turn + wide, lat + high).ravel()
            shut[shapes.query(squares, predicate="intersects")[0]] = True
        return shut.reshape(lon.shape)

    try:
        found = pursuit.pursue(chase, holding.onward(asked, asked.seed, coast), closed)
    except ValueError as error:
        raise UserError(f"{asked.name}: pursuit: {error}") from None
    other = holding.onward(asked, noise.seed_for(asked.seed, noise.Purpose.PURSUIT), coast)
    return Chased(found, pursuit.judged(chase, found.path, other))


def _write(found: Regained, out: Path, backend: str, overwrite: bool, land: Callable[[Box], Any]) -> None:
    asked = found.held.study
    told = {
        "title": asked.title,
        "source": f"casp-drift {version.__version__}",
        "versions": version.told(),
        "seed": str(asked.seed),
        "case": asked.text,
        "backend": backend,
    }
    about = "A heuristic, no Bayes: take areas as rough (docs/tracking.md)."
    imprint = Imprint(
        asked.title, f"{told['source']}, seed {asked.seed}. {about}", {**told, "run_id": formats.run_id(told)}
    )
    writer.write(out, [chapter.chapter(chapter.Matter(found, imprint, land), told)], overwrite=overwrite)
