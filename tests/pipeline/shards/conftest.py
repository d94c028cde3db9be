"""What the tests of shards and clusters share: a case, its result in one piece, and two workers."""

from collections.abc import Iterator
from typing import Any

import pytest
import shards as runs

import drift
from drift.pipeline.shards import cluster


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> drift.Case:
    return runs.case(tmp_path_factory.mktemp("cluster"))


@pytest.fixture(scope="module")
def made(case: drift.Case) -> drift.Result:
    return drift.run(case)


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    with cluster.connect_to_cluster(2, None) as client:
        yield client
