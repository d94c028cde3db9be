"""Leeway: published classes, user coefficients, plain windage, and pure water drifters.

Leeway has a downwind and a crosswind component. Each is slope * wind speed at 10 m + offset, on a
downwind, a right and a left line (Allen and Plourde 1999, CG-D-08-99; Allen 2005, CG-D-05-05). The
left line is not the mirror image of the right one. The project's tables are in % and cm/s:
data/leeway.csv has the 85 classes of the US Coast Guard, data/leeway_later.csv classes published
since, with the source of each. An agency adds its own by a `Catalogue`. Everything returned is SI.
"""

import csv
import difflib
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from importlib import resources
from typing import Any, Literal

from drift.engine.motion.objects import everyday
from geo.errors import UserError

AIR_IN_WATER = 0.0346  # sqrt(1.225 kg/m3 / 1025 kg/m3)
TABLES = ("leeway.csv", "leeway_later.csv")
COAST_GUARD = "Allen and Plourde 1999, CG-D-08-99; Allen 2005, CG-D-05-05"  # of the first table

Stokes = Literal["inside", "added"]
# Whether lines include the Stokes drift, by the method with which they were measured (docs/leeway.md).
# Direct: relative to the water at the object, which the waves carry too (Sutherland et al. 2024,
# doi:10.1007/s10236-024-01600-3). Otherwise the convention of services holds: it is inside.
STOKES: dict[str, Stokes] = {
    "direct": "added",
    "indirect": "inside",
    "unknown": "inside",
    "estimated": "inside",
}


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
    # "inside": the lines include the Stokes drift, so that of [[stokes]] is not added
    stokes: Stokes = "added"
    measured: str = ""  # how the lines were found, a key of STOKES; "": not a class
    source: str = ""  # of the lines
    warning: str = ""  # reported wherever such an object drifts

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
    """Return the shipped classes by name, in the tables' order: those of the US Coast Guard first."""
    return {row["name"]: _drifter(row) for table in TABLES for row in _rows(table)}


def _rows(table: str) -> list[dict[str, str]]:
    text = resources.files("drift.data").joinpath(table).read_text(encoding="utf-8")
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


def _drifter(row: dict[str, str]) -> Drifter:
    def line(side: str) -> Line:
        slope, offset, std = (
            float(row[f"{side}_{column}"]) for column in ("slope", "offset", "std")
        )
        return Line(slope / 100, offset / 100, std / 100)

    return class_of(
        Drifter(
            row["name"],
            row["description"],
            line("down"),
            line("right"),
            line("left"),
            level=int(row["level"]),
            measured=row["measured"],
            source=row.get("source") or COAST_GUARD,
            warning=row.get("warning") or "",
        )
    )


def class_of(drifter: Drifter) -> Drifter:
    """Return a class with `stokes` by the way in which it was measured; lines of 0 include
    nothing.
    """
    return replace(drifter, stokes=STOKES[drifter.measured] if drifter.uses_wind else "added")


@dataclass(frozen=True)
class Catalogue:
    """The classes that a case may name: the shipped ones, and those of an agency's own file."""

    own: Mapping[str, Drifter] = field(default_factory=dict)  # by name, in the file's order
    file: str = ""  # its path; "": none
    stokes: Stokes | None = None  # replaces that of every object
    readable: bool = True  # False: the file has mistakes, so its names are not known

    @property
    def classes(self) -> dict[str, Drifter]:
        """All classes by name, the agency's own first."""
        return {**self.own, **classes()}

    @property
    def command(self) -> str:
        """The command that lists these classes."""
        return (
            f"drift objects --catalogue {shlex.quote(self.file)}" if self.file else "drift objects"
        )

    def find(self, name: str) -> Drifter:
        """Return a class by name, ignoring case.

        Raises:
            UserError: there is none; the message has the nearest name.
        """
        if name.lower() == WATER.name:
            return WATER
        table = self.classes
        names = {key.upper(): key for key in table}
        if name.upper() in names:
            return table[names[name.upper()]]
        if not self.readable:
            return WATER  # the mistakes of the file are reported instead
        near = difflib.get_close_matches(name.upper(), names, n=1, cutoff=0.5)
        hint = f'nearest is "{names[near[0]]}"' if near else self._hint(name)
        raise UserError(f'no leeway class "{name}"; {hint}. See: {self.command}')

    def _hint(self, name: str) -> str:
        matches = self.search(name.replace("-", " ").replace("_", " "))
        return f'such as "{matches[0].name}"' if matches else 'or "water" for a pure water drifter'

    def search(self, words: str = "") -> list[Drifter]:
        """Return the classes whose name or description, or that of their main class, has every
        word.

        Case is ignored. Everyday words, such as yacht, match the classes they cover:
        drift.engine.motion.objects.everyday.
        """
        return _matching(words, self.classes)

    def with_stokes(self, drifter: Drifter) -> Drifter:
        """Return a drifter with the case's own answer to whether its lines include the Stokes
        drift. Water has no lines, and always moves with the waves.
        """
        if self.stokes is None or drifter == WATER:
            return drifter
        return replace(drifter, stokes=self.stokes)


def find_class(name: str) -> Drifter:
    """Return a shipped class by name, ignoring case; raise UserError with the nearest name if it
    is unknown.
    """
    return Catalogue().find(name)


def search_classes(words: str = "") -> list[Drifter]:
    """Return the shipped classes that have every word, as `Catalogue.search` does."""
    return Catalogue().search(words)


def _matching(words: str, table: Mapping[str, Drifter]) -> list[Drifter]:
    wanted = [
        (word, everyday.classes_of_word(word, tuple(table))) for word in everyday.split_words(words)
    ]
    matches, above = [], [""] * 8
    for drifter in table.values():
        above[drifter.level] = f"{drifter.name} {drifter.description}".lower()
        text = " ".join(above[: drifter.level + 1])
        if all(word in text or (meant and drifter.name in meant.classes) for word, meant in wanted):
            matches.append(drifter)
    return matches
