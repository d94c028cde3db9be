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
    name: str,
    out: str | os.PathLike[str] | None = None,
    *,
    changes: Mapping[str, str] | None = None,
    variants: Mapping[str, Mapping[str, str]] | None = None,
    figures: Sequence[str] = (),
    runs: int | None = None,
    backend: str = "cpu",
    threads: int | None = None,
    overwrite: bool = False,
    tell: Callable[[str, float], None] = lambda phase, share: None,
) -> Experiment:
    """Return what many runs of a case came to, and with `out` write tables and a picture into a
    folder, all or none.

    Args:
        name: of a case of `drift run`, or of a tracking case, whose ways of following are compared;
            or its file.
        out: a folder for the results, written completely or not at all; None: nothing is written.
        changes: places in the file and TOML values, {"particles": "4000"}, for all runs.
        variants: the same by the name of each variant, on common random numbers; a tracking case
            takes none.
        figures: numbers of summary.json to follow, by their places there; a tracking case takes
            none.
        runs: how many, with a seed each; None: 20.
        backend: where particles move: "cpu", "cuda", "vulkan", "metal", or "auto" for a graphics
            card where one is worth it. A process keeps the backend and the threads that it began
            with.
        threads: threads of the CPU; None, or more than there are: all. No number of them changes a
            bit of the results.
        overwrite: whether results that `out` holds are replaced, once the new ones are complete.
        tell: takes what is being done, and the share of it that is done, 0 to 1.

    Returns:
        Means, standard errors and quantiles of each figure by variant, and their differences.

    Raises:
        UserError: what a user can change, one line for each mistake (`error.lines`).
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
        asked = tracking.load(
            name, changes | ({} if runs is None else {"experiment.runs": str(runs)})
        )
        if not isinstance(asked.target, Scene):
            raise UserError(
                f'"{name}" has detections, no [target] to be compared with: drift track {name}'
            )
        runtime.start(backend, threads, asked.runs * len(asked.methods))
        with runtime.alone():
            coast = shore.of_study(asked)
            outcome = tracked.run(
                asked, None if coast is None else coast.device, partial(tell, "following")
            )
        found = Experiment(
            asked.title,
            asked.text,
            asked.seed,
            asked.runs,
            f"{asked.size:,} particles, {outcome.sweeps:,} sweeps",
            tuple(method.name for method in asked.methods),
            outcome.figures,
            asked.published,
            outcome,
            asked.files,
        )
    else:
        found = ordinary.run(
            name,
            changes,
            variants or {},
            figures,
            runs or RUNS,
            backend=backend,
            threads=threads,
            tell=tell,
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
    imprint = Imprint(
        found.title,
        f"{told['source']}, seed {found.seed}",
        {**told, "run_id": formats.run_id(told)},
    )
    writer.write(
        out, [chapter.chapter(ExperimentOutputs(found, imprint), told)], overwrite=overwrite
    )
