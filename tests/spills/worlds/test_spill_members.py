"""A spill in an ensemble of currents: a member belongs to a world, and the finds say which it was."""

import json
from pathlib import Path

import numpy as np
import pytest

import drift
from drift.engine.environment.forcing_spec import ForcingSpec
from drift.engine.particles import members, partials
from drift.pipeline import run_setup
from drift.spills.backtrack import backward
from drift.spills.worlds import shrinkage, worlds
from drift.spills.worlds.worlds import Proposal
from geo import sphere
from geo.array import Array
from geo.errors import UserError

MEMBERS = 5
FLOW = np.array(
    [[0.3, 0.0], [-0.3, 0.0], [0.0, 0.3], [-0.3, 0.1], [-0.2, -0.2]]
)  # [m/s]; only the first leads to the coast
CASE = """
start = "2026-11-21T12:00Z"
duration = "40 h"
coast = {{ source = "land.geojson" }}
seed = 3
{uncertainty}

[output]
every = "20 h"

[[current]]
name = "ensemble"
members = [{rows}]

[domain]
west = 3
east = 6
south = -1.5
north = 1.5

[spill]
objects = 50
worlds = {worlds}
per_world = 20
position = {{ at = [4.8, 0.0], error = "1 nmi", until = "+1 h" }}
redraws = {redraws}

[[spill.class]]
name = "drum"
object = "water"
{find}
"""
FIND = """
[[find]]
name = "a drum"
at = [5.0, 0.0]
time = "+38 h"
"""


def load(
    folder: Path, count: int = 400, find: str = FIND, redraws: int = 0, uncertainty: str = ""
) -> drift.Case:
    """Return the case beside a coast that runs north and south at 5 E."""
    ring = [[5.0, -1.4], [5.9, -1.4], [5.9, 1.4], [5.0, 1.4], [5.0, -1.4]]
    land = {
        "type": "Feature",
        "properties": {},
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }
    (folder / "land.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": [land]})
    )
    rows = ", ".join(f"{{ constant = {{ east = {u}, north = {v} }} }}" for u, v in FLOW.tolist())
    text = CASE.format(rows=rows, worlds=count, find=find, redraws=redraws, uncertainty=uncertainty)
    (folder / "case.toml").write_text(text)
    return drift.load(folder / "case.toml")


def test_a_world_has_one_member_and_all_its_objects_drift_in_it(tmp_path: Path) -> None:
    case = load(tmp_path)
    begin = run_setup.prepare(case, run_setup.open_for(case))
    begin.scene.forcing.close()
    member, world = members.member_of_particles(begin.ensemble), begin.ensemble.world.to_numpy()
    assert member is not None
    assert begin.worlds is not None
    assert begin.worlds.member is not None
    assert np.array_equal(member, begin.worlds.member[world])
    assert (np.diff(begin.worlds.member) >= 0).all()
    assert np.bincount(begin.worlds.member).tolist() == [80] * MEMBERS


def test_worlds_of_unequal_members_weigh_alike(tmp_path: Path) -> None:
    """Dealt in whole blocks of worlds where there are enough; then the numbers differ, and the
    weights make up for it.
    """
    case = load(tmp_path, members.ENOUGH * MEMBERS * partials.WORLDS + 70)
    drawn = worlds.draw_worlds(
        case.spill, 7, lambda lon, lat: np.zeros(lon.shape, bool), members=MEMBERS
    )  # type: ignore[arg-type]
    assert drawn.member is not None
    counts = np.bincount(drawn.member)
    assert counts[0] % partials.WORLDS == 0
    assert np.ptp(counts) > 0
    assert np.bincount(drawn.member, np.exp(drawn.log_weight)) == pytest.approx(
        drawn.size / MEMBERS
    )


def test_the_finds_tell_the_member(tmp_path: Path) -> None:
    """Only one member leads to where the drum lay: it is all but sure.

    What others have of it is what worlds borrow of each other, where a few particles are all that
    is known: under 1 %.
    """
    result = drift.run(load(tmp_path))
    table = result.tables["members"]
    assert table["prior"].to_numpy() == pytest.approx(0.2)
    assert table["posterior"][0] > 0.99
    assert table["posterior"].sum() == pytest.approx(1)
    assert table["lon"][0] == pytest.approx(5.0, abs=0.01)
    silent = drift.run(load(tmp_path, find=""))
    assert silent.tables["members"]["posterior"].to_numpy() == pytest.approx(0.2)


def test_worlds_borrow_strength_of_their_own_member_alone() -> None:
    """Three worlds of one member among many of another: nothing near them is counted but each
    other.
    """
    latent = np.random.default_rng(2).standard_normal((203, 2))
    member = np.array([0] * 100 + [1] * 3 + [2] * 100, np.int32)
    alike = shrinkage.world_similarity(latent, member)
    count = np.where(member == 1, 1.0, 1000.0)
    assert alike.near.shape[1] > 3
    assert alike.nearby(count)[member == 1].tolist() == [2.0] * 3
    assert (alike.nearby(count)[member != 1] == 1000.0 * alike.near.shape[1]).all()


def test_worlds_drawn_anew_keep_to_the_law_of_members(tmp_path: Path) -> None:
    """From any proposal over latents and members: weights have mean 1, members weigh 1/M each,
    latents are normal.

    Within 4.5 standard errors of the mean of so many products.
    """
    case, random = load(tmp_path), np.random.default_rng(5)
    k = worlds.draw_worlds(case.spill, 1, _at_sea, count=50).latent.shape[1]  # type: ignore[arg-type]
    # none at two members: only the prior's share reaches them
    centre = np.array([0, 0, 1, 3], np.int32)
    proposal = Proposal(
        0.5 * random.standard_normal((4, k)),
        np.array([0.4, 0.2, 0.3, 0.1]),
        0.8 * np.eye(k),
        centre,
        MEMBERS,
    )
    drawn = worlds.draw_worlds(case.spill, 9, _at_sea, proposal, count=60_000)  # type: ignore[arg-type]
    assert drawn.member is not None
    assert (np.diff(drawn.member) >= 0).all()
    weight = np.exp(drawn.log_weight)

    def near(values: Array, expected: float) -> None:
        product = weight * values
        assert abs(product.mean() - expected) < 4.5 * product.std() / np.sqrt(product.size)

    near(np.ones(drawn.size), 1.0)
    for m in range(MEMBERS):
        near((drawn.member == m).astype(float), 1 / MEMBERS)
        near((drawn.member == m) * drawn.latent[:, 0], 0.0)
    near(drawn.latent[:, 0] ** 2, 1.0)


def _at_sea(lon: Array, lat: Array) -> Array:
    return np.zeros(np.shape(lon), bool)


def test_a_renewal_finds_the_same_member(tmp_path: Path) -> None:
    """With few worlds the finds leave too few, so worlds are drawn again about those: members are
    drawn with them.
    """
    result = drift.run(load(tmp_path, 100, redraws=2))
    assert result.aftermath is not None
    assert len(result.aftermath.rounds) > 1
    assert result.tables["members"]["posterior"][0] > 0.95
    assert np.bincount(result.aftermath.worlds.member)[0] > 50


@pytest.mark.thorough
def test_an_origin_is_a_mixture_over_the_members(tmp_path: Path) -> None:
    """A find at sea after T: in member k the release is normal about the find less u_k T, times the
    prior, in closed form.

    Members weigh as the density of what lies between find and prior. Within 3 standard errors, and
    the side of a cell.
    """
    spread, radius, hours = 8000.0, 3000.0, 10
    degree = np.radians(sphere.RADIUS)
    seen = np.array([4.75, 0.0]) * degree
    find = (
        f'\n[[find]]\nat = [4.75, 0.0]\ntime = "+{hours} h"\nat_sea = true\nradius = "{radius} m"\n'
    )
    case = load(tmp_path, find=find)
    text = case.path.read_text().replace(
        'error = "1 nmi", until = "+1 h"', f'std = "{spread} m", time = "+0 h"'
    )
    case.path.write_text(text)
    case = drift.load(case.path)
    where, spec = run_setup.open_for(case), run_setup.ensemble_spec(case)
    assert case.spill is not None
    found = backward.estimate_origin(
        case.spill,
        spec,
        run_setup.clock_spec(case),
        where,
        None,
        [-1],
        backward.Resolution(500, 100, 48, 1),
    )
    variance = spread**2 + radius**2
    begun = seen - FLOW * hours * 3600.0 - np.array([4.8, 0.0]) * degree
    share = np.exp(-(begun**2).sum(1) / (2 * variance))
    mean = (share / share.sum()) @ begun * spread**2 / variance + np.array([4.8, 0.0]) * degree
    side = float(np.diff(found.lon[:2])[0]) * degree
    assert np.array(found.mean[:2]) * degree == pytest.approx(
        mean, abs=3 * max(found.error[:2]) + side
    )
    alone = (seen - FLOW[0] * hours * 3600.0 - np.array([4.8, 0.0]) * degree) * spread**2 / variance
    # one member says something else
    assert np.abs(alone + np.array([4.8, 0.0]) * degree - mean).max() > 2000


def test_fewer_worlds_than_members_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"\[spill\] worlds: 4 are too few for 5 members"):
        worlds.draw_worlds(load(tmp_path).spill, 7, _at_sea, count=4, members=MEMBERS)  # type: ignore[arg-type]


def test_parts_of_a_source_are_its_members(tmp_path: Path) -> None:
    case = load(tmp_path)
    (spec,) = case.forcing["current"]
    assert isinstance(spec, ForcingSpec)
    assert [part.constant for part in spec.parts] == [tuple(flow) for flow in FLOW.tolist()]
