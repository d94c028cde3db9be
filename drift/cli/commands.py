"""The command line `drift`: its commands, what they print, and their exit status.

Exit status: 0, 2 for the user's errors (a line each), 1 for ours, 130 when interrupted, 143 when asked to end. Nothing
heavy is imported before the command that needs it, so that help and lists come at once.
"""

import argparse
import math
import os
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from drift.cli import export, fetch, grammar, terminal
from drift.output import interrupt
from geo.errors import UserError


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status."""
    terminal.open_streams()
    # NumPy's, which a user cannot mend; tests take them as errors.
    warnings.filterwarnings("ignore", category=RuntimeWarning)
    warnings.filterwarnings("ignore", message="Glyph .* missing from font")  # the map shows a box in its place
    if os.name == "posix" and not os.environ.get("HOME"):  # Taichi aborts at import without one
        home = os.path.expanduser("~")
        os.environ["HOME"] = home if os.path.isdir(home) else tempfile.gettempdir()
    try:
        with interrupt.ending_cleanly():
            return _dispatch(argv)
    except UserError as error:
        for line in terminal.lines(error):
            print(f"drift: {line}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(interrupt.INTERRUPTED, file=sys.stderr)
        return 130
    except interrupt.Terminated:
        print(interrupt.TERMINATED, file=sys.stderr)
        return 143
    except BrokenPipeError:  # the reader left, as in `drift objects | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except SystemExit as leaving:  # argparse's --help
        return int(leaving.code or 0)
    except Exception as error:
        traceback.print_exc()
        print(f"drift: an error of drift itself: {type(error).__name__}: {error}", file=sys.stderr)
        return 1


def _dispatch(argv: Sequence[str] | None) -> int:
    whole = grammar.parser()
    given = whole.parse_args(argv)
    if given.version:
        from importlib.metadata import version

        terminal.say(f"drift {version('casp-drift')}")
        return 0
    if given.command is None:
        whole.print_help()
        return 0
    commands: dict[str, Callable[[argparse.Namespace], None]] = {
        "run": _run,
        "plan": _plan,
        "origin": _origin,
        "export": export.run,
        "fetch": fetch.run,
        "verify": _verify,
        "fit-errors": _fit_errors,
        "bridge": _bridge,
        "fit-bridge": _fit_bridge,
        "check": _check,
        "cases": _cases,
        "objects": _objects,
        "info": _info,
    }
    commands[given.command](given)
    return 0


def _load(given: argparse.Namespace) -> Any:
    from drift.case import file as case_file

    try:
        os.getcwd()
    except OSError as error:
        raise UserError(f"the current folder is not there any more ({error.strerror}); go to one that is") from None
    overrides = _changes(given)
    if given.seed is not None:
        overrides["seed"] = str(given.seed)
    return case_file.load(given.case, overrides)


def _changes(given: argparse.Namespace) -> dict[str, str]:
    """Return what --set changes, by key."""
    overrides = {}
    for change in given.changes:
        key, equals, value = change.partition("=")
        if not key.strip() or not equals:
            raise UserError(f'--set "{change}" must be KEY=VALUE, like clock.step=600')
        overrides[key.strip()] = value
    return overrides


def _run(given: argparse.Namespace) -> None:
    with _started(given, "forecast") as (case, out, options):
        from drift import facts, flow
        from drift.cli import outcome
        from drift.forecast import tables

        result = flow.run(case, out, **options)
    made = result.summary["run"]
    last = {**tables.numbers(result.forecast), **result.summary}
    terminal.facts(case.title, outcome.spill(last) if case.spill else outcome.forecast(last))
    # What steers is moved exactly: only drift has a scheme and errors of its step.
    scheme = f"{made['scheme']}, step {made['step_s']} s, " if facts.drifts(case) else ""
    basis = f"{made['particles']:,} particles, {scheme}seed {made['seed']}"
    terminal.say(f"{basis}\nResults in {out}")


def _plan(given: argparse.Namespace) -> None:
    with _started(given, "plan") as (case, out, options):
        from drift.cli import outcome
        from drift.patrols import files as patrol_files
        from drift.patrols import patrol
        from drift.planner import planner

        if case.spill:
            patrols, result = patrol.patrol(case, out, **options)
        else:
            search_plan, _ = planner.plan(case, out, **options)
    if case.spill:
        assert result.aftermath is not None
        terminal.facts(case.title, patrol_files.facts(patrols, result.aftermath))
        terminal.say(f"Patrols in {out / 'patrols.txt'}, all results in {out}")
        return
    terminal.facts(case.title, outcome.plan(search_plan))
    terminal.say(f"Search action plan in {out / 'plan.txt'}, all results in {out}")


def _origin(given: argparse.Namespace) -> None:
    with _started(given, "origin") as (case, out, options):
        from drift import flow
        from drift.backtrack import backward
        from drift.cli import outcome

        release = flow.origin(case, out, **options)
    terminal.facts(case.title, outcome.origin(backward.summary(release), backward.warnings(release)))
    terminal.say(f"Results in {out}")


def _verify(given: argparse.Namespace) -> None:
    drifters = _drifters(given)
    drifters |= {
        "every": _quantity(given.every, "s", "--every", "12 h"),
        "error": _quantity(given.error, "m", "--error", "100 m"),
        "hours": given.hours,
        "particles": given.particles,
    }
    with _started(given, "verify") as (case, out, options):
        from drift.drifters import text as verification_text
        from drift.drifters import verification

        verified = verification.verify(case, given.drifters, out, **drifters, **options)
    terminal.facts(case.title, verification_text.facts(verified))
    terminal.say(f"Results in {out}")


def _fit_errors(given: argparse.Namespace) -> None:
    drifters = _drifters(given)
    with interrupt.leaving_at_once():  # nothing is written
        case = _load(given)
        from drift.drifters import fitting, fitting_text

        fitted = fitting.fit_errors(case, given.drifters, held_out=given.hold_out, **drifters)
    terminal.facts(f"{case.title}: errors that suit the drifters", fitting_text.facts(fitted))
    terminal.say(f"\n{fitting_text.toml(fitted)}")


def _bridge(given: argparse.Namespace) -> None:
    with interrupt.leaving_at_once():
        if given.out is not None:
            _check_file(given.out, "--out", ".png")
        if given.geojson is not None:
            _check_file(given.geojson, "--geojson", ".geojson")
        from drift.bridges import study, text
        from drift.case import bridge as bridge_file

        asked = bridge_file.load(given.file, given.k)
        found = study.answers(asked)
        terminal.facts(asked.title, text.answers(found))
    if given.geojson is not None:
        words = text.features(found)
        _replace(given.geojson, "--geojson", lambda half: half.write_text(words, encoding="utf-8"))
        terminal.say(f"Areas in {given.geojson}")
    if given.out is not None:
        from drift.bridges import map as bridge_map
        from drift.maps import page
        from drift.version import __version__
        from geo.coast import shore

        land = shore.land(asked.coast, bridge_map.box(found))
        attributes = {"casp-drift": __version__, "coast": land.source}
        with page.literal():
            _replace(given.out, "--out", lambda half: bridge_map.draw(found, half, land.polygons, attributes))
        terminal.say(f"Picture in {given.out}")


def _fit_bridge(given: argparse.Namespace) -> None:
    with interrupt.leaving_at_once():  # nothing is written
        error = None if given.error.strip() == "fit" else _probable_error(given.error)
        every, gap = (
            None if text is None else _quantity(text, "s", option, "6 h")
            for text, option in ((given.every, "--every"), (given.max_gap, "--max-gap"))
        )
        slowest = 0.0 if given.min_speed is None else _quantity(given.min_speed, "m/s", "--min-speed", "5 kn")
        fastest = _quantity(given.max_speed, "m/s", "--max-speed", "60 kn")
        without = None if given.without is None else _box(given.without)
        from drift.bridges import fit, text
        from drift.bridges.stretches import Rules
        from drift.drifters import reading

        tracks = reading.read(given.tracks, given_as="tracks")
        rules = Rules(every, gap, slowest, fastest, without)
        fitted = fit.fit(tracks, method=given.by, error=error, rules=rules, held_out=given.hold_out)
    terminal.facts(f"{given.tracks}: spread rate of bridges", text.fitted(fitted))
    terminal.say(f"\n{text.toml(fitted)}")


def _probable_error(text: str) -> float:
    """Return the standard deviation [m] in each component of errors of which half are within a radius."""
    from drift.case import units

    try:
        radius = units.quantity(text, "m", "length", "10 m")
    except ValueError as error:
        raise UserError(f'--error: {error}; or write "fit"') from None
    if not radius >= 0:
        raise UserError(f'--error "{text}" must be at least 0')
    return radius / math.sqrt(2 * math.log(2))


def _box(text: str) -> Any:
    """Return the box of "west,south,east,north" [deg]."""
    from geo import sphere
    from geo.box import Box

    try:
        west, south, east, north = (float(part) for part in text.split(","))
    except ValueError:
        raise UserError(
            f'--without "{text}" must be west,south,east,north in degrees, like 32.2,29.95,32.7,31.25'
        ) from None
    if not (-180 <= west <= 360 and -180 <= east <= 360 and -90 <= south < north <= 90):
        raise UserError(
            f'--without "{text}": longitudes are -180 to 360, latitudes -90 to 90, and south is below north; '
            "the order is west,south,east,north"
        )
    west = sphere.wrap_degrees(west)
    return Box(west, south, sphere.east_of_degrees(east, west), north)


def _drifters(given: argparse.Namespace) -> dict[str, Any]:
    """Return how a file of drifters is to be read."""
    from drift.drifters import reading

    return {
        "columns": reading.mapped(given.columns),
        "gap": _quantity(given.max_gap, "s", "--max-gap", "3 h"),
        "fastest": _quantity(given.max_speed, "m/s", "--max-speed", "3 m/s"),
    }


def _quantity(text: str, unit: str, option: str, example: str) -> float:
    """Return what an option says in SI; raise UserError unless it is above zero."""
    from drift.case import units

    try:
        number = units.quantity(text, unit, "quantity", example)
    except ValueError as error:
        raise UserError(f"{option}: {error}") from None
    if not number > 0:
        raise UserError(f'{option} "{text}" must be above 0')
    return number


@contextmanager
def _started(given: argparse.Namespace, kind: str) -> Iterator[tuple[Any, Path, dict[str, Any]]]:
    """Give the case, the folder for its results, and how to run it, showing progress meanwhile."""
    with interrupt.leaving_at_once():
        case = _load(given)
        out = given.out or Path(f"{case.path.stem}-{kind}")
        if given.threads is not None and given.threads < 1:
            raise UserError(f"--threads {given.threads} must be at least 1")
        from drift import flow  # noqa: F401 - flow: what is slow to import is imported here
        from drift.cli import progress
        from drift.preview import outlook
        from kernels import runtime

        cores = runtime.cores()
        if given.threads is not None and given.threads > cores:
            print(f"drift: --threads {given.threads}: runs on {cores}, all the cores it may use here", file=sys.stderr)

    if worth := outlook.caution(case):
        print(f"drift: {worth}", file=sys.stderr)
    with progress.shown(case) as show:

        def report(phase: str, share: float) -> None:
            interrupt.heed()
            show(phase, share)

        options = {"threads": given.threads, "backend": given.backend, "overwrite": given.overwrite, "report": report}
        yield case, out, options


def _check(given: argparse.Namespace) -> None:
    with interrupt.leaving_at_once():  # nothing is written
        case = _load(given)
        from drift.preview import check

        understood = check.check(case)
    terminal.facts(f"{case.title}: ready to run", understood)


def _cases(given: argparse.Namespace) -> None:
    from drift.case import file as case_file

    table = terminal.table("Name", "Title")
    for name, title in case_file.shipped():
        table.add_row(name, title)
    terminal.show(table)


def _objects(given: argparse.Namespace) -> None:
    from drift.motion import leeway

    words = " ".join(given.words)
    classes = leeway.search(words)
    if not classes:
        raise UserError(f'no leeway class holds "{words}"; see them all: drift objects')
    table = terminal.table("Class", "Description")
    for side in ("Downwind", "Right", "Left"):
        table.add_column(f"{side}\n% + cm/s ± cm/s", justify="right", no_wrap=True)
    for drifter in classes:
        lines = (
            f"{100 * line.slope:.2f} {100 * line.offset:+6.2f} {100 * line.std:5.2f}"
            for line in (drifter.down, drifter.right, drifter.left)
        )
        table.add_row(drifter.name, "  " * drifter.level + drifter.description, *lines)
    terminal.show(table)
    if upwind := [f"{drifter.name} {drifter.lull:.1f}" for drifter in classes if drifter.lull > 0]:
        terminal.say(f"Mean drift is upwind, as published, in winds below [m/s]: {', '.join(upwind)} (docs/leeway.md).")
    if not words:
        terminal.say(
            'Besides: "water" for a pure water drifter, { windage = "3 %" } or lines of your own in the case file.'
        )


def _info(given: argparse.Namespace) -> None:
    with interrupt.leaving_at_once():  # nothing is written
        from geo.forcing import describe

        if given.plot is not None:
            _check_plot(given.plot)
        options: dict[str, Any] = {}
        if given.changes:
            from drift.case import file as case_file
            from drift.environment import forcing_spec

            spec = case_file.source(given.quantity or "current", given.files, _changes(given))
            options = forcing_spec.options(spec)
        understood = describe.understand(given.files, given.quantity, **options)
        texts = ["\n".join([*describe.describe(source), *describe.sketch(source)]) for source in understood]
    for text in texts:
        terminal.say(text)
    for source in understood if given.plot is not None else ():
        plot = given.plot
        if len(understood) > 1:
            plot = plot.with_name(f"{plot.stem}-{source.quantity}{plot.suffix}")
        _draw(source, plot)
        terminal.say(f"Map in {plot}")


def _draw(source: Any, path: Path) -> None:
    from drift.maps import field, page
    from geo import notation
    from geo.coast import shore

    _check_plot(path)
    values, grid = source.read(0), source.grid
    when = f", {notation.group(source.times[0])}" if source.times.size else ""
    title = f"{source.quantity} {source.name}{when}"
    land = shore.land("gshhg", grid.box).polygons

    def draw(half: Path) -> None:
        field.draw_field(half, grid.lon, grid.lat, values[..., 0], values[..., 1], title=title, polygons=land)

    with page.literal():
        _replace(path, "--plot", draw)


def _replace(path: Path, option: str, write: Callable[[Path], object]) -> None:
    """Write a file beside its place and move it there once it is whole; raise UserError where that is not possible."""
    half = path.with_name(f".{path.name[:100]}.{os.getpid()}{path.suffix}")
    try:
        write(half)
        os.replace(half, os.path.realpath(path))
    except OSError as error:
        raise UserError(f"{option} {path}: cannot be written ({error.strerror}); name another file") from error
    finally:
        half.unlink(missing_ok=True)


def _check_plot(path: Path) -> None:
    """Raise UserError unless a picture can be written to a path."""
    _check_file(path, "--plot", ".png")


def _check_file(path: Path, option: str, suffix: str) -> None:
    """Raise UserError unless a file of a kind can be written to a path."""
    folder = path.absolute().parent
    try:
        there = os.path.lexists(path) and not (path.is_file() and os.access(path, os.W_OK))
        if path.suffix.lower() != suffix or not folder.is_dir() or len(os.fsencode(path.name)) > 255 or there:
            raise UserError(f"{option} {str(path)[:300]}: must be a {suffix} file in a folder that exists")
    except (OSError, ValueError) as error:
        raise UserError(f"{option} {str(path)[:300]!a}: {error}; name another file") from None
    if not os.access(folder, os.W_OK | os.X_OK):
        raise UserError(f"{option} {path}: cannot write in {folder}; name another file")


def leave() -> None:
    """Run the command line and end the process.

    An interrupted run ends at once, as taking Taichi down takes a second.
    """
    status = main()
    if status in (130, 143):  # all is unwound, nothing is left to write
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
        os._exit(status)
    sys.exit(status)


if __name__ == "__main__":
    leave()
