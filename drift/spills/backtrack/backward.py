"""Estimate where and when a spill was released, by a run backward in time from its finds.

As a function of the release (x, t), the density p(find | x, t) obeys the backward Kolmogorov
equation. With s the time before the find it reads dp/ds = v . grad p + D lap p. Particles moved by
-v with diffusion D have a density rho with drho/ds = div(v rho) + D lap rho. The two differ by
div(v) p, so p is rho with log weights -integral of div(v) ds along the tracks (Thomson 1987,
doi:10.1017/S0022112087001940; Flesch et al. 1995,
doi:10.1175/1520-0450(1995)034<1320:BTLSDM>2.0.CO;2, for flows without divergence). Errors of
current and wind and jibes are reversible in time, so backward they follow the same laws.

Backward worlds share factors of windage and errors of the current, but no release: the release lies
on a grid. Within a world, finds are independent given the release, so their densities multiply. The
product is then averaged over worlds.

The forward posterior (drift.spills.worlds.finds) is the final answer. This estimate only proposes
where to look, because it neglects:

- the chance that the other objects were missed (1 - u), and with it the evidence of the finds on
  the
reporting rate. If many objects are not found, this draws the release towards the finds: a release
near
them would have given more of them;
- the flux onto a shore. The density at d = tracks.OFFING off the shore replaces it. Off a straight
  shore
their ratio goes as sinh(z) / z, z = x d / (2 D t), where x is the distance at a time t before the
arrival: releases come out too far and too late by d if z is large (hardly any diffusion), and by
next
to nothing if it is below a half;
- the width of the kernels that turn particles into densities (`_smooth`). If particles are not
  spread
normally it shifts the mean, for arrivals at a straight shore by 2 to 3 % of a standard deviation a
find;
- refloating and sliding: a track that meets the coast ends there.

All objects are assumed to go adrift when half of `release_duration` is over. A find that may be
false has, if it is false, the density of one that is equally likely to come from anywhere in the
box of the prior.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt
import xarray as xr

from drift.engine.environment import domain
from drift.engine.environment.environment import Environment
from drift.engine.motion import simulate, step_size
from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.forcing import Forcing
from drift.engine.motion.models import by_name as models
from drift.engine.motion.period import ClockSpec, Period
from drift.engine.motion.scenario import TrackPrior
from drift.engine.motion.scene import Scene
from drift.engine.motion.simulate import Progress
from drift.engine.particles import partials, weights
from drift.engine.particles.ensemble import Ensemble
from drift.engine.particles.status import Status
from drift.forecast import effective
from drift.forecast.effective import Count
from drift.spills.backtrack import tracks
from drift.spills.backtrack.tracks import Beaches, Group
from drift.spills.worlds import worlds as drawn_worlds
from drift.spills.worlds.records import Spill
from drift.spills.worlds.worlds import Worlds
from geo import notation, sphere
from geo.array import Array, Real
from geo.coast import edges as shoreline
from geo.coast.segments import Segments
from geo.errors import UserError
from kernels.maths import noise
from kernels.maths.noise import Purpose
from kernels.step import advance
from kernels.step import coast as device_coast

DRAWS = 2**19  # draws from the prior, to count its share in every cell
TAIL = 1e-4  # share of the prior that lies beyond each side of the grid
SMALLEST = 10.0  # [m] side of a cell
POINT = 1e-4  # [deg] width of the only cell where all releases are at one longitude or latitude
# [cells] narrowest kernel: the sum of a normal curve of this width over cell centres errs by 0.2 %
FINEST = 0.6
CUT = 6.0  # widths beyond which a kernel counts as zero: 2e-9 of its mass lies there
LEAST = 1.0001 * np.exp(-(CUT**2) / 2)  # height of a kernel there, with room for rounding
BATCH = 100  # worlds whose densities are computed at once, to limit memory
SECOND = np.timedelta64(1, "s")
ROUGH = "place and time are rough"
# [bit] less information is reported as none: a normal distribution shifted by half its standard
# deviation gives 0.18
LITTLE = 0.25


@dataclass(frozen=True)
class Origin:
    """Release place and time on a grid: prior and posterior, (time, lat, lon), each with sum 1."""

    # [deg] centres of cells, without a jump at the antimeridian, so they may exceed -180..180
    lon: Real
    lat: Real
    time: npt.NDArray[np.datetime64]  # [s] centres of equal parts of the release window
    prior: Real
    probability: Real
    mean: tuple[float, float, float]  # lon, lat [deg], time [s since 1970]
    std: tuple[float, float, float]  # east, north [m], time [s]
    # standard error of the mean by the delta method over worlds: [m], [m], [s]
    error: tuple[float, float, float]
    worlds: int
    effective: float  # effective number of worlds after the finds


@dataclass(frozen=True)
class _Grid:
    """The cells of place and time, and the prior in them."""

    lon: Real
    lat: Real
    time: npt.NDArray[np.int64]  # [s since 1970]
    prior: Real
    side: float  # [m] side of a cell

    @property
    def centre(self) -> tuple[float, float]:
        """Centre (lon, lat) [deg] of the grid, and of its plane map."""
        return float(self.lon[[0, -1]].mean()), float(self.lat[[0, -1]].mean())

    def plane(self, lon: Array, lat: Array) -> tuple[Array, Array]:
        """Return (x, y) [m] of places [deg] on a plate carree that is true at the centre."""
        lon0, lat0 = self.centre
        east = np.radians(sphere.wrap_degrees(lon - lon0)) * (
            sphere.RADIUS * np.cos(np.radians(lat0))
        )
        return east, np.radians(lat - lat0) * sphere.RADIUS


@dataclass(frozen=True)
class Resolution:
    """Resolution of an origin: worlds x per_find particles go back from each find."""

    worlds: int = 500
    per_find: int = 200
    cells: int = 64  # along the longer side of the grid
    times: int = 24  # parts of the release window


def estimate_origin(
    spill: Spill,
    spec: EnsembleSpec,
    clock_spec: ClockSpec,
    environment: Environment,
    segments: Segments | None,
    stretch: Sequence[int],
    resolution: Resolution = Resolution(),
    progress: Progress | None = None,
) -> Origin:
    """Estimate where and when the objects found were released.

    Args:
        spill: the spill with its finds.
        spec: ensemble of the forward run.
        clock_spec: step and scheme of the run.
        environment: forcing and coast.
        segments: stretches of coast; None if all finds are at sea.
        stretch: segment of each find (drift.spills.worlds.evidence.stretch_of_find), -1 at sea.
        resolution: numbers of worlds, particles, cells and times.
        progress: callback for the progress of the run.

    Returns:
        Prior and posterior of the release.

    Raises:
        UserError: there are no finds, or no release that is allowed leads to them.
    """
    if not spill.finds:
        raise UserError("no finds, so the origin cannot be estimated; add a [[find]]")
    if isinstance(spill.prior, TrackPrior):
        raise UserError(
            "[spill] track: drift origin goes back to one place of release, and this spill has a "
            "ship's track; use drift run: unknowns.csv has the begin and length of each loss"
        )
    rng = noise.generator(spec.seed, Purpose.BACKWARD_PLACES)
    is_land = partial(shoreline.is_land, environment.coast) if environment.coast else _nowhere
    prior_seed = noise.seed_for(spec.seed, Purpose.BACKWARD_PRIOR)
    grid = _prior_grid(spill, prior_seed, is_land, resolution)
    world_seed = noise.seed_for(spec.seed, Purpose.BACKWARD_WORLDS)
    members = len(environment.members)
    # round up, so that all members have the same number of worlds
    count = -(-resolution.worlds // members) * members if members else resolution.worlds
    worlds = drawn_worlds.draw_worlds(spill, world_seed, is_land, count=count, members=members)
    latest = max(find.time for find in spill.finds).astype("datetime64[s]")
    adrift = grid.time + round(spill.release_duration / 2)
    elapsed = notation.epoch(latest) - adrift  # [s] from the last find back to each release
    if elapsed.max() <= 0:
        raise UserError(
            f"all finds are older than any release: the last one is of {latest} UTC; check "
            "[spill] time"
        )
    backward_spec = replace(spec, period=Period(latest, latest - elapsed.max() * SECOND, -1))
    beaches = Beaches(environment.coast, segments, stretch)
    ensemble, groups = tracks.draw_backward_particles(
        backward_spec, spill, worlds, beaches, resolution.per_find, rng
    )
    forcing = Forcing(list(environment.scenarios), -1)
    try:
        shore = device_coast.upload(environment.coast) if environment.coast else None
        bias, box = spill.current_bias > 0, domain.binary(environment.box)
        polar = domain.is_polar(environment.box)
        surroundings = advance.Surroundings(
            box, shore, bias=bias, divergence=True, scheme=clock_spec.scheme, polar=polar
        )
        scene = Scene(forcing, models.motions(spec.errors, spec.scenarios), surroundings)
        clock, _ = step_size.clock_of(
            backward_spec.period, clock_spec, spec.errors, environment.sources, ensemble, scene
        )
        order = np.flatnonzero(elapsed > 0)[::-1]  # a run backward meets the latest release first
        moments = simulate.run(ensemble, scene, clock, elapsed[order], progress)
        slices = _slices(spill, grid, worlds, groups, ensemble, zip(order, moments, strict=True))
        return _posterior(spill, grid, worlds.size, slices)
    finally:
        forcing.close()


def _nowhere(lon: Array, lat: Array) -> Array:
    return np.zeros(np.shape(lon), bool)


def _prior_grid(
    spill: Spill, seed: int, is_land: drawn_worlds.IsLand, resolution: Resolution
) -> _Grid:
    """Return the grid with the prior in it, counted from many draws.

    Place and time are independent unless the prior is a voyage; then all draws count for the place
    at every time.
    """
    draws = drawn_worlds.draw_worlds(spill, seed, is_land, count=DRAWS)
    lon, lat = sphere.to_degrees(draws.lon), sphere.to_degrees(draws.lat)
    lon = sphere.near_degrees(lon, lon[0])
    (west, east), (south, north) = (np.quantile(x, (TAIL, 1 - TAIL)) for x in (lon, lat))
    degree = np.radians(sphere.RADIUS)  # [m] of latitude
    width, height = (
        (east - west) * degree * np.cos(np.radians((south + north) / 2)),
        (north - south) * degree,
    )
    side = max(width / resolution.cells, height / resolution.cells, SMALLEST)
    axes = []
    for low, high, length in ((west, east, width), (south, north, height)):
        n = max(int(np.ceil(length / side - 1e-6)), 1)
        step = (high - low) / length * side if length > 0 else POINT
        axes.append((low + high) / 2 + step * (np.arange(n + 1) - n / 2))
    first, last = notation.epoch(spill.prior.release_start), notation.epoch(spill.prior.release_end)
    one_time = np.array([first - 0.5, first + 0.5])
    time_edges = np.linspace(first, last, resolution.times + 1) if last > first else one_time
    counts = np.histogramdd((draws.release, lat, lon), (time_edges, axes[1], axes[0]))[0]
    if not spill.prior.moving:
        counts = np.broadcast_to(counts.mean(axis=0), counts.shape)
    lon_centre, lat_centre, time_centre = ((x[1:] + x[:-1]) / 2 for x in (*axes, time_edges))
    return _Grid(
        lon_centre, lat_centre, np.rint(time_centre).astype(np.int64), counts / counts.sum(), side
    )


@dataclass(frozen=True)
class _Slice:
    """The contribution of one release time to the posterior.

    probability and sums are to be multiplied by exp(log_scale).
    """

    time: int  # index on the grid
    log_scale: float
    probability: Real  # (ny, nx) prior times the likelihood's mean over worlds
    sums: Real  # (worlds, 3) sums over the map of prior times likelihood, times 1, x and y [m]
    find_mass: Real  # (finds,) sum over the map of prior times likelihood of each find alone


def _slices(
    spill: Spill,
    grid: _Grid,
    worlds: Worlds,
    groups: list[Group],
    ensemble: Ensemble,
    moments: Iterator[tuple[int, simulate.Moment]],
) -> Iterator[_Slice]:
    """Yield prior times likelihood on the grid for each release time."""
    gx, gy = grid.plane(grid.lon, grid.lat)
    for k, moment in moments:
        density = _find_densities(spill, grid, worlds, groups, ensemble, moment)
        prior = grid.prior[k]
        find_mass = np.array([float((prior * _mean(g)).sum()) for g in density])
        with np.errstate(divide="ignore"):
            log_likelihood = sum(
                np.log((1 - find.false) * g.astype(np.float64) + find.false)
                for find, g in zip(spill.finds, density, strict=True)
            )
        log_likelihood = np.where(prior > 0, log_likelihood, -np.inf)
        log_scale = float(log_likelihood.max())
        if np.isfinite(log_scale):
            joint = np.exp(log_likelihood - log_scale) * prior
            sums = np.stack([joint.sum((1, 2)), joint.sum(1) @ gx, joint.sum(2) @ gy], axis=1)
            yield _Slice(k, log_scale, _mean(joint), sums, find_mass)
        else:
            yield _Slice(k, log_scale, np.zeros_like(prior), np.zeros((worlds.size, 3)), find_mass)


def _find_densities(
    spill: Spill,
    grid: _Grid,
    worlds: Worlds,
    groups: list[Group],
    ensemble: Ensemble,
    moment: simulate.Moment,
) -> Array:
    """Return each find's density by world and cell, relative to a uniform one over the box.

    Its shape is (finds, worlds, ny, nx).
    """
    gx, gy = grid.plane(grid.lon, grid.lat)
    # area of a cell in the plane over that on the sphere
    area_ratio = (np.cos(np.radians(grid.centre[1])) / np.cos(np.radians(grid.lat)))[:, None]
    box = grid.side**2 * gx.size * gy.size
    release = ensemble.release.to_numpy()
    density = np.zeros((len(spill.finds), worlds.size, gy.size, gx.size), np.float32)
    log_weight = np.where(moment.status == Status.ADRIFT, ensemble.log_weight.to_numpy(), -np.inf)
    x, y = grid.plane(sphere.to_degrees(moment.lon), sphere.to_degrees(moment.lat))
    for group in groups:
        shape = (worlds.size, group.count)
        slots = slice(group.first, group.first + shape[0] * shape[1])
        age = (moment.elapsed - release[slots]).reshape(shape)
        weight = np.exp(log_weight[slots].astype(np.float64)).reshape(shape) * (
            group.share / group.count
        )
        weight *= tracks.probability_not_sunk(
            spill.kinds[group.kind], worlds.sinking[:, group.kind], age
        )
        for b in range(0, worlds.size, BATCH):
            part = slice(b, b + BATCH)
            density[group.find, part] += box * _smooth(
                x[slots].reshape(shape)[part],
                y[slots].reshape(shape)[part],
                weight[part],
                gx,
                gy,
                grid.side,
                spill.release_std,
            )
    density *= area_ratio
    return density


def _mean(values: Array) -> Array:
    """Return the mean over worlds (W, ...)."""
    return partials.sum_over_worlds(values) / len(values)


def _smooth(
    x: Real, y: Real, weight: Real, gx: Real, gy: Real, side: float, release_std: float
) -> Array:
    """Return kernel densities [1/m2] of particles, convolved with the release scatter.

    Their shape is (worlds, ny, nx). x, y [m], weight: (worlds, n); gx (nx,), gy (ny,) [m]: nodes of
    the grid. The product kernels are normal, n^(-1/4) standard deviations wide for n effective
    particles, at least as wide as the scatter and FINEST cells. To keep variances, particles are
    shrunk towards their mean by what the kernels are wider than the scatter (West 1993).

    Silverman's rule (1986, eq. 4.15), n^(-1/6), suits a map of one world. Here densities are
    multiplied over finds and then averaged over worlds: the noise of the kernels averages out,
    their bias stays, and adds up find by find. So they are narrower; but a kernel still holds about
    n^(1/2) particles, so that noise does not decide between worlds.
    """
    total = weight.sum(axis=1, keepdims=True)
    share = np.divide(weight, total, out=np.zeros_like(weight), where=total > 0)
    effective_number = 1 / np.maximum((share**2).sum(axis=1, keepdims=True), 1e-12)
    kernels = []
    for place, node in ((x, gx), (y, gy)):
        mean = (share * place).sum(axis=1, keepdims=True)
        variance = (share * (place - mean) ** 2).sum(axis=1, keepdims=True)
        width_squared = np.maximum(
            variance * effective_number ** (-1 / 2), max(release_std, FINEST * side) ** 2
        )
        shrinkage = np.sqrt(
            np.clip(1 - (width_squared - release_std**2) / np.maximum(variance, 1e-6), 0, 1)
        )
        width = np.sqrt(width_squared)
        shrunk = ((mean + shrinkage * (place - mean)) / width).astype(np.float32)
        kernel = shrunk[..., None] - (node / width).astype(np.float32)[:, None]
        kernel *= kernel
        np.exp(np.minimum(kernel, CUT**2, out=kernel) * np.float32(-0.5), out=kernel)
        kernel *= kernel > LEAST  # denormal float32 numbers would take a hundred times as long
        kernels.append(kernel / (width * np.sqrt(2 * np.pi)).astype(np.float32)[..., None])
    return np.asarray(
        np.matmul(
            (kernels[1] * weight[..., None].astype(np.float32)).transpose(0, 2, 1), kernels[0]
        )
    )


def _posterior(spill: Spill, grid: _Grid, worlds: int, by_time: Iterator[_Slice]) -> Origin:
    """Return the posterior over all release times."""
    slices = list(by_time)
    find_mass = np.sum([s.find_mass for s in slices], axis=0)
    for find, mass in zip(spill.finds, find_mass, strict=True):
        if mass <= 0 and find.false == 0:
            raise UserError(
                f"{find.name}: no release that [spill] allows leads there ({len(slices)} release "
                "times were tried); check its place and time, widen the release, or make "
                "[domain] larger"
            )
    top = max(s.log_scale for s in slices)
    if not np.isfinite(top):
        raise UserError(
            "the finds exclude each other: each could come from a release that [spill] allows, "
            "but no release leads to all of them; check their times, raise windage_bias or "
            "current_bias, or set `false` to a probability for the odd one"
        )
    probability, sums = np.zeros(grid.prior.shape), np.zeros((worlds, 4))
    time0 = int(grid.time[0])
    for s in slices:
        factor = np.exp(s.log_scale - top)
        probability[s.time] = factor * s.probability
        sums[:, :3] += factor * s.sums
        sums[:, 3] += factor * s.sums[:, 0] * (grid.time[s.time] - time0)
    total = sums[:, 0].sum()
    mean = sums[:, 1:].sum(axis=0) / total
    # each world's contribution to the error of the mean, which is a ratio of sums
    residual = sums[:, 1:] - mean * sums[:, :1]
    error = np.sqrt((residual**2).sum(axis=0) * worlds / max(worlds - 1, 1)) / total
    probability /= probability.sum()
    gx, gy = grid.plane(grid.lon, grid.lat)
    spread = [
        float(np.sqrt(((axis - m) ** 2 * probability.sum(axis=others)).sum()))
        for axis, m, others in zip(
            (gx, gy, grid.time - time0), mean, ((0, 1), (0, 2), (1, 2)), strict=True
        )
    ]
    lon = grid.centre[0] + np.degrees(
        mean[0] / (sphere.RADIUS * np.cos(np.radians(grid.centre[1])))
    )
    return Origin(
        lon=grid.lon,
        lat=grid.lat,
        time=grid.time.astype("datetime64[s]"),
        prior=grid.prior,
        probability=probability,
        mean=(
            float(lon),
            float(grid.centre[1] + np.degrees(mean[1] / sphere.RADIUS)),
            float(time0 + mean[2]),
        ),
        std=(spread[0], spread[1], spread[2]),
        error=(float(error[0]), float(error[1]), float(error[2])),
        worlds=worlds,
        effective=weights.effective(sums[:, 0]),
    )


def count(origin: Origin) -> Count:
    """Return the effective number of worlds."""
    return Count(origin.effective, origin.worlds, "worlds")


def origin_warnings(origin: Origin) -> list[str]:
    """Return warnings that an origin is unreliable or no result of its finds."""
    few_worlds = effective.sentence(
        count(origin), "after the finds", f"{ROUGH}; one find may contradict the rest: check each"
    )
    lines = [few_worlds] if count(origin).few else []
    return lines + ([_nothing_new(origin)] if information_gain(origin) < LITTLE else [])


def information_gain(origin: Origin) -> float:
    """Return the information of the finds on the release [bit].

    It is the Kullback-Leibler divergence of the posterior from the prior (Kullback and Leibler
    1951, doi:10.1214/aoms/1177729694).
    """
    positive = origin.probability > 0
    share, prior = origin.probability[positive], origin.prior[positive]
    return max(float((share * np.log2(share / prior)).sum()), 0.0)


def _nothing_new(origin: Origin) -> str:
    """Return the warning that the finds hardly change the prior."""
    return (
        f"the finds add almost no information about the release ({information_gain(origin):.2f} bit): "
        "its place and time come from [spill], not from the finds; give a wider area, or more finds"
    )


def origin_dataset(origin: Origin) -> xr.Dataset:
    """Return prior and posterior probability by time, lat and lon as an xarray.Dataset."""
    dims = ("time", "lat", "lon")
    return xr.Dataset(
        {
            "probability": (
                dims,
                origin.probability,
                {"long_name": "posterior probability of the release", "units": "1"},
            ),
            "prior": (
                dims,
                origin.prior,
                {"long_name": "prior probability of the release", "units": "1"},
            ),
        },
        {
            "time": (
                "time",
                origin.time.astype("datetime64[ns]"),
                {"standard_name": "time", "long_name": "time of release, UTC", "axis": "T"},
            ),
            "lat": ("lat", origin.lat, _axis("latitude", "Y", "degrees_north")),
            "lon": ("lon", origin.lon, _axis("longitude", "X", "degrees_east")),
        },
        {
            "title": "Release of a spill, proposed by tracks back from its finds",
            "summary": (
                "Probability of the place and time of a spill's release, by cells and times, before "
                "and after its finds."
            ),
            "comment": "rough backtrack; confirm with a forward run",
            "worlds": origin.worlds,
            "effective_worlds": origin.effective,
        },
    )


def _axis(name: str, axis: str, units: str) -> dict[str, str]:
    return {
        "standard_name": name,
        "long_name": f"{name} of the cell's centre",
        "axis": axis,
        "units": units,
    }


def cell_edges(centres: Real) -> Real:
    """Return the edges [deg] of cells of equal width from their centres, (n + 1,).

    A single cell is POINT wide.
    """
    step = centres[1] - centres[0] if centres.size > 1 else POINT
    return np.append(centres - step / 2, centres[-1] + step / 2)


def cell_area(origin: Origin) -> Real:
    """Return the area [m2] of a cell in each row, R^2 dlon (sin lat2 - sin lat1), (nlat,)."""
    width = np.radians(cell_edges(origin.lon)[1] - cell_edges(origin.lon)[0])
    return np.asarray(
        sphere.RADIUS**2 * width * np.diff(np.sin(np.radians(cell_edges(origin.lat))))
    )


def summary_of_origin(origin: Origin) -> dict[str, float | str]:
    """Return the release in figures by column: mean, radii and areas by share, times by quantile.

    Radii are about the mean position; an area is the smallest that holds the share, to one cell.
    """
    place, probability_of_time = origin.probability.sum(axis=0), origin.probability.sum(axis=(1, 2))
    lon, lat = np.meshgrid(origin.lon, origin.lat)
    centre = np.radians(origin.mean[:2])
    distance = sphere.distance(centre[0], centre[1], np.radians(lon), np.radians(lat)).ravel()
    area = np.broadcast_to(cell_area(origin)[:, None], place.shape)
    row: dict[str, float | str] = {
        "lon_deg": float(sphere.wrap_degrees(origin.mean[0])),
        "lat_deg": origin.mean[1],
        "time": _utc(origin.mean[2]),
        "east_std_km": origin.std[0] / 1000,
        "north_std_km": origin.std[1] / 1000,
        "time_std_h": origin.std[2] / 3600,
        "east_error_km": origin.error[0] / 1000,
        "north_error_km": origin.error[1] / 1000,
        "time_error_h": origin.error[2] / 3600,
    }
    nearest = np.argsort(distance, kind="stable")
    densest = np.argsort(-(place / area).ravel(), kind="stable")
    for share in (50, 90):
        k, m = (
            int(np.searchsorted(np.cumsum(place.ravel()[o]), share / 100 - 1e-12))
            for o in (nearest, densest)
        )
        row[f"radius_{share}_km"] = float(distance[nearest[min(k, nearest.size - 1)]]) / 1000
        row[f"area_{share}_km2"] = float(area.ravel()[densest[: m + 1]].sum()) / 1e6
    seconds = notation.epochs(origin.time)
    half = (seconds[1] - seconds[0]) / 2 if seconds.size > 1 else 0.0
    time_edges = np.concatenate([seconds - half, [seconds[-1] + half]])
    cumulative = np.concatenate([[0.0], np.cumsum(probability_of_time)])
    for share in (10, 50, 90):
        row[f"time_{share}"] = _utc(float(np.interp(share / 100, cumulative, time_edges)))
    row["information_bit"] = information_gain(origin)
    row["worlds"], row["effective_worlds"] = float(origin.worlds), origin.effective
    return row


def _utc(seconds: float) -> str:
    return f"{np.datetime64(round(seconds), 's')}Z"
