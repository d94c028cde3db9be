"""The models of motion by name, and what a run's scenarios have of them."""

from collections.abc import Iterable

from drift.engine.motion import own_model
from drift.engine.motion.drift import DRIFT
from drift.engine.motion.forcing_error import Errors
from drift.engine.motion.model import Model, Motion
from drift.engine.motion.own_motion import OwnMotion
from drift.engine.motion.period import Period
from drift.engine.motion.scenario import Scenario
from drift.engine.motion.steering import steer
from drift.engine.motion.steering.itinerary import Itinerary
from drift.engine.motion.steering.steer import Steering
from drift.engine.particles.ensemble import Column

MODELS: dict[str, Model] = {"drift": DRIFT}


def model_of(scenario: Scenario) -> Model:
    """Return the model by which a scenario's object moves once it is adrift."""
    return (
        own_model.model(scenario.motion)
        if isinstance(scenario.motion, OwnMotion)
        else MODELS[scenario.model]
    )


def forced(scenarios: Iterable[Scenario]) -> bool:
    """Return whether all of some scenarios move with currents and winds alone, and are lost without
    them.
    """
    return all(_feels(s.itinerary) if s.itinerary else model_of(s).forced for s in scenarios)


def _feels(itinerary: Itinerary) -> bool:
    return itinerary.currents == "felt"


def columns(scenarios: Iterable[Scenario]) -> tuple[Column, ...]:
    """Return the columns that particles of some scenarios have besides the core, each once."""
    every = [
        column
        for s in scenarios
        for column in (*model_of(s).columns, *(steer.COLUMNS if s.itinerary else ()))
    ]
    return tuple({column.name: column for column in every}.values())


def motions(errors: Errors, scenarios: Iterable[Scenario]) -> tuple[Motion, ...]:
    """Return how the objects of each scenario move."""
    return tuple(
        Motion(model := model_of(scenario), model.terms(errors, scenario)) for scenario in scenarios
    )


def steering(scenarios: Iterable[Scenario], period: Period, errors: Errors) -> Steering | None:
    """Return how scenarios steer before they go adrift; None: none does."""
    return steer.steering([scenario.itinerary for scenario in scenarios], period, errors.current)
