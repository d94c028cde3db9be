"""The forcing quantities (current, wind, Stokes drift) with their limits and properties."""

import math
from dataclasses import dataclass


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
    ),
    "stokes": Quantity(
        spoken="Stokes drift",
        key="stokes",
        fastest=3.0,
        impossible=10.0,
        utmost=1.0,
        sigma=0.1,
        wanted="the Stokes drift at most 5 m deep, or within 0.1 of the surface in sigma",
    ),
}


def required_quantities() -> tuple[str, ...]:
    """Return the quantities whose absence makes the drift unknown."""
    return tuple(name for name, quantity in QUANTITIES.items() if quantity.needed)


def list_quantities(article: str = "") -> str:
    """Return all quantities as text, each after an article: "a current, a wind or a ..."."""
    names = [f"{article}{quantity.spoken}" for quantity in QUANTITIES.values()]
    return f"{', '.join(names[:-1])} or {names[-1]}"
