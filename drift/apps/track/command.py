"""A contact that was lost, from its detections to the files: `drift track` and `drift.track`."""

import os
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from drift import version
from drift.apps.track import chapter, chase
from drift.apps.track.chase import Land
from drift.apps.track.record import Regained
from drift.case.tracking import tracking
from drift.products.files import formats, writer
from drift.products.maps.imprint import Imprint
from drift.tracking.tracker import holding, shore
from drift.tracking.tracker.detections import Detections
from geo.errors import UserError
from kernels.runtime import runtime


def track(
    name: str | os.PathLike[str], out: str | os.PathLike[str] | None = None, *,
    changes: Mapping[str, str] | None = None, backend: str = "cpu", threads: int | None = None, overwrite: bool = False,
    tell: Callable[[str, float], None] = lambda phase, share: None,
) -> Regained:  # fmt: skip
    """Return the track of a target by the detections there are, and its areas.

    name: of a tracking case with `detections`, or its file. out: a folder for the track, its areas and a picture, all or
    none; where there is no path to be had the rest is written, and `chased` says why. changes: as --set has them. tell:
    takes what is being done, and the share of it that is done. Raises UserError for all that the user can mend.
    """
    folder = None if out is None else Path(out)
    if folder is not None:
        writer.check_folder(folder, overwrite, (*chapter.FILES, *chapter.PATHS, *chapter.PICTURES))
    asked = tracking.load(name, changes)
    if not isinstance(asked.target, Detections):
        raise UserError(
            f'"{asked.name}" has a [target], no detections: drift experiment {asked.name}, or give detections = "file.csv"'
        )
    land = chase.land()
    chase.check(asked, land)
    runtime.start(backend, threads, 1 + holding.OTHERS)
    with runtime.alone():
        coast = shore.of_study(asked)
        held = holding.hold(asked, coast, partial(tell, "following"))
        tell("path", 0.0)
        found = Regained(held, chase.chased(asked, land, None if coast is None else coast.device))
    if folder is not None:
        tell("writing", 0.0)
        _write(found, folder, overwrite, land)
    return found


def _write(found: Regained, out: Path, overwrite: bool, land: Land) -> None:
    asked = found.held.study
    told = {
        "title": asked.title,
        "source": f"casp-drift {version.__version__}",
        "versions": version.told(),
        "seed": str(asked.seed),
        "case": asked.text,
        **runtime.about(),
        **formats.inputs(asked.files),
    }
    about = "A heuristic, no Bayes: take areas as rough (docs/tracking.md)."
    imprint = Imprint(
        asked.title, f"{told['source']}, seed {asked.seed}. {about}", {**told, "run_id": formats.run_id(told)}
    )
    writer.write(out, [chapter.chapter(chapter.TrackOutputs(found, imprint, land), told)], overwrite=overwrite)
