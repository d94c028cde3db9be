"""Motion at its limits: next to a pole, across the antimeridian, where forcing ends or cannot be
read, inside a step.
"""

import numpy as np
import pytest
import shapely
from scipy.integrate import solve_ivp

from drift.engine.motion import simulate
from drift.engine.motion.clock import Clock
from drift.engine.motion.forcing import Forcing, Sources
from drift.engine.motion.models.drift import COLUMNS, DRIFT
from drift.engine.motion.models.model import Motion
from drift.engine.motion.scene import Scene
from drift.engine.particles import ensemble as record
from drift.engine.particles.status import Status
from geo import sphere
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast.shore import Shore
from geo.forcing import sources
from kernels.step import advance as kernel
from kernels.step import coast as device_coast

EVERYWHERE = kernel.Domain(-(2**31), -(2**30), 2**32 - 1, 2**31)
T0 = 1_795_000_000 // 86_400 * 86_400  # [s since 1970] a midnight in November 2026
STILL = kernel.Physics()


def ensemble_at(lon: float, lat: float, release: list[int]) -> record.Ensemble:
    ensemble = record.empty(5, (0, len(release)), COLUMNS)
    ensemble.lon.fill(int(sphere.to_binary(lon)))
    ensemble.lat.fill(int(sphere.to_binary(lat)))
    ensemble.release.from_numpy(np.array(release, np.int32))
    return ensemble


def world(
    current: sources.Source,
    direction: int = 1,
    physics: kernel.Physics = STILL,
    coast=None,
    domain=EVERYWHERE,
):
    return Scene(
        Forcing([Sources({"current": (current,)})], direction),
        (Motion(DRIFT, physics),),
        kernel.Surroundings(domain, coast),
    )


@pytest.mark.parametrize(
    ("lat", "east", "north"), [(88.9, 1.0, 0.0), (-88.9, 0.5, -0.02), (88.0, 2.0, 0.1)]
)
def test_steps_of_an_hour_close_to_the_pole(lat: float, east: float, north: float) -> None:
    """Against Dormand and Prince in float64, across the antimeridian: 12 roundings of 5 mm and
    float32 steps.
    """
    ensemble = ensemble_at(179.9, lat, [0])
    (end,) = simulate.run(
        ensemble,
        world(sources.constant_field("current", east, north)),
        Clock(T0, 43_200, 1, 3600),
        np.array([43_200]),
    )
    exact = solve_ivp(
        lambda t, y: [east / (sphere.RADIUS * np.cos(y[1])), north / sphere.RADIUS],
        (0, 43_200),
        np.radians([179.9, lat]),
        "DOP853",
        rtol=1e-12,
        atol=1e-15,
    ).y[:, -1]
    assert sphere.distance(*exact, end.lon[0] * sphere.UNIT, end.lat[0] * sphere.UNIT) < 0.1


@pytest.mark.parametrize("direction", [1, -1])
def test_every_output_before_and_after_the_end_of_the_forcing(direction: int) -> None:
    """Uniform flow: position is speed times time from release to the end of the last step that has
    forcing.
    """
    times = (T0 + np.array([-20_000, 20_000])).astype("datetime64[s]")
    source = sources.uniform_field("current", times, [1.0, 1.0], [0.0, 0.0])
    release = np.array([0, 100, 3000, 5000])
    ensemble = ensemble_at(0.0, 0.0, release.tolist())
    outputs = np.arange(0, 25_001, 250)
    moments = list(
        simulate.run(
            ensemble, world(source, direction), Clock(T0 + 417, 25_000, direction, 900), outputs
        )
    )
    ended = ensemble.status_since.to_numpy()
    assert (np.abs(ended - (20_000 - 417 * direction)) < 900).all()
    lasted = np.maximum(np.minimum(outputs[:, None], ended) - release, 0)
    way = direction * sphere.RADIUS * sphere.UNIT * np.array([m.lon for m in moments])
    assert way == pytest.approx(lasted, abs=0.5)
    outside = np.array([m.status for m in moments]) == Status.OUTSIDE
    assert (outside == (outputs[:, None] >= ended)).all()


def test_a_slice_that_cannot_be_read_stops_the_run_and_only_where_it_is_needed() -> None:
    def read(i: int) -> np.ndarray:
        if i == 3:
            raise OSError("slice 3 is broken")
        return np.ones((2, 2, 2), np.float32)

    times = (T0 + 3600 * np.arange(6)).astype("datetime64[s]")
    source = sources.Source("current", "x", sources.EVERYWHERE, times, read, 0.0, (), "")
    place = world(source)
    list(simulate.run(ensemble_at(0, 0, [0]), place, Clock(T0, 7200, 1, 600), np.array([7200])))
    with pytest.raises(OSError, match="slice 3"):
        list(
            simulate.run(
                ensemble_at(0, 0, [0]), place, Clock(T0, 14_400, 1, 600), np.array([14_400])
            )
        )
    place.forcing.close()


@pytest.mark.thorough
def test_nobody_inland_where_land_lies_across_the_antimeridian() -> None:
    land = [shapely.box(178, -5, 180, 5), shapely.box(-180, -5, -178, 5)]
    box = Box(-180, -80, 180, 88)
    coast = shoreline.build_coast(Shore(np.array(land), "test", (), box), box)
    rng = np.random.default_rng(0)
    lon, lat = (
        sphere.to_binary(180 + rng.uniform(-5, 5, 5000)),
        sphere.to_binary(rng.uniform(-8, 8, 5000)),
    )
    wet = ~shoreline.is_land(coast, lon, lat)
    ensemble = record.empty(3, (0, int(wet.sum())), COLUMNS)
    ensemble.lon.from_numpy(lon[wet])
    ensemble.lat.from_numpy(lat[wet])
    place = world(
        sources.constant_field("current", 1.0, -0.5),
        physics=kernel.Physics(diffusivity=2000.0),
        coast=device_coast.upload(coast),
    )
    for moment in simulate.run(
        ensemble, place, Clock(T0, 172_800, 1, 21_600), np.array([40_000, 172_800])
    ):
        x, y = (np.asarray(sphere.to_degrees(a)) for a in (moment.lon, moment.lat))
        assert not shapely.contains_properly(shapely.union_all(land), shapely.points(x, y)).any()
    assert (ensemble.status.to_numpy() == Status.ASHORE).sum() > 300


def test_the_account_is_of_the_end_of_the_run() -> None:
    """1 m/s for 4000 s does not leave a box whose edge is 5000 m away."""
    edge = round(5000 / (sphere.UNIT * sphere.RADIUS))
    box = kernel.Domain(
        int(sphere.to_binary(-1)), int(sphere.to_binary(-1)), edge + int(sphere.to_binary(1)), 2**24
    )
    ensemble = ensemble_at(0.0, 0.0, [0])
    place = world(sources.constant_field("current", 1.0, 0.0), domain=box)
    (end,) = simulate.run(ensemble, place, Clock(T0, 4000, 1, 3600), np.array([4000]))
    assert end.status[0] == Status.ADRIFT


def test_the_spread_at_an_output_inside_a_step() -> None:
    """2 D t at any t, not only on the lattice; 20,000 draws: 1 % standard error, 5 % allowed."""
    lon, lat = -179.99, 61.0
    ensemble = ensemble_at(lon, lat, [0] * 20_000)
    place = world(
        sources.constant_field("current", 0.0, 0.0), physics=kernel.Physics(diffusivity=100.0)
    )
    (early,) = simulate.run(ensemble, place, Clock(T0, 3600, 1, 3600), np.array([600]))
    way = np.array(
        sphere.offset(*np.radians([lon, lat]), early.lon * sphere.UNIT, early.lat * sphere.UNIT)
    )
    assert way.var(axis=1) == pytest.approx(2 * 100 * 600, rel=0.05)
    assert abs(np.corrcoef(way)[0, 1]) < 4.5 / np.sqrt(20_000)
