"""A budget as text for the terminal, as a CSV table, and as numbers for summary.json."""

from typing import Any

from drift.assess.budget import consensus
from drift.assess.budget.record import Budget
from drift.products.files import formats
from geo import notation
from geo.notation import NMI

EXPLAINED = (
    "Shapley: the mean of what a source adds to those that are on before it, over all orders; "
    "they add up to 100 %"
)
LEAST_REST = 0.001  # share of the area without any source from which it is printed


def budget_facts(found: Budget) -> dict[str, str]:
    """Return the shares at the last time, those at other times in a line each, and the advice."""
    last = len(found.times) - 1
    facts = {"time": notation.format_dtg(found.times[last])}
    for s, share in enumerate(found.shares):
        facts[f"{notation.hundredths(share)} % area"] = f"{size_in_words(found, last, s)} nmi2"
    for k, source in enumerate(found.sources):
        facts[source.name] = _source_in_words(found, k, last)
    if (found.rest.value[last] >= LEAST_REST).any():
        facts["rest"] = _listed(found.rest.value[last], found.rest.error[last])
    for t, time in enumerate(found.times[:-1]):
        facts[f"at {notation.format_dtg(time)}"] = "; ".join(
            f"{source.name} {_listed(found.share.value[k, t], found.share.error[k, t])}"
            for k, source in enumerate(found.sources)
        )
    facts["shares"] = f"of the {areas_in_words(found)} areas. {EXPLAINED}"
    facts["greatest"] = f"{found.greatest.name}: {found.greatest.advice}"
    if found.consensus is not None:
        facts["consensus"] = consensus.consensus_in_words(found.consensus)
    if found.left_out:
        facts["note"] = f"before any search: {', '.join(found.left_out)} not used"
    return facts


def size_in_words(found: Budget, time: int, share: int, sign: str = "+-") -> str:
    """Return the size of an area [nmi2] with its standard error."""
    size, error = (x[time, share] / NMI**2 for x in (found.total.value, found.total.error))
    if size >= 100:
        return f"{size:,.0f} {sign} {error:,.0f}"
    return f"{size:.3g} {sign} {error:.1g}"


def areas_in_words(found: Budget) -> str:
    """Return the shares of the areas, like "50, 95 %"."""
    return f"{', '.join(notation.hundredths(share) for share in found.shares)} %"


def _source_in_words(found: Budget, source: int, time: int) -> str:
    """Return the shares of a source, and what the areas are without it and with it alone."""
    share, without, alone = (
        (estimate.value[source, time], estimate.error[source, time])
        for estimate in (found.share, found.without, found.alone)
    )
    changes = ", ".join(change_in_words(float(value)) for value in without[0])
    # to a hundredth: with a source that spreads nothing alone the area is rounding
    sizes = ", ".join(f"{round(value / NMI**2, 2):,.3g}" for value in alone[0])
    return f"{_listed(*share)}; without it {changes}; alone {sizes} nmi2"


def change_in_words(change: float) -> str:
    """Return a relative change of an area, like "38 % smaller"."""
    rounded = round(100 * abs(change))
    if rounded == 0:
        return "the same"
    return f"{rounded} % {'smaller' if change < 0 else 'larger'}"


def _listed(values: Any, errors: Any) -> str:
    """Return shares with their standard errors, one for each area."""
    return ", ".join(
        f"{100 * value:.0f} +- {100 * error:.1f} %"
        for value, error in zip(values, errors, strict=True)
    )


def budget_csv(found: Budget, run: str) -> str:
    """Return a row for each time, area and source as CSV; run: the run_id, for the last column."""
    rows = []
    for row in found.table.to_dict("records"):
        rows.append(
            {
                "time": row["time"].to_datetime64(),
                "area_percent": notation.hundredths(row["area"]),
                "source": row["source"],
                "share": row["share"],
                "share_standard_error": row["share_standard_error"],
                "change_without": row["without"],
                "change_without_standard_error": row["without_standard_error"],
                "alone_nmi2": row["alone_m2"] / NMI**2,
                "alone_standard_error_nmi2": row["alone_m2_standard_error"] / NMI**2,
            }
        )
    return formats.csv_rows(rows, run=run, digits=".6g")


def summary_of_budget(found: Budget) -> dict[str, Any]:
    """Return the figures for summary.json, areas in [m2]."""
    return {
        "particles": found.particles,
        "batches": len(found.batches),
        "not_used": list(found.left_out),
        "areas": [
            {
                "time": time,
                "area": share,
                "m2": found.total.value[t, s],
                "standard_error_m2": found.total.error[t, s],
                "rest": found.rest.value[t, s],
                "sources": {
                    source.key: {
                        "share": found.share.value[k, t, s],
                        "share_standard_error": found.share.error[k, t, s],
                        "change_without": found.without.value[k, t, s],
                        "change_without_standard_error": found.without.error[k, t, s],
                        "alone_m2": found.alone.value[k, t, s],
                        "alone_standard_error_m2": found.alone.error[k, t, s],
                    }
                    for k, source in enumerate(found.sources)
                },
            }
            for t, time in enumerate(found.times)
            for s, share in enumerate(found.shares)
        ],
        "greatest": {"source": found.greatest.key, "advice": found.greatest.advice},
        "off": {source.key: source.off for source in found.sources},
        **({"consensus": _summary_of_consensus(found.consensus)} if found.consensus else {}),
    }


def _summary_of_consensus(agreed: consensus.Consensus) -> dict[str, Any]:
    """Return the areas [m2] by how many models agree, at each time."""
    many = len(agreed.names)
    return {
        "of": agreed.what,
        "models": list(agreed.names),
        "areas": [
            {
                "time": time,
                "area": share,
                "m2_by_models": [agreed.area(t, s, least) for least in range(1, many + 1)],
            }
            for t, time in enumerate(agreed.whole.data["time"].values)
            for s, share in enumerate(agreed.whole.shares)
        ],
    }
