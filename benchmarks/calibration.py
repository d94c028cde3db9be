"""Are the washup forecasts of a spill as sure as they may be? Simulation-based calibration on the
Gulf coast.

    python benchmarks/calibration.py [TRUTHS] [--worlds N] [--picture FILE.png] [--wrong FACTOR]

Truths are spills drawn from the prior of the case gulf_containers (100 objects, more of them
reported), each drifted as one world of its own with another seed. After 0, 1, 5 and 20 finds each
is forecast, and where the truth lies among the simulated spills of the forecast, its rank, must be
uniform (Cook, Gelman and Rubin 2006, doi:10.1198/106186006X136976; Talts et al. 2018,
arXiv:1804.06788): the number of all that come ashore by the end, and the number on stretches with a
mean of at least 1 (counts: randomised ranks). Beside it the same forecast without worlds, every
unknown drawn for each object alone. --wrong: the forecaster believes in reporting rates that are
too high by a factor.
"""

import argparse
import io
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import smallest
from scipy import stats

import drift
from drift.engine.motion import simulate, spool
from drift.engine.motion.spool import SnapshotStore
from drift.pipeline import run_setup
from drift.spills.worlds import evidence, finds, renewal, strandings
from drift.spills.worlds.fates import Fates
from drift.spills.worlds.realisations import realise
from kernels.runtime import runtime

FINDS = (0, 1, 5, 20)
CASE = {
    "spill.objects": "100",
    "spill.per_world": "100",
    "spill.reporting": '{ rate = { wild = "0.2 /day" }, bias = 0.5 }',
    "find": "[]",
    "output.every": '"10 d"',
}


@dataclass(frozen=True)
class Bank:
    """Worlds that have been drifted."""

    case: drift.Case
    fates: Fates
    worlds: object
    segments: object
    coast: object


def bank(seed: int, worlds: int) -> Bank:
    """Draw and drift worlds."""
    case = drift.load("gulf_containers", {**CASE, "spill.worlds": str(worlds), "seed": str(seed)})
    where = run_setup.open_for(case)
    begin = run_setup.prepare(case, where)
    book = strandings.Landings(begin.ensemble, False)
    outputs = case.period.seconds(case.outputs)
    moments = simulate.run(begin.ensemble, begin.scene, begin.clock, outputs, watch=book.watch)
    segments = evidence.cut_stretches(case.spill, where.coast)
    with SnapshotStore.of_run(
        case.period, begin.ensemble, moments, len(outputs), worlds=True, more=book.note
    ) as snapshots:
        known = evidence.build_evidence(
            case.period, case.spill, segments, where.coast, begin.worlds
        )
        spool.PART = 2**40  # all worlds in one part
        (fates,) = renewal.read_fates(case.period, case.spill, snapshots, segments, known).parts()
    begin.scene.forcing.close()
    return Bank(case, fates, begin.worlds, segments, where.coast)


@dataclass(frozen=True)
class Truth:
    """One true spill: where its objects come ashore and when, and when each is found."""

    kind: np.ndarray
    segment: np.ndarray  # -1: never ashore
    arrival: np.ndarray
    found: np.ndarray  # [s], inf: not within the run


def truths(made: Bank, rng: np.random.Generator, end: float) -> list[Truth]:
    """Return each world of a bank as a true spill: some objects destroyed, some reported."""
    fates, spill = made.fates, made.case.spill
    rate = evidence.reporting_rates(spill.reporting, made.segments)
    n = fates.world.size
    segment, arrival = np.full(n, -1), np.full(n, np.inf)
    segment[fates.stays.slot], arrival[fates.stays.slot] = fates.stays.segment, fates.stays.arrival
    result = []
    for world in range(fates.worlds):
        slots = np.flatnonzero(fates.world == world)
        lost = rng.random(slots.size) < rng.uniform(*spill.destroyed)
        seg, came = np.where(lost, -1, segment[slots]), np.where(lost, np.inf, arrival[slots])
        wait = rng.exponential(1, slots.size) / (rate[seg] * made.worlds.reporting[world])
        found = np.where(seg >= 0, came + wait, np.inf)
        result.append(Truth(fates.kind[slots], seg, came, np.where(found < end, found, np.inf)))
    return result


def rank(truth: float, sample: np.ndarray, weight: np.ndarray, rng: np.random.Generator) -> float:
    """Return the randomised rank of a truth among weighted values, in (0, 1)."""
    below, equal = weight[sample < truth].sum(), weight[sample == truth].sum()
    return float(below + rng.random() * equal)


def ranks(
    made: Bank,
    truth: Truth,
    known: finds.SpillEvidence,
    count: int,
    end: int,
    rng: np.random.Generator,
    seed: int,
):
    """Return (total, stretches, without worlds total, stretches; effective worlds) after a number
    of finds; None too few.
    """
    order = np.argsort(truth.found)[:count]
    if count and not np.isfinite(truth.found[order[-1]]):
        return None
    told = tuple(
        finds.Detection(f"{k}", int(truth.kind[i]), int(truth.segment[i]), int(truth.found[i]))
        for k, i in enumerate(order)
    )
    known = replace(known, finds=told, now=float(truth.found[order[-1]]) if count else 0.0)
    fates, worlds = made.fates, made.worlds
    posterior = finds.posterior(fates, known, worlds.latent, worlds.log_weight)
    ((_, (drawn,)),) = realise(fates, posterior, seed, 1)
    rest = np.ones(truth.segment.size, bool)
    rest[order] = False
    ashore = rest & (truth.arrival <= end)
    # Numbers ashore at the end by world and stretch, of those not found.
    stays = fates.stays
    amount = drawn.stands[stays.slot]
    world = fates.world[stays.slot]
    total = np.bincount(world, amount, fates.worlds)
    weight = posterior.weight
    result = {"total": [rank(ashore.sum(), total, weight, rng)], "stretch": []}
    mean = np.bincount(stays.segment, amount * weight[world], len(made.segments.name))
    pooled_p = np.bincount(stays.segment, weights=None, minlength=mean.size) / fates.world.size
    keep = 1 - made.case.spill.destroyed[1] / 2
    if count == 0:
        n = truth.segment.size
        alone = rng.binomial(n, keep * pooled_p.sum(), 20_000)
        even = np.full(alone.size, 1 / alone.size)
        result["total alone"] = [rank(ashore.sum(), alone, even, rng)]
        result["stretch alone"] = []
    for s in np.flatnonzero(mean >= 1):
        there = stays.segment == s
        number = np.bincount(world[there], amount[there], fates.worlds)
        true = int((ashore & (truth.segment == s)).sum())
        result["stretch"].append(rank(true, number, weight, rng))
        if count == 0:
            alone = rng.binomial(truth.segment.size, keep * pooled_p[s], 5_000)
            result["stretch alone"].append(rank(true, alone, np.full(5_000, 1 / 5_000), rng))
    return result, posterior.effective


def main() -> None:
    """Draw, forecast, and print a line for each number of finds."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("truths", nargs="?", type=int, default=200)
    options.add_argument("--worlds", type=int, default=5000)
    options.add_argument("--picture", type=Path)
    options.add_argument("--wrong", type=float, default=1.0)
    given = smallest.parse(options, truths=50, worlds=50, picture=io.BytesIO())
    runtime.start()
    begin = time.perf_counter()
    made, true = bank(1, given.worlds), bank(2, given.truths)
    end = made.case.period.duration
    rng = np.random.default_rng(5)
    spills = truths(true, rng, end)
    known = evidence.build_evidence(
        made.case.period, made.case.spill, made.segments, made.coast, made.worlds
    )
    known = replace(
        known, reporting=replace(known.reporting, rate=known.reporting.rate * given.wrong)
    )
    print(f"drifted in {time.perf_counter() - begin:.0f} s", flush=True)
    shown: dict[str, list[float]] = {}
    for count in FINDS:
        total, stretch, sizes = [], [], []
        for k, spill in enumerate(spills):
            found = ranks(made, spill, known, count, end, rng, 1000 * count + k)
            if found is None:
                continue
            values, effective = found
            total += values["total"]
            stretch.append(values["stretch"])
            sizes.append(effective)
            for name in ("total alone", "stretch alone"):
                if name in values:
                    shown.setdefault(name, []).extend(values[name])
        told = f"effective worlds: median {np.median(sizes):.0f}, least {min(sizes):.0f}; {time.perf_counter() - begin:.0f} s"
        print(line(f"{count} finds", total, stretch), told, flush=True)
        # A run would draw worlds again for the others; which they are depends on what was found
        # alone, so ranks stay uniform.
        enough = [k for k, size in enumerate(sizes) if size >= renewal.FEWEST]
        total, stretch = [total[k] for k in enough], [stretch[k] for k in enough]
        told = (
            line(f"{count} finds, where {renewal.FEWEST:.0f} worlds count", total, stretch)
            if enough
            else f"{count} finds: no spill of which {renewal.FEWEST:.0f} worlds count"
        )
        print(told, flush=True)
        shown[f"{count} finds, total"], shown[f"{count} finds, stretches"] = (
            total,
            [r for one in stretch for r in one],
        )
    print(line("without worlds", shown["total alone"], [[r] for r in shown["stretch alone"]]))
    if given.picture:
        draw(shown, given.picture, given.truths)


def line(name: str, total: list[float], stretch: list[list[float]]) -> str:
    """Return how uniform ranks are:

    Kolmogorov's p for totals; for stretches shares with errors by spill.
    """
    inside = np.array([np.mean([0.1 < r < 0.9 for r in one]) for one in stretch if one])
    mean = np.array([np.mean(one) for one in stretch if one])
    p = stats.kstest(total, "uniform").pvalue
    held = np.mean([0.1 < r < 0.9 for r in total])
    return (
        f"{name}: {len(total)} spills; total: KS p {p:.3f}, 10-90 % hold {held:.0%} +- {np.sqrt(0.16 / len(total)):.0%}; "
        f"stretches: mean rank {mean.mean():.3f} +- {mean.std() / np.sqrt(mean.size):.3f}, 10-90 % hold {inside.mean():.1%} +- "
        f"{inside.std() / np.sqrt(inside.size):.1%};"
    )


def draw(shown: dict[str, list[float]], path: Path | io.BytesIO, number: int) -> None:
    """Draw rank histograms: with worlds above, without below."""
    from matplotlib.figure import Figure

    names = [*(f"{count} finds, total" for count in FINDS), "total alone"]
    names += [*(f"{count} finds, stretches" for count in FINDS), "stretch alone"]
    words = {"total alone": "no worlds, total", "stretch alone": "no worlds, stretches"}
    figure = Figure((12, 5.2), layout="constrained")
    axes = figure.subplots(2, 5, sharex=True)
    for ax, name in zip(axes.ravel(), names, strict=True):
        values = np.array(shown[name])
        bins = 10
        dark = "alone" in name
        ax.hist(
            values,
            np.linspace(0, 1, bins + 1),
            color="#8b2e16" if dark else "#27496d",
            edgecolor="white",
        )
        level = values.size / bins
        if "total" in name:
            low, high = stats.binom.ppf([0.005, 0.995], values.size, 1 / bins)
            ax.axhspan(low, high, color="#999999", alpha=0.35, zorder=0)
        ax.axhline(level, color="#333333", linewidth=0.8)
        ax.set_title(
            f"{words.get(name, name)} ({values.size:,})".replace("1 finds", "1 find"), fontsize=9
        )
        ax.set_yticks([])
    figure.supxlabel("rank of the truth in the forecast", fontsize=9)
    figure.suptitle(
        f"Calibration of {number} simulated spills: flat is right; heaped at the ends is too sure "
        "(grey: 99 % of the heights that chance gives)", fontsize=10,
    )  # fmt: skip
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
