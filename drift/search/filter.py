"""The filter: what sorties that found nothing, contacts and sensors do to the weights of an ensemble.

It works while the ensemble moves.

The clock of the forecast tells it of every step. A sortie's exposure grows as it is flown and changes weights when it
ends; an output in between sees what it has done so far. Evidence is the mean weight after over that before. A sortie
that does nothing changes no bit.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from drift.motion.ensemble_spec import EnsembleSpec
from drift.motion.scene import Begin, Scene
from drift.motion.simulate import PositionsAt
from drift.particles import ensemble as record
from drift.particles import life, resample, weights
from drift.particles.ensemble import Ensemble
from drift.particles.status import STRANDED, Status, on_map
from drift.particles.weights import Weighed
from drift.search import contacts as contact_laws
from drift.search import crossings, debris, looks, overdue
from drift.search.exposure import Exposed, SortieExposure
from drift.search.observers import Observers
from drift.search.records import NO_SENSORS, Contact, Kind, Look, Resampling, Sensors, Sortie
from drift.search.standing import Standing, standing
from drift.search.updates import Update, Updates
from geo.array import Array
from geo.errors import UserError
from kernels import runtime
from kernels.advance import Step

Device = Any

Noted = Callable[[Update, Array, Array, Array | None], None]

FARTHEST = 20.0  # most that the log of the sum of weights may be off before weights are brought back


class Search:
    """Sorties, contacts and sensors of one run; `updates` tells afterwards what each did."""

    def __init__(
        self,
        spec: EnsembleSpec,
        sorties: Sequence[Sortie],
        contacts: Sequence[Contact],
        resampling: Resampling,
        ensemble: Ensemble,
        scene: Scene,
        sensors: Sensors = NO_SENSORS,
        noted: Noted | None = None,
        known: Sequence[np.datetime64] = (),
    ) -> None:
        """Make ready for a run through a scene of an ensemble that has been drawn from `spec`.

        noted: is told of each update as it takes effect, with the log weights (n,) before and after it, and the
        particle of the begin from which each descends (n,); None: itself. known: when it is known that nothing was reported,
        besides the times of sorties, contacts and sensors.
        """
        self._noted = noted
        self._spec, self._resampling, self.ensemble, self._scene = spec, resampling, ensemble, scene
        self._start = spec.period.epoch
        seas = scene.seas("current")
        members = [scene.forcing.members(sea[0], "current") for sea in seas]
        self._all = [SortieExposure(sortie, self._start, seas, members) for sortie in sorties]
        self._waiting = list(self._all)
        self._contacts = [(spec.period.elapsed(contact.time), contact) for contact in contacts]
        self._shared: dict[tuple[str, float], Device] = {}
        self._step: Step | None = None
        self._begin: Begin | None = None  # where the particles began the present step
        self._looks = [(spec.period.elapsed(look.time), look) for look in sensors.looks]
        self._observers = Observers(spec, sensors, ensemble, scene)
        heard = [*known, *sensors.times, *(contact.time for contact in contacts)]
        heard += [time for sortie in sorties for time in (sortie.start, sortie.end)]
        self._begins = overdue.begins(spec)
        self._overdue = overdue.times(spec, [spec.period.elapsed(time) for time in heard])
        self._debris = debris.of_contacts(spec, self._contacts, scene, ensemble)
        self._updates: list[Update] = []
        first = self.ensemble.log_weight.to_numpy()
        self._prior = self._weighed(first).scenarios
        # Log weights (n,) by all that was seen, as if no sortie had been flown.
        self.unsearched = first.astype(np.float64)
        self._missed = np.ones(len(spec.scenarios) + 1)  # product of 1 - POS so far
        self._lineage, self._drawn_anew = np.arange(ensemble.n, dtype=np.int32), False
        self._ancestors: Array | None = None
        self._events = 0
        self._never: Array | None = None  # product over sorties of the share of time that a particle was not searched
        self._least = np.inf  # effective particles after any update
        self._target = _living(ensemble)

    @property
    def updates(self) -> Updates:
        """What has happened so far, with sorties as they were flown.

        They drift with their markers in the likeliest scenario.
        """
        last = self._updates[-1].posterior if self._updates else self._prior
        likeliest = int(np.argmax(last))
        flown = tuple(sortie.as_flown(likeliest, self._start) for sortie in self._all)
        lines = crossings.build(self._spec, self._observers.lines, self.ensemble) if self._observers.lines else None
        return Updates(tuple(s.name for s in self._spec.scenarios), self._prior, tuple(self._updates), flown, lines)

    def stops(self, after: int, until: int) -> list[int]:
        """Return the times in (after, until] at which something takes effect [s after start]."""
        times = [flown.end for flown in self._waiting] + [time for time, _ in self._contacts + self._looks]
        times += self._overdue
        return sorted({t for t in times if after < t <= until} | self._observers.stops(after, until))

    def before(self, elapsed: int, duration: int) -> bool:
        """Take the markers of sorties over a step, for which the forcing is set; return whether any is flown in it."""
        under_way = self._flown(elapsed + duration)
        for flown in under_way:
            flown.drift(self._scene.forcing, elapsed, duration)
        end = elapsed + duration
        debris = any(beside.last > elapsed for beside in self._debris.values())
        moving = any(elapsed < when <= end and contact.moves for when, contact in self._contacts)
        return bool(under_way) or debris or moving or self._observers.looking(elapsed + duration)

    def moved(self, begin: Begin | None) -> None:
        """Take note of where the particles began the step that has just been made."""
        self._begin = begin
        self._observers.moved(begin)
        assert self._step is not None
        for beside in self._debris.values():
            if beside.last > self._step.elapsed:
                beside.advance(self.ensemble, begin, self._step)

    def ready(self, step: Step) -> None:
        """Make ready for a step."""
        self._step = step
        self._observers.before(step)

    def _flown(self, until: int) -> list[SortieExposure]:
        """Return the sorties that have begun before a time and are not over."""
        return [flown for flown in self._waiting if flown.begin < until]

    def _exposed(self, flown: SortieExposure, until: int, keep: bool) -> Exposed:
        assert self._begin is not None
        assert self._step is not None
        return flown.expose(self.ensemble, self._begin, self._scene.helm(self.ensemble), self._step, until, keep)

    def take_effect(self, time: int, place: PositionsAt) -> None:
        """Change weights by all that ends or is seen at a time.

        place: gives where an ensemble's particles were then.
        """
        asked = [c for when, c in self._contacts + self._looks if when == time and not getattr(c, "drifter", None)]
        if asked or self._observers.stops(time - 1, time):
            self._observers.cut(time, place)
        for flown in [f for f in self._waiting if f.end == time]:
            self._fail(flown)
            self._waiting.remove(flown)
            flown.exposed = None
            if all(other.sortie.group != flown.sortie.group for other in self._waiting):
                self._shared.pop((flown.sortie.group, flown.sortie.shape), None)
        for when, contact in [c for c in self._contacts if c[0] == time]:
            self._contacts.remove((when, contact))
            self._see(contact, time, place)
        for when, look in [c for c in self._looks if c[0] == time]:
            self._looks.remove((when, look))
            self._look(look, time, place)
        if time in self._overdue:
            missing = overdue.log_likelihood(self._spec, time, self.ensemble)
            news = time in self._begins or (missing[self.ensemble.log_weight.to_numpy() > -np.inf] < 0).any()
            if news:
                self._tell(overdue.name(self._spec, time), "overdue", time, missing, positive=True)
        for seen in self._observers.over(time):
            likelihood = seen.likelihood(seen.ready(self.ensemble.n), over=True)
            assert likelihood is not None
            self._tell(seen.what.name, seen.kind, time, likelihood, seen.positive)

    def _fail(self, flown: SortieExposure) -> None:
        """Change weights because a sortie found nothing."""
        sortie, exposed = flown.sortie, self._exposed(flown, flown.end, keep=True)
        before = self.ensemble.log_weight.to_numpy()
        flown.fail(self.ensemble, exposed, self._group(flown, self._shared), self.ensemble.log_weight)
        after = self.ensemble.log_weight.to_numpy()
        then, now = self._weighed(before), self._weighed(after)
        evidence = self._evidence(then, now, f'sortie "{sortie.name}"')
        weight = weights.relative(before)
        pos = np.nan_to_num(-np.expm1(evidence))  # a scenario that had no weight finds nothing
        self._missed = self._missed * (1 - pos)
        lost, alive = weight - weights.relative(after, before), None
        if any(s.survival for s in self._spec.scenarios):
            alive = self._mean(lost * self._alive(0.5 * (flown.begin + flown.end)), weight)
        there = np.isin(life.read(self.ensemble).at(flown.end), STRANDED)
        searched = flown.searched()
        effective = self._effective(after, now)
        self._never = (1 - searched if self._never is None else self._never * (1 - searched)).astype(np.float32)
        self._note(
            Update(
                sortie.name, "sortie", sortie.end, evidence, now.scenarios, self._effective(before, then), effective,
                poc=self._mean(np.maximum(weight * searched, lost), weight), pos=pos,
                ashore=self._mean(lost * there, weight), alive=alive,
                cumulative=1 - self._missed, standing=self._standing(sortie.end, after, effective),
            ),
            before,
            after,
        )  # fmt: skip
        self._settle(after.astype(np.float64))

    def _see(self, contact: Contact, time: int, place: PositionsAt) -> None:
        """Change weights by a contact."""
        who, its, begin = self.ensemble, self._scene, None
        if contact.drifter is not None:
            seen = self._debris[contact.drifter]
            who, its, begin = seen.ensemble, seen.scene, seen.begin
        lon, lat = place(who, its, begin, time)
        likelihood = contact_laws.log_likelihood(contact, lon, lat)
        if contact.moves:
            assert self._begin is not None
            assert self._step is not None
            velocity = self._scene.velocity(self.ensemble, self._begin, self._step, time)
            likelihood = likelihood + contact_laws.log_motion(contact, *velocity)
        there = on_map(life.read(who).at(time))
        likelihood = np.where(there, likelihood, -np.inf)
        current = self.log_weight(time)
        # The mean likelihood under all that is known then, which includes sorties under way.
        mean = self._weighed(current + likelihood).log_sum - self._weighed(current).log_sum
        if contact.false_density > 0:
            likelihood = np.logaddexp(likelihood, np.log(contact.false_density))
        elif contact.belief < 1:  # doubt is in units of the mean, so that the evidence stays a density
            if mean == -np.inf:
                likelihood = np.zeros_like(likelihood)
            else:
                with np.errstate(divide="ignore"):
                    doubt = np.log1p(-contact.belief) + mean
                    likelihood = np.logaddexp(np.log(contact.belief) + likelihood, doubt)
        self._tell(contact.name, "contact", time, likelihood, positive=True)

    def _look(self, look: Look, time: int, place: PositionsAt) -> None:
        """Change weights by what a look saw or did not see."""
        lon, lat = place(self.ensemble, self._scene, None, time)
        there = on_map(life.read(self.ensemble).at(time))
        self._tell(look.name, "look", time, looks.log_likelihood(look, lon, lat, there), look.positive)

    def _tell(self, name: str, kind: Kind, time: int, likelihood: Array, positive: bool) -> None:
        """Change weights by the log likelihood (n,) of what was told at a time; positive: of something that was seen."""
        if positive:
            self.unsearched = self.unsearched + likelihood
        before, when = self.ensemble.log_weight.to_numpy(), self._spec.period.time(time)
        after = before + likelihood
        then, now = self._weighed(before), self._weighed(after)
        evidence = self._evidence(then, now, f'{kind} "{name}"')
        effective = self._effective(after, now)
        standing = self._standing(when, after, effective)
        update = Update(
            name, kind, when, evidence, now.scenarios, self._effective(before, then), effective, standing=standing
        )
        self._note(update, before, after)
        self._settle(after, changed=True)

    def _settle(self, log_weight: Array, changed: bool = False) -> None:
        """Bring the sum of weights back to 1 once it is far off.

        Otherwise float32 would lose digits of small differences.
        """
        total = self._weighed(log_weight).log_sum
        if abs(total) > FARTHEST:
            self.ensemble.log_weight.from_numpy((log_weight - total).astype(np.float32))
        elif changed:
            self.ensemble.log_weight.from_numpy(log_weight.astype(np.float32))

    def log_weight(self, time: int) -> Array:
        """Return the weights as they stand at a time, float32 (n,).

        They include what sorties under way have missed until then.
        """
        under_way, said = self._flown(time), self._observers.so_far(time)
        if not under_way:
            only = np.asarray(self.ensemble.log_weight.to_numpy())
            return only if said is None else (only + said).astype(np.float32)
        weight = runtime.copy(self.ensemble.log_weight)
        groups = {(flown.sortie.group, flown.sortie.shape) for flown in under_way}
        shared = {key: runtime.copy(column) for key, column in self._shared.items() if key in groups}
        for flown in under_way:
            flown.fail(self.ensemble, self._exposed(flown, time, keep=False), self._group(flown, shared), weight)
        failed = np.asarray(weight.to_numpy())
        return failed if said is None else (failed + said).astype(np.float32)

    def watch(self, until: int) -> None:
        """See what all sorties and sensors do until the end of the step that has just been made."""
        self._observers.watch(until)
        for flown in self._flown(until):
            self._exposed(flown, until, keep=True)

    def after(self, until: int) -> None:
        """Resample at the end of a step, if the effective particles are fewer than asked for."""
        rule = self._resampling
        changed = self._updates and self._events < len(self._updates)
        if rule.below <= 0 or not changed:
            return
        self._events = len(self._updates)
        ess = record.weighed(self.ensemble).ess
        if ess >= rule.below * sum(self._target):
            return
        ancestors = self._draw(until)
        self._lineage, self._drawn_anew = self._lineage[ancestors], True
        self._ancestors = ancestors if self._ancestors is None else self._ancestors[ancestors]
        weight = self.ensemble.log_weight.to_numpy()
        distinct = len(np.unique(self._lineage[weight > -np.inf])) / sum(self._target)
        self._updates[-1] = replace(self._updates[-1], ess_resampled=self._weighed(weight).ess, distinct=distinct)

    def _draw(self, until: int) -> Array:
        """Replace all particles by offspring, in place; return their ancestors (n,)."""
        e, rule = self.ensemble, self._resampling
        seeds = self._spec.seed, self._events
        before = e.log_weight.to_numpy()
        if rule.across:
            ancestors, log_weight, bounds = resample.across(before, e.scenarios, e.n, seeds)
            spare = np.zeros(e.n, bool)
            for which in (e, *(beside.ensemble for beside in self._debris.values())):
                record.lay(which, bounds)
        else:
            ancestors, log_weight, spare = resample.offspring(before, e.scenarios, self._target, rule.method, seeds)
        with np.errstate(invalid="ignore"):  # spare slots have no weight before or after
            own = self.unsearched[ancestors] - before[ancestors] + log_weight
        self.unsearched = np.where(log_weight > -np.inf, own, -np.inf)
        begun = [flown.exposed.columns for flown in self._waiting if flown.exposed]
        columns = [column for own in begun for column in own] + list(self._shared.values())
        columns += self._observers.columns
        for beside in self._debris.values():
            record.inherit(beside.ensemble, ancestors)
            self._wait_anew(beside.ensemble, until)
        if self._never is not None:
            self._never = self._never[ancestors]
        record.inherit(e, ancestors)
        for column in columns:
            values = column.to_numpy().reshape(-1, e.n)
            column.from_numpy(np.ascontiguousarray(values[:, ancestors]).reshape(-1))
        e.log_weight.from_numpy(log_weight)
        status = np.where(spare, int(Status.LEFT), e.status.to_numpy())
        e.status.from_numpy(status.astype(np.int32))
        self._wait_anew(e, until)
        return ancestors

    def _wait_anew(self, which: Ensemble, time: int) -> None:
        """Let the waits of particles ashore begin at a time, where they refloat.

        A wait is drawn for slot and landing. It has no memory, so that copies may begin theirs anew.
        """
        if self._scene.place.beach.stay > 0:
            ashore, since = which.status.to_numpy() == Status.ASHORE, which.status_since.to_numpy()
            which.status_since.from_numpy(np.where(ashore, time, since).astype(np.int32))

    def ancestors(self) -> Array | None:
        """Return whose offspring the particles are, int64 (n,), since it was last asked.

        Return None if they are themselves.
        """
        ancestors, self._ancestors = self._ancestors, None
        return ancestors

    def _group(self, flown: SortieExposure, columns: dict[tuple[str, float], Device]) -> Device:
        """Return the columns of the misses that share a sortie's unknown factor of sweep width."""
        if len(flown.factors) == 1:
            return self.ensemble.log_weight  # the kernel reads no group then, so any column will do
        key = (flown.sortie.group, flown.sortie.shape)
        if key not in columns:
            columns[key] = runtime.empty(self.ensemble.n * len(flown.factors))
        return columns[key]

    def _evidence(self, then: Weighed, now: Weighed, what: str) -> Array:
        """Return the log of mean weight after over before, by scenario and of all; refuse what no scenario allows."""
        whole = now.log_sum - then.log_sum
        with np.errstate(invalid="ignore"):  # NaN for a scenario that had no weight before
            sums = now.log_sums - then.log_sums
        if not np.isfinite(whole):
            names = ", ".join(f'"{s.name}"' for s in self._spec.scenarios)
            raise UserError(
                f"{what} contradicts every scenario ({names}): after it no particle has any weight, and nothing can be "
                "said. Check its place, time and error, or allow for doubt: a POD or detection below 1, a belief below "
                "1, false alarms, or a wider prior"
            )
        return np.array([*sums, whole])

    def _effective(self, log_weight: Array, weighed: Weighed) -> float:
        """Return the effective number of particles by log weights (n,), copies as one (drift.forecast.effective)."""
        if not self._drawn_anew or log_weight.max() == -np.inf:
            return weighed.ess
        return weights.effective(self.ensemble.blocks.grouped(self._lineage, weights.relative(log_weight)))

    def _weighed(self, log_weight: Array) -> Weighed:
        """Return what is needed of the weights of all particles."""
        return weights.weighed(log_weight, self.ensemble.blocks)

    def _mean(self, part: Array, weight: Array) -> Array:
        """Return a part of the weight as a share, by scenario and of all; 0 where there is no weight."""
        sums = self.ensemble.blocks.partial(part, weight)
        over, under = np.concatenate([sums.by_scenario[:, 0], sums.total]).T
        return np.asarray(np.divide(over, under, out=np.zeros(len(under)), where=under > 0))

    def _alive(self, time: float) -> Array:
        """Return each particle's chance of being alive at a time [s after start]; 1 without survival times."""
        release = self.ensemble.release.to_numpy()
        alive = np.ones(self.ensemble.n)
        for scenario, (a, b) in zip(self._spec.scenarios, self.ensemble.scenarios, strict=True):
            if scenario.survival:
                alive[a:b] = scenario.survival.alive(time - release[a:b])
        return alive

    def _standing(self, time: np.datetime64, log_weight: Array, ess: float) -> Standing:
        """Return how the search stands at a time, by log weights (n,) and their effective number."""
        self._least = min(self._least, ess)
        return standing(time, self.ensemble, log_weight, self._never, self._least, self._spec.period.duration)

    def _note(self, update: Update, before: Array, log_weight: Array) -> None:
        """Take an update down, with the log weights (n,) before and after it."""
        distinct = self._updates[-1].distinct if self._updates else 1.0
        self._updates.append(replace(update, distinct=distinct))
        if self._noted is not None:
            self._noted(self._updates[-1], before, log_weight, self._lineage if self._drawn_anew else None)


def _living(ensemble: Ensemble) -> list[int]:
    """Return how many slots of each scenario hold particles; others are to spare."""
    living = ensemble.status.to_numpy() != Status.LEFT
    counts = np.bincount(ensemble.scenario.to_numpy()[living], minlength=len(ensemble.scenarios))
    return [int(count) for count in counts]
