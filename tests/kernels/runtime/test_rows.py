"""Columns in the rows of one array are read, written, copied and inherited as if each had its own."""

import numpy as np
import pytest

from drift.engine.particles import ensemble as record
from drift.engine.particles.ensemble import Column
from kernels.runtime import rows, runtime

NAMES = ("a", "b", "c")
VALUES = np.arange(15, dtype=np.float32).reshape(3, 5)


def test_a_row_is_written_alone() -> None:
    columns = rows.stack(NAMES, VALUES)
    columns["b"].from_numpy(np.full(5, -1, np.float32))
    columns["c"].fill(7)
    np.testing.assert_array_equal(columns["a"].to_numpy(), VALUES[0])
    whole = rows.whole(columns, NAMES).to_numpy().reshape(3, 5)
    np.testing.assert_array_equal(whole, [VALUES[0], np.full(5, -1), np.full(5, 7)])
    with pytest.raises(ValueError, match="shape"):
        columns["a"].from_numpy(np.zeros(1, np.float32))


def test_what_is_read_is_a_copy() -> None:
    columns = rows.stack(NAMES, VALUES)
    columns["a"].to_numpy()[:] = 9
    np.testing.assert_array_equal(columns["a"].to_numpy(), VALUES[0])


def test_an_array_is_given_for_its_own_columns_in_their_order_alone() -> None:
    columns = rows.stack(NAMES, VALUES)
    for wrong in (("b", "a", "c"), ("a", "c"), ("a", "alone")):
        with pytest.raises(ValueError, match="is not row"):
            rows.whole({**columns, "alone": runtime.empty(5)}, wrong)
    other = rows.stack(NAMES, VALUES)
    with pytest.raises(ValueError, match="column b"):
        rows.whole({"a": columns["a"], "b": other["b"]}, ("a", "b"))


def test_each_array_is_made_once() -> None:
    columns = {"alone": runtime.upload(VALUES[0]), **rows.stack(NAMES, VALUES)}
    asked = []
    new = rows.rebuilt(columns, lambda name, array: asked.append(name) or runtime.copy(array))
    assert asked == ["alone", "a"]
    assert list(new) == list(columns)
    new["b"].fill(0)
    np.testing.assert_array_equal(columns["b"].to_numpy(), VALUES[1])
    np.testing.assert_array_equal(new["c"].to_numpy(), VALUES[2])
    assert len(rows.arrays(columns.values())) == 2


def test_ensembles_inherit_and_join_row_by_row() -> None:
    """Each column of an ensemble is as it would be alone: copies, samples and joins of slots do not
    mix rows.
    """
    spec = (Column("x", np.float32, 2, "", "", "both"), Column("y", np.int32, 1, "", ""), Column("z", np.float32, 3, "", "", "both"))  # fmt: skip
    ensemble = record.empty(1, (0, 2, 5), spec)
    assert list(ensemble.own) == ["x", "y", "z"]
    assert ensemble.own["z"].to_numpy().tolist() == [3] * 5
    values = {name: np.arange(5) + 10 * k for k, name in enumerate(ensemble.own)}
    for name, column in ensemble.own.items():
        column.from_numpy(values[name].astype(column.to_numpy().dtype))
    few = record.sample(ensemble, np.array([1, 2, 4]))
    both = record.join_ensembles([few, ensemble])
    record.inherit(ensemble.columns.values(), np.array([0, 0, 3, 3, 4]))
    for name in ensemble.own:
        assert few.own[name].to_numpy().tolist() == values[name][[1, 2, 4]].tolist()
        assert both.own[name].to_numpy().tolist() == [*values[name][[1, 2, 4]], *values[name]]
        assert ensemble.own[name].to_numpy().tolist() == values[name][[0, 0, 3, 3, 4]].tolist()
    assert few.bounds == (0, 1, 3)
