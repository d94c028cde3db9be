"""The whole flow on one page: case -> environment -> prior -> forecast -> products -> files."""

import contextlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from drift import ensemble as record
from drift import environment, figures, forecast, output, prior, products
from drift.case import Case, ForcingError
from drift.environment import Environment
from drift.forcing import QUANTITIES, Forcing
from drift.forecast import Clock, Moment, Trial, World
from drift.products import Forecast, Snapshot
from drift.scenario import Scenario
from drift.status import Status
from geo import coast as shoreline
from geo import sphere
from geo.errors import UserError
from kernels import advance, deposit, runtime
from kernels import coast as device_coast

Report = Callable[[str, float], None]
PACKAGES = ("casp-drift", "taichi", "numpy", "xarray", "netCDF4", "roaring-landmask")
LEAST_INTERVAL = 300  # [s] a lattice finer than that is not worth a node of forcing
LOST = (Status.OUTSIDE, Status.LEFT)


@dataclass(frozen=True)
class Result:
    """A forecast, the numbers about it, and its subsample's tracks."""

    case: Case
    forecast: Forecast
    trajectories: output.Trajectories
    summary: dict[str, Any]

    @property
    def probability(self) -> Any:
        """Probability that the object is in a cell (time, lat, lon), an xarray.DataArray."""
        return self.forecast.probability


@dataclass
class Stopwatch:
    """Wall time by phase [s]."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextlib.contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Add the time spent inside to a phase."""
        begin = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin


def run(
    case: Case,
    out: Path | None = None,
    *,
    threads: int | None = None,
    backend: str = "cpu",
    overwrite: bool = False,
    report: Report | None = None,
) -> Result:
    """Forecast a case; with `out`, write the results there, complete or not at all.

    report is told what is being done and how much of it is done. Raises UserError for all that the user can mend.
    """
    tell = report or (lambda phase, share: None)
    if out is not None:
        output.check_folder(out, overwrite)
    clock = Stopwatch()
    with clock.phase("start"):
        runtime.start(backend, threads)
    tell("read", 0.0)
    with clock.phase("read"):
        where = environment.open_for(case)
        shore = device_coast.upload(where.coast) if where.coast else None
    with clock.phase("prior"):
        drawn = prior.draw(case, shore)
    ensemble = drawn.ensemble
    forcing = Forcing(list(where.scenarios), case.direction)
    try:
        world = World(forcing, tuple(_physics(case, s) for s in case.scenarios), shore, _domain(where), case.scheme)
        with clock.phase("step"):
            ticks, trial = _clock(case, where, ensemble, world)
            _check_place(case, where, ensemble, world, ticks)
        outputs = np.array([prior.elapsed(case, t) for t in case.outputs])
        with clock.phase("drift"):
            moments = list(forecast.run(ensemble, world, ticks, outputs, partial(tell, "drift")))
    finally:
        forcing.close()
    account = record.account(ensemble, moments[-1].status)
    _check_lost(case, where, account.by_status.sum(axis=0))
    tell("map", 0.0)
    with clock.phase("products"):
        snapshots = _snapshots(case, ensemble, moments)
        is_land = partial(shoreline.is_land, where.coast) if where.coast else None
        made = products.build(
            snapshots, scenarios=[s.name for s in case.scenarios], is_land=is_land, deposit=deposit.deposit
        )
        tracks = _trajectories(case, snapshots)
    summary = _summary(case, where, account, drawn, ticks, trial, clock)
    if out is not None:
        tell("write", 0.0)
        with clock.phase("write"):
            attributes = _attributes(case, where)
            footer = f"{attributes['source']}, seed {case.seed}, coast {attributes['coast']}"
            pictures = figures.figures(case, where, made, footer)
            output.write(out, made, tracks, summary, pictures, attributes=attributes, overwrite=overwrite)
    return Result(case, made, tracks, summary)


def check(case: Case) -> dict[str, Any]:
    """Return how a case's forcing and coast were understood, having opened them all; run nothing."""
    where = environment.open_for(case)
    box = where.box
    found: dict[str, Any] = {
        "run": f"{case.start} to {case.end} UTC, {case.particles:,} particles",
        "domain": f"{box.west:.2f} to {box.east:.2f} E, {box.south:.2f} to {box.north:.2f} N",
        "coast": where.coast.source if where.coast else "none in the domain",
    }
    for source in where.sources:
        found[f"{source.quantity} {source.name}"] = "; ".join(source.notes) or "as is"
    return found


def _physics(case: Case, scenario: Scenario) -> advance.Physics:
    """Return a scenario's physics; an error without spread is off."""
    wind = case.wind_error if scenario.object.uses_wind else ForcingError(0.0, 1.0)
    return advance.Physics(
        case.current_error.std, case.current_error.time, wind.std, wind.time, case.diffusivity, scenario.jibe_rate
    )


def _domain(where: Environment) -> advance.Domain:
    box = where.box
    west, south = (int(sphere.to_binary(x)) for x in (box.west, box.south))
    width = min(round((box.east - box.west) * sphere.TURN / 360), sphere.TURN - 1)
    return advance.Domain(west, south, width, round((box.north - box.south) * sphere.TURN / 360))


def _clock(case: Case, where: Environment, ensemble: record.Ensemble, world: World) -> tuple[Clock, Trial | None]:
    """Return the clock: the case's step, or the largest whose error is small; on the lattice of the forcing's times."""
    divisor, origin = _lattice([s.times.astype("datetime64[s]").astype(np.int64) for s in where.sources])
    start = int(case.start.astype("datetime64[s]").astype(np.int64))
    duration = abs(int((case.end - case.start) / np.timedelta64(1, "s")))
    errors = [e.time for e in (case.current_error, case.wind_error) if e.std > 0]
    longest = min(errors) / 6 if errors else np.inf
    if case.step is not None and case.step > longest:
        raise UserError(
            f"clock.step: {case.step} s is longer than a sixth of the errors' decorrelation time ({longest:.0f} s), and the "
            'spread would depend on it; give at most that, or "auto"'
        )
    if case.step is not None:
        return Clock(start, duration, case.direction, case.step, origin % case.step), None
    ladder_clock = Clock(start, duration, case.direction, 1, 0)
    trial = forecast.choose_step(ensemble, world, ladder_clock, divisor, origin, longest, case.tolerance)
    return Clock(start, duration, case.direction, trial.step, origin % trial.step), trial


def _lattice(times: list[npt.NDArray[np.int64]]) -> tuple[int, int]:
    """Return the interval [s] that steps should divide, and a point of the lattice [s since 1970].

    That is the common divisor of all sources' times; times that share none of use are left to interpolation.
    """
    several = [t for t in times if t.size > 1]
    for chosen in (several, [t for t in several if _common(t, int(t[0])) >= LEAST_INTERVAL]):
        if chosen:
            origin = int(chosen[0][0])
            divisor = _common(np.concatenate(chosen), origin)
            if divisor >= LEAST_INTERVAL:
                return divisor, origin
    return 3600, int(several[0][0]) // 3600 * 3600 if several else 0


def _common(times: npt.NDArray[np.int64], origin: int) -> int:
    return int(np.gcd.reduce(np.abs(times - origin)))


def _check_place(case: Case, where: Environment, ensemble: record.Ensemble, world: World, clock: Clock) -> None:
    """Refuse a prior of which more than may be lost lies where there is no forcing."""
    low, high, _ = next(clock.steps())
    world.forcing.set(low, high)
    lon, lat = ensemble.lon.to_numpy(), ensemble.lat.to_numpy()
    # What is released later may find a source that has nothing yet: the run itself judges it.
    probability = np.where(ensemble.release.to_numpy() <= clock.step, record.probability(ensemble), 0.0)
    missing = dict.fromkeys(QUANTITIES, 0.0)
    for (first, last), ranges in zip(ensemble.scenarios, world.forcing.ranges, strict=True):
        for k, quantity in enumerate(missing):
            tiles = ranges[2 * k : 2 * k + 2]
            if tiles[1] > tiles[0]:
                valid = world.forcing.tiles.at(*tiles, lon[first:last], lat[first:last], 0.0)[:, 2]
                missing[quantity] += float(probability[first:last][valid < 0.5].sum())
    for quantity, share in missing.items():
        if share > case.max_lost:
            boxes = [s.grid.box for s in where.sources if s.quantity == quantity]
            extents = ", ".join(f"{b.west:.2f}..{b.east:.2f} E {b.south:.2f}..{b.north:.2f} N" for b in boxes)
            raise UserError(
                f"[[{quantity}]]: {share:.0%} of the prior lies where there is no {quantity} ({extents} of the domain "
                f"is covered, land excluded); at most {case.max_lost:.0%} may be lost (max_lost). Add a source, or move "
                "the scenario"
            )


def _check_lost(case: Case, where: Environment, by_status: npt.NDArray[np.float64]) -> None:
    """Refuse a run that lost more than the case allows."""
    lost = {status: float(by_status[status]) for status in LOST}
    if sum(lost.values()) <= case.max_lost:
        return
    box = where.box
    raise UserError(
        f"{sum(lost.values()):.0%} of the probability was lost by the end: {lost[Status.OUTSIDE]:.0%} ran out of "
        f"forcing, {lost[Status.LEFT]:.0%} left the domain ({box.west:.2f}..{box.east:.2f} E, {box.south:.2f}.."
        f"{box.north:.2f} N); at most {case.max_lost:.0%} may be (max_lost). Shorten the run, add a source, or widen "
        "[domain]"
    )


def _snapshots(case: Case, ensemble: record.Ensemble, moments: list[Moment]) -> list[Snapshot]:
    probability = record.probability(ensemble)
    scenario = np.repeat(np.arange(len(case.scenarios), dtype=np.int32), np.diff(ensemble.bounds))
    return [
        Snapshot(
            case.start + np.timedelta64(case.direction * m.elapsed, "s"), m.lon, m.lat, probability, m.status, scenario
        )
        for m in moments
    ]


def _trajectories(case: Case, snapshots: list[Snapshot]) -> output.Trajectories:
    """Return the tracks of slots spread evenly over the ensemble."""
    n = snapshots[0].lon.size
    slot = (
        np.unique(np.linspace(0, n - 1, min(case.trajectories, n)).astype(int))
        if case.trajectories
        else np.array([], int)
    )
    stack = {name: np.stack([getattr(s, name)[slot] for s in snapshots], axis=1) for name in ("lon", "lat", "status")}
    weight = np.repeat(snapshots[0].probability[slot][:, None], len(snapshots), axis=1)
    times = np.array([s.time for s in snapshots])
    return output.Trajectories(
        times, slot, snapshots[0].scenario[slot], stack["lon"], stack["lat"], stack["status"], weight
    )


def _attributes(case: Case, where: Environment) -> dict[str, str]:
    """Return what every file carries: the case, the seed, versions, and what the forcing was."""
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in PACKAGES)
    return {
        "title": case.title,
        "source": versions.split(",")[0],
        "versions": versions,
        "seed": str(case.seed),
        "backend": runtime.backend(),
        "forcing": "; ".join(f"{s.quantity} {s.name}: {s.fingerprint}" for s in where.sources),
        "coast": where.coast.source if where.coast else "none",
        "case": case.text,
    }


def _summary(
    case: Case,
    where: Environment,
    account: record.Account,
    drawn: prior.Prior,
    clock: Clock,
    trial: Trial | None,
    watch: Stopwatch,
) -> dict[str, Any]:
    """Return the numbers of a run that are not in its forecast."""
    by_status = account.by_status.sum(axis=0)
    return {
        "run": {
            "start": str(case.start),
            "end": str(case.end),
            "particles": case.particles,
            "seed": case.seed,
            "step_s": clock.step,
            "step_errors_m_per_day": {str(k): v for k, v in trial.errors.items()} if trial else None,
            "scheme": case.scheme,
            "coast_behaviour": case.coast.behaviour,
            "backend": runtime.backend(),
        },
        "effective_sample_size": account.ess,
        "account": {status.name.lower(): float(by_status[status]) for status in Status},
        "scenario_weights": {
            s.name: {"prior": s.weight, "posterior": float(w), "prior_on_land": dry}
            for s, w, dry in zip(case.scenarios, account.by_status.sum(axis=1), drawn.dry, strict=True)
        },
        "forcing": [
            {
                "quantity": s.quantity,
                "name": s.name,
                "missing_share": s.missing,
                "understood": list(s.notes),
                "fingerprint": s.fingerprint,
            }
            for s in where.sources
        ],
        "coast": {"source": where.coast.source if where.coast else "none", "notes": list(where.notes)},
        "wall_time_s": watch.seconds,
    }
