"""Values of command line options in the form that commands need: cases, quantities, boxes, files.

An invalid value raises UserError with a message of one line.
"""

import argparse
import math
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from geo.errors import UserError

FARTHEST = 20_000_000.0  # [m] no two points of the Earth are farther apart


def load_case(
    name: str,
    changes: Sequence[str],
    seed: int | None,
    option: str = "--set",
    along: Collection[str] = (),
) -> Any:
    """Load a case file or a shipped case with its overrides.

    Args:
        name: path of a case file, or the name of a shipped case.
        changes: overrides as KEY=VALUE.
        seed: seed in place of the case's; None keeps that.
        option: name of the option that gave `changes`, for messages.
        along: quantities that the case needs no sources for.

    Returns:
        The case (`drift.case.record.Case`).

    Raises:
        UserError: the current folder does not exist, or the case is invalid.
    """
    from drift.case import file as case_file

    try:
        os.getcwd()
    except OSError as error:
        raise UserError(
            f"the current folder no longer exists ({error.strerror}); change to one that does"
        ) from None
    overrides = parse_overrides(changes, option)
    if seed is not None:
        overrides["seed"] = str(seed)
    return case_file.load(name, overrides, along=along)


def parse_overrides(changes: Sequence[str], option: str = "--set") -> dict[str, str]:
    """Return overrides by key, from texts KEY=VALUE."""
    overrides = {}
    for change in changes:
        key, equals, value = change.partition("=")
        if not key.strip() or not equals:
            raise UserError(f'{option} "{change}" must be KEY=VALUE, like clock.step=600')
        overrides[key.strip()] = value
    return overrides


def parse_positive_quantity(text: str, unit: str, option: str, example: str) -> float:
    """Return the value of an option in SI units; raise UserError unless it is above zero."""
    from drift.case.values import units

    try:
        number = units.quantity(text, unit, "quantity", example)
    except ValueError as error:
        raise UserError(f"{option}: {error}") from None
    if not number > 0:
        raise UserError(f'{option} "{text}" must be above 0')
    return number


def shard_options(args: argparse.Namespace) -> dict[str, Any]:
    """Return the options of a run that divide it into shards: memory [GiB] and shards."""
    return {"memory": _parse_memory(args.memory), "shards": args.shards}


def _parse_memory(text: str | None) -> float | None:
    """Return a size of memory [GiB]; None if the option is not given."""
    if text is None:
        return None
    return parse_positive_quantity(text, "GiB", "--memory", "4 GB")


def parse_probable_error(text: str) -> float:
    """Return the standard deviation [m] per component, from the radius with half of the errors."""
    from drift.case.values import units

    try:
        radius = units.quantity(text, "m", "length", "10 m")
    except ValueError as error:
        raise UserError(f'--error: {error}; or write "fit"') from None
    if not 0 <= radius <= FARTHEST:
        raise UserError(
            f'--error "{text}" must be from 0 to {FARTHEST / 1000:,.0f} km, half round the Earth'
        )
    return radius / math.sqrt(2 * math.log(2))


def parse_box(text: str) -> Any:
    """Return the box of a text "west,south,east,north" [deg]."""
    from geo.box import box_between

    try:
        west, south, east, north = (float(part) for part in text.split(","))
    except ValueError:
        raise UserError(
            f'--without "{text}" must be west,south,east,north in degrees, like -98,18,-80,31'
        ) from None
    if not (-180 <= west <= 360 and -180 <= east <= 360 and -90 <= south < north <= 90):
        raise UserError(
            f'--without "{text}": longitudes are -180 to 360, latitudes -90 to 90, and south is below north; '
            "the order is west,south,east,north"
        )
    try:
        return box_between(west, south, east, north)
    except ValueError as error:
        raise UserError(f'--without "{text}": {error}') from None


def drifter_reading_options(args: argparse.Namespace) -> dict[str, Any]:
    """Return the options for reading a file of drifter tracks."""
    from drift.case.tracking import reading

    return {
        "columns": reading.parse_columns(args.columns),
        "gap": parse_positive_quantity(args.max_gap, "s", "--max-gap", "3 h"),
        "fastest": parse_positive_quantity(args.max_speed, "m/s", "--max-speed", "3 m/s"),
        "ends_aground": args.ends_aground,
    }


def quantities_in_columns(columns: Mapping[str, str]) -> list[str]:
    """Return the quantities that columns of a drifter file provide, without repetition."""
    return list(dict.fromkeys(key.rpartition("_")[0] for key in columns))


def check_writable_file(path: Path, option: str, suffix: str) -> None:
    """Raise UserError unless a file with this suffix can be written to this path."""
    folder = path.absolute().parent
    try:
        blocked = os.path.lexists(path) and not (path.is_file() and os.access(path, os.W_OK))
        if (
            path.suffix.lower() != suffix
            or not folder.is_dir()
            or len(os.fsencode(path.name)) > 255
            or blocked
        ):
            raise UserError(
                f"{option} {str(path)[:300]}: must be a {suffix} file in a folder that exists"
            )
    except (OSError, ValueError) as error:
        raise UserError(f"{option} {str(path)[:300]!a}: {error}; name another file") from None
    if not os.access(folder, os.W_OK | os.X_OK):
        raise UserError(f"{option} {path}: cannot write in {folder}; name another file")


def write_and_replace(path: Path, option: str, write: Callable[[Path], object]) -> None:
    """Write a file under a temporary name beside its path, then move it into place.

    Raises UserError if it cannot be written.
    """
    partial_file = path.with_name(f".{path.name[:100]}.{os.getpid()}{path.suffix}")
    try:
        write(partial_file)
        os.replace(partial_file, os.path.realpath(path))
    except OSError as error:
        raise UserError(
            f"{option} {path}: cannot be written ({error.strerror}); name another file"
        ) from error
    finally:
        partial_file.unlink(missing_ok=True)
