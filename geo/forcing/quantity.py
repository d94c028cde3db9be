"""The quantities of forcing: currents, winds and Stokes drift, each with what holds for it in any
file.
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Quantity:
    """One quantity of forcing."""

    spoken: str  # its name in messages
    key: str  # its key in a scenario, which names the sources that the scenario drifts in
    fastest: float  # [m/s] that a speed is believed to
    impossible: float  # [m/s] of a component, beyond which a value is a fill value
    utmost: float  # [m/s] that no average over a whole run exceeds
    sigma: float  # share of the column from the surface within which a level passes for it
    wanted: str  # level, in messages
    # In the air levels are heights, the direction is where it comes from, and it blows over land
    # too. It moves an object by its leeway; what is in the water moves all that drifts alike.
    in_air: bool = False
    # [m/s] that the mean over all places and times of a file stays under. Where it is known a few
    # points may exceed `fastest`; otherwise none may.
    strong_mean: float = math.inf
    zeros_are_land: bool = False  # even beside missing values: it really is zero hardly anywhere
    plain: bool = False  # variables "u" and "v" that do not say what they are may be it
    has_errors: bool = False  # whether [uncertainty] states how wrong it may be
    # cells that a source is filled from wet neighbours toward the coast, where its table says
    # nothing
    fill: int = 3
    # where its sources have no value nothing is known of the drift; else it adds nothing there
    needed: bool = True


# The fastest of tidal races reach 8 to 10, the significant Stokes drift of hurricanes 1; the
# strongest sustained wind was 96 (Patricia, 2015), which no model's grid resolves; the strongest
# gust on record was 113. 0.005 of the atmosphere is 40 m.
QUANTITIES = {
    "current": Quantity(
        spoken="current",
        key="currents",
        fastest=8.0,
        impossible=20.0,
        utmost=5.0,
        sigma=0.1,
        wanted="the current at most 5 m deep, or within 0.1 of the surface in sigma",
        strong_mean=2.5,  # western boundary currents fill no file
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


def needed() -> tuple[str, ...]:
    """Return the quantities without a value of which nothing is known of the drift."""
    return tuple(name for name, quantity in QUANTITIES.items() if quantity.needed)


def any_of(article: str = "") -> str:
    """Return all quantities in words, each after an article: "a current, a wind or a Stokes drift"."""
    names = [f"{article}{quantity.spoken}" for quantity in QUANTITIES.values()]
    return f"{', '.join(names[:-1])} or {names[-1]}"
