"""Copies of particles after resampling: unbiased, separate, and each with its own coefficients and
waits.
"""

import dataclasses
import math

import numpy as np
import pytest
import spills
from filtered import NORMAL, STILL, hours, load, run

from drift.engine.motion import simulate
from drift.engine.motion.errors.forcing_error import ForcingError
from drift.engine.motion.objects import leeway
from drift.engine.particles import ensemble as record
from drift.engine.particles import resample
from drift.engine.particles.status import Status
from drift.evidence.filter.debris import debris
from drift.evidence.filter.meeting import Resampled
from drift.evidence.filter.records import (
    Contact,
    Fix,
    Resampling,
)
from drift.forecast import effective
from drift.pipeline import run_setup
from geo import sphere
from kernels.runtime import runtime


def test_resampling_is_unbiased():
    """Over many draws every particle has its expected offspring, and means of functions stay; one
    that has no weight has none.
    """
    random = np.random.default_rng(3)
    weight = random.gamma(0.3, 1.0, 200)
    weight[[0, 7, 199]] = 0.0
    values = random.normal(size=(2, 200))
    rounds, number = 4000, 200
    for draw in (
        lambda: resample.systematic(weight, number, random.random()),
        lambda: resample.kahn(weight, number, random.random(200)),
    ):
        counts = np.array([np.bincount(draw(), minlength=200) for _ in range(rounds)])
        expected = number * weight / weight.sum()
        assert not counts[:, weight == 0].any()
        assert np.all(np.abs(counts - expected[None]) < 1)  # floor or the next one
        spread = np.sqrt(np.maximum((expected % 1) * (1 - expected % 1), 1e-12) / rounds)
        assert np.all(np.abs(counts.mean(axis=0) - expected) < 4.5 * spread + 1e-9)
        means = counts @ values.T / number
        exact = values @ weight / weight.sum()
        assert np.all(
            np.abs(means.mean(axis=0) - exact) < 4.5 * means.std(axis=0) / math.sqrt(rounds)
        )
    total = counts.sum(axis=1)  # Kahn's number floats, its spread at most sqrt(N) / 2
    assert abs(total.mean() - number) < 4.5 * total.std() / math.sqrt(rounds)
    assert 1 < total.std() < 0.5 * math.sqrt(number)


def test_kahns_weights_are_those_that_were_aimed_at():
    """Each offspring weighs sum(w) / N, N the number aimed at: by the number drawn, their expected
    sum would be off.
    """
    random = np.random.default_rng(12)
    number, rounds = 60, 6000
    log_weight = np.log(random.gamma(0.4, 1.0, resample.capacity(number))).astype(np.float32)
    log_weight[number:] = -np.inf
    weight = np.exp(log_weight.astype(np.float64))
    value = np.where(
        np.arange(weight.size) == int(np.argmax(weight)), 1.0, 0.0
    )  # its offspring change the number drawn
    found = np.zeros((rounds, 2))
    for k in range(rounds):
        ancestors, made, _ = resample.offspring(
            log_weight, [(0, weight.size)], [number], "kahn", (5, k)
        )
        new = np.exp(made.astype(np.float64))
        np.testing.assert_allclose(new[new > 0], weight.sum() / number, rtol=1e-6)
        found[k] = new.sum(), (new * value[ancestors]).sum()
    exact = np.array([weight.sum(), (weight * value).sum()])
    assert np.all(np.abs(found.mean(axis=0) - exact) < 4.5 * found.std(axis=0) / math.sqrt(rounds))
    assert found[:, 0].std() > 0  # the number drawn floats, and the sum of the weights with it


def test_debris_has_coefficients_of_its_own(tmp_path):
    """It shares its object's release and errors to the bit; leeway coefficients and sides, even of
    one class, are independent.
    """
    text = STILL + NORMAL.format(d=10).replace('object = "water"', 'object = "LIFE-RAFT-DB-10"')
    text += '[[wind]]\nconstant = { speed = "9 m/s", from = 250 }\n'
    n = 50_000
    bare = load(tmp_path, text, particles=n, current_error=ForcingError(0.3, 40_000.0))
    seen = tuple(
        Contact(
            name,
            hours(2),
            "position",
            fixes=(Fix(-179.9, 30.1),),
            major=5000.0,
            minor=5000.0,
            drifter=drifter,
        )
        for name, drifter in (
            ("twin", bare.scenarios[0].object),
            ("oar", leeway.find_class("PIW-1")),
        )
    )
    case = dataclasses.replace(bare, contacts=seen)
    runtime.start()
    begin = run_setup.prepare(case, run_setup.open_for(case))
    found = debris.of_contacts(
        run_setup.ensemble_spec(case),
        [(7200, contact) for contact in seen],
        begin.scene,
        begin.ensemble,
    )
    begin.scene.forcing.close()
    whole = [begin.ensemble, *(one.ensemble for one in found.values())]
    assert len(whole) == 3
    for name in ("lon", "lat", "release", "current_error_east", "current_error_north"):
        columns = [ensemble.columns[name].to_numpy() for ensemble in whole]
        assert all(np.array_equal(columns[0], column) for column in columns[1:])
    for name in ("down_slope", "right_slope", "left_slope", "side"):
        columns = np.array([ensemble.columns[name].to_numpy() for ensemble in whole], np.float64)
        assert np.abs(np.corrcoef(columns) - np.eye(3)).max() < 4.5 / math.sqrt(n)


def test_object_and_debris_part_inside_a_step(tmp_path):
    """Half way through a step each walks on a bridge of its own: variance D T / 2 a component about
    the middle, no correlation.

    Noise that two of them have in common would show as a correlation of 1.
    """
    n, diffusivity = 40_000, 30.0
    text = STILL.replace("30 min", "1 h").replace('"6 h"', '"1 h"') + NORMAL.format(d=diffusivity)
    drifters = {"oar": leeway.find_class("PIW-1"), "raft": leeway.find_class("LIFE-RAFT-DB-10")}
    fix = {"kind": "position", "fixes": (Fix(-179.9, 30.1),), "major": 5e4, "minor": 5e4}
    contacts = tuple(
        Contact(name, hours(0.5), **fix, drifter=drifter) for name, drifter in drifters.items()
    )
    case = load(tmp_path, text, particles=n, contacts=contacts)
    runtime.start()
    begin = run_setup.prepare(case, run_setup.open_for(case))
    search, bends = run_setup.build_search_filter(case, begin), []
    first, apply_evidence = begin.ensemble.lat.to_numpy().astype(float), search.apply_evidence

    def effect(time, place):
        """Note how far north of the middle of its step debris is seen [m]."""

        def noted(debris, scene, before, time):
            lon, lat = place(debris, scene, before, time)
            bends.append(
                (lat - (before.lat.to_numpy().astype(float) + debris.lat.to_numpy()) / 2)
                * sphere.UNIT
                * sphere.RADIUS
            )
            return lon, lat

        apply_evidence(time, noted)

    search.apply_evidence = effect
    (moment,) = simulate.run(
        begin.ensemble, begin.scene, begin.clock, np.array([1800]), search=search
    )
    begin.scene.forcing.close()
    middle = (first + begin.ensemble.lat.to_numpy()) / 2
    bends.append((moment.lat - middle) * sphere.UNIT * sphere.RADIUS)
    assert len(bends) == 3
    for bend in bends:
        assert np.var(bend) == pytest.approx(diffusivity * 3600 / 2, rel=4.5 * math.sqrt(2 / n))
    assert np.abs(np.corrcoef(bends) - np.eye(3)).max() < 4.5 / math.sqrt(n)


def test_copies_ashore_begin_their_waits_anew_debris_too(tmp_path):
    """Else a copy, whose wait is drawn for its own slot, may long have waited enough, and most
    would leave at once.
    """
    (tmp_path / "land.geojson").write_text(spills.SHORE)
    coast = '[coast]\nsource = "land.geojson"\nbehaviour = "refloat"\nhalf_life = "2 h"\n'
    text = STILL.replace('[coast]\nsource = "none"\n', coast) + NORMAL.format(d=5).replace(
        "[-179.99, 30.0]", "[-0.2, 0.1]"
    )
    fix = {"kind": "position", "fixes": (Fix(-0.2, 0.1),), "major": 5e3, "minor": 5e3}
    contact = Contact("oar", hours(2), **fix, drifter=leeway.find_class("PIW-1"))
    case = load(
        tmp_path,
        text,
        particles=2000,
        contacts=(contact,),
        resampling=Resampling("systematic", 0.5),
    )
    runtime.start()
    begin = run_setup.prepare(case, run_setup.open_for(case))
    search = run_setup.build_search_filter(case, begin)
    begin.scene.forcing.close()
    (beside,) = search._debris.values()
    for ensemble in (begin.ensemble, beside.ensemble):
        ensemble.status.from_numpy(
            np.where(np.arange(2000) % 3 == 0, int(Status.ASHORE), 0).astype(np.int32)
        )
        ensemble.status_since.fill(17)
    log_weight, layout = begin.ensemble.log_weight.to_numpy(), begin.ensemble.layout
    search.resample_all(
        Resampled(
            *resample.offspring(log_weight, [(0, 2000)], [2000], "systematic", (1, 1)), layout
        ),
        7200,
    )
    for ensemble in (begin.ensemble, beside.ensemble):
        ashore = ensemble.status.to_numpy() == Status.ASHORE
        assert 0 < ashore.sum() < 2000
        assert (ensemble.status_since.to_numpy() == np.where(ashore, 7200, 17)).all()


def test_offspring_separate_and_remember(tmp_path):
    """After a narrow contact few ancestors remain; their offspring part by later noise, and tracks
    lead back to them.
    """
    text = STILL + NORMAL.format(d=30)
    fix = Contact(
        "fix", hours(1), "position", fixes=(Fix(-179.98, 30.01),), major=300.0, minor=300.0
    )
    vague = dataclasses.replace(fix, name="vague", time=hours(3), major=90e3, minor=90e3)
    case = load(
        tmp_path,
        text,
        particles=5000,
        contacts=(fix, vague),
        resampling=Resampling("systematic", 0.5),
    )
    search, ensemble, moments = run(case, outputs=[0, 3600, 7200, 21_600])
    update = search.updates.all[0]
    assert update.resampled
    assert update.distinct < 0.05
    assert update.ess_after < 500
    assert update.ess_resampled == pytest.approx(5000, rel=1e-3)
    later = search.updates.all[1]  # tells next to nothing: copies still count as one
    assert later.ess_before == pytest.approx(update.ess_after, rel=0.02)
    assert later.ess_after == pytest.approx(later.ess_before, rel=0.02)
    family = moments[2].ancestors
    assert effective.number(record.probability(ensemble), family) == pytest.approx(
        later.ess_after, rel=0.02
    )
    last, drawn = moments[-1], moments[2].ancestors
    assert moments[1].ancestors is None
    assert len(np.unique(drawn)) == round(update.distinct * 5000)
    assert len(np.unique(last.lon)) > 4900
    # over 5 h a walk leads sqrt(2 D t) a component from the ancestor's place at 1 h
    from_lon, from_lat = moments[1].lon[drawn], moments[1].lat[drawn]
    east, north = sphere.offset(
        *(x * sphere.UNIT for x in (from_lon, from_lat, last.lon, last.lat))
    )
    expected = math.sqrt(2 * 30 * 5 * 3600)
    assert np.std(east) == pytest.approx(expected, rel=0.05)
    assert np.std(north) == pytest.approx(expected, rel=0.05)
