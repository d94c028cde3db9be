"""Python's search for cycles: off while modules are imported, and at work afterwards."""

import gc
from collections.abc import Iterator

import pytest

from drift.apps.cli import jobs


@pytest.fixture(autouse=True)
def thawed() -> Iterator[None]:
    gc.unfreeze()
    yield
    gc.unfreeze()
    assert gc.isenabled()


def test_imports_are_not_searched() -> None:
    with jobs._not_collected():
        assert not gc.isenabled()
        own: list[object] = []
    assert gc.isenabled()
    assert gc.get_freeze_count() > 10_000
    assert not any(one is own for one in gc.get_objects())


def test_it_is_at_work_after_an_import_that_fails() -> None:
    with pytest.raises(ImportError), jobs._not_collected():
        raise ImportError("no such library")
    assert gc.isenabled()


def test_what_a_second_run_of_the_process_leaves_is_searched() -> None:
    """Otherwise a program that runs many cases would keep the cycles of all."""
    with jobs._not_collected():
        pass
    with jobs._not_collected():
        assert gc.isenabled()
        cycle: list[object] = []
        cycle.append(cycle)
    assert any(one is cycle for one in gc.get_objects())
