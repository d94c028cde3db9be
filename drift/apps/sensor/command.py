"""`drift sensor` and `drift.sensor_reach`: compute where a sensor detects, and write results."""

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
    """Return where a sensor of a case would detect a target by one look; nothing is run.

    Args:
        case: a case from `drift.load` or `drift.vary`, with a `[[sensor]]` of that name.
        name: name of the sensor.
        out: a folder for sensor.png, sensor.nc and sensor.csv; None: nothing is written.
        time: as a case writes it, "211830ZNOV26" or "+6 h"; None: the start of the case, or of the
            one sortie that carries the sensor.
        at: "36 00N 070 00W", for a sensor whose table gives no position.
        heading: heading of its array [degrees from north].
        beams: numbers of beams from 1; None: all.
        scenario: scenario whose source level is used; None: the likeliest.
        speed: speed of the target, "8 kn", if its source level depends on it.
        overwrite: whether results in `out` are replaced, once the new ones are complete.

    Returns:
        The detection by one look, by bearing [rad] and range [m] and on a grid (lat, lon), and the
        range of 50 % detection [m] by bearing, shape (360,).

    Raises:
        UserError: no such sensor, or its position, heading, time or speed is missing or invalid.
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
    attributes = _attributes(case, found.question)
    imprint = Imprint(
        f'{case.title}: sensor "{found.question.sensor.name}"',
        f"{attributes['source']}. A look is one instant; land is ignored; blank areas are out of "
        "range.",
        {**attributes, "run_id": formats.run_id(attributes)},
    )
    land = coastline.land_reader(None, case.coast)
    writer.write(
        folder,
        [chapter.chapter(chapter.SensorOutputs(found, imprint, land), attributes)],
        overwrite=overwrite,
    )


def _attributes(case: Case, question: Question) -> dict[str, str]:
    """Return the attributes that every file carries.

    The question is appended to the case, so that each question has its own run_id.
    """
    description = "; ".join(
        [
            text.described(question),
            *(f"{name}: {description}" for name, description in question.assumed),
        ]
    )
    return {
        "title": case.title,
        "source": f"casp-drift {version.__version__}",
        "versions": version.told(),
        "seed": str(case.seed),
        "coast": case.coast.source,
        "case": f"{case.text.rstrip()}\n# sensor {question.sensor.name}: {description}\n",
        **case.about,
    }
