"""Searches for objects whose state changes: their sweep widths by state, what was seen, survival."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from changing import FAR, HOUR, case, column, within
from filtered import run, weights
from scipy import stats

from drift.engine.motion import changes
from drift.engine.particles.status import Status

ANCHORED = {"downwind": {"slope": "0 %"}, "name": "anchored"}
CAPSIZED = {"name": "capsized", "rate": "0.35/h"}
SUNK = {"name": "sunk", "from": ["unchanged", "capsized"], "rate": "0.1/h", "sinks": True}
AREA = """
[[sortie]]
name = "area"
start = "+1 h"
end = "+4 h"
speed = "60 kn"
law = "random"
sweep_width = "3.2 nmi"
sweep_width_after = { capsized = "0.8 nmi" }
area = { polygon = [[-88.2, 27.3], [-87.8, 27.3], [-87.8, 27.7], [-88.2, 27.7]] }
"""


def resting(folder: Path, own: list[dict[str, Any]], *more: str, **tables: Any) -> Any:
    """Return the filter and particles of a case whose raft stays where it is."""
    tables = {"clock": {"step": "10 min"}, "particles": 3000, **tables}
    search, ensemble, _ = run(
        case(folder, own, *more, **{"scenario": {"object": ANCHORED}, **tables})
    )
    return search, ensemble


def test_each_state_is_swept_by_its_own_width(tmp_path: Path) -> None:
    """Random search of an area that holds all: the miss of every particle is exp(-C) by its own
    time in each state. Within the step of its change a particle is searched in either.
    """
    search, ensemble = resting(tmp_path, [CAPSIZED, SUNK], AREA)
    (sortie,) = search.updates.sorties
    whole, part = sortie.coverage[0], sortie.changed[0][1][0]
    assert part / whole == pytest.approx(0.25)
    came = [np.clip(column(ensemble, f"changed_{k}"), HOUR, 4 * HOUR) for k in (1, 2)]
    capsized, sunk = np.minimum(*came), came[1]
    exposure = (whole * (capsized - HOUR) + part * (sunk - capsized)) / (3 * HOUR)
    weight = column(ensemble, "log_weight")
    log_miss = weight - np.log(1 / ensemble.n)
    # half a step of ten minutes, between the two coverages
    bound = (whole - part) * 300 / (3 * HOUR)
    assert np.abs(log_miss + exposure).max() < bound + 1e-4
    # of the mean: these errors are uniform to either side
    wanted = np.log(np.exp(-exposure).mean())
    error = FAR * bound / np.sqrt(3 * ensemble.n)
    assert search.updates.all[0].log_evidence[-1] == pytest.approx(wanted, abs=error)


def test_an_unknown_width_is_one_in_all_states(tmp_path: Path) -> None:
    """A factor W of the gamma distribution with shape k: the miss is (1 + C / k)^-k, where C is
    the exposure of a particle in all its states together. Nothing else shares the factor.
    """
    shape = 1.0  # a standard deviation of 100 %
    area = AREA.replace("[[sortie]]", "[[sortie]]\nsweep_width_uncertainty = 1.0")
    search, ensemble = resting(tmp_path, [CAPSIZED], area, clock={"step": "2 min"})
    (sortie,) = search.updates.sorties
    whole, part = sortie.coverage[0], sortie.changed[0][1][0]
    capsized = np.clip(column(ensemble, "changed_1"), HOUR, 4 * HOUR)
    exposure = (whole * (capsized - HOUR) + part * (4 * HOUR - capsized)) / (3 * HOUR)
    log_miss = column(ensemble, "log_weight") - np.log(1 / ensemble.n)
    # half a step of two minutes, between the two coverages; the law is less steep than its exponent
    bound = (whole - part) * 60 / (3 * HOUR)
    # factors of their own in each state would give the product of two such means
    both = [whole * (capsized - HOUR) / (3 * HOUR), part * (4 * HOUR - capsized) / (3 * HOUR)]
    apart = sum(shape * np.log1p(own / shape) for own in both)
    wanted = shape * np.log1p(exposure / shape)
    assert np.abs(log_miss + wanted).max() < bound + 1e-3
    assert np.abs(apart - wanted).max() > 5 * bound


def test_pos_in_closed_form(tmp_path: Path) -> None:
    """The mean miss of an object that capsizes at a rate while it is searched, and cannot be found
    once it has sunk: exp(M t) of the hazards of change and detection.
    """
    from scipy.linalg import expm

    search, ensemble = resting(tmp_path, [CAPSIZED, SUNK], AREA, particles=9000)
    (update,), (sortie,) = search.updates.all, search.updates.sorties
    whole, part = sortie.coverage[0] / 3, sortie.changed[0][1][0] / 3
    rates = np.array([[-0.45, 0.35, 0.1], [0, -0.1, 0.1], [0, 0, 0]])
    begin = expm(rates)[0]
    survives = begin @ expm(3 * (rates - np.diag([whole, part, 0.0])))
    missed = np.exp(column(ensemble, "log_weight")) * ensemble.n
    error = missed.std() / np.sqrt(ensemble.n)
    assert abs(update.pos[-1] - (1 - survives.sum())) < FAR * error
    # given no find, capsized and sunk ones are likelier
    weight, state = weights(ensemble), column(ensemble, "state")
    later = survives @ expm(2 * rates) / survives.sum()
    ess = 1 / (weight**2).sum()
    for number, share in enumerate(later):
        assert within(weight[state == number].sum(), share, ess)
    assert ((state == 2) == (column(ensemble, "status") == Status.SUNK)).all()


def test_legs_see_only_the_state_that_they_can(tmp_path: Path) -> None:
    """A sweep width of zero after the change: who has capsized before the legs keeps its weight."""
    legs = """
[[sortie]]
name = "legs"
start = "+2 h"
speed = "90 kn"
sweep_width = "2 nmi"
sweep_width_after = { capsized = "0 nmi" }
waypoints = [[-88.6, 27.5], [-87.4, 27.52]]
"""
    _, ensemble = resting(tmp_path, [CAPSIZED], legs)
    came, weight = column(ensemble, "changed_1"), column(ensemble, "log_weight")
    before, after = came < 2 * HOUR - 600, came > 4 * HOUR
    first = np.float32(np.log(1 / ensemble.n))
    assert before.sum() > 300
    np.testing.assert_array_equal(weight[before], first)
    assert (weight[after] < first).all()


@pytest.mark.parametrize("state", ["capsized", "unchanged"])
def test_a_contact_in_a_state(tmp_path: Path, state: str) -> None:
    """Its evidence is that of the contact alone times the probability of the state."""
    seen = """
[[contact]]
name = "hull"
time = "+170 min"
[contact.position]
at = "27 31N 088 00W"
error = "1 nmi"
"""
    only = seen.replace("[contact.position]", f'state = "{state}"\n[contact.position]')
    plain, _ = resting(tmp_path, [CAPSIZED], seen, particles=8000)
    search, ensemble = resting(tmp_path, [CAPSIZED], only, particles=8000)
    came = column(ensemble, "changed_1")
    weight = weights(ensemble)
    assert (weight[(came <= 170 * 60) != (state == "capsized")] == 0).all()
    chance = np.exp(-0.35 * 170 / 60)
    wanted = 1 - chance if state == "capsized" else chance
    ratio = np.exp(search.updates.all[0].log_evidence[-1] - plain.updates.all[0].log_evidence[-1])
    ess = plain.updates.all[0].ess_after
    assert within(ratio, wanted, ess)


def test_survival_is_the_product_over_states(tmp_path: Path) -> None:
    """A person leaves the raft: 20 h in it, half as alive after 1.5 h in the water. SciPy's
    lognormal laws, at any time.
    """
    own = [
        {"name": "in the water", "rate": "0.5/h", "survival": {"median": "90 min", "spread": 1.7}}
    ]
    raft = {"object": ANCHORED, "survival": {"median": "20 h", "spread": 1.4}}
    search, ensemble = resting(
        tmp_path,
        own,
        AREA.replace("capsized", "in the water").replace("{ in the water", '{ "in the water"'),
        scenario=raft,
    )
    scenarios, time = search._spec.scenarios, 5.5 * HOUR
    release, law = changes.survival_clocks(ensemble, scenarios, time)
    first, second = scenarios[0].survivals
    alive = np.where(law == 0, first.alive(time - release), second.alive(time - release))
    came = column(ensemble, "changed_1")
    before, after = np.minimum(came, time), np.maximum(time - came, 0)
    wanted = stats.lognorm(np.log(1.4), scale=20 * HOUR).sf(before) * np.where(
        after > 0, stats.lognorm(np.log(1.7), scale=1.5 * HOUR).sf(after), 1.0
    )
    np.testing.assert_allclose(alive, wanted, rtol=1e-6, atol=1e-9)
    # found alive: fewer than found
    (update,) = search.updates.all
    assert 0 < update.alive[-1] < 0.9 * update.pos[-1]
