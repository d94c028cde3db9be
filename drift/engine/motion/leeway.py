"""Leeway: published classes, user coefficients, plain windage, and pure water drifters.

Leeway has a downwind and a crosswind component. Each is slope * wind speed at 10 m + offset, on a
downwind, a right and a left line (Allen and Plourde 1999, CG-D-08-99; Allen 2005, CG-D-05-05). The
left line is not the mirror image of the right one. The project's table data/leeway.csv is in % and
cm/s; everything returned is SI.
"""

import csv
import difflib
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from typing import Any

from drift.engine.motion import everyday
from geo.errors import UserError

AIR_IN_WATER = 0.0346  # sqrt(1.225 kg/m3 / 1025 kg/m3)


@dataclass(frozen=True)
class Line:
    """One leeway line: speed = slope * wind + offset, with the standard error of the regression.

    Each particle draws xi ~ N(0, 1) once per line. Its slope is slope + slope_std * xi and its
    offset is offset + offset_std * xi, so that at 10 m/s of wind its error is std * xi (Breivik and
    Allen 2008, doi:10.1016/j.jmarsys.2007.02.010). On a downwind line xi is redrawn until the slope
    is not negative (docs/leeway.md).
    """

    slope: float = 0.0  # [1]
    offset: float = 0.0  # [m/s]; positive to the right of downwind on a crosswind line
    std: float = 0.0  # [m/s] standard error of the regression
    spread: float = 0.0  # [1] standard deviation of the slope alone: plain windage

    @property
    def slope_std(self) -> float:
        """Standard deviation of a particle's slope [1]: error / (20 m/s)."""
        return self.std / 20.0 + self.spread

    @property
    def offset_std(self) -> float:
        """Standard deviation of a particle's offset [m/s]: error / 2."""
        return self.std / 2.0


@dataclass(frozen=True)
class Drifter:
    """A drifting object: its name and three leeway lines; level: its depth below its main class in
    the table.
    """

    name: str
    description: str
    down: Line
    right: Line
    left: Line
    level: int = 0
    # share under water, uniform between objects; down holds the mean
    immersion: tuple[float, float] | None = None
    blown: bool = False  # whether a motion model without leeway lines uses the wind

    @property
    def uses_wind(self) -> bool:
        """Whether the wind moves the object at all."""
        still = Line()
        return self.blown or (self.down, self.right, self.left) != (still, still, still)

    @property
    def lull(self) -> float:
        """Wind speed [m/s] below which the published downwind line points upwind; 0 if it never
        does.
        """
        return max(0.0, -self.down.offset / self.down.slope) if self.down.slope > 0 else 0.0

    @property
    def jibes(self) -> bool:
        """Whether the right and the left line differ."""
        return self.right != self.left


def windage(immersion: Any) -> Any:
    """Return the share of the wind speed [1] at which a box drifts, of the shape of `immersion`.

    The air drag on the part above water balances the water drag on the part below: sqrt(rho_air /
    rho_water) sqrt((1 - I) / I), with equal drag coefficients (Daniel et al. 2002,
    doi:10.1016/S1353-2561(02)00075-0).

    Args:
        immersion: share I of its height under water.
    """
    return AIR_IN_WATER * ((1.0 - immersion) / immersion) ** 0.5


WATER = Drifter("water", "Water particle: moves with the current only", Line(), Line(), Line())


@lru_cache(maxsize=1)
def classes() -> dict[str, Drifter]:
    """Return the 85 published classes by name, in the table's order."""
    text = resources.files("drift.data").joinpath("leeway.csv").read_text(encoding="utf-8")
    rows = csv.DictReader(line for line in text.splitlines() if not line.startswith("#"))
    return {row["name"]: _drifter(row) for row in rows}


def _drifter(row: dict[str, str]) -> Drifter:
    def line(side: str) -> Line:
        slope, offset, std = (
            float(row[f"{side}_{column}"]) for column in ("slope", "offset", "std")
        )
        return Line(slope / 100, offset / 100, std / 100)

    return Drifter(
        row["name"],
        row["description"],
        line("down"),
        line("right"),
        line("left"),
        level=int(row["level"]),
    )


def find_class(name: str) -> Drifter:
    """Return a class by name, ignoring case; raise UserError with the nearest name if it is
    unknown.
    """
    if name.lower() == WATER.name:
        return WATER
    table = classes()
    if name.upper() in (names := {key.upper(): key for key in table}):
        return table[names[name.upper()]]
    near = difflib.get_close_matches(name.upper(), names, n=1, cutoff=0.5)
    hint = f'nearest is "{names[near[0]]}"' if near else _hint(name)
    raise UserError(f'no leeway class "{name}"; {hint}. See: drift objects')


def _hint(name: str) -> str:
    matches = search_classes(name.replace("-", " ").replace("_", " "))
    return f'such as "{matches[0].name}"' if matches else 'or "water" for a pure water drifter'


def search_classes(words: str = "") -> list[Drifter]:
    """Return the classes whose name or description, or that of their main class, has every word.

    Case is ignored. Everyday words, such as yacht, match the classes they cover:
    drift.engine.motion.everyday.
    """
    wanted = [
        (word, everyday.classes_of_word(word, tuple(classes())))
        for word in everyday.split_words(words)
    ]
    matches, above = [], [""] * 8
    for drifter in classes().values():
        above[drifter.level] = f"{drifter.name} {drifter.description}".lower()
        text = " ".join(above[: drifter.level + 1])
        if all(word in text or (meant and drifter.name in meant.classes) for word, meant in wanted):
            matches.append(drifter)
    return matches
