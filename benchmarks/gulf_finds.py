"""What each find says: the case gulf_containers after none, one, two ... of its finds, on the same
worlds.

    python benchmarks/gulf_finds.py

Prints the table of docs/spill.md. The finds are those of one simulated spill, of which 238 objects
came ashore.
"""

import argparse
from dataclasses import replace

import numpy as np
import smallest

import drift
from drift.pipeline import flow, run_options
from drift.spills.worlds import finds, washup
from drift.spills.worlds.realisations import realise
from drift.spills.worlds.renewal import SpillResult


def main() -> None:
    """Drift once, then add the finds one by one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", type=int, default=2000)
    given = smallest.parse(parser, worlds=50)
    with flow.open_result(
        run_options.open_job(drift.load("gulf_containers", {"spill.worlds": str(given.worlds)}))
    ) as result:
        assert result.aftermath is not None
        _tell(result.aftermath)


def _tell(after: SpillResult) -> None:
    """Print the table."""
    known, worlds, end = after.posterior.known, after.worlds, after.period.duration
    surprises = {one.find.name: one for one in after.surprises}
    fates = [str(f) for f in after.washup["fate"].values]
    print(
        "| finds | the last one | beforehand | worlds that count | not yet found, ashore on day 10 | windage | most likely stretch |"
    )
    print("|---|---|---|---|---|---|---|")
    for count in range(len(known.finds) + 1):
        some = known.finds[:count]
        told = finds.posterior(
            after.fates,
            replace(known, finds=some, now=float(some[-1].time) if some else 0.0),
            worlds.latent,
            worlds.log_weight,
        )
        drawn = realise(after.fates, told, 1, 1)
        kinds = [kind.name for kind in after.spill.kinds]
        data = washup.build_washup(
            drawn, after.segments, told.weight, np.array([end]), after.period.start, kinds
        )
        k = fates.index("ashore")
        low, _, high = data["total_number"].values[:, k, -1]
        worst = washup.worst_stretches(data, 1)[0]
        place, before = ("", "")
        if some:
            one = surprises[some[-1].name]
            place = f"{some[-1].name}, {after.segments.name[some[-1].place]}"
            before = f"{one.probability:.1%} ({one.tail:.0%})"
        print(
            f"| {count} | {place} | {before} | {told.effective:.0f} | {data['total'].values[k, -1]:.0f} ({low:.0f} to "
            f"{high:.0f}) | {told.weight @ worlds.windage:.2f} +- "
            f"{np.sqrt(told.weight @ (worlds.windage - told.weight @ worlds.windage) ** 2):.2f} | "
            f"{data['name'].values[worst]}: {data['expected'].values[-1, worst]:.1f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
