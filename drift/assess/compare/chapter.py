"""What a comparison hands out: maps and figures as netCDF, figures as a table, words, and a
picture.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from drift.assess.compare import text
from drift.assess.compare.record import Contrast
from drift.pipeline import run_metadata
from drift.pipeline.run_options import Job
from drift.products.files.chapter import Chapter, Contents, Stamped, bound
from drift.products.maps.imprint import Setting
from drift.products.report.leaves import Leaf


@dataclass(frozen=True)
class ComparisonOutputs:
    """What the files and pictures are made from."""

    contrast: Contrast
    setting: Setting  # of case A, with the title of both


def _map(matter: ComparisonOutputs, path: Path) -> None:
    # imported here, for Matplotlib takes a second
    from drift.assess.compare import map as contrast_map

    contrast_map.plot_comparison(matter.contrast, path, matter.setting)


FILES: dict[str, Callable[[ComparisonOutputs, Stamped], Contents]] = {
    "compare.nc": lambda matter, stamped: matter.contrast.data,
    "compare.csv": lambda matter, stamped: text.comparison_csv(matter.contrast, stamped["run_id"]),
    "compare.txt": lambda matter, stamped: text.page(matter.contrast),
}
PICTURES: dict[str, Callable[[ComparisonOutputs, Path], None]] = {
    "compare.png": _map,
}


def setting(found: Contrast, jobs: tuple[Job, Job]) -> Setting:
    """Return what the pictures of a comparison show; jobs: of A and of B."""
    on = run_metadata.setting(jobs[0].case, jobs[0].where)
    caution = run_metadata.caution(jobs[0].case) or run_metadata.caution(jobs[1].case)
    imprint = replace(
        on.imprint, title=found.title, attributes=_attributes(found, jobs), caution=caution
    )
    return run_metadata.with_coast(replace(on, imprint=imprint))


def _attributes(found: Contrast, jobs: tuple[Job, Job]) -> dict[str, str]:
    a, b = (run_metadata.attributes(job.case, job.where) for job in jobs)
    return {
        **a,
        "title": found.title,
        "forcing": f"A: {a['forcing']} B: {b['forcing']}",
        "uncertainty": a["uncertainty"]
        if a["uncertainty"] == b["uncertainty"]
        else f"A: {a['uncertainty']} B: {b['uncertainty']}",
        "case": f"{a['case']}\n# --- B ---\n{b['case']}",
    }


def chapters(found: Contrast, jobs: tuple[Job, Job]) -> list[Chapter]:
    """Return the chapters of a comparison; jobs: of A and of B."""
    matter = ComparisonOutputs(found, setting(found, jobs))
    warnings = tuple(
        f"{name}: {words}"
        for name, result in (("A", found.a), ("B", found.b))
        for words in result.summary["warnings"]
    )
    numbers = {
        "compare": text.summary_of_comparison(found),
        "a": found.a.summary,
        "b": found.b.summary,
        "warnings": list(warnings),
    }
    told = (partial(_leaves, found, [run_metadata.setting(job.case, job.where) for job in jobs]),)
    return [
        Chapter(
            numbers,
            bound(FILES, matter),
            bound(PICTURES, matter),
            _attributes(found, jobs),
            warnings,
            told,
        )
    ]


def _leaves(found: Contrast, begun: Sequence[Setting]) -> list[Leaf]:
    from drift.assess.compare import report

    return report.comparison_leaves(found, begun)
