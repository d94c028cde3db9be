"""The command `drift fetch`: its options and its call."""

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
    """Add the command's parser to the grammar, and return it."""
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
        help="longest wait for a server's answer (default: 60 s)",
    )
    fetch.add_argument(
        "--list", action="store_true", dest="listed", help="list the providers and stop"
    )
    fetch.add_argument("--dry-run", action="store_true", help="show the size and stop")
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


def run(args: argparse.Namespace) -> Answer:
    """Fetch forcing, and return the TOML tables that read it in a case."""
    if args.listed:
        return _list(args.catalogue)
    from drift.apps.cli import progress
    from drift.apps.fetch import fetching, parts

    if not 0 < args.timeout < 1e6:
        raise UserError(f"--timeout {args.timeout:g} must be a number of seconds above 0")
    area_and_span = fetching.ordered_span(
        args.case, args.box, args.begin, args.end, take.parse_overrides(args.changes)
    )
    out = args.out or Path(f"{Path(args.case).stem}-{SUFFIX}" if args.case else SUFFIX)
    orders = fetching.orders(
        *area_and_span,
        providers=args.providers,
        quantities=args.quantities,
        own=args.catalogue,
        timeout=args.timeout,
    )
    shipments = fetching.request_shipments(orders, _print_note)
    downloaded = fetching.downloaded_parts(out, shipments)
    remaining = parts.missing(shipments, downloaded)
    box, begin, end = area_and_span
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
    facts["to fetch"] = f"about {parts.size_in_words(remaining)}" + (
        f"; {len(downloaded)} parts are already downloaded" if downloaded else ""
    )
    numbers: dict[str, Any] = {
        "providers": [shipment.order.provider.name for shipment in shipments],
        "size_bytes": sum(shipment.size for shipment in shipments),
        "to_fetch_bytes": remaining,
    }
    if args.dry_run:
        return Answer("Forcing", facts, numbers=numbers)
    interactive = not (args.json or args.quiet)
    if interactive:  # before anything is fetched
        terminal.print_facts("Forcing", facts)
    if not args.yes and (remaining > fetching.LARGEST or not all(s.size for s in shipments)):
        _confirm_size(remaining, interactive=interactive)
    try:
        with progress.progress(quiet=not interactive) as report:
            fetched = fetching.fetch_and_publish(
                out, shipments, overwrite=args.overwrite, report=report, tell=_print_note
            )
    except BaseException as error:
        if not isinstance(error, Exception):  # Ctrl-C, or a request to end
            print(
                "drift: downloaded parts are kept; the same command continues from there",
                file=sys.stderr,
            )
        raise
    lines = (f"{len(fetched.files)} files in {out}. For the case:\n\n{fetched.tables}",)
    numbers |= {"files": [path.name for path in fetched.files], "tables": fetched.tables}
    return Answer(lines=lines, numbers=numbers, results=out)


def _list(own: Path | None) -> Answer:
    from drift.apps.fetch import catalogue

    providers = catalogue.read_providers(own).values()
    columns = ("name", "quantity", "title", "resolution", "stamp", "kind", "credentials")

    def show() -> None:
        page = terminal.empty_table(*columns)
        for provider in providers:
            page.add_row(*(getattr(provider, column) for column in columns))
        terminal.print_table(page)

    return Answer(
        numbers={
            "providers": [{c: getattr(provider, c) for c in columns} for provider in providers]
        },
        show=show,
    )


def _confirm_size(size: float, *, interactive: bool) -> None:
    """Ask the user whether to fetch this amount; raise UserError without a yes."""
    from drift.apps.fetch import parts

    much = (
        f"about {parts.size_in_words(size)}" if size else "an amount that is not known in advance"
    )
    if not interactive or not sys.stdin or not sys.stdin.isatty():
        raise UserError(
            f"this is {much}: ask for a smaller box or a shorter span; on the command line, --yes fetches it"
        )
    print(f"Fetch {much}? [y/N] ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise UserError("nothing was fetched")


def _print_note(line: str) -> None:
    print(f"drift: {line}", file=sys.stderr)
