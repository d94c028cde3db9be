"""`drift serve`: its options, and its call."""

import argparse
from collections.abc import Sequence
from typing import Any

from drift.apps.cli import terminal
from drift.apps.cli.answer import Answer


def add(commands: Any, backends: Sequence[str]) -> None:
    """Add the command to the grammar; backends: where particles can move."""
    serve = commands.add_parser(
        "serve", help="edit, run and read cases in the browser (docs/serve.md)"
    )
    serve.add_argument(
        "folder",
        nargs="?",
        default=".",
        metavar="FOLDER",
        help="cases and results (default: this folder)",
    )
    serve.add_argument(
        "--host",
        default="127.0.0.1",
        metavar="ADDRESS",
        help="where it listens (default: this machine alone)",
    )
    serve.add_argument(
        "--port", type=int, metavar="N", help="port (default: 8765, or the next free one)"
    )
    serve.add_argument(
        "--allow",
        action="append",
        default=[],
        metavar="PATH",
        help="cases may read this file or folder too, besides FOLDER and DRIFT_DATA; may be repeated",
    )
    serve.add_argument(
        "--allow-host",
        action="append",
        default=[],
        metavar="HOST",
        help="cases may ask addresses at this host (OPeNDAP); may be repeated",
    )
    serve.add_argument(
        "--hours",
        type=float,
        default=12.0,
        metavar="N",
        help="the most that a job may take (default: 12)",
    )
    serve.add_argument(
        "--memory",
        type=float,
        metavar="GIB",
        help="the most memory that a job may take (default: what the machine has; not on Windows)",
    )
    serve.add_argument(
        "--backend",
        choices=backends,
        default="cpu",
        help="where particles of jobs move, as in drift run (default: cpu)",
    )
    serve.add_argument("--no-browser", action="store_true", help="only print the address")


def run(given: argparse.Namespace) -> Answer:
    """Serve until interrupted."""
    from drift.apps.serve import server

    server.serve(
        given.folder,
        host=given.host,
        port=given.port,
        allow=given.allow,
        allow_host=given.allow_host,
        hours=given.hours,
        memory=given.memory,
        backend=given.backend,
        browser=not given.no_browser,
        say=terminal.say,
    )
    return Answer()
