"""What differs between two cases, in words and as a table."""

from typing import Any

from drift.contrast.figures import SHIFT
from drift.contrast.record import Contrast
from drift.contrast.units import Difference
from drift.output import formats
from geo import notation
from geo.notation import NMI

HEADER = ["time_utc", "quantity", "name", "unit", "a", "b", "difference", "standard_error", "run_id"]
WORST = 10  # stretches that are listed in words


def table(found: Contrast, run: str) -> str:
    """Return every figure as CSV, in SI; run: its run_id, in the last column."""
    rows = [
        [notation.iso(row.time), row.quantity, row.name, row.unit, *map(_cell, (row.a, row.b, row.difference, row.error)), run]
        for row in found.rows
    ]  # fmt: skip
    return formats.csv_text(HEADER, rows)


def _cell(value: float) -> str:
    return f"{value:.9g}" if value == value else ""


def numbers(found: Contrast) -> dict[str, Any]:
    """Return the figures for the summary, in SI."""
    return {
        "step_s": found.step,
        "notes": list(found.notes),
        "differences": [
            {
                "time": row.time, "quantity": row.quantity, "name": row.name, "unit": row.unit,
                "a": row.a, "b": row.b, "difference": row.difference, "standard_error": row.error,
            }
            for row in found.rows
        ],
    }  # fmt: skip


def facts(found: Contrast) -> dict[str, str]:
    """Return what differs at the last output of both, and of the run as a whole, a line each."""
    last = found.times[-1]
    told = {
        "A": found.names[0],
        "B": found.names[1],
        "time": notation.group(last),
        "mean of B from that of A": _shift(found),
    }
    for row in found.rows:
        if row.time == last and row.quantity not in SHIFT and (row.a or row.b) and row not in found.of_run:
            told[_called(row)] = words(row)
    stretches = 0
    for row in found.of_run:
        stretches += row.quantity == "ashore"
        if stretches <= WORST + 1:  # all of them together come first
            told[_called(row)] = words(row)
    told["errors"] = "standard errors of the differences, of chance alone, on common random numbers"
    return told | {f"note {k}": note for k, note in enumerate(found.notes, 1)}


def _called(row: Difference) -> str:
    if row.quantity in ("status", "scenario"):
        return f'scenario "{row.name}"' if row.quantity == "scenario" else row.name.replace("_", " ")
    if row.quantity == "area":
        return f"{row.name} area"
    return row.quantity if row.name == "all" else f"{row.quantity}, {row.name}"


def words(row: Difference) -> str:
    """Return a difference in words: A, B, B - A and its standard error."""
    scale, decimals, unit, sign = {
        "1": (100.0, 1, "%", " points"), "m2": (1 / NMI**2, 1, "nmi2", ""), "objects": (1.0, 1, "objects", ""),
    }[row.unit]  # fmt: skip
    a, b, difference, error = (scale * value for value in (row.a, row.b, row.difference, row.error))
    if a != a or b != b:
        return "none in one of them"
    own = f"{a:,.{decimals}f} -> {b:,.{decimals}f} {unit}"
    return f"{own}, {difference:+,.{decimals}f} +- {error:,.{decimals + 1}f}{sign}"


def _shift(found: Contrast) -> str:
    rows = {row.quantity: row for row in found.rows if row.time == found.times[-1] and row.quantity in SHIFT}
    east, north = (rows[name] for name in SHIFT)
    if east.difference != east.difference:
        return "none: nothing is on the map in one of them"
    return (
        f"{east.difference / NMI:+.2f} +- {east.error / NMI:.2f} nmi east, "
        f"{north.difference / NMI:+.2f} +- {north.error / NMI:.2f} nmi north"
    )


def page(found: Contrast) -> str:
    """Return all that differs as a page of text."""
    lines = [found.title, ""]
    told = facts(found)
    wide = max(map(len, told))
    lines += [f"{name:<{wide}}  {fact}" for name, fact in told.items()]
    lines += ["", "By time: mean of B from that of A [nmi], and areas [nmi2]", ""]
    for time in found.times:
        east, north = (row for name in SHIFT for row in found.at(time, name))
        shift = (
            "nothing on the map in one of them"
            if east.difference != east.difference
            else f"{east.difference / NMI:+.2f} +- {east.error / NMI:.2f} east, "
            f"{north.difference / NMI:+.2f} +- {north.error / NMI:.2f} north"
        )
        areas = "; ".join(f"{row.name} {words(row)}" for row in found.at(time, "area"))
        lines.append(f"{notation.group(time)}  {shift}; {areas}")
    return "\n".join(lines) + "\n"
