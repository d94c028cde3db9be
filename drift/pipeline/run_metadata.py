"""What a run says about itself besides its forecast: numbers, attributes of files, words on
pictures.
"""

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
from drift.engine.motion import forcing_error
from drift.engine.motion.scenario import Scenario
from drift.engine.particles.status import Status
from drift.forecast import likeliest
from drift.forecast.likeliest import Shown
from drift.forecast.starts import others, starts
from drift.forecast.survey import Survey
from drift.pipeline.run_setup import Setup
from drift.products.files import formats
from drift.products.files.chapter import Chapter
from drift.products.maps.imprint import Imprint, Setting
from drift.products.report import leaves
from drift.products.report.leaves import Leaf
from geo import notation
from geo.files import digest
from kernels.runtime import runtime

LAND = {  # what land means to a target under way, in words
    "refuse": "lanes, voyages and areas that touch land are rejected",
    "stop": "what meets the shore under way runs aground there",
    "ignore": "ways lead over land",
}


def attributes(case: Case, where: Environment) -> dict[str, str]:
    """Return what every file carries: the case, the seed, versions, and what the forcing was."""
    return {
        "title": case.title,
        "source": f"casp-drift {version.__version__}",
        "versions": version.told(),
        "seed": str(case.seed),
        **runtime.about(),
        "forcing": "; ".join(f"{s.quantity} {s.name}: {s.fingerprint}" for s in where.sources),
        "coast": where.coast.source if where.coast else "none",
        "uncertainty": errors(case),
        "case": case.text,
        **case.about,
        **({"caution": words} if (words := caution(case)) else {}),
    }


def chapter(case: Case, facts: Mapping[str, str], numbers: Mapping[str, Any]) -> Chapter:
    """Return the chapter of a run itself; facts: its attributes; numbers: of its summary."""
    told = (partial(_leaves, case, numbers),)
    return Chapter(numbers, leaves=told, facts=facts, warnings=tuple(numbers["warnings"]))


def _leaves(case: Case, numbers: Mapping[str, Any]) -> list[Any]:
    """Return what the report shows of how a case was understood."""
    run = numbers["run"]
    rows = [
        [
            "Run",
            f"{run['start']}Z to {run['end']}Z, {run['particles']:,} particles, seed {run['seed']}, "
            f"{run['backend']}{f': {device}' if (device := run.get('device')) else ''}",
        ],
        ["Step", f"{run['scheme']}, {run['step_s']} s"],
        ["Errors", numbers["uncertainty"]["told"] or "none that anything feels"],
        ["Coast", f"{numbers['coast']['source']}; {run['coast_behaviour']}"],
        *(["Coast", note] for note in numbers["coast"]["notes"]),
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
        written(case),
    ]


def written(case: Case) -> Leaf:
    """Return the case as the report shows it."""
    return leaves.text_leaf("The case as it was written", words=case.text)


def setting(case: Case, where: Environment, shown: Shown | None = None) -> Setting:
    """Return what every chart of a run shows, and what stands on it.

    shown: scenarios whose beginnings are drawn and named, by default the likeliest beforehand.
    """
    source = attributes(case, where)
    known_as, short = (
        ("Position at start", "start") if case.direction < 0 else ("Last known position", "LKP")
    )
    stories = case.scenarios
    if case.spill:  # its classes of objects were released together
        known_as, short, stories = (
            "Release",
            "release",
            (replace(case.scenarios[0], name="release"),),
        )
    if shown is None or case.spill:
        shown = likeliest.likeliest_scenarios([scenario.weight for scenario in stories])
    marks, lines = starts(stories, known_as, short, shown)
    return Setting(
        Imprint(
            case.title,
            # The errors come first: without them an area means nothing.
            f"{_errors_first(source['uncertainty'])}{source['source']}, seed {source['seed']}",
            {**source, "run_id": formats.run_id(source)},
            caution(case),
        ),
        coastline.lands(where.coast, case.coast),
        marks,
        lines,
        others(stories, shown),
        known_as,
        case.particles,
        case.opens,
        [partial(_itineraries, stories)] if any(scenario.itinerary for scenario in stories) else (),
    )


def _itineraries(scenarios: Sequence[Scenario], now: Any) -> Any:
    """Return what is drawn of itineraries on a map, of any time: a
    drift.products.maps.overlay.Overlay.
    """
    from drift.engine.environment import layers  # imported here, for Matplotlib takes a second

    return layers.itineraries(scenarios)


def with_coast(on: Setting) -> Setting:
    """Return it with the source of the coast in the line at the foot."""
    imprint = on.imprint
    return replace(
        on,
        imprint=replace(imprint, footer=f"{imprint.footer}, coast {imprint.attributes['coast']}"),
    )


def changed(case: Case, where: Environment, before: Mapping[str, Any]) -> list[str]:
    """Return what of a run is not as in the summary of one before, in words; empty where that is of
    exactly this run.
    """
    of = attributes(case, where)
    now: dict[str, Any] = {
        name: of.get(name) for name in ("case", "seed", "versions", "backend", "device", "coast")
    }
    now["forcing"] = [
        [source.quantity, source.name, source.fingerprint] for source in where.sources
    ]
    # changed in Python it may have the text of another
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


def synthetic(case: Case) -> bool:
    """Whether winds or currents are made up."""
    return any(spec.analytic is not None for spec in case.sources)


def caution(case: Case) -> str:
    """Return the banner of every picture: made-up winds or currents, else errors that were switched
    off.
    """
    if synthetic(case):
        return "SYNTHETIC wind or current: not for operations"
    felt = any(scenario.object.uses_wind for scenario in case.scenarios)
    return forcing_error.switched_off(case.current_error, case.wind_error if felt else None)


def _errors_first(told: str) -> str:
    return f"Errors: {told}. " if told else ""


def drifts(case: Case) -> bool:
    """Whether anything drifts: what steers and never goes adrift feels no wind, and a current only
    if it is told to.
    """
    return any(contact.drifter is not None for contact in case.contacts) or any(
        scenario.itinerary is None or scenario.itinerary.distress is not None
        for scenario in case.scenarios
    )


def errors(case: Case) -> str:
    """Return which errors of current and wind a run has, in a line, and who says so; "" where
    nothing feels them.
    """
    adrift = drifts(case)
    if not (
        adrift
        or any(s.itinerary is not None and s.itinerary.currents == "felt" for s in case.scenarios)
    ):
        return ""
    wind = case.wind_error if adrift and case.forcing["wind"] else None
    told = forcing_error.errors_in_words(
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
        f"{told}; added to the spread of the members of the {' and of the '.join(both)}"
        if both
        else told
    )


def behaviour(case: Case) -> str:
    """Return what the coast does, in words."""
    coast = case.coast
    if coast.source == "none":
        return "none: particles pass over land"
    steering = [scenario.itinerary for scenario in case.scenarios if scenario.itinerary is not None]
    ways = dict.fromkeys(LAND[itinerary.land] for itinerary in steering)
    if any(itinerary.land == "refuse" and itinerary.currents == "felt" for itinerary in steering):
        ways |= dict.fromkeys([LAND["stop"]])
    if not drifts(case):
        return "; ".join(ways)
    return "; ".join([_strands(coast), *(f"under way: {words}" for words in ways)])


def _strands(coast: Coast) -> str:
    if coast.behaviour == "slide":
        return "slide: particles that reach the shore move on along it"
    if coast.behaviour == "refloat":
        return (
            f"refloat: stranded particles are afloat again with a half-life of {notation.number(coast.half_life / 3600)} h, once its drift "
            f"leads off the beach, {notation.number(coast.offing)} m off it"
        )
    return "strand: particles that reach the shore stay there"


def input_file(path: str) -> dict[str, Any]:
    """Return the path, size and digest of an input file, so that a damaged or exchanged one shows."""
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
    """Return the numbers of a run that are not in its forecast; end: its particles at its end."""
    # Sums of as many weights are 1 to rounding; readers are spared that.
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
            "coast_behaviour": behaviour(case),
            **runtime.about(),
        },
        "uncertainty": {
            "told": errors(case),
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
        "inputs": [input_file(path) for path in case.inputs],
        "coast": {
            "source": where.coast.source if where.coast else "none",
            "notes": list(where.notes),
        },
        "wall_time_s": seconds,
    }
