"""The particle filter against exact Bayes on a grid and plain brute force."""

import dataclasses
import math

import numpy as np
import pytest
from filtered import BOX, FLOW, METRES, SQUARE, STILL, flown, hours, legs, load, run, weights
from scipy import stats

from drift.engine.particles.status import Status
from drift.evidence.filter import state
from drift.evidence.filter.records import (
    Contact,
    Fix,
    Law,
    Sortie,
)
from geo import sphere
from geo.errors import UserError
from geo.polyline import Area

# Exact Bayes: a 64 x 64 grid of cells across the antimeridian, nothing moves.

CELLS = 64
WEST, SOUTH, WIDE, HIGH = 179.84, -0.2, 0.32, 0.4


def _target():
    """Return twelve sorties on whole cells and three contacts, and the exact posterior of cells
    with its log evidence.

    The contact that may be false comes last: its belief is about what is known then.
    """
    random = np.random.default_rng(5)
    laws = [Law("random"), Law("inverse_cube"), Law("definite_range"), Law("m_beta", 0.8)]
    sorties, exact = [], np.full((CELLS, CELLS), 1 / CELLS**2)  # (lat, lon)
    for k in range(12):
        i, j = np.sort(random.choice(CELLS + 1, (2, 2), replace=False), axis=1)
        law, coverage = laws[k % 4], float(random.uniform(0.2, 1.2))
        # b(C) of each law, written out
        pod = [
            1 - math.exp(-coverage),
            math.erf(math.sqrt(math.pi) / 2 * coverage),
            min(coverage, 1.0),
            1
            - 0.2 ** math.floor(coverage / 0.8)
            * (1 - 0.8 * (coverage / 0.8 - math.floor(coverage / 0.8))),
        ][k % 4]
        lon = WEST + WIDE / CELLS * np.array([j[0], j[1], j[1], j[0]])
        lat = SOUTH + HIGH / CELLS * np.array([i[0], i[0], i[1], i[1]])
        exact[i[0] : i[1], j[0] : j[1]] *= 1 - pod
        begin = 0.3 * k
        sorties.append(
            Sortie(f"s{k}", "", hours(begin), hours(begin + 1.1), law, (1.0,), area=Area(tuple(lon), tuple(lat)), coverage=(coverage,))
        )  # fmt: skip
    contacts = []
    fine = 16  # midpoints across a cell
    y = SOUTH + HIGH * (np.arange(CELLS * fine) + 0.5) / (CELLS * fine)
    x = WEST + WIDE * (np.arange(CELLS * fine) + 0.5) / (CELLS * fine)
    told = [
        (180.02, 0.03, 9000.0, 1.0, 0.0),
        (180.07, 0.11, 5000.0, 1.0, 4e-9),
        (179.95, -0.05, 6000.0, 0.6, 0.0),
    ]
    for k, (lon, lat, std, belief, false) in enumerate(told):
        fixes = (Fix(lon, lat),)
        contacts.append(
            Contact(
                f"c{k}",
                hours(2 + 1.5 * k),
                "position",
                belief,
                fixes=fixes,
                major=std,
                minor=std,
                false_density=false,
            )
        )
        east, north = (x - lon) * METRES, (y - lat) * METRES  # at the equator, to 1e-5
        density = stats.norm.pdf(north[:, None], scale=std) * stats.norm.pdf(
            east[None, :], scale=std
        )
        density = density.reshape(CELLS, fine, CELLS, fine).mean(axis=(1, 3)) + false
        # within a cell the product of both contacts is not that of their means: 1e-3 of it at this
        # size
        exact_before = exact.copy()
        if belief < 1:
            mean = (exact * density).sum() / exact.sum()
            density = belief * density + (1 - belief) * mean
        exact = exact_before * density
    return sorties, contacts, exact / exact.sum(), math.log(exact.sum())


@pytest.mark.parametrize("n", [10_000, 160_000])
def test_exact_bayes(tmp_path, n):
    """Total variation from the exact posterior falls as 1/sqrt(N), and so does the error of the
    evidence.
    """
    sorties, contacts, exact, evidence = _target()
    case = load(
        tmp_path, STILL + BOX, sorties=tuple(sorties), contacts=tuple(contacts), particles=n
    )
    search, ensemble, _ = run(case)
    w = weights(ensemble)
    lon = (
        (ensemble.lon.to_numpy().astype(np.int64) - int(sphere.to_binary(WEST)))
        % 2**32
        * (360 / 2**32)
    )
    lat = sphere.to_degrees(ensemble.lat.to_numpy())
    j, i = (lon / WIDE * CELLS).astype(int), ((lat - SOUTH) / HIGH * CELLS).astype(int)
    found = np.zeros((CELLS + 1, CELLS + 1))
    np.add.at(found, (i, j), w)
    variation = (
        0.5 * np.abs(found[:CELLS, :CELLS] - exact).sum()
        + 0.5 * found.sum()
        - 0.5 * found[:CELLS, :CELLS].sum()
    )
    # A cell's weight is a mean of n numbers: its mean absolute deviation is sqrt(2 / pi) standard
    # deviations.
    posterior_over_prior = exact * CELLS**2
    expected = 0.5 * math.sqrt(2 / math.pi) * np.sqrt(exact * posterior_over_prior / n).sum()
    assert variation == pytest.approx(expected, rel=0.1)
    relative = math.sqrt((exact * posterior_over_prior).sum() / n)
    assert abs(search.updates.log_evidence - evidence) < 4 * relative
    print(
        f"n {n}: total variation {variation:.5f}, theory {expected:.5f}; log evidence {search.updates.log_evidence:.5f}, exact {evidence:.5f}"
    )


def test_sorties_together_find_what_their_failures_leave_out(tmp_path):
    """Cumulative POS is 1 less the chance that all fail: areas that overlap, so that neither sums
    nor products of others do.
    """
    lon = WEST + WIDE * np.array(
        [[0.0, 0.5, 0.5, 0.0], [0.25, 0.75, 0.75, 0.25], [0.0, 1.0, 1.0, 0.0]]
    )
    lat = SOUTH + HIGH * np.array([0.0, 0.0, 1.0, 1.0])
    coverage = (0.9, 1.3, 0.4)
    sorties = tuple(
        Sortie(f"s{k}", "", hours(k), hours(k + 1.1), Law("random"), (1.0,), area=Area(tuple(lon[k]), tuple(lat)), coverage=(c,))
        for k, c in enumerate(coverage)
    )  # fmt: skip
    n = 40_000
    search, _, _ = run(load(tmp_path, STILL + BOX, sorties=sorties, particles=n))
    a, b, c = coverage
    quarters = np.array([a, a + b, b, 0.0]) + c
    missed = np.exp(-quarters).mean()
    error = np.sqrt(np.var(np.exp(-quarters)) / n)
    assert abs(search.updates.all[-1].cumulative[-1] - (1 - missed)) < 4 * error
    middle = np.exp(-np.array([a, a + b, b, 0.0]))
    assert abs(search.updates.all[1].cumulative[-1] - (1 - middle.mean())) < 4 * np.sqrt(
        np.var(middle) / n
    )


def test_weights_as_if_no_sortie_had_been_flown_hold_what_was_seen(tmp_path):
    """They are those of the same run without its sorties: by them it is told what ran out of the
    domain.
    """
    fix = Contact(
        "seen",
        hours(1.5),
        "position",
        fixes=(Fix(180.03, 60.01),),
        major=5000.0,
        minor=3000.0,
        orientation=0.7,
    )
    track = legs([(-4000, -2000), (4000, -2000), (4000, 2000), (-4000, 2000)], 1.7, 10.0)
    case = load(tmp_path, FLOW, contacts=(fix,))
    seen, both = (
        run(dataclasses.replace(case, sorties=s))[:2]
        for s in ((), (flown("square", track, Law(), 900.0),))
    )
    expected = seen[1].log_weight.to_numpy().astype(np.float64)
    found = both[0].unsearched.whole("unsearched")
    np.testing.assert_allclose(found - found.max(), expected - expected.max(), atol=1e-5)
    assert np.ptp(expected) > 1
    assert np.ptp(both[1].log_weight.to_numpy() - expected) > 0.5


def test_what_has_left_cannot_be_seen(tmp_path):
    """Beyond the domain nobody knows where it is: such a particle can be no contact; one that
    leaves later can.
    """
    text = FLOW.replace('until = "+1 h"', "").replace(
        "[coast]", "[domain]\nwest = 179.8\nsouth = 59.9\neast = -179.9\nnorth = 60.2\n[coast]"
    )
    fix = Contact(
        "seen", hours(1.5), "position", fixes=(Fix(180.0, 60.0),), major=8000.0, minor=8000.0
    )
    _, ensemble, _ = run(load(tmp_path, "max_lost = 1" + text, contacts=(fix,)))
    left = ensemble.status.to_numpy() == Status.LEFT
    before = left & (ensemble.status_since.to_numpy() <= 1.5 * 3600)
    assert before.sum() > 20
    assert (left & ~before).sum() > 20
    np.testing.assert_array_equal(np.isneginf(ensemble.log_weight.to_numpy()), before)


def test_shared_sweep_width(tmp_path):
    """Twenty looks at C = 0.3 with an unknown factor of shape 4:

    SEARCH.md's chances of a miss, in closed form.
    """
    whole = Area((179.9, 180.1, 180.1, 179.9), (59.9, 59.9, 60.1, 60.1))
    misses = {}
    for name, shape, group in (
        ("known", math.inf, "one"),
        ("anew", 4.0, ""),
        ("shared", 4.0, "one"),
    ):
        sorties = tuple(
            Sortie(
                f"{k}", "", hours(0.2 * k), hours(0.2 * k + 0.2), Law("random"), (1.0,), shape,
                group or str(k), area=whole, coverage=(0.3,),
            )
            for k in range(20)
        )  # fmt: skip
        search, _, _ = run(load(tmp_path, STILL + SQUARE, sorties=sorties))
        misses[name] = math.exp(search.updates.log_evidence)
    assert misses["known"] == pytest.approx(math.exp(-6), rel=1e-4)
    assert misses["anew"] == pytest.approx((1 + 0.3 / 4) ** -80, rel=1e-4)
    assert misses["shared"] == pytest.approx((1 + 6 / 4) ** -4, rel=1e-4)  # 0.0256


def test_only_what_shares_an_unknown_holds_it_for_each_particle(tmp_path, monkeypatch):
    """It takes as many numbers a particle as the unknown has values."""
    made = []
    ready = state.ReportGroup.ready
    monkeypatch.setattr(
        state.ReportGroup, "ready", lambda group, n: made.append(group) or ready(group, n)
    )
    whole = Area((179.9, 180.1, 180.1, 179.9), (59.9, 59.9, 60.1, 60.1))
    for groups, holders in (("abc", 0), ("aba", 1), ("aab", 1)):
        sorties = tuple(
            Sortie(
                f"{k}", "", hours(0.3 * k), hours(0.3 * k + 0.5), Law("random"), (1.0,), 4.0, group,
                area=whole, coverage=(0.3,),
            )
            for k, group in enumerate(groups)
        )  # fmt: skip
        made.clear()
        search, *_ = run(load(tmp_path, STILL + SQUARE, sorties=sorties))
        assert len({id(group) for group in made if group in search._groups.values()}) == holders
        assert all(group.missed is None for group in search._groups.values())


def test_share_of_time_inside(tmp_path):
    """Half the time in an area at C = 2 is half of b(2) for a swept pattern, and e^-1 of a miss for
    random search.
    """
    ring = Area((179.0, 181.0, 181.0, 179.0), (59.9, 59.9, 60.1, 60.1))
    for kind, expected in (
        ("inverse_cube", math.erf(math.sqrt(math.pi)) / 2),
        ("random", 1 - math.exp(-1)),
    ):
        # released half an hour after the search begins, it is there for half of the hour
        text = STILL + SQUARE + 'time = "+30 min"'
        sortie = Sortie("s", "", hours(0), hours(1), Law(kind), (1.0,), area=ring, coverage=(2.0,))
        search, _, _ = run(load(tmp_path, text, sorties=(sortie,)))
        assert search.updates.all[0].pos[-1] == pytest.approx(expected, rel=1e-5)
        # half of the time there; at least what was found, which is more where random search goes on
        # without an edge
        assert search.updates.all[0].poc[-1] == pytest.approx(max(0.5, expected), rel=1e-5)


@pytest.mark.parametrize("kind", ["inverse_cube", "definite_range", "m_beta", "random"])
def test_a_search_that_was_cut_short(tmp_path, kind):
    """Of a swept pattern a part of the area was swept in full: that part of b(C), not b of that
    part; random search has its effort.
    """
    ring, part, coverage = Area((179.0, 181.0, 181.0, 179.0), (59.9, 59.9, 60.1, 60.1)), 0.7, 0.9
    law = Law(kind, 0.8) if kind == "m_beta" else Law(kind)
    sortie = Sortie(
        "s", "", hours(0), hours(1), law, (1.0,), area=ring, coverage=(coverage,), completed=part
    )
    search, _, _ = run(load(tmp_path, STILL + SQUARE, sorties=(sortie,)))
    expected = {
        "inverse_cube": part * math.erf(math.sqrt(math.pi) / 2 * coverage),
        "definite_range": part * coverage,
        "m_beta": part * (1 - 0.2 * (1 - 0.8 * (coverage / 0.8 - 1))),
        "random": 1 - math.exp(-part * coverage),
    }[kind]
    assert search.updates.all[0].pos[-1] == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("minutes", [7, 130, 300])
def test_a_pod_of_one_leaves_nothing(tmp_path, minutes):
    """However long it takes: an object that stayed where everything is found was not there."""
    ring = Area((179.0, 181.0, 181.0, 179.0), (59.9, 59.9, 60.1, 60.1))
    sortie = Sortie(
        "all",
        "",
        hours(0),
        hours(minutes / 60),
        Law("definite_range"),
        (1.0,),
        area=ring,
        coverage=(1.2,),
    )
    with pytest.raises(UserError, match='sortie "all" contradicts every scenario \\("square"\\)'):
        run(load(tmp_path, STILL + SQUARE, sorties=(sortie,)))


def test_a_story_that_is_dead_stays_so(tmp_path):
    """What a sortie rules out has no POS from later ones, and the others go on."""
    text = STILL + SQUARE + BOX.replace('"box"', '"elsewhere"')
    ring = Area((179.0, 181.0, 181.0, 179.0), (59.9, 59.9, 60.1, 60.1))
    sorties = [
        Sortie(
            "all",
            "",
            hours(0),
            hours(1),
            Law("definite_range"),
            (1.0, 1.0),
            area=ring,
            coverage=(1.2, 1.2),
        ),
        Sortie(
            "again",
            "",
            hours(1),
            hours(2),
            Law("random"),
            (1.0, 1.0),
            area=ring,
            coverage=(1.0, 1.0),
        ),
    ]
    search, _, _ = run(load(tmp_path, text, sorties=tuple(sorties)))
    first, second = search.updates.all
    assert first.posterior.tolist() == [0.0, 1.0]
    assert first.pos == pytest.approx([1.0, 0.0, 0.5])
    assert second.pos.tolist() == [0.0, 0.0, 0.0]
    assert second.cumulative == pytest.approx([1.0, 0.0, 0.5])
