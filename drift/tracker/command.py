"""An experiment from the question to the files: `drift experiment`."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from drift import version
from drift.maps.imprint import Imprint
from drift.output import formats, writer
from drift.output.chapter import Chapter
from drift.tracker import experiment as experiments
from drift.tracker import text
from drift.tracker.experiment import Outcome
from drift.tracker.study import Study
from kernels import runtime

FILES = ("experiment.csv", "experiment_runs.csv", "experiment_times.csv")
PICTURE = "experiment.png"


def experiment(
    asked: Study, out: Path, *, backend: str = "cpu", threads: int | None = None, overwrite: bool = False,
    tell: Callable[[str, float], None] = lambda phase, share: None,
) -> Outcome:  # fmt: skip
    """Return what an experiment came to, and write its tables and its picture into a folder, all or none.

    tell: takes what is being done, and the share of it that is done. Raises UserError where the folder holds something.
    """
    writer.check_folder(out, overwrite, (*FILES, PICTURE))
    runtime.start(backend, threads)
    with runtime.alone():
        found = experiments.run(asked, partial(tell, "following"))
    told = {
        "title": asked.title,
        "source": f"casp-drift {version.__version__}",
        "versions": version.told(),
        "seed": str(asked.seed),
        "case": asked.text,
        "backend": backend,
    }
    imprint = Imprint(asked.title, f"{told['source']}, seed {asked.seed}", {**told, "run_id": formats.run_id(told)})
    tables = zip(FILES, (text.table, text.runs, text.times), strict=True)
    files = {name: lambda stamped, make=make: make(found) for name, make in tables}
    whole = Chapter({"experiment": text.numbers(found)}, files, {PICTURE: partial(_draw, found, imprint)}, facts=told)
    tell("writing", 0.0)
    writer.write(out, [whole], overwrite=overwrite)
    return found


def _draw(found: Outcome, imprint: Imprint, path: Path) -> None:
    from drift.tracker import errors_map  # here: Matplotlib takes a second to import

    errors_map.draw(found, path, imprint)
