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
    name: str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    *,
    changes: Mapping[str, str] | None = None,
    backend: str = "cpu",
    threads: int | None = None,
    overwrite: bool = False,
    tell: Callable[[str, float], None] = lambda phase, share: None,
) -> Regained:
    """Return the track of a target by the detections there are, and its areas.

    Args:
        name: of a tracking case with `detections`, or its file.
        out: a folder for the track, its areas and a picture, all or none; None: nothing is written.
        changes: places in the file and TOML values, {"particles": "4000"}, as --set has them.
        backend: where particles move: "cpu", "cuda", "vulkan", "metal", or "auto" for a graphics
            card where one is worth it. A process keeps the backend and the threads that it began
            with.
        threads: threads of the CPU; None, or more than there are: all. No number of them changes a
            bit of the results.
        overwrite: whether results that `out` holds are replaced, once the new ones are complete.
        tell: takes what is being done, and the share of it that is done, 0 to 1.

    Returns:
        In `held` the track by time and its areas; in `chased` with a `[pursuit]` the path, or why
        there is none.

    Raises:
        UserError: what a user can change, one line for each mistake (`error.lines`).
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
        asked.title,
        f"{told['source']}, seed {asked.seed}. {about}",
        {**told, "run_id": formats.run_id(told)},
    )
    writer.write(
        out,
        [chapter.chapter(chapter.TrackOutputs(found, imprint, land), told)],
        overwrite=overwrite,
    )
