"""Slots that go from one scenario to another: expected offspring, and everything that must follow
the particles.
"""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy import special, stats

import drift
from drift.case import file as case_file
from drift.engine.motion import simulate
from drift.engine.motion.spool import SnapshotStore
from drift.engine.particles import ensemble as record
from drift.engine.particles import resample, weights
from drift.evidence.filter.filter import SearchFilter
from drift.evidence.filter.records import Contact, Fix, Law, Resampling, Sortie
from drift.pipeline import run_setup
from geo import sphere
from geo.polyline import Area
from kernels.runtime import runtime

HEAD = """
start = "2026-11-21T00:00Z"
duration = "6 h"
particles = {particles}
seed = 11
clock.step = "30 min"
coast.source = "none"
uncertainty.diffusivity = "{d} m2/s"
[[current]]
constant = {{ speed = "0 kn", toward = 0 }}
"""
STORY = """
[[scenario]]
name = "story {k}"
weight = {weight}
object = "water"
position = {{ at = [{lon}, {lat}], std = "{std} m" }}
"""
D = 40.0  # [m2/s]
COUNT = 14
RANDOM = np.random.default_rng(12)
PRIOR = RANDOM.gamma(2.0, size=COUNT)
PRIOR /= PRIOR.sum()
LON, LAT = (359.73 + 0.05 * np.arange(COUNT)) % 360 - 180, 30.0 + RANDOM.uniform(-0.02, 0.02, COUNT)
STD = RANDOM.uniform(1500.0, 3500.0, COUNT)
ALL_OF_IT = Area((178.0, 182.0, 182.0, 178.0), (29.0, 29.0, 31.0, 31.0))


def hours(h: float) -> np.datetime64:
    return np.datetime64("2026-11-21T00:00:00") + np.timedelta64(round(3600 * h), "s")


def case_of(tmp_path: Path, particles: int, more: str = "") -> Path:
    stories = [
        STORY.format(
            k=k, weight=float(PRIOR[k]), lon=float(LON[k]), lat=float(LAT[k]), std=float(STD[k])
        )
        for k in range(COUNT)
    ]
    (tmp_path / "case.toml").write_text(
        more + HEAD.format(particles=particles, d=D) + "".join(stories)
    )
    return tmp_path / "case.toml"


def seen(when: float, lon: float, lat: float, std: float, **more: object) -> Contact:
    return Contact(
        f"at {when}", hours(when), "position", fixes=(Fix(lon, lat),), major=std, minor=std, **more
    )


def test_across_scenarios_each_particle_has_its_expected_offspring() -> None:
    """Three of 60 scenarios hold 99 %: weights stay by scenario, none that is possible goes
    without.
    """
    random, many = np.random.default_rng(2), 60
    sizes = random.integers(20, 60, many)
    bounds = np.concatenate([[0], np.cumsum(sizes)])
    n, scenario = int(bounds[-1]), np.repeat(np.arange(many), sizes)
    weight = random.gamma(0.6, size=n)
    weight[:9] = 0.0  # of the first scenario nine have none
    weight[scenario == 17] = 0.0  # and one scenario has none at all
    share = np.full(many, 0.01 / 56)
    share[[40, 41, 52]], share[17] = (0.55, 0.11, 0.33), 0.0
    total = np.bincount(scenario, weight)
    weight *= (share / np.where(total > 0, total, 1.0))[scenario]
    with np.errstate(divide="ignore"):
        log_weight = np.log(weight).astype(np.float32)
    weight = np.exp(log_weight.astype(float))
    ranges = list(zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True))
    rounds, count = 500, np.zeros(n)
    for k in range(rounds):
        ancestors, new, laid = resample.resample_across_scenarios(log_weight, ranges, n, (7, k))
        copies = np.bincount(ancestors, minlength=n)
        owner = record.owners(laid)
        assert np.array_equal(scenario[ancestors], owner)
        slots = np.diff(laid)
        expected = slots[scenario] * weight / np.bincount(scenario, weight)[scenario].clip(1e-300)
        # floor or the next one; float32 logarithms
        assert np.all(np.abs(copies - expected) < 1 + 1e-3)
        count += copies
    assert slots.sum() == n
    assert slots[17] == 0
    # the floors themselves are at most a tenth of the whole, by which shares are scaled
    least = 0.1 / 59 / 1.1 * n
    assert slots[np.arange(many) != 17].min() >= math.floor(least)
    # Bernstein's inequality: all 2,400 means lie within this but for a chance of 1e-3; float32
    # logarithms shift by 1e-5
    chance, log = (expected % 1) * (1 - expected % 1), math.log(2 * n / 1e-3)
    apart = log / (3 * rounds) + np.sqrt((log / (3 * rounds)) ** 2 + 2 * chance * log / rounds)
    assert np.all(np.abs(count / rounds - expected) < apart + 1e-5 * expected)
    after = np.exp(new.astype(float))
    np.testing.assert_allclose(
        np.bincount(owner, after, many), np.bincount(scenario, weight, many), rtol=1e-6
    )


def test_half_are_effective_where_three_of_300_scenarios_hold_all_but_one_percent() -> None:
    """Beforehand they have 1 % of the particles, as the others do; within scenarios it would stay
    so.
    """
    random, many, each = np.random.default_rng(3), 300, 333
    share = np.full(many, 0.01 / 297)
    share[[40, 41, 250]] = 0.55, 0.11, 0.33
    log_weight = (np.repeat(np.log(share), each) + random.normal(0, 0.3, many * each)).astype(
        np.float32
    )
    ranges = [(k * each, (k + 1) * each) for k in range(many)]
    _, within, _ = resample.offspring(log_weight, ranges, [each] * many, "systematic", (7, 1))
    _, across, bounds = resample.resample_across_scenarios(log_weight, ranges, many * each, (7, 1))
    found = [
        weights.effective(np.exp(new.astype(float))) / (many * each) for new in (within, across)
    ]
    assert found[0] < 0.01
    # slots are dealt out as 0.1 / 300 to each of 297 and the rest in proportion: one over the sum
    # of squares by slot
    slots = np.maximum(share, 0.1 / many) / np.maximum(share, 0.1 / many).sum()
    # shares are drawn, and slots are whole
    assert found[1] == pytest.approx(1 / (share**2 / slots).sum(), rel=0.05)
    assert found[1] > 0.5
    assert np.diff(bounds).min() >= 30


def test_counts_leave_none_without() -> None:
    found = resample.counts(np.array([1e-9, 0.0, 5.0, 1e-12, 1.0]), 6)
    assert found.sum() == 6
    assert found[1] == 0
    assert found.min() == 0 < found[[0, 2, 3, 4]].min()
    assert found[2] == found.max()


@pytest.mark.parametrize("across", [False, True])
def test_a_mixture_of_kalman_filters(tmp_path: Path, across: bool) -> None:
    """Scenarios of normals that diffuse: their posterior after fixes, and a sortie under way that
    sees some, in closed form.
    """
    fixes = [
        (1.2, 179.97, 30.01, 2500.0),
        (2.7, 179.99, 29.99, 4000.0),
        (4.6, -179.99, 30.0, 5000.0),
    ]
    coverage = tuple(float(c) for c in np.where(np.arange(COUNT) % 3 == 1, 1.3, 0.0))
    flown = Sortie(
        "all",
        "",
        hours(0.7),
        hours(3.9),
        Law("random"),
        (1.0,) * COUNT,
        area=ALL_OF_IT,
        coverage=coverage,
    )
    asked = case_file.load(case_of(tmp_path, 120_000))
    runtime.start()
    spec, where = run_setup.ensemble_spec(asked), run_setup.open_for(asked)
    begin = run_setup.prepare(asked, where)
    rule = Resampling("systematic", 0.6, across)
    search = SearchFilter(
        spec, (flown,), [seen(*fix) for fix in fixes], rule, begin.ensemble, begin.scene
    )
    outputs = np.array([0, 4320, 9000, 21_600])
    moments = simulate.run(begin.ensemble, begin.scene, begin.clock, outputs, search=search)
    before = begin.ensemble.bounds
    with SnapshotStore.of_run(asked.period, begin.ensemble, moments, len(outputs)) as snapshots:
        begin.scene.forcing.close()
        ensemble = begin.ensemble
        resampled = next(update for update in search.updates.all if update.resampled)
        assert resampled.name == "at 1.2"  # while the sortie is under way
        # within scenarios their shares stay uneven
        assert (resampled.ess_resampled > 0.9 * 120_000) is across
        assert (ensemble.bounds == before) is not across
        assert np.array_equal(ensemble.scenario.to_numpy(), record.owners(ensemble.bounds))
        assert np.array_equal(snapshots[0].scenario, record.owners(before))
        assert np.array_equal(snapshots[3].scenario, ensemble.scenario.to_numpy())
        exact, mean, variance = np.log(PRIOR), np.stack([0 * LON, 0 * LAT]), STD**2
        last = 0.0
        for when, lon, lat, std in fixes:
            variance = variance + 2 * D * 3600 * (when - last)
            at = np.stack(sphere.offset(*np.radians([LON, LAT]), np.radians(lon), np.radians(lat)))
            total = variance + std**2
            exact = exact + stats.norm.logpdf(at - mean, scale=np.sqrt(total)).sum(axis=0)
            gain = variance / total
            mean, variance, last = mean + gain * (at - mean), variance * (1 - gain), when
        exact = special.softmax(exact - np.array(coverage))
        ess = [update.ess_after for update in search.updates.all]
        effective = min(ess) / 3
        end = snapshots[3]
        share = np.bincount(end.scenario, end.probability, COUNT)
        assert 0.1 < exact.max() < 0.9
        # the sphere bends these 10 km by 1e-3, and evidence by the square of that over the variance
        assert np.all(np.abs(share - exact) < 4 * np.sqrt(exact * (1 - exact) / effective) + 2e-3)
        assert np.all(search.updates.all[-1].posterior == pytest.approx(share, abs=1e-7))
        best = int(np.argmax(exact))
        own = end.scenario == best
        at = np.stack(
            sphere.offset(
                np.radians(LON[best]),
                np.radians(LAT[best]),
                *(x[own] * sphere.UNIT for x in (end.lon, end.lat)),
            )
        )
        found = (at * end.probability[own]).sum(axis=1) / end.probability[own].sum()
        spread = np.sqrt((variance[best] + 2 * D * 3600 * (6 - last)) / (effective * exact[best]))
        assert np.all(np.abs(found - mean[:, best]) < 4 * spread + 1e-3 * np.abs(mean[:, best]))


@pytest.mark.thorough
def test_tracks_and_debris_follow_particles_into_other_slots(tmp_path: Path) -> None:
    """Each track begins where its scenario does, and each piece of debris lies by its own
    scenario's objects.
    """
    contact = '[[contact]]\nname = "{name}"\n{of}time = "{time}"\nposition = {{ at = [179.97, 30.01], error = "{error} nmi" }}\n'
    more = contact.format(name="one", of="", time="+70 min", error=1.5)
    more += contact.format(name="two", of='of = "PIW-1"\n', time="+4 h", error=9)
    text = case_of(
        tmp_path,
        8000,
        'resampling = { below = 0.7, across_scenarios = true }\noutput.every = "2 h"\n',
    )
    text.write_text(text.read_text() + more)
    made = drift.run(drift.load(text))
    tracks, weight = made.trajectories, made.forecast.data["scenario_probability"].values
    np.testing.assert_allclose(weight.sum(axis=1), 1.0, atol=1e-9)
    np.testing.assert_allclose(weight[0], PRIOR, atol=1e-6)  # float32 logarithms
    far = [
        np.hypot(
            *sphere.offset(
                math.radians(LON[s]), math.radians(LAT[s]), x * sphere.UNIT, y * sphere.UNIT
            )
        )
        / STD[s]
        for s, x, y in zip(tracks.scenario, tracks.lon[:, 0], tracks.lat[:, 0], strict=True)
    ]
    assert len(set(tracks.scenario.tolist())) > 3
    assert max(far) < 6  # standard deviations, of 200 tracks


def test_debris_beside_is_laid_as_its_objects_are(tmp_path: Path) -> None:
    asked = case_file.load(case_of(tmp_path, 3000))
    runtime.start()
    begin = run_setup.prepare(asked, run_setup.open_for(asked))
    water = asked.scenarios[0].object
    contacts = [seen(0.9, 179.97, 30.01, 2500.0), seen(4.0, -179.99, 30.0, 9000.0, drifter=water)]
    rule = Resampling("systematic", 0.7, True)
    search = SearchFilter(
        run_setup.ensemble_spec(asked), (), contacts, rule, begin.ensemble, begin.scene
    )
    list(simulate.run(begin.ensemble, begin.scene, begin.clock, np.array([21_600]), search=search))
    begin.scene.forcing.close()
    (beside,) = search._debris.values()
    assert beside.ensemble.bounds == begin.ensemble.bounds
    owner = record.owners(begin.ensemble.bounds)
    assert np.array_equal(beside.ensemble.scenario.to_numpy(), owner)
    lon, lat = (getattr(beside.ensemble, name).to_numpy() * sphere.UNIT for name in ("lon", "lat"))
    east, north = sphere.offset(np.radians(LON)[owner], np.radians(LAT)[owner], lon, lat)
    # it began with the object, and has walked for at most 4 h
    assert (np.hypot(east, north) / np.sqrt(STD[owner] ** 2 + 2 * D * 4 * 3600)).max() < 6
