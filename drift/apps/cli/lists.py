"""Commands that list or describe (cases, objects, info), and `new`, which writes a case file."""

import argparse
from pathlib import Path
from typing import Any

from drift.apps.cli import cards, terminal
from drift.apps.cli import given as take
from drift.apps.cli.answer import Answer
from drift.products.files import interrupt
from geo.errors import UserError


def cases(args: argparse.Namespace) -> Answer:
    """List the shipped cases."""
    from drift.case import file as case_file

    shipped, tracking = case_file.shipped(), case_file.shipped("tracking")

    def show() -> None:
        table = terminal.empty_table("Name", "Title")
        for name, title in shipped:
            table.add_row(name, title)
        for name, title in tracking:
            table.add_row(name, f"{title} (tracking)")
        terminal.print_table(table)

    titles = {"cases": shipped, "tracking_cases": tracking}
    numbers = {
        key: [{"name": name, "title": title} for name, title in rows]
        for key, rows in titles.items()
    }
    return Answer(numbers=numbers, show=show)


def new(args: argparse.Namespace) -> Answer:
    """Write a commented case file as a starting point."""
    from drift.case import template

    path = args.file or Path(f"{args.story}.toml")
    template.write(args.story, path)
    return Answer(
        lines=(
            f"{path}: {(template.TEMPLATES | template.TRACKED)[args.story]}. Next: drift check "
            f"{path}",
        ),
        numbers={"file": path},
    )


NO_SEARCH_OBJECT = "no sweep width table fits; give sweep_width instead"


def objects(args: argparse.Namespace) -> Answer:
    """List leeway classes, or search them."""
    from drift.engine.motion.objects import everyday
    from drift.engine.motion.objects.leeway import COAST_GUARD, Catalogue

    words, known = " ".join(args.words), Catalogue()
    if args.catalogue:
        from drift.case.scenario import catalogue  # pydantic takes half a second

        known = catalogue.read_catalogue(args.catalogue)
    classes = known.search(words)
    if not classes:
        raise UserError(
            f'no leeway class contains "{words}"; list all: {known.command}. If none fits, '
            "describe the object in the case: "
            'object = { windage = "3 %" }, or leeway coefficients of your own'
        )
    names = tuple(known.classes)
    meant = ((word, everyday.classes_of_word(word, names)) for word in everyday.split_words(words))
    notes = [f"{word}: {meaning.note}." for word, meaning in meant if meaning and meaning.note]
    seen: dict[str, list[str]] = {}
    for drifter in classes:
        found = everyday.search_objects(drifter.name)
        seen.setdefault(found.words if found else NO_SEARCH_OBJECT, []).append(drifter.name)

    sources: dict[str, list[str]] = {}
    for drifter in classes:
        if drifter.source != COAST_GUARD:
            source = f"{drifter.source}; measured: {drifter.measured}. {drifter.warning}".strip()
            sources.setdefault(source, []).append(drifter.name)

    def show() -> None:
        table = terminal.empty_table("Class", "Description")
        for side in ("Downwind", "Right", "Left"):
            table.add_column(f"{side}\n% + cm/s ± cm/s", justify="right", no_wrap=True)
        for drifter in classes:
            lines = (
                f"{100 * line.slope:.2f} {100 * line.offset:+6.2f} {100 * line.std:5.2f}"
                for line in (drifter.down, drifter.right, drifter.left)
            )
            table.add_row(drifter.name, "  " * drifter.level + drifter.description, *lines)
        terminal.print_table(table)
        if upwind := [
            f"{drifter.name} {drifter.lull:.1f}" for drifter in classes if drifter.lull > 0
        ]:
            listed = ", ".join(upwind)
            terminal.print_line(
                f"Mean drift is upwind, as published, in winds below [m/s]: {listed} "
                "(docs/leeway.md)."
            )
        for source, drifters in sources.items():
            terminal.print_line(f"{', '.join(drifters)}: {source}")
        if added := [drifter.name for drifter in classes if drifter.stokes == "added"]:
            terminal.print_line(
                f"Stokes drift of a case is added to the lines of {', '.join(added)}; those of the "
                "others include it (docs/leeway.md)."
            )
        for target, drifters in seen.items():
            terminal.print_line(f"search_object of {_shortened(drifters)}: {target}")
        for note in notes:
            terminal.print_line(note)
        if not words:
            terminal.print_line(
                'Also: "water" for a pure water drifter, { windage = "3 %" } or coefficients of '
                "your own in the case file."
            )

    return Answer(
        numbers={"objects": [_numbers(drifter) for drifter in classes], "notes": notes}, show=show
    )


def _shortened(names: list[str]) -> str:
    """Return names as one text, with equal prefixes shortened: SKIFF-1, -2, -4, SPORT-BOAT."""
    kinds: dict[str, list[str]] = {}
    for name in names:
        kind, _, number = name.rpartition("-")
        if number[:1].isdigit():
            kinds.setdefault(f"{kind}-", []).append(number)
        else:
            kinds[name] = [""]
    return ", ".join(kind + ", -".join(numbers) for kind, numbers in kinds.items())


def _numbers(drifter: Any) -> dict[str, Any]:
    """Return a leeway class for programs, in SI units."""
    from drift.engine.motion.objects import everyday

    found = everyday.search_objects(drifter.name)
    lines = {"downwind": drifter.down, "right": drifter.right, "left": drifter.left}
    return {
        "name": drifter.name,
        "description": drifter.description,
        "level": drifter.level,
        "measured": drifter.measured,
        "source": drifter.source,
        "stokes": drifter.stokes,
        "warning": drifter.warning,
        "search_objects": list(found.names) if found else [],
        **{
            name: {"slope": line.slope, "offset_m_per_s": line.offset, "std_m_per_s": line.std}
            for name, line in lines.items()
        },
    }


def info(args: argparse.Namespace) -> Answer:
    """Report how forcing files are interpreted, or which graphics cards there are."""
    if args.backend and (args.files or args.quantity or args.changes or args.plot):
        raise UserError("--backend lists graphics cards: give no files with it")
    if args.backend:
        return cards.listed()
    if not args.files:
        raise UserError(
            "give forcing files, or --backend to list graphics cards. See: drift info --help"
        )
    with interrupt.exit_on_signal():  # nothing is written
        from geo.forcing import describe

        if args.plot is not None:
            take.check_writable_file(args.plot, "--plot", ".png")
        options: dict[str, Any] = {}
        if args.changes:
            from drift.case import file as case_file
            from drift.engine.environment import forcing_spec

            changes = take.parse_overrides(args.changes)
            spec = case_file.source(args.quantity or "current", args.files, changes)
            options = forcing_spec.options(spec)
        interpreted = describe.open_quantities(args.files, args.quantity, **options)
        descriptions = [describe.describe(source) for source in interpreted]
        sketches = [] if args.json else [describe.sketch(source) for source in interpreted]

    def show() -> None:
        for lines, sketch in zip(descriptions, sketches, strict=True):
            terminal.print_line("\n".join([*lines, *sketch]))

    numbers: dict[str, Any] = {
        "sources": [
            {
                "quantity": source.quantity,
                "name": source.name,
                "west_deg": source.grid.box.west,
                "south_deg": source.grid.box.south,
                "east_deg": source.grid.box.east,
                "north_deg": source.grid.box.north,
                "nlon": source.grid.nlon,
                "nlat": source.grid.nlat,
                "dlon_deg": source.grid.dlon,
                "dlat_deg": source.grid.dlat,
                "times": source.times,
                "missing_share": source.missing,
                "notes": source.notes,
                "fingerprint": source.fingerprint,
                "facts": lines,
            }
            for source, lines in zip(interpreted, descriptions, strict=True)
        ]
    }
    if args.plot is None:
        return Answer(numbers=numbers, show=show)
    plots = []
    for source in interpreted:
        plot = args.plot
        if len(interpreted) > 1:
            plot = plot.with_name(f"{plot.stem}-{source.quantity}{plot.suffix}")
        _plot_source(source, plot)
        plots.append(plot)
    lines = tuple(f"Map in {plot}" for plot in plots)
    return Answer(lines=lines, numbers={**numbers, "plots": plots}, show=show)


def _plot_source(source: Any, path: Path) -> None:
    from drift.products.maps import field, page
    from geo import notation
    from geo.coast import shore

    take.check_writable_file(path, "--plot", ".png")
    values, grid = source.read(0), source.grid
    when = f", {notation.format_dtg(source.times[0])}" if source.times.size else ""
    title = f"{source.quantity} {source.name}{when}"
    land = shore.read_land("gshhg", grid.box).polygons

    def draw(half: Path) -> None:
        field.draw_field(
            half, grid.lon, grid.lat, values[..., 0], values[..., 1], title=title, polygons=land
        )

    with page.literal_text():
        take.write_and_replace(path, "--plot", draw)
