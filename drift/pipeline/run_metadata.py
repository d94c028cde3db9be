"""Metadata of a run: file attributes, numbers of the summary, titles and footers of maps."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from drift import version
from drift.case import case_digest
from drift.case.record import Case
from drift.engine.environment import coastline
from drift.engine.environment.environment import Environment
from drift.engine.environment.environment_spec import Coast
from drift.engine.motion.errors import forcing_error
from drift.engine.motion.objects.leeway import Drifter
from drift.engine.motion.scenario import Scenario
from drift.engine.particles.status import Status
from drift.forecast import likeliest
from drift.forecast.likeliest import Shown
from drift.forecast.starts import others, prior_marks
from drift.forecast.survey import Survey
from drift.pipeline.run_setup import Setup
from drift.products.files import formats
from drift.products.files.chapter import OutputBundle
from drift.products.maps.imprint import Imprint, Setting
from drift.products.report import leaves
from drift.products.report.leaves import Leaf
from geo import notation
from geo.files import digest
from kernels.runtime import runtime

LAND = {  # effect of land on a target under way, by the case's key
    "refuse": "lanes, voyages and areas that touch land are rejected",
    "stop": "a target that meets the shore runs aground there",
    "ignore": "paths cross land",
}


def file_attributes(case: Case, where: Environment) -> dict[str, str]:
    """Return the attributes of every output file: case, seed, versions and forcing fingerprints."""
    return {
        "title": case.title,
        "source": f"casp-drift {version.__version__}",
        "versions": version.told(),
        "seed": str(case.seed),
        **runtime.about(),
        "forcing": "; ".join(f"{s.quantity} {s.name}: {s.fingerprint}" for s in where.sources),
        "coast": where.coast.source if where.coast else "none",
        "uncertainty": describe_errors(case),
        "case": case.text,
        **case.about,
        **({"caution": words} if (words := caution_banner(case)) else {}),
    }


def metadata_bundle(
    case: Case, facts: Mapping[str, str], numbers: Mapping[str, Any]
) -> OutputBundle:
    """Return the output bundle of a run's metadata.

    Args:
        case: the case of the run.
        facts: attributes of its files.
        numbers: contents of its summary.json.
    """
    items = (partial(_report_items, case, numbers),)
    return OutputBundle(numbers, leaves=items, facts=facts, warnings=tuple(numbers["warnings"]))


def _report_items(case: Case, numbers: Mapping[str, Any]) -> list[Any]:
    """Return the report's table of how the case was interpreted, and the text of the case."""
    run = numbers["run"]
    rows = [
        [
            "Run",
            f"{run['start']}Z to {run['end']}Z, {run['particles']:,} particles, seed {run['seed']}, "
            f"{run['backend']}{f': {device}' if (device := run.get('device')) else ''}",
        ],
        ["Step", f"{run['scheme']}, {run['step_s']} s"],
        ["Errors", numbers["uncertainty"]["told"] or "none: no target feels wind or current"],
        ["Coast", f"{numbers['coast']['source']}; {run['coast_behaviour']}"],
        *(["Coast", note] for note in numbers["coast"]["notes"]),
        *(["Object", _object_in_words(one)] for one in numbers["leeway"]),
        *(
            [f'{source["quantity"]} "{source["name"]}"', note]
            for source in numbers["forcing"]
            for note in source["understood"]
        ),
    ]
    return [
        leaves.table_leaf(
            "How the case was understood", [("", "What", "words"), ("", "How", "words")], rows=rows
        ),
        case_text_item(case),
    ]


def _object_in_words(one: Mapping[str, str]) -> str:
    """Return a row of `_summary_of_objects` as text."""
    waves = "in its lines" if one["stokes"] == "inside" else "not in its lines"
    return (
        f"{one['name']}: {one['description']}; {one['source']}; measured: {one['measured']}; "
        f"Stokes drift {waves}"
    )


def case_text_item(case: Case) -> Leaf:
    """Return the report's item with the text of the case."""
    return leaves.text_leaf("The case as it was written", words=case.text)


def map_setting(case: Case, where: Environment, shown: Shown | None = None) -> Setting:
    """Return the title, attribution, land, marks and lines of every map of a run.

    Args:
        case: the case of the run.
        where: its environment.
        shown: scenarios whose starts are drawn; None: those with the highest prior probability.
    """
    source = file_attributes(case, where)
    known_as, short = (
        ("Position at start", "start") if case.direction < 0 else ("Last known position", "LKP")
    )
    released = case.scenarios
    if case.spill:  # all classes of objects share one release
        known_as, short, released = (
            "Release",
            "release",
            (replace(case.scenarios[0], name="release"),),
        )
    if shown is None or case.spill:
        shown = likeliest.likeliest_scenarios([scenario.weight for scenario in released])
    marks, lines = prior_marks(released, known_as, short, shown)
    return Setting(
        Imprint(
            case.title,
            # The errors come first: without them an area means nothing.
            f"{_errors_sentence(source['uncertainty'])}{source['source']}, seed {source['seed']}",
            {**source, "run_id": formats.run_id(source)},
            caution_banner(case),
        ),
        coastline.land_reader(where.coast, case.coast),
        marks,
        lines,
        others(released, shown),
        known_as,
        case.particles,
        case.opens,
        [partial(_itineraries, released)]
        if any(scenario.itinerary for scenario in released)
        else (),
    )


def _itineraries(scenarios: Sequence[Scenario], now: Any) -> Any:
    """Return the map overlay (`drift.products.maps.overlay.Overlay`) of itineraries."""
    from drift.engine.environment import layers  # imported late: Matplotlib takes a second

    return layers.itineraries(scenarios)


def with_coast(on: Setting) -> Setting:
    """Return a map setting whose footer names the source of the coast."""
    imprint = on.imprint
    return replace(
        on,
        imprint=replace(imprint, footer=f"{imprint.footer}, coast {imprint.attributes['coast']}"),
    )


def changed_inputs(case: Case, where: Environment, before: Mapping[str, Any]) -> list[str]:
    """Return the inputs of a run that differ from the summary of an earlier one.

    Args:
        case: the case of the run.
        where: its environment.
        before: contents of the earlier run's summary.json.

    Returns:
        Descriptions such as "the seed"; empty if `before` is the summary of exactly this run.
    """
    of = file_attributes(case, where)
    now: dict[str, Any] = {
        name: of.get(name) for name in ("case", "seed", "versions", "backend", "device", "coast")
    }
    now["forcing"] = [
        [source.quantity, source.name, source.fingerprint] for source in where.sources
    ]
    # a case changed in Python keeps the text of its file, so the digest is compared too
    now["case"] = [of["case"], case_digest.digest(case)]
    now["files"] = [input_file(path)["digest"] for path in case.inputs]
    coast, forcing, files = (before.get(name) for name in ("coast", "forcing", "inputs"))
    then = {
        **before,
        "case": [
            before.get("case"),
            run.get("case_digest") if isinstance(run := before.get("run"), dict) else None,
        ],
        "coast": coast.get("source") if isinstance(coast, dict) else None,
        "forcing": [
            [source.get(key) for key in ("quantity", "name", "fingerprint")]
            for source in _rows(forcing)
        ],
        "files": [file.get("digest") for file in _rows(files)],
    }
    return [f"the {name}" for name, value in now.items() if value != then.get(name)]


def _rows(value: Any) -> list[dict[str, Any]]:
    return [row for row in value if isinstance(row, dict)] if isinstance(value, list) else []


def has_synthetic_forcing(case: Case) -> bool:
    """Return whether any wind or current of the case is an analytic field."""
    return any(spec.analytic is not None for spec in case.sources)


def caution_banner(case: Case) -> str:
    """Return the warning banner of every picture: synthetic forcing, or winds and currents without
    an error."""
    if has_synthetic_forcing(case):
        return "SYNTHETIC wind or current: not for operations"
    exact = _without_error(case)
    return f"NO ERROR of {' and '.join(exact)} in this forecast" if exact else ""


def _without_error(case: Case) -> dict[str, str]:
    """Return the quantities that move something and have no error, each with the reason: the case
    says so, or it types them and states none. Members stand for the error of what is typed, and a
    diffusivity for that of a current.
    """
    felt = {
        "current": _feels_currents(case),
        "wind": any(scenario.uses_wind for scenario in case.scenarios),
    }
    errors = {"current": case.current_error, "wind": case.wind_error}
    spread = {
        name: any(spec.members for spec in case.forcing[name])
        or (name == "current" and case.diffusivity > 0)
        for name in errors
    }
    return {
        name: error.by[0]
        for name, error in errors.items()
        if felt[name]
        and case.forcing[name]
        and error.std == error.bias == 0
        and (
            error.by[0] == forcing_error.CASE
            or (error.by[0] == forcing_error.NOWHERE and not spread[name])
        )
    }


def _errors_sentence(description: str) -> str:
    return f"Errors: {description}. " if description else ""


def _drifting_objects(case: Case) -> list[Drifter]:
    """Return the objects that drift in a case, what they change to, and debris, each once."""
    adrift = [scenario.object for scenario in _adrift(case)]
    others = [
        *(change.object for scenario in _adrift(case) for change in scenario.changes),
        *(contact.drifter for contact in case.contacts),
    ]
    return list(dict.fromkeys([*adrift, *(one for one in others if one is not None)]))


def _adrift(case: Case) -> list[Scenario]:
    """Return the scenarios whose object drifts at some time."""
    return [
        scenario
        for scenario in case.scenarios
        if scenario.itinerary is None or scenario.itinerary.distress is not None
    ]


def case_warnings(case: Case) -> list[str]:
    """Return warnings about what a case states: winds and currents without an error, and its leeway
    classes.
    """
    return error_warnings(case) + object_warnings(case)


def error_warnings(case: Case) -> list[str]:
    """Return a warning if a case types winds or currents and states no error of them."""
    typed = [name for name, why in _without_error(case).items() if why == forcing_error.NOWHERE]
    if has_synthetic_forcing(case) or not typed:
        return []
    stated = {
        "current": 'current = { std = "0.3 m/s", time = "11 h" }',
        "wind": 'wind = { std = "2 m/s", time = "12 h" }',
    }
    return [
        f"this forecast takes its {' and '.join(typed)} as exact, so its areas are too small: they are not from "
        f"model files, and the case states no error. State one in [uncertainty], as "
        f'{" and ".join(stated[name] for name in typed)}; "none" accepts that there is none (docs/errors.md)'
    ]


def object_warnings(case: Case) -> list[str]:
    """Return warnings about the leeway classes of a case: Stokes drift that is not added because
    the lines include it, and figures of a class that are rough.
    """
    objects, lines = _drifting_objects(case), []
    if any(scenario.sources.get("stokes") for scenario in _adrift(case)):
        names = dict.fromkeys(one.name for one in objects if one.stokes == "inside")
        if names:
            lines.append(
                f"the Stokes drift of [[stokes]] is not added to {', '.join(names)}: leeway lines measured at sea "
                'include it (docs/leeway.md); leeway.stokes = "added" adds it all the same'
            )
    return lines + [f"object {one.name}: {one.warning}" for one in objects if one.warning]


def _summary_of_objects(case: Case) -> list[dict[str, str]]:
    """Return the leeway classes of a case, with the source of their lines."""
    return [
        {
            "name": drifter.name,
            "description": drifter.description,
            "measured": drifter.measured,
            "source": drifter.source,
            "stokes": drifter.stokes,
        }
        for drifter in _drifting_objects(case)
        if drifter.measured
    ]


def drifts(case: Case) -> bool:
    """Return whether anything drifts.

    A target that steers and never goes adrift feels no wind, and currents only if `currents` says
    so.
    """
    return any(contact.drifter is not None for contact in case.contacts) or any(
        scenario.itinerary is None or scenario.itinerary.distress is not None
        for scenario in case.scenarios
    )


def _feels_currents(case: Case) -> bool:
    return drifts(case) or any(
        scenario.itinerary is not None and scenario.itinerary.currents == "felt"
        for scenario in case.scenarios
    )


def describe_errors(case: Case) -> str:
    """Return a line on the current and wind errors of a run and their source; "" if none is
    felt."""
    if not _feels_currents(case):
        return ""
    wind = case.wind_error if drifts(case) and case.forcing["wind"] else None
    description = forcing_error.errors_in_words(
        case.current_error, wind, case.diffusivity, case.diffusivity_by
    )
    both = [
        quantity
        for quantity, error in (("current", case.current_error), ("wind", wind))
        if error
        and error.std + error.bias > 0
        and any(spec.members for spec in case.forcing[quantity])
    ]
    return (
        f"{description}; added to the spread of the members of the {' and of the '.join(both)}"
        if both
        else description
    )


def describe_coast(case: Case) -> str:
    """Return a description of what happens to particles and targets at the coast."""
    coast = case.coast
    if coast.source == "none":
        return "none: particles pass over land"
    steering = [scenario.itinerary for scenario in case.scenarios if scenario.itinerary is not None]
    ways = dict.fromkeys(LAND[itinerary.land] for itinerary in steering)
    if any(itinerary.land == "refuse" and itinerary.currents == "felt" for itinerary in steering):
        ways |= dict.fromkeys([LAND["stop"]])
    if not drifts(case):
        return "; ".join(ways)
    return "; ".join([_stranding(coast), *(f"under way: {words}" for words in ways)])


def _stranding(coast: Coast) -> str:
    if coast.behaviour == "slide":
        return "slide: particles that reach the shore move on along it"
    if coast.behaviour == "refloat":
        return (
            f"refloat: stranded particles refloat with a half-life of {notation.number(coast.half_life / 3600)} h, once their drift "
            f"leads away from the beach, {notation.number(coast.offing)} m off it"
        )
    return "strand: particles that reach the shore stay there"


def input_file(path: str) -> dict[str, Any]:
    """Return the path, size and digest of an input file, so that a changed file can be
    recognised."""
    try:
        return {"path": path, "bytes": digest.size(path), "digest": digest.digest_of(path)}
    except OSError as error:
        return {
            "path": path,
            "bytes": None,
            "digest": f"none: {error.strerror or 'gone'} by the end of the run",
        }


def summary_of_run(
    case: Case,
    where: Environment,
    end: Survey,
    setup: Setup,
    seconds: dict[str, float],
) -> dict[str, Any]:
    """Return the numbers of summary.json that do not come from the forecast's maps.

    Args:
        case: the case of the run.
        where: its environment.
        end: survey of the particles at the end of the run.
        setup: the scene, clock and priors of the run.
        seconds: wall time by phase [s].
    """
    # Sums of many float weights are 1 only to rounding: normalize them for the reader.
    by_status, by_scenario = end.status / end.status.sum(), end.scenario / end.scenario.sum()
    return {
        "run": {
            "start": str(case.start),
            "end": str(case.end),
            "particles": case.particles,
            "seed": case.seed,
            "case_digest": case_digest.digest(case),
            "step_s": setup.clock.step,
            "step_errors_m_per_day": {str(k): v for k, v in setup.trial.errors.items()}
            if setup.trial
            else None,
            "scheme": case.scheme,
            "coast_behaviour": describe_coast(case),
            **runtime.about(),
        },
        "uncertainty": {
            "told": describe_errors(case),
            **forcing_error.summary_of_errors(
                case.current_error, case.wind_error, case.diffusivity, case.diffusivity_by
            ),
        },
        "effective_sample_size": end.effective,
        **({"guide": setup.guide.numbers} if setup.guide else {}),
        "account": {status.name.lower(): float(by_status[status]) for status in Status},
        "scenario_weights": {
            s.name: {"prior": s.weight, "posterior": float(w), "prior_on_land": dry}
            for s, w, dry in zip(case.scenarios, by_scenario, setup.dry, strict=True)
        },
        "forcing": [
            {
                "quantity": s.quantity,
                "name": s.name,
                "missing_share": s.missing,
                "understood": list(s.notes),
                "fingerprint": s.fingerprint,
            }
            for s in where.sources
        ],
        "leeway": _summary_of_objects(case),
        "inputs": [input_file(path) for path in case.inputs],
        "coast": {
            "source": where.coast.source if where.coast else "none",
            "notes": list(where.notes),
        },
        "wall_time_s": seconds,
    }
