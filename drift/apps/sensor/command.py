"""Where a sensor of a case hears, from the question to the files:

`drift sensor` and `drift.sensor_reach`.
"""

import os
from collections.abc import Sequence
from pathlib import Path

from drift import version
from drift.apps.sensor import asked, chapter, reach, text
from drift.apps.sensor.records import Question, Reach
from drift.case.record import Case
from drift.engine.environment import coastline
from drift.products.files import formats, writer
from drift.products.maps.imprint import Imprint


def sensor_reach(
    case: Case,
    name: str,
    out: str | os.PathLike[str] | None = None,
    *,
    time: object = None,
    at: object = None,
    heading: object = None,
    beams: Sequence[int] | None = None,
    scenario: str | None = None,
    speed: object = None,
    overwrite: bool = False,
) -> Reach:
    """Return where a sensor of a case would hear, or see, a target by one look; nothing is run.

    Args:
        case: of `drift.load` or `drift.vary`, with a `[[sensor]]` of that name.
        name: of the sensor.
        out: a folder for sensor.png, sensor.nc and sensor.csv; None: nothing is written.
        time: as a case writes it, "211830ZNOV26" or "+6 h"; None: the start of the case, or of the
            one sortie that carries the sensor.
        at: "36 00N 070 00W", of a sensor whose table does not say.
        heading: of its array [degrees from north].
        beams: numbers from 1; None: all.
        scenario: whose source level is heard; None: the likeliest.
        speed: "8 kn", where the level goes by it.
        overwrite: whether results that `out` holds are replaced, once the new ones are complete.

    Returns:
        What one look detects by bearing [rad] and range [m] and on a grid (lat, lon), and how far
        it detects with 50 % [m], shape (360,) by bearing.

    Raises:
        UserError: no such sensor, or its place, heading, time or speed is missing or does not fit.
    """
    folder = None if out is None else Path(out)
    question = asked.question(
        case, name, time=time, at=at, heading=heading, beams=beams, scenario=scenario, speed=speed
    )
    if folder is not None:
        writer.check_folder(folder, overwrite, (*chapter.FILES, *chapter.PICTURES))
    found = reach.reach(question)
    if folder is not None:
        _write(case, found, folder, overwrite)
    return found


def _write(case: Case, found: Reach, folder: Path, overwrite: bool) -> None:
    told = _attributes(case, found.question)
    imprint = Imprint(
        f'{case.title}: sensor "{found.question.sensor.name}"',
        f"{told['source']}. A look is one instant; land is passed over; where a map is blank nothing is heard or seen.",
        {**told, "run_id": formats.run_id(told)},
    )
    land = coastline.lands(None, case.coast)
    writer.write(
        folder,
        [chapter.chapter(chapter.SensorOutputs(found, imprint, land), told)],
        overwrite=overwrite,
    )


def _attributes(case: Case, question: Question) -> dict[str, str]:
    """Return what every file carries.

    What was asked stands under the case, so that each question has its own run_id.
    """
    words = "; ".join(
        [text.described(question), *(f"{name}: {words}" for name, words in question.assumed)]
    )
    return {
        "title": case.title,
        "source": f"casp-drift {version.__version__}",
        "versions": version.told(),
        "seed": str(case.seed),
        "coast": case.coast.source,
        "case": f"{case.text.rstrip()}\n# sensor {question.sensor.name}: {words}\n",
        **case.about,
    }
