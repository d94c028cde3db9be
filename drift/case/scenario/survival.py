"""Survival time in cold water: a published regression on the water temperature.

It is used only within its range of temperatures. It gives the time at which the core temperature of
an average adult falls to 30 degC; drowning before that, and rafts, are not modelled.
"""

from typing import Annotated

from pydantic import BeforeValidator, Field, model_validator

from drift.case.values import fields, units
from drift.engine.motion.scenario import Survival

# Hayward, Eckerson and Collis 1975, Thermal balance and survival time prediction of man in cold
# water, Can. J. Physiol. Pharmacol. 53, 21-32: adults of average build, lightly clothed, in
# lifejackets, holding still in sea water of 4.6 to 18.2 degC; survival time [min] = 15 + 7.2 /
# (0.0785 - 0.0034 T), T [degC].
SOURCE = "Hayward, Eckerson and Collis 1975"
COLDEST, WARMEST = 4.6, 18.2  # [degC] measured in
ONSET, LOSS, COOLING, WARMTH = 15.0, 7.2, 0.0785, 0.0034  # [min], [degC], [degC/min], [1/min]
# Our assumption, the paper gives none: 68 % survive between half and twice the median, because
# people and sea states vary widely.
SPREAD = 2.0
OTHERS = (
    "a formula with its numbers is known for light clothing only. For other clothing or a raft give "
    "median and spread instead (survival suits: 2 to 10 times as long, National Search and Rescue "
    "Manual, JP 3-50, chapter 4)"
)
CLOTHING = ("light",)


def celsius(value: object) -> float:
    """Return a water temperature [degC] within the range of the regression.

    Args:
        value: text like "12 degC", or in another unit of temperature.
    """
    kelvin = units.temperature(value)
    degrees = kelvin - units.FREEZING
    if not COLDEST - 1e-9 <= degrees <= WARMEST + 1e-9:
        raise ValueError(
            f"water {value!r} is {degrees:.1f} degC; {SOURCE} measured in {COLDEST} to {WARMEST} degC. Outside give "
            "median and spread"
        )
    return degrees


def immersed(water: float) -> float:
    """Return the median survival time [s] of lightly clothed people in water at `water` [degC]."""
    return 60 * (ONSET + LOSS / (COOLING - WARMTH * water))


class SurvivalTable(fields.Table):
    """Survival time after going adrift: lognormal, given by a median and a spread factor.

    The median is given, or computed from the water temperature.
    """

    median: fields.Duration | None = None
    """Median survival time."""
    spread: Annotated[float, Field(gt=1, le=20)] | None = None
    """Factor of one standard deviation; by default 1.5 with `median`, 2 with `water`."""
    water: Annotated[float, BeforeValidator(celsius)] | None = None
    """Water temperature, from which drift computes the median."""
    clothing: str | None = None
    """Clothing; needs `water`. Only `"light"` is allowed, because no other formula is known."""

    @model_validator(mode="after")
    def one_way(self) -> "SurvivalTable":
        """Reject no median or two, and clothing without a known formula."""
        if fields.one_of(self, ("median", "water")) == "median":
            if self.clothing is not None:
                raise ValueError(
                    "clothing belongs to water; a median already includes the effect of clothing"
                )
        elif self.clothing not in CLOTHING:
            given = "is missing" if self.clothing is None else f'"{self.clothing}" is not known'
            raise ValueError(f'clothing {given}; with water it must be "light": {OTHERS}')
        return self

    def survival(self) -> Survival:
        """Return the record of the survival time."""
        if self.median is not None:
            return Survival(self.median, self.spread or 1.5)
        assert self.water is not None
        spread = self.spread or SPREAD
        return Survival(
            immersed(self.water),
            spread,
            f"{SOURCE}, light clothing, {self.water:.1f} degC",
        )
