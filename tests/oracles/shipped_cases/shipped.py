"""Shipped cases that are run once for two questions: is it what a second opinion says, and what the
case expects?
"""

from typing import Any

from drift.case import expect
from drift.forecast.products import tables
from drift.products.files import formats

# in test_case_oracles.py and test_case_searches.py; test_cases.py runs the others
COMPARED = ("overdue_boat", "norkyst_raft", "overdue_yacht")


def misses(result: Any) -> list[str]:
    """Return what a result misses of what its case expects at the end, a line each."""
    return expect.misses(
        result.case.expect,
        formats.plain(tables.summary_of_forecast(result.forecast))["outputs"][-1],
    )
