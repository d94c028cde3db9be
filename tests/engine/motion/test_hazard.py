"""Distress along a trackline by a hazard of place and time: closed forms, and the product of prior
and hazard on a fine lattice in float64, also across the antimeridian.
"""

from pathlib import Path

import hazards
import numpy as np
import pytest
import trial_case
from scipy import stats

import drift
from drift.engine.motion import prior
from drift.pipeline import run_setup
from geo import sphere
from kernels.runtime import runtime

N = 40_000
PLACES = {"Gulf": (-86.63, 27.21), "antimeridian": (179.41, -16.37)}
SPEED, HOURS = 5.3, 9.0  # [m/s], about the length of the voyage [h]


@pytest.fixture(autouse=True)
def _started() -> None:
    runtime.start()


def leg(place: str) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return a leg north-east of a place [deg], about 170 km long."""
    lon, lat = PLACES[place]
    return (lon, lat), (lon + 1.37, lat + 0.83)


def voyage(place: str, **keys) -> dict:
    way = [list(corner) for corner in leg(place)]
    return {"waypoints": way, "speed": f"{SPEED} m/s", "cross_track": "6 km", **keys}


def drawn(case: drift.Case) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the release [s], position [deg] and log weight of the particles."""
    where = run_setup.open_for(case)
    begun = run_setup.prepare(case, where)
    begun.scene.forcing.close()
    own = begun.ensemble
    lon, lat = (sphere.to_degrees(x.to_numpy()) for x in (own.lon, own.lat))
    return own.release.to_numpy().astype(float), lon, lat, own.log_weight.to_numpy()


def case_of(folder: Path, place: str, hazard: dict | None, **more) -> drift.Case:
    line = voyage(place, **more.pop("line", {}))
    own = {"position": None, "trackline": line, **more.pop("own", {})}
    own |= {"hazard": hazard} if hazard else {}
    tables = {"particles": N, "duration": "14 h", **more}
    return trial_case.load(folder, scenario=own, **tables)


def lasts(place: str) -> float:
    """Return the duration of the voyage [s]."""
    a, b = leg(place)
    ends = hazards.great_circle(a, b, np.array([0.0, 1.0]))
    return hazards.RADIUS * np.arccos(ends[0] @ ends[1]) / SPEED


def field(place: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return longitudes from the west, latitudes, and a hazard that is no plane."""
    (west, south), (east, north) = leg(place)
    lon, lat = np.linspace(west - 0.5, east + 0.5, 24), np.linspace(south - 0.5, north + 0.5, 19)
    x, y = np.meshgrid(lon - west, lat - south)
    return lon, lat, 0.2 + np.sin(2.1 * x + 0.4) ** 2 * np.exp(0.7 * y)


def bilinear(lon: np.ndarray, lat: np.ndarray, values: np.ndarray):
    """Return a function of places [deg] that interpolates a field as SciPy does."""
    from scipy.interpolate import RegularGridInterpolator

    inner = RegularGridInterpolator((lat, lon), values)
    return lambda x, y: inner(np.stack(np.broadcast_arrays(y, (x - lon[0]) % 360 + lon[0]), -1))


def agrees(values: np.ndarray, truth: np.ndarray, share: np.ndarray) -> None:
    """Assert that a sample has a distribution on a lattice: Kolmogorov and Smirnov at 1e-4."""
    found = np.searchsorted(np.sort(values), truth, side="right") / values.size
    edges = np.cumsum(share)
    # the lattice's own step, and the quantile of the statistic
    assert np.abs(found - edges).max() < 2.23 / np.sqrt(values.size) + share.max()


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("mode", [None, 0.63])
def test_a_field_gives_the_product_of_law_and_hazard(
    place: str, mode: float | None, tmp_path: Path
) -> None:
    a, b = leg(place)
    lon, lat, values = field(place)
    hazards.write(tmp_path / "risk.nc", values, lon, lat)
    line = {"distress": {"triangular": {"mode": mode}}} if mode else {}
    release, x, y, weight = drawn(case_of(tmp_path, place, {"file": "risk.nc"}, line=line))
    assert np.ptp(weight) == 0
    at = bilinear(lon, lat, values)
    law = stats.triang(mode).pdf if mode else np.ones_like
    share, off, joint = hazards.posterior(a, b, 6000.0, law, lambda s, x, y: at(x, y))
    agrees(release / lasts(place), share, joint.sum(axis=1))
    agrees(hazards.right_of(a, b, x, y), off + 5 / 121 * 6000.0, joint.sum(axis=0))
    # the mean hazard at the particles, of both together
    mean = (joint * at(*_places(a, b, share, off))).sum()
    there = at(x, y)
    assert abs(there.mean() - mean) < 4 * there.std() / np.sqrt(N)


def _places(a, b, share, off) -> tuple[np.ndarray, np.ndarray]:
    found: list[np.ndarray] = []
    ones = np.ones_like
    hazards.posterior(a, b, 6000.0, ones, lambda s, x, y: found.extend((x, y)) or ones(x))
    return found[0], found[1]


def test_a_linear_hazard_in_time_has_a_closed_form(tmp_path: Path) -> None:
    """A hazard 1 + 3 s at the share s: the distribution is (s + 1.5 s^2) / 2.5."""
    lon, lat, _ = field("Gulf")
    whole = lasts("Gulf") / 3600
    values = np.ones((2, lat.size, lon.size)) * np.array([1.0, 4.0])[:, None, None]
    hazards.write(tmp_path / "risk.nc", values, lon, lat, hours=[0.0, whole])
    found = drawn(case_of(tmp_path, "Gulf", {"file": "risk.nc", "outside": 4.0}))
    s = np.sort(found[0] / lasts("Gulf"))
    assert stats.kstest(s, lambda s: (s + 1.5 * s**2) / 2.5).pvalue > 1e-4


def test_a_hazard_by_wind_follows_the_law_of_changes(tmp_path: Path) -> None:
    """A wind that rises and falls: 1 / (1 + exp((10 - w) / 1.7)) by quadrature."""
    speeds, ends = np.array([4.0, 17.0, 6.0]), np.array([0.0, 5.0, 14.0])
    rows = [
        {"time": f"+{h} h", "speed": f"{w} m/s", "from": 200}
        for h, w in zip(ends, speeds, strict=True)
    ]
    case = case_of(
        tmp_path,
        "antimeridian",
        {"wind": "10 m/s", "width": "1.7 m/s"},
        wind={"table": rows},
    )
    release = drawn(case)[0]
    whole = lasts("antimeridian")
    share = (np.arange(4000) + 0.5) / 4000
    wind = np.interp(share * whole / 3600, ends, speeds)
    density = 1 / (1 + np.exp((10.0 - wind) / 1.7))
    agrees(release / whole, share + 0.5 / 4000, density / density.sum())


def test_shallow_water_by_depth_and_elsewhere(tmp_path: Path) -> None:
    """Elevations that are a plane: the share drawn where they are above -20 m."""
    lon, lat, _ = field("Gulf")
    x, y = np.meshgrid(lon - lon[0], lat - lat[0])
    height = -35.3 + 9.1 * x + 4.2 * y
    hazards.write(tmp_path / "bed.nc", height, lon, lat, "elevation", units="m")
    asked = {"file": "bed.nc", "depth": "20 m", "deeper": 0.3}
    _, px, py, _ = drawn(case_of(tmp_path, "Gulf", asked))
    at = bilinear(lon, lat, height)

    def hazard(s, x, y):
        return np.where(at(x, y) > -20, 1.0, 0.3)

    a, b = leg("Gulf")
    share, off, joint = hazards.posterior(a, b, 6000.0, np.ones_like, hazard)
    truth = joint[at(*_places(a, b, share, off)) > -20].sum()
    shallow = (at(px, py) > -20).mean()
    # the edge is drawn to within a cell of the voyage, and of the places across it
    assert 0.2 < truth < 0.9
    assert abs(shallow - truth) < 4 * np.sqrt(truth * (1 - truth) / N) + 2 / 1024


def test_outside_of_the_field_holds_the_value_given(tmp_path: Path) -> None:
    """A field of 2 over the first part of the leg alone, 0.5 beyond."""
    lon, lat, values = field("antimeridian")
    inside = lon < lon[0] + 1.2
    hazards.write(tmp_path / "risk.nc", np.full_like(values[:, inside], 2.0), lon[inside], lat)
    asked = {"file": "risk.nc", "outside": 0.5}
    _, x, _, _ = drawn(case_of(tmp_path, "antimeridian", asked, line={"cross_track": "1 m"}))
    edge = lon[inside][-1]
    within = ((x - lon[0]) % 360 < edge - lon[0]).mean()
    a, b = leg("antimeridian")
    share, off, joint = hazards.posterior(
        a,
        b,
        1.0,
        np.ones_like,
        lambda s, x, y: np.where((x - lon[0]) % 360 < edge - lon[0], 2, 0.5),
    )
    px = _places(a, b, share, off)[0]
    truth = joint[(px - lon[0]) % 360 < edge - lon[0]].sum()
    assert abs(within - truth) < 4 * np.sqrt(truth * (1 - truth) / N) + 2 / 1024


def test_a_constant_hazard_changes_the_law_by_nothing(tmp_path: Path) -> None:
    lon, lat, values = field("Gulf")
    hazards.write(tmp_path / "risk.nc", np.full_like(values, 3.7), lon, lat)
    plain = drawn(case_of(tmp_path, "Gulf", None))
    even = drawn(case_of(tmp_path, "Gulf", {"file": "risk.nc"}))
    # the same numbers, but for the rounding of float32 within a cell
    assert np.abs(plain[0] - even[0]).max() <= 0.01 * lasts("Gulf") / 1024 + 1
    assert np.array_equal(plain[3], even[3])


def test_scenarios_keep_their_weight(tmp_path: Path) -> None:
    """However small the hazard of one of them is."""
    lon, lat, values = field("Gulf")
    hazards.write(tmp_path / "risk.nc", 1e-6 * values, lon, lat)
    line = {"object": "water", "trackline": voyage("Gulf")}
    both = [
        {"name": "hit", "weight": 0.3, **line, "hazard": {"file": "risk.nc"}},
        {"name": "any", "weight": 0.7, **line},
    ]
    case = trial_case.load(tmp_path, scenario=both, particles=N, duration="14 h")
    where = run_setup.open_for(case)
    begun = run_setup.prepare(case, where)
    begun.scene.forcing.close()
    share = np.exp(begun.ensemble.log_weight.to_numpy().astype(float))
    cut = begun.ensemble.scenarios[0][1]
    assert share[:cut].sum() == pytest.approx(0.3, rel=1e-5)
    assert share.sum() == pytest.approx(1.0, rel=1e-5)


def test_a_shard_draws_its_slice_of_the_whole(tmp_path: Path) -> None:
    """Each slot draws for itself; what the hazard leaves out is not taken for land."""
    lon, lat, values = field("antimeridian")
    hazards.write(tmp_path / "risk.nc", values, lon, lat)
    case = case_of(tmp_path, "antimeridian", {"file": "risk.nc"})
    where = run_setup.open_for(case)
    spec = run_setup.spec_of(case, where)
    whole = prior.draw_ensemble(spec, None)
    assert whole.tried.tolist() == [[N, 0]]
    for own in prior.layout(spec).shards(3):
        part = prior.draw_ensemble(spec, None, own).ensemble
        for name in ("lon", "lat", "release", "log_weight"):
            cut = whole.ensemble.columns[name].to_numpy()[part.places]
            assert np.array_equal(part.columns[name].to_numpy(), cut), name


def test_a_field_ends_with_its_last_time(tmp_path: Path) -> None:
    lon, lat, values = field("Gulf")
    both = np.stack([values, values])
    hazards.write(tmp_path / "risk.nc", both, lon, lat, hours=[0.0, 4.0])
    asked = {"file": "risk.nc", "outside": 0}
    release = drawn(case_of(tmp_path, "Gulf", asked))[0]
    # a whole second, and a cell of the voyage
    assert 3.9 * 3600 < release.max() <= 4 * 3600 + 1 + lasts("Gulf") / 1024
