"""The motion models by name, and the models, columns and steering of a run's scenarios."""

from collections.abc import Iterable

from drift.engine.motion import changes
from drift.engine.motion.errors.forcing_error import Errors
from drift.engine.motion.models import own_model
from drift.engine.motion.models.drift import DRIFT
from drift.engine.motion.models.model import Model, Motion
from drift.engine.motion.models.own_motion import OwnMotion
from drift.engine.motion.period import Period
from drift.engine.motion.scenario import Scenario
from drift.engine.motion.steering import steer
from drift.engine.motion.steering.itinerary import Itinerary
from drift.engine.motion.steering.steer import Steering
from drift.engine.particles.ensemble import Column

MODELS: dict[str, Model] = {"drift": DRIFT}


def model_of(scenario: Scenario) -> Model:
    """Return the motion model of a scenario's object once it is adrift."""
    return (
        own_model.model(scenario.motion)
        if isinstance(scenario.motion, OwnMotion)
        else MODELS[scenario.model]
    )


def forced(scenarios: Iterable[Scenario]) -> bool:
    """Return whether all given scenarios move only with currents and winds, and are lost without
    them.
    """
    return all(_feels(s.itinerary) if s.itinerary else model_of(s).forced for s in scenarios)


def _feels(itinerary: Itinerary) -> bool:
    return itinerary.currents == "felt"


def columns(scenarios: Iterable[Scenario]) -> tuple[Column, ...]:
    """Return the columns of the scenarios' models besides CORE, each once."""
    every = [
        column
        for s in scenarios
        for column in (
            *model_of(s).columns,
            *changes.columns(s.changes),
            *(steer.COLUMNS if s.itinerary else ()),
        )
    ]
    return tuple({column.name: column for column in every}.values())


def motions(errors: Errors, scenarios: Iterable[Scenario]) -> tuple[Motion, ...]:
    """Return the motion of each scenario's objects."""
    return tuple(
        Motion(model := model_of(scenario), model.terms(errors, scenario)) for scenario in scenarios
    )


def steering(scenarios: Iterable[Scenario], period: Period, errors: Errors) -> Steering | None:
    """Return the itineraries that scenarios follow before they go adrift; None if no scenario
    steers.
    """
    return steer.steering([scenario.itinerary for scenario in scenarios], period, errors.current)
