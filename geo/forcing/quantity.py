"""The forcing quantities (current, wind, Stokes drift): limits, properties, and names in files.

A quantity is a velocity, or a number such as the concentration of sea ice (`scalar`). A number is
stored like a velocity, as (value, 0). It moves nothing; particles.nc records it along the tracks.
"""

import math
from dataclasses import dataclass

# of the variables of both components (east or x, north or y), and their axes: "true" for east and
# north, "grid" for the grid's own, "?" for the grid's own if it is not aligned with north
Names = tuple[tuple[str, str, str], ...]


@dataclass(frozen=True)
class Quantity:
    """One quantity of forcing."""

    spoken: str  # its name in messages
    key: str  # key in a scenario that lists the sources which the scenario uses
    fastest: float  # [m/s] largest plausible speed
    impossible: float  # [m/s] components beyond it are fill values
    utmost: float  # [m/s] largest plausible average over a whole run
    sigma: float  # distance from the surface, as a share of the column, up to which levels pass
    wanted: str  # accepted level, for messages
    standard_names: Names = ()  # CF standard names, best first
    usual_names: Names = ()  # names of variables without attributes, best first
    scalar: bool = False  # a number: its names are made by `number_names`
    unit: str = "m/s"  # of all values
    # True for quantities of the air: levels are heights, the direction is where it comes from, it
    # has values over land, and it moves an object by its leeway. Quantities in the water move all
    # objects equally.
    in_air: bool = False
    # [m/s] largest plausible mean over all points and times of a file. If it is finite, a few
    # points may exceed `fastest`; otherwise none may.
    strong_mean: float = math.inf
    zeros_are_land: bool = False  # exact zeros mean land even in files with missing values
    plain: bool = False  # undescribed variables "u" and "v" may be this quantity
    has_errors: bool = False  # [uncertainty] states its error
    # number of cells by which values are extrapolated from wet neighbours toward the coast, unless
    # the source's table sets it
    fill: int = 3
    # True: without a value the drift is unknown; False: a missing value adds nothing to the drift
    needed: bool = True

    @property
    def unit_text(self) -> str:
        """The unit after a number in messages, with a space; "" for a share."""
        return "" if self.unit == "1" else f" {self.unit}"


def number_names(*names: str) -> Names:
    """Return names of variables that hold a scalar, for `standard_names` and `usual_names`."""
    return tuple((name, name, "true") for name in names)


# The fastest tidal races reach 8 to 10 m/s, the significant Stokes drift of hurricanes 1 m/s. The
# strongest sustained wind was 96 m/s (Patricia, 2015), which no model grid resolves; the strongest
# recorded gust was 113 m/s. 0.005 of the atmosphere is 40 m.
QUANTITIES = {
    "current": Quantity(
        spoken="current",
        key="currents",
        fastest=8.0,
        impossible=20.0,
        utmost=5.0,
        sigma=0.1,
        wanted="the current at most 5 m deep, or within 0.1 of the surface in sigma",
        strong_mean=2.5,  # only western boundary currents are as strong, and none fills a file
        zeros_are_land=True,
        plain=True,
        has_errors=True,
        standard_names=(
            ("surface_eastward_sea_water_velocity", "surface_northward_sea_water_velocity", "true"),
            ("eastward_sea_water_velocity", "northward_sea_water_velocity", "true"),
            ("surface_sea_water_x_velocity", "surface_sea_water_y_velocity", "grid"),
            ("surface_x_sea_water_velocity", "surface_y_sea_water_velocity", "grid"),
            ("x_sea_water_velocity", "y_sea_water_velocity", "grid"),
            ("sea_water_x_velocity", "sea_water_y_velocity", "grid"),
            ("sea_water_x_velocity_at_u_location", "sea_water_y_velocity_at_v_location", "grid"),
            (
                "surface_geostrophic_eastward_sea_water_velocity",
                "surface_geostrophic_northward_sea_water_velocity",
                "true",
            ),
        ),
        usual_names=(
            ("u_eastward", "v_northward", "true"),
            ("u_sur_eastward", "v_sur_northward", "true"),
            ("water_u", "water_v", "true"),
            ("uo", "vo", "?"),
            ("uos", "vos", "?"),
            ("ssu", "ssv", "?"),
            ("usurf", "vsurf", "?"),
            ("u_surf", "v_surf", "?"),
            ("u_sur", "v_sur", "grid"),
            ("utotal", "vtotal", "true"),
            ("vozocrtx", "vomecrty", "grid"),
            ("sozocrtx", "somecrty", "grid"),
            ("horizontalVelX", "horizontalVelY", "true"),
            ("hvel", "hvel", "true"),
            ("uogrd", "vogrd", "true"),
            ("ucur", "vcur", "true"),
            ("ucurr", "vcurr", "true"),
            ("u_current", "v_current", "true"),
            ("current_u", "current_v", "true"),
            ("ugos", "vgos", "true"),
            ("u_velocity", "v_velocity", "?"),
            ("u", "v", "?"),
        ),
    ),
    "wind": Quantity(
        spoken="wind",
        key="winds",
        fastest=90.0,
        impossible=120.0,
        utmost=50.0,
        sigma=0.005,
        wanted="the wind 2 to 20 m above the sea",
        in_air=True,
        has_errors=True,
        standard_names=(
            ("eastward_wind", "northward_wind", "true"),
            ("x_wind", "y_wind", "grid"),
            ("grid_eastward_wind", "grid_northward_wind", "grid"),
        ),
        usual_names=(
            ("u10", "v10", "?"),
            ("U10M", "V10M", "true"),
            ("u10m", "v10m", "true"),
            ("10u", "10v", "true"),
            ("u10n", "v10n", "true"),
            ("air_u", "air_v", "true"),
            ("x_wind_10m", "y_wind_10m", "grid"),
            ("x_wind", "y_wind", "grid"),
            ("uas", "vas", "true"),
            ("ugrd10m", "vgrd10m", "true"),
            ("UGRD_10maboveground", "VGRD_10maboveground", "true"),
            ("UGRD", "VGRD", "true"),
            (
                "u-component_of_wind_height_above_ground",
                "v-component_of_wind_height_above_ground",
                "true",
            ),
            ("uwnd", "vwnd", "true"),
            ("u_wind", "v_wind", "true"),
            ("wind_u", "wind_v", "true"),
            ("eastward_wind", "northward_wind", "true"),
            ("Uwind", "Vwind", "?"),
            ("windSpeedX", "windSpeedY", "true"),
            ("uwind_speed", "vwind_speed", "true"),
            ("windx", "windy", "true"),
            ("u", "v", "?"),
        ),
    ),
    "stokes": Quantity(
        spoken="Stokes drift",
        key="stokes",
        fastest=3.0,
        impossible=10.0,
        utmost=1.0,
        sigma=0.1,
        wanted="the Stokes drift at most 5 m deep, or within 0.1 of the surface in sigma",
        standard_names=(
            (
                "sea_surface_wave_stokes_drift_eastward_velocity",
                "sea_surface_wave_stokes_drift_northward_velocity",
                "true",
            ),
            ("eastward_surface_stokes_drift", "northward_surface_stokes_drift", "true"),
            ("surface_eastward_stokes_drift", "surface_northward_stokes_drift", "true"),
            (
                "sea_surface_wave_stokes_drift_x_velocity",
                "sea_surface_wave_stokes_drift_y_velocity",
                "grid",
            ),
        ),
        usual_names=(
            ("VSDX", "VSDY", "true"),
            ("ust", "vst", "true"),
            ("uuss", "vuss", "true"),
            ("uss", "vss", "true"),
            ("ustokes", "vstokes", "true"),
            ("u_stokes", "v_stokes", "true"),
            ("stokes_u", "stokes_v", "true"),
        ),
    ),
}


def required_quantities() -> tuple[str, ...]:
    """Return the quantities whose absence makes the drift unknown."""
    return tuple(name for name, quantity in QUANTITIES.items() if quantity.needed)


def velocities() -> tuple[str, ...]:
    """Return the quantities that are velocities."""
    return tuple(name for name, quantity in QUANTITIES.items() if not quantity.scalar)


def scalars() -> tuple[str, ...]:
    """Return the quantities that are numbers."""
    return tuple(name for name, quantity in QUANTITIES.items() if quantity.scalar)


def list_quantities(article: str = "") -> str:
    """Return all quantities as text, each after an article: "a current, a wind or a ..."."""
    names = [f"{article}{quantity.spoken}" for quantity in QUANTITIES.values()]
    return f"{', '.join(names[:-1])} or {names[-1]}"
