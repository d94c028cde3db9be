"""The output files of a verification: verify.csv, verify.nc and verify.png."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from drift import version
from drift.assess.verify import files as verification_files
from drift.assess.verify import text as verification_text
from drift.assess.verify.verification import Verification
from drift.pipeline import run_metadata
from drift.products.files.chapter import Contents, OutputBundle, Stamped, bind_outputs
from drift.products.maps.imprint import Imprint
from kernels.runtime import runtime


@dataclass(frozen=True)
class VerificationOutputs:
    """The inputs of the verification's files and picture."""

    verification: Verification
    imprint: Imprint


def _plot(outputs: VerificationOutputs, path: Path) -> None:
    # imported here because Matplotlib takes a second
    from drift.assess.verify import map as verification_map

    verification_map.plot_verification(outputs.verification, path, outputs.imprint)


FILES: dict[str, Callable[[VerificationOutputs, Stamped], Contents]] = {
    "verify.csv": lambda outputs, stamped: verification_files.verification_csv(
        outputs.verification, stamped["run_id"]
    ),
    "verify.nc": lambda outputs, stamped: verification_files.verification_dataset(
        outputs.verification
    ),
}
PICTURES: dict[str, Callable[[VerificationOutputs, Path], None]] = {
    "verify.png": _plot,
}


def verification_bundle(verification: Verification) -> OutputBundle:
    """Return the output bundle of a verification."""
    case = verification.case
    inputs = [run_metadata.input_file(path) for path in case.inputs]
    attributes = {
        "title": f"{case.title}: forecasts of drifters",
        "source": f"casp-drift {version.__version__}",
        "versions": version.told(),
        "seed": str(case.seed),
        **runtime.about(),
        "forcing": "; ".join(f"{Path(given['path']).name}: {given['digest']}" for given in inputs),
        "coast": case.coast.source,
        "uncertainty": verification_text.assumed_errors(verification),
        "case": case.text,
    }
    footer = f"{attributes['source']}, seed {case.seed}, {attributes['uncertainty']}"
    outputs = VerificationOutputs(verification, Imprint(case.title, footer, attributes))
    numbers = {
        "verification": verification_files.summary_of_verification(verification),
        "inputs": inputs,
    }
    return OutputBundle(
        numbers,
        bind_outputs(FILES, outputs),
        bind_outputs(PICTURES, outputs),
        attributes,
        tuple(run_metadata.case_warnings(case)),
    )
