"""The command of sensors: sensor."""

import argparse
import re
from pathlib import Path

from drift.apps.cli import given as take
from drift.apps.cli.answer import Answer
from drift.products.files import interrupt
from geo.errors import UserError


def sensor(given: argparse.Namespace) -> Answer:
    """Say where a sensor of a case would hear, or see, a target."""
    with interrupt.leaving_at_once():
        case = take.case(given.case, given.changes, given.seed)
        label = re.sub(r"[^\w.-]+", "_", given.name)[:60]
        out = given.out or Path(f"{case.path.stem}-sensor-{label}")
        beams = None if given.beams is None else _beams(given.beams)
        from drift.apps.sensor import command, text

    found = command.sensor_reach(
        case,
        given.name,
        out,
        time=given.time,
        at=given.at,
        heading=given.heading,
        beams=beams,
        scenario=given.scenario,
        speed=given.speed,
        overwrite=given.overwrite,
    )
    line = f"Maps in {out / 'sensor.png'}, all results in {out}"
    return Answer(
        case.title, text.reach_facts(found), (line,), {"sensor": text.summary_of_reach(found)}, out
    )


def _beams(text: str) -> list[int]:
    """Return the numbers of "1,4"."""
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise UserError(f'--beams "{text}" must be numbers with commas between, like 1,4') from None
