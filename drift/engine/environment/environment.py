"""The environment of a run: winds and currents of its domain and the coast, opened and checked
once.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from drift.engine.environment import coastline, domain
from drift.engine.environment.environment_spec import EnvironmentSpec
from drift.engine.environment.forcing_spec import ForcingSpec
from drift.engine.environment.forcing_spec import options as source_options
from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.forcing import Sources
from drift.engine.motion.models import by_name as models
from drift.engine.motion.period import Period
from drift.engine.motion.scenario import Scenario
from geo import notation
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast.shore import Shore
from geo.errors import UserError
from geo.files import dataset
from geo.forcing import sources
from geo.forcing.quantity import QUANTITIES, required_quantities
from geo.forcing.reading import memory, stream
from geo.forcing.reading.kept import SliceCache
from geo.forcing.sources import Source

# What is read of a source ends on a lattice, whose lines are at most this share of the box's width
# or height apart.
FINEST_SHARE = 1 / 8
FAR = np.timedelta64(
    12, "h"
)  # between rows of a table, from which a note is given: weather changes faster
COARSEST = 4.0  # [deg] the lattice's widest spacing


@dataclass(frozen=True)
class Environment:
    """The forcing of each scenario, the coast (None without one), and the domain of the run.

    scenarios: what moves the objects of each. water: the same with the Stokes drift also where the
    leeway lines of its object include it: what moves the water, and a buoy in it.
    """

    box: Box
    scenarios: tuple[Sources, ...]
    water: tuple[Sources, ...]
    sources: tuple[Source, ...]
    coast: shoreline.Coast | None
    notes: tuple[str, ...]
    members: tuple[str, ...] = ()  # names of the forcing ensemble's members; empty: no ensemble


class Common(Protocol):
    """Sources and coasts shared by several runs: see drift.pipeline.shared_forcing.SharedRegion."""

    def source(self, spec: ForcingSpec, box: Box) -> Source:
        """Return the part of a source that `open_source` gives for a box, of files or a dataset in
        memory.

        See geo.forcing.sources.
        """

    def coast(
        self, spec: EnsembleSpec, asked: EnvironmentSpec, box: Box
    ) -> tuple[Shore, shoreline.Coast | None]:
        """Return the land and coast of a box, shared where that changes nothing."""


def open_for(
    spec: EnsembleSpec,
    asked: EnvironmentSpec,
    held: Mapping[str, memory.NamedDataset],
    seen: Callable[[Shore], Shore] | None = None,
    common: Common | None = None,
) -> Environment:
    """Return the environment of a run.

    Args:
        spec: of the ensemble.
        asked: the forcing, coast and domain of the case.
        held: datasets in memory, by name.
        seen: selects the detail of the land that is needed; None: all of it.
        common: sources and coasts shared with other runs.

    Raises:
        UserError: if a file can't be read, if sources leave part of the run without forcing, or if
            a reported position lies on land.
    """
    box = domain.bounds(spec, asked)
    about = domain.middle(spec) if domain.is_polar(box) else None
    opened: dict[tuple[str, str], Source] = {}
    wrong: list[str] = []
    for source in asked.sources:
        try:
            opened[source.quantity, source.name] = _open(
                source, box, spec.period, held, common, about
            )
        except UserError as error:
            wrong += error.lines
    if wrong:
        raise UserError(*wrong)
    finished = SliceCache(first=True)  # the step is chosen with the forcing that the run then uses
    opened = {
        key: source
        if source.shelf
        else source.with_cache((*key, source.fingerprint, source.grid), finished)
        for key, source in opened.items()
    }
    cells = {(source.quantity, source.name): source.fill for source in asked.sources}
    added = frozenset((source.quantity, source.name) for source in asked.sources if source.add)
    opened = {key: _with_notes(source, added) for key, source in opened.items()}
    water, scenarios = [], []
    for scenario in spec.scenarios:
        by_quantity = {
            quantity: tuple(opened[quantity, name] for name in names)
            for quantity, names in _names(spec, scenario).items()
        }
        water.append(Sources(by_quantity, cells, added))
        if scenario.object.stokes == "inside":
            by_quantity = {**by_quantity, "stokes": ()}
        scenarios.append(Sources(by_quantity, cells, added))
    without: dict[str, list[str]] = {}  # scenarios by message
    for scenario, named in zip(spec.scenarios, scenarios, strict=True):
        if not (spec.debris or models.forced([scenario])):
            continue  # its particles are not lost without forcing
        place = f'{spec.story} "{scenario.name}"'
        for quantity in required_quantities():
            for k, term in enumerate(named.terms(quantity)):
                for complaint in _coverage_errors(
                    spec.period, asked.max_lost, quantity, term, added=k > 0
                ):
                    without.setdefault(complaint, []).append(place)
    for complaint, (first, *others) in without.items():
        wrong.append(f"{first}{f' and {len(others)} more' if others else ''}: {complaint}")
    shown = tuple(opened.values())
    base = tuple(source for source in shown if (source.quantity, source.name) not in added)
    coastal = coastline.coast_box(spec, box, base)
    try:
        shared = common.coast(spec, asked, coastal) if common else None
        land, coast = coastline.open_coast(spec, asked.coast, coastal, seen, shared)
    except UserError as error:
        raise UserError(*wrong, *error.lines) from None
    if wrong:
        raise UserError(*wrong)
    if coast is None and spec.release:
        raise UserError(
            f"[spill]: there is no coast in its domain, {box.west:.2f}..{box.east:.2f} E, {box.south:.2f}.."
            f"{box.north:.2f} N ({land.source}): nothing can come ashore; widen [domain], or check [coast] source"
        )
    used = {
        (source.quantity, source.name): source
        for named in scenarios
        for quantity in QUANTITIES
        for source in named.of(quantity)
    }
    return Environment(
        box,
        tuple(scenarios),
        tuple(water),
        shown,
        coast,
        land.notes,
        _members(list(used.values())),
    )


def warnings(where: Environment) -> list[str]:
    """Return warnings about the sources of a run."""
    return [
        f'{source.quantity} "{source.name}": {note.removeprefix(sources.WARNING_PREFIX)}'
        for source in where.sources
        for note in source.notes
        if note.startswith(sources.WARNING_PREFIX)
    ]


def share_slices(where: Environment, folder: Path | None) -> None:
    """Share the regridded slices of an environment's forcing between processes through a folder;
    None: stop.
    """
    for source in where.sources:
        if source.shelf:
            source.shelf.finished.store(folder)


def _members(used: Sequence[Source]) -> tuple[str, ...]:
    """Return the names of the forcing ensemble's members; empty without an ensemble.

    Raises UserError where two sources do not have the same number of members.
    """
    ensembles = [source for source in used if source.others]
    if len({len(source.members) for source in ensembles}) > 1:
        told = ", ".join(f'{len(s.members)} of {s.quantity} "{s.name}"' for s in ensembles)
        raise UserError(
            f"the ensembles of a run must have the same number of members, because a particle drifts in the same member of "
            f"each; given {told}: name the same number of each, or choose one member of a source by variables"
        )
    together = zip(
        *([member.label for member in source.members] for source in ensembles), strict=True
    )
    return tuple(" + ".join(dict.fromkeys(labels)) for labels in together)


def box_to_read(box: Box) -> Box:
    """Return the box to read from a source: the one asked for, extended to a lattice.

    The lines of the lattice are at most an eighth of the box apart. Runs that begin near each other
    thus read the same part of a source on the same grid, so that many forecasts prepare it only
    once.
    """

    def outward(low: float, high: float) -> tuple[float, float]:
        step = min(2.0 ** math.floor(math.log2((high - low) * FINEST_SHARE)), COARSEST)
        return math.floor(low / step) * step, math.ceil(high / step) * step

    (west, east), (south, north) = outward(box.west, box.east), outward(box.south, box.north)
    if east - west >= 360:
        west, east = -180.0, 180.0
    return Box(west, max(south, -90.0), east, min(north, 90.0))


def _names(spec: EnsembleSpec, scenario: Scenario) -> dict[str, tuple[str, ...]]:
    """Return the names of a scenario's sources, by quantity, without winds if nothing uses them."""
    blown = scenario.uses_wind or any(drifter.uses_wind for drifter in spec.debris)
    return {
        quantity: names if blown or not QUANTITIES[quantity].in_air else ()
        for quantity, names in scenario.sources.items()
    }


def hold(
    asked: EnvironmentSpec, datasets: Mapping[str, Any] | None, place: str
) -> dict[str, memory.NamedDataset]:
    """Return the datasets in memory by name.

    Args:
        asked: the sources of the case.
        datasets: given to the run, by name.
        place: name of the case's file in messages.

    Raises:
        UserError: if a dataset is named but not given, or given but not named.
    """
    given = memory.wrap_datasets(datasets)
    every = [part for spec in asked.sources for part in spec.parts]
    named = {spec.dataset: spec for spec in every if spec.dataset is not None}
    for name, spec in named.items():
        if name not in given:
            raise UserError(
                f'{place}: {spec.quantity} "{spec.name}": dataset = "{name}" is an xarray.Dataset in memory, which '
                f'only Python can give: drift.run(case, datasets={{"{name}": ...}}); from the command line name files'
            )
    for name in given:
        if name not in named:
            names = ", ".join(f'"{other}"' for other in named) or "none"
            raise UserError(
                f'datasets: "{name}" is given, and no source of {place} has dataset = "{name}"; named: {names}'
            )
    return given


def _open(
    spec: ForcingSpec,
    box: Box,
    period: Period,
    held: Mapping[str, memory.NamedDataset],
    common: Common | None,
    about: tuple[float, float] | None,
) -> Source:
    """Return one source, cropped to the box; about: see geo.forcing.sources.uniform_field."""
    if spec.each:
        own = [_open(part, box, period, held, common, about) for part in spec.parts]
        called = _member_labels(spec)
        joined = sources.combine_members(
            [replace(source, label=label) for source, label in zip(own, called, strict=True)]
        )
        return replace(joined, name=spec.name)
    if spec.constant is not None:
        return sources.constant_field(spec.quantity, *spec.constant, name=spec.name, about=about)
    if spec.table is not None:
        table = spec.table
        rows = sources.uniform_field(
            spec.quantity,
            np.array(table.times),
            table.east,
            table.north,
            name=spec.name,
            about=about,
        )
        return replace(rows, gapless=True, notes=rows.notes + _note_sparse_rows(rows))
    if spec.analytic is not None:
        first, last = period.span
        flow = sources.analytic(spec.quantity, spec.analytic, box, first, last, **spec.parameters)
        return replace(flow, name=spec.name)
    try:
        if common:
            found = common.source(spec, box_to_read(box))
        else:
            found = sources.open_source(
                spec.quantity,
                list(spec.files) if spec.dataset is None else held[spec.dataset],
                box=box_to_read(box),
                name=spec.name,
                **source_options(spec),
            )
        return found.without_blank_slices(*period.span)
    except UserError as error:
        reason = str(error)
        if spec.dataset is not None:
            reason = reason.replace(f"[[{spec.quantity}]] files", f"[[{spec.quantity}]] dataset")
        raise UserError(f'{spec.quantity} "{spec.name}": {reason}') from None


def _note_sparse_rows(rows: Source) -> tuple[str, ...]:
    """Return a note if rows of a table are FAR or more apart: the weather in between is unknown."""
    longest = np.diff(rows.times).max()
    if longest < FAR:
        return ()
    hours = notation.number(float(longest / np.timedelta64(1, "h")))
    return (
        f"rows up to {hours} h apart, interpolated linearly: add rows where the change was not linear",
    )


def _member_labels(spec: ForcingSpec) -> list[str]:
    """Return the names of members that are separate sources: their own parameters, or numbers if
    long.
    """
    called = []
    for number, part in enumerate(spec.parts, 1):
        if part.constant is not None:
            called.append(sources.format_vector(spec.quantity, *part.constant))
        elif part.analytic is not None:
            called.append(
                ", ".join(f"{k} = {v:g}" for k, v in part.parameters.items() if _differs(spec, k))
                or str(number)
            )
        else:
            called.append(dataset.title(part.files) or part.dataset or str(number))
    return (
        called
        if len(set(called)) == len(called)
        else [str(number) for number in range(1, len(called) + 1)]
    )


def _differs(spec: ForcingSpec, key: str) -> bool:
    return len({part.parameters.get(key) for part in spec.parts}) > 1


def _with_notes(source: Source, added: frozenset[tuple[str, str]]) -> Source:
    """Return a source with notes on where and when it has values as a term of a sum.

    Where or when one term of a sum has no value, the sum has none.
    """
    if all(quantity != source.quantity for quantity, _ in added):
        return source
    notes, box = list(source.notes), source.grid.box
    if (source.quantity, source.name) in added:
        notes.append(
            f"added to the other sources of [[{source.quantity}]]: where it has no value, the sum has none"
        )
    if source.grid is not sources.EVERYWHERE:
        notes.append(
            f"within {box.west:.2f} to {box.east:.2f} E, {box.south:.2f} to {box.north:.2f} N"
        )
    if source.times.size:
        notes.append(
            f"from {notation.format_dtg(source.times[0])} to {notation.format_dtg(source.times[-1])}"
        )
    notes += [
        f"no values between {notation.format_dtg(a)} and {notation.format_dtg(b)}"
        for a, b in stream.data_gaps(source)
    ]
    return replace(source, notes=tuple(notes))


def _coverage_errors(
    period: Period, max_lost: float, quantity: str, sources: tuple[Source, ...], *, added: bool
) -> list[str]:
    """Return an error if a quantity has no source for more of a run than may be lost, otherwise [].

    sources: one term of the quantity's sum.
    """
    if any(not source.times.size for source in sources):
        return []
    first, last = period.span
    spans = sorted(span for source in sources for span in stream.data_spans(source))
    without, reached = [], first
    for begin, end in (*spans, (last, last)):
        if begin > reached:
            without.append((reached, min(begin, last)))
        reached = min(max(reached, end), last)
    without = [hole for hole in without if hole[1] > hole[0]]
    if not without or (max_lost == 1 and without != [(first, last)]):
        return []
    share = 1 - float(
        sum((end - begin for begin, end in without), np.timedelta64(0, "s")) / (last - first)
    )
    names = ", ".join(f'"{source.name}"' for source in sources)
    whole = f"{notation.format_dtg(min(s[0] for s in spans))} to {notation.format_dtg(max(s[1] for s in spans))}"
    gaps = sorted(hole for source in sources for hole in stream.data_gaps(source))
    inside = any(
        begin < hole_end and hole_begin < end
        for begin, end in without
        for hole_begin, hole_end in gaps
    )
    holds = (
        f" with gaps of more than {stream.LONGEST_GAP} times its usual interval, which are not interpolated over"
        * inside
    )
    lacking = " and ".join(
        f"from {notation.format_dtg(begin)} to {notation.format_dtg(end)}"
        for begin, end in without[:3]
    )
    more = f" and {len(without) - 3} times more" if len(without) > 3 else ""
    return [
        f"{quantity} {names} lasts from {whole}{holds}, the run from "
        f"{notation.format_dtg(first)} to {notation.format_dtg(last)}: no data {lacking}{more} ({math.floor(100 * share)}% of the run "
        "is covered), and particles adrift then are lost. Change "
        + (
            f"start, duration or end, or leave {names} out: it has add = true, so the sum needs it"
            if added
            else f"start, duration or end, or add another [[{quantity}]], or rows to its table"
        )
    ]
