"""Load case files: TOML files that describe the object, its last known position and the forcing.

`load` turns a file into a `Case`, a frozen record in SI units and UTC. It reports every error that
can be found without opening the forcing, all at once, one per line. Shipped cases are found by
name.
"""

import difflib
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
from drift.case.scenario import catalogue, family
from drift.case.schema import CaseTable
from drift.case.values import messages, mistakes, toml_text, units
from drift.case.values.mistakes import Mistakes
from drift.engine.environment.forcing_spec import ForcingSpec
from drift.engine.motion.steering.family import merge_lines
from geo.errors import UserError
from geo.files import small
from geo.forcing.quantity import QUANTITIES

# keys that name input files
FILES = ("files", "source", "lakes", "file", "network", "track", "actual", "catalogue")
# a long word of the input is shortened in messages
LONG_WORD = re.compile(r"\S{301,}")
ALONG = "along the tracks"  # name of the source that stands for columns of a drifter file
LARGEST = 16 * 2**20  # [bytes] of a case file: a thousand times the shipped ones


def shipped(folder: str = "") -> list[tuple[str, str]]:
    """Return (name, title) of the shipped cases; folder "tracking": those of drift experiment."""
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
    """Load and validate a case file, or a shipped case.

    Args:
        name: a path, or a name that `drift cases` lists.
        overrides: changed keys and their TOML values as text: {"clock.step": "10 min",
            "scenario.0.weight": "0.3"}.
        along: quantities ("current", "wind", "stokes") given by columns of a drifter file
            (`drift.verify`, `drift.fit_errors`); the case needs no source for these.

    Returns:
        The validated case: times in UTC, positions in radians, SI units.

    Raises:
        UserError: all mistakes of the case, one line for each (`error.lines`).
    """
    return load_text(*_read(name), overrides, along=along)


def load_text(
    path: Path,
    text: str,
    overrides: Mapping[str, str] | None = None,
    *,
    along: Collection[str] = (),
) -> Case:
    """Validate the text of a case file, which need not be saved.

    Args:
        path: the file that it is the text of: relative paths start from its folder.
        text: TOML.
        overrides: see `load`.
        along: see `load`.

    Returns:
        The validated case, as `load` returns it.

    Raises:
        UserError: all mistakes of the case, one line for each (`error.lines`).
    """
    try:
        data = toml_text.parse_toml(text)
    except (ValueError, RecursionError) as error:
        # tomllib raises these also for numbers of 5,000 digits and for 1,000 nested brackets
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
    return _validate(data, path, text, wrong)


def is_of_tracking(data: Mapping[str, Any]) -> bool:
    """Return whether tables are those of a tracking case (drift.case.tracking.tracking), valid or
    not.
    """
    other, own = (
        {"scenario", "family", "spill"},
        {"target", "detections", "detection", "method", "tracker"},
    )
    return not other & set(data) and bool(own & set(data))


def vary(case: Case, changes: Mapping[str, Any]) -> Case:
    """Return a copy of a case with changed keys, validated like a file.

    Times relative to the start, such as a release at "+2 h", move with a changed start.

    Args:
        case: made by `drift.load` or `drift.vary`; it is not modified.
        changes: keys as in `load`, with Python values in place of TOML: {"start":
            np.datetime64("2026-11-21T18:30"), "scenario.0.position.at": [4.33, 60.17], "seed": 7}.
            Lists, dicts and NumPy values are allowed; None removes a key.

    Returns:
        The changed case.

    Raises:
        UserError: all mistakes of the changed case, one line for each (`error.lines`).
    """
    data, text, wrong = deepcopy(dict(case.tables)), case.text, Mistakes()
    for key, value in changes.items():
        with wrong.gathered():
            _set_key(data, key, _plain(value))
        text += f"\n# --set {key}={_plain(value)}"
    return _validate(data, case.path, text, wrong)


def _plain(value: Any) -> Any:
    """Convert a value to the types of TOML: NumPy times to text, its numbers and arrays to
    Python's."""
    if isinstance(value, np.datetime64):
        return f"{value.astype('datetime64[s]')}Z"
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


def _validate(data: dict[str, Any], path: Path, text: str, wrong: Mistakes) -> Case:
    """Build the case of a file's tables; raise UserError with all mistakes, those in `wrong`
    too."""
    unread = Mistakes()  # of the catalogue of leeway classes
    classes = catalogue.catalogue_of_case(data, path.absolute().parent, unread)
    context = {"whole": CaseTable, "catalogue": classes}
    try:
        wrong.refuse()
        case = build.build_case(CaseTable.model_validate(data, context=context), path, text)
        unread.refuse()
        inputs = tuple(
            dict.fromkeys(_input_files(family.expand_families(data), path.absolute().parent))
        )
        return replace(case, inputs=inputs, tables=data)
    except ValidationError as error:
        messages_of_case = (
            *unread.lines,
            *messages.lines(error, _with_families(data)),
            *rest.further_mistakes(data, error, path, text, context),
        )
        raise _error_of_case(
            path, (*_merge_family_mistakes(messages_of_case, data), *_source_mistakes(data, path))
        ) from None
    except UserError as error:
        messages_of_case = (
            *unread.lines,
            *error.lines,
            *rest.further_mistakes(data, error, path, text, context),
        )
        raise _error_of_case(path, _merge_family_mistakes(messages_of_case, data)) from None
    except OverflowError:  # integers beyond the largest float
        raise UserError(f"{path.name}: one of its whole numbers is too large") from None


def _with_families(data: dict[str, Any]) -> Any:
    """Return the tables with the scenarios of families added, so that messages can name these."""
    try:
        return family.expand_families(data)
    except ValueError:  # already among the mistakes
        return data


def _merge_family_mistakes(lines: Sequence[str], data: dict[str, Any]) -> tuple[str, ...]:
    """Merge lines of mistakes that scenarios of one family share."""
    return tuple(merge_lines(lines, family.places(data)))


def source(quantity: str, files: Sequence[str], overrides: Mapping[str, str]) -> ForcingSpec:
    """Return the forcing source that a case would make of files.

    Args:
        quantity: "current", "wind" and so on.
        files: paths or patterns.
        overrides: further keys of the source as TOML text: {"variables.east": "ue"}.

    Raises:
        UserError: one line for each mistake.
    """
    data: dict[str, Any] = {"files": list(files)}
    wrong = Mistakes()
    for key, value in overrides.items():
        with wrong.gathered():
            if key.partition(".")[0] in ("files", "name", "fill", "add"):
                raise UserError(f"--set {key}: this key does not affect how a file is read")
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


def _input_files(node: Any, folder: Path, key: str = "") -> Iterator[str]:
    """Yield the paths of all input files that the valid tables of a case name."""
    if isinstance(node, Mapping):
        for name, value in node.items():
            if key != "frequency" or name != "source":  # the source of a sound is not a file
                yield from _input_files(value, folder, name)
    elif isinstance(node, list):
        for value in node:
            # in a list, `track` holds positions, not a file
            yield from _input_files(value, folder, key if key == "files" else "")
    elif isinstance(node, str) and (
        (key in FILES and node not in {"gshhg", "none"})
        or (key == "motion" and node.endswith(".py"))
    ):
        yield from (
            path for path in sources.matching_files(node, folder) if not sources.ADDRESS.match(path)
        )


def _error_of_case(path: Path, lines: tuple[str, ...]) -> UserError:
    """Return the error of a case: its mistakes, one per line, each beginning with the file's
    name."""
    return UserError(*(_one_line(path, line) for line in mistakes.shorten_lines(lines)))


def _one_line(path: Path, message: str) -> str:
    """Return a mistake as one line after its file's name; line breaks in the input become
    spaces."""
    line = LONG_WORD.sub(
        lambda word: f"{word[0][:60]}... ({len(word[0]):,} letters)", " ".join(message.split())
    )
    return f"{path.name}: {line}"


def _source_mistakes(data: dict[str, Any], path: Path) -> list[str]:
    """Return the mistakes in the forcing sources of a case whose other tables are invalid."""
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
            except ValidationError:  # already among the mistakes
                continue
            if isinstance(start, np.datetime64):
                with wrong.gathered(sources.source_label(quantity, number, table.name)):
                    table.spec(quantity, number, start, path.absolute().parent)
    return wrong.lines


def _read(name: str | os.PathLike[str]) -> tuple[Path, str]:
    path = Path(name)
    plain = path.name == str(name) and path.suffix != ".toml"  # the form of a shipped case's name
    if plain and name and (os.path.isdir(path) or not os.path.lexists(path)):
        path = Path(str(resources.files("cases").joinpath(f"{name}.toml")))
    try:
        # Windows editors write a byte order mark
        return path, small.read_small_file(path, LARGEST).decode("utf-8-sig")
    except (FileNotFoundError, NotADirectoryError):
        if str(name) in {known for known, _ in shipped("tracking")}:
            raise UserError(
                f'"{name}" is a tracking case: drift experiment or drift track, see drift cases'
            ) from None
        if os.path.lexists(f"{name}.toml"):
            raise UserError(f'no case "{name}"; did you mean the file "{name}.toml"?') from None
        names = [known for known, _ in shipped()]
        beside = [str(path) for path in Path(name).parent.glob("*.toml")]
        near = difflib.get_close_matches(str(name), [*names, *beside], 1)
        if near:
            raise UserError(
                f'no case "{name}"; did you mean "{near[0]}"? See: drift cases'
            ) from None
        raise UserError(
            f'no case "{name}": neither a file nor a shipped case ({", ".join(names)}). See: drift cases'
        ) from None
    except UnicodeDecodeError:
        raise UserError(f'"{name}" is not a case file: it is not text in UTF-8') from None
    except OSError as error:
        raise UserError(f'cannot read case "{str(name)[:300]}": {error.strerror}') from None
    except ValueError as error:  # a name with a zero byte
        raise UserError(f"cannot read case {str(name)[:300]!a}: {error}") from None


def override(data: dict[str, Any], key: str, value: str) -> None:
    """Set one key of a case's tables, in place.

    Args:
        data: the tables as read.
        key: its path, such as "clock.step"; numbers count list items from 0.
        value: a TOML value as text.

    Raises:
        UserError: there is no such place.
    """
    if not f"{key}{value}".isascii() and any(
        "\ud800" <= letter <= "\udfff" for letter in f"{key}{value}"
    ):
        raise UserError(f"--set {key!a}={value!a} is not text in UTF-8")
    try:
        parsed = tomllib.loads(f"value = {value}")
        new = parsed["value"] if len(parsed) == 1 else value
    except (ValueError, RecursionError):
        new = value  # --set clock.step="10 min" then needs no second pair of quotes
    _set_key(data, key, new)


def _set_key(data: dict[str, Any], key: str, new: Any) -> None:
    """Set one key of the tables, or remove it if the new value is None.

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
        raise UserError(
            f'{key}: "{part}" is not a number from 0 to {len(node) - 1}; items of a list are counted '
            "from 0, as in scenario.0.weight"
        )
    return int(part)
