"""Position laws of bridges: the paper's equations in a plane, and a fine simulation in three
dimensions on the sphere.
"""

import math

import numpy as np
import pytest
from scipy import integrate

from drift.tracking.bridges import bridge as bridges
from drift.tracking.bridges import ellipse
from geo import sphere

NMI = 1852.0
HOUR = 3600.0
RADIUS = 6_371_008.8  # [m]


def rate(nmi_per_root_hour: float) -> float:
    """K [m/sqrt(s)]."""
    return nmi_per_root_hour * NMI / 60


def correlated(rng: np.random.Generator, size: int, scale: float) -> np.ndarray:
    """A covariance of `size` components with deviations about `scale`, all of them correlated."""
    factor = rng.normal(0, scale, (size, size + 2))
    return factor @ factor.T / (size + 2)


@pytest.mark.parametrize("share", [0.07, 0.31, 0.5, 0.68, 0.93])
def test_equations_2_to_9_where_the_ends_are_near(share: float) -> None:
    """Written out as in the paper.

    Ends are 4 nmi apart: the sphere's law and the plane's differ by h^2/3 = 5e-7 at most.
    """
    rng = np.random.default_rng(41)
    sigma = correlated(rng, 4, 900.0)
    span, k = 7.3 * HOUR, rate(0.8)
    begin, end = (-88.2, 27.6), (-88.147, 27.645)
    one = bridges.between(*np.transpose([begin, end]), [1000.0, 1000.0 + span], k, sigma)
    law = bridges.bridge_at(one, [1000.0 + share * span])
    t, left = share * span, span - share * span  # t - t_d, t_a - t
    brownian = k**2 * t * left / span
    early, late, both = (left / span) ** 2, (t / span) ** 2, t * left / span**2
    xx = early * sigma[0, 0] + late * sigma[2, 2] + 2 * both * sigma[0, 2] + brownian
    yy = early * sigma[1, 1] + late * sigma[3, 3] + 2 * both * sigma[1, 3] + brownian
    xy = early * sigma[0, 1] + late * sigma[2, 3] + both * (sigma[0, 3] + sigma[1, 2])
    # Meridians converge between the ends by 0.053 degrees times the sine of the latitude, which
    # turns east by 4e-4 rad.
    assert law.covariance[0] == pytest.approx(
        np.array([[xx, xy], [xy, yy]]), rel=2e-3, abs=2e-3 * math.sqrt(xx * yy)
    )
    middle = [np.degrees(law.lon[0]), np.degrees(law.lat[0])]
    assert middle == pytest.approx(np.array(begin) * (1 - share) + np.array(end) * share, abs=2e-5)


def test_equations_5_to_9_hold_exactly_as_the_earth_grows_flat() -> None:
    """Without the convergence of meridians: on the equator, where the error falls with the square
    of the distance.
    """
    rng = np.random.default_rng(5)
    shape = correlated(rng, 4, 1.0)
    for degrees in (0.3, 0.1):
        scale = 0.02 * math.radians(degrees) * RADIUS
        sigma, k, span = shape * scale**2, scale / 60, 3600.0
        law = bridges.bridge_at(
            bridges.between([10.0, 10.0 + degrees], [0.0, 0.0], [0.0, span], k, sigma),
            [0.35 * span],
        )
        weights = np.hstack([0.65 * np.eye(2), 0.35 * np.eye(2)])
        plane = weights @ sigma @ weights.T + k**2 * span * 0.35 * 0.65 * np.eye(2)
        assert np.abs(law.covariance[0] / plane - 1).max() < math.radians(degrees) ** 2


def paths(
    k: float, span: float, angle: float, count: int, steps: int, rng: np.random.Generator
) -> np.ndarray:
    """Places of simulated paths midway, unit vectors (count, 3): Euler steps in three dimensions of
    the bridge's own equation.

    dX = log_X(P) / (T - t) dt + K dW in the tangent plane. It departs at longitude 0 and arrives at
    `angle`, on the equator.
    """
    place = np.tile([1.0, 0.0, 0.0], (count, 1))
    goal = np.array([math.cos(angle), math.sin(angle), 0.0])
    dt = span / steps
    for step in range(steps // 2):
        dot = place @ goal
        ahead = goal - dot[:, None] * place
        ahead *= (np.arctan2(np.linalg.norm(ahead, axis=1), dot) / np.linalg.norm(ahead, axis=1))[
            :, None
        ]
        noise = rng.normal(0, k * math.sqrt(dt) / RADIUS, (count, 3))
        noise -= (noise * place).sum(1)[:, None] * place
        move = ahead * dt / (span - step * dt) + noise
        size = np.linalg.norm(move, axis=1)[:, None]
        place = place * np.cos(size) + move * np.sinc(size / np.pi)
        place /= np.linalg.norm(place, axis=1)[:, None]
    return place


def test_far_ends_against_a_fine_simulation_in_three_dimensions() -> None:
    """6,000 nmi, K = 12, 400 h: 140.2 nmi across midway and 120 along, where a plane has 120 both
    ways.

    4,000 paths tell a deviation to 1.1 %; Euler's steps and what is beyond first order are 0.3 %
    (measured with 10^6 paths).
    """
    angle, span, count = 6000 * NMI / RADIUS, 400 * HOUR, 4000
    place = paths(rate(12), span, angle, count, 200, np.random.default_rng(17))
    one = bridges.between([0.0, math.degrees(angle)], [0.0, 0.0], [0.0, span], rate(12))
    law = bridges.bridge_at(one, [span / 2])
    along, across = np.sqrt(np.diag(law.covariance[0]))
    assert (along / NMI, across / NMI) == pytest.approx((120.0, 140.197), rel=1e-5)
    assert across == pytest.approx(
        math.sqrt(rate(12) ** 2 * span * math.tan(angle / 2) / (2 * angle)), rel=1e-12
    )
    lat, lon = np.arcsin(place[:, 2]), np.arctan2(place[:, 1], place[:, 0])
    east, north = sphere.offset(law.lon[0], law.lat[0], lon, lat)
    tolerance = 3 / math.sqrt(2 * count) + 0.003
    assert north.std() == pytest.approx(across, rel=tolerance)
    assert east.std() == pytest.approx(along, rel=tolerance)


@pytest.mark.parametrize("share", [0.12, 0.5, 0.77])
def test_variance_across_is_the_integral_of_jacobi_fields(share: float) -> None:
    """What is strayed at u grows as sin of the angle to the arrival shrinks: sin^2(h(s)) int du /
    sin^2(h(u)) by quadrature.
    """
    angle, span = 1.31, 88 * HOUR

    def left(s: float) -> float:
        return math.sin((1 - s) * angle)

    integral, _ = integrate.quad(
        lambda u: (left(share) / left(u)) ** 2, 0, share, epsabs=0, epsrel=1e-12
    )
    found = bridges.strayed(np.array(share), np.array(share), np.array(angle))
    assert found == pytest.approx([share * (1 - share), integral], rel=1e-9)
    one = bridges.between([20.0, 20.0 + math.degrees(angle)], [0, 0], [0, span], 30.0)
    assert bridges.bridge_at(one, [share * span]).covariance[0, 1, 1] == pytest.approx(
        900 * span * integral, rel=1e-9
    )


def test_errors_of_the_ends_move_the_great_circle() -> None:
    """A shift of an end by 20 m shifts a point of the way as the great circle through the shifted
    end runs.
    """
    lon, lat = np.array([-140.3, 158.2]), np.array([21.7, -33.4])
    one = bridges.between(lon, lat, [0.0, 9e5], 0.0, np.eye(4))
    for share in (0.2, 0.66):
        law = bridges.bridge_at(one, [share * 9e5])
        columns = []
        for end, (east, north) in [(0, (20, 0)), (0, (0, 20)), (1, (20, 0)), (1, (0, 20))]:
            x, y = np.radians(lon), np.radians(lat)
            x[end], y[end] = sphere.destination(x[end], y[end], east, north)
            way = np.array(sphere.offset(x[0], y[0], x[1], y[1])) * share
            there = sphere.destination(x[0], y[0], *way)
            columns.append(np.array(sphere.offset(law.lon[0], law.lat[0], *there)) / 20)
        shift = np.transpose(columns)  # (2, 4): the derivative of the point by the ends
        assert law.covariance[0] == pytest.approx(shift @ shift.T, rel=1e-4, abs=1e-4)


def test_any_number_of_way_points() -> None:
    """At a way point the law is its own; in a leg it is that of the leg alone; times of one leg are
    correlated, of two are not.
    """
    rng = np.random.default_rng(8)
    lon, lat, time = (
        [170.0, 178.5, -176.0, -171.0],
        [40.0, 43.5, 41.0, 44.2],
        np.array([0.0, 7e4, 1.5e5, 2.6e5]),
    )
    sigma = correlated(rng, 8, 2e4)
    one = bridges.between(lon, lat, time, 80.0, sigma)
    for k in range(4):
        law = bridges.bridge_at(one, [time[k]])
        assert law.covariance[0] == pytest.approx(
            sigma[2 * k : 2 * k + 2, 2 * k : 2 * k + 2], rel=1e-9
        )
        assert np.degrees([law.lon[0], law.lat[0]]) == pytest.approx(
            [sphere.wrap_degrees(lon[k]), lat[k]], abs=1e-9
        )
    second = bridges.between(lon[1:3], lat[1:3], time[1:3], 80.0, sigma[2:6, 2:6])
    asked = np.array([8e4, 1e5, 1.3e5])
    assert bridges.bridge_at(one, asked).covariance == pytest.approx(
        bridges.bridge_at(second, asked).covariance, rel=1e-9
    )
    known = bridges.between(lon, lat, time, 80.0)
    _, whole = bridges.joint(known, np.array([3e4, 8e4, 1.3e5]))
    assert np.abs(whole[:2, 2:]).max() == 0  # of two legs
    assert np.trace(whole[2:4, 4:6]) > 0
    # Given the place at 8e4, the place at 1.3e5 is that of a bridge from there: its variance does
    # not know the departure.
    left = whole[4:6, 4:6] - whole[4:6, 2:4] @ np.linalg.solve(whole[2:4, 2:4], whole[2:4, 4:6])
    rest = bridges.bridge_at(known, [8e4])
    onward = bridges.between(
        np.degrees([rest.lon[0], np.radians(-176.0)]),
        np.degrees([rest.lat[0], np.radians(41.0)]),
        [8e4, 1.5e5],
        80.0,
    )
    assert left == pytest.approx(
        bridges.bridge_at(onward, [1.3e5]).covariance[0], rel=1e-9, abs=1e-3
    )


def test_joint_law_has_the_position_law_on_its_diagonal() -> None:
    rng = np.random.default_rng(9)
    one = bridges.between(
        [3.0, 9.0, 5.5], [58.0, 61.0, 66.0], [0.0, 5e4, 2e5], 60.0, correlated(rng, 6, 8e3)
    )
    asked = np.array([0.0, 1.3e4, 5e4, 9e4, 1.9e5, 2e5])
    place, whole = bridges.joint(one, asked)
    assert place.covariance == pytest.approx(bridges.bridge_at(one, asked).covariance, rel=1e-12)
    assert np.linalg.eigvalsh(whole).min() > -1e-9 * np.abs(whole).max()


@pytest.mark.parametrize("share", [0.5, 0.9, 0.95])
def test_ellipse_holds_its_share(share: float) -> None:
    """Of draws from the normal law, by a point-in-polygon test of shapely's; across the
    antimeridian, three standard errors.
    """
    import shapely

    rng = np.random.default_rng(12)
    covariance = np.array([[6.1e8, 2.2e8], [2.2e8, 2.4e8]])
    lon, lat = np.radians(179.7), np.radians(-41.3)
    outline = ellipse.polygon(lon, lat, covariance, share)
    draws = rng.multivariate_normal([0, 0], covariance, 20_000)
    x, y = sphere.destination(lon, lat, *draws.T)
    inside = shapely.contains_xy(
        shapely.Polygon(outline), sphere.near_degrees(np.degrees(x), 179.7), np.degrees(y)
    )
    chord = 2e-4 * (1 - share) * -2 * math.log1p(-share)  # what the polygon's chords cut off
    assert inside.mean() == pytest.approx(
        share, abs=3 * math.sqrt(share * (1 - share) / 20_000) + chord
    )
    # its area: the shoelace formula in the tangent plane, in which chords cut off 2 pi^2 / (3 n^2)
    # of an ellipse
    east, north = sphere.offset(lon, lat, *np.radians(outline).T)
    shoelace = 0.5 * abs((east * np.roll(north, -1) - north * np.roll(east, -1)).sum()) / NMI**2
    assert ellipse.area(covariance, share) == pytest.approx(shoelace, rel=2.2e-4)
    assert shapely.Polygon(outline).exterior.is_ccw


def test_axes_of_an_ellipse() -> None:
    turn = math.radians(131.0)
    ahead, beside = (
        np.array([math.sin(turn), math.cos(turn)]),
        np.array([math.cos(turn), -math.sin(turn)]),
    )
    covariance = 900.0**2 * np.outer(ahead, ahead) + 350.0**2 * np.outer(beside, beside)
    long, short, direction = ellipse.axes(covariance)
    assert (float(long), float(short), math.degrees(direction)) == pytest.approx(
        (900.0, 350.0, 131.0)
    )


def test_share_through_a_place() -> None:
    covariance = np.array([[4.0, 1.0], [1.0, 9.0]])
    east, north = 1.1, -2.3
    square = np.array([east, north]) @ np.linalg.inv(covariance) @ np.array([east, north])
    assert ellipse.held(np.array([east, north]), covariance) == pytest.approx(
        1 - math.exp(-square / 2)
    )


def test_no_spread_and_no_errors_is_the_great_circle() -> None:
    one = bridges.between([10.0, 42.0], [50.0, 61.0], [0.0, 1e5], 0.0)
    law = bridges.bridge_at(one, [3.1e4])
    assert np.abs(law.covariance).max() == 0
    whole = sphere.distance(*np.radians([10.0, 50.0, 42.0, 61.0]))
    assert sphere.distance(*np.radians([10.0, 50.0]), law.lon[0], law.lat[0]) == pytest.approx(
        0.31 * whole
    )


def test_what_stays_at_its_place_loiters() -> None:
    """Departure and arrival at one place: a closed tour, K^2 s (1 - s) T in every direction."""
    one = bridges.between([5.2, 5.2], [55.0, 55.0], [0.0, 4e4], 12.0)
    law = bridges.bridge_at(one, [1e4])
    assert law.covariance[0] == pytest.approx(144 * 4e4 * 0.25 * 0.75 * np.eye(2))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"time": [0.0, 0.0]},
            "way point 2 is reached at the time of way point 1; give way points in order",
        ),
        ({"time": [9e4, 0.0]}, "way point 2 is reached 25 h before way point 1"),
        ({"spread_rate": -1.0}, "at least 0"),
        ({"spread_rate": math.nan}, "at least 0"),
        ({"lon_deg": [5.0], "lat_deg": [55.0], "time": [0.0]}, "needs two way points or more"),
        ({"lon_deg": [5.0, 6.0, 7.0]}, "shapes"),
        ({"lat_deg": [55.0, 91.0]}, "outside -90 to 90"),
        ({"lat_deg": [55.0, math.nan]}, "not finite"),
        ({"lon_deg": [5.0, -175.0], "lat_deg": [0.0, 1.0]}, "179 degrees apart"),
        ({"covariance": np.eye(3)}, r"shape \(3, 3\)"),
        ({"covariance": np.eye(4) + np.eye(4, k=1)}, "not symmetric"),
        (
            {"covariance": np.eye(4) - 2 * np.eye(4)[:, [1, 0, 2, 3]]},
            "not symmetric|negative variance",
        ),
        ({"spread_rate": 3e4}, "lower the spread rate"),
    ],
)
def test_what_is_no_bridge_is_refused(changes: dict[str, object], words: str) -> None:
    given = {
        "lon_deg": [5.0, 7.0],
        "lat_deg": [55.0, 56.0],
        "time": [0.0, 9e4],
        "spread_rate": 50.0,
    } | changes
    with pytest.raises(ValueError, match=words) as refusal:
        bridges.between(**given)
    assert "\n" not in str(refusal.value)


def test_a_time_outside_the_bridge_is_refused() -> None:
    one = bridges.between(
        [5.0, 7.0],
        [55.0, 56.0],
        np.array(["2026-06-01T00", "2026-06-02T12"], "datetime64[s]"),
        50.0,
    )
    assert bridges.bridge_at(one, np.array(["2026-06-01T09"], "datetime64[s]")).lon.shape == (1,)
    with pytest.raises(
        ValueError, match="37 h after departure is outside the bridge, which lasts 36 h"
    ):
        bridges.bridge_at(one, np.array(["2026-06-02T13"], "datetime64[s]"))


def test_share_of_an_ellipse_must_be_one() -> None:
    with pytest.raises(ValueError, match="between 0 and 1"):
        ellipse.polygon(0.0, 0.0, np.eye(2), 1.0)
