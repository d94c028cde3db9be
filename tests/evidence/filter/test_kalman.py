"""Positions and debris that contacts report: the particle filter against a Kalman filter and joint
normals.
"""

import dataclasses
import math

import numpy as np
import pytest
from filtered import NORMAL, SQUARE, STILL, hours, load, offsets, run, weights
from scipy import stats

from drift.evidence.filter.records import (
    Contact,
    Fix,
    Resampling,
)
from geo import sphere
from geo.errors import UserError

# A Kalman filter: a normal prior, a random walk, three fixes with error.


@pytest.mark.parametrize("method", ["systematic", "kahn", None])
def test_kalman(tmp_path, method):
    """Mean, covariance and evidence agree with the Kalman filter, with and without resampling."""
    d = 60.0  # [m2/s] so that the walk over 5 h, 1.5 km a component, counts beside the prior
    fixes = [
        (1.0, (2500.0, 1500.0), 2500.0),
        (2.6, (5000.0, -500.0), 2000.0),
        (5.0, (6000.0, 3000.0), 3000.0),
    ]
    lon0, lat0 = -179.99, 30.0
    contacts = []
    for k, (when, (east, north), std) in enumerate(fixes):
        lon, lat = sphere.destination(math.radians(lon0), math.radians(lat0), east, north)
        fix = Fix(float(np.degrees(lon)), float(np.degrees(lat)))
        contacts.append(
            Contact(f"fix {k}", hours(when), "position", fixes=(fix,), major=std, minor=std)
        )
    resampling = Resampling(method, 0.9) if method else Resampling()
    n = 200_000
    case = load(
        tmp_path,
        STILL + NORMAL.format(d=d),
        contacts=tuple(contacts),
        particles=n,
        resampling=resampling,
    )
    search, ensemble, _ = run(case)

    turn = math.radians(30)
    # (axis, east and north)
    axes = np.array([[math.sin(turn), math.cos(turn)], [math.cos(turn), -math.sin(turn)]])
    mean, cov, evidence, last = (
        np.zeros(2),
        axes.T @ np.diag([4000.0**2, 2500.0**2]) @ axes,
        0.0,
        0.0,
    )
    for when, z, std in fixes:
        cov = cov + 2 * d * 3600 * (when - last) * np.eye(2)
        total = cov + std**2 * np.eye(2)
        evidence += stats.multivariate_normal.logpdf(z, mean, total)
        gain = cov @ np.linalg.inv(total)
        mean, cov, last = mean + gain @ (np.array(z) - mean), cov - gain @ cov, when
    cov = cov + 2 * d * 3600 * (6.0 - last) * np.eye(2)

    w = weights(ensemble)
    at = np.stack(offsets(ensemble, lon0, lat0))
    found = at @ w
    spread = (w * (at - found[:, None])) @ (at - found[:, None]).T
    effective = min(update.ess_after for update in search.updates.all) / (3 if method else 1)
    assert all(update.resampled for update in search.updates.all[:2]) == bool(method)
    assert np.all(np.abs(found - mean) < 4 * np.sqrt(np.diag(cov) / effective))
    # standard error of a covariance: sqrt((c_ii c_jj + c_ij^2) / n); the sphere itself bends 10 km
    # by 1e-3
    error = np.sqrt((np.outer(np.diag(cov), np.diag(cov)) + cov**2) / effective)
    assert np.all(np.abs(spread - cov) < 4 * error + 2e-3 * np.abs(cov).max())
    assert abs(search.updates.log_evidence - evidence) < 4 * 3 / math.sqrt(effective)
    print(
        f"{method}: mean {found} / {mean}, log evidence {search.updates.log_evidence:.4f} / {evidence:.4f}"
    )


@pytest.mark.thorough
def test_debris_by_joint_normals(tmp_path):
    """Debris found reweights the object by what they share, the release and the errors of the
    current, and by no more.
    """
    std, time, bias, d, when, error = 0.25, 6 * 3600.0, 0.2, 40.0, 5.0, 1500.0
    text = STILL + NORMAL.format(d=d).replace(
        "[uncertainty]",
        '[uncertainty]\ncurrent = { std = "0.25 m/s", time = "6 h", bias = "0.2 m/s" }',
    )
    z = (9000.0, -4000.0)
    lon, lat = sphere.destination(math.radians(-179.99), math.radians(30.0), *z)
    fix = Fix(float(np.degrees(lon)), float(np.degrees(lat)))
    n = 100_000
    bare = load(tmp_path, text, particles=n)
    debris = dataclasses.replace(bare.scenarios[0].object, name="oar")
    contact = Contact(
        "oar", hours(when), "position", fixes=(fix,), major=error, minor=error, drifter=debris
    )
    case = dataclasses.replace(
        bare, contacts=(contact,), end=hours(when), outputs=np.array([hours(0), hours(when)])
    )
    search, ensemble, _ = run(case)
    turn, t = math.radians(30), 3600 * when
    axes = np.array([[math.sin(turn), math.cos(turn)], [math.cos(turn), -math.sin(turn)]])
    released = axes.T @ np.diag([4000.0**2, 2500.0**2]) @ axes
    # the integral of a stationary Ornstein-Uhlenbeck process (Gillespie 1996,
    # doi:10.1103/PhysRevE.54.2084)
    forcing = (
        2 * std**2 * time**2 * (t / time - 1 + math.exp(-t / time)) + (bias * t) ** 2
    ) * np.eye(2)
    walk = 2 * d * t * np.eye(2)
    shared, own = released + forcing, released + forcing + walk
    gain = shared @ np.linalg.inv(own + error**2 * np.eye(2))
    mean, cov = gain @ np.array(z), own - gain @ shared
    evidence = stats.multivariate_normal.logpdf(z, np.zeros(2), own + error**2 * np.eye(2))
    w = weights(ensemble)
    at = np.stack(offsets(ensemble, -179.99, 30.0))
    found = at @ w
    spread = (w * (at - found[:, None])) @ (at - found[:, None]).T
    effective = search.updates.all[0].ess_after
    assert np.all(np.abs(found - mean) < 4 * np.sqrt(np.diag(cov) / effective))
    width = np.sqrt((np.outer(np.diag(cov), np.diag(cov)) + cov**2) / effective)
    # 15 km on the sphere: 2e-3
    assert np.all(np.abs(spread - cov) < 4 * width + 3e-3 * np.abs(cov).max())
    assert abs(search.updates.log_evidence - evidence) < 4 * 3 / math.sqrt(effective)


def test_outputs_do_not_change_what_a_contact_sees(tmp_path):
    """Nor do two outputs at one time: evidence of a contact later in the same step is the same to
    the bit.
    """
    text = STILL.replace("30 min", "1 h") + NORMAL.format(d=80)
    fix = Contact(
        "fix", hours(0.6), "position", fixes=(Fix(-179.98, 30.01),), major=900.0, minor=700.0
    )
    case = load(tmp_path, text, particles=3000, contacts=(fix,))
    alone, shown = (run(case, outputs) for outputs in ([], [700, 1900, 1900, 2300]))
    assert len(shown[2]) == 4
    assert alone[0].updates.log_evidence == shown[0].updates.log_evidence
    np.testing.assert_array_equal(
        *(ensemble.log_weight.to_numpy() for _, ensemble, _ in (alone, shown))
    )


def test_weights_stay_near_one_after_small_densities(tmp_path):
    """A density of 1e-9 a square metre twice: float32 would lose small differences far from 0."""
    fixes = [
        Contact(str(h), hours(h), "position", fixes=(Fix(-179.98, 30.01),), major=9e3, minor=7e3)
        for h in (1, 2, 3)
    ]
    case = load(tmp_path, STILL + NORMAL.format(d=30), particles=2000, contacts=tuple(fixes))
    _, ensemble, _ = run(case)
    assert abs(np.log(np.exp(ensemble.log_weight.to_numpy().astype(float)).sum())) <= 20


def test_two_contacts_within_one_step(tmp_path):
    """The second is where a walk can get to from the first: evidence of a Kalman filter, fixes 6
    min apart in a step of 60.
    """
    d, fixes = 100.0, [(1.4, (500.0, 300.0), 200.0), (1.5, (700.0, 100.0), 200.0)]
    text = STILL.replace("30 min", "60 min") + NORMAL.format(d=d).replace(
        '["4000 m", "2500 m"]', '"600 m"'
    ).replace("orientation = 30", "")
    contacts, mean, cov, evidence, last = [], np.zeros(2), 600.0**2 * np.eye(2), 0.0, 0.0
    for k, (when, z, std) in enumerate(fixes):
        lon, lat = sphere.destination(math.radians(-179.99), math.radians(30.0), *z)
        fix = Fix(float(np.degrees(lon)), float(np.degrees(lat)))
        contacts.append(
            Contact(f"{k}", hours(when), "position", fixes=(fix,), major=std, minor=std)
        )
        cov = cov + 2 * d * 3600 * (when - last) * np.eye(2)
        total = cov + std**2 * np.eye(2)
        evidence += stats.multivariate_normal.logpdf(z, mean, total)
        gain = cov @ np.linalg.inv(total)
        mean, cov, last = mean + gain @ (np.array(z) - mean), cov - gain @ cov, when
    search, _, _ = run(load(tmp_path, text, contacts=tuple(contacts), particles=100_000))
    assert search.updates.log_evidence == pytest.approx(
        evidence, abs=4 * 3 / math.sqrt(search.updates.all[-1].ess_after)
    )


def test_a_contact_that_nothing_explains(tmp_path):
    """One wrong digit: refused where it is believed, without effect where it may be false; and no
    NaN.
    """
    far = Contact(
        "digit", hours(1), "position", fixes=(Fix(-50.0, 10.0),), major=3000.0, minor=3000.0
    )
    with pytest.raises(UserError, match='contact "digit" contradicts every scenario'):
        run(load(tmp_path, STILL + SQUARE, contacts=(far,)))
    search, ensemble, _ = run(
        load(tmp_path, STILL + SQUARE, contacts=(dataclasses.replace(far, belief=0.9),))
    )
    assert np.ptp(ensemble.log_weight.to_numpy()) == 0
    assert search.updates.all[0].ess_after == pytest.approx(1000)
