"""The case: who is adrift, since when and where, in which wind and current, and what is asked of the forecast.

`load` turns a TOML file into a Case, a frozen record in SI and UTC. Every error that can be found without opening the
forcing is found here, all of them at once, a line each. Cases that ship with the project are found by name.
"""

import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from drift.case import build, messages, mistakes, sources, uncertainty, units
from drift.case import contact as contact_table
from drift.case import plan as plan_table
from drift.case import sortie as sortie_table
from drift.case.context import Run
from drift.case.expect import Expect
from drift.case.mistakes import Mistakes
from drift.case.schema import CaseTable, OutputTable
from drift.case.sources import SourceTable
from drift.motion.forcing_error import CASE, DEFAULT, UNFELT, ForcingError
from drift.motion.forcing_spec import ForcingSpec, Quantity
from drift.motion.scenario import Scenario
from drift.planner.depth import Depth
from drift.search.records import Contact, PlanSpec, Resampling, Sortie, Unit
from drift.spill.records import Spill
from geo import notation
from geo.box import Box
from geo.cells import Cells
from geo.errors import UserError
from geo.files import small

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

MOST_OUTPUTS = 1000
FILES = ("files", "source", "lakes", "file", "track", "actual")  # keys that name input files
QUANTITIES: tuple[Quantity, ...] = ("current", "wind", "stokes")
LARGEST = 16 * 2**20  # [bytes] of a case file: a thousand times those that ship


@dataclass(frozen=True)
class Coast:
    """Where the shoreline comes from ("gshhg", "none" or an absolute path) and what it does to a particle."""

    source: str
    behaviour: Literal["strand", "refloat", "slide"]
    half_life: float = 0.0  # [s] of lying ashore before it is afloat again; 0: it lies there for good
    offing: float = 0.0  # [m] off the beach where it is afloat again
    lakes: bool | str = False  # water; or the absolute path of a file of lakes


@dataclass(frozen=True)
class Case:
    """A validated case. Times are datetime64[s] UTC; start is where the run begins, end where it stops."""

    title: str
    path: Path
    text: str  # the file as read, with the overrides as comments
    start: np.datetime64
    end: np.datetime64
    direction: int  # +1, or -1 for a backward run, whose end is before its start
    particles: int
    seed: int
    max_lost: float
    outputs: NDArray[np.datetime64]  # in order of the run, start and end included
    trajectories: int
    areas: tuple[float, ...]  # shares of the probability whose areas are told, ascending
    grid: Cells | None  # of all outputs; None: cells follow the particles
    step: int | None  # [s], positive also in a backward run; None: choose it
    scheme: Literal["rk2", "rk4"]
    tolerance: float  # [m] a day
    domain: Box | None
    coast: Coast
    currents: tuple[ForcingSpec, ...]
    winds: tuple[ForcingSpec, ...]
    stokes: tuple[ForcingSpec, ...]
    current_error: ForcingError
    wind_error: ForcingError
    diffusivity: float  # [m2/s]
    diffusivity_by: str  # who says so: drift.case.uncertainty
    scenarios: tuple[Scenario, ...]  # of a spill: one a class of objects, all with its prior
    spill: Spill | None
    sorties: tuple[Sortie, ...]  # by start
    contacts: tuple[Contact, ...]  # by time
    units: tuple[Unit, ...]
    plan: PlanSpec
    resampling: Resampling
    expect: Expect
    depth: Depth | None = None  # where boats have too little water
    inputs: tuple[str, ...] = ()  # absolute paths of all files, and folders of files, that it names besides addresses
    tables: Mapping[str, Any] = field(default_factory=dict, repr=False, compare=False)  # as read, overrides included


def shipped() -> list[tuple[str, str]]:
    """Return (name, title) of the cases that ship with the project."""
    files = sorted(
        (file for file in resources.files("cases").iterdir() if file.name.endswith(".toml")), key=lambda f: f.name
    )
    return [
        (file.name.removesuffix(".toml"), str(tomllib.loads(file.read_text(encoding="utf-8")).get("title", "")))
        for file in files
    ]


def load(name: str | os.PathLike[str], overrides: Mapping[str, str] | None = None) -> Case:
    """Return the case of a TOML file, or of a shipped case's name.

    overrides: {"clock.step": "10 min", "scenario.0.weight": "0.3"}: places in the file and TOML values.
    Raises one UserError for whatever is wrong with it, a line for each mistake.
    """
    path, text = _read(name)
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # TOMLDecodeError; numbers of 5,000 digits; 1,000 brackets deep
        raise UserError(_one_line(path, f"not valid TOML: {error}")) from None
    wrong = Mistakes()
    for key, value in (overrides or {}).items():
        with wrong.gathered():
            _override(data, key, value)
        text += f"\n# --set {key}={value}"
    return _validated(data, path, text, wrong)


def vary(case: Case, changes: Mapping[str, Any]) -> Case:
    """Return a case with some places of its file changed, validated as a file is.

    changes: {"start": np.datetime64("2026-11-21T18:30"), "scenario.0.position.at": [4.33, 60.17], "seed": 7}: places as in
    `load`, with the values that TOML would have there, lists, tables and times of NumPy among them; None takes a key away.
    What the case states in relation to its start, such as a release "+2 h", goes along with it.
    Raises one UserError for whatever is wrong with it, a line for each mistake.
    """
    data, text, wrong = deepcopy(dict(case.tables)), case.text, Mistakes()
    for key, value in changes.items():
        with wrong.gathered():
            _put(data, key, _plain(value))
        text += f"\n# --set {key}={_plain(value)}"
    return _validated(data, case.path, text, wrong)


def _plain(value: Any) -> Any:
    """Return a value as TOML would give it: NumPy's times as text, its numbers and arrays as Python's own."""
    if isinstance(value, np.datetime64):
        return f"{value.astype('datetime64[s]')}Z"
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    return [_plain(one) for one in value] if isinstance(value, list | tuple) else value


def _validated(data: dict[str, Any], path: Path, text: str, wrong: Mistakes) -> Case:
    """Return the case of a file's tables; raise all that is wrong with it, `wrong` included."""
    try:
        wrong.refuse()
        case = _build(CaseTable.model_validate(data), path, text)
        return replace(case, inputs=tuple(dict.fromkeys(_inputs(data, path.absolute().parent))), tables=data)
    except ValidationError as error:
        raise _refusal(path, (*messages.lines(error, data), *_sources_without(data, path))) from None
    except UserError as error:
        raise _refusal(path, error.lines) from None
    except OverflowError:  # integers beyond the largest float
        raise UserError(f"{path.name}: one of its whole numbers is too large") from None


def source(quantity: Quantity, files: Sequence[str], overrides: Mapping[str, str]) -> ForcingSpec:
    """Return files as the source that a case with these keys would make of them; overrides: {"variables.east": "ue"}.

    Raises UserError, a line for each mistake.
    """
    data: dict[str, Any] = {"files": list(files)}
    wrong = Mistakes()
    for key, value in overrides.items():
        with wrong.gathered():
            if key.partition(".")[0] in ("files", "name", "fill", "add"):
                raise UserError(f"--set {key}: this key says nothing of how a file is read")
            _override(data, key, value)
    wrong.refuse()
    try:
        return SourceTable.model_validate(data).spec(quantity, 1, np.datetime64("1970-01-01", "s"), Path.cwd())
    except ValidationError as error:
        raise UserError(*messages.lines(error, data)) from None
    except ValueError as error:
        raise UserError(str(error)) from None


def _inputs(here: Any, folder: Path, key: str = "") -> Iterator[str]:
    """Give the paths of the files that a case's tables, which are known to be in order, name anywhere."""
    if isinstance(here, Mapping):
        for name, value in here.items():
            yield from _inputs(value, folder, name)
    elif isinstance(here, list):
        for value in here:
            yield from _inputs(value, folder, key if key == "files" else "")  # a track in a list is positions
    elif isinstance(here, str) and key in FILES and here not in {"gshhg", "none"}:
        yield from (path for path in sources.found(here, folder) if not sources.ADDRESS.match(path))


def _refusal(path: Path, lines: tuple[str, ...]) -> UserError:
    """Return a refusal of a case: its mistakes, each a line that begins with the file's name."""
    return UserError(*(_one_line(path, line) for line in mistakes.shortened(lines)))


def _one_line(path: Path, message: str) -> str:
    """Return a mistake with its file's name; what was given may hold line breaks of its own."""
    return f"{path.name}: {' '.join(message.split())}"


def _sources_without(data: dict[str, Any], path: Path) -> list[str]:
    """Return what is wrong with the sources that can be understood in a case that as a whole can't be."""
    try:
        start = units.time(data.get("start"))
    except ValueError:
        return []
    found = Mistakes()
    for quantity in QUANTITIES:
        tables = data.get(quantity)
        for number, written in enumerate(tables if isinstance(tables, list) else (), 1):
            try:
                table = SourceTable.model_validate(written)
            except ValidationError:  # told already
                continue
            if isinstance(start, np.datetime64):
                with found.gathered(sources.place(quantity, number, table.name)):
                    table.spec(quantity, number, start, path.absolute().parent)
    return found.lines


def _read(name: str | os.PathLike[str]) -> tuple[Path, str]:
    path = Path(name)
    if path.suffix != ".toml" and path.name == str(name) and not os.path.lexists(path):
        path = Path(str(resources.files("cases").joinpath(f"{name}.toml")))
    try:
        return path, small.contents(path, LARGEST).decode("utf-8-sig")  # Windows' editors begin with a mark
    except (FileNotFoundError, NotADirectoryError):
        names = ", ".join(name for name, _ in shipped())
        raise UserError(f'no case "{name}": neither a file nor a shipped case ({names}). See: drift cases') from None
    except UnicodeDecodeError:
        raise UserError(f'"{name}" is not a case file: it is not text in UTF-8') from None
    except OSError as error:
        raise UserError(f'cannot read case "{str(name)[:300]}": {error.strerror}') from None
    except ValueError as error:  # a name with a zero byte
        raise UserError(f"cannot read case {str(name)[:300]!a}: {error}") from None


def _override(data: dict[str, Any], key: str, value: str) -> None:
    """Set one place of the tables as read to a TOML value."""
    if not f"{key}{value}".isascii() and any("\ud800" <= letter <= "\udfff" for letter in f"{key}{value}"):
        raise UserError(f"--set {key!a}={value!a} is not text in UTF-8")
    try:
        parsed = tomllib.loads(f"value = {value}")
        new = parsed["value"] if len(parsed) == 1 else value
    except (ValueError, RecursionError):
        new = value  # so that --set clock.step="10 min" needs no second pair of quotes
    _put(data, key, new)


def _put(data: dict[str, Any], key: str, new: Any) -> None:
    """Set one place of the tables as read, or take it away where the new value is None; numbers in the key count list items from 0."""
    *above, last = key.split(".")
    here: Any = data
    for part in above:
        here = here.setdefault(part, {}) if isinstance(here, dict) else here[_index(here, part, key)]
    if isinstance(here, dict) and new is None:
        here.pop(last, None)
    elif isinstance(here, dict):
        here[last] = new
    else:
        here[_index(here, last, key)] = new


def _index(here: Any, part: str, key: str) -> int:
    if not isinstance(here, list):
        raise UserError(f'--set {key}: there is nothing called "{part}" inside a value')
    if not part.isdecimal() or int(part) >= len(here):
        raise UserError(f'--set {key}: "{part}" is not a number from 0 to {len(here) - 1}')
    return int(part)


def _build(table: CaseTable, path: Path, text: str) -> Case:
    """Return the record, after what only the whole case can tell."""
    start, end = table.begin(), table.finish()
    folder, wrong = path.absolute().parent, Mistakes()
    known = tuple(
        _sources(quantity, tables, start, folder, wrong)
        for quantity, tables in zip(QUANTITIES, (table.current, table.wind, table.stokes), strict=True)
    )
    spill: Spill | None = None
    scenarios: tuple[Scenario, ...] = ()
    with wrong.gathered():
        if table.spill:
            spill = build.spill(table, start, end, folder)
            scenarios = build.classes(spill, start, end, known)
        else:
            scenarios = build.scenarios(table.scenario, start, end, known)
    run = Run(start, end, scenarios, folder)
    sorties, contacts, fleet, plan = _search(table, run, wrong)
    more = [find.time for find in spill.finds if find.at_sea] if spill else plan_table.times(sorties, contacts)
    outputs = np.empty(0, "datetime64[s]")
    with wrong.gathered():
        outputs = _outputs(table.output, start, end, more)
    current_error, wind_error = uncertainty.CURRENT, uncertainty.WIND
    with wrong.gathered():
        if scenarios:  # those at fault say nothing of what they drift in
            current_error, wind_error = _errors(table, known, scenarios, contacts)
        spill = replace(spill, current_bias=current_error.bias) if spill else None
    if table.depth is None and any(unit.draught > 0 for unit in fleet):
        wrong.lines.append(
            'draught: without depths it says nothing; give [depth] file = "depths.nc", or leave draught out'
        )
    depths = None
    with wrong.gathered():
        if table.depth:
            file = sources.one_file(table.depth.file, folder, "depth.file")
            depths = Depth(file, table.depth.variable, table.depth.positive)
    shore, lakes = table.coast.source, table.coast.lakes
    with wrong.gathered():
        shore = _shore(shore, folder)
    with wrong.gathered():
        lakes = sources.one_file(lakes, folder, "coast.lakes") if isinstance(lakes, str) else lakes
    made = ", ".join(f"{one:g}" for one in table.output.areas)
    wrong.lines += [
        f"expect: no {percent:g} % area is made, only {made} %; add {percent:g} to output.areas"
        for percent in table.expect.by_percent()
        if percent not in table.output.areas
    ]
    wrong.refuse()
    assert plan is not None
    currents, winds, stokes = known
    diffusivity = table.uncertainty.diffusivity
    return Case(
        title=table.title or path.stem,
        path=path,
        text=text,
        start=start,
        end=end,
        direction=-1 if table.direction == "backward" else 1,
        particles=spill.particles if spill else table.particles,
        seed=table.seed,
        max_lost=table.max_lost,
        outputs=outputs,
        trajectories=table.output.trajectories,
        areas=table.output.fractions(),
        grid=table.output.grid.cells() if table.output.grid else None,
        step=table.clock.step,
        scheme=table.clock.scheme,
        tolerance=table.clock.tolerance,
        domain=table.domain.box() if table.domain else None,
        coast=Coast(shore, table.coast.behaviour, table.coast.half_life or 0.0, table.coast.offing, lakes),
        currents=currents,
        winds=winds,
        stokes=stokes,
        current_error=current_error,
        wind_error=wind_error,
        diffusivity=uncertainty.DIFFUSIVITY if diffusivity is None else diffusivity,
        diffusivity_by=DEFAULT if diffusivity is None else CASE,
        scenarios=scenarios,
        spill=spill,
        sorties=sorties,
        contacts=contacts,
        units=fleet,
        plan=plan,
        resampling=table.resampling.resampling(),
        expect=table.expect,
        depth=depths,
    )


def _errors(
    table: CaseTable,
    known: tuple[tuple[ForcingSpec, ...], ...],
    scenarios: tuple[Scenario, ...],
    contacts: tuple[Contact, ...],
) -> tuple[ForcingError, ForcingError]:
    """Return the errors of current and wind: as the case says, else by default where they come from gridded files."""
    currents, winds, _ = known
    said = table.uncertainty
    drifters = [s.object for s in scenarios] + [c.drifter for c in contacts if c.drifter is not None]
    reason = uncertainty.silent(currents, [s.currents for s in scenarios])
    current = uncertainty.error(said.current, uncertainty.CURRENT, reason, "current")
    if table.spill:
        current = uncertainty.in_spill(current, said.current, table.spill.current_bias)
    reason = uncertainty.silent(winds, [s.winds for s in scenarios])
    if not any(drifter.uses_wind for drifter in drifters):
        reason = UNFELT
    return current, uncertainty.error(said.wind, uncertainty.WIND, reason, "wind")


def _search(
    table: CaseTable, run: Run, wrong: Mistakes
) -> tuple[tuple[Sortie, ...], tuple[Contact, ...], tuple[Unit, ...], PlanSpec | None]:
    """Return what was searched, seen, and can be sent; what is wrong with it is added to the mistakes.

    Where the scenarios are at fault nothing is looked at: they say what is searched for, and how well it is seen.
    """
    sorties: tuple[Sortie, ...] = ()
    contacts: tuple[Contact, ...] = ()
    fleet: tuple[Unit, ...] = ()
    plan = None
    if not run.scenarios:
        return sorties, contacts, fleet, plan
    before = len(wrong.lines)
    with wrong.gathered():
        sorties = sortie_table.build(table.sortie, run)
    with wrong.gathered():
        contacts = contact_table.build(table.contact, run)
    with wrong.gathered():
        plan = table.plan.spec(run, sorties, contacts, asked=bool(table.unit) or "plan" in table.model_fields_set)
    # Units that fit no plan of the case may fit the longest that there can be.
    longest = PlanSpec(run.start, run.end, "pos", 0.0, 1, plan_table.LEAST)
    with wrong.gathered():
        fleet = plan_table.build(table.unit, run, plan or longest)
    if len(wrong.lines) == before:
        with wrong.gathered():
            plan_table.check_groups(sorties, fleet)
    return sorties, contacts, fleet, plan


def _outputs(
    table: OutputTable, start: np.datetime64, end: np.datetime64, more: list[np.datetime64]
) -> NDArray[np.datetime64]:
    sign = 1 if end > start else -1
    if table.times is not None:
        times = [units.resolve(time, start) for time in table.times]
        for time in times:
            if not min(start, end) <= time <= max(start, end):
                raise UserError(
                    f"output.times: {notation.group(time)} is outside the run, {notation.group(start)} to {notation.group(end)}"
                )
    else:
        span = abs((end - start).astype(int))
        every = max(round(table.every or 21_600.0), 1)
        if span // every > MOST_OUTPUTS:
            raise UserError(f"output.every gives {span // every:,} output times; at most {MOST_OUTPUTS}")
        times = [start + np.timedelta64(sign * k * every, "s") for k in range(span // every + 1)]
    every_time = np.unique(np.array([start, *times, *more, end], dtype="datetime64[s]"))
    return every_time[::sign]


def _shore(source: str, folder: Path) -> str:
    if source in {"gshhg", "none"}:
        return source
    return sources.one_file(source, folder, "coast.source", '; allowed are "gshhg", "none" and a shoreline file')


def _sources(
    quantity: Quantity, tables: list[SourceTable], start: np.datetime64, folder: Path, wrong: Mistakes
) -> tuple[ForcingSpec, ...]:
    """Return the sources of a quantity; one that is at fault is added to the mistakes, and stands in by its name."""
    specs: list[ForcingSpec] = []
    for number, table in enumerate(tables, 1):
        place = sources.place(quantity, number, table.name)
        spec = ForcingSpec(table.name or f"{quantity} {number}", quantity)
        with wrong.gathered(place):
            spec = table.spec(quantity, number, start, folder)
        if spec.name in {other.name for other in specs}:
            wrong.lines.append(f"{place}: two sources have this name; give each its own")
        specs.append(spec)
    if specs and all(spec.add for spec in specs):
        wrong.lines.append(
            f'{quantity} "{specs[0].name}": add = true, and there is no [[{quantity}]] to add it to: leave add out of the '
            "source that the others are added to"
        )
    return tuple(specs)
