"""`drift track` and `drift.track`: follow a target by its detections, and write the results."""

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
    """Return the track of a target estimated from its detections, and its containment areas.

    Args:
        name: a tracking case with `detections`, by name or file.
        out: a folder for the track, its areas and a map, all or none; None: nothing is written.
        changes: overrides by key, {"particles": "4000"}, as for --set.
        backend: where particles move: "cpu", "cuda", "vulkan", "metal", or "auto" for a graphics
            card if the run is large enough. A process keeps the backend and the threads that it
            began with.
        threads: threads of the CPU; None, or more than there are: all. The results do not depend on
            it.
        overwrite: whether results in `out` are replaced, once the new ones are complete.
        tell: called with the phase and the share of it that is done, 0 to 1.

    Returns:
        In `held` the track by time and its areas; in `chased`, for a case with a `[pursuit]`, the
        path, or why there is none.

    Raises:
        UserError: what a user can change, one line for each mistake (`error.lines`).
    """
    folder = None if out is None else Path(out)
    if folder is not None:
        writer.check_folder(folder, overwrite, (*chapter.FILES, *chapter.PATHS, *chapter.PICTURES))
    study = tracking.load(name, changes)
    if not isinstance(study.target, Detections):
        raise UserError(
            f'"{study.name}" has a [target] instead of detections: use drift experiment '
            f'{study.name}, or give detections = "file.csv"'
        )
    land = chase.land()
    chase.check_pursuit(study, land)
    runtime.start(backend, threads, 1 + holding.OTHERS)
    with runtime.alone():
        coast = shore.of_study(study)
        held = holding.hold(study, coast, partial(tell, "following"))
        tell("path", 0.0)
        found = Regained(
            held, chase.plan_pursuit(study, land, None if coast is None else coast.device)
        )
    if folder is not None:
        tell("writing", 0.0)
        _write(found, folder, overwrite, land)
    return found


def _write(found: Regained, out: Path, overwrite: bool, land: Land) -> None:
    study = found.held.study
    attributes = {
        "title": study.title,
        "source": f"casp-drift {version.__version__}",
        "versions": version.told(),
        "seed": str(study.seed),
        "case": study.text,
        **runtime.about(),
        **formats.inputs(study.files),
    }
    caution = "Heuristic, not Bayesian: areas are approximate (docs/tracking.md)."
    imprint = Imprint(
        study.title,
        f"{attributes['source']}, seed {study.seed}. {caution}",
        {**attributes, "run_id": formats.run_id(attributes)},
    )
    writer.write(
        out,
        [chapter.chapter(chapter.TrackOutputs(found, imprint, land), attributes)],
        overwrite=overwrite,
    )
