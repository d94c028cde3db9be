"""Every shipped case without sorties and finds against a second opinion in plain float64
(tests/oracles/second_opinions/oracle.py).

No oracle is had for worlds that finds weigh (gulf_containers) and for what refloats (paria): here
they run without. The areas of what is partly ashore are none either: they hold cells of the map
along a line.
"""

import numpy as np
import pytest
import shipped
from case_answers import SIGMAS, agrees, flat, ours, theirs
from case_worlds import overdue_yacht, world_of
from oracle import Array

from drift.case import file as case_file
from drift.engine.particles.status import Status
from drift.pipeline import flow


@pytest.mark.thorough
def test_yachts_are_where_a_second_opinion_says() -> None:
    """Shares, means and second moments 84 h after the departure, under way, adrift, ashore and in
    port.
    """
    theirs = overdue_yacht(np.random.default_rng(20_260_605), 3_000)
    settings = {"particles": "24_000", "output": '{ every = "100 d", trajectories = 1_000_000 }'}
    result = flow.run(case_file.load("overdue_yacht", settings))
    assert shipped.misses(result) == []
    tracks = result.trajectories
    kinds = (Status.ADRIFT, Status.ASHORE, Status.UNDER_WAY, Status.ARRIVED)

    def told(lon: Array, lat: Array, fate: Array) -> tuple[Array, Array]:
        x, y = flat(lon, lat, (-85.0, 28.8)).T
        a, b = x - x.mean(), y - y.mean()
        columns = np.stack([*(fate == kind for kind in kinds), x, y, a * a, b * b, a * b], axis=1)
        return columns.mean(axis=0), columns.std(axis=0) / np.sqrt(lon.size)

    for number, (x, y, fate, _) in enumerate(theirs):
        mine = tracks.scenario == number
        lon, lat = (at[mine, -1].astype(float) * 360 / 2**32 for at in (tracks.lon, tracks.lat))
        (here, e), (there, f) = told(lon, lat, tracks.status[mine, -1]), told(x, y, fate)
        apart = (here - there) / np.maximum(np.hypot(e, f), 1e-300)
        assert (np.abs(apart[here != there]) < SIGMAS).all(), (number, here, there, apart)


UNSEARCHED = (
    "gulf_containers",
    "washington_piw",
    "biscay_drifter",
    "paria_boat",
    "paria",
    "washington_drums",
)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.thorough] * (name != "washington_piw"))
        for name in UNSEARCHED
    ],
)
def test_case_is_what_a_second_opinion_says(
    name: str, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(20_260_601)
    world, about = world_of(name, rng, request, monkeypatch)
    settings = {"sortie": "[]"} | ({"coast": "{}"} if name == "paria" else {})
    agrees(ours(name, about, settings)[0], theirs(world, rng, about))
