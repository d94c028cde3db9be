"""Graphics cards on the command line: `drift info --backend`, and the choice of --backend auto."""

import argparse
import sys
from pathlib import Path
from typing import Any

from drift.apps.cli import terminal
from drift.apps.cli.answer import Answer
from drift.products.files import interrupt


def start_backend(args: argparse.Namespace, out: Path, particles: int, elsewhere: bool) -> None:
    """Start the requested backend unless it is the CPU, so that a broken card is reported first.

    Prints in one line what --backend auto selects.

    Args:
        args: the parsed command line; its `backend` is replaced once auto is decided.
        out: folder of the results; an unfinished run in it determines the backend.
        particles: number of particles of the run.
        elsewhere: whether worker processes move the particles.
    """
    from drift.pipeline.shards import shelf
    from kernels.runtime import runtime

    why = ""
    if args.backend == runtime.AUTO and elsewhere:
        args.backend, why = "cpu", "workers move particles on processors"
    elif (settled := shelf.resumed_backend(args.backend, out)) != args.backend:
        args.backend, why = settled, f"the unfinished run in {out} used it"
    if why and not args.quiet:
        print(f"drift: --backend auto takes {args.backend}: {why}", file=sys.stderr)
    if args.backend != "cpu" and not elsewhere:
        runtime.start(args.backend, args.threads, particles)
        print_backend_choice(args)


def print_backend_choice(args: argparse.Namespace) -> None:
    """Print what --backend auto selected and why; with --quiet print nothing."""
    from kernels.runtime import runtime

    if args.backend == runtime.AUTO and runtime.told() and not args.quiet:
        print(f"drift: {runtime.told()}", file=sys.stderr)


def listed() -> Answer:
    """Return the graphics cards that drivers list, and the choice of --backend auto."""
    with interrupt.exit_on_signal():  # nothing is written
        from kernels.runtime import devices, drivers

        found = [drivers.ask(backend) for backend in devices.CARDS]
        choice = devices.automatic(
            None, {backend.backend: backend for backend in found}.__getitem__
        )

    def show() -> None:
        table = terminal.empty_table("Backend", "Device", "Kind", "Driver", "Memory", "Usable")
        table.add_row("cpu", "this processor", "processor", "", "", "yes")
        for backend in found:
            if not backend.devices:
                table.add_row(
                    backend.backend, "none", "", "", "", _unusable(backend.why, backend.remedy)
                )
            for device in backend.devices:
                usable = _unusable(device.unfit, device.remedy) if device.unfit else "yes"
                name = (
                    f"{device.name} *"
                    if device == backend.taken and len(backend.devices) > 1
                    else device.name
                )
                note = (
                    ", for tests: a software device"
                    if device.kind == "software" and not device.unfit
                    else ""
                )
                table.add_row(
                    backend.backend, name, device.kind, device.driver, device.memory, usable + note
                )
        terminal.print_table(table)

    taken = choice.device.backend if choice.device else "cpu"
    threshold = (
        f"; runs with fewer than {devices.WORTH:,} particles use the CPU" if choice.device else ""
    )
    numbers: dict[str, Any] = {
        "devices": [
            _numbers(device, device == backend.taken)
            for backend in found
            for device in backend.devices
        ],
        "missing": {
            backend.backend: {"why": backend.why, "remedy": backend.remedy}
            for backend in found
            if not backend.devices
        },
        "auto": {"backend": taken, "why": choice.why, "least_particles": devices.WORTH},
    }
    legend = (
        ("* the device that its backend uses",)
        if any(len(backend.devices) > 1 for backend in found)
        else ()
    )
    lines = (*legend, f"--backend auto takes {taken}: {choice.why}{threshold}")
    return Answer(lines=lines, numbers=numbers, show=show)


def _unusable(why: str, remedy: str) -> str:
    return f"no: {why}; {remedy}" if remedy else f"no: {why}"


def _numbers(device: Any, taken: bool) -> dict[str, Any]:
    """Return a graphics card for programs; taken: whether its backend would use it."""
    return {
        "backend": device.backend,
        "number": device.number,
        "name": device.name,
        "kind": device.kind,
        "driver": device.driver,
        "memory_bytes": device.total,
        "free_bytes": device.free,
        "usable": not device.unfit,
        "why": device.unfit,
        "remedy": device.remedy,
        "taken": taken,
    }
