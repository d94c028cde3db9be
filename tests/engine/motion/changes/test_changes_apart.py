"""Changes of state in shards, after resampling, and of OpenDrift's capsizing on the same wind."""

from pathlib import Path

import numpy as np
import pytest
import trial_case
import xarray as xr
from changing import FAR, HOUR, PLAIN, case, column, within
from filtered import run
from scipy import integrate, stats
from scipy.interpolate import RegularGridInterpolator

from drift.engine.motion import prior, simulate
from drift.pipeline import run_setup
from kernels.runtime import runtime

CHANGES = [
    {"name": "capsized", "rate": "0.5/h", "wind": "16 m/s", "object": "PIW-1"},
    {"name": "sunk", "from": "capsized", "rate": "0.3/h", "sinks": True},
]


def test_a_shard_changes_as_within_the_whole(tmp_path: Path) -> None:
    """Also when the steps are launched one by one: each column of the slots of one block."""
    own = case(tmp_path, CHANGES, particles=9000, duration="3 h", clock={"step": "30 min"})
    _, whole, _ = run(own)
    first, last = 4096, 8192
    runtime.start()
    begin, spec = run_setup.prepare(own, run_setup.open_for(own)), run_setup.ensemble_spec(own)
    part = prior.draw_ensemble(spec, None, whole.layout.some(first, last)).ensemble
    times = np.arange(0, 3 * 3600 + 1, 1800)
    for _ in simulate.run(part, begin.scene, begin.clock, times):
        pass
    begin.scene.forcing.close()
    assert 0 < (column(part, "state") == 2).sum() < part.n
    for name in part.columns:
        np.testing.assert_array_equal(column(part, name), column(whole, name)[first:last], name)


CONTACT = """
[[contact]]
name = "seen"
time = "+2 h"
[contact.position]
at = "27 30N 087 59W"
error = "1 nmi"
[resampling]
below = 0.9
"""


@pytest.mark.parametrize("law", [{}, {"wind": "17 m/s"}], ids=["rate", "wind"])
def test_copies_wait_each_for_itself(tmp_path: Path, law: dict[str, str]) -> None:
    """After resampling at 2 h: of those unchanged then, the share that changes until 6 h, whatever
    their ancestor; copies that share a time that the case gave share it still.
    """
    changes = [
        {"name": "capsized", "rate": "0.3/h", "leeway": 1, **law},
        {"name": "swamped", "from": ["unchanged", "capsized"], "rate": "0.2/h", "leeway": 1},
        {"name": "silent", "from": ["capsized", "swamped"], "at": ["+3 h", "+5 h"]},
    ]
    # the raft rests, so that the weights do not depend on its state
    quiet = {"wind": PLAIN["wind"] | {"name": "gale"}, "clock": {"step": "30 min"}}
    still = {"object": {"downwind": {"slope": "0 %"}, "name": "anchored"}}
    own = case(tmp_path, changes, CONTACT, **quiet, scenario=still, particles=12_000)
    search, ensemble, _ = run(own)
    lineage, rate = search._history.lineage, (0.15 if law else 0.3) + 0.2
    assert lineage is not None
    first = np.minimum(column(ensemble, "changed_1"), column(ensemble, "changed_2"))
    later = first > 2 * HOUR
    changed = first < 6 * HOUR
    assert within(changed[later].mean(), 1 - np.exp(-4 * rate), int(later.sum()))
    scale = HOUR / rate
    found = stats.kstest(
        first[later & changed] - 2 * HOUR, stats.truncexpon(4 * rate, scale=scale).cdf
    )
    assert found.pvalue > 1e-3
    order = np.lexsort((np.arange(ensemble.n), lineage))
    twins = (lineage[order][1:] == lineage[order][:-1]) & later[order][1:] & later[order][:-1]
    one, other = first[order][1:][twins], first[order][:-1][twins]
    both = (one < 6 * HOUR) & (other < 6 * HOUR)
    assert both.sum() > 300
    # whole seconds among hours: equal ones are rare
    assert (one[both] == other[both]).mean() < 0.01
    wait = column(ensemble, "wait_3")[order]
    assert (wait[1:][twins] == wait[:-1][twins]).all()


@pytest.mark.thorough
def test_opendrift_capsizes_as_often_in_the_same_wind(data: Path, tmp_path: Path) -> None:
    """Shares capsized in time off Norway, by OpenDrift's law, written again in NumPy.

    OpenDrift (opendrift/models/leeway.py, Leeway.update, version 1.14): in each step of dt an object
    capsizes with the probability p(W) dt / 1 h, p(W) = 0.5 + 0.5 tanh((W - threshold) / sigma), W at
    its begin. Ours is a hazard of the same size: rate 1/h, width sigma / 2. So ours is
    exp(-integral) where OpenDrift has the product of 1 - p dt, with p at the begins of steps: the
    integral differs by half of the first step and by half of the sum of (p dt)^2. Winds are
    interpolated by SciPy on the file's own grid; ours come from a lattice in longitude and
    latitude, which changes shares by up to 0.003.
    """
    file = data / "norkyst" / "arome_subset_16Nov2015.nc"
    threshold, sigma, step = 22.0, 5.0, 600.0
    place = (60.3, 3.7)
    own = trial_case.load(
        tmp_path,
        start="2015-11-16T06:00Z",
        duration="36 h",
        particles=6000,
        clock={"step": "10 min"},
        current=PLAIN["current"],
        wind={"files": str(file)},
        uncertainty=PLAIN["uncertainty"],
        scenario={
            "object": "water",
            "position": {"at": list(place[::-1]), "std": "1 m"},
            "change": [{"name": "capsized", "rate": "1/h", "wind": "22 m/s", "width": "2.5 m/s"}],
        },
    )
    _, ensemble, _ = run(own)
    came = column(ensemble, "changed_1")
    with xr.open_dataset(file) as wind:
        lat, lon = wind.latitude.values, wind.longitude.values
        # the place on the file's grid: where its latitude and longitude are these
        y, x = np.unravel_index(
            np.argmin((lat - place[0]) ** 2 + (np.cos(1.05) * (lon - place[1])) ** 2), lat.shape
        )
        fit = np.array(
            [
                [lat[y + 1, x] - lat[y, x], lat[y, x + 1] - lat[y, x]],
                [lon[y + 1, x] - lon[y, x], lon[y, x + 1] - lon[y, x]],
            ]
        )
        off = np.linalg.solve(fit, [place[0] - lat[y, x], place[1] - lon[y, x]])
        hours = (wind.time.values - np.datetime64("2015-11-16T06:00")) / np.timedelta64(1, "h")
        grid = (hours, np.arange(lat.shape[0]), np.arange(lat.shape[1]))
        when = np.linspace(0, 36, 36 * 60 + 1)
        points = np.stack(
            [when, np.full(when.size, y + off[0]), np.full(when.size, x + off[1])], axis=1
        )
        speed = np.hypot(
            *(
                RegularGridInterpolator(grid, wind[name].values)(points)
                for name in ("x_wind_10m", "y_wind_10m")
            )
        )
    chance = 0.5 + 0.5 * np.tanh((speed - threshold) / sigma)
    theirs = 1 - np.cumprod(1 - chance[:-1:10] * step / HOUR)
    exact = 1 - np.exp(-integrate.cumulative_simpson(chance, x=when, initial=0))
    for hour in (3, 6, 12, 18, 24, 30, 36):
        share, wanted = (came <= hour * HOUR).mean(), exact[60 * hour]
        other, error = theirs[6 * hour - 1], np.sqrt(wanted * (1 - wanted) / ensemble.n)
        print(
            f"{hour} h: OpenDrift's law {other:.4f}, its integral {wanted:.4f}, ours {share:.4f} +- {error:.4f}"
        )
        assert abs(share - wanted) < FAR * error + 0.003
        # their steps: half of a step's chance at the begin, and (p dt)^2 / 2 a step
        largest = chance.max() * step / HOUR
        assert abs(other - wanted) < (1 - wanted) * largest * (0.5 + 0.5 * np.log(1 / (1 - wanted)))
    assert 0.2 < theirs[-1] < 0.99
