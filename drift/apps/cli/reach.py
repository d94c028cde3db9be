"""The command `drift sensor`."""

import argparse
import re
from pathlib import Path

from drift.apps.cli import given as take
from drift.apps.cli.answer import Answer
from drift.products.files import interrupt
from geo.errors import UserError


def sensor(args: argparse.Namespace) -> Answer:
    """Map where a sensor of a case would detect a target."""
    with interrupt.exit_on_signal():
        case = take.load_case(args.case, args.changes, args.seed)
        label = re.sub(r"[^\w.-]+", "_", args.name)[:60]
        out = args.out or Path(f"{case.path.stem}-sensor-{label}")
        beams = None if args.beams is None else _beams(args.beams)
        from drift.apps.sensor import command, text

    found = command.sensor_reach(
        case,
        args.name,
        out,
        time=args.time,
        at=args.at,
        heading=args.heading,
        beams=beams,
        scenario=args.scenario,
        speed=args.speed,
        overwrite=args.overwrite,
    )
    line = f"Maps in {out / 'sensor.png'}, all results in {out}"
    return Answer(
        case.title, text.reach_facts(found), (line,), {"sensor": text.summary_of_reach(found)}, out
    )


def _beams(text: str) -> list[int]:
    """Return the beam numbers of a text like "1,4"."""
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise UserError(f'--beams "{text}" must be numbers separated by commas, like 1,4') from None
