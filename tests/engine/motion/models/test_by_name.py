"""Models of motion: a second one, in closed form, moves beside drift; columns of both are copied;
each knows its own particles inside a step.
"""

import numpy as np
import pytest

from drift.engine.motion import simulate
from drift.engine.motion.clock import Clock
from drift.engine.motion.forcing import Forcing, Sources
from drift.engine.motion.models.by_name import MODELS
from drift.engine.motion.models.drift import COLUMNS, DRIFT
from drift.engine.motion.models.model import Group, Model, Motion
from drift.engine.motion.scene import Scene
from drift.engine.particles import ensemble as record
from drift.engine.particles.ensemble import Column, Ensemble
from drift.engine.particles.status import Status
from geo import sphere
from geo.forcing import sources
from kernels.step import advance as kernel
from kernels.step.bridge import Inside

EVERYWHERE = kernel.Domain(-(2**31), -(2**30), 2**32 - 1, 2**31)
SPEED = Column("speed", np.float32, 3.0, "m/s", "toward the north")
METRES = sphere.RADIUS * sphere.UNIT  # of a unit of latitude


def mover(
    ensemble: Ensemble, group: Group, waters: object, direction: int, bend: object
) -> kernel.Move:
    """Move particles north at their own speed times the terms: a model without noise, forcing or
    coast.
    """

    def move(step: kernel.Step, count: int = 1) -> None:
        lat, speed = ensemble.lat.to_numpy(), ensemble.own["speed"].to_numpy()
        own = slice(group.batch.first, group.batch.last)
        lat[own] += np.rint(
            direction * group.terms[0] * speed[own] * count * step.duration / METRES
        ).astype(np.int32)
        ensemble.lat.from_numpy(lat)
        status = ensemble.status.to_numpy()
        status[own] = Status.ADRIFT
        ensemble.status.from_numpy(status)

    return move


def between(ensemble: Ensemble, terms: object, place: kernel.Surroundings, inside: Inside) -> None:
    """Leave it where it was first: this model stays till the end of a step, and leaps."""


NORTH = Model(
    False, (SPEED,), lambda errors, scenario: 1.0, lambda *given: None, mover, between, lambda errors: {}, lambda *x: 9.0,
    lambda *x: 9.0,
)  # fmt: skip


@pytest.fixture
def both() -> tuple[Ensemble, Scene]:
    """Three particles that drift at 1 m/s to the east, and two that go north at 3 m/s and at 6 m/s."""
    ensemble = record.empty(5, (0, 3, 5), (*COLUMNS, SPEED))
    ensemble.own["speed"].from_numpy(np.array([0, 0, 0, 3, 6], np.float32))
    current = Sources({"current": (sources.constant_field("current", 1.0, 0.0),)})
    scene = Scene(
        Forcing([current, current], 1),
        (Motion(DRIFT, kernel.Physics()), Motion(NORTH, 1.5)),
        kernel.Surroundings(EVERYWHERE),
    )
    return ensemble, scene


def test_each_model_moves_its_own_particles(both: tuple[Ensemble, Scene]) -> None:
    ensemble, scene = both
    moments = list(simulate.run(ensemble, scene, Clock(0, 7200, 1, 3600), np.array([5400, 7200])))
    scene.forcing.close()
    for moment, drifted, gone in zip(moments, (5400, 7200), (3600, 7200), strict=True):
        # rounding: half a unit of 5 mm a step
        np.testing.assert_allclose(
            moment.lon * METRES, [drifted, drifted, drifted, 0, 0], atol=0.02
        )
        np.testing.assert_allclose(moment.lat * METRES, [0, 0, 0, 4.5 * gone, 9 * gone], atol=0.02)


def test_columns_of_all_models_are_copied(both: tuple[Ensemble, Scene]) -> None:
    ensemble, scene = both
    scene.forcing.close()
    few = record.sample(ensemble, np.array([1, 3, 4]))
    assert few.bounds == (0, 1, 3)
    assert few.numbers == (0, 1)
    assert set(few.columns) == {one.name for one in (*record.CORE, *COLUMNS, SPEED)}
    assert few.own["speed"].to_numpy().tolist() == [0, 3, 6]
    record.inherit(ensemble.columns.values(), np.array([0, 0, 2, 4, 4]))
    assert ensemble.own["speed"].to_numpy().tolist() == [0, 0, 0, 6, 6]
    assert few.own["speed"].to_numpy().tolist() == [0, 3, 6]  # a copy of its own


def test_first_values_are_those_of_the_columns() -> None:
    ensemble = record.empty(1, (0, 4), (SPEED,))
    for column in (*record.CORE, SPEED):
        values = ensemble.columns[column.name].to_numpy()
        assert values.dtype == column.dtype
        assert (values == np.array(column.first, column.dtype)).all()


def test_drift_is_the_model_of_a_scenario_that_says_nothing() -> None:
    assert MODELS["drift"] is DRIFT
    assert {column.name for column in DRIFT.columns} == set(kernel.OWN)
    assert {column.name for column in record.CORE} == {*kernel.CORE, "world"}
