"""Built-in flows: closed forms, no divergence, the same whenever a run starts, labelled synthetic."""

import numpy as np
import pytest

from geo import sphere
from geo.box import Box
from geo.errors import UserError
from geo.forcing import analytic, sources

GULF = Box(-97.0, 22.0, -80.0, 30.0)
START, END = np.datetime64("2026-11-21T18:30:00"), np.datetime64("2026-11-23T06:00:00")


def velocity(
    kind: str, box: Box, x: float, y: float, seconds: float, **parameters: float
) -> np.ndarray:
    quantity = "wind" if kind == "breeze" else "current"
    return np.array(
        [float(v) for v in analytic.build_flow(quantity, kind, box, **parameters)[0](x, y)(seconds)]
    )


@pytest.mark.parametrize("kind", ["gulf", "stommel_gyre"])
def test_currents_have_no_divergence(kind: str) -> None:
    rng = np.random.default_rng(2)
    flow = analytic.build_flow("current", kind, GULF)[0]
    lon, lat, h = rng.uniform(-94, -81, 300), rng.uniform(23, 29, 300), 0.01
    seconds = 3.3e5
    east = (flow(lon + h, lat)(seconds)[0] - flow(lon - h, lat)(seconds)[0]) / (2 * h)
    north = [flow(lon, lat + d)(seconds)[1] * np.cos(np.radians(lat + d)) for d in (h, -h)]
    # [m/s per degree]
    divergence = (east + (north[0] - north[1]) / (2 * h)) / np.cos(np.radians(lat))
    shear = np.abs(flow(lon, lat + h)(seconds)[0] - flow(lon, lat - h)(seconds)[0]) / (2 * h)
    # the streamfunction is continuous everywhere; only on the kinks of the jet's axis do
    # differences see a jump
    assert np.quantile(np.abs(divergence), 0.97) < 0.01 * shear.max()


def test_gulf_looks_like_the_gulf() -> None:
    source = sources.analytic("current", "gulf", GULF, START, END)
    assert "SYNTHETIC" in source.notes[0]
    values = source.read(0)
    speed = np.hypot(values[..., 0], values[..., 1])
    assert 0.8 < speed.max() < 1.3
    days = 7.3e8
    assert velocity("gulf", GULF, -86.0, 22.0, days)[1] > 0.4  # north through the Yucatan Channel
    assert velocity("gulf", GULF, -81.6, 23.8, days)[0] > 0.4  # east through the Straits of Florida
    assert np.hypot(*velocity("gulf", GULF, -91.0, 29.3, days)) < 0.12  # the shelf


def test_hours_are_absolute_and_cover_the_run() -> None:
    first = sources.analytic("current", "gulf", GULF, START, END)
    assert (first.times[0], first.times[-1]) == (
        np.datetime64("2026-11-21T18:00"),
        np.datetime64("2026-11-23T06:00"),
    )
    assert (np.diff(first.times) == np.timedelta64(1, "h")).all()
    later = sources.analytic("current", "gulf", GULF, END, START + np.timedelta64(5, "h"))
    k = int(np.nonzero(first.times == later.times[2])[0][0])
    np.testing.assert_array_equal(first.read(k), later.read(2))
    values = first.read(3)
    assert values.dtype == np.float32
    assert values.flags.c_contiguous
    assert values.shape == (first.grid.nlat, first.grid.nlon, 2)
    assert first.grid.box.west <= GULF.west
    assert first.grid.box.north >= GULF.north


def test_solid_rotation_is_omega_cross_r() -> None:
    axis = np.radians([25.0, 50.0])
    omega = np.array(
        [np.cos(axis[1]) * np.cos(axis[0]), np.cos(axis[1]) * np.sin(axis[0]), np.sin(axis[1])]
    )
    for lon, lat in ((13.0, 7.0), (-170.0, -60.0), (25.0, 50.0)):
        x, y = np.radians([lon, lat])
        r = np.array([np.cos(y) * np.cos(x), np.cos(y) * np.sin(x), np.sin(y)])
        v = 0.7 * np.cross(omega, r)
        east, north = (
            np.array([-np.sin(x), np.cos(x), 0.0]),
            np.array([-np.sin(y) * np.cos(x), -np.sin(y) * np.sin(x), np.cos(y)]),
        )
        got = velocity(
            "solid_rotation", GULF, lon, lat, 0.0, speed=0.7, pole_lon=25.0, pole_lat=50.0
        )
        np.testing.assert_allclose(got, (v @ east, v @ north), atol=1e-12)


def test_inertial_circle() -> None:
    """One inertial period at 26 N is 12 h / sin(lat) of the sidereal day, and the velocity comes
    back.
    """
    period = np.pi / (analytic.ROTATION * np.sin(np.radians(26.0)))
    assert period == pytest.approx(86_164.1 / 2 / np.sin(np.radians(26.0)), rel=1e-4)
    a, b, c = (
        velocity("inertial", GULF, -90.0, 24.0, t, lat=26.0, mean_east=0.0)
        for t in (0.0, period / 4, period)
    )
    np.testing.assert_allclose(a, c, atol=1e-12)
    np.testing.assert_allclose(b, (0.0, -a[0]), atol=1e-12)  # east, then south: clockwise


def test_stommel_gyre_closes() -> None:
    box = Box(-10.0, 30.0, 10.0, 42.0)
    for lon, lat, k in ((-10.0, 35.0, 0), (10.0, 35.0, 0), (0.0, 30.0, 1), (0.0, 42.0, 1)):
        assert abs(velocity("stommel_gyre", box, lon, lat, 0.0)[k]) < 1e-9
    assert velocity("stommel_gyre", box, -9.9, 36.0, 0.0)[1] > 0.5  # the western edge runs north
    assert velocity("stommel_gyre", box, 3.0, 36.0, 0.0)[1] < 0


def test_breeze_is_a_trade_wind_that_turns_daily() -> None:
    source = sources.analytic("wind", "breeze", GULF, START, END)
    values = np.stack([source.read(k) for k in range(25)])
    speed = np.hypot(values[..., 0], values[..., 1])
    assert speed.min() > 4.0
    assert speed.max() < 10.5
    assert values[..., 0].mean() < -2.0  # from the east
    assert np.ptp(speed[:, 10, 10]) > 1.0


@pytest.mark.parametrize("kind", ["gulf", "solid_rotation", "inertial", "breeze"])
def test_a_flow_is_the_same_whatever_box_asks_for_it(kind: str) -> None:
    """But a gyre, which fills its box."""
    at = (-86.3, 25.7, 9.1e6)
    assert (
        velocity(kind, GULF, *at).tolist()
        == velocity(kind, Box(-88.0, 25.0, -71.0, 41.5), *at).tolist()
    )


def test_nodes_stand_where_they_stand_in_any_box() -> None:
    """And their values are those of the flow; a box round the Earth has no seam."""
    narrow, wide = (
        sources.analytic("wind", "breeze", box, START, END, spacing=0.7)
        for box in (Box(-90.3, 24.1, -87.2, 26.9), Box(-93.9, 21.3, -85.1, 28.2))
    )
    both = [np.round(source.grid.lon / 0.7).astype(int).tolist() for source in (narrow, wide)]
    rows = [np.round(source.grid.lat / 0.7).astype(int).tolist() for source in (narrow, wide)]
    i, j = both[1].index(both[0][0]), rows[1].index(rows[0][0])
    ny, nx = narrow.grid.nlat, narrow.grid.nlon
    np.testing.assert_array_equal(narrow.read(3), wide.read(3)[j : j + ny, i : i + nx])
    for source in (narrow, wide):
        np.testing.assert_allclose(
            source.grid.lon / 0.7, np.round(source.grid.lon / 0.7), atol=1e-9
        )
    assert narrow.grid.lon[0] <= -90.3 < narrow.grid.lon[1]
    assert narrow.grid.lat[-2] < 26.9 <= narrow.grid.lat[-1]
    assert sources.analytic(
        "current", "solid_rotation", Box(-180, -90, 180, 90), START, END, spacing=0.7
    ).grid.seamless


def test_antimeridian_and_poles() -> None:
    source = sources.analytic(
        "current", "solid_rotation", Box(175.0, 85.0, 190.0, 90.0), START, END
    )
    lat = source.grid.lat
    assert np.isnan(source.read(0)[lat > 89]).all()
    assert np.isfinite(source.read(0)[lat <= 89]).all()
    assert source.missing == pytest.approx((lat > 89).mean())


def test_unknown_flows_and_parameters() -> None:
    with pytest.raises(UserError, match='"gulv" is unknown; allowed: gulf'):
        sources.analytic("current", "gulv", GULF, START, END)
    with pytest.raises(UserError, match=r"allowed: .*breeze"):
        sources.analytic("wind", "gulf", GULF, START, END)
    with pytest.raises(UserError, match="takes speed, tide"):
        sources.analytic("current", "gulf", GULF, START, END, spede=1.0)


def test_radius_of_the_derivatives() -> None:
    assert pytest.approx(sphere.RADIUS * np.pi / 180) == analytic.METRES
