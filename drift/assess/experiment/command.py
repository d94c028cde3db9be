"""Run an experiment and write its results: `drift experiment`."""

import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

from drift import version
from drift.assess.experiment import chapter, ordinary
from drift.assess.experiment.chapter import ExperimentOutputs
from drift.assess.experiment.record import Experiment
from drift.case.tracking import tracking
from drift.products.files import formats, writer
from drift.products.maps.imprint import Imprint
from drift.tracking.tracker import experiment as tracked
from drift.tracking.tracker import shore
from drift.tracking.tracker.study import Scene
from geo.errors import UserError
from kernels.runtime import runtime

RUNS = 20  # of a case of drift run, where nobody says how many


def experiment(
    name: str, out: str | os.PathLike[str] | None = None, *, changes: Mapping[str, str] | None = None,
    variants: Mapping[str, Mapping[str, str]] | None = None, figures: Sequence[str] = (), runs: int | None = None,
    backend: str = "cpu", threads: int | None = None, overwrite: bool = False,
    tell: Callable[[str, float], None] = lambda phase, share: None,
) -> Experiment:  # fmt: skip
    """Return what many runs of a case came to, and with `out` write tables and a picture into a folder, all or none.

    name: of a case of drift run, or of a tracking case, whose ways of following are compared. changes, variants, figures:
    as of drift.assess.experiment.ordinary.run; a tracking case takes changes alone. runs: how many. tell: takes what is being
    done, and the share of it that is done. Raises UserError for all that the user can mend.
    """
    if runs is not None and runs < 1:
        raise UserError(f"--runs {runs} must be at least 1")
    folder = None if out is None else Path(out)
    if folder is not None:
        writer.check_folder(folder, overwrite, (*chapter.FILES, *chapter.PICTURES))
    changes = dict(changes or {})
    if tracking.is_one(name):
        if variants or figures:
            raise UserError(
                "--with and --figure are for cases of drift run; a tracking case has [[method]] and [experiment]"
            )
        asked = tracking.load(name, changes | ({} if runs is None else {"experiment.runs": str(runs)}))
        if not isinstance(asked.target, Scene):
            raise UserError(f'"{name}" has detections, no [target] to be compared with: drift track {name}')
        runtime.start(backend, threads, asked.runs * len(asked.methods))
        with runtime.alone():
            coast = shore.of_study(asked)
            outcome = tracked.run(asked, None if coast is None else coast.device, partial(tell, "following"))
        found = Experiment(
            asked.title, asked.text, asked.seed, asked.runs, f"{asked.size:,} particles, {outcome.sweeps:,} sweeps",
            tuple(method.name for method in asked.methods), outcome.figures, asked.published, outcome, asked.files,
        )  # fmt: skip
    else:
        found = ordinary.run(
            name, changes, variants or {}, figures, runs or RUNS, backend=backend, threads=threads, tell=tell
        )
    if folder is not None:
        tell("writing", 0.0)
        _write(found, folder, overwrite)
    return found


def _write(found: Experiment, out: Path, overwrite: bool) -> None:
    told = {
        "title": found.title,
        "source": f"casp-drift {version.__version__}",
        "versions": version.told(),
        "seed": str(found.seed),
        "case": found.text,
        **runtime.about(),
        **formats.inputs(found.files),
    }
    imprint = Imprint(found.title, f"{told['source']}, seed {found.seed}", {**told, "run_id": formats.run_id(told)})
    writer.write(out, [chapter.chapter(ExperimentOutputs(found, imprint), told)], overwrite=overwrite)
