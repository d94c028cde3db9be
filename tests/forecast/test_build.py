"""Containment areas, maps and mean tracks against known densities and closed forms."""

import dataclasses
import itertools

import numpy as np
import pytest
import xarray as xr
from densities import (
    LAT,
    LON,
    SHARES,
    TIME,
    far_apart,
    filament,
    inside,
    mixture,
    normal,
    pinpoint,
    positions,
    ring,
    snapshot,
)

from drift.engine.particles import partials
from drift.engine.particles.snapshot import Snapshot
from drift.engine.particles.status import Status
from drift.forecast import build as forecast_build
from drift.forecast import cloud, shares, survey
from geo import sphere


@pytest.mark.parametrize(("n", "tolerance"), [(10_000, 0.06), (100_000, 0.016)])
def test_areas_of_a_bivariate_normal(n, tolerance):
    """2 pi sx sy ln(1 / (1 - p)); 4 standard errors of the sample's own quantile plus 1 % of
    smoothing.
    """
    made = forecast_build.build_forecast(
        [snapshot(*normal(n, np.random.default_rng(11)))], scenarios=["only"]
    )
    exact = 2 * np.pi * 4000 * 9000 * -np.log(1 - SHARES)
    np.testing.assert_allclose(made.data["containment_area"].values[0], exact, rtol=tolerance)


@pytest.mark.parametrize("n", [10_000, 100_000])
@pytest.mark.parametrize("cloud", [normal, ring, mixture, filament, far_apart, pinpoint])
def test_areas_hold_their_share_of_new_particles(cloud, n):
    """Within 2 % (0.5 % of it sampling error of the quantile at n = 10^4), a little more to the
    safe side.
    """
    rng = np.random.default_rng(n)
    made = forecast_build.build_forecast([snapshot(*cloud(n, rng))], scenarios=["only"])
    np.testing.assert_allclose(
        made.data["held_out"].values[0], SHARES, atol=3 * 0.5 / np.sqrt(n / 2)
    )
    fresh = cloud(200_000, rng)
    for share in shares.SHARES:
        error = inside(made, share, *fresh) - share
        assert -0.015 < error < 0.025, (share, error)


@pytest.mark.thorough
@pytest.mark.parametrize("cloud", [normal, far_apart, filament])
def test_few_particles_err_on_the_wide_side(cloud):
    rng = np.random.default_rng(8)
    held = []
    for _ in range(8):
        made = forecast_build.build_forecast([snapshot(*cloud(100, rng))], scenarios=["only"])
        held.append([inside(made, share, *cloud(20_000, rng)) for share in shares.SHARES])
    assert (np.mean(held, axis=0) > SHARES - [0.05, 0.05, 0.03]).all()


def test_weights_count_as_probability():
    """Importance weights that turn one normal into another give that one's areas: 12 % at an ESS of
    about 40,000.
    """
    rng = np.random.default_rng(4)
    east, north = rng.normal(0, 8000, 80_000), rng.normal(0, 8000, 80_000)
    weight = np.exp(
        -0.5 * (east / 6000) ** 2 - 0.5 * (north / 6000) ** 2 + 0.5 * (east**2 + north**2) / 8000**2
    )
    made = forecast_build.build_forecast([snapshot(east, north, weight=weight)], scenarios=["only"])
    exact = 2 * np.pi * 6000**2 * -np.log(1 - SHARES)
    np.testing.assert_allclose(made.data["containment_area"].values[0], exact, rtol=0.05)


def test_containment_is_of_the_smallest_area():
    made = forecast_build.build_forecast(
        [snapshot(*normal(20_000, np.random.default_rng(1)))], scenarios=["only"]
    )
    data = made.data.isel(time=0)
    height = (data["probability"] / data["cell_area"]).values
    contained = data["containment"].values
    order = np.argsort(-height.ravel(), kind="stable")
    # two cells: the file's float32 may swap near ties
    assert (np.diff(contained.ravel()[order][:5000]) >= -1e-3).all()
    assert contained.min() > 0
    assert contained.max() == 1


def coast_at(east):
    """Land east of a meridian [m from the middle]."""
    edge, _ = positions(np.array([float(east)]), np.array([0.0]))
    return lambda lon, lat: lon > edge[0]


def test_probability_adds_up_and_keeps_off_land():
    rng = np.random.default_rng(7)
    n = 30_000
    east, north = rng.normal(0, 5000, n), rng.normal(0, 9000, n)
    status = np.where(east > 4000, Status.ASHORE, Status.ADRIFT)
    east = np.where(status == Status.ASHORE, 3990.0, east)
    status[:3000] = Status.LEFT
    status[3000:3600] = Status.PENDING
    scenario = rng.choice(3, n, p=[0.6, 0.3, 0.1])
    one = snapshot(east, north, weight=rng.random(n), status=status, scenario=scenario)
    status, scenario = one.status, one.scenario
    made = forecast_build.build_forecast([one], scenarios=["a", "b", "c"], is_land=coast_at(4000))
    data = made.data.isel(time=0)
    on_map = one.probability[status <= Status.ASHORE].sum()
    assert float(data["probability"].sum(dtype=float)) == pytest.approx(on_map, rel=1e-6)
    assert float(data["probability_ashore"].sum(dtype=float)) == pytest.approx(
        one.probability[status == Status.ASHORE].sum(), rel=1e-6
    )
    np.testing.assert_allclose(
        data["probability_by_scenario"].sum("scenario").values,
        data["probability"].values,
        rtol=1e-5,
        atol=1e-12,
    )
    for i in range(3):
        mine = (scenario == i) & (status <= Status.ASHORE)
        assert float(data["probability_by_scenario"][i].sum(dtype=float)) == pytest.approx(
            one.probability[mine].sum(), rel=1e-6
        )
    assert float(data["status_probability"].sum()) == pytest.approx(1, abs=1e-12)
    assert float(data["scenario_probability"].sum()) == pytest.approx(1, abs=1e-12)
    lon, _ = np.meshgrid(data["lon"].values, data["lat"].values)
    inland = lon > sphere.to_degrees(positions(np.array([4000.0]), np.array([0.0]))[0])[0] + 0.011
    assert float(data["probability"].values[inland].sum()) == 0
    assert inland.any()
    offshore = lon < LON
    assert float(data["probability_ashore"].values[offshore].sum()) == 0


@pytest.mark.parametrize("stranded", [1.0, 0.6])
def test_cells_of_a_shore_hold_the_share_that_their_containment_says(stranded):
    """Of new particles of the law, within 4.5 standard errors of theirs and the map's; the cell at
    the edge holds under 2 % beside.

    Half of what is smoothed along a shore lies in fine cells beside those that hold all: the
    forecast's coarser cells have another calibration than they. Outlines are not held to it: they
    hold more on a shore (areas.contour).
    """
    n = 20_000

    def shore(x):
        return 0.3 * x + 2000 * np.sin(x / 3000)

    def draw(seed):
        rng = np.random.default_rng(seed)
        east, ashore = rng.normal(0, 6000, n), rng.random(n) < stranded
        north = shore(east) - np.where(ashore, 0.0, 500 + np.abs(rng.normal(0, 4000, n)))
        return east, north, np.where(ashore, Status.ASHORE, Status.ADRIFT)

    def is_land(lon, lat):
        east, north = sphere.offset(*np.radians([LON, LAT]), lon * sphere.UNIT, lat * sphere.UNIT)
        return north > shore(east)

    east, north, status = draw(3)
    data = forecast_build.build_forecast(
        [snapshot(east, north, status=status)], scenarios=["x"], is_land=is_land
    ).data.isel(time=0)
    lon, lat = (sphere.to_degrees(v) for v in positions(*draw(4)[:2]))
    at = (
        data["containment"]
        .sel(lon=xr.DataArray(lon), lat=xr.DataArray(lat), method="nearest")
        .values
    )
    for share in (0.5, 0.75, 0.9):
        error = np.sqrt(2 * share * (1 - share) / n)
        assert share - 0.02 - 4.5 * error < (at <= share).mean() < share + 4.5 * error


def test_a_bay_that_holds_no_particle_stays_empty():
    rng = np.random.default_rng(9)
    low, high = (positions(np.array([e]), np.array([0.0]))[0][0] for e in (5000.0, 5200.0))
    one = snapshot(np.minimum(rng.normal(0, 3000, 20_000), 4990), rng.normal(0, 4000, 20_000))
    made = forecast_build.build_forecast(
        [one], scenarios=["x"], is_land=lambda lon, lat: (lon > low) & (lon < high)
    )
    behind = made.data["lon"].values > sphere.to_degrees(high)
    assert behind.any()
    assert float(made.data["probability"].values[:, :, behind].sum()) == 0


def test_the_antimeridian_is_no_seam():
    cloud = normal(20_000, np.random.default_rng(6))
    here = forecast_build.build_forecast([snapshot(*cloud, lon=20.0)], scenarios=["x"])
    there = forecast_build.build_forecast([snapshot(*cloud, lon=179.98)], scenarios=["x"])
    np.testing.assert_allclose(
        there.data["containment_area"], here.data["containment_area"], rtol=0.01
    )
    lon = there.data["lon"].values
    assert (np.diff(lon) > 0).all()
    assert lon[0] < 180 < lon[-1]
    assert lon[0] >= -180
    assert float(there.data["mean_lon"][0]) == pytest.approx(179.98, abs=0.01)
    assert there.contours[-1].polygon.is_valid


def test_times_share_one_grid_and_early_areas_stay_sharp():
    """A position known to 10 m grows to 10 nmi: its first area has cells of its own."""
    rng = np.random.default_rng(12)
    unit = rng.normal(size=(2, 20_000))
    snapshots = [
        snapshot(*(unit * s), time=TIME + np.timedelta64(i, "h"))
        for i, s in enumerate((10.0, 1000.0, 20_000.0))
    ]
    data = forecast_build.build_forecast(snapshots, scenarios=["x"]).data
    exact = np.outer(2 * np.pi * np.array([10.0, 1000.0, 20_000.0]) ** 2, -np.log(1 - SHARES))
    np.testing.assert_allclose(data["containment_area"].values, exact, rtol=0.06)
    assert float(data["cell_area"].mean()) > 100 * exact[0, 0]
    np.testing.assert_allclose(
        data["probability"].sum(("lat", "lon"), dtype=float).values, 1, rtol=1e-6
    )


@pytest.mark.parametrize("processes", [2, 3])
def test_maps_that_copies_of_the_process_compute_are_the_same_bits(monkeypatch, processes):
    """Adrift and ashore, unequal weights, two scenarios; no particle is on the second map."""
    rng = np.random.default_rng(14)
    unit, weight = rng.normal(size=(2, 9000)), rng.random(9000)
    some = rng.choice([Status.ADRIFT, Status.ASHORE], 9000)
    made = [
        snapshot(
            *(unit * s),
            time=TIME + np.timedelta64(i, "h"),
            weight=weight / weight.sum(),
            scenario=np.repeat([0, 1], [4000, 5000]),
            status=np.full(9000, Status.SUNK) if i == 1 else some,
        )
        for i, s in enumerate((300.0, 500.0, 2000.0, 7000.0))
    ]
    here = forecast_build.build_forecast(made, scenarios=["a", "b"])
    asked = []
    monkeypatch.setattr(forecast_build, "WORTH", 0)
    monkeypatch.setattr(forecast_build.runtime, "threads", lambda: processes)
    map_in_order = forecast_build.copies.map_in_order
    monkeypatch.setattr(
        forecast_build.copies,
        "map_in_order",
        lambda function, items, many: asked.append(many) or map_in_order(function, items, many),
    )
    there = forecast_build.build_forecast(made, scenarios=["a", "b"])
    assert asked == [processes]
    assert here.data.identical(there.data)
    for one, other in zip(here.contours, there.contours, strict=True):
        assert (one.time, one.share, one.area) == (other.time, other.share, other.area)
        assert one.polygon.equals_exact(other.polygon, 0)


@dataclasses.dataclass
class InParts:
    """A snapshot that is read in ranges of whole blocks, in any order."""

    whole: Snapshot
    cuts: list[int]
    order: list[int]

    time, n = property(lambda self: self.whole.time), property(lambda self: self.whole.n)

    def parts(self):
        blocks = self.whole.blocks
        edges = [*blocks.first.tolist(), blocks.n]
        spans = list(itertools.pairwise([0, *self.cuts, len(blocks.first)]))
        for a, b in (spans[k] for k in self.order):
            own = slice(edges[a], edges[b])
            columns = (
                getattr(self.whole, name)
                for name in (
                    "lon",
                    "lat",
                    "probability",
                    "status",
                    "scenario",
                    "family",
                    "world",
                    "member",
                )
            )
            yield Snapshot(
                self.whole.time,
                *(None if c is None else c[own] for c in columns),
                blocks.some(a, b),
            )


@pytest.mark.thorough
@pytest.mark.parametrize("cuts", [[], [1], [2, 3, 5]])
def test_same_bits_for_particles_in_any_parts(cuts):
    """Copies, worlds, scenarios in blocks, weights over six orders, some off the map."""
    rng = np.random.default_rng(13)
    n, bounds = 30_000, (0, 9000, 30_000)
    own = {
        "weight": rng.random(n) * 10 ** rng.uniform(-6, 0, n),
        "scenario": np.repeat([0, 1], np.diff(bounds)),
        "status": rng.choice([Status.ADRIFT, Status.ASHORE, Status.SUNK], n),
    }
    family, world = np.sort(rng.integers(0, 5000, n)), np.arange(n) // 40
    one = dataclasses.replace(snapshot(*mixture(n, rng), **own), family=family, world=world)
    one = dataclasses.replace(one, cut=partials.cut_blocks(bounds, bounds[:-1], (4096, 4096)))
    order = rng.permutation(len(cuts) + 1).tolist()
    whole = forecast_build.build_forecast([one], scenarios=["a", "b"]).data
    assert whole.identical(
        forecast_build.build_forecast([InParts(one, cuts, order)], scenarios=["a", "b"]).data
    )


@pytest.mark.parametrize("order", [[0, 1, 2], [2, 1, 0], [1, 2, 0]])
def test_the_heaviest_and_the_lightest_of_all_parts_count(order):
    """Maps tell by them whether all weigh alike, and squares of weights are summed in units of the
    heaviest.
    """
    rng = np.random.default_rng(14)
    n = 3 * partials.BLOCK
    weight = np.repeat([5.0, 2.0, 3.0], partials.BLOCK)
    status = np.full(n, Status.ADRIFT)
    weight[7], status[7] = 9.0, Status.SUNK  # off the map
    one = snapshot(*normal(n, rng), weight=weight, status=status)
    one = dataclasses.replace(one, cut=partials.cut_blocks((0, n), (0,), (partials.BLOCK,)))
    found = survey.survey_output(InParts(one, [1, 2], order), 1)
    share = one.probability[status == Status.ADRIFT]
    assert (found.lightest, found.heaviest) == (share.min(), share.max())


def test_nothing_on_the_map():
    one = snapshot(*normal(50, np.random.default_rng(0)), status=np.full(50, Status.PENDING))
    later = snapshot(*normal(50, np.random.default_rng(0)), time=TIME + np.timedelta64(6, "h"))
    for snapshots in ([one], [one, later]):
        made = forecast_build.build_forecast(snapshots, scenarios=["x"])
        assert float(made.data["probability"][0].sum()) == 0
        assert np.isnan(made.data["containment_area"].values[0]).all()
        assert np.isnan(made.data["mean_lat"].values[0])
        assert float(made.data["status_probability"].sel(status="pending")[0]) == pytest.approx(1)


@pytest.mark.parametrize("n", [1, 2, 3, 7, 5000])
def test_all_particles_in_one_point(n):
    made = forecast_build.build_forecast([snapshot(np.zeros(n), np.zeros(n))], scenarios=["x"])
    assert float(made.data["probability"].sum()) == pytest.approx(1, rel=1e-6)
    assert 0 < float(made.data["containment_area"][0, 2]) < 1000  # [m2]


def test_some_particles_without_weight():
    weight = np.ones(4000)
    weight[1000:] = 0
    east, north = normal(4000, np.random.default_rng(3))
    east[1000:] += 300e3  # nobody is there
    made = forecast_build.build_forecast([snapshot(east, north, weight=weight)], scenarios=["x"])
    assert made.data["lon"].values[-1] < LON + 0.5


def test_mean_positions_are_vector_means():
    rng = np.random.default_rng(2)
    n = 4000
    status = np.where(rng.random(n) < 0.3, Status.ASHORE, Status.ADRIFT)
    scenario = rng.integers(0, 2, n)
    one = snapshot(
        rng.normal(0, 60e3, n),
        rng.normal(0, 90e3, n),
        weight=rng.random(n),
        status=status,
        scenario=scenario,
        lon=179.9,
        lat=71.0,
    )
    status, scenario = one.status, one.scenario
    data = forecast_build.build_forecast([one], scenarios=["a", "b"]).data.isel(time=0)
    lon, lat = np.radians(sphere.to_degrees(one.lon)), np.radians(sphere.to_degrees(one.lat))
    xyz = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])

    def mean(which):
        x, y, z = (xyz * np.where(which, one.probability, 0)).sum(axis=1)
        return np.degrees(np.arctan2(y, x)) % 360, np.degrees(np.arctan2(z, np.hypot(x, y)))

    found = [(data[f"{k}_lon"].item() % 360, data[f"{k}_lat"].item()) for k in ("mean", "datum")]
    np.testing.assert_allclose(found, [mean(status >= 0), mean(status == Status.ADRIFT)], atol=1e-9)
    np.testing.assert_allclose(
        data["scenario_mean_lat"].values[1], mean(scenario == 1)[1], atol=1e-9
    )


def test_groups_hold_runs_of_slots_together_and_share_evenly():
    group = cloud.group(np.arange(100_000), 100_000)
    assert (np.diff(group.reshape(-1, 32), axis=1) == 0).all()
    # 3125 runs: 4 standard errors of a share of 1/4 are 3.1 %
    assert abs(np.bincount(group, minlength=4) / 1e5 - 0.25).max() < 0.031
    assert len(set(cloud.group(np.arange(40), 40))) == 4
