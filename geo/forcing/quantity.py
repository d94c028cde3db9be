"""The quantities of forcing: currents, winds and Stokes drift, each with what holds for it in any file."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Quantity:
    """One quantity of forcing."""

    spoken: str  # its name in messages
    fastest: float  # [m/s] that a speed is believed to
    impossible: float  # [m/s] of a component, beyond which a value is a fill value
    sigma: float  # share of the column from the surface within which a level passes for it
    wanted: str  # level, in messages
    in_air: bool = False  # levels are heights, the direction is where it comes from, and it blows over land too


# The fastest of tidal races reach 8 to 10, the significant Stokes drift of hurricanes 1; the strongest sustained wind
# was 96 (Patricia, 2015), which no model's grid resolves; the strongest gust on record was 113. 0.005 of the atmosphere
# is 40 m.
QUANTITIES = {
    "current": Quantity(
        "current", 8.0, 20.0, 0.1, "the current at most 5 m deep, or within 0.1 of the surface in sigma"
    ),
    "wind": Quantity("wind", 90.0, 120.0, 0.005, "the wind 2 to 20 m above the sea", in_air=True),
    "stokes": Quantity(
        "Stokes drift", 3.0, 10.0, 0.1, "the Stokes drift at most 5 m deep, or within 0.1 of the surface in sigma"
    ),
}
