"""The command `drift fetch`: its grammar, and what it does."""

import argparse
import sys
from pathlib import Path
from typing import Any

from drift.apps.cli import given as take
from drift.apps.cli import terminal
from drift.apps.cli.answer import Answer
from geo.errors import UserError
from geo.forcing.quantity import QUANTITIES

SUFFIX = "forcing"


def add(commands: Any) -> argparse.ArgumentParser:
    """Add the command to the grammar, and return it."""
    fetch: argparse.ArgumentParser = commands.add_parser(
        "fetch", help="fetch winds and currents for a case, or a box and a span, from providers"
    )
    fetch.add_argument(
        "case", metavar="CASE", nargs="?", help="case file, or a shipped case's name"
    )
    fetch.add_argument(
        "--box", metavar="W,S,E,N", help="west,south,east,north [deg] in place of the case's domain"
    )
    fetch.add_argument("--from", dest="begin", metavar="TIME", help="in place of the case's start")
    fetch.add_argument("--to", dest="end", metavar="TIME", help="in place of the case's end")
    fetch.add_argument(
        "--provider",
        action="append",
        default=[],
        dest="providers",
        metavar="NAME",
        help="one for each quantity; see --list",
    )
    fetch.add_argument(
        "--quantity",
        action="append",
        default=[],
        dest="quantities",
        choices=tuple(QUANTITIES),
        help="may be repeated (default: current and wind, or those of the providers)",
    )
    fetch.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for the files (default: NAME-forcing)"
    )
    fetch.add_argument(
        "--catalogue", type=Path, metavar="FILE", help="providers of your own (docs/fetch.md)"
    )
    fetch.add_argument(
        "--timeout",
        type=float,
        default=60.0,
        metavar="S",
        help="a server's longest silence (default: 60 s)",
    )
    fetch.add_argument(
        "--list", action="store_true", dest="listed", help="list the providers and end"
    )
    fetch.add_argument("--dry-run", action="store_true", help="ask how much it is and end")
    fetch.add_argument("--yes", action="store_true", help="fetch large amounts without asking")
    fetch.add_argument(
        "--overwrite", action="store_true", help="replace files that an earlier fetch wrote there"
    )
    fetch.add_argument(
        "--set",
        action="append",
        default=[],
        dest="changes",
        metavar="KEY=VALUE",
        help="change a key of the case",
    )
    return fetch


def run(given: argparse.Namespace) -> Answer:
    """Fetch what a case needs, and return what it takes to read it."""
    if given.listed:
        return _list(given.catalogue)
    from drift.apps.cli import progress
    from drift.apps.fetch import fetching, parts

    if not 0 < given.timeout < 1e6:
        raise UserError(f"--timeout {given.timeout:g} must be a number of seconds above 0")
    where = fetching.ordered_span(
        given.case, given.box, given.begin, given.end, take.changed(given.changes)
    )
    out = given.out or Path(f"{Path(given.case).stem}-{SUFFIX}" if given.case else SUFFIX)
    ordered = fetching.orders(
        *where,
        providers=given.providers,
        quantities=given.quantities,
        own=given.catalogue,
        timeout=given.timeout,
    )
    shipments = fetching.ship(ordered, _tell)
    there = fetching.there(out, shipments)
    left = parts.missing(shipments, there)
    box, begin, end = where
    facts = {
        "box": f"{box.west:.2f} to {box.east:.2f} E, {box.south:.2f} to {box.north:.2f} N",
        "span": f"{begin}Z to {end}Z",
    }
    for shipment in shipments:
        provider = shipment.order.provider
        notes = "".join(f"; {note}" for note in shipment.notes)
        facts[f"{provider.quantity} {provider.name}"] = (
            f"{provider.title}: {parts.size_in_words(shipment.size)} in {len(shipment.parts)} files{notes}"
        )
    facts["to fetch"] = f"about {parts.size_in_words(left)}" + (
        f"; {len(there)} parts are there from before" if there else ""
    )
    numbers: dict[str, Any] = {
        "providers": [shipment.order.provider.name for shipment in shipments],
        "size_bytes": sum(shipment.size for shipment in shipments),
        "to_fetch_bytes": left,
    }
    if given.dry_run:
        return Answer("Forcing", facts, numbers=numbers)
    aloud = not (given.json or given.quiet)
    if aloud:  # before anything is fetched
        terminal.print_facts("Forcing", facts)
    if not given.yes and (left > fetching.LARGEST or not all(s.size for s in shipments)):
        _agree(left, asked=aloud)
    try:
        with progress.progress(quiet=not aloud) as report:
            fetched = fetching.carry_out(
                out, shipments, overwrite=given.overwrite, report=report, tell=_tell
            )
    except BaseException as error:
        if not isinstance(error, Exception):  # Ctrl-C, or a request to end
            print(
                "drift: what was fetched is kept; the same command goes on from there",
                file=sys.stderr,
            )
        raise
    lines = (f"{len(fetched.files)} files in {out}. For the case:\n\n{fetched.tables}",)
    numbers |= {"files": [path.name for path in fetched.files], "tables": fetched.tables}
    return Answer(lines=lines, numbers=numbers, results=out)


def _list(own: Path | None) -> Answer:
    from drift.apps.fetch import catalogue

    known = catalogue.read_providers(own).values()
    columns = ("name", "quantity", "title", "resolution", "stamp", "kind", "credentials")

    def show() -> None:
        page = terminal.empty_table(*columns)
        for one in known:
            page.add_row(*(getattr(one, column) for column in columns))
        terminal.show(page)

    return Answer(
        numbers={"providers": [{c: getattr(one, c) for c in columns} for one in known]}, show=show
    )


def _agree(size: float, *, asked: bool) -> None:
    """Ask whether to fetch so much; where nobody can be asked, refuse."""
    from drift.apps.fetch import parts

    much = (
        f"about {parts.size_in_words(size)}" if size else "an amount that is not known beforehand"
    )
    if not asked or not sys.stdin or not sys.stdin.isatty():
        raise UserError(
            f"this is {much}: add --yes to fetch it, or ask for a smaller box or a shorter span"
        )
    print(f"Fetch {much}? [y/N] ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise UserError("nothing was fetched")


def _tell(line: str) -> None:
    print(f"drift: {line}", file=sys.stderr)
