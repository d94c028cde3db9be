"""Many forecasts in one process, one after another.

They may differ in starts, places, seeds, errors or objects. What the cases have in common is made
once: their files are opened, surveyed and decoded once, their coast is built once. A forecast of
many is the forecast that `drift.run` makes of its case alone, bit for bit, whoever else is among
them and in whatever order. Forecasts come one by one, so that ten thousand need no more memory than
one (with maps: three); one that is refused says why, and the next goes on.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from drift.case.record import Case
from drift.engine.motion import scene, simulate
from drift.engine.motion.spool import SnapshotStore
from drift.engine.particles import snapshot
from drift.forecast import build as forecast_build
from drift.forecast.build import Forecast
from drift.pipeline import run_setup
from drift.pipeline.run_options import Report
from drift.pipeline.shared_forcing import Waters, divide
from geo import sphere
from geo.array import Array
from geo.errors import UserError
from kernels.runtime import runtime

Maps = bool | Literal["last"]

AHEAD = 2  # forecasts at most that drift before the maps of one are done
NOTHING = np.empty((0, 0))


@dataclass(frozen=True, repr=False)
class Brief:
    """A forecast in brief: its particles at each output, and its maps where they were asked for.

    Arrays are of shape (outputs, particles). Of one that was refused they are empty, and `error`
    says why.
    """

    case: Case
    times: npt.NDArray[np.datetime64]  # of the outputs, UTC, shape (outputs,)
    lon: Array  # [deg] -180 to 180
    lat: Array
    status: Array  # uint8, drift.engine.particles.status.Status: 0 is adrift, 1 ashore
    probability: Array  # adds up to 1 over the particles, of all statuses
    # (outputs, 2) lon, lat [deg] of the mean of those adrift or ashore; NaN where there are none
    mean: Array
    step: int = 0  # [s]
    forecast: Forecast | None = None  # maps: of all outputs, or of the last
    error: UserError | None = None

    def __repr__(self) -> str:
        """Return what it is, in a line."""
        told = (
            f"rejected: {self.error}"
            if self.error
            else f"{len(self.times)} outputs, {self.lon.shape[-1]:,} particles"
        )
        return f'<drift.Brief "{self.case.title}": {told}>'


def run_many(
    cases: Sequence[Case],
    *,
    datasets: Mapping[str, Any] | None = None,
    threads: int | None = None,
    backend: str = "cpu",
    maps: Maps = False,
    report: Report | None = None,
) -> Iterator[Brief]:
    """Give the forecasts of cases, in their order, each as soon as it is made.

    Each is the forecast that `drift.run` makes of its case alone, bit for bit. Files and coast are
    opened once, kernels are compiled once. It is a generator: what is not kept is freed.

    Args:
        cases: of `drift.load` and `drift.vary`; they need have nothing in common. Spills have no
            forecast in brief: theirs is an error.
        datasets: the xarray.Datasets that sources of any of them with `dataset = "name"` name, by
            that name; they are only read, and not kept.
        threads: threads of the CPU; None, or more than there are: all. No number of them changes a
            bit of the results.
        backend: where particles move: "cpu", "cuda", "vulkan", "metal", or "auto" for a graphics
            card where one is worth it. A process keeps the backend and the threads that it began
            with.
        maps: False for particles alone, "last" for the map of each forecast's last output, True for
            all its maps, as `drift.run` makes them. Maps are made while the next forecasts drift: a
            forecast comes when AHEAD more have drifted.
        report: is called with "forecasts" and the share of the forecasts that is done, 0 to 1.

    Returns:
        An iterator of a `drift.Brief` for each case: `lon`, `lat` [degrees], `status` and
        `probability` of all particles, each of shape (outputs, particles), and `times` (outputs,).
        Of a case that cannot be forecast it has an `error`, a UserError, in place of particles, and
        the others go on.

    Raises:
        UserError: no case can run: `maps` is none of the three, the backend or the number of
            threads cannot be had.
    """
    if maps not in (False, True, "last"):
        raise UserError(f'maps = {maps!r}: give False, "last" or True')
    with runtime.alone():
        runtime.start(backend, threads, max((case.particles for case in cases), default=0))
    return _each(tuple(cases), datasets or {}, maps, report or (lambda phase, share: None))


def _each(
    cases: Sequence[Case], datasets: Mapping[str, Any], maps: Maps, tell: Report
) -> Iterator[Brief]:
    # reversed, to pop: waters are freed with their last case
    shared = divide(cases, datasets)[::-1]
    # forecasts whose maps are being made while the next one drifts
    before: list[Future[Brief]] = []
    with ThreadPoolExecutor(AHEAD, "maps") as pool:
        for number, case in enumerate(cases):
            with runtime.alone():  # one case at a time, and none while the caller runs one
                try:
                    with runtime.telling_full():
                        brief, rest = _forecast(case, _named(case, datasets), shared.pop(), maps)
                except UserError as error:
                    brief, rest = _refused(case, error), None
            before.append(pool.submit(_mapped, brief, rest))
            while len(before) > (AHEAD if maps and number + 1 < len(cases) else 0):
                done = before.pop(0).result()
                tell("forecasts", (number + 1 - len(before)) / len(cases))
                yield done


def _mapped(brief: Brief, rest: Callable[[], Forecast] | None) -> Brief:
    try:
        return brief if rest is None else replace(brief, forecast=rest())
    except UserError as error:
        return _refused(brief.case, error)


def _named(case: Case, datasets: Mapping[str, Any]) -> dict[str, Any]:
    """Return the datasets that a case names."""
    names = {spec.dataset for spec in case.sources}
    return {name: data for name, data in datasets.items() if name in names}


def _refused(case: Case, error: UserError) -> Brief:
    return Brief(case, case.outputs[:0], *(NOTHING,) * 4, np.empty((0, 2)), error=error)


def _forecast(
    case: Case, datasets: Mapping[str, Any], waters: Waters, maps: Maps
) -> tuple[Brief, Callable[[], Forecast] | None]:
    """Return the forecast of one case in its waters, without maps, and what makes these in any
    thread.
    """
    if case.spill:
        raise UserError(
            f"{case.path.name}: has a [spill], which drift.run forecasts; run_many is for [[scenario]] tables"
        )
    where = waters.open_for(case, datasets)
    begin = run_setup.prepare(case, where, waters.shore(where.coast))
    try:
        search, outputs = run_setup.search(case, begin), case.period.seconds(case.outputs)
        moments = simulate.run(begin.ensemble, begin.scene, begin.clock, outputs, search=search)
        with SnapshotStore.of_run(case.period, begin.ensemble, moments, len(outputs)) as snapshots:
            run_setup.check_end(
                case, where, begin, snapshots, search.unsearched if search else None
            )
            seen = list(snapshots)
    finally:
        begin.scene.forcing.close()
    rest = None
    if maps:
        is_land = scene.land_of(begin.scene)
        names = [scenario.name for scenario in case.scenarios]
        wanted = seen if maps is True else seen[-1:]
        rest = forecast_build.begin(
            wanted, scenarios=names, is_land=is_land, shares=case.areas, grid=case.grid
        )
    brief = Brief(
        case,
        np.array([output.time for output in seen]),
        np.stack([output.lon for output in seen]) * (360.0 / sphere.TURN),
        np.stack([output.lat for output in seen]) * (360.0 / sphere.TURN),
        np.stack([output.status for output in seen]).astype(np.uint8),
        np.stack([output.probability for output in seen]),
        np.array([snapshot.means(snapshot.vectors(output)).all for output in seen]),
        begin.clock.step,
    )
    return brief, rest
