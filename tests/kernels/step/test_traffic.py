"""benchmarks/traffic.py counts the columns of a step: against what a step truly reads and writes."""

import numpy as np
import pytest
import throughput
import traffic

from kernels.runtime import batch, runtime
from kernels.step import advance as kernel
from kernels.step import coast

N = 400
LEFT = 3  # a status: the particle has left
# Values that would change a step which read the column; all others get 1 more.
UNIT = 2.0**32 / 360  # binary angle units of a degree
OTHER = {
    "status": LEFT,
    "release": 900,
    "sink_time": 1_000,
    "lon": round(-90 * UNIT),
    "lat": round(25 * UNIT),
}
PHYSICS = throughput.FULL._replace(jibe_rate=1e-3)
BEACH = kernel.Beach(stay=3_600.0, offing=50.0)
CASES = {
    "wind": (kernel.Physics(), kernel.Surroundings(throughput.domain())),
    "errors": (throughput.ERRORS, kernel.Surroundings(throughput.domain(), scheme="rk2")),
    "everything": (
        PHYSICS,
        kernel.Surroundings(throughput.domain(), coast.open_sea(), BEACH, bias=True, sinks=True),
    ),
}


@pytest.mark.thorough
@pytest.mark.parametrize("case", CASES)
def test_as_many_columns_are_counted_as_a_step_reads_and_writes(case: str) -> None:
    """Read is what changes another column when it is another; written is what is not as before."""
    runtime.start("cpu")
    tiles = throughput.fields()
    physics, place = CASES[case]
    begin, end = _stepped(tiles, physics, place, "")
    written = {name for name in begin if not np.array_equal(begin[name], end[name])}
    read = {"scenario"}  # where its noise and its physics stand: no other value is allowed here
    for name in begin.keys() - read:
        _, other = _stepped(tiles, physics, place, name)
        if any(not np.array_equal(end[each], other[each]) for each in begin if each != name):
            read.add(name)
    counted = traffic.columns(kernel.features(throughput.RANGES, (physics,), place))
    assert (len(counted.read), len(counted.written)) == (len(read), len(written)), (read, written)
    assert counted.bytes == 4 * (len(read) + len(written))


def _stepped(
    tiles: object, physics: kernel.Physics, place: kernel.Surroundings, changed: str
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return columns before and after a step, with one of them changed."""
    rng = np.random.default_rng(5)
    lon, lat = ((rng.uniform(*ends, N) * UNIT).astype(np.int32) for ends in ((-95, -85), (20, 30)))
    ensemble = throughput.ensemble_at(lon, lat)
    ensemble.own["side"].from_numpy(np.where(np.arange(N) % 2, 1, -1).astype(np.int32))
    if changed:
        column = ensemble.columns[changed]
        values = column.to_numpy()
        column.from_numpy(
            np.full_like(values, OTHER[changed])
            if changed in OTHER
            else values + values.dtype.type(1)
        )
    begin = {name: column.to_numpy() for name, column in ensemble.columns.items()}
    own = batch.batch_of((0, N), (0,), (0,))
    kernel.mover(ensemble, own, tiles, throughput.RANGES, (physics,), place, 1)(
        kernel.Step(1, 600, 600, 1)
    )
    return begin, {name: column.to_numpy() for name, column in ensemble.columns.items()}


def test_a_step_gathers_four_nodes_a_quantity_and_stage() -> None:
    """By hand: 4 stages x 2 quantities x 4 nodes x (2 components x 2 times) x 4 bytes."""
    _, place = CASES["wind"]
    chosen = kernel.features(throughput.RANGES, (kernel.Physics(),), place)
    assert traffic.gathered(chosen) == 4 * 2 * 4 * 4 * 4
