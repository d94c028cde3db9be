"""An experiment from the question to the files: `drift experiment`."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from drift import version
from drift.maps.imprint import Imprint
from drift.output import formats, writer
from drift.tracker import chapter
from drift.tracker import experiment as experiments
from drift.tracker.chapter import Matter
from drift.tracker.experiment import Outcome
from drift.tracker.study import Study
from kernels import runtime


def experiment(
    asked: Study, out: Path, *, backend: str = "cpu", threads: int | None = None, overwrite: bool = False,
    tell: Callable[[str, float], None] = lambda phase, share: None,
) -> Outcome:  # fmt: skip
    """Return what an experiment came to, and write its tables and its picture into a folder, all or none.

    tell: takes what is being done, and the share of it that is done. Raises UserError where the folder holds something.
    """
    writer.check_folder(out, overwrite, (*chapter.FILES, *chapter.PICTURES))
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
    tell("writing", 0.0)
    writer.write(out, [chapter.chapter(Matter(found, imprint), told)], overwrite=overwrite)
    return found
