"""The commands of Brownian bridges: bridge, fit-bridge."""

import argparse

from drift.apps.cli import given as take
from drift.apps.cli.answer import Answer
from drift.products.files import interrupt


def bridge(args: argparse.Namespace) -> Answer:
    """Estimate positions between known way points, and crossing times of lines."""
    with interrupt.exit_on_signal():
        if args.out is not None:
            take.check_writable_file(args.out, "--out", ".png")
        if args.geojson is not None:
            take.check_writable_file(args.geojson, "--geojson", ".geojson")
        from drift.case.tracking import bridge as bridge_file
        from drift.tracking.bridges import study, text

        problem = bridge_file.load(args.file, args.k)
        found = study.answers(problem)
    lines = []
    if args.geojson is not None:
        geojson = text.features(found)
        take.write_and_replace(
            args.geojson, "--geojson", lambda half: half.write_text(geojson, encoding="utf-8")
        )
        lines.append(f"Areas in {args.geojson}")
    if args.out is not None:
        from drift.products.maps import page
        from drift.tracking.bridges import map as bridge_map
        from drift.version import __version__
        from geo.coast import shore

        land = shore.read_land(problem.coast, bridge_map.box(found))
        attributes = {"casp-drift": __version__, "coast": land.source}
        with page.literal_text():
            take.write_and_replace(
                args.out,
                "--out",
                lambda half: bridge_map.plot_bridge(found, half, land.polygons, attributes),
            )
        lines.append(f"Map in {args.out}")
    return Answer(problem.title, text.answers(found), tuple(lines), text.summary_of_bridge(found))


def fit_bridge(args: argparse.Namespace) -> Answer:
    """Fit the spread rate of Brownian bridges to real tracks."""
    with interrupt.exit_on_signal():  # nothing is written
        error = None if args.error.strip() == "fit" else take.parse_probable_error(args.error)
        every, gap = (
            None if text is None else take.parse_positive_quantity(text, "s", option, "6 h")
            for text, option in ((args.every, "--every"), (args.max_gap, "--max-gap"))
        )
        slowest = (
            0.0
            if args.min_speed is None
            else take.parse_positive_quantity(args.min_speed, "m/s", "--min-speed", "5 kn")
        )
        fastest = take.parse_positive_quantity(args.max_speed, "m/s", "--max-speed", "60 kn")
        without = None if args.without is None else take.parse_box(args.without)
        from drift.case.tracking import reading
        from drift.tracking.bridges import fit, text
        from drift.tracking.bridges.stretches import Rules

        tracks = reading.read_drifters(args.tracks, given_as="tracks")
        rules = Rules(every, gap, slowest, fastest, without)
        fitted = fit.fit(tracks, method=args.by, error=error, rules=rules, held_out=args.hold_out)
    toml, title = text.toml(fitted), f"{args.tracks}: spread rate of Brownian bridges"
    return Answer(title, text.fitted(fitted), (f"\n{toml}",), {"toml": toml})
