"""The command `drift serve`: its options and its call."""

import argparse
from collections.abc import Sequence
from typing import Any

from drift.apps.cli import terminal
from drift.apps.cli.answer import Answer


def add(commands: Any, backends: Sequence[str]) -> None:
    """Add the command's parser to the grammar; backends: the allowed values of --backend."""
    serve = commands.add_parser(
        "serve", help="edit, run and read cases in the browser (docs/serve.md)"
    )
    serve.add_argument(
        "folder",
        nargs="?",
        default=".",
        metavar="FOLDER",
        help="folder of cases and results (default: the current folder)",
    )
    serve.add_argument(
        "--host",
        default="127.0.0.1",
        metavar="ADDRESS",
        help="address to listen on (default: 127.0.0.1, this machine only)",
    )
    serve.add_argument(
        "--port", type=int, metavar="N", help="port (default: 8765, or the next free one)"
    )
    serve.add_argument(
        "--allow",
        action="append",
        default=[],
        metavar="PATH",
        help="a file or folder that cases may read, besides FOLDER and DRIFT_DATA; may be repeated",
    )
    serve.add_argument(
        "--allow-host",
        action="append",
        default=[],
        metavar="HOST",
        help="a host that cases may open addresses at (OPeNDAP); may be repeated",
    )
    serve.add_argument(
        "--hours",
        type=float,
        default=12.0,
        metavar="N",
        help="longest time that a job may run [h] (default: 12)",
    )
    serve.add_argument(
        "--memory",
        type=float,
        metavar="GIB",
        help="most memory that a job may use (default: no limit but the machine's; not on Windows)",
    )
    serve.add_argument(
        "--backend",
        choices=backends,
        default="cpu",
        help="where particles of jobs are computed, as in drift run (default: cpu)",
    )
    serve.add_argument(
        "--user",
        action="append",
        default=[],
        metavar="NAME",
        help="a user, who gets an address of their own; may be repeated (default: one user)",
    )
    serve.add_argument(
        "--guest",
        action="append",
        default=[],
        metavar="NAME",
        help="a guest, who may read but not change; may be repeated",
    )
    serve.add_argument(
        "--webhook", metavar="URL", help="an address that gets a message when a run ends"
    )
    serve.add_argument(
        "--chart",
        action="append",
        default=[],
        metavar="FILE",
        help="a chart for the map: MBTiles or PMTiles of images; may be repeated",
    )
    serve.add_argument("--no-browser", action="store_true", help="only print the address")


def run(args: argparse.Namespace) -> Answer:
    """Serve the folder until interrupted."""
    from drift.apps.serve import server

    server.serve(
        args.folder,
        host=args.host,
        port=args.port,
        allow=args.allow,
        allow_host=args.allow_host,
        hours=args.hours,
        memory=args.memory,
        backend=args.backend,
        user=args.user,
        guest=args.guest,
        webhook=args.webhook,
        chart=args.chart,
        browser=not args.no_browser,
        say=terminal.print_line,
    )
    return Answer()
