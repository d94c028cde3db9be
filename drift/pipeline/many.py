"""Many forecasts in one process, one after another.

The cases may differ in everything. Files are opened, surveyed and decoded once, the coast is built
once. Each forecast equals that of `drift.run` for its case to the bit, whatever the other cases and
their order. The generator yields one forecast at a time, so ten thousand need no more memory than
one (with maps: three). A rejected case yields its error, and the next case follows.
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
from drift.pipeline.run_options import ProgressCallback
from drift.pipeline.shared_forcing import SharedRegion, share_regions
from geo import sphere
from geo.array import Array
from geo.errors import UserError
from kernels.runtime import runtime

Maps = bool | Literal["last"]

AHEAD = 2  # forecasts simulated at most before the maps of the first are complete
NOTHING = np.empty((0, 0))


@dataclass(frozen=True, repr=False)
class Brief:
    """A short forecast: its particles at each output, and its maps if requested.

    Arrays have the shape (outputs, particles). For a rejected case the arrays are empty, and
    `error` holds the reason.
    """

    case: Case
    times: npt.NDArray[np.datetime64]  # of the outputs, UTC, shape (outputs,)
    lon: Array  # [deg] -180 to 180
    lat: Array
    status: Array  # uint8, drift.engine.particles.status.Status: 0 is adrift, 1 ashore
    probability: Array  # adds up to 1 over the particles, of all statuses
    # (outputs, 2) lon, lat [deg] of the mean position, adrift or ashore; NaN without particles
    mean: Array
    step: int = 0  # [s]
    forecast: Forecast | None = None  # maps: of all outputs, or of the last
    error: UserError | None = None

    def __repr__(self) -> str:
        """Return the title and size of the forecast, or the reason of its rejection."""
        description = (
            f"rejected: {self.error}"
            if self.error
            else f"{len(self.times)} outputs, {self.lon.shape[-1]:,} particles"
        )
        return f'<drift.Brief "{self.case.title}": {description}>'


def run_many(
    cases: Sequence[Case],
    *,
    datasets: Mapping[str, Any] | None = None,
    threads: int | None = None,
    backend: str = "cpu",
    maps: Maps = False,
    report: ProgressCallback | None = None,
) -> Iterator[Brief]:
    """Yield the forecasts of cases in their order, each as soon as it is made.

    Each forecast equals that of `drift.run` for its case to the bit. Files and coast are opened
    once, kernels are compiled once. The generator keeps no forecast that it has yielded.

    Args:
        cases: made by `drift.load` or `drift.vary`; they need have nothing in common. A spill has
            no short forecast: it yields an error.
        datasets: xarray.Datasets by name, for sources of any case with `dataset = "name"`; drift
            reads them and keeps no reference.
        threads: CPU threads; None, or more than there are: all. The results are the same to the bit
            for any number.
        backend: device that moves particles: "cpu", "cuda", "vulkan", "metal", or "auto": a
            graphics card if the run is large enough. A process keeps the backend and the threads of
            its first run.
        maps: False for particles alone, "last" for the map of each forecast's last output, True for
            all maps of `drift.run`. Maps are made while the next forecasts are simulated: a
            forecast
            is yielded after up to AHEAD more have been simulated.
        report: called with "forecasts" and the share of the forecasts done, 0 to 1.

    Returns:
        An iterator over one `drift.Brief` per case: `lon`, `lat` [degrees], `status` and
        `probability` of all particles, each of shape (outputs, particles), and `times` (outputs,).
        For a rejected case, `error` is a UserError and the arrays are empty; the other cases
        continue.

    Raises:
        UserError: no case can run: `maps` has another value, or the backend or number of threads is
            not available.
    """
    if maps not in (False, True, "last"):
        raise UserError(f'maps = {maps!r}: give False, "last" or True')
    with runtime.alone():
        runtime.start(backend, threads, max((case.particles for case in cases), default=0))
    return _yield_forecasts(
        tuple(cases), datasets or {}, maps, report or (lambda phase, share: None)
    )


def _yield_forecasts(
    cases: Sequence[Case], datasets: Mapping[str, Any], maps: Maps, tell: ProgressCallback
) -> Iterator[Brief]:
    # reversed for pop(): a region is freed after its last case
    shared = share_regions(cases, datasets)[::-1]
    # forecasts whose maps are being made while the next one drifts
    before: list[Future[Brief]] = []
    with ThreadPoolExecutor(AHEAD, "maps") as pool:
        for number, case in enumerate(cases):
            with runtime.alone():  # one case at a time, and none while the caller runs another
                try:
                    with runtime.telling_full():
                        brief, make_maps = _forecast(
                            case, _datasets_of(case, datasets), shared.pop(), maps
                        )
                except UserError as error:
                    brief, make_maps = _rejected(case, error), None
            before.append(pool.submit(_with_maps, brief, make_maps))
            while len(before) > (AHEAD if maps and number + 1 < len(cases) else 0):
                done = before.pop(0).result()
                tell("forecasts", (number + 1 - len(before)) / len(cases))
                yield done


def _with_maps(brief: Brief, make_maps: Callable[[], Forecast] | None) -> Brief:
    try:
        return brief if make_maps is None else replace(brief, forecast=make_maps())
    except UserError as error:
        return _rejected(brief.case, error)


def _datasets_of(case: Case, datasets: Mapping[str, Any]) -> dict[str, Any]:
    """Return the datasets that the sources of a case name."""
    names = {spec.dataset for spec in case.sources}
    return {name: data for name, data in datasets.items() if name in names}


def _rejected(case: Case, error: UserError) -> Brief:
    return Brief(case, case.outputs[:0], *(NOTHING,) * 4, np.empty((0, 2)), error=error)


def _forecast(
    case: Case, datasets: Mapping[str, Any], waters: SharedRegion, maps: Maps
) -> tuple[Brief, Callable[[], Forecast] | None]:
    """Return the forecast of one case without maps, and a function that makes its maps."""
    if case.spill:
        raise UserError(
            f"{case.path.name}: has a [spill], which drift.run forecasts; run_many is for [[scenario]] tables"
        )
    where = waters.open_for(case, datasets)
    begin = run_setup.prepare(case, where, waters.shore(where.coast))
    try:
        search, outputs = (
            run_setup.build_search_filter(case, begin),
            case.period.seconds(case.outputs),
        )
        moments = simulate.run(begin.ensemble, begin.scene, begin.clock, outputs, search=search)
        with SnapshotStore.of_run(case.period, begin.ensemble, moments, len(outputs)) as snapshots:
            run_setup.check_end(
                case, where, begin, snapshots, search.unsearched if search else None
            )
            seen = list(snapshots)
    finally:
        begin.scene.forcing.close()
    make_maps = None
    if maps:
        is_land = scene.land_of(begin.scene)
        names = [scenario.name for scenario in case.scenarios]
        wanted = seen if maps is True else seen[-1:]
        make_maps = forecast_build.begin(
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
    return brief, make_maps
