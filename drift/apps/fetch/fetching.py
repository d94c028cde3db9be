"""`drift.fetch`: download winds and currents for a case, or for a box and a span, into files."""

import json
import os
import shutil
import uuid
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from drift.apps.fetch import catalogue, grib_filter, opendap, parts, toolbox
from drift.apps.fetch.catalogue import Provider
from drift.apps.fetch.order import Order, Shipment
from drift.apps.fetch.parts import Report, retry
from drift.case import file as case_file
from drift.case.record import Case
from drift.case.values import units
from drift.engine.environment import domain
from drift.pipeline import run_setup
from drift.products.files import publication
from geo.box import Box, box_between
from geo.errors import UserError
from geo.files import address
from geo.forcing import level, sources
from geo.forcing.quantity import QUANTITIES

SHIP: dict[str, Callable[[Order], Shipment]] = {
    "opendap": opendap.ship,
    "erddap": opendap.ship,
    "grib_filter": grib_filter.ship,
    "copernicusmarine": toolbox.ship,
}
LARGEST = 200e6  # [bytes] above which a fetch needs confirmation
TABLES = "forcing.toml"
USUAL = ("current", "wind")
NO_FORCING = (
    '[{ constant = { speed = "0 kn", toward = 0 } }]'  # replaces forcing that is not there yet
)
# changes of a case whose forcing may still be missing
NO_SOURCES = {name: NO_FORCING if name in USUAL else "[]" for name in QUANTITIES}


@dataclass(frozen=True)
class Fetched:
    """Result of a fetch: the files, and the TOML tables of a case that read them."""

    files: tuple[Path, ...]
    tables: str


def _area_and_span_of_case(
    case: str | os.PathLike[str] | Case, overrides: Mapping[str, str] | None = None
) -> tuple[Box, np.datetime64, np.datetime64]:
    """Return the domain and the span of a case, whose winds and currents may still be missing.

    overrides: as for `drift.case.file.load`, for a case that is given by its file.
    """
    if not isinstance(case, Case):
        case = case_file.load(case, {**(overrides or {}), **NO_SOURCES})
    return area_and_span(case)


def area_and_span(case: Case) -> tuple[Box, np.datetime64, np.datetime64]:
    """Return the domain of a case, and its first and last time [s] UTC."""
    box = domain.bounds(run_setup.ensemble_spec(case), run_setup.environment_spec(case))
    return box, min(case.start, case.end), max(case.start, case.end)


def parse_box(text: str) -> Box:
    """Return the box of a text "west,south,east,north" [deg].

    East may be above 180, or less than west.
    """
    try:
        west, south, east, north = (float(word) for word in text.split(","))
    except ValueError:
        raise UserError(
            f'--box "{text}" must be west,south,east,north in degrees, like 4,59,7,61'
        ) from None
    if not (
        -90 <= south < north <= 90 and -360 <= west <= 540 and -360 <= east <= 540 and west != east
    ):
        raise UserError(
            f'--box "{text}": south must be less than north, both in -90 to 90, longitudes in -360 to 540'
        )
    try:
        return box_between(west, south, east, north)
    except ValueError as error:
        raise UserError(f'--box "{text}": {error}') from None


def orders(
    box: Box,
    begin: np.datetime64,
    end: np.datetime64,
    *,
    providers: Sequence[str] = (),
    quantities: Sequence[str] = (),
    own: Path | None = None,
    timeout: float = address.TIMEOUT,
) -> list[Order]:
    """Return an order for each quantity.

    Args:
        box: area to fetch.
        begin, end: span to fetch [s] UTC.
        providers: names of providers; () chooses them.
        quantities: quantities to fetch; (): those of the named providers, else current and wind.
        own: catalogue file of the user; None: that of the user's configuration.
        timeout: longest wait for a server's answer [s].
    """
    if begin >= end:
        raise UserError(
            f"the span ends ({end}Z) before it begins ({begin}Z): change --from and --to"
        )
    providers_by_name = catalogue.read_providers(own)
    named = [providers_by_name[name].quantity for name in providers if name in providers_by_name]
    wanted = list(dict.fromkeys(quantities or named or USUAL))
    asked_at = now()
    chosen = catalogue.choose(providers_by_name, wanted, providers, box, begin, end, asked_at)
    return [Order(provider, box, begin, end, timeout, asked_at) for provider in chosen]


def now() -> np.datetime64:
    """Return the current time [s] UTC."""
    return np.datetime64("now", "s")


def request_shipments(ordered: Sequence[Order], tell: Callable[[str], None]) -> list[Shipment]:
    """Return the shipment of each order, after asking the providers for their datasets' shapes."""
    return [retry(partial(SHIP[order.provider.protocol], order), tell) for order in ordered]


def downloaded_parts(out: Path, shipments: Sequence[Shipment]) -> dict[str, str]:
    """Return the parts that an interrupted fetch has left, as digests by key."""
    folder = parts.parts_folder(out, [shipment.order for shipment in shipments])
    if not folder.is_dir():
        return {}
    with parts.locked_parts(folder) as digests:
        return digests


def fetch_and_publish(
    out: Path,
    shipments: Sequence[Shipment],
    *,
    overwrite: bool = False,
    report: Report = lambda what, share: None,
    tell: Callable[[str], None] = lambda line: None,
) -> Fetched:
    """Fetch the missing parts, then publish all files at once or none."""
    names = [name for shipment in shipments for name in _names(shipment)]
    publication.check(out, overwrite, [*names, TABLES])
    folder = parts.parts_folder(out, [shipment.order for shipment in shipments])
    with parts.locked_parts(folder) as digests:
        parts.fetch(folder, shipments, digests, report, tell)
        tables = _tables(out, shipments)
        for shipment in shipments:
            _check_readable(shipment, [parts.path(folder, part.key) for part in shipment.parts])
        with publication.staged(out) as stage:
            for shipment in shipments:
                for name, part in zip(_names(shipment), shipment.parts, strict=True):
                    _link_or_copy(parts.path(folder, part.key), stage.new / name)
            (stage.new / TABLES).write_text(tables, encoding="utf-8")
            files = publication.publish(stage, str(uuid.uuid4()), overwrite)
        shutil.rmtree(folder, ignore_errors=True)
    return Fetched(tuple(files), tables)


def _check_readable(shipment: Shipment, files: list[Path]) -> None:
    """Raise UserError unless the files can be read as the quantity that was ordered."""
    order = shipment.order
    try:
        sources.open_source(
            order.provider.quantity,
            [str(f) for f in files],
            variables=_variables(shipment),
            depth=_depth(order.provider),
            lenient=True,
            times=_times(order.provider),
        )
    except UserError as error:
        raise UserError(
            f"{order.provider.name} was downloaded completely, but cannot be read as "
            f"{order.provider.quantity}: {error}"
        ) from None


def _variables(shipment: Shipment) -> dict[str, str] | None:
    """Return the component names for the case's table; None if the files use eccodes' names."""
    provider = shipment.order.provider
    if provider.protocol == "grib_filter":  # eccodes' own names
        return None
    return dict(zip(("east", "north"), provider.variables, strict=True))


def _depth(provider: Provider) -> float | None:
    """Return the depth [m] that the case must name, if the layer is too deep for the surface."""
    deep = (
        provider.quantity != "wind"
        and provider.level is not None
        and abs(provider.level) > level.DEEPEST
    )
    return abs(provider.level) if deep and provider.level is not None else None


def _times(provider: Provider) -> dict[str, str] | None:
    """Return the `times` key of a case for time means whose files do not state it; else None."""
    return {"stamp": provider.stamp} if provider.stamp in ("start", "middle", "end") else None


def _link_or_copy(part: Path, new: Path) -> None:
    """Link or copy a part to where it is published; it stays among the parts until all is done."""
    try:
        os.link(part, new)
    except OSError:
        shutil.copyfile(part, new)


def _names(shipment: Shipment) -> list[str]:
    provider = shipment.order.provider
    return [
        f"{provider.quantity}-{provider.name}-{number:04d}.nc"
        for number in range(1, len(shipment.parts) + 1)
    ]


def _tables(out: Path, shipments: Sequence[Shipment]) -> str:
    """Return the TOML tables of a case that read the files of a folder."""
    lines = []
    for shipment in shipments:
        provider = shipment.order.provider
        pattern = (out.absolute() / f"{provider.quantity}-{provider.name}-*.nc").as_posix()
        lines += [
            f"# {provider.title}; {provider.license or 'its licence is not known'}",
            f"[[{provider.quantity}]]",
        ]
        lines += [f"name = {_toml_string(provider.name)}", f"files = {_toml_string(pattern)}"]
        if names := _variables(shipment):
            east, north = (_toml_string(names[side]) for side in ("east", "north"))
            lines += [f"variables = {{ east = {east}, north = {north} }}"]
        if (depth := _depth(provider)) is not None:
            lines += [f'depth = "{depth:g} m"']
        if times := _times(provider):
            lines += [f"times = {{ stamp = {_toml_string(times['stamp'])} }}"]
        lines += [""]
    return "\n".join(lines)


def _toml_string(words: str) -> str:
    return json.dumps(words, ensure_ascii=False)


def fetch(
    case: str | os.PathLike[str] | Case | None = None,
    *,
    box: tuple[float, float, float, float] | None = None,
    begin: np.datetime64 | str | None = None,
    end: np.datetime64 | str | None = None,
    providers: Sequence[str] = (),
    quantities: Sequence[str] = (),
    out: str | os.PathLike[str],
    catalogue: str | os.PathLike[str] | None = None,
    largest: float = LARGEST,
    timeout: float = address.TIMEOUT,
    overwrite: bool = False,
    report: Report | None = None,
) -> Fetched:
    """Fetch winds and currents for a case, or a box and a span, into a folder.

    An interrupted fetch continues when it is called again.

    Args:
        case: a file, a shipped case's name or a `Case`, whose area and times are fetched; None with
            `box`, `begin` and `end`.
        box: west, south, east, north [degrees].
        begin, end: in place of the case's times; UTC, np.datetime64 or text such as "221200ZNOV26".
        providers: names of the catalogue; (): for each quantity the first that needs no
            credentials.
        quantities: "current", "wind", "stokes"; (): current and wind.
        out: the folder of the files.
        catalogue: a file of providers of your own; None: that of the user's configuration, if
            there is one.
        largest: size above which an order is rejected [bytes].
        timeout: longest wait for a server's answer [s].
        overwrite: whether files of an earlier order in `out` are replaced.
        report: called with the phase (the name of a provider, then "done") and the share of it that
            is done, 0 to 1; `drift.progress` makes one. An exception that it raises ends the fetch.

    Returns:
        The files, and the tables of a case that name them.

    Raises:
        UserError: the order is too large, no provider has it, a server does not answer, or `out`
            contains another order.
    """
    area, first, last = ordered_span(case, box, begin, end)
    ordered = orders(
        area,
        first,
        last,
        providers=providers,
        quantities=quantities,
        own=Path(catalogue) if catalogue is not None else None,
        timeout=timeout,
    )
    shipments = request_shipments(ordered, lambda line: None)
    size = sum(shipment.size for shipment in shipments)
    if size > largest:
        raise UserError(
            f"this is about {parts.size_in_words(size)}, more than the {parts.size_in_words(largest)} that `largest` allows"
        )
    return fetch_and_publish(
        Path(out), shipments, overwrite=overwrite, report=report or (lambda what, share: None)
    )


def ordered_span(
    case: str | os.PathLike[str] | Case | None,
    box: tuple[float, float, float, float] | str | None,
    begin: np.datetime64 | str | None,
    end: np.datetime64 | str | None,
    overrides: Mapping[str, str] | None = None,
) -> tuple[Box, np.datetime64, np.datetime64]:
    """Return the box and the span to fetch; what is not given comes from the case."""
    complete = box is not None and all(map(_is_absolute, (begin, end)))
    if case is None and (box is None or begin is None or end is None):
        raise UserError("give a case, or all of --box, --from and --to")
    # With box and times given, the case may be incomplete: it only gives the folder its name.
    area, first, last = (
        _area_and_span_of_case(case, overrides)
        if case is not None and not complete
        else (None, None, None)
    )
    if box is not None:
        area = parse_box(box if isinstance(box, str) else ",".join(str(edge) for edge in box))
    assert area is not None
    return area, _parse_moment(begin, first, "--from"), _parse_moment(end, last, "--to")


def _is_absolute(stated: np.datetime64 | str | None) -> bool:
    """Return True for a time that is absolute, not relative to a case's start."""
    try:
        return stated is not None and not (
            isinstance(stated, str) and isinstance(units.time(stated), np.timedelta64)
        )
    except ValueError:
        return True


def _parse_moment(
    stated: np.datetime64 | str | None, own: np.datetime64 | None, name: str
) -> np.datetime64:
    if stated is None:
        assert own is not None
        return own
    if isinstance(stated, np.datetime64):
        instant: np.datetime64 = stated.astype("datetime64[s]")
        return instant
    try:
        moment = units.time(stated)
    except ValueError as error:
        raise UserError(f"{name}: {error}") from None
    if isinstance(moment, np.timedelta64):
        if own is None:
            raise UserError(
                f'{name} "{stated}" is relative to the start of a case: give a case, or a date '
                "and time"
            )
        return units.resolve(moment, own)
    return moment
