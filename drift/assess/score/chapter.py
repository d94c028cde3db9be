"""The output files of scores of past cases: score.csv and score.png."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from drift.assess.score import text
from drift.assess.score.calibration import Score
from drift.products.files.chapter import Contents, OutputBundle, Stamped, bind_outputs
from drift.products.maps.imprint import Imprint


@dataclass(frozen=True)
class ScoreOutputs:
    """The inputs of the files and the picture."""

    score: Score
    imprint: Imprint


def _plot(outputs: ScoreOutputs, path: Path) -> None:
    # imported here because Matplotlib takes a second
    from drift.assess.score import map as score_map

    score_map.plot_score(outputs.score, path, outputs.imprint)


FILES: dict[str, Callable[[ScoreOutputs, Stamped], Contents]] = {
    "score.csv": lambda outputs, stamped: text.score_csv(outputs.score, stamped["run_id"]),
}
PICTURES: dict[str, Callable[[ScoreOutputs, Path], None]] = {"score.png": _plot}


def score_bundle(outputs: ScoreOutputs, attributes: dict[str, str]) -> OutputBundle:
    """Return the output bundle of scores; `attributes` are its provenance texts by name."""
    return OutputBundle(
        {"score": text.summary_of_score(outputs.score)},
        bind_outputs(FILES, outputs),
        bind_outputs(PICTURES, outputs),
        attributes,
    )
