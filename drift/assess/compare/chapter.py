"""The output files of a comparison: compare.nc, compare.csv, compare.txt and compare.png."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from drift.assess.compare import text
from drift.assess.compare.record import Contrast
from drift.pipeline import run_metadata
from drift.pipeline.run_options import Job
from drift.products.files.chapter import Contents, OutputBundle, Stamped, bind_outputs
from drift.products.maps.imprint import Setting
from drift.products.report.leaves import Leaf


@dataclass(frozen=True)
class ComparisonOutputs:
    """The inputs of the comparison's files and picture."""

    contrast: Contrast
    setting: Setting  # of case A, with the title of both


def _plot(outputs: ComparisonOutputs, path: Path) -> None:
    # imported here because Matplotlib takes a second
    from drift.assess.compare import map as contrast_map

    contrast_map.plot_comparison(outputs.contrast, path, outputs.setting)


FILES: dict[str, Callable[[ComparisonOutputs, Stamped], Contents]] = {
    "compare.nc": lambda outputs, stamped: outputs.contrast.data,
    "compare.csv": lambda outputs, stamped: text.comparison_csv(
        outputs.contrast, stamped["run_id"]
    ),
    "compare.txt": lambda outputs, stamped: text.comparison_page(outputs.contrast),
}
PICTURES: dict[str, Callable[[ComparisonOutputs, Path], None]] = {
    "compare.png": _plot,
}


def _gravity(caution: str) -> tuple[bool, int]:
    return caution.startswith("SYNTHETIC"), len(caution)


def setting(found: Contrast, jobs: tuple[Job, Job]) -> Setting:
    """Return the map setting of a comparison; jobs: of A and of B."""
    on = run_metadata.map_setting(jobs[0].case, jobs[0].where)
    # there is room for one: the gravest
    caution = max((run_metadata.caution_banner(job.case) for job in jobs), key=_gravity)
    imprint = replace(
        on.imprint, title=found.title, attributes=_attributes(found, jobs), caution=caution
    )
    return run_metadata.with_coast(replace(on, imprint=imprint))


def _attributes(found: Contrast, jobs: tuple[Job, Job]) -> dict[str, str]:
    a, b = (run_metadata.file_attributes(job.case, job.where) for job in jobs)
    return {
        **a,
        "title": found.title,
        "forcing": f"A: {a['forcing']} B: {b['forcing']}",
        "uncertainty": a["uncertainty"]
        if a["uncertainty"] == b["uncertainty"]
        else f"A: {a['uncertainty']} B: {b['uncertainty']}",
        "case": f"{a['case']}\n# --- B ---\n{b['case']}",
    }


def comparison_bundles(found: Contrast, jobs: tuple[Job, Job]) -> list[OutputBundle]:
    """Return the output bundle of a comparison; jobs: of A and of B."""
    outputs = ComparisonOutputs(found, setting(found, jobs))
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
    leaves = (
        partial(_leaves, found, [run_metadata.map_setting(job.case, job.where) for job in jobs]),
    )
    return [
        OutputBundle(
            numbers,
            bind_outputs(FILES, outputs),
            bind_outputs(PICTURES, outputs),
            _attributes(found, jobs),
            warnings,
            leaves,
        )
    ]


def _leaves(found: Contrast, begun: Sequence[Setting]) -> list[Leaf]:
    from drift.assess.compare import report

    return report.comparison_leaves(found, begun)
