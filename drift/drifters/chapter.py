"""What a verification hands out: a row for each forecast and lead, all of it as netCDF, and a picture."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from drift import facts
from drift.drifters import files as verification_files
from drift.drifters import text as verification_text
from drift.drifters.verification import Verification
from drift.maps.imprint import Imprint
from drift.output.chapter import Chapter, Contents, Stamped, bound
from kernels import runtime


@dataclass(frozen=True)
class Matter:
    """What the files and pictures are made from."""

    made: Verification
    imprint: Imprint


def _picture(one: Matter, path: Path) -> None:
    from drift.drifters import map as verification_map  # here: Matplotlib takes a second to import

    verification_map.draw(one.made, path, one.imprint)


FILES: dict[str, Callable[[Matter, Stamped], Contents]] = {
    "verify.csv": lambda one, stamped: verification_files.table(one.made, stamped["run_id"]),
    "verify.nc": lambda one, stamped: verification_files.dataset(one.made),
}
PICTURES: dict[str, Callable[[Matter, Path], None]] = {
    "verify.png": _picture,
}


def chapter(made: Verification) -> Chapter:
    """Return the only chapter of a verification."""
    case = made.case
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in facts.PACKAGES)
    inputs = [facts.input_file(path) for path in case.inputs]
    attributes = {
        "title": f"{case.title}: forecasts of drifters",
        "source": versions.split(",")[0],
        "versions": versions,
        "seed": str(case.seed),
        "backend": runtime.backend(),
        "forcing": "; ".join(f"{Path(one['path']).name}: {one['digest']}" for one in inputs),
        "coast": case.coast.source,
        "uncertainty": verification_text.errors(made),
        "case": case.text,
    }
    footer = f"{attributes['source']}, seed {case.seed}, {attributes['uncertainty']}"
    one = Matter(made, Imprint(case.title, footer, attributes))
    numbers = {"verification": verification_files.numbers(made), "inputs": inputs}
    return Chapter(numbers, bound(FILES, one), bound(PICTURES, one), attributes)
