"""Score finished runs against their finds, and write the results: `drift score`."""

import os
from collections.abc import Sequence
from pathlib import Path

from drift import version
from drift.assess.score import chapter, incident
from drift.assess.score.calibration import Score
from drift.assess.score.incident import Find, Incident, Run
from drift.products.files import formats, writer
from drift.products.maps.imprint import Imprint
from geo.errors import UserError

WITHIN = 3600.0  # [s] largest time from a find to the only output near it


def score(
    folders: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str] | None = None,
    *,
    found: str | os.PathLike[str] | None = None,
    within: float = WITHIN,
    overwrite: bool = False,
) -> Score:
    """Return how well the forecasts of past cases held the places where objects were found.

    Each forecast is scored as it was before its find. With `out`, also write the results.

    Args:
        folders: results of `drift.run`, a folder for each case.
        out: folder for the results, written completely or not at all; None: nothing is written.
        found: a CSV file with the columns run (name of the folder, or its run_id), time, lon and
            lat; None: each case has a contact called "found".
        within: largest time [s] from a find to an output, if there is none on its other side.
        overwrite: whether results in `out` are replaced, once the new ones are complete.

    Returns:
        The containment at each find (0 to 1) with separations [m], and over all finds the share
        that each area held, with exact intervals and tests.

    Raises:
        UserError: a folder is no finished run, has no find, or used the find before it; one line
            for each mistake (`error.lines`).
    """
    target = None if out is None else Path(out)
    if target is not None:
        writer.check_folder(target, overwrite, (*chapter.FILES, *chapter.PICTURES))
    if not within >= 0:
        raise UserError(f"--within {within:g} s must be at least 0 s")
    listed = [folders] if isinstance(folders, str | os.PathLike) else list(folders)
    if not listed:
        raise UserError("drift score: no folder is given; name the results of drift run")
    runs = [incident.open_run(Path(folder)) for folder in listed]
    finds = _finds_of(runs, None if found is None else Path(found))
    rows: list[Incident] = []
    wrong: list[str] = []
    for run, find in zip(runs, finds, strict=True):
        try:
            rows.append(incident.score_run(run, find, within))
        except UserError as error:
            wrong += error.lines
    if wrong:
        raise UserError(*wrong)
    result = Score(tuple(rows))
    if target is not None:
        _write(result, runs, target, overwrite)
    return result


def _finds_of(runs: Sequence[Run], path: Path | None) -> list[Find]:
    """Return the find of each run; raise UserError for runs without, and for runs named twice."""
    names = [run.name for run in runs]
    wrong = [
        f'drift score: two folders are called "{name}"; rename one'
        for name in sorted({name for name in names if names.count(name) > 1})
    ]
    given = {} if path is None else incident.read_finds(path)
    known = {*names, *(run.run_id for run in runs)}
    wrong += [
        f'{path}: run "{name}" is none of the folders given: {", ".join(names)}'
        for name in given
        if name not in known
    ]
    finds = []
    for run in runs:
        find = given.get(run.name, given.get(run.run_id)) or run.find
        if find is None:
            wrong.append(
                f"results {run.folder}: where was it found? Give --found FILE with a line for "
                f'run "{run.name}", or name a contact of the case "{incident.FOUND}"'
            )
        else:
            finds.append(find)
    if wrong:
        raise UserError(*wrong)
    return finds


def _write(result: Score, runs: Sequence[Run], target: Path, overwrite: bool) -> None:
    case = "\n".join(
        f"{one.run} {one.run_id}: found {one.find.time}Z, {one.find.lon:.6f}, {one.find.lat:.6f}"
        for one in result.incidents
    )
    title = f"Scores of {len(runs)} past case{'s' * (len(runs) > 1)}"
    attributes = {
        "title": title,
        "source": f"casp-drift {version.__version__}",
        "versions": version.told(),
        "case": case,
    }
    stamped = {**attributes, "run_id": formats.run_id(attributes)}
    imprint = Imprint(title, attributes["source"], stamped)
    outputs = chapter.ScoreOutputs(result, imprint)
    writer.write(target, [chapter.score_bundle(outputs, attributes)], overwrite=overwrite)
