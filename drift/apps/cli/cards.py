"""Graphics cards on the command line:

`drift info --backend`, and what --backend auto took, in a line.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

from drift.apps.cli import terminal
from drift.apps.cli.answer import Answer
from drift.products.files import interrupt


def start(given: argparse.Namespace, out: Path, particles: int, elsewhere: bool) -> None:
    """Start the backend that is asked for, where it is no processor: what is wrong with a card is
    said before all else.

    out: folder for the results, where an unfinished run settles what auto takes; elsewhere: workers
    move the particles. What auto takes is said in a line.
    """
    from drift.pipeline.shards import shelf
    from kernels.runtime import runtime

    why = ""
    if given.backend == runtime.AUTO and elsewhere:
        given.backend, why = "cpu", "workers move particles on processors"
    elif (settled := shelf.settled(given.backend, out)) != given.backend:
        given.backend, why = settled, f"on it an unfinished run in {out} was moved"
    if why and not given.quiet:
        print(f"drift: --backend auto takes {given.backend}: {why}", file=sys.stderr)
    if given.backend != "cpu" and not elsewhere:
        runtime.start(given.backend, given.threads, particles)
        say_choice(given)


def say_choice(given: argparse.Namespace) -> None:
    """Print what --backend auto took and why; quiet: print only a warning, where a card could not
    be used.
    """
    from kernels.runtime import runtime

    if given.backend == runtime.AUTO and runtime.told() and not given.quiet:
        print(f"drift: {runtime.told()}", file=sys.stderr)


def listed() -> Answer:
    """Return the graphics cards that drivers list, and which backend --backend auto takes for a
    large run.
    """
    with interrupt.leaving_at_once():  # nothing is written
        from kernels.runtime import devices, drivers

        found = [drivers.ask(backend) for backend in devices.CARDS]
        choice = devices.automatic(None, {one.backend: one for one in found}.__getitem__)

    def show() -> None:
        table = terminal.empty_table("Backend", "Device", "Kind", "Driver", "Memory", "Usable")
        table.add_row("cpu", "this processor", "processor", "", "", "yes")
        for one in found:
            if not one.devices:
                table.add_row(one.backend, "none", "", "", "", _unusable(one.why, one.remedy))
            for device in one.devices:
                usable = _unusable(device.unfit, device.remedy) if device.unfit else "yes"
                named = (
                    f"{device.name} *"
                    if device == one.taken and len(one.devices) > 1
                    else device.name
                )
                note = (
                    ", for tests: a software device"
                    if device.kind == "software" and not device.unfit
                    else ""
                )
                table.add_row(
                    one.backend, named, device.kind, device.driver, device.memory, usable + note
                )
        terminal.show(table)

    taken = choice.device.backend if choice.device else "cpu"
    few = (
        f"; runs of fewer than {devices.WORTH:,} particles stay on the cpu" if choice.device else ""
    )
    numbers: dict[str, Any] = {
        "devices": [
            _numbers(device, device == one.taken) for one in found for device in one.devices
        ],
        "missing": {
            one.backend: {"why": one.why, "remedy": one.remedy} for one in found if not one.devices
        },
        "auto": {"backend": taken, "why": choice.why, "least_particles": devices.WORTH},
    }
    starred = (
        ("* the device on which its backend starts",)
        if any(len(one.devices) > 1 for one in found)
        else ()
    )
    lines = (*starred, f"--backend auto takes {taken}: {choice.why}{few}")
    return Answer(lines=lines, numbers=numbers, show=show)


def _unusable(why: str, remedy: str) -> str:
    return f"no: {why}; {remedy}" if remedy else f"no: {why}"


def _numbers(device: Any, taken: bool) -> dict[str, Any]:
    """Return a graphics card for programs; taken: its backend would start it."""
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
