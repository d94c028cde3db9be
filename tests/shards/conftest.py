"""What tests of shards share: they hold runs against each other to the bit, which maps of few cells show as well."""

import pytest


@pytest.fixture(scope="module", autouse=True)
def small_maps(coarse_maps: None) -> None:
    """Make all maps of fewer cells, in each way of making a run; workers make none."""
