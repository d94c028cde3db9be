"""Transmission loss of made-up water for shipped cases: a parabolic equation, from Munk's profile
to packed netCDF files.

`python docs/generate/losses.py` writes the files of `cases/losses/` again. Nothing in them was
measured: the water is Munk's canonical profile, whose axis and strength follow a smooth law of
place, over a flat bottom without land.

The field is marched in range by the split-step Fourier algorithm (Tappert 1977, in Wave Propagation
and Underwater Acoustics, Lecture Notes in Physics 70, doi:10.1007/3-540-08527-0_5), with the
wide-angle splitting of Thomson and Chapman (1983), J. Acoust. Soc. Am. 74, 1848,
doi:10.1121/1.390272. The starting field is that of a point source in wave numbers, so that water of
one speed is exact. Intensities are averaged over a third of an octave and a window of range: what
is left is direct sound, convergence zones and what the bottom sends back, without interference by
the metre. Left out are density (of the bottom), rough seas, currents and the curvature of the
Earth.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Waves = NDArray[np.complex128]
Water = Callable[
    [Array, Array], tuple[Array, Array]
]  # of latitude and longitude [deg]: depth of the axis [m], strength

NMI = 1852.0  # [m]
RADIUS = 6371e3  # [m] of the Earth
REFERENCE = 1500.0  # [m/s] sound speed in which the phase is counted
# [m/s] this and the next two: Munk 1974, J. Acoust. Soc. Am. 55, 220, doi:10.1121/1.1914492
AXIS_SPEED = 1492.0
SCALE = 1300.0  # [m]
PERTURBATION = 0.00737
SEDIMENT = 1.01  # speed in the bottom over that of the water at the bottom
SEDIMENT_LOSS = 0.5  # [dB] a wavelength in the bottom
# of frequencies over which intensities are averaged, in octaves
OCTAVE = np.linspace(-1 / 6, 1 / 6, 5)
STEEPEST = math.radians(75)  # of the source's sound; steeper than 60 degrees it fades
WORST = 150.0  # [dB] beyond which no loss is told apart
REFRESH = 5000.0  # [m] after which the water along a radial is taken again


@dataclass(frozen=True)
class Grid:
    """Depths of the field, and its step in range."""

    points: int = 1024
    # [m]; inf: none, and the lower end of the grid reflects as the surface does
    bottom: float = 5200.0
    deepest: float = 7680.0  # [m] lower end of the grid
    step: float = 100.0  # [m] in range

    @property
    def depth(self) -> Array:
        """Depth of each point [m] (points,), without the surface and the lower end, where the
        pressure is none.
        """
        return np.arange(1, self.points) * (self.deepest / self.points)


@dataclass(frozen=True)
class Survey:
    """What a file holds: where, how far, and of which water."""

    title: str
    water: Water
    law: str  # of the water, in words
    places: tuple[tuple[float, float], ...]  # (lat, lon) [deg]
    bearings: int
    farthest: float  # [nmi]
    spacing: float  # [nmi] between ranges
    smooth: float  # [nmi] standard deviation of the window of range
    depths: tuple[float, ...]  # [m] of the sensor; by reciprocity it is here that the field begins
    target: float = 100.0  # [m] depth
    frequency: float = 50.0  # [Hz]


def munk(depth: Array, axis: Array, strength: Array) -> Array:
    """Return Munk's sound speed [m/s] at depths [m], from the depth of the axis [m] and a strength
    (canonical: 1300, 1).
    """
    eta = 2 * (depth - axis) / SCALE
    return np.asarray(AXIS_SPEED * (1 + strength * PERTURBATION * (eta + np.exp(-eta) - 1)))


def sargasso(lat: Array, lon: Array) -> tuple[Array, Array]:
    """Return axis [m] and strength: deep and strong south of a front at 36.8 N, shallower and
    weaker north of it.
    """
    north = (1 + np.tanh((lat - 36.8) / 0.3)) / 2 + 0 * lon
    return 1050 - 350 * north, 1 - 0.15 * north


def north_pacific(lat: Array, lon: Array) -> tuple[Array, Array]:
    """Return axis [m] and strength about a subarctic front from 38 N at 145 E to 44 N at 125 W, 5
    degrees wide.
    """
    front = 38 + 6 * (lon % 360 - 145) / 90
    north = (1 + np.tanh((lat - front) / 5)) / 2
    return 1000 - 850 * north, 1 - 0.3 * north


SURVEYS = {
    "sargasso.nc": Survey(
        "Transmission loss of made-up water about 36N 070W",
        sargasso,
        "axis at 1050 m, strength 1 south, 700 m, 0.85 north of 36.8 N, by tanh over 0.3 degrees of latitude",
        ((36.0, -70.0), (36.0, -68.558333)),
        bearings=24,
        farthest=100.0,
        spacing=0.25,
        smooth=0.4,
        depths=(100.0,),
    ),
    "north_pacific.nc": Survey(
        "Transmission loss of made-up water in the North Pacific",
        north_pacific,
        "axis at 1000 m, strength 1 south, 150 m, 0.7 north of a line from 38N 145E to 44N 125W, by tanh over 5 degrees "
        "of latitude",
        (
            (46.0, 160.0),
            (32.0, 155.0),
            (50.0, -178.0),
            (40.0, 178.0),
            (30.0, -172.0),
            (48.0, -150.0),
            (36.0, -150.0),
            (44.0, -133.0),
            (31.0, -133.0),
        ),
        bearings=12,
        farthest=300.0,
        spacing=1.0,
        smooth=0.8,
        depths=(200.0, 900.0),
    ),
}


def source(grid: Grid, depth: float, frequency: float, steepest: float = STEEPEST) -> Waves:
    """Return the sine transform of a point source's field, reduced by exp(ikr) / sqrt(r), (points -
    1,).

    It is the sum over modes of sin(kz depth) H0(kr r) with H0 far off, and 1 m from the source its
    pressure is 1.
    """
    k = 2 * math.pi * frequency / REFERENCE
    kz = np.pi * np.arange(1, grid.points) / grid.deepest
    sine = np.minimum(kz / k, 1.0)
    along = k * np.sqrt(1 - sine**2)
    angle = np.arcsin(sine)
    gentle = steepest - math.radians(15)
    fade = np.where(
        angle < gentle,
        1.0,
        np.cos(np.clip((angle - gentle) / math.radians(15), 0, 1) * np.pi / 2) ** 2,
    )
    amplitude = np.where(kz < k, fade / np.sqrt(np.maximum(along, 1e-9 * k)), 0.0)
    turn = 1j * np.exp(-0.25j * np.pi) * math.sqrt(2 / math.pi) * 2 * np.pi / grid.deepest
    return np.asarray(turn * amplitude * np.sin(kz * depth))


def slowness(grid: Grid, speed: Array) -> Waves:
    """Return the index of refraction less 1 (..., points - 1), the bottom's and its losses
    included.

    speed: of the water at the grid's depths [m/s]. A sponge over the lowest part of the grid lets
    nothing come back.
    """
    if math.isinf(grid.bottom):
        return REFERENCE / speed - 1 + 0j
    depth = grid.depth
    below = (1 + np.tanh((depth - grid.bottom) / 15)) / 2
    floor = SEDIMENT * speed[..., [np.searchsorted(depth, grid.bottom)]]
    speed = speed * (1 - below) + floor * below
    sponge = np.exp(-(((grid.deepest - depth) / ((grid.deepest - grid.bottom) / 4)) ** 2))
    lost = SEDIMENT_LOSS / (40 * np.pi * math.log10(math.e)) * below + 0.05 * sponge
    return np.asarray(REFERENCE / speed * (1 + 1j * lost) - 1)


def sines(field: Waves) -> Waves:
    """Return the sine transform of a field (..., n): twice over it is 2 (n + 1) times the field."""
    n = field.shape[-1]
    odd = np.zeros((*field.shape[:-1], 2 * (n + 1)), complex)
    odd[..., 1 : n + 1] = field
    odd[..., n + 2 :] = -field[..., ::-1]
    return np.asarray(1j * np.fft.fft(odd)[..., 1 : n + 1])


def march(
    grid: Grid,
    start: Waves,
    index: Callable[[float], Waves],
    frequency: float,
    steps: int,
    depth: float,
) -> Array:
    """Return the intensity at a depth [m] after each step, relative to 1 m from the source,
    (radials, steps).

    start: sine transform of the field, (radials, points - 1). index: of a range [m], the index of
    refraction less 1.
    """
    k = 2 * math.pi * frequency / REFERENCE
    kz = np.pi * np.arange(1, grid.points) / grid.deepest
    free = np.exp(1j * grid.step * (np.sqrt(k**2 - kz**2 + 0j) - k)) / (2 * grid.points)
    at = depth / grid.deepest * grid.points - 1
    near, share = int(at), at - int(at)
    intensity = np.empty((len(start), steps))
    field = sines(start) / 2  # a sum over sines, once
    half = np.exp(0.5j * k * grid.step * index(0.0))
    for n in range(steps):
        reached = n * grid.step
        if n and reached % REFRESH < grid.step:
            half = np.exp(0.5j * k * grid.step * index(reached))
        field = half * sines(free * sines(half * field))
        here = (1 - share) * field[:, near] + share * field[:, near + 1]
        intensity[:, n] = np.abs(here) ** 2 / (reached + grid.step)
    return intensity


def along(lat: float, lon: float, bearing: Array, distance: float) -> tuple[Array, Array]:
    """Return the positions [deg] at bearings [rad] and a distance [m] from a place [deg], on the
    sphere.
    """
    phi, angle = math.radians(lat), distance / RADIUS
    sine = math.sin(phi) * math.cos(angle) + math.cos(phi) * math.sin(angle) * np.cos(bearing)
    east = np.sin(bearing) * math.sin(angle) * math.cos(phi)
    return np.degrees(np.arcsin(sine)), lon + np.degrees(
        np.arctan2(east, math.cos(angle) - math.sin(phi) * sine)
    )


def absorption(frequency: float) -> float:
    """Return the absorption of sea water [dB/m], Thorp 1967, J. Acoust. Soc.

    Am. 42, 270, doi:10.1121/1.1910566.
    """
    f2 = (frequency / 1000) ** 2
    return (0.1 * f2 / (1 + f2) + 40 * f2 / (4100 + f2) + 0.003) / 914.4


def smoothed(values: Array, spread: float) -> Array:
    """Return values (..., n) under a Gaussian window of a standard deviation in points; outside
    they are those at the ends.
    """
    reach = math.ceil(4 * spread)
    window = np.exp(-0.5 * (np.arange(-reach, reach + 1) / spread) ** 2)
    padded = np.concatenate(
        [values[..., :1]] * reach + [values] + [values[..., -1:]] * reach, axis=-1
    )
    return np.apply_along_axis(np.convolve, -1, padded, window / window.sum(), "valid")


def radials(
    survey: Survey, place: tuple[float, float], depth: float, grid: Grid
) -> tuple[Array, Array]:
    """Return ranges [m] (r,) and losses [dB] (bearings, r) round a place, from a sensor's depth
    [m].
    """
    bearing = 2 * np.pi * np.arange(survey.bearings) / survey.bearings

    def index(distance: float) -> Waves:
        axis, strength = survey.water(*along(*place, bearing, distance))
        return slowness(grid, munk(grid.depth, axis[:, None], strength[:, None]))

    steps = math.ceil((survey.farthest + 5 * survey.smooth) * NMI / grid.step)
    band = survey.frequency * 2.0**OCTAVE
    intensity = np.zeros((survey.bearings, steps))
    for frequency in band:
        start = np.broadcast_to(source(grid, depth, frequency), (survey.bearings, grid.points - 1))
        intensity += march(grid, start, index, frequency, steps, survey.target) / len(band)
    reached = np.arange(1, steps + 1) * grid.step
    # Spreading is taken out before the window and put back after it: a mean over the window would
    # raise what is near.
    level = 10 * np.log10(
        np.maximum(smoothed(intensity * reached, survey.smooth * NMI / grid.step), 1e-30)
    )
    ranges = np.arange(1, round(survey.farthest / survey.spacing) + 1) * survey.spacing * NMI
    lost = np.array([np.interp(ranges, reached, row) for row in -level])
    return ranges, np.clip(
        lost + 10 * np.log10(ranges) + absorption(survey.frequency) * ranges, 0, WORST
    )


def write(path: Path, survey: Survey, ranges: Array, loss: Array) -> None:
    """Write losses (depths, places, bearings, ranges) as hundredths of a decibel."""
    import netCDF4

    with netCDF4.Dataset(path, "w") as data:
        data.setncatts(
            {
                "Conventions": "CF-1.8",
                "title": survey.title,
                "source": f"Computed for made-up water, NOT measured and not for use at sea: wide-angle split-step Fourier "
                f"parabolic equation, Munk's profile ({survey.law}), flat bottom at {Grid().bottom:g} m, no land",
                "history": "made by docs/generate/losses.py of casp-drift from made-up water",
                "references": "Tappert 1977, doi:10.1007/3-540-08527-0_5; Thomson and Chapman 1983, doi:10.1121/1.390272; "
                "Munk 1974, doi:10.1121/1.1914492",
                "comment": f"Intensities averaged over a third of an octave about {survey.frequency:g} Hz and over a window of "
                f"range of {survey.smooth:g} nmi (one standard deviation).",
            }
        )
        for name, size in zip(("depth", "place", "bearing", "range"), loss.shape, strict=True):
            data.createDimension(name, size)
        lat, lon = np.array(survey.places).T
        coordinates = {
            "depth": (
                ("depth",),
                survey.depths,
                "m",
                "depth of the sensor",
                {"positive": "down", "axis": "Z"},
            ),
            "lat": (
                ("place",),
                lat,
                "degrees_north",
                "latitude of the sensor",
                {"standard_name": "latitude"},
            ),
            "lon": (
                ("place",),
                lon,
                "degrees_east",
                "longitude of the sensor",
                {"standard_name": "longitude"},
            ),
            "bearing": (
                ("bearing",),
                360 * np.arange(survey.bearings) / survey.bearings,
                "degree",
                "true bearing from the sensor, clockwise from north",
                {},
            ),
            "range": (("range",), ranges, "m", "range from the sensor", {}),
            "target_depth": ((), survey.target, "m", "depth of the target", {"positive": "down"}),
            "frequency": ((), survey.frequency, "Hz", "middle of the band", {}),
        }
        for name, (dims, values, unit, words, more) in coordinates.items():
            variable = data.createVariable(name, "f8", dims)
            variable.setncatts({"units": unit, "long_name": words, **more})
            variable[...] = values
        packed = data.createVariable(
            "loss",
            "i2",
            ("depth", "place", "bearing", "range"),
            zlib=True,
            complevel=9,
            shuffle=True,
            fill_value=-32768,
        )
        packed.setncatts(
            {
                "units": "dB",
                "long_name": "transmission loss re 1 m, of made-up water",
                "coordinates": "lat lon target_depth frequency",
                "scale_factor": 0.01,
                "add_offset": 0.0,
            }
        )
        packed[...] = loss


def main() -> None:
    """Write every file of `cases/losses/`."""
    folder = Path(__file__).parents[2] / "cases" / "losses"
    folder.mkdir(exist_ok=True)
    for name, survey in SURVEYS.items():
        rows = [
            [radials(survey, place, depth, Grid()) for place in survey.places]
            for depth in survey.depths
        ]
        write(
            folder / name,
            survey,
            rows[0][0][0],
            np.array([[loss for _, loss in row] for row in rows]),
        )


if __name__ == "__main__":
    main()
