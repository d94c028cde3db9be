"""The grammar of the command line: commands, their options and help texts.

The module imports nothing slow, so that `--help` answers at once.
"""

import argparse
import re
from pathlib import Path
from typing import Any

from drift.apps.cli import export, fetch, serve
from geo.errors import UserError
from geo.forcing.quantity import QUANTITIES, velocities

SHELLS = ("bash", "zsh", "fish", "tcsh")
BACKENDS = ("cpu", "cuda", "vulkan", "metal", "auto")
EXAMPLES = """examples:
  drift run overdue_boat
  drift plan overdue_boat
  drift export overdue_boat-forecast kml
  drift new search my_case.toml
  drift run my_case.toml --out results --set clock.step='10 min' --set scenario.0.weight=0.3
  drift compare overdue_boat --set-b uncertainty.wind.std='4 m/s'
  drift fetch my_case.toml --dry-run
  drift objects raft deep ballast
  drift fit-bridge ships.csv --every '6 h' --min-speed '5 kn' --hold-out
  drift info currents/*.nc --plot currents.png
  drift info --backend"""


class Parser(argparse.ArgumentParser):
    """Argument parser that reports an error in one line and reads "-" before a digit as a value."""

    def __init__(self, *args: Any, **options: Any) -> None:
        """Create a parser with argparse's own arguments."""
        super().__init__(*args, **options)
        # argparse knows -98 as a value, but not -98,18,-80,31 nor -1e3 nor -3h.
        self._negative_number_matcher = re.compile(r"^-\.?\d")

    def error(self, message: str) -> Any:
        """Raise UserError with argparse's message and a hint to `--help`."""
        raise UserError(f"{message}. See: {self.prog} --help")


def parser() -> Parser:
    """Return the parser of the whole command line."""
    root = Parser(
        prog="drift",
        description="Forecast where an object adrift at sea may be.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    root.add_argument("--version", action="store_true", help="print the version")
    root.add_argument(
        "--print-completion",
        choices=SHELLS,
        metavar="SHELL",
        help="print a script that completes drift's commands and options in a shell: "
        f"{', '.join(SHELLS)}",
    )
    root.set_defaults(json=False, quiet=False)
    commands = root.add_subparsers(dest="command", metavar="COMMAND", parser_class=Parser)

    run = commands.add_parser("run", help="forecast a case and write maps and tables")
    _add_case(run)
    _add_results(run, "NAME-forecast")
    _add_resume(run)
    _add_scale(run)
    _add_cluster(run)

    plan = commands.add_parser(
        "plan", help="plan the next search of a case with its units, or the next patrols of a spill"
    )
    _add_case(plan)
    _add_results(plan, "NAME-plan")
    _add_scale(plan)
    _add_cluster(plan)

    origin = commands.add_parser(
        "origin", help="run a spill backward from its finds to its probable origin"
    )
    _add_case(origin)
    _add_results(origin, "NAME-origin")

    _add_output(export.add(commands))
    _add_compare(commands)
    _add_budget(commands)

    _add_output(fetch.add(commands))

    _add_verify(commands)
    _add_score(commands)

    fit = commands.add_parser(
        "fit-errors", help="fit a case's [uncertainty] to the tracks of real drifters"
    )
    _add_case(fit)
    _add_drifters(fit)
    _add_output(fit, quiet=False)
    fit.add_argument(
        "--hold-out",
        action="store_true",
        help="also fit half of the drifters and report how well that fit suits the other half",
    )

    _add_bridge(commands)
    _add_fit_bridge(commands)

    _add_sensor(commands)
    _add_experiment(commands)
    track = commands.add_parser(
        "track",
        help="estimate a target's track from its detections: track, containment areas, and where "
        "to search",
    )
    _add_case(track)
    _add_results(track, "NAME-track")

    check = commands.add_parser("check", help="validate a case and its forcing without running")
    _add_case(check)
    _add_output(check)

    cases = commands.add_parser("cases", help="list the cases that ship with drift")
    _add_output(cases, quiet=False)

    new = commands.add_parser("new", help="write a commented case file as a starting point")
    new.add_argument(
        "story", metavar="TEMPLATE", help="position, passage, spill, search or contact"
    )
    new.add_argument(
        "file", type=Path, nargs="?", metavar="FILE", help="a new file (default: TEMPLATE.toml)"
    )
    _add_output(new)

    objects = commands.add_parser("objects", help="list leeway classes, or search them")
    objects.add_argument(
        "words", nargs="*", metavar="WORDS", help="only classes that contain every word"
    )
    objects.add_argument(
        "--catalogue", type=Path, metavar="FILE", help="with the classes of your own catalogue"
    )
    _add_output(objects, quiet=False)

    _add_info(commands)
    serve.add(commands, BACKENDS)
    return root


def _add_case(command: argparse.ArgumentParser) -> None:
    command.add_argument("case", metavar="CASE", help="a case file, or the name of a shipped case")
    command.add_argument(
        "--set",
        action="append",
        default=[],
        dest="changes",
        metavar="KEY=VALUE",
        help="change one value of the case, like particles=20000 or clock.step='10 min'; list items count from 0; "
        "may be repeated",
    )
    command.add_argument("--seed", type=int, metavar="N", help="another seed than the case's")


def _add_drifters(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--drifters",
        required=True,
        metavar="FILE",
        help="tracks of real drifters: CSV, or netCDF with CF trajectories",
    )
    command.add_argument(
        "--columns",
        default="",
        metavar="KEY=COLUMN,..",
        help="forcing along the tracks, instead of the case's: current_east=u,current_north=v; the same for "
        f"{', '.join(f'{quantity}_' for quantity in velocities() if quantity != 'current')}",
    )
    command.add_argument(
        "--max-gap",
        default="3 h",
        metavar="TIME",
        help="longest gap between fixes that is interpolated (default: 3 h)",
    )
    command.add_argument(
        "--max-speed",
        default="3 m/s",
        metavar="SPEED",
        help="reject fixes that imply a higher speed (default: 3 m/s)",
    )
    command.add_argument(
        "--ends-aground",
        action="store_true",
        help="a drifter whose track ends near the shore ran aground there (default: its fate is unknown)",
    )


def _add_results(command: argparse.ArgumentParser, folder: str) -> None:
    command.add_argument(
        "--out", type=Path, metavar="DIR", help=f"folder for the results (default: {folder})"
    )
    command.add_argument(
        "--threads",
        type=int,
        metavar="N",
        help="CPU threads (default: all); the result doesn't change",
    )
    command.add_argument(
        "--backend",
        choices=BACKENDS,
        default="cpu",
        help="where particles are computed: the CPU or a graphics card; auto: a card if there is "
        "one and the run is "
        "large enough (default: cpu)",
    )
    command.add_argument(
        "--overwrite", action="store_true", help="replace results that the folder contains"
    )
    _add_output(command)


def _add_scale(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--memory",
        metavar="SIZE",
        help='memory that the run may use, as "4 GB" (default: half of the free memory); more '
        "particles "
        "than fit are computed in shards, and a stopped run continues with the missing shards",
    )
    command.add_argument(
        "--shards",
        type=int,
        metavar="N",
        help="divide the particles into this many shards; the result doesn't change",
    )


def _add_resume(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--resume",
        action="store_true",
        help="do nothing if the folder contains the results of exactly this run; otherwise compute "
        "them, continue if this run was stopped, and replace results of another run once the new "
        "ones are complete",
    )


def _add_cluster(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help="distribute the shards over this many processes of this machine",
    )
    command.add_argument(
        "--cluster",
        metavar="ADDRESS",
        help="distribute them over a dask cluster, as tcp://head:8786",
    )


def _add_output(command: argparse.ArgumentParser, *, quiet: bool = True) -> None:
    how = command.add_mutually_exclusive_group()
    how.add_argument("--json", action="store_true", help="print one JSON object, errors too")
    if quiet:
        how.add_argument("--quiet", action="store_true", help="print only errors and warnings")


def _add_compare(commands: Any) -> None:
    compare = commands.add_parser(
        "compare", help="run two cases on the same random numbers and report the differences"
    )
    _add_case(compare)
    compare.add_argument(
        "other",
        metavar="B",
        nargs="?",
        help="the second case (default: the first one, changed by --set-b)",
    )
    compare.add_argument(
        "--set-b",
        action="append",
        default=[],
        dest="changes_b",
        metavar="KEY=VALUE",
        help="change one value of B only, where --set changes both; may be repeated",
    )
    compare.add_argument(
        "--plan",
        action="store_true",
        help="also plan the next search of each, and compare the probability of success",
    )
    _add_results(compare, "NAME-compare")


def _add_budget(commands: Any) -> None:
    budget = commands.add_parser(
        "budget",
        help="show what drives the areas of a case: the share of start, current, wind, leeway and "
        "other sources, and where models agree",
    )
    _add_case(budget)
    budget.add_argument(
        "--time",
        action="append",
        default=[],
        dest="times",
        metavar="TIME",
        help="like 211830ZNOV26 or '+6 h'; may be repeated (default: output.datum, or the end)",
    )
    budget.add_argument(
        "--particles",
        type=int,
        default=10_000,
        metavar="N",
        help="in each small forecast (default: 10000)",
    )
    _add_results(budget, "NAME-budget")


def _add_verify(commands: Any) -> None:
    verify = commands.add_parser(
        "verify", help="forecast real drifters from many starts and score the forecasts"
    )
    _add_case(verify)
    _add_drifters(verify)
    verify.add_argument(
        "--every", default="12 h", metavar="TIME", help="time between starts (default: 12 h)"
    )
    verify.add_argument(
        "--hours", type=float, default=24, metavar="N", help="length of a forecast (default: 24)"
    )
    verify.add_argument(
        "--error",
        default="100 m",
        metavar="LENGTH",
        help="radius that contains half of the position errors of the fixes (default: 100 m)",
    )
    verify.add_argument(
        "--particles", type=int, default=4000, metavar="N", help="in each forecast (default: 4000)"
    )
    _add_results(verify, "NAME-verify")


def _add_score(commands: Any) -> None:
    score = commands.add_parser(
        "score", help="score finished runs against the places where the objects were found"
    )
    score.add_argument(
        "folders", nargs="+", metavar="FOLDER", help="results of drift run, one folder a case"
    )
    score.add_argument(
        "--found",
        metavar="FILE",
        help="CSV with the columns run (name of the folder), time, lon and lat (default: the "
        "contact called found in each case)",
    )
    score.add_argument(
        "--within",
        default="1 h",
        metavar="TIME",
        help="largest time from a find to an output, if there is none on its other side "
        "(default: 1 h)",
    )
    score.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for the results (default: score)"
    )
    score.add_argument(
        "--overwrite", action="store_true", help="replace results that the folder contains"
    )
    _add_output(score)


def _add_bridge(commands: Any) -> None:
    bridge = commands.add_parser(
        "bridge",
        help="estimate positions between known way points, and crossing times of lines, without "
        "particles",
    )
    bridge.add_argument(
        "file", metavar="FILE", help="way points, lines and times as TOML (docs/bridges.md)"
    )
    bridge.add_argument(
        "--k", metavar="RATE", help="another spread rate than the file's, like '24 nmi/sqrt(h)'"
    )
    bridge.add_argument(
        "--out",
        type=Path,
        metavar="PNG",
        help="draw the areas on a chart, and the crossing times",
    )
    bridge.add_argument(
        "--geojson", type=Path, metavar="FILE", help="write the areas and mean positions as GeoJSON"
    )
    _add_output(bridge)


def _add_fit_bridge(commands: Any) -> None:
    fit = commands.add_parser(
        "fit-bridge", help="fit the spread rate K of Brownian bridges to real tracks"
    )
    fit.add_argument(
        "tracks",
        metavar="TRACKS",
        help="CSV with ship (or id), time, lon, lat; or netCDF with CF trajectories",
    )
    fit.add_argument(
        "--by",
        choices=("neighbours", "steady", "wandering"),
        default="neighbours",
        help="the likelihood: of each fix given its neighbours, of all steps with a mean "
        "velocity, or of all steps without "
        "(default: neighbours)",
    )
    fit.add_argument(
        "--every",
        metavar="TIME",
        help="thin the tracks to fixes this far apart, like '6 h' (default: all)",
    )
    fit.add_argument(
        "--max-gap",
        metavar="TIME",
        help="longest time between fixes that is used (default: 1.5 times --every, or 24 h)",
    )
    fit.add_argument(
        "--min-speed",
        metavar="SPEED",
        help="use only steps faster than this between fixes, like '5 kn' (default: all)",
    )
    fit.add_argument(
        "--max-speed",
        default="60 kn",
        metavar="SPEED",
        help="reject fixes that imply a higher speed (default: 60 kn)",
    )
    fit.add_argument(
        "--error",
        default="10 m",
        metavar="LENGTH",
        help='radius that contains half of the position errors of the fixes, or "fit" to fit it '
        "too (default: 10 m)",
    )
    fit.add_argument(
        "--without",
        metavar="BOX",
        help="leave out the fixes in a box, west,south,east,north in degrees, like -98,18,-80,31",
    )
    fit.add_argument(
        "--hold-out",
        action="store_true",
        help="also fit every other track and report the coverage of the 50 and 90 %% areas on "
        "the rest",
    )
    _add_output(fit, quiet=False)


def _add_experiment(commands: Any) -> None:
    experiment = commands.add_parser(
        "experiment",
        help="run a case many times, in several variants on common random numbers, and report "
        "the spread of its figures",
    )
    _add_case(experiment)
    experiment.add_argument(
        "--runs",
        type=int,
        metavar="N",
        help="runs of each variant (default: 20, or the tracking case's)",
    )
    experiment.add_argument(
        "--with",
        action="append",
        default=[],
        dest="variants",
        metavar="NAME:KEY=VALUE",
        help="also run a variant with one value changed, several separated by ; may be repeated",
    )
    experiment.add_argument(
        "--figure",
        action="append",
        default=[],
        dest="figures",
        metavar="PATH",
        help="a number of summary.json, like outputs.-1.area_nmi2.95%%; * at the end for all; "
        "may be repeated (default: "
        "areas, POS, evidence)",
    )
    _add_results(experiment, "NAME-experiment")


def _add_sensor(commands: Any) -> None:
    sensor = commands.add_parser(
        "sensor", help="map where a sensor of a case would detect a target"
    )
    _add_case(sensor)
    sensor.add_argument("name", metavar="NAME", help="name of a [[sensor]] table of the case")
    sensor.add_argument(
        "--time",
        metavar="TIME",
        help="like 211830ZNOV26 or '+6 h' (default: the start of the case, or of the one "
        "sortie that carries the sensor)",
    )
    sensor.add_argument(
        "--at",
        metavar="POSITION",
        help="position of the sensor, like '36 00N 070 00W', if its table gives none (default: "
        "the position "
        "then of the one sortie that carries it)",
    )
    sensor.add_argument(
        "--heading", metavar="DEG", help="heading of the array of a sensor that is placed by --at"
    )
    sensor.add_argument(
        "--beams", metavar="1,4", help="numbers of the beams that are processed (default: all)"
    )
    sensor.add_argument(
        "--scenario",
        metavar="SCENARIO",
        help="scenario whose source level is used (default: the one with the highest prior)",
    )
    sensor.add_argument(
        "--speed",
        metavar="SPEED",
        help="speed of the target, like '8 kn', if its source level depends on speed (default: the "
        "lowest in its table)",
    )
    sensor.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for the results (default: CASE-sensor-NAME)"
    )
    sensor.add_argument(
        "--overwrite", action="store_true", help="replace results that the folder contains"
    )
    _add_output(sensor)


def _add_info(commands: Any) -> None:
    info = commands.add_parser(
        "info", help="report how forcing files are interpreted, or which graphics cards there are"
    )
    info.add_argument(
        "files",
        nargs="*",
        metavar="FILE",
        help="files of one source; they are joined in time, u and v may be in separate files",
    )
    info.add_argument(
        "--backend", action="store_true", help="list graphics cards and what --backend auto selects"
    )
    info.add_argument(
        "--as", choices=tuple(QUANTITIES), dest="quantity", help="read the files as this quantity"
    )
    info.add_argument(
        "--set",
        action="append",
        default=[],
        dest="changes",
        metavar="KEY=VALUE",
        help="a key of a case's source, like variables.east=ue, units=cm/s, steady=true or depth='5 m'; "
        "may be repeated",
    )
    _add_output(info, quiet=False)
    info.add_argument("--plot", type=Path, metavar="PNG", help="draw a map of the first time")
