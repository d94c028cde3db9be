"""Detection keys of sorties and units: detection function, sweep width, range zones.

A sweep width is one length, one for each scenario by name, or the conditions with which the
published tables give it for each scenario's search_object.
"""

import difflib
import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, PlainValidator, model_validator

from drift.case.values import fields, units
from drift.engine.motion.scenario import Scenario
from drift.evidence.filter.detection import laws, sweep_width
from drift.evidence.filter.records import Law, Watch
from geo import notation
from geo.errors import UserError
from geo.notation import NMI

EXAMPLE = 'search_object = "Raft 4 person"'
VISUAL = "visual"  # the sensor of the sweep width tables
SENSORS = (VISUAL, "radar", "infrared", "nvg", "sonar", "beacon", "other")


def _sensor(value: object) -> str:
    name = str(value).strip().lower()
    if name not in SENSORS:
        near = difflib.get_close_matches(name, SENSORS, n=1)
        hint = f'did you mean "{near[0]}"? ' if near else ""
        raise ValueError(f'no sensor "{value}"; {hint}Allowed: {", ".join(SENSORS)}')
    return name


Sensor = Annotated[str, BeforeValidator(_sensor)]
MOST_WIDTH = 200 * NMI  # [m]
# largest standard deviation as a share of the width: 16 quadrature nodes cover no wider tail
MOST_UNKNOWN = 1.0


def _length(value: object) -> float:
    number = units.quantity(value, "m", "distance", "1 nmi")
    if not 0 <= number <= fields.HALF_TURN:
        raise ValueError(
            f"distance {value!r} must be at least 0 m and at most half the way round the Earth"
        )
    return number


def probability(value: object, what: str = "POD") -> float:
    """Return a probability, given as a number or a percentage.

    Args:
        value: the value as written.
        what: kind of probability, for the message.
    """
    number = units.quantity(value, "", what, "0.6")
    if not 0 <= number <= 1:
        raise ValueError(f"{what} {value!r} must be a probability, 0 to 1")
    return number


def _law(value: object) -> Law:
    if isinstance(value, Law):
        return value
    plain = [kind for kind in laws.LAWS if kind not in WITH_NUMBERS]
    if isinstance(value, str) and value in plain:
        return Law(value)
    if isinstance(value, dict) and len(value) == 1:
        ((kind, given),) = value.items()
        if kind in WITH_NUMBERS:
            read, _ = WITH_NUMBERS[kind]
            return read(given)
    near = difflib.get_close_matches(str(value), plain, n=1, cutoff=0.5)
    hint = f'did you mean "{near[0]}"? ' if near and isinstance(value, str) else ""
    allowed = ", ".join(
        [f'"{kind}"' for kind in plain] + [example for _, example in WITH_NUMBERS.values()]
    )
    raise ValueError(f"no detection function {value!r}; {hint}Allowed: {allowed}")


def _m_beta(value: object) -> Law:
    beta = probability(value, "m_beta")
    if beta == 0:
        raise ValueError("m_beta = 0 never detects; m_beta is the POD within the maximum range")
    return Law("m_beta", beta=beta)


def _curve(value: object) -> Law:
    if (
        not isinstance(value, list)
        or len(value) < 2
        or not all(isinstance(row, list) and len(row) == 2 for row in value)
    ):
        raise ValueError(
            'curve needs two or more rows of lateral range and chance of detection, like ["1 nmi", 0.4]'
        )
    ranges = tuple(_length(row[0]) for row in value)
    chances = tuple(probability(row[1], "chance of detection") for row in value)
    if ranges[0] != 0:
        raise ValueError(f"curve begins at {value[0][0]!r}; its first lateral range must be 0")
    for k, (near, far) in enumerate(itertools.pairwise(ranges)):
        if far <= near:
            raise ValueError(f"curve: {value[k + 1][0]!r} does not come after {value[k][0]!r}")
    if max(chances) == 0:
        raise ValueError("curve detects nothing at any range")
    return Law("curve", ranges=ranges, chances=chances)


WITH_NUMBERS = {  # detection functions with parameters: their parser and an example
    "m_beta": (_m_beta, "{ m_beta = 0.8 }"),
    "curve": (_curve, '{ curve = [["0 nmi", 0.9], ["1 nmi", 0.4]] }'),
}


class ConditionsTable(fields.Table):
    """Conditions for the sweep width tables: visibility, altitude, weather and fatigue."""

    visibility: Annotated[fields.Length, Field(gt=0)]
    altitude: fields.Length | None = None
    wind: fields.WindSpeed | None = None
    seas: fields.Length | None = None
    fatigue: bool = False

    @model_validator(mode="after")
    def weather(self) -> "ConditionsTable":
        """Reject missing weather: fair weather has up to four times the sweep width of bad
        weather."""
        if self.wind is None and self.seas is None:
            raise ValueError(
                'wind or seas is missing: bad weather reduces the sweep width to a quarter; give for example wind = "12 kn"'
            )
        return self


def _width(value: object) -> Any:
    """Return a sweep width [m], sweep widths by scenario, or conditions for the tables."""
    if not isinstance(value, dict):
        return _one_width(value)
    if set(value) & set(ConditionsTable.model_fields):
        return ConditionsTable.model_validate(value)
    if not value:
        raise ValueError(
            "is empty; give a length, one for each scenario, or { visibility = .., wind = .. } for the tables"
        )
    return {str(name): _one_width(width, least=0.0) for name, width in value.items()}


def _one_width(value: object, least: float = 10.0) -> float:
    number = units.quantity(value, "m", "sweep width", "1.2 nmi")
    if not (least <= number <= MOST_WIDTH and not 0 < number < 10):
        raise ValueError(
            f'sweep width {value!r} must be 10 m to {MOST_WIDTH / NMI:g} nmi; write its unit, like "1.2 nmi"'
            + (
                ""
                if least == 0
                else "; 0 is allowed in a table by scenario, for an object that cannot be seen"
            )
        )
    return number


CERTAIN = 1e-6  # share of a sweep width; a smaller uncertainty counts as 0


def _unknown(value: object) -> float:
    share = units.quantity(value, "", "share", "30 %")
    if not 0 <= share <= MOST_UNKNOWN:
        raise ValueError(
            f"{value!r} must be a standard deviation as a share of the sweep width, 0 to {notation.hundredths(MOST_UNKNOWN)} %"
        )
    return share


def _kind(value: object) -> object:
    if isinstance(value, str):
        try:
            return sweep_width.find_kind(value)
        except UserError:
            kinds = ", ".join(f'"{kind}"' for kind in sweep_width.KINDS)
            raise ValueError(
                f'no kind of unit "{value}"; allowed: {kinds}; for other units leave it out, and name their sensor'
            ) from None
    return value


Kind = Annotated[str, BeforeValidator(_kind)]


class SensorTable(fields.Table):
    """Keys of sorties and units on their detection of the search object."""

    sensor: Sensor = VISUAL
    law: Annotated[Law, BeforeValidator(_law)] = Law()
    sweep_width: Annotated[Any, PlainValidator(_width)] = None
    sweep_width_under_way: Annotated[Any, PlainValidator(_width)] = None
    sweep_width_uncertainty: Annotated[float, BeforeValidator(_unknown)] = 0.0
    sweep_group: fields.Label | None = None
    altitude: fields.Length | None = None

    def shape(self) -> float:
        """Return the shape of the sweep width's unknown factor: gamma, mean 1, variance 1 /
        shape."""
        return (
            1 / self.sweep_width_uncertainty**2
            if self.sweep_width_uncertainty >= CERTAIN
            else math.inf
        )

    def group(self, kind: str) -> str:
        """Return the name of the group that shares the unknown factor of the sweep width.

        By default a group is one kind of unit, sensor and uncertainty.
        """
        shape = self.shape()
        unsure = "" if math.isinf(shape) else f", {100 / math.sqrt(shape):.3g} %"
        return self.sweep_group or f"{kind} {self.sensor}{unsure}".strip()

    def height(self) -> float:
        """Return the altitude [m]; NaN if it is not given."""
        altitude = self.altitude
        if altitude is None and isinstance(self.sweep_width, ConditionsTable):
            altitude = self.sweep_width.altitude
        return math.nan if altitude is None else altitude

    def widths(self, kind: str, speed: float, scenarios: Sequence[Scenario]) -> tuple[float, ...]:
        """Return the sweep width [m] for each scenario.

        A lateral range curve has its own sweep width.

        Args:
            kind: kind of unit, "" if not given.
            speed: search speed [m/s], NaN if not given.
            scenarios: the scenarios of the case.

        Raises:
            ValueError: keys are missing or inconsistent.
        """
        given, own = self.sweep_width, laws.formulas_of(self.law).width
        if given is None and own is not None:
            return (own(self.law),) * len(scenarios)
        if given is None:
            raise ValueError(
                "sweep_width is missing; give a length, one for each scenario, or { visibility = .., wind = .. } for "
                "the tables"
            )
        if isinstance(given, ConditionsTable):
            return tuple(self._tabulated(given, kind, speed, scenario) for scenario in scenarios)
        if isinstance(given, dict):
            return values_by_scenario(given, scenarios, "sweep_width")
        if own is not None and not math.isclose(given, swept := own(self.law), rel_tol=0.02):
            raise ValueError(
                f"sweep_width is {given / NMI:.3g} nmi, but the curve sweeps {swept / NMI:.3g} nmi (twice its "
                "integral); leave sweep_width out, or give one for each scenario, to which the curve is stretched"
            )
        return (float(given),) * len(scenarios)

    def widths_under_way(
        self, kind: str, speed: float, scenarios: Sequence[Scenario]
    ) -> tuple[float, ...]:
        """Return the sweep width [m] of each scenario's vessel under way; () if none steers.

        It is `sweep_width_under_way`; else with the tables that of the vessel's search object; else
        the same as adrift.

        Args:
            kind: kind of unit, "" if not given.
            speed: search speed [m/s], NaN if not given.
            scenarios: the scenarios of the case.

        Raises:
            ValueError: keys are missing or inconsistent.
        """
        given = self.sweep_width_under_way
        steer = [scenario.itinerary is not None for scenario in scenarios]
        if not any(steer):
            if given is not None:
                raise ValueError(
                    "sweep_width_under_way: no scenario is under way; leave it out, or add [[scenario.phase]]"
                )
            return ()
        if given is None and not isinstance(self.sweep_width, ConditionsTable):
            return self.widths(kind, speed, scenarios)
        under_way = [
            replace(
                scenario, search_object=scenario.itinerary.search_object or scenario.search_object
            )
            if scenario.itinerary
            else scenario
            for scenario in scenarios
        ]
        table = self if given is None else self.model_copy(update={"sweep_width": given})
        return table.widths(kind, speed, under_way)

    @property
    def _by_tables(self) -> bool:
        """Whether the sweep width comes from the tables."""
        return isinstance(self.sweep_width, ConditionsTable)

    def _tabulated(
        self, seen: ConditionsTable, kind: str, speed: float, scenario: Scenario
    ) -> float:
        if self.sensor != VISUAL:
            raise ValueError(
                f'sweep_width: the tables apply to visual search, not to sensor "{self.sensor}"; give a length'
            )
        if not kind:
            kinds = ", ".join(sweep_width.KINDS)
            raise ValueError(f"the sweep width tables need the kind of unit: {kinds}")
        if scenario.search_object is None:
            stays = scenario.itinerary is not None and scenario.itinerary.distress is None
            raise ValueError(
                f'the sweep width tables need search_object in scenario "{scenario.name}", '
                + (
                    f"which stays under way: there write vessel = {{ {EXAMPLE} }}"
                    if stays
                    else f"like {EXAMPLE}"
                )
                + "; or give sweep_width as a length here"
            )
        altitude = self.height()
        if math.isnan(altitude):
            if kind != "Boat":
                raise ValueError(
                    f'the sweep width tables of {kind} need altitude, like altitude = "500 ft"'
                )
            altitude = 8 * sweep_width.FOOT  # height of eye in a small boat
        given = sweep_width.Conditions(
            seen.visibility, altitude, speed, seen.wind, seen.seas, seen.fatigue
        )
        try:
            return sweep_width.width(scenario.search_object, kind, given)
        except UserError as error:
            raise ValueError(f"sweep_width: {error}") from None


def values_by_scenario(
    given: dict[str, float], scenarios: Sequence[Scenario], key: str
) -> tuple[float, ...]:
    """Return the values of a table by scenario, in the order of the scenarios.

    Args:
        given: values by the name of a scenario or of a family.
        scenarios: the scenarios of the case.
        key: key of the table, for messages.

    Raises:
        ValueError: a scenario is missing, or a name is unknown.
    """
    names = [scenario.name for scenario in scenarios]
    places = {
        scenario.name: scenario.family for scenario in scenarios if scenario.family is not None
    }
    families = dict.fromkeys(place.family.name for place in places.values())
    called = [*families, *names]
    for name in given:
        if name not in called:
            near = difflib.get_close_matches(name, called, n=1, cutoff=0.5)
            hint = f'did you mean "{near[0]}"? ' if near else ""
            there = ", ".join(
                dict.fromkeys([*families, *(name for name in names if name not in places)])
            )
            raise ValueError(f'{key}: no scenario "{name}"; {hint}there are: {there}')
    keys = [
        name if name in given or name not in places else places[name].family.name for name in names
    ]
    missing = [own for own in keys if own not in given]
    if missing:
        what = "family" if missing[0] in families else "scenario"
        raise ValueError(
            f'{key} lacks {what} "{missing[0]}"; give one for each, 0 for an object that cannot be seen'
        )
    return tuple(given[own] for own in keys)


def _zone(row: object) -> tuple[float, float, float]:
    if not isinstance(row, list | tuple) or len(row) != 3:
        raise ValueError(
            f'{row!r} is not a zone; write [inner range, outer range, POD], like ["28 nmi", "32 nmi", 0.6]'
        )
    inner, outer, pod = _length(row[0]), _length(row[1]), probability(row[2])
    if outer <= inner:
        raise ValueError(
            f"zone from {row[0]!r} to {row[1]!r} must go from its inner to its outer range"
        )
    if pod == 0:
        raise ValueError(
            f"zone from {row[0]!r} to {row[1]!r} has a POD of 0; leave it out: the POD is 0 outside all zones"
        )
    return inner, outer, pod


def _zones(value: object) -> Watch:
    if not isinstance(value, list) or not value:
        raise ValueError(
            'must be a list of zones, like [["0 nmi", "5 nmi", 0.8], ["28 nmi", "32 nmi", 0.6]]'
        )
    rows = sorted(_zone(row) for row in value)
    for (_, outer, _), (inner, _, _) in itertools.pairwise(rows):
        if inner < outer:
            raise ValueError(
                f"two zones overlap between {inner / NMI:g} and {outer / NMI:g} nmi; each range has one POD"
            )
    return Watch(*(tuple(row[k] for row in rows) for k in range(3)))


Zones = Annotated[Watch, BeforeValidator(_zones)]
Pod = Annotated[
    Any,
    PlainValidator(
        lambda value: (
            {str(name): probability(pod) for name, pod in value.items()}
            if isinstance(value, dict)
            else probability(value)
        )
    ),
]
