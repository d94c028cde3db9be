"""The differences between two cases as text, as CSV and for summary.json."""

from typing import Any

from drift.assess.compare.figures import SHIFT
from drift.assess.compare.record import Contrast
from drift.assess.compare.units import Difference
from drift.products.files import formats
from geo import notation
from geo.notation import NMI

OUR_GRID = (
    # start of a warning that is not printed: the user did not choose the common grid
    "output.grid: its cells are too coarse"
)
WORST = 10  # most stretches that are listed in the text


def comparison_csv(found: Contrast, run: str) -> str:
    """Return all figures as CSV, in SI; run: the run_id, for the last column."""
    rows = [
        {
            "time_utc": row.time,
            "quantity": row.quantity,
            "name": row.name,
            "unit": row.unit,
            "a": row.a,
            "b": row.b,
            "difference": row.difference,
            "standard_error": row.error,
            "given_a": found.given[0],
            "given_b": found.given[1],
        }
        for row in found.rows
    ]
    return formats.csv_rows(rows, run=run, digits=".9g")


def summary_of_comparison(found: Contrast) -> dict[str, Any]:
    """Return the figures for summary.json, in SI."""
    return {
        "step_s": found.step,
        "notes": list(found.notes),
        "given": dict(zip("ab", found.given, strict=True)),
        "differences": [
            {
                "time": row.time,
                "quantity": row.quantity,
                "name": row.name,
                "unit": row.unit,
                "a": row.a,
                "b": row.b,
                "difference": row.difference,
                "standard_error": row.error,
            }
            for row in found.rows
        ],
    }


def comparison_facts(found: Contrast) -> dict[str, str]:
    """Return the differences at the last common output and of the whole run, by name."""
    last = found.times[-1]
    lines = {
        "A": found.names[0],
        "B": found.names[1],
        **({"given": words_given(found)} if set(found.given) != {"nothing"} else {}),
        "time": notation.format_dtg(last),
        "mean of B relative to that of A": _shift(found),
    }
    for row in found.rows:
        if (
            row.time == last
            and row.quantity not in SHIFT
            and (row.a or row.b)
            and row not in found.of_run
        ):
            lines[_row_name(row)] = difference_in_words(row)
    stretches = 0
    for row in found.of_run:
        stretches += row.quantity == "ashore"
        if stretches <= WORST + 1:  # the sum over all stretches comes first
            lines[_row_name(row)] = difference_in_words(row)
    lines["errors"] = "standard errors of the differences (sampling only), on common random numbers"
    lines |= {f"note {k}": note for k, note in enumerate(found.notes, 1)}
    return lines | {
        f"warning {k}, {name}": words
        for name, result in (("A", found.a), ("B", found.b))
        for k, words in enumerate(
            (w for w in result.summary["warnings"] if not w.startswith(OUR_GRID)), 1
        )
    }


def words_given(found: Contrast) -> str:
    """Return by which evidence the cases are weighted, and for spills how to compare without it."""
    a, b = found.given
    each = f"A and B are each weighted by {a}" if a == b else f"A is weighted by {a}, B by {b}"
    if found.a.case.spill is None:
        return each
    free = "--set find='[]' --set patrol='[]'"
    return f"{each}, so differences include their effect; to compare without finds: {free}"


def _row_name(row: Difference) -> str:
    if row.quantity in ("status", "scenario"):
        return (
            f'scenario "{row.name}"' if row.quantity == "scenario" else row.name.replace("_", " ")
        )
    if row.quantity == "area":
        return f"{row.name} area"
    return row.quantity if row.name == "all" else f"{row.quantity}, {row.name}"


def difference_in_words(row: Difference) -> str:
    """Return a row as text: A, B, B - A and its standard error."""
    scale, decimals, unit, sign = {
        "1": (100.0, 1, "%", " points"),
        "m2": (1 / NMI**2, 1, "nmi2", ""),
        "objects": (1.0, 1, "objects", ""),
    }[row.unit]
    a, b, difference, error = (scale * value for value in (row.a, row.b, row.difference, row.error))
    if a != a or b != b:
        return "none in one of the cases"
    own = f"{a:,.{decimals}f} -> {b:,.{decimals}f} {unit}"
    return f"{own}, {difference:+,.{decimals}f} +- {error:,.{decimals + 1}f}{sign}"


def _shift(found: Contrast) -> str:
    rows = {
        row.quantity: row
        for row in found.rows
        if row.time == found.times[-1] and row.quantity in SHIFT
    }
    east, north = (rows[name] for name in SHIFT)
    if east.difference != east.difference:
        return "none: one of the cases has nothing on the map"
    return (
        f"{east.difference / NMI:+.2f} +- {east.error / NMI:.2f} nmi east, "
        f"{north.difference / NMI:+.2f} +- {north.error / NMI:.2f} nmi north"
    )


def comparison_page(found: Contrast) -> str:
    """Return all differences as a page of text."""
    lines = [found.title, ""]
    facts = comparison_facts(found)
    wide = max(map(len, facts))
    lines += [f"{name:<{wide}}  {fact}" for name, fact in facts.items()]
    lines += ["", "By time: mean of B relative to that of A [nmi], and areas [nmi2]", ""]
    for time in found.times:
        east, north = (row for name in SHIFT for row in found.at(time, name))
        shift = (
            "one of the cases has nothing on the map"
            if east.difference != east.difference
            else f"{east.difference / NMI:+.2f} +- {east.error / NMI:.2f} east, "
            f"{north.difference / NMI:+.2f} +- {north.error / NMI:.2f} north"
        )
        areas = "; ".join(
            f"{row.name} {difference_in_words(row)}" for row in found.at(time, "area")
        )
        lines.append(f"{notation.format_dtg(time)}  {shift}; {areas}")
    return "\n".join(lines) + "\n"
