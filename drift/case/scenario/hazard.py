"""The `hazard` of a scenario: where and when distress on its trackline is likelier."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from drift.case.forcing import sources
from drift.case.scenario.change import WIDTH
from drift.case.values import fields
from drift.engine.motion.scenario import Hazard

OF_FILE = ("variable", "units", "outside", "depth")  # keys that need a file
OF_DEPTH = ("deeper", "positive")  # keys that need a depth


class HazardTable(fields.Table):
    """How likely distress is by place and time, compared with others: by wind, or by a file."""

    wind: fields.WindSpeed | None = None
    width: Annotated[fields.WindSpeed | None, Field(gt=0)] = None
    file: str | None = None
    variable: str | None = None
    units: dict[str, str] = Field(default_factory=dict)
    outside: Annotated[float | None, Field(ge=0, allow_inf_nan=False)] = None
    depth: Annotated[fields.Depth | None, Field(gt=0)] = None
    deeper: fields.Share | None = None
    positive: Literal["up", "down"] | None = None

    @model_validator(mode="after")
    def whole(self) -> "HazardTable":
        """Reject a hazard by neither or both of wind and file, and keys of the other one."""
        wrong = []
        given = [name for name in ("wind", "file") if getattr(self, name) is not None]
        if len(given) != 1:
            found = " and ".join(given) if given else "none"
            wrong.append(f"exactly one of wind, file must be given; found {found}")
        for names, other in ((("width",), "wind"), (OF_FILE, "file"), (OF_DEPTH, "depth")):
            wrong += [
                f"{name} belongs to {other}; add {other}, or leave {name} out"
                for name in names
                if getattr(self, name) not in (None, {}) and getattr(self, other) is None
            ]
        fields.refuse(self, wrong)
        return self

    def hazard(self, folder: Path) -> Hazard:
        """Return the record of the hazard.

        Args:
            folder: folder from which relative paths start.

        Raises:
            UserError: the file is missing or has no valid hazard.
        """
        if self.file is None:
            assert self.wind is not None
            return Hazard((self.wind, WIDTH if self.width is None else self.width))
        from drift.evidence.sensors import hazard_file  # imported here: it loads xarray

        return hazard_file.read_hazard(
            sources.one_file(self.file, folder, "hazard.file"),
            variable=self.variable,
            units=self.units,
            depth=self.depth,
            deeper=self.deeper or 0.0,
            positive=self.positive,
            outside=self.outside,
        )
