"""Errors of winds and currents: the size of each, its source, and descriptions for users."""

import math
from dataclasses import dataclass, replace
from typing import Any

from geo import notation

CASE, DEFAULT, NOWHERE, RIVALS, MEMBERS, UNFELT = (
    "case",
    "default",
    "not from model files",
    "rival sources",
    "the spread of its members represents it",
    "nothing drifts with it",
)
HOUR = 3600.0


@dataclass(frozen=True)
class ForcingError:
    """Error of each component of a wind or current: an Ornstein-Uhlenbeck process about a constant
    bias.

    Zeros switch it off.
    """

    std: float  # [m/s]
    time: float  # [s] decorrelation
    # [m/s] standard deviation of the constant bias of a particle, or in a spill of a world
    bias: float = 0.0
    # sources of std, time and bias, or why there is none
    by: tuple[str, str, str] = (CASE, CASE, CASE)
    length: float = (
        12_500.0  # [m] over which it is correlated: drift.engine.motion.errors.buoy_errors
    )
    # degrees of freedom of Student's law, at least 3; inf: a normal law. Of the current only
    tail: float = math.inf

    @property
    def tailed(self) -> bool:
        """Whether each particle has a scale of its own."""
        return math.isfinite(self.tail)

    def displacement(self, duration: float) -> float:
        """Return the standard deviation of a component of what the error does to a position [m].

        Args:
            duration: for which a particle drifts [s].
        """
        share = duration / self.time
        walk = 2 * (self.std * self.time) ** 2 * (share + math.expm1(-share))
        return math.sqrt(walk + (self.bias * duration) ** 2)


@dataclass(frozen=True)
class Errors:
    """The forcing errors of a run: of current and wind, and the diffusivity of unresolved
    motion.
    """

    current: ForcingError
    wind: ForcingError
    diffusivity: float  # [m2/s]

    def unbiased(self) -> "Errors":
        """Return the errors without the bias of the current; in a spill each world draws it, not
        each particle.
        """
        return replace(self, current=replace(self.current, bias=0.0))


def errors_in_words(
    current: ForcingError, wind: ForcingError | None, diffusivity: float, by: str
) -> str:
    """Return a line that lists the errors of a run and the source of each.

    by: source of the diffusivity. wind: None if there is no wind.
    """
    parts = [_words("current", current), *([_words("wind", wind)] if wind is not None else [])]
    parts += [f"diffusivity {notation.number(diffusivity)} m2/s ({by})"] if diffusivity > 0 else []
    return "; ".join(parts)


def _words(quantity: str, error: ForcingError) -> str:
    std, time, bias = error.by
    parts = []
    if error.std > 0:
        whose = std if std == time else f"{std}, time by {time}"
        parts.append(
            (f"{notation.number(error.std)} m/s over {notation.number(error.time / HOUR)} h", whose)
        )
    if error.bias > 0:
        parts.append((f"{notation.number(error.bias)} m/s that lasts", bias))
    if not parts:
        what_to_do = "; state one in [uncertainty]" * (std == NOWHERE)
        return f"no error of the {quantity} ({std}{what_to_do})"
    law, alone = "", ""
    if error.tailed:  # no default has a tail
        law = f", Student's with {notation.number(error.tail)} degrees of freedom"
        if parts[-1][1] != CASE:
            law, alone = "", f"{law} ({CASE})"
    parts[-1] = (parts[-1][0] + law, parts[-1][1])
    if len({whose for _, whose in parts}) == 1:
        parts = [(" and ".join(text for text, _ in parts), parts[0][1])]
    return f"{quantity} {' and '.join(f'{text} ({whose})' for text, whose in parts)}{alone}"


def summary_of_errors(
    current: ForcingError, wind: ForcingError, diffusivity: float, by: str
) -> dict[str, Any]:
    """Return the errors of a run for its summary, each with its source."""
    errors: dict[str, Any] = {
        name: {
            "std_m_s": error.std,
            "time_s": error.time,
            "bias_m_s": error.bias,
            "by": dict(zip(("std", "time", "bias"), error.by, strict=True))
            | ({"tail": CASE} if error.tailed else {}),
            **({"tail": error.tail} if error.tailed else {}),
        }
        for name, error in (("current", current), ("wind", wind))
    }
    return errors | {"diffusivity": {"m2_s": diffusivity, "by": by}}
