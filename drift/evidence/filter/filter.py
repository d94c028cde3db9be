"""The filter: what sorties that found nothing, contacts and sensors do to the weights of an
ensemble.

It works while the ensemble moves.

The clock of the forecast tells it of every step. A sortie's exposure grows as it is flown and
changes weights when it ends; an output in between sees what it has done so far. Evidence is the
mean weight after over that before. A sortie that does nothing changes no bit.

The ensemble may be a shard of a run. What it does to a particle it makes of that particle alone;
what takes all of them it asks of its meeting (drift.evidence.filter.meeting), and what is told of
an update is made elsewhere (drift.evidence.filter.account).
"""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.scene import Begin, Scene
from drift.engine.motion.simulate import PositionsAt
from drift.engine.motion.steering import steer
from drift.engine.particles import ensemble as record
from drift.engine.particles import life, weights
from drift.engine.particles.columns import Columns
from drift.engine.particles.ensemble import Ensemble
from drift.engine.particles.status import STRANDED, Status, on_map
from drift.evidence.filter import contacts as contact_laws
from drift.evidence.filter import crossings, filling, overdue
from drift.evidence.filter.account import Account, Event, Noted
from drift.evidence.filter.crossings import Watched
from drift.evidence.filter.debris import debris
from drift.evidence.filter.detection import heard, looks, sight
from drift.evidence.filter.detection.heard import Sent
from drift.evidence.filter.detection.listening import Listening
from drift.evidence.filter.detection.sight import Targets
from drift.evidence.filter.exposure import SortieExposure
from drift.evidence.filter.filling import Cloud, Filling
from drift.evidence.filter.markers import Marker
from drift.evidence.filter.meeting import Alone, Drawn, Meeting, Redrawing
from drift.evidence.filter.observers import Observers
from drift.evidence.filter.records import (
    NO_SENSORS,
    Contact,
    Heard,
    Kind,
    Look,
    Resampling,
    Sensors,
    Sortie,
    Tone,
)
from drift.evidence.filter.updates import Updates
from drift.evidence.sensors import unknown
from geo import sphere
from geo.array import Array
from kernels.runtime import runtime
from kernels.step.advance import Step

Device = Any
Flown = SortieExposure | Listening


class HostColumn:
    """A column that no kernel needs, with a device column's manners."""

    def __init__(self, values: Array) -> None:
        """Hold values (n,)."""
        self.values = values

    def to_numpy(self) -> Array:
        """Return them."""
        return self.values

    def from_numpy(self, values: Array) -> None:
        """Take others."""
        self.values = values


class SearchFilter:
    """Sorties, contacts and sensors of one run, or of a shard of it; of a run in one piece
    `updates` tells afterwards what each did."""

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
        meeting: Meeting | None = None,
        resumed: bool = False,
    ) -> None:
        """Make ready for a run through a scene of an ensemble that has been drawn from `spec`.

        noted: is told of each update as it takes effect. known: when it is known that nothing was
        reported, besides the times of sorties, contacts and sensors. meeting: with the other shards
        of the run; None: this is all of it. resumed: whether the particles' columns are still to
        come from elsewhere, and `resume` is to be called.
        """
        self._spec, self._resampling, self.ensemble, self._scene = spec, resampling, ensemble, scene
        self._start = spec.period.epoch
        self._all = exposures(spec, sorties, scene)
        self._waiting = list(self._all)
        # values that stand for each unknown
        self._factors = {flown.key: len(flown.factors) for flown in self._all}
        self._contacts = [
            (spec.period.elapsed(contact.time), number, contact)
            for number, contact in enumerate(contacts)
        ]
        self._shared: dict[tuple[str, float], Device] = {}
        self._step: Step | None = None
        self._begin: Begin | None = None  # where the particles began the present step
        self._looks = [(spec.period.elapsed(look.time), look) for look in sensors.looks]
        self._factors |= self._by_sensors()
        self._observers = Observers(spec, sensors, ensemble, scene)
        heard = [*known, *sensors.times, *(contact.time for contact in contacts)]
        heard += [time for sortie in sorties for time in (sortie.start, sortie.end)]
        self._begins = overdue.begins(spec)
        self._overdue = overdue.times(spec, [spec.period.elapsed(time) for time in heard])
        self._debris = debris.of_contacts(
            spec,
            [(time, seen) for time, _, seen in self._contacts],
            scene,
            ensemble,
            resumed=resumed,
        )
        first = self.ensemble.log_weight.to_numpy()
        # What no kernel needs: "unsearched", log weights (n,) by all that was seen, as if no sortie
        # had been flown; "never", product over sorties of the share of time that a particle was not
        # searched; "lineage", the particle of the begin from which each descends, and "ancestors",
        # of those at the last output; without a column: itself.
        self._held = {"unsearched": HostColumn(first.astype(np.float64))}
        self._happened = False  # whether anything took effect in the present step
        # particles that the last contact leaves nothing (n,)
        self._contradicted = np.zeros(0, bool)
        self._filling: Filling | None = None
        if resampling.fills:
            self._filling = filling.of_run(resampling, spec, scene.place.coast)
        if meeting is None:
            self._account = Account(spec, noted)
            self._account.begin(Columns.held(ensemble.blocks, {"log_weight": first}))
            meeting = Alone(self._account, Redrawing(spec.seed, resampling, living(ensemble)))
        self._meeting = meeting

    @property
    def updates(self) -> Updates:
        """What has happened so far, with sorties as they were flown."""
        flown = [partial(sortie.as_flown, start=self._start) for sortie in self._all]
        crossed, lines = None, self.watched
        if lines:
            columns = {
                "log_weight": self.ensemble.log_weight.to_numpy(),
                **crossings.columns_of(lines),
            }
            crossed = crossings.build_crossings(
                self._spec,
                [seen.line for seen in lines],
                Columns.held(self.ensemble.blocks, columns),
            )
        return self._account.told(flown, crossed)

    @property
    def unsearched(self) -> Columns:
        """Log weights of that name by all that was seen, as if no sortie had been flown, float64."""
        return Columns.held(self.ensemble.blocks, {"unsearched": self._held["unsearched"].values})

    @property
    def watched(self) -> list[Watched]:
        """The lines whose crossing is to be told, and what they have seen so far."""
        return self._observers.watched()

    @property
    def markers(self) -> list[Marker]:
        """What drifts with its patterns, whose ways lead on."""
        return [marker for flown in self._all for marker in flown.markers]

    @property
    def columns(self) -> dict[str, Device]:
        """All that a particle has, by names that `column` knows; those of several values have them
        one after another.
        """
        found = {f"particle {name}": column for name, column in self.ensemble.columns.items()}
        for number, beside in enumerate(self._debris.values()):
            found |= {
                f"debris {number} {name}": column
                for name, column in beside.ensemble.columns.items()
            }
        for number, flown in enumerate(self._all):
            if flown.exposed is not None:
                found |= {
                    f"sortie {number} {name}": column
                    for name, column in flown.exposed.columns.items()
                }
        for key, column in self._shared.items():
            found[f"shared {self._groups.index(key)}"] = column
        return found | self._observers.columns | self._held

    def column(self, name: str) -> Device:
        """Return a column by its name, made where it is not there yet."""
        kind, *which = name.split(" ")
        if kind == "particle":
            return self.ensemble.columns[which[0]]
        if kind == "debris":
            return list(self._debris.values())[int(which[0])].ensemble.columns[which[1]]
        if kind == "sortie":
            return (
                self._all[int(which[0])]
                .ready(self.ensemble, self._scene.steering is not None)
                .columns[which[1]]
            )
        if kind == "shared":
            key = self._groups[int(which[0])]
            return self._shared.setdefault(key, runtime.empty(self.ensemble.n * self._factors[key]))
        if kind == "sensor":
            return self._observers.column(int(which[0]), int(which[1]))
        return self._held.setdefault(kind, HostColumn(np.empty(0)))

    @property
    def _groups(self) -> list[tuple[str, float]]:
        """The groups of sorties and looks that share an unknown."""
        return list(self._factors)

    def resume(self, time: int) -> None:
        """Go on from a time at which a step begins: sorties that were over by then are past [s
        after start].
        """
        self._waiting = [flown for flown in self._waiting if flown.end > time]
        self._observers.over_by(time)

    def stops(self, after: int, until: int, step: Step | None = None) -> list[int]:
        """Return the times in (after, until] at which an update takes effect [s after start]; step:
        the step between the two.
        """
        times = [flown.end for flown in self._waiting] + self._overdue
        times += [time for time, _, _ in self._contacts] + [time for time, _ in self._looks]
        return sorted(
            {t for t in times if after < t <= until} | self._observers.stops(after, until, step)
        )

    def rests(self, step: Step) -> bool:
        """Return whether nothing looks on or takes effect in a step."""
        end = step.elapsed + step.duration
        return not (
            self._looks_on(step.elapsed, end) or self.stops(max(step.elapsed, 0), end, step)
        )

    def before(self, elapsed: int, duration: int) -> bool:
        """Take the markers of sorties over a step, for which the forcing is set; return whether any
        is flown in it.
        """
        self._meeting.begin(elapsed, elapsed + duration)
        for flown in self._flown(elapsed + duration):
            flown.drift(self._scene.forcing, elapsed, duration)
        return self._looks_on(elapsed, elapsed + duration)

    def _looks_on(self, elapsed: int, end: int) -> bool:
        """Return whether something asks where the particles begin a step between two times."""
        debris = any(beside.last > elapsed for beside in self._debris.values())
        moving = any(
            elapsed < when <= end and heard.asks_velocity(contact)
            for when, _, contact in self._contacts
        )
        moving |= any(
            elapsed < when <= end and sight.by_speed(look.sensor) for when, look in self._looks
        )
        return bool(self._flown(end)) or debris or moving or self._observers.looking(end)

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

    def _flown(self, until: int) -> list[Flown]:
        """Return the sorties that have begun before a time and are not over."""
        return [flown for flown in self._waiting if flown.begin < until]

    def _exposed(self, flown: Flown, until: int, keep: bool) -> Any:
        assert self._begin is not None
        assert self._step is not None
        return flown.expose(
            self.ensemble, self._begin, self._scene.helm(self.ensemble), self._step, until, keep
        )

    def take_effect(self, time: int, place: PositionsAt) -> None:
        """Change weights by all that ends or is seen at a time.

        place: gives where an ensemble's particles were then.
        """
        asked = any(when == time and contact.drifter is None for when, _, contact in self._contacts)
        asked |= any(when == time for when, _ in self._looks)
        if asked or self._observers.stops(time - 1, time, self._step):
            self._observers.cut(time, place)
        for flown in [f for f in self._waiting if f.end == time]:
            self._fail(flown)
            self._waiting.remove(flown)
            flown.exposed = None
            self._forget(flown.key)
        for when, number, contact in [c for c in self._contacts if c[0] == time]:
            self._contacts.remove((when, number, contact))
            self._see(contact, number, time, place)
            if self._filling is not None and filling.bounded(contact):
                self._fill(self._filling, contact, number, time)
        for when, look in [c for c in self._looks if c[0] == time]:
            self._looks.remove((when, look))
            self._look(look, time, place)
        if time in self._overdue:
            missing = overdue.log_likelihood(self._spec, time, self.ensemble)
            told = time in self._begins  # later only if that is news to any particle
            self._tell(
                overdue.name(self._spec, time),
                "overdue",
                time,
                missing,
                positive=True,
                certain=told,
            )
        for seen in self._observers.over(time):
            likelihood = seen.likelihood(seen.ready(self.ensemble.n), over=True)
            assert likelihood is not None
            self._tell(seen.what.name, seen.kind, time, likelihood, seen.positive)

    def _fill(self, how: Filling, contact: Contact, number: int, time: int) -> None:
        """Place particles again that a contact at the end of a step rules out, if it leaves too
        few.
        """
        e, own = self.ensemble, self.ensemble.columns
        lon, lat = (own[name].to_numpy() * sphere.UNIT for name in ("lon", "lat"))
        cloud = Cloud(
            lon,
            lat,
            own["speed"].to_numpy().astype(np.float64),
            e.log_weight.to_numpy().astype(np.float64),
        )
        placed = how.anew(contact, number, time, cloud, self._contradicted, e.layout)
        if placed is None:
            return
        assert isinstance(self._meeting, Alone)
        if not placed.slots.size:  # it is ashore
            self._meeting.account.lost()
            return
        steer.place_targets(e, placed.slots, vars(placed), time)
        before = e.log_weight.to_numpy()
        new = placed.log_weight.astype(np.float32)
        e.log_weight.from_numpy(new)
        with np.errstate(invalid="ignore"):  # what finds no water has no weight before or after
            unsearched = np.where(
                new > -np.inf, self._held["unsearched"].values + new - before, -np.inf
            )
        unsearched[placed.slots] = new[placed.slots]  # nothing was searched where they are
        self._held["unsearched"].values = unsearched
        for name, values in (("never", 1), ("lineage", placed.slots)):  # they descend from nobody
            if name in self._held:
                # an output may hold the old ones
                self._held[name].values = self._held[name].values.copy()
                self._held[name].values[placed.slots] = values
        self._meeting.account.filled(new, e.layout)

    def _forget(self, key: tuple[str, float]) -> None:
        """Let go of the misses of a group of which nobody is to come."""
        if key not in self._keys():
            self._shared.pop(key, None)

    def _keys(self) -> dict[tuple[str, float], int]:
        """Number of quadrature nodes for the unknown of each pending group."""
        keys = {flown.key: len(flown.factors) for flown in self._waiting}
        return keys | self._by_sensors()

    def _by_sensors(self) -> dict[tuple[str, float], int]:
        """Number of quadrature nodes for each pending sensor group's unknown."""
        sensors = [look.sensor for _, look in self._looks if look.sensor]
        sensors += [contact.heard.sensor for _, _, contact in self._contacts if contact.heard]
        return {unknown.key(sensor): len(unknown.values(sensor)[1]) for sensor in sensors}

    def _fail(self, flown: Flown) -> None:
        """Change weights because a sortie found nothing."""
        sortie, exposed = flown.sortie, self._exposed(flown, flown.end, keep=True)
        before = self.ensemble.log_weight.to_numpy()
        flown.fail(
            self.ensemble, exposed, self._group(flown, self._shared), self.ensemble.log_weight
        )
        searched = flown.searched()
        never = self._held.setdefault("never", HostColumn(np.ones(self.ensemble.n, np.float32)))
        never.values = (never.values * (1 - searched)).astype(np.float32)
        there = np.isin(life.read_lives(self.ensemble).at(flown.end), STRANDED)
        self._note(
            sortie.name,
            "sortie",
            sortie.end,
            before,
            self.ensemble.log_weight.to_numpy(),
            {"searched": searched, "there": there},
            middle=0.5 * (flown.begin + flown.end),
        )

    def _see(self, contact: Contact, number: int, time: int, place: PositionsAt) -> None:
        """Change weights by a contact."""
        who, its, begin = self.ensemble, self._scene, None
        if contact.drifter is not None:
            seen = self._debris[contact.drifter]
            who, its, begin = seen.ensemble, seen.scene, seen.begin
        lon, lat = place(who, its, begin, time)
        status, unit = life.read_lives(who).at(time), contact_laws.log_unit(contact)
        if contact.heard is not None:
            self._hear(
                contact,
                contact.heard,
                number,
                time,
                self._targets(lon, lat, status, contact, time),
                unit,
            )
            return
        likelihood = contact_laws.log_likelihood(contact, lon, lat)
        if contact.moves:
            likelihood = likelihood + contact_laws.log_motion(contact, *self._velocity(time))
        likelihood = np.where(on_map(status), likelihood, -np.inf)
        likelihood = self._allowed(contact, likelihood, unit)
        doubted, unit = self._doubted(contact, number, time, likelihood, likelihood, unit)
        self._tell(contact.name, "contact", time, doubted - unit, positive=True, unit=unit)

    def _hear(
        self, contact: Contact, own: Heard, number: int, time: int, targets: Targets, unit: float
    ) -> None:
        """Change weights by a contact of a sensor of the case; unit: log of what its likelihood is
        about.
        """
        sent = self._sent(own.tone) if own.tone and own.tone.group else None
        said = heard.log_likelihood(contact, targets, sent)
        if contact.moves:
            said = said + contact_laws.log_motion(contact, targets.east, targets.north)
        key, chances = unknown.key(own.sensor), unknown.values(own.sensor)[1]
        many = len(chances)
        if many > 1:
            shared = self._shared.setdefault(key, runtime.empty(self.ensemble.n * many))
            before = shared.to_numpy().reshape(said.shape).astype(np.float64)
            likelihood = sight.averaged(said, before, chances)
        else:
            likelihood = said[0]
        said, unit = self._doubted(contact, number, time, said, likelihood, unit)
        if sent is not None and own.tone:
            self._learn(own.tone, heard.learned(contact, targets, sent))
        said = said - unit
        told = self._allowed(
            contact, sight.together(said, shared, chances) if many > 1 else said[0], 0.0
        )
        self._tell(contact.name, "contact", time, told, positive=True, unit=unit)
        self._forget(key)

    def _allowed(self, contact: Contact, likelihood: Array, unit: float) -> Array:
        """Return the log likelihoods of a contact (n,), with a floor above its `unit` where
        particles are placed again at contacts.
        """
        if self._filling is None or not filling.bounded(contact):
            return likelihood
        self._contradicted = likelihood - unit <= filling.FLOOR
        return np.maximum(likelihood, unit + filling.FLOOR)

    def _doubted(
        self, contact: Contact, number: int, time: int, said: Array, likelihood: Array, unit: float
    ) -> tuple[Array, float]:
        """Return the log likelihoods `said` of a contact that may be false, and the log of their
        unit.

        likelihood: the same if it is of the object, whatever the unknown, (n,).
        """
        if contact.false_density > 0:
            return np.logaddexp(said, np.log(contact.false_density)), unit
        if contact.belief == 1:
            return said, unit
        # Doubt is in units of the mean under all that is known then, sorties under way too.
        current, blocks = self.log_weight(time), self.ensemble.blocks
        both = weights.weighed(current, blocks), weights.weighed(current + likelihood, blocks)
        unit = self._meeting.mean(number, *both)
        if unit == -np.inf:
            return np.zeros_like(said), 0.0
        with np.errstate(divide="ignore"):
            return np.logaddexp(
                np.log(contact.belief) + said, np.log1p(-contact.belief) + unit
            ), unit

    def _targets(
        self, lon: Array, lat: Array, status: Array, contact: Contact, time: int
    ) -> Targets:
        """Return the particles as a sensor of the case asks for them."""
        still = np.zeros(lon.shape)
        east, north = self._velocity(time) if heard.asks_velocity(contact) else (still, still)
        return Targets(lon, lat, self.ensemble.scenario.to_numpy(), east, north, status)

    def _velocity(self, time: int) -> tuple[Array, Array]:
        """Return (east, north) [m/s] of the particles at a time inside the step just made."""
        assert self._begin is not None
        assert self._step is not None
        return self._scene.velocity(self.ensemble, self._begin, self._step, time)

    def _sent(self, tone: Tone) -> Sent:
        """Return what is known of the frequency that each particle sends, by all contacts of a
        group so far.
        """
        first = heard.at_first(tone, self.ensemble.n)
        held = (
            self._held.setdefault(name, HostColumn(values))
            for name, values in zip(_tone_names(tone), first, strict=True)
        )
        return Sent(*(column.values for column in held))

    def _learn(self, tone: Tone, sent: Sent) -> None:
        """Take down what is known of it after a contact."""
        for name, values in zip(_tone_names(tone), sent, strict=True):
            self._held[name].values = values

    def _look(self, look: Look, time: int, place: PositionsAt) -> None:
        """Change weights by what a look saw or did not see."""
        lon, lat = place(self.ensemble, self._scene, None, time)
        status = life.read_lives(self.ensemble).at(time)
        if look.sensor is None:
            self._tell(
                look.name,
                "look",
                time,
                looks.log_likelihood(look, lon, lat, on_map(status)),
                look.positive,
            )
            return
        still = np.zeros(lon.shape)
        east, north = self._velocity(time) if sight.by_speed(look.sensor) else (still, still)
        source = Targets(lon, lat, self.ensemble.scenario.to_numpy(), east, north, status)
        said = sight.log_likelihood(look, source)
        chances = unknown.values(look.sensor)[1]
        if len(chances) == 1:
            self._tell(look.name, "look", time, said[0], look.positive)
            return
        key = unknown.key(look.sensor)
        shared = self._shared.setdefault(key, runtime.empty(self.ensemble.n * len(chances)))
        self._tell(look.name, "look", time, sight.together(said, shared, chances), look.positive)
        self._forget(key)

    def _tell(
        self,
        name: str,
        kind: Kind,
        time: int,
        likelihood: Array,
        positive: bool,
        unit: float = 0.0,
        certain: bool = True,
    ) -> None:
        """Change weights by the log likelihood (n,) of what was told at a time; positive: of
        something that was seen.

        unit: log of what the likelihood is in units of; certain: whether it is told even if it says
        nothing new.
        """
        if positive:
            self._held["unsearched"].values = self._held["unsearched"].values + likelihood
        before = self.ensemble.log_weight.to_numpy()
        after = before + likelihood
        self.ensemble.log_weight.from_numpy(after.astype(np.float32))
        self._note(
            name, kind, self._spec.period.time(time), before, after, {}, unit=unit, certain=certain
        )

    def _note(
        self,
        name: str,
        kind: Kind,
        time: np.datetime64,
        before: Array,
        after: Array,
        more: Mapping[str, Array],
        *,
        unit: float = 0.0,
        middle: float = 0.0,
        certain: bool = True,
    ) -> None:
        """Hand an update over, with the log weights (n,) before and after it."""
        held = {
            key: self._held[key].values
            for key in list[str](("lineage", "never"))
            if key in self._held
        }
        own = {"before": before, "after": after, "release": self.ensemble.release.to_numpy()}
        columns = Columns.held(self.ensemble.blocks, {**own, **held, **more})
        self._meeting.take(Event(name, kind, time, columns, unit, middle, certain))
        self._happened = True

    def log_weight(self, time: int) -> Array:
        """Return the weights as they stand at a time, float32 (n,).

        They include what sorties under way have missed until then.
        """
        under_way, said = self._flown(time), self._observers.so_far(time)
        if not under_way:
            only = np.asarray(self.ensemble.log_weight.to_numpy())
            return only if said is None else (only + said).astype(np.float32)
        weight = runtime.copy(self.ensemble.log_weight)
        groups = {flown.key for flown in under_way}
        shared = {
            key: runtime.copy(column) for key, column in self._shared.items() if key in groups
        }
        for flown in under_way:
            flown.fail(
                self.ensemble,
                self._exposed(flown, time, keep=False),
                self._group(flown, shared),
                weight,
            )
        failed = np.asarray(weight.to_numpy())
        return failed if said is None else (failed + said).astype(np.float32)

    def watch(self, until: int) -> None:
        """See what all sorties and sensors do until the end of the step that has just been made."""
        self._observers.watch(until)
        for flown in self._flown(until):
            self._exposed(flown, until, keep=True)

    def after(self, until: int) -> None:
        """Resample at the end of a step, if the effective particles are fewer than asked for.

        Particles that are guided toward a find wait for it: their weights go by the noise that they
        are still to meet.
        """
        if self._scene.guided is not None and until < self._scene.guided.until:
            return
        happened, self._happened = self._happened, False
        if self._resampling.below <= 0 or not happened:
            return
        drawn = self._meeting.anew(self.ensemble.log_weight.to_numpy(), self.ensemble.layout)
        if drawn is not None:
            self.redraw(drawn, until)
            assert isinstance(self._meeting, Alone)
            self._meeting.drawn(
                drawn.log_weight, self._held["lineage"].values, self.ensemble.layout
            )

    def redraw(self, drawn: Drawn, until: int) -> None:
        """Draw all particles of a run again at a time [s after start]."""
        record.inherit(self.columns.values(), drawn.ancestors)
        self.begin_anew(drawn, until)

    def begin_anew(self, drawn: Drawn, until: int) -> None:
        """Make particles of what has been copied from their ancestors at a time [s after start]."""
        e = self.ensemble
        every = [e, *(beside.ensemble for beside in self._debris.values())]
        with np.errstate(invalid="ignore"):  # spare slots have no weight before or after
            own = self._held["unsearched"].values - e.log_weight.to_numpy() + drawn.log_weight
        self._held["unsearched"].values = np.where(drawn.log_weight > -np.inf, own, -np.inf)
        for name in ("lineage", "ancestors"):
            self._held.setdefault(name, HostColumn(drawn.ancestors.astype(np.int32)))
        e.log_weight.from_numpy(drawn.log_weight)
        e.status.from_numpy(
            np.where(drawn.spare, int(Status.LEFT), e.status.to_numpy()).astype(np.int32)
        )
        for which in every:
            which.layout = drawn.layout
            self._wait_anew(which, until)

    def _wait_anew(self, which: Ensemble, time: int) -> None:
        """Let the waits of particles ashore begin at a time, where they refloat.

        A wait is drawn for slot and landing. It has no memory, so that copies may begin theirs
        again.
        """
        if self._scene.place.beach.stay > 0:
            ashore, since = which.status.to_numpy() == Status.ASHORE, which.status_since.to_numpy()
            which.status_since.from_numpy(np.where(ashore, time, since).astype(np.int32))

    def ancestors(self) -> Array | None:
        """Return whose offspring the particles are, slots of the whole run (n,), since it was last
        asked.

        Return None if they are themselves.
        """
        held = self._held.pop("ancestors", None)
        return None if held is None else held.values

    def lineage(self) -> Array | None:
        """Return the particle of the begin from which each descends, int32 (n,); None: itself."""
        held = self._held.get("lineage")
        return None if held is None else held.values

    def _group(self, flown: Flown, columns: dict[tuple[str, float], Device]) -> Device:
        """Return the columns of the misses that share a sortie's unknown factor of sweep width."""
        if len(flown.factors) == 1:
            return self.ensemble.log_weight  # the kernel reads no group then, so any column will do
        key = flown.key
        if key not in columns:
            columns[key] = runtime.empty(self.ensemble.n * len(flown.factors))
        return columns[key]


def _tone_names(tone: Tone) -> tuple[str, str]:
    """Return the names of the columns of what is known of a frequency; a name of a column has no
    blanks.
    """
    group = tone.group.replace(" ", "_")
    return f"precision:{group}", f"turned:{group}"


def exposures(spec: EnsembleSpec, sorties: Sequence[Sortie], scene: Scene) -> list[Flown]:
    """Return sorties made ready to be flown in a scene."""
    seas = scene.seas("current")
    members = [scene.forcing.members(sea[0], "current") for sea in seas]
    return [
        Listening(sortie, spec.period.epoch)
        if sortie.sensor is not None
        else SortieExposure(sortie, spec.period.epoch, seas, members)
        for sortie in sorties
    ]


def living(ensemble: Ensemble) -> list[int]:
    """Return how many slots of each scenario hold particles; others are to spare."""
    living = ensemble.status.to_numpy() != Status.LEFT
    counts = np.bincount(ensemble.scenario.to_numpy()[living], minlength=len(ensemble.scenarios))
    return [int(count) for count in counts]
