"""Run an experiment and write its results: `drift experiment`.

A case of `drift run` is run in variants (drift.assess.experiment.ordinary). A tracking case
compares its ways of following a target (drift.tracking.tracker.experiment).
"""

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

RUNS = 20  # default number of runs of a case of drift run


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
    """Run a case many times, and return the figures of all runs.

    With `out`, also write tables and a picture into that folder, all or none.

    Args:
        name: name or file of a case of `drift run`, or of a tracking case, whose [[method]]s are
            compared.
        out: folder for the results, written completely or not at all; None: nothing is written.
        changes: places in the file and TOML values, {"particles": "4000"}, for all runs.
        variants: changes by the name of each variant, run on common random numbers; not allowed for
            a tracking case.
        figures: numbers of summary.json to report, by their paths there; not allowed for a tracking
            case.
        runs: number of runs, with a seed each; None: 20.
        backend: where particles move: "cpu", "cuda", "vulkan", "metal", or "auto" for a graphics
            card if the run is large enough. A process keeps the backend and the threads that it started
            with.
        threads: threads of the CPU; None, or more than there are: all. The number of threads does
            not change a bit of the results.
        overwrite: whether to replace existing results in `out`, once the new ones are complete.
        tell: callback that takes the name of the current phase, and the share of it that is done, 0
            to 1.

    Returns:
        Means, standard errors and quantiles of each figure by variant, and their differences.

    Raises:
        UserError: the case or an option is wrong; one line for each mistake (`error.lines`).
    """
    if runs is not None and runs < 1:
        raise UserError(f"--runs {runs} must be at least 1")
    folder = None if out is None else Path(out)
    if folder is not None:
        writer.check_folder(folder, overwrite, (*chapter.FILES, *chapter.PICTURES))
    changes = dict(changes or {})
    if tracking.is_tracking_case(name):
        if variants or figures:
            raise UserError(
                "--with and --figure are for cases of drift run; a tracking case has [[method]] "
                "and [experiment]"
            )
        study = tracking.load(
            name, changes | ({} if runs is None else {"experiment.runs": str(runs)})
        )
        if not isinstance(study.target, Scene):
            raise UserError(
                f'"{name}" has detections, no [target] to be compared with: drift track {name}'
            )
        runtime.start(backend, threads, study.runs * len(study.methods))
        with runtime.alone():
            coast = shore.of_study(study)
            outcome = tracked.run(
                study, None if coast is None else coast.device, partial(tell, "following")
            )
        found = Experiment(
            study.title,
            study.text,
            study.seed,
            study.runs,
            f"{study.size:,} particles, {outcome.sweeps:,} sweeps",
            tuple(method.name for method in study.methods),
            outcome.figures,
            study.published,
            outcome,
            study.files,
        )
    else:
        found = ordinary.run_variants(
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
    attributes = {
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
        f"{attributes['source']}, seed {found.seed}",
        {**attributes, "run_id": formats.run_id(attributes)},
    )
    writer.write(
        out,
        [chapter.experiment_bundle(ExperimentOutputs(found, imprint), attributes)],
        overwrite=overwrite,
    )
