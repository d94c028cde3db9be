"""Sensor lines alone change no weight: the table of updates has its columns, and no row."""

from dataclasses import replace

import searches

from drift.evidence.filter.products import tables


def test_a_table_without_updates_has_its_columns() -> None:
    updates = searches.search()[3]
    rows = tables.csv(updates, "run").splitlines()
    assert rows[0] == ",".join([*tables.COLUMNS, "run_id"])
    assert tables.csv(replace(updates, all=()), "run").splitlines() == rows[:1]
