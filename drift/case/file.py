"""Case files: who is adrift, since when and where, in which wind and current, and what is asked
for.

`load` turns a TOML file into a Case, a frozen record in SI and UTC. Every error that can be found
without opening the forcing is found here, all of them at once, a line each. Cases that ship with
the project are found by name.
"""

import os
import re
import tomllib
from collections.abc import Collection, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from drift.case import build, rest
from drift.case.forcing import sources
from drift.case.forcing.sources import SourceTable
from drift.case.record import Case
from drift.case.scenario import family
from drift.case.schema import CaseTable
from drift.case.values import messages, mistakes, units
from drift.case.values.mistakes import Mistakes
from drift.engine.environment.forcing_spec import ForcingSpec
from drift.engine.motion.steering.family import gathered
from geo.errors import UserError
from geo.files import small
from geo.forcing.quantity import QUANTITIES

# keys that name input files
FILES = ("files", "source", "lakes", "file", "network", "track", "actual")
# of what was given: shortened, so that what is wrong with it can be read
LONG_WORD = re.compile(r"\S{301,}")
ALONG = "along the tracks"  # name of a source that stands for columns of a drifters' file
LARGEST = 16 * 2**20  # [bytes] of a case file: a thousand times those that ship


def shipped(folder: str = "") -> list[tuple[str, str]]:
    """Return (name, title) of the cases that ship with the project; folder: "tracking" for those of
    drift experiment.
    """
    place = resources.files("cases").joinpath(folder)
    files = sorted(
        (file for file in place.iterdir() if file.name.endswith(".toml")), key=lambda f: f.name
    )
    return [
        (
            file.name.removesuffix(".toml"),
            str(tomllib.loads(file.read_text(encoding="utf-8")).get("title", "")),
        )
        for file in files
    ]


def load(
    name: str | os.PathLike[str],
    overrides: Mapping[str, str] | None = None,
    *,
    along: Collection[str] = (),
) -> Case:
    """Return the case of a TOML file, or of a shipped case's name.

    Args:
        name: a path, or a name that `drift cases` lists.
        overrides: {"clock.step": "10 min", "scenario.0.weight": "0.3"}: places in the file and TOML
            values, as text.
        along: quantities, "current", "wind", "stokes", that columns of a drifters' file give
            (`drift.verify`, `drift.fit_errors`), so that the case needs no source of them.

    Returns:
        The case, validated; times in UTC, places in radians, SI units.

    Raises:
        UserError: one for all that is wrong with it, a line for each mistake (`error.lines`).
    """
    path, text = _read(name)
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        # also for numbers of 5,000 digits, and 1,000 brackets deep
        raise UserError(_one_line(path, f"not valid TOML: {error}")) from None
    if is_of_tracking(data):
        raise UserError(
            f"{path.name}: is a tracking case: drift track for one with detections, drift experiment for one with a [target]"
        )
    wrong = Mistakes()
    for key, value in (overrides or {}).items():
        with wrong.gathered():
            override(data, key, value)
        text += f"\n# --set {key}={value}"
    for quantity in along:
        if not data.get(quantity):
            data[quantity] = [{"name": ALONG, "constant": {"east": 0.0, "north": 0.0}}]
            text += f"\n# {quantity}: from columns along the tracks of drifters"
    return _validated(data, path, text, wrong)


def is_of_tracking(data: Mapping[str, Any]) -> bool:
    """Return whether tables are of a tracking case (drift.case.tracking.tracking), whatever is
    wrong with them.
    """
    other, own = (
        {"scenario", "family", "spill"},
        {"target", "detections", "detection", "method", "tracker"},
    )
    return not other & set(data) and bool(own & set(data))


def vary(case: Case, changes: Mapping[str, Any]) -> Case:
    """Return a case with some places of its file changed, validated as a file is.

    What the case states in relation to its start, such as a release "+2 h", goes along with it.

    Args:
        case: of `drift.load` or `drift.vary`; it stays as it is.
        changes: {"start": np.datetime64("2026-11-21T18:30"), "scenario.0.position.at": [4.33,
            60.17], "seed": 7}: places as in `load`, with the values that TOML would have there,
            lists, tables and times of NumPy among them; None takes a key away.

    Returns:
        The changed case.

    Raises:
        UserError: one for all that is wrong with it, a line for each mistake (`error.lines`).
    """
    data, text, wrong = deepcopy(dict(case.tables)), case.text, Mistakes()
    for key, value in changes.items():
        with wrong.gathered():
            _put(data, key, _plain(value))
        text += f"\n# --set {key}={_plain(value)}"
    return _validated(data, case.path, text, wrong)


def _plain(value: Any) -> Any:
    """Return a value as TOML would give it:

    NumPy's times as text, its numbers and arrays as Python's own.
    """
    if isinstance(value, np.datetime64):
        return f"{value.astype('datetime64[s]')}Z"
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


def _validated(data: dict[str, Any], path: Path, text: str, wrong: Mistakes) -> Case:
    """Return the case of a file's tables; raise all that is wrong with it, `wrong` included."""
    try:
        wrong.refuse()
        case = build.build_case(
            CaseTable.model_validate(data, context={"whole": CaseTable}), path, text
        )
        inputs = tuple(dict.fromkeys(_inputs(family.expanded(data), path.absolute().parent)))
        return replace(case, inputs=inputs, tables=data)
    except ValidationError as error:
        told = (
            *messages.lines(error, _named(data)),
            *rest.mistakes(data, error, path, text, CaseTable),
        )
        raise _refusal(path, (*_by_family(told, data), *_sources_without(data, path))) from None
    except UserError as error:
        told = (*error.lines, *rest.mistakes(data, error, path, text, CaseTable))
        raise _refusal(path, _by_family(told, data)) from None
    except OverflowError:  # integers beyond the largest float
        raise UserError(f"{path.name}: one of its whole numbers is too large") from None


def _named(data: dict[str, Any]) -> Any:
    """Return the tables of a case with the scenarios of its families, so that mistakes in these can
    be told by name.
    """
    try:
        return family.expanded(data)
    except ValueError:  # which is among the mistakes already
        return data


def _by_family(lines: Sequence[str], data: dict[str, Any]) -> tuple[str, ...]:
    """Return lines of mistakes with those that scenarios of a family share made one."""
    return tuple(gathered(lines, family.places(data)))


def source(quantity: str, files: Sequence[str], overrides: Mapping[str, str]) -> ForcingSpec:
    """Return files as the source that a case with these keys would make of them.

    overrides: {"variables.east": "ue"}.
    Raises UserError, a line for each mistake.
    """
    data: dict[str, Any] = {"files": list(files)}
    wrong = Mistakes()
    for key, value in overrides.items():
        with wrong.gathered():
            if key.partition(".")[0] in ("files", "name", "fill", "add"):
                raise UserError(f"--set {key}: this key says nothing of how a file is read")
            override(data, key, value)
    wrong.refuse()
    try:
        return SourceTable.model_validate(data).spec(
            quantity, 1, np.datetime64("1970-01-01", "s"), Path.cwd()
        )
    except ValidationError as error:
        raise UserError(*messages.lines(error, data)) from None
    except ValueError as error:
        raise UserError(str(error)) from None


def _inputs(node: Any, folder: Path, key: str = "") -> Iterator[str]:
    """Give the paths of the files that a case's tables, which are known to be in order, name
    anywhere.
    """
    if isinstance(node, Mapping):
        for name, value in node.items():
            if key != "frequency" or name != "source":  # of a sound, which is no file
                yield from _inputs(value, folder, name)
    elif isinstance(node, list):
        for value in node:
            # a track in a list is positions
            yield from _inputs(value, folder, key if key == "files" else "")
    elif isinstance(node, str) and (
        (key in FILES and node not in {"gshhg", "none"})
        or (key == "motion" and node.endswith(".py"))
    ):
        yield from (
            path for path in sources.matching(node, folder) if not sources.ADDRESS.match(path)
        )


def _refusal(path: Path, lines: tuple[str, ...]) -> UserError:
    """Return a refusal of a case: its mistakes, each a line that begins with the file's name."""
    return UserError(*(_one_line(path, line) for line in mistakes.shortened(lines)))


def _one_line(path: Path, message: str) -> str:
    """Return a mistake with its file's name; what was given may hold line breaks of its own."""
    line = LONG_WORD.sub(
        lambda word: f"{word[0][:60]}... ({len(word[0]):,} letters)", " ".join(message.split())
    )
    return f"{path.name}: {line}"


def _sources_without(data: dict[str, Any], path: Path) -> list[str]:
    """Return what is wrong with the sources that can be understood in a case that as a whole can't
    be.
    """
    try:
        start = units.time(data.get("start"))
    except ValueError:
        return []
    wrong = Mistakes()
    for quantity in QUANTITIES:
        tables = data.get(quantity)
        for number, written in enumerate(tables if isinstance(tables, list) else (), 1):
            try:
                table = SourceTable.model_validate(written)
            except ValidationError:  # which is among the mistakes already
                continue
            if isinstance(start, np.datetime64):
                with wrong.gathered(sources.source_label(quantity, number, table.name)):
                    table.spec(quantity, number, start, path.absolute().parent)
    return wrong.lines


def _read(name: str | os.PathLike[str]) -> tuple[Path, str]:
    path = Path(name)
    plain = path.name == str(name) and path.suffix != ".toml"  # as shipped cases are called
    if plain and name and (os.path.isdir(path) or not os.path.lexists(path)):
        path = Path(str(resources.files("cases").joinpath(f"{name}.toml")))
    try:
        # editors of Windows put a byte order mark first
        return path, small.contents(path, LARGEST).decode("utf-8-sig")
    except (FileNotFoundError, NotADirectoryError):
        if str(name) in {known for known, _ in shipped("tracking")}:
            raise UserError(
                f'"{name}" is a tracking case: drift experiment or drift track, see drift cases'
            ) from None
        names = ", ".join(name for name, _ in shipped())
        raise UserError(
            f'no case "{name}": neither a file nor a shipped case ({names}). See: drift cases'
        ) from None
    except UnicodeDecodeError:
        raise UserError(f'"{name}" is not a case file: it is not text in UTF-8') from None
    except OSError as error:
        raise UserError(f'cannot read case "{str(name)[:300]}": {error.strerror}') from None
    except ValueError as error:  # a name with a zero byte
        raise UserError(f"cannot read case {str(name)[:300]!a}: {error}") from None


def override(data: dict[str, Any], key: str, value: str) -> None:
    """Set one place of the tables as read, like clock.step, to a TOML value.

    Raises UserError where there is no such place.
    """
    if not f"{key}{value}".isascii() and any(
        "\ud800" <= letter <= "\udfff" for letter in f"{key}{value}"
    ):
        raise UserError(f"--set {key!a}={value!a} is not text in UTF-8")
    try:
        parsed = tomllib.loads(f"value = {value}")
        new = parsed["value"] if len(parsed) == 1 else value
    except (ValueError, RecursionError):
        new = value  # so that --set clock.step="10 min" needs no second pair of quotes
    _put(data, key, new)


def _put(data: dict[str, Any], key: str, new: Any) -> None:
    """Set one place of the tables as read, or take it away where the new value is None.

    Numbers in the key count the items of a list from 0.
    """
    *above, last = key.split(".")
    node: Any = data
    for part in above:
        node = (
            node.setdefault(part, {}) if isinstance(node, dict) else node[_index(node, part, key)]
        )
    if isinstance(node, dict) and new is None:
        node.pop(last, None)
    elif isinstance(node, dict):
        node[last] = new
    else:
        node[_index(node, last, key)] = new


def _index(node: Any, part: str, key: str) -> int:
    if not isinstance(node, list):
        raise UserError(f'{key}: there is nothing called "{part}" inside a value')
    if not part.isdecimal() or int(part) >= len(node):
        raise UserError(f'{key}: "{part}" is not a number from 0 to {len(node) - 1}')
    return int(part)
