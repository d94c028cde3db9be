"""Results of a spill after the drift: fates, posterior of the worlds given the finds, and washup.

If the finds leave too few effective worlds, worlds are drawn again around those with weight, and
the drift is run again: population Monte Carlo (Cappe et al. 2004, doi:10.1198/106186004X12803). The
likelihood of the finds is tempered for the proposal of these worlds, never in the result.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr
from scipy import special  # stats would take a second to import

from drift.engine.motion.period import Period
from drift.engine.motion.spool import SnapshotStore
from drift.engine.particles import partials, weights
from drift.forecast import effective
from drift.spills.worlds import (
    evidence,
    finds,
    realisations,
    release,
    unknowns,
    verdict,
    washup,
    worlds,
)
from drift.spills.worlds.fates import FatesSource
from drift.spills.worlds.kept import StoredFates
from drift.spills.worlds.products import tables as washup_tables
from drift.spills.worlds.records import Spill
from drift.spills.worlds.worlds import Proposal, Worlds
from geo.array import Array, Real
from geo.coast.edges import Coast
from geo.coast.segments import Segments

FEWEST = effective.FEW["worlds"]  # effective worlds below which they are drawn again
NARROWING = (
    # worlds drawn over effective worlds of the tempered proposal: how far one round may narrow it
    20.0
)
ENOUGH = 10.0  # least effective worlds per latent from which a proposal is made
WORST = 10  # stretches in the summary
# [objects] least expected number of a stretch that the summary ranks by number per km: leaves out
# short stretches with next to nothing
SOME = 0.1
REALISATIONS = 4  # most complete spills for each world


@dataclass(frozen=True)
class DriftedRun:
    """A finished run: the particles at its outputs and its end, with their stays on the shore."""

    seed: int
    snapshots: SnapshotStore
    worlds: Worlds | None = None  # None unless the run is a spill


@dataclass(frozen=True)
class SpillResult:
    """The results of a spill."""

    period: Period
    spill: Spill
    segments: Segments
    fates: FatesSource  # readable as long as the run's files are open
    worlds: Worlds
    prior: Worlds  # worlds of the first round
    posterior: finds.Posterior
    surprises: tuple[finds.Surprise, ...]
    washup: xr.Dataset
    rounds: tuple[float, ...]  # effective worlds in each round


def stretches_of_spill(
    period: Period, spill: Spill, coast: Coast, prior_worlds: Worlds
) -> Segments:
    """Return the stretches of coast for a spill's figures.

    Raises:
        UserError: a find, a patrol or the file of stretches is wrong.
    """
    segments = evidence.cut_stretches(spill, coast)
    evidence.build_evidence(period, spill, segments, coast, prior_worlds)
    return segments


def iterate_importance_sampling(
    period: Period,
    spill: Spill,
    coast: Coast,
    segments: Segments,
    first: DriftedRun,
    renew: Callable[[Proposal, int], DriftedRun],
) -> tuple[DriftedRun, SpillResult]:
    """Return the run whose worlds are effective enough given the finds, and its results.

    Args:
        period: period of the run.
        spill: the spill.
        coast: the coast of its domain.
        segments: stretches of the coast.
        first: the run with worlds from the prior.
        renew: draws worlds from a proposal and runs their objects; it also takes the number of the
            round, from 1.

    Returns:
        The last run, weighted by the finds, and the results.
    """
    assert first.worlds is not None
    drifted, current_worlds, rounds, usual = first, first.worlds, [0.0], None
    while True:
        known = evidence.build_evidence(period, spill, segments, coast, current_worlds)
        fates = read_fates(period, spill, drifted.snapshots, segments, known)
        usual = finds.usual(fates, known, current_worlds.log_weight) if usual is None else usual
        known = replace(known, usual=usual)
        posterior = finds.posterior(
            fates, known, current_worlds.latent, current_worlds.log_weight, current_worlds.member
        )
        rounds[-1] = posterior.effective
        if (
            posterior.effective >= FEWEST
            or len(rounds) > spill.redraws
            or not (known.finds or known.patrols)
        ):
            break
        effective_wanted = min(
            max(current_worlds.size / NARROWING, ENOUGH * len(current_worlds.names)),
            current_worlds.size / 4,
        )
        # The exponent interpolates from the density that the worlds were drawn from (0) to the
        # posterior (1), so it never leads back to the prior.
        log_target = posterior.log_likelihood + current_worlds.log_weight
        proposal = worlds.proposal_around(
            current_worlds,
            weights.shares(finds.tempering_exponent(log_target, effective_wanted) * log_target),
        )
        drifted = renew(proposal, len(rounds))
        assert drifted.worlds is not None
        current_worlds = drifted.worlds
        rounds.append(0.0)
    drifted.snapshots.reweigh(_log_weights(fates, posterior))
    aftermath = SpillResult(
        period,
        spill,
        segments,
        fates,
        current_worlds,
        first.worlds,
        posterior,
        finds.surprises(
            fates, known, current_worlds.latent, current_worlds.log_weight, current_worlds.member
        ),
        washup.build_washup(
            realisations.realise(fates, posterior, drifted.seed, spills_per_world(spill)),
            segments,
            posterior.weight,
            _outputs(period, drifted.snapshots),
            period.start,
            [kind.name for kind in spill.kinds],
            spills_per_world(spill),
            drifted.snapshots.folder,
        ),
        tuple(rounds),
    )
    return drifted, aftermath


def read_fates(
    period: Period,
    spill: Spill,
    snapshots: SnapshotStore,
    segments: Segments,
    known: finds.SpillEvidence,
) -> StoredFates:
    """Return the particles' fates at the end of the run, and positions at finds at sea.

    Args:
        period: period of the run.
        spill: the spill.
        snapshots: the run's snapshots, whose files must stay open.
        segments: stretches of coast.
        known: finds and patrols.

    Returns:
        The fates, part by part.
    """
    times = _outputs(period, snapshots).tolist()
    at_sea = {
        k: times.index(find.time)
        for k, find in enumerate(known.finds)
        if isinstance(find.place, finds.AtSea)
    }
    return StoredFates(
        snapshots, spill.worlds, release.particles_per_class(spill), segments.of_edge, at_sea
    )


def _log_weights(fates: FatesSource, posterior: finds.Posterior) -> Iterator[Array]:
    """Yield the log weights of the particles given the finds, part by part; the largest is 0.

    A world's weight is shared among its particles: by class in proportion to the objects still to
    be found, and within a class in proportion to each particle's chance of not having been found.
    """
    objects_left = finds.remaining_objects(posterior)
    # if all objects are found, the map shows where they could have been
    if not (objects_left * posterior.weight[:, None]).any():
        objects_left = np.ones_like(objects_left)
    shared, largest = unfound_chances(fates, posterior.known)
    with np.errstate(divide="ignore"):
        log_weight_of_class = (
            np.log(posterior.weight)[:, None]
            + np.log(objects_left)
            - np.log(np.maximum(shared, 1e-300))
        )
    top = (log_weight_of_class + np.log(np.maximum(largest, 1e-300))).max()
    for part in fates.parts():
        chance = 1 - finds.found(part, posterior.known)
        log_weight = log_weight_of_class[part.world, part.kind] + np.log(np.maximum(chance, 1e-300))
        yield (log_weight - top).astype(np.float32)


def unfound_chances(fates: FatesSource, known: finds.SpillEvidence) -> tuple[Real, Real]:
    """Return the sum and the maximum of particles' chances of not being found.

    Args:
        fates: fates of all particles.
        known: finds and patrols.

    Returns:
        Sum and maximum over the particles of a class in a world, (W, classes) each.
    """
    shared, largest = (np.zeros((fates.worlds, len(fates.counts))) for _ in range(2))
    for part in fates.parts():
        chance = 1 - finds.found(part, known)
        cell = (part.world - part.here.start) * shared.shape[1] + part.kind
        shared[part.here] = np.bincount(cell, chance, part.many * shared.shape[1]).reshape(
            part.many, -1
        )
        for kind in range(shared.shape[1]):
            largest[part.here, kind] = chance[part.kind == kind].reshape(part.many, -1).max(axis=1)
    return shared, largest


def _outputs(period: Period, snapshots: SnapshotStore) -> npt.NDArray[np.int64]:
    """Return the output times [s since start]."""
    return period.seconds(snapshots.time(k) for k in range(len(snapshots)))


def spills_per_world(spill: Spill) -> int:
    """Return the number of complete spills drawn for each world."""
    return int(np.clip(spill.per_world // spill.objects[1], 1, REALISATIONS))


def rows_of_unknowns(after: SpillResult) -> dict[str, Any]:
    """Return the unknowns before and after the finds (drift.spills.worlds.unknowns)."""
    kinds = [kind.name for kind in after.spill.kinds]
    return unknowns.unknowns_table(
        after.worlds, after.prior, after.posterior, after.period.start, kinds
    )


def summary_of_spill(after: SpillResult) -> dict[str, Any]:
    """Return the figures of a spill for summary.json."""
    data, spill = after.washup, after.spill
    end = data.isel(time=-1)
    columns = washup_tables.stretch_columns(data)
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    densest = sorted(
        (row for row in rows if row["expected"] >= SOME), key=lambda row: row["rank_per_km"]
    )
    return {
        "spill": {
            "objects": list(spill.objects),
            "worlds": spill.worlds,
            "particles_per_world": spill.per_world,
            "effective_worlds": after.posterior.effective,
            "effective_worlds_by_round": list(after.rounds),
            "warning": joined_warnings(after),
            "notes": _accuracy_notes(spill),
            "stretches": len(after.segments.name),
            "totals": {
                str(fate): {
                    "expected": float(end["total"].values[k]),
                    "standard_error": float(end["total_se"].values[k]),
                    **{
                        f"number_{100 * share:.0f}": float(end["total_number"].values[j, k])
                        for j, share in enumerate(data["quantile"].values)
                    },
                }
                for k, fate in enumerate(data["fate"].values)
            },
            "worst_stretches": rows[:WORST],
            "densest_stretches": densest[:WORST],
            "patrols": rows_of_patrols(spill, after.segments),
            "silence": silence_of_spill(after),
            "finds": rows_of_finds(after),
            "unknowns": rows_of_unknowns(after),
        }
    }


def rows_of_finds(after: SpillResult) -> list[verdict.Row]:
    """Return the row of each find (drift.spills.worlds.verdict.find_rows), in order of time."""
    return verdict.find_rows(after.spill, after.segments, after.posterior, after.surprises)


def silence_of_spill(after: SpillResult) -> str | None:
    """Return up to when the absence of reports is evidence, as text; None without evidence."""
    return verdict.silence_in_words(after.period, after.spill, after.posterior.known.now)


def rows_of_patrols(spill: Spill, segments: Segments) -> list[dict[str, Any]]:
    """Return each patrol's time, detection probability and searched stretches."""
    rows = []
    for patrol in spill.patrols:
        walked = list(evidence.stretches_of_patrol(patrol, segments))
        rows.append(
            {
                "name": patrol.name,
                "time": patrol.time,
                "detection": patrol.detection,
                "stretches": [washup_tables.stretch_with_town(segments, k) for k in walked],
                "segments": walked,
                "length_km": float(segments.length[walked].sum() / 1000),
            }
        )
    return rows


def joined_warnings(after: SpillResult) -> str | None:
    """Return the warnings in one sentence; None if there are none."""
    return "; ".join(spill_warnings(after)) or None


def spill_warnings(after: SpillResult) -> list[str]:
    """Return warnings of finds that do not fit the spill, and of too few effective worlds."""
    texts = verdict.odd_find_warnings(rows_of_finds(after))
    few, many = _probability_of_number(after)
    if min(few, many) < verdict.ODD:
        how = (
            f"so few had a probability of {few:.1g}"
            if few < many
            else f"so many had a probability of {many:.1g}"
        )
        texts.append(
            f"the finds ({len(after.posterior.known.finds)}) don't fit the spill: {how} "
            "beforehand; check the patrols' detection, [spill.reporting] rate and [spill] "
            "destroyed before believing the figures"
        )
    count = effective.Count(after.posterior.effective, after.spill.worlds, "worlds")
    if count.few:
        when = "after the finds" if after.posterior.known.finds else ""
        texts.append(
            f"{effective.sentence(count, when, 'figures are rough')}; raise spill.worlds or "
            "spill.redraws, or check the finds that are called odd"
        )
    return texts


def _probability_of_number(after: SpillResult) -> tuple[float, float]:
    """Return the prior probabilities of at most, and of at least, the number of finds ashore."""
    posterior, numbers = after.posterior, after.posterior.known.numbers
    ashore = sum(
        unrelated < 0.5 and not isinstance(find.place, finds.AtSea)
        for find, unrelated in zip(posterior.known.finds, posterior.unrelated, strict=True)
    )
    if not posterior.known.finds and not posterior.known.patrols:
        return 1.0, 1.0
    world_weight = weights.shares(after.worlds.log_weight)
    share, grid_prior = (
        posterior.share @ numbers.shares,
        numbers.objects_prior[:, None] * numbers.destroyed_prior,
    )
    count, odds = numbers.objects[:, None], np.empty((len(world_weight), 2))
    for batch in finds.world_ranges(len(world_weight)):
        chance = share[batch, None, None] * (1 - numbers.destroyed)
        odds[batch, 0] = (grid_prior * special.bdtr(np.minimum(ashore, count), count, chance)).sum(
            (1, 2)
        )
        odds[batch, 1] = (
            grid_prior * special.bdtrc(np.minimum(ashore - 1, count), count, chance)
        ).sum((1, 2))
    few, many = partials.sum_over_worlds(world_weight[:, None] * odds).tolist()
    return few, many


def _accuracy_notes(spill: Spill) -> list[str]:
    """Return notes on the accuracy of the figures."""
    if spill.objects[1] <= spill.per_world:
        return []
    return [
        f"a world has {spill.per_world:,} particles for up to {spill.objects[1]:,} objects: each "
        "stands for several, which makes ranges up to "
        f"{(spill.objects[1] / spill.per_world) ** 0.5:.2f} times too wide; raise spill.per_world"
    ]
