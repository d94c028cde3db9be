"""Landings under diffusion, sliding, sinking and shared bias: closed forms."""

import numpy as np
import pytest
import shapely
from scipy import special, stats
from straight_shores import METRE, drift_on, jagged, land

from drift.engine.particles.status import Status
from drift.spills.worlds import release
from geo import sphere
from geo.coast import edges as shoreline
from kernels.step import advance as kernel


@pytest.mark.thorough
@pytest.mark.parametrize("step", [pytest.param(900, marks=pytest.mark.thorough), 3600])
def test_arrivals_with_diffusion_follow_the_inverse_gaussian_law(step: int) -> None:
    """Brownian motion with drift first meets a line at distance a after IG(a / u, a^2 / 2D)
    (Schroedinger 1915).

    In one step of an hour the walk spreads 850 m; without the bridge arrivals would come 490 m, 82
    min late.
    """
    away, speed, diffusivity, n = 5000.0, 0.1, 100.0, 40_000
    shore = land(jagged(0.004))
    ensemble, _ = drift_on(
        shore,
        (speed, 0.0),
        n,
        (-away * METRE, 0.1),
        600_000,
        step,
        physics=kernel.Physics(diffusivity=diffusivity),
    )
    status, ended = ensemble.status.to_numpy(), ensemble.status_since.to_numpy()
    mean, shape = away / speed, away**2 / (2 * diffusivity)
    law = stats.invgauss(mean / shape, scale=shape)
    arrived = np.where(status == Status.ASHORE, ended + 0.5, np.inf)
    assert (status == Status.ASHORE).mean() == pytest.approx(
        law.cdf(600_000), abs=4.5 * np.sqrt(0.25 / n)
    )
    times = np.sort(arrived[np.isfinite(arrived)])
    apart = np.abs(np.arange(1, times.size + 1) / n - law.cdf(times)).max()
    print(step, apart, times.mean() - mean)
    assert apart < 1.95 / np.sqrt(n)  # Kolmogorov's 0.1 % point
    assert not shoreline.is_land(shore, ensemble.lon.to_numpy(), ensemble.lat.to_numpy()).any()


@pytest.mark.parametrize(
    ("away", "speed", "lat"),
    [(800.0, 0.2, 0.1), (150.0, -0.02, 0.1), (1500.0, 0.4, -48.7), (150.0, -0.02, 67.3)],
)
def test_one_step_lands_by_the_inverse_gaussian_law(away: float, speed: float, lat: float) -> None:
    """Whether the shore is met within a single step of an hour, and when: near its begin, near its
    end, or by going over it.

    Brownian motion with drift u meets a line at distance a by time t with the distribution of an
    inverse Gaussian time; where the drift leads away, with that of its mirror times exp(2 a u /
    sigma^2).
    """
    n, dt, diffusivity = 100_000, 3600, 3.0  # a step's walk of 147 m
    shore = land(shapely.box(0, lat - 1.4, 1.4, lat + 1.4), lat=lat)
    west = -away * METRE / np.cos(np.radians(lat))
    ensemble, _ = drift_on(
        shore, (speed, 0.0), n, (west, lat), dt, dt, physics=kernel.Physics(diffusivity=diffusivity)
    )
    ashore = ensemble.status.to_numpy() == Status.ASHORE
    sigma2 = 2 * diffusivity
    shape, mean = away**2 / sigma2, away / abs(speed)
    law = stats.invgauss(mean / shape, scale=shape)
    share = law.cdf(dt) * (1.0 if speed > 0 else np.exp(2 * away * speed / sigma2))
    assert 0.02 < share < 0.98
    assert abs(ashore.mean() - share) < 4.5 * np.sqrt(share * (1 - share) / n)
    when = ensemble.status_since.to_numpy()[ashore] + 0.5  # whole seconds, cut
    assert (
        stats.kstest(when, lambda t: law.cdf(t) / law.cdf(dt)).statistic
        < 1.95 / np.sqrt(when.size) + 0.5 * 2 / dt
    )


def test_arrivals_do_not_depend_on_where_the_edges_of_a_straight_shore_end() -> None:
    """Noise being keyed by slot and step, one long edge and hundreds of short ones stop the same
    particles.
    """
    ends = []
    for edge in (1.0, 0.004):
        ensemble, _ = drift_on(
            land(jagged(edge)),
            (0.1, 0.02),
            5000,
            (-0.02, 0.1),
            86_400,
            1800,
            physics=kernel.Physics(diffusivity=50.0),
        )
        ends.append((ensemble.status.to_numpy(), ensemble.status_since.to_numpy()))
    assert (ends[0][0] == ends[1][0]).mean() > 0.999  # float32 near the threshold of a touch
    both = (ends[0][0] == Status.ASHORE) & (ends[1][0] == Status.ASHORE)
    assert np.abs(ends[0][1][both] - ends[1][1][both]).max() < 60


@pytest.mark.parametrize("step", [600, 1200, 3600])
def test_without_diffusion_arrivals_are_those_of_the_straight_way(step: int) -> None:
    shore = land(jagged(0.004))
    ensemble, _ = drift_on(shore, (0.25, 0.1), 4, (-0.05, -0.2), 86_400, step)
    assert (ensemble.status.to_numpy() == Status.ASHORE).all()
    assert ensemble.status_since.to_numpy() == pytest.approx(0.05 / METRE / 0.25, abs=2)
    lat = ensemble.lat.to_numpy() * (360 / sphere.TURN)
    assert lat == pytest.approx(-0.2 + 0.05 * 0.1 / 0.25, abs=2 * METRE)


@pytest.mark.parametrize("step", [pytest.param(900, marks=pytest.mark.thorough), 3600])
def test_sliding_follows_the_shore_at_the_drift_along_it(step: int) -> None:
    """A shore that leans 30 degrees: beyond the landing the way is the drift's part along it,
    whatever the step.
    """
    lean = np.radians(30)
    along = np.array([np.sin(lean), np.cos(lean)])
    ends = [(-1.3 * along[0], -1.3 * along[1]), (1.3 * along[0], 1.3 * along[1])]
    shore = land(
        shapely.Polygon([*ends, (1.4, 1.3 * along[1]), (1.4, -1.4), (-1.3 * along[0], -1.4)])
    )
    u, hours = np.array([0.3, 0.1]), 48
    start = np.array([-0.15, 0.1])
    ensemble, (end,) = drift_on(
        shore, tuple(u), 3, tuple(start), hours * 3600, step, beach=kernel.Beach(slides=True)
    )
    assert (ensemble.status.to_numpy() == Status.ADRIFT).all()
    across = np.array([along[1], -along[0]])  # towards the land
    landing = -(start @ across) / METRE / (u @ across)
    expected = (start @ along) / METRE + (u @ along) * hours * 3600
    place = np.array([end.lon[0], end.lat[0]]) * (360 / sphere.TURN) / METRE
    assert 0 < landing < hours * 3600
    # On the plane lon-lat of this test the way along is exact; cos(lat) < 1 adds 0.02 % of it, and
    # 0.5 m off the shore.
    assert place @ along == pytest.approx(expected, rel=4e-4)
    assert -5 < place @ across < 0
    assert not shoreline.is_land(shore, end.lon, end.lat).any()


@pytest.mark.thorough
@pytest.mark.parametrize("step", [pytest.param(900, marks=pytest.mark.thorough), 3600])
def test_sliding_with_diffusion_is_reflected_brownian_motion(step: int) -> None:
    """The law of the distance from a wall, from which it starts, with a drift u onto it (Harrison
    1985, Brownian Motion and Stochastic Flow Systems, eq. 1.8.11)."""
    shore, n, diffusivity, t = land(jagged(0.01)), 20_000, 50.0, 86_400
    physics = kernel.Physics(diffusivity=diffusivity)
    spread = np.sqrt(2 * diffusivity * t)
    for speed in (0.0, 0.05):

        def law(z, u=speed):
            back = np.exp(-u * z / diffusivity) * stats.norm.cdf((u * t - z) / spread)
            return stats.norm.cdf((z + u * t) / spread) - back

        _, (end,) = drift_on(
            shore,
            (speed, 0.0),
            n,
            (-METRE, 0.1),
            86_400,
            step,
            physics=physics,
            beach=kernel.Beach(slides=True),
        )
        away = -end.lon * (360 / sphere.TURN) / METRE
        assert (away > 0).all()
        apart = stats.kstest(away, law).statistic
        print(step, speed, apart)
        assert apart < 1.95 / np.sqrt(n)  # Kolmogorov's 0.1 % point


@pytest.mark.parametrize("slides", [False, True])
def test_a_walk_that_is_off_changes_no_bit(slides: bool) -> None:
    """Against a kernel without walks: paths that meet a shore of many corners, or slide along it."""
    beach, random, n = kernel.Beach(slides=slides), np.random.default_rng(4), 2000
    corners = np.linspace(-1.4, 1.4, 700)
    zigzag = np.column_stack([random.uniform(-0.004, 0.004, corners.size), corners])
    shore = land(shapely.Polygon([(1.4, 1.4), (1.4, -1.4), *zigzag]))
    lat = sphere.to_binary(random.uniform(-0.4, 0.4, n))

    def drifted(physics: kernel.Physics, still: bool) -> list[np.ndarray]:
        ensemble, _ = drift_on(
            shore,
            (0.31, 0.17),
            n,
            (-3000 * METRE, 0.1),
            14_400,
            3600,
            physics=physics,
            prepare=lambda ensemble: ensemble.lat.from_numpy(lat),
            beach=beach,
            still=still,
        )
        columns = ensemble.lon, ensemble.lat, ensemble.status, ensemble.status_since
        return [column.to_numpy() for column in columns]

    without = drifted(kernel.Physics(), False)
    off = drifted(kernel.Physics(diffusivity=20.0), True)
    assert all(map(np.array_equal, off, without))
    assert not np.array_equal(without[0], drifted(kernel.Physics(diffusivity=20.0), False)[0])


def test_what_sinks_does_so_at_its_time_and_nowhere_else() -> None:
    n = 1000
    times = np.arange(n, dtype=np.int32) * 100

    def prepare(ensemble) -> None:
        ensemble.sink_time.from_numpy(times)
        ensemble.release.from_numpy(np.full(n, 500, np.int32))

    ensemble, (end,) = drift_on(
        None, (0.5, 0.0), n, (-1.0, 0.1), 60_000, 1000, prepare=prepare, sinks=True
    )
    status, ended = end.status, ensemble.status_since.to_numpy()
    assert (status == np.where(times <= 60_000, Status.SUNK, Status.ADRIFT)).all()
    sunk = times < 60_000
    assert (ended[sunk] == np.maximum(times[sunk], 500)).all()
    way = (end.lon * (360 / sphere.TURN) + 1.0) / METRE
    assert way == pytest.approx(0.5 * (np.clip(times, 500, 60_000) - 500), abs=2)


def test_a_world_shares_its_bias() -> None:
    def prepare(ensemble) -> None:
        ensemble.world.from_numpy(np.repeat(np.arange(3, dtype=np.int32), 4))
        release.share(ensemble, east, north)

    east, north = np.array([0.1, 0.0, -0.2]), np.array([0.0, 0.3, 0.1])
    _, (end,) = drift_on(None, (0.2, 0.0), 12, (0.0, 0.0), 36_000, 1800, prepare=prepare, bias=True)
    for column, mean in ((end.lon, 0.2 + east), (end.lat, north)):
        way = column.reshape(3, 4) * (360 / sphere.TURN) / METRE
        assert way == pytest.approx(np.repeat(mean[:, None] * 36_000, 4, 1), abs=3)


def test_an_islet_smaller_than_the_steps_spread_is_met_as_often_as_it_should() -> None:
    """100 m of radius, in a walk that spreads 850 m a step, against the probability that such a
    walk ever meets a disc.

    Where D lap p + u dp/dx = 0, p exp(k x) with k = u / 2D is a sum of K_n(k r) cos(n angle); on
    the disc it is exp(k x) (Abramowitz and Stegun 1964, eq. 9.6.34). After 120,000 s they are 11 km
    beyond: exp(-11) of them come back.
    """
    turn, n, radius, away, speed, diffusivity = (
        np.linspace(0, 2 * np.pi, 25)[:-1],
        20_000,
        100.0,
        1000.0,
        0.1,
        100.0,
    )
    islet = land(shapely.Polygon(radius * METRE * np.column_stack([np.cos(turn), np.sin(turn)])))
    ensemble, _ = drift_on(
        islet,
        (speed, 0.0),
        n,
        (-away * METRE, 0.0),
        120_000,
        3600,
        physics=kernel.Physics(diffusivity=diffusivity),
    )
    met = (ensemble.status.to_numpy() == Status.ASHORE).mean()
    order, k = np.arange(20), speed / (2 * diffusivity)
    terms = (
        np.where(order, 2, 1)
        * (-1.0) ** order
        * special.iv(order, k * radius)
        / special.kn(order, k * radius)
    )
    share = np.exp(k * away) * (terms * special.kn(order, k * away)).sum()
    print(met, share)
    # Pieces of 150 m leave 3 % at most of an islet of 100 m.
    assert met == pytest.approx(share, abs=0.03 * share + 4.5 * np.sqrt(share * (1 - share) / n))


@pytest.mark.parametrize("step", [300, 1800])
def test_both_banks_of_a_narrow_channel_are_met_as_they_should(step: int) -> None:
    """From a quarter of the width of 300 m: the near bank is met with probability 3/4 (gambler's
    ruin), nobody is across.
    """
    half = 150 * METRE
    banks = land(shapely.box(-1.4, half, 1.4, 1.4), shapely.box(-1.4, -1.4, 1.4, -half))
    n = 20_000
    ensemble, _ = drift_on(
        banks,
        (0.0, 0.0),
        n,
        (0.0, 0.5 * half),
        7200,
        step,
        physics=kernel.Physics(diffusivity=100.0),
    )
    lat = ensemble.lat.to_numpy() * (360 / sphere.TURN)
    assert (ensemble.status.to_numpy() == Status.ASHORE).all()
    assert np.abs(lat).max() < half + 0.01 * METRE
    # pieces of 150 m
    assert (lat > 0).mean() == pytest.approx(0.75, abs=4.5 * np.sqrt(0.1875 / n) + 0.01)
