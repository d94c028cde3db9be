"""The unit of work of a run in shards: a shard, drawn and moved from the begin of the run to its end."""

import contextlib
from dataclasses import dataclass, replace

from drift import start
from drift.case.record import Case
from drift.environment.environment import Environment
from drift.motion import prior, simulate
from drift.motion.clock import Clock
from drift.motion.forcing import Forcing
from drift.motion.scene import Scene
from drift.motion.spool import Reel
from drift.particles.ensemble import Layout


@dataclass(frozen=True)
class Unit:
    """A shard of a case's run."""

    case: Case
    clock: Clock
    layout: Layout
    number: int  # of the shard
    of: str = ""  # nothing besides the fingerprint of the run

    @property
    def n(self) -> int:
        """Number of particles."""
        return self.layout.bounds[-1]

    def move(self, scene: Scene, where: Environment, tell: simulate.Progress | None, reel: Reel) -> None:
        """Draw the particles, move them, and take down what they were like at all output times; tell: takes what is done."""
        case = self.case
        if tell:
            tell(0.0)
        ensemble = prior.draw(start.spec_of(case, where), scene.place.coast, self.layout).ensemble
        with contextlib.closing(Forcing(list(where.scenarios), case.direction)) as forcing:
            outputs = case.period.seconds(case.outputs)
            own = replace(scene, forcing=forcing)
            reel.record(case.period, ensemble, simulate.run(ensemble, own, self.clock, outputs, tell))
