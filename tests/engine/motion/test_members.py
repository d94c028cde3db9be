"""Members of an ensemble of winds and currents: dealing, positions and posteriors against closed
forms.
"""

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

import drift
from drift.engine.motion import simulate
from drift.engine.particles import members, partials
from drift.pipeline import run_setup
from geo import sphere
from geo.array import Array
from geo.errors import UserError
from geo.grids.grid import Grid
from kernels.step.sample import Tiles

MEMBERS = 51
RNG = np.random.default_rng(8)
# [m/s], east and north, of each member
FLOW = RNG.normal([0.3, 0.1], [0.2, 0.12], (MEMBERS, 2)).round(3)
HOURS = 12
T = 3600.0 * HOURS

CASE = """
title = "members"
start = "2026-01-01T00:00Z"
duration = "12 h"
particles = {particles}
seed = {seed}
uncertainty = {uncertainty}

[coast]
source = "none"

[domain]
west = -17
east = -13
south = -2
north = 2

{current}

[[scenario]]
name = "drifts"
object = "water"
position = {{ at = [-15.0, 0.1], error = "2 nmi" }}

[output]
every = "6 h"
{more}
"""
DIFFUSION = 20.0  # [m2/s]
SPREADS = f'{{ current = "none", diffusivity = "{DIFFUSION} m2/s" }}'


def typed(flow: Array = FLOW) -> str:
    """Return a current whose members are typed."""
    rows = ", ".join(f"{{ constant = {{ east = {u}, north = {v} }} }}" for u, v in flow.tolist())
    return f'[[current]]\nname = "ensemble"\nmembers = [{rows}]'


def dataset(flow: Array, dim: str | None = "number", hours: int = HOURS) -> xr.Dataset:
    """Return uniform, steady currents (members, 2) as a file has them; without a dimension of
    members if dim is None.
    """
    lon, lat, time = np.linspace(-18, -12, 25), np.linspace(-3, 3, 21), np.arange(0, hours + 1, 3.0)
    coords: dict[str, Any] = {
        "time": ("time", time, {"units": "hours since 2026-01-01"}),
        "lat": ("lat", lat, {"units": "degrees_north"}),
        "lon": ("lon", lon, {"units": "degrees_east"}),
    }
    dims: tuple[str, ...] = ("time", "lat", "lon")
    if dim:
        dims, coords[dim] = (
            (dim, *dims),
            (dim, np.arange(len(flow)), {"standard_name": "realization"}),
        )
    data = xr.Dataset(coords=coords)
    for k, (name, side) in enumerate((("uo", "eastward"), ("vo", "northward"))):
        values = flow[:, k, None, None, None] if dim else flow[k, None, None, None]
        shape = tuple(len(coords[d][1]) for d in dims)
        attributes = {"units": "m s-1", "standard_name": f"{side}_sea_water_velocity"}
        data[name] = (dims, np.broadcast_to(values, shape).astype(np.float32), attributes)
    return data


def along(folder: Path) -> str:
    """Return a current whose members lie along a dimension of one file."""
    dataset(FLOW).to_netcdf(folder / "all.nc")
    return '[[current]]\nname = "ensemble"\nfiles = "all.nc"\nmembers = true'


def by_file(folder: Path) -> str:
    """Return a current of which each file is a member."""
    for k, flow in enumerate(FLOW):
        dataset(flow, None).to_netcdf(folder / f"member_{k:02d}.nc")
    return '[[current]]\nname = "ensemble"\nfiles = "member_*.nc"\nmembers = true'


def load(
    folder: Path,
    current: str,
    more: str = "",
    particles: int = 51 * 40,
    uncertainty: str = '"none"',
) -> drift.Case:
    """Return the case with a current."""
    text = CASE.format(
        current=current, more=more, particles=particles, uncertainty=uncertainty, seed=5
    )
    (folder / "case.toml").write_text(text)
    return drift.load(folder / "case.toml")


def moved(case: drift.Case) -> tuple[Array, Array, Array]:
    """Return the way of each particle east and north [m], (2, n), and its latitude before [rad] and
    its member, (n,).
    """
    where = run_setup.open_for(case)
    begin = run_setup.prepare(case, where)
    lon, lat = begin.ensemble.lon.to_numpy(), begin.ensemble.lat.to_numpy()
    with closing(begin.scene.forcing):
        for _ in simulate.run(begin.ensemble, begin.scene, begin.clock, np.array([T])):
            pass
    north = (begin.ensemble.lat.to_numpy() - lat).astype(float) * sphere.UNIT * sphere.RADIUS
    east = (begin.ensemble.lon.to_numpy() - lon).astype(float) * sphere.UNIT * sphere.RADIUS
    member = members.member_of_particles(begin.ensemble)
    assert member is not None
    return np.stack([east, north]), lat * sphere.UNIT, member


WAYS: dict[str, Callable[[Path], str]] = {
    "typed": lambda folder: typed(),
    "dimension": along,
    "files": by_file,
}
Moved = tuple[Array, Array, Array]


@pytest.fixture(scope="module")
def each_way(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Moved]:
    """What `moved` returns, by the way in which members are given."""
    folder = tmp_path_factory.mktemp("members")
    return {name: moved(load(folder, make(folder))) for name, make in WAYS.items()}


@pytest.mark.parametrize("name", WAYS)
def test_each_particle_is_displaced_by_its_own_member(
    each_way: dict[str, Moved], name: str
) -> None:
    """In closed form: dlat = v T / R, and dlon = u / v (g(lat + dlat) - g(lat)) with g the inverse
    Gudermannian.

    A step rounds twice to 9.3 mm: of s steps no end is off by more than s of them.
    """
    way, lat, member = each_way[name]
    assert np.bincount(member).tolist() == [40] * MEMBERS
    u, v = FLOW.astype(np.float32).astype(float)[member].T
    rise = v * T / sphere.RADIUS
    g = [np.arctanh(np.sin(x)) for x in (lat, lat + rise)]
    dlon = np.where(
        np.abs(v) > 1e-9,
        u / np.where(v == 0, 1, v) * (g[1] - g[0]),
        u * T / sphere.RADIUS / np.cos(lat),
    )
    steps = 12  # of an hour: the error of RK4 in a uniform current is far below a rounding
    rounding = steps * sphere.UNIT * sphere.RADIUS
    assert np.abs(way[1] - v * T).max() < rounding
    # In single precision the way of a step is known to 6e-8 of itself, 1 m/s for an hour.
    assert np.abs(way[0] - dlon * sphere.RADIUS).max() < rounding


def test_three_ways_to_give_members_give_the_same_bits(each_way: dict[str, Moved]) -> None:
    first, *others = (way for way, _, _ in each_way.values())
    assert len(others) == 2
    assert all(np.array_equal(way, first) for way in others)


LOOK = """
[[look]]
name = "sonar"
time = "+12 h"
at = {at}
radius = "10 km"
sees = "nothing"
law = { exponential = 2 }
"""
RADIUS = 10_000.0  # [m]
AT = (-14.87, 0.14)


def exact(case: drift.Case, flow: Array) -> Array:
    """Return how likely the look's answer is in each member, in closed form.

    Positions in member k are Gaussian about m_k with variance s^2 = s0^2 + 2 D T a component; the
    look misses with 1 - exp(-r^2 / a^2), whose mean is 1 - exp(-|m_k|^2 / (a^2 + 2 s^2)) / (1 + 2
    s^2 / a^2).
    """
    prior = case.scenarios[0].prior
    variance = prior.major**2 + 2 * DIFFUSION * T  # type: ignore[union-attr]
    begin = np.radians([-15.0, 0.1]) * sphere.RADIUS
    off = begin + flow * T - np.radians(AT) * sphere.RADIUS
    seen = np.exp(-(off**2).sum(1) / (RADIUS**2 + 2 * variance)) / (1 + 2 * variance / RADIUS**2)
    return np.asarray(1 - seen)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "make",  # they give the same bits, as above
    [
        pytest.param(make, id=name, marks=[pytest.mark.thorough] * (name != "dimension"))
        for name, make in WAYS.items()
    ],
)
def test_the_posterior_of_the_members_is_that_of_the_mixture(tmp_path: Path, make: Any) -> None:
    """Within 3 standard errors: a member's weight is a mean of n likelihoods in [0, 1], of variance
    at most q (1 - q).
    """
    particles = 51 * 400
    case = load(
        tmp_path, make(tmp_path), LOOK.replace("{at}", f"[{AT[0]}, {AT[1]}]"), particles, SPREADS
    )
    result = drift.run(case)
    q = exact(case, FLOW)
    truth = q / q.sum()
    table = result.tables["members"]
    assert len(table) == MEMBERS
    assert table["prior"].to_numpy() == pytest.approx(1 / MEMBERS)
    found = table["posterior"].to_numpy()
    error = np.sqrt(q * (1 - q) / (particles / MEMBERS)) / q.sum()
    # A hundredth of what the look does to a weight, where hardly a particle is looked at: the plane
    # and single precision.
    apart = np.abs(found - truth) / (error + 0.01 * (1 - q) / q.sum())
    assert (apart**2).mean() < 1 + 3 * np.sqrt(2 / MEMBERS)
    assert truth.min() < 0.7 * truth.max()  # the look does tell members apart
    weights = result.summary["members"]["weights"]
    assert [row["posterior"] for row in weights.values()] == pytest.approx(found, rel=1e-6)
    assert result.posteriors is not None
    told = [quantity.quantity.name for quantity in result.posteriors.told]
    assert "member" in told
    last = result.posteriors.stages[-1].marginals[told.index("member")]
    assert last.table is not None
    assert last.table[-1] == pytest.approx(found, rel=1e-5)


def test_diffusion_makes_a_mixture_of_gaussians(tmp_path: Path) -> None:
    """Mean and variance of all: those of the members' means, and in each s0^2 + 2 D T, within 3
    standard errors.
    """
    particles = 51 * 400
    case = load(tmp_path, typed(), particles=particles, uncertainty=SPREADS)
    way, _, member = moved(case)
    within = way - FLOW[member].T * T
    variance = 2 * DIFFUSION * T
    assert np.abs(within.mean(axis=1)).max() < 3 * np.sqrt(variance / particles)
    assert within.var(axis=1) == pytest.approx(variance, rel=3 * np.sqrt(2 / particles))
    by_member = np.array([way[:, member == k].mean(axis=1) for k in range(MEMBERS)])
    apart = (by_member - FLOW * T) / np.sqrt(variance / 400)
    assert (apart**2).mean() == pytest.approx(1, abs=3 * np.sqrt(2 / apart.size))


def test_resampling_copies_the_member(tmp_path: Path) -> None:
    """Where a particle is at the end, less its member's way, one began that had this member."""
    look = (
        LOOK.replace("+12 h", "+6 h")
        .replace("{at}", f"[{AT[0]}, {AT[1]}]")
        .replace("nothing", "something")
    )
    case = load(
        tmp_path,
        typed(),
        f"[resampling]\nbelow = 0.9\n{look}".replace("[resampling]", "[resampling]", 1),
    )
    where = run_setup.open_for(case)
    begin = run_setup.prepare(case, where)
    first = begin.ensemble.lat.to_numpy().astype(np.int64)
    born = members.member_of_particles(begin.ensemble)
    with closing(begin.scene.forcing):
        search = run_setup.build_search_filter(case, begin)
        assert search is not None
        for _ in simulate.run(
            begin.ensemble, begin.scene, begin.clock, np.array([T]), search=search
        ):
            pass
    member = members.member_of_particles(begin.ensemble)
    assert born is not None
    assert member is not None
    assert np.bincount(member, minlength=MEMBERS).std() > 10  # some have many more than others now
    back = begin.ensemble.lat.to_numpy() - FLOW[member, 1] * T / sphere.RADIUS / sphere.UNIT
    for k in np.unique(member):
        apart = np.abs(back[member == k][:, None] - first[born == k])
        assert apart.min(axis=1).max() <= 12 + 1  # units of 9.3 mm, one a step


@given(st.integers(1, 60), st.integers(0, 2_000_000))
def test_members_are_dealt_in_runs_and_weigh_alike(many: int, more: int) -> None:
    member = members.deal(many + more, many)
    assert (np.diff(member) >= 0).all()
    counts = np.bincount(member, minlength=many)
    assert counts.size == many
    assert counts.min() > 0
    weight = np.exp(members.even(member, many))
    assert np.bincount(member, weight) == pytest.approx(1 / many)
    begins = np.searchsorted(member, np.arange(many))
    if many + more >= members.ENOUGH * many * partials.BLOCK:
        assert (begins % partials.BLOCK == 0).all()
        assert counts.max() <= counts.min() * (1 + 1 / members.ENOUGH) + partials.BLOCK
    else:
        assert np.ptp(counts) <= 1


def test_a_tile_tells_each_point_by_its_own_member() -> None:
    """Two tiles by priority, the first with three members of which one has a hole, the second alike
    for all.
    """
    grid, other = Grid(5.0, 40.0, 1.0, 1.0, 5, 4), Grid(4.0, 39.0, 0.5, 0.5, 20, 16)
    tiles = Tiles([grid, other], members=[3, 1])
    for k in range(3):
        values = np.full((4, 5, 2), [k + 1.0, -k], np.float32)
        if k == 1:
            values[:, :2] = np.nan
        for later in (False, True):
            tiles.place(0, values * (1 + later), later=later, member=k)
    for later in (False, True):
        tiles.place(1, np.full((16, 20, 2), 9.0, np.float32), later=later)
    tiles.blend([(0.0, 1.0), (0.0, 1.0)])
    lon, lat = sphere.to_binary([5.5, 5.5, 5.5, 8.5, 4.2]), sphere.to_binary([41.5] * 5)
    found = tiles.at(0, 2, lon, lat, 0.5, np.array([0, 1, 2, 1, 2], np.int32))
    assert found[:, 0] == pytest.approx([1.5, 9.0, 4.5, 3.0, 9.0])
    assert found[:, 1] == pytest.approx([0.0, 9.0, -3.0, -1.5, 9.0])
    assert (found[:, 2] == 1).all()
    # without members asked for: the first
    assert tiles.at(0, 2, lon[:1], lat[:1], 0.0)[0, 0] == 1.0


def test_two_ensembles_of_different_numbers_are_refused_in_a_line(tmp_path: Path) -> None:
    wind = '\n[[wind]]\nname = "gusts"\nmembers = [{ constant = { east = 5, north = 1 } }, { constant = { east = 6, north = 0 } }]'
    case = load(tmp_path, (typed() + wind), "").path
    text = case.read_text().replace('object = "water"', 'object = "PIW-1"')
    case.write_text(text)
    with pytest.raises(
        UserError, match=r'same number of members.*51 of current "ensemble", 2 of wind "gusts"'
    ) as refused:
        run_setup.open_for(drift.load(case))
    assert len(refused.value.lines) == 1


def test_wind_and_current_go_together_and_one_may_have_none(tmp_path: Path) -> None:
    """Windage 10 % straight downwind: member k of one with member k of the other."""
    flow, wind = FLOW[:3], np.array([[5.0, 0.0], [0.0, 6.0], [-7.0, 1.0]])
    rows = ", ".join(f"{{ constant = {{ east = {u}, north = {v} }} }}" for u, v in wind.tolist())
    both = f"{typed(flow)}\n\n[[wind]]\nmembers = [{rows}]"
    one = f"{typed(flow)}\n\n[[wind]]\nconstant = {{ east = 5, north = 0 }}"
    for current, air in ((both, wind), (one, wind[[0, 0, 0]])):
        load(tmp_path, current, particles=300)
        path = tmp_path / "case.toml"
        path.write_text(
            path.read_text().replace(
                'object = "water"', 'object = { name = "buoy", windage = 0.1 }'
            )
        )
        way, _, member = moved(drift.load(path))
        assert way[1] == pytest.approx(
            (flow + 0.1 * air)[member, 1] * T, abs=12 * 0.0093 + 1e-6 * 3e4
        )


def test_fewer_particles_than_members_are_refused(tmp_path: Path) -> None:
    case = load(tmp_path, typed(), particles=50)
    with pytest.raises(UserError, match=r"50 of the 50 particles.*51 members.*raise particles"):
        run_setup.prepare(case, run_setup.open_for(case))


def test_a_run_without_members_has_no_column(tmp_path: Path) -> None:
    case = load(tmp_path, "[[current]]\nconstant = { east = 0.1, north = 0.1 }", particles=100)
    begin = run_setup.prepare(case, run_setup.open_for(case))
    begin.scene.forcing.close()
    assert "member" not in begin.ensemble.columns
    assert begin.scene.forcing.tiles.members == 1
