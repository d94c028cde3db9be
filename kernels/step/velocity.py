"""Drift velocity of an object at a point: current, Stokes drift, leeway, and their errors."""

import taichi as ti

from kernels.runtime import bundle
from kernels.step.features import CURRENT, LAYERS, MEMBERS, STOKES, WIND
from kernels.step.sample import of_tile, position, sample

# Indices in `Sea.ranges` of the first and the last tile of each.
CURRENT_FROM, WIND_FROM, STOKES_FROM = (
    position(quantity) for quantity in ("current", "wind", "stokes")
)
CURRENT_TO = CURRENT_FROM + 1

f32x3 = ti.types.vector(3, ti.f32)
f32x4 = ti.types.vector(4, ti.f32)


@ti.dataclass
class Drifter:
    """The properties of a particle that determine its drift during one step."""

    line: f32x4  # leeway: slope and offset [m/s] downwind, then to the right of downwind
    error: f32x4  # [m/s] errors of current and wind, east and north
    member: ti.i32  # member of the forcing ensemble; 0 without one
    row: ti.i32  # where `Sea.scale` holds the weights of this step
    asks: ti.f32  # 0: the result will not be used


@ti.func
def leeway(line: f32x4, wind_east: ti.f32, wind_north: ti.f32) -> ti.types.vector(2, ti.f32):
    """Return the leeway (east, north) [m/s] of an object in a wind [m/s].

    line: slope and offset [m/s] downwind and to the right of downwind (Allen and Plourde 1999;
    Breivik and Allen 2008, doi:10.1016/j.jmarsys.2007.02.010, eq. 1-2).
    """
    slowness = 1.0 / (ti.sqrt(wind_east * wind_east + wind_north * wind_north) + 1e-9)
    along = line[0] + line[1] * slowness  # per m/s of wind
    across = line[2] + line[3] * slowness
    return ti.Vector(
        [wind_east * along + wind_north * across, wind_north * along - wind_east * across]
    )


@ti.func
def forcing_at(
    features: ti.template(),
    sea: ti.template(),
    own: ti.template(),
    place: ti.template(),
    lon: ti.i32,
    lat: ti.i32,
    fraction: ti.f32,
) -> f32x3:
    """Return (east, north, valid) [m/s] of one quantity of the forcing.

    place: index of its first tile in `Sea.ranges`.
    """
    members = ti.static(bool(features & MEMBERS))
    first, r = sea.ranges[place], f32x3(0.0)
    if ti.static(bundle.alone()):
        # `asks` changes from stage to stage. A graphics card therefore reads a tile's numbers from
        # its cache at each stage, instead of holding them in two dozen registers all through the
        # step.
        first = ti.select(own.asks > 0.5, first, 0)
    if ti.static(features & LAYERS):
        r = sample(
            members, sea, own.row, first, sea.ranges[place + 1], lon, lat, fraction, own.member
        )
    else:
        r = of_tile(members, sea, own.row, first, lon, lat, fraction, own.member)
    return r


@ti.func
def drift(
    features: ti.template(),
    sea: ti.template(),
    own: ti.template(),
    lon: ti.i32,
    lat: ti.i32,
    fraction: ti.f32,
) -> f32x3:
    """Return (east, north, valid) [m/s] of an object: current + Stokes drift + leeway + errors.

    sea: kernels.step.sample.Sea; own: a `Drifter`; lon, lat [binary angle]; fraction: of the step.
    valid: 0 where forcing is missing.
    """
    u, v, valid = own.error[0], own.error[1], 1.0
    if ti.static(features & CURRENT):
        c = forcing_at(features, sea, own, CURRENT_FROM, lon, lat, fraction)
        u, v, valid = u + c[0], v + c[1], c[2]
    if ti.static(features & STOKES):
        s = forcing_at(features, sea, own, STOKES_FROM, lon, lat, fraction)
        u, v, valid = u + s[0], v + s[1], valid * s[2]
    if ti.static(features & WIND):
        w = forcing_at(features, sea, own, WIND_FROM, lon, lat, fraction)
        way = leeway(own.line, w[0] + own.error[2], w[1] + own.error[3])
        u, v, valid = u + way[0], v + way[1], valid * w[2]
    return f32x3(u, v, valid)
