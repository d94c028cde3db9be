"""A pilot run of a few thousand particles, which decides whether and how finds guide a run.

It moves debris without a coast to its finds, once as drawn and then guided. The first run estimates
how many particles the finds would leave effective. The next ones fit the response of debris to the
pulls, and add passes until debris misses its predicted position by less than the errors of the
finds.
"""

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drift.engine.motion import prior
from drift.engine.motion.scenario import Scenario
from drift.engine.particles import weights
from drift.engine.particles.ensemble import Ensemble, Layout
from drift.evidence.filter import contacts as contact_laws
from drift.evidence.filter.debris import guide as guides
from drift.evidence.filter.debris import responses
from drift.evidence.filter.debris.guide import Fit, Fits, Guide, Trial, Way
from drift.evidence.filter.records import Contact
from geo.array import Array

WORTHWHILE = 0.1  # share of particles that is effective without guiding, below which finds guide
PILOT = 4096  # particles in all; of a scenario LEAST at least
LEAST = 512
WIDER = 2.0  # factor on the variance of a find's error in the proposal: its tails must not be short
FEW = 30  # particles that are too few to fit anything
MOST = 5  # passes: each moves the debris of all particles once
CLOSE = 2.0  # variance of the misses over the variance of the find, below which passes end
# the same variance over that of the pass before, above which one more pass would not help
HARDLY = 0.7
MIDDLE = 2 * np.log(2)  # median of the square of a two-dimensional standard normal


def fit(trial: Trial, contacts: Sequence[Contact]) -> Guide | None:
    """Return how finds guide the particles of a run; None if they need not, or cannot.

    Args:
        trial: what the particles are drawn from, and the forcing and steps of their run.
        contacts: all contacts of the case.
    """
    spec = trial.spec
    finds = guides.finds_of(spec, contacts)
    guidable = [_is_guidable(scenario) for scenario in spec.scenarios]
    if not finds or not any(guidable) or spec.release is not None or spec.period.direction < 0:
        return None
    finds = tuple(find for find in finds if find.time > 0)
    seen = [(find.time, find.contact.drifter) for find in finds if find.contact.drifter is not None]
    if not seen:
        return None
    answers = responses.forcing_responses(spec.errors, seen, trial.clock)
    plain = Fit(
        np.stack([np.eye(2)] * len(finds)),
        np.stack([WIDER * find.covariance for find in finds]),
        np.stack([WIDER * find.covariance for find in finds]),
        np.zeros((len(finds), 2)),
        np.zeros((len(finds), 2, 2)),
    )
    blind = Guide(finds, answers, (tuple(plain if can else None for can in guidable),))
    if not any(
        _has_shared_uncertainty(blind, scenario)
        for scenario, can in zip(spec.scenarios, guidable, strict=True)
        if can
    ):
        return None
    return _fit_response(blind, trial)


def _is_guidable(scenario: Scenario) -> bool:
    """Return whether a scenario's release is drawn at the start, not where it goes adrift."""
    return scenario.itinerary is None and scenario.prior is not None


def _has_shared_uncertainty(blind: Guide, scenario: Scenario) -> bool:
    """Return whether any unknown that a scenario shares with debris is uncertain."""
    place = guides.place_covariance(scenario)
    return bool(blind.responses.covariance(0, place).any())


def _fit_response(blind: Guide, trial: Trial) -> Guide | None:
    """Return a guide with the fitted response of debris.

    Return None if finds leave enough effective particles without guiding.
    """
    whole = prior.layout(trial.spec)
    most = max(LEAST, PILOT // len(trial.spec.scenarios))
    counts = np.minimum(prior.counts_of(trial.spec), most)
    bounds = (0, *(int(x) for x in np.cumsum(counts)))
    layout = Layout(bounds, whole.numbers, whole.block)
    calm = replace(trial.scene, place=trial.scene.place._replace(coast=None))
    open_sea = trial._replace(scene=calm)
    drawn = prior.draw_ensemble(trial.spec, None, layout).ensemble
    way = guides.debris_way(blind, open_sea, drawn, moved=False)
    if _effective(blind, drawn, way) >= WORTHWHILE:
        return None
    spans = [slice(a, b) for a, b in itertools.pairwise(layout.bounds)]
    fits = tuple(
        _with_unknown_debris(fit, way, span)
        for fit, span in zip(blind.passes[0], spans, strict=True)
    )
    led = guides.with_columns(blind, drawn)
    passes: list[Fits] = []
    strays = np.inf
    while len(passes) < MOST:
        guides.pull_particles(blind, fits, trial.spec, led, way, number=len(passes), last=False)
        after = guides.debris_way(blind, open_sea, led, moved=True)
        fitted = [
            _with_response(blind, fit, (way, after), span)
            for fit, span in zip(fits, spans, strict=True)
        ]
        fits, way = tuple(fit for fit, _ in fitted), after
        passes.append(fits)
        before, strays = strays, max(stray for _, stray in fitted)
        if strays < CLOSE or strays > HARDLY * before:
            break
    return replace(blind, passes=tuple(passes))


def _effective(guide: Guide, drawn: Ensemble, way: Way) -> float:
    """Return the share of particles that are effective after all finds, without guiding."""
    total = drawn.log_weight.to_numpy().astype(np.float64)
    before = weights.effective(weights.relative(total))
    for k, find in enumerate(guide.finds):
        log_likelihood = contact_laws.log_likelihood(find.contact, way.lon[k], way.lat[k])
        log_likelihood = np.where(way.known[k], log_likelihood, -np.inf)
        if find.contact.false_density > 0:
            log_likelihood = np.logaddexp(log_likelihood, np.log(find.contact.false_density))
        elif find.contact.belief < 1:
            mean = np.logaddexp.reduce(total + log_likelihood) - np.logaddexp.reduce(total)
            if mean == -np.inf:
                return 0.0
            log_likelihood = np.logaddexp(
                np.log(find.contact.belief) + log_likelihood, np.log1p(-find.contact.belief) + mean
            )
        total = total + log_likelihood
    if total.max() == -np.inf:
        return 0.0
    return weights.effective(weights.relative(total)) / before


def _with_unknown_debris(fit: Fit | None, way: Way, span: slice) -> Fit | None:
    """Return a fit that predicts debris of unknown position from the debris of known position."""
    finds = len(way.known)
    known = way.known[:, span].all(axis=0)
    if fit is None or known.sum() < FEW:
        return fit
    rest = (way.apart - way.shared)[span][known].reshape(-1, finds, 2)
    spread = [np.cov(rest[:, k].T) for k in range(finds)]
    return fit._replace(mean=rest.mean(axis=0), spread=np.stack(spread))


def _with_response(
    guide: Guide, fit: Fit | None, ways: tuple[Way, Way], span: slice
) -> tuple[Fit | None, float]:
    """Return a fit with estimated M, and the largest ratio of misses to find errors (variances)."""
    first, second = ways
    known = (first.known & second.known)[:, span].all(axis=0)
    if fit is None or known.sum() < FEW:
        return fit, 0.0
    inverse, close, error, most = (
        np.array(fit.inverse),
        np.array(fit.close),
        np.array(fit.error),
        0.0,
    )
    for k, find in enumerate(guide.finds):
        own = slice(2 * k, 2 * k + 2)
        by = (second.shared - first.shared)[span, own][known]
        to = (second.apart - first.apart)[span, own][known]
        answer = np.linalg.lstsq(by, to, rcond=None)[0].T
        if not 0.05 < np.linalg.det(answer) < 20:
            answer = np.eye(2)
        inverse[k] = np.linalg.inv(answer)
        strays = _robust_covariance(to - by @ answer.T)
        close[k] = inverse[k] @ (WIDER * find.covariance) @ inverse[k].T
        error[k] = inverse[k] @ (WIDER * find.covariance + strays) @ inverse[k].T
        most = max(most, float(np.trace(strays) / np.trace(find.covariance)))
    return fit._replace(inverse=inverse, close=close, error=error), most


def _robust_covariance(rest: Array) -> Array:
    """Return the covariance of residuals (n, 2) [m], scaled by their median size.

    A few large outliers then have no effect.
    """
    whole = rest.T @ rest / len(rest) + 1e-6 * np.eye(2)
    size = np.einsum("na,ab,nb->n", rest, np.linalg.inv(whole), rest)
    return np.asarray(whole * (np.median(size) / MIDDLE))
