"""Commands of Brownian bridges: bridge, fit-bridge."""

import argparse

from drift.apps.cli import given as take
from drift.apps.cli.answer import Answer
from drift.products.files import interrupt


def bridge(given: argparse.Namespace) -> Answer:
    """Say where something is between known places."""
    with interrupt.leaving_at_once():
        if given.out is not None:
            take.check_file(given.out, "--out", ".png")
        if given.geojson is not None:
            take.check_file(given.geojson, "--geojson", ".geojson")
        from drift.case.tracking import bridge as bridge_file
        from drift.tracking.bridges import study, text

        asked = bridge_file.load(given.file, given.k)
        found = study.answers(asked)
    lines = []
    if given.geojson is not None:
        words = text.features(found)
        take.replace(
            given.geojson, "--geojson", lambda half: half.write_text(words, encoding="utf-8")
        )
        lines.append(f"Areas in {given.geojson}")
    if given.out is not None:
        from drift.products.maps import page
        from drift.tracking.bridges import map as bridge_map
        from drift.version import __version__
        from geo.coast import shore

        land = shore.land(asked.coast, bridge_map.box(found))
        attributes = {"casp-drift": __version__, "coast": land.source}
        with page.literal():
            take.replace(
                given.out,
                "--out",
                lambda half: bridge_map.plot_bridge(found, half, land.polygons, attributes),
            )
        lines.append(f"Picture in {given.out}")
    return Answer(asked.title, text.answers(found), tuple(lines), text.summary_of_bridge(found))


def fit_bridge(given: argparse.Namespace) -> Answer:
    """Fit the spread rate of bridges to real tracks."""
    with interrupt.leaving_at_once():  # nothing is written
        error = None if given.error.strip() == "fit" else take.probable_error(given.error)
        every, gap = (
            None if text is None else take.quantity(text, "s", option, "6 h")
            for text, option in ((given.every, "--every"), (given.max_gap, "--max-gap"))
        )
        slowest = (
            0.0
            if given.min_speed is None
            else take.quantity(given.min_speed, "m/s", "--min-speed", "5 kn")
        )
        fastest = take.quantity(given.max_speed, "m/s", "--max-speed", "60 kn")
        without = None if given.without is None else take.box(given.without)
        from drift.assess.verify import reading
        from drift.tracking.bridges import fit, text
        from drift.tracking.bridges.stretches import Rules

        tracks = reading.read_drifters(given.tracks, given_as="tracks")
        rules = Rules(every, gap, slowest, fastest, without)
        fitted = fit.fit(tracks, method=given.by, error=error, rules=rules, held_out=given.hold_out)
    toml, title = text.toml(fitted), f"{given.tracks}: spread rate of bridges"
    return Answer(title, text.fitted(fitted), (f"\n{toml}",), {"toml": toml})
