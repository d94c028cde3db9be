"""The particle filter: weight updates by sorties without a find, contacts and sensors.

The filter works while the ensemble moves: the forecast clock calls it at every step. The exposure
of a sortie grows while it is flown, and changes the weights when the sortie ends; an output in
between includes the exposure so far. The evidence of an update is the mean weight after it over the
mean weight before it. A sortie without effect changes no bit.

The ensemble may be one shard of a run. Per-particle updates use that particle alone. Operations
over the whole ensemble go through `Meeting` (drift.evidence.filter.meeting), a reduction across
shards; the summary of each update is built in drift.evidence.filter.account.
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
from drift.evidence.filter.account import Account, Event, UpdateCallback
from drift.evidence.filter.crossings import Watched
from drift.evidence.filter.debris import debris
from drift.evidence.filter.detection import heard, looks, sight
from drift.evidence.filter.detection.heard import Sent
from drift.evidence.filter.detection.listening import Listening
from drift.evidence.filter.detection.sight import Targets
from drift.evidence.filter.exposure import SortieExposure
from drift.evidence.filter.filling import BulkRepopulation, ParticleCloud
from drift.evidence.filter.markers import Marker
from drift.evidence.filter.meeting import LocalReduction, Reduction, Resampled, ResamplingRule
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
    """A host column with the interface of a device column, for values that no kernel reads."""

    def __init__(self, values: Array) -> None:
        """Store values (n,)."""
        self.values = values

    def to_numpy(self) -> Array:
        """Return the values (n,)."""
        return self.values

    def from_numpy(self, values: Array) -> None:
        """Replace the values by others (n,)."""
        self.values = values


class SearchFilter:
    """Sorties, contacts and sensors of one run, or of a shard of a run.

    For a run in one piece, `updates` reports afterwards what each of them did.
    """

    def __init__(
        self,
        spec: EnsembleSpec,
        sorties: Sequence[Sortie],
        contacts: Sequence[Contact],
        resampling: Resampling,
        ensemble: Ensemble,
        scene: Scene,
        sensors: Sensors = NO_SENSORS,
        noted: UpdateCallback | None = None,
        known: Sequence[np.datetime64] = (),
        meeting: Reduction | None = None,
        resumed: bool = False,
    ) -> None:
        """Set up the filter for an ensemble drawn from `spec` that moves through a scene.

        Args:
            spec: what the ensemble was drawn from.
            sorties: searches without a find.
            contacts: sightings of the object or of its debris.
            resampling: when and how particles are resampled.
            ensemble: the particles of the run or of the shard.
            scene: forcing, coast and steering of the run.
            sensors: looks, presences, barriers and lines.
            noted: callback for each update as it takes effect.
            known: further times at which nothing was reported, besides the times of sorties,
                contacts and sensors.
            meeting: the reduction across the shards of the run; None: this is the whole run.
            resumed: whether the columns of the particles are loaded later, by a call of `resume`.
        """
        self._spec, self._resampling, self.ensemble, self._scene = spec, resampling, ensemble, scene
        self._start = spec.period.epoch
        self._all = create_exposures(spec, sorties, scene)
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
        self._factors |= self._nodes_of_sensor_groups()
        self._observers = Observers(spec, sensors, ensemble, scene)
        heard = [*known, *sensors.times, *(contact.time for contact in contacts)]
        heard += [time for sortie in sorties for time in (sortie.start, sortie.end)]
        self._begins = overdue.overdue_deadlines(spec)
        self._overdue = overdue.overdue_update_times(
            spec, [spec.period.elapsed(time) for time in heard]
        )
        self._debris = debris.of_contacts(
            spec,
            [(time, seen) for time, _, seen in self._contacts],
            scene,
            ensemble,
            resumed=resumed,
        )
        first = self.ensemble.log_weight.to_numpy()
        # Host columns: "unsearched", log weights (n,) by all positive evidence, as if no sortie had
        # been flown; "never", product over sorties of the share of time that a particle was not
        # searched; "lineage", the initial particle from which each descends; "ancestors", the same
        # for the particles of the last output. Without a column, each particle is its own ancestor.
        self._host_columns = {"unsearched": HostColumn(first.astype(np.float64))}
        self._updated = False  # whether anything took effect in the present step
        # bool (n,): particles that the last contact rules out
        self._ruled_out = np.zeros(0, bool)
        self._filling: BulkRepopulation | None = None
        if resampling.fills:
            self._filling = filling.bulk_repopulation_of(resampling, spec, scene.place.coast)
        if meeting is None:
            self._account = Account(spec, noted)
            self._account.begin(Columns.held(ensemble.blocks, {"log_weight": first}))
            meeting = LocalReduction(
                self._account, ResamplingRule(spec.seed, resampling, occupied_slots(ensemble))
            )
        self._meeting = meeting

    @property
    def updates(self) -> Updates:
        """All updates so far, with the sorties as they were flown."""
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
        """Log weights by all positive evidence, as if no sortie had been flown, float64."""
        return Columns.held(
            self.ensemble.blocks, {"unsearched": self._host_columns["unsearched"].values}
        )

    @property
    def watched(self) -> list[Watched]:
        """The lines whose crossings are reported, with their observations so far."""
        return self._observers.watched()

    @property
    def markers(self) -> list[Marker]:
        """The datum markers of drifting patterns whose tracks are simulated."""
        return [marker for flown in self._all for marker in flown.markers]

    @property
    def columns(self) -> dict[str, Device]:
        """All columns of the particles, by the names that `column` accepts.

        A column with several values per particle stores one block of n after another.
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
        return found | self._observers.columns | self._host_columns

    def column(self, name: str) -> Device:
        """Return a column by its name; create it if it does not exist yet."""
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
        return self._host_columns.setdefault(kind, HostColumn(np.empty(0)))

    @property
    def _groups(self) -> list[tuple[str, float]]:
        """Keys of the groups of sorties and looks that share an unknown factor."""
        return list(self._factors)

    def resume(self, time: int) -> None:
        """Skip the sorties and sensors that ended by the start of a step [s after start]."""
        self._waiting = [flown for flown in self._waiting if flown.end > time]
        self._observers.drop_ended(time)

    def stops(self, after: int, until: int, step: Step | None = None) -> list[int]:
        """Return the times in (after, until] at which an update takes effect [s after start].

        step: the step between the two times.
        """
        times = [flown.end for flown in self._waiting] + self._overdue
        times += [time for time, _, _ in self._contacts] + [time for time, _ in self._looks]
        return sorted(
            {t for t in times if after < t <= until} | self._observers.stops(after, until, step)
        )

    def rests(self, step: Step) -> bool:
        """Return whether a step has no active sensor and no update."""
        end = step.elapsed + step.duration
        return not (
            self._needs_start_positions(step.elapsed, end)
            or self.stops(max(step.elapsed, 0), end, step)
        )

    def before(self, elapsed: int, duration: int) -> bool:
        """Move the datum markers over a step; return whether positions at its start are needed.

        The forcing must be set for the step.
        """
        self._meeting.begin(elapsed, elapsed + duration)
        for flown in self._begun_sorties(elapsed + duration):
            flown.drift(self._scene.forcing, elapsed, duration)
        return self._needs_start_positions(elapsed, elapsed + duration)

    def _needs_start_positions(self, elapsed: int, end: int) -> bool:
        """Return whether an update needs the particles' positions at the start of a step."""
        debris = any(beside.last > elapsed for beside in self._debris.values())
        moving = any(
            elapsed < when <= end and heard.asks_velocity(contact)
            for when, _, contact in self._contacts
        )
        moving |= any(
            elapsed < when <= end and sight.level_depends_on_speed(look.sensor)
            for when, look in self._looks
        )
        return bool(self._begun_sorties(end)) or debris or moving or self._observers.looking(end)

    def moved(self, begin: Begin | None) -> None:
        """Store where the particles began the step just made, and move the debris over it."""
        self._begin = begin
        self._observers.moved(begin)
        assert self._step is not None
        for beside in self._debris.values():
            if beside.last > self._step.elapsed:
                beside.advance(self.ensemble, begin, self._step)

    def ready(self, step: Step) -> None:
        """Prepare the observers for a step."""
        self._step = step
        self._observers.before(step)

    def _begun_sorties(self, until: int) -> list[Flown]:
        """Return the sorties that begin before a time and have not ended."""
        return [flown for flown in self._waiting if flown.begin < until]

    def _exposure_until(self, flown: Flown, until: int, keep: bool) -> Any:
        """Return the exposure of the particles to a sortie until a time in the step just made."""
        assert self._begin is not None
        assert self._step is not None
        return flown.expose(
            self.ensemble, self._begin, self._scene.helm(self.ensemble), self._step, until, keep
        )

    def apply_evidence(self, time: int, place: PositionsAt) -> None:
        """Update the weights by everything that ends or is observed at a time.

        Args:
            time: of the updates [s after start].
            place: returns the positions of an ensemble's particles at that time.
        """
        asked = any(when == time and contact.drifter is None for when, _, contact in self._contacts)
        asked |= any(when == time for when, _ in self._looks)
        if asked or self._observers.stops(time - 1, time, self._step):
            self._observers.cut(time, place)
        for flown in [f for f in self._waiting if f.end == time]:
            self._apply_sortie(flown)
            self._waiting.remove(flown)
            flown.exposed = None
            self._free_shared_misses(flown.key)
        for when, number, contact in [c for c in self._contacts if c[0] == time]:
            self._contacts.remove((when, number, contact))
            self._apply_contact(contact, number, time, place)
            if self._filling is not None and filling.bounds_position(contact):
                self._repopulate(self._filling, contact, number, time)
        for when, look in [c for c in self._looks if c[0] == time]:
            self._looks.remove((when, look))
            self._apply_look(look, time, place)
        if time in self._overdue:
            missing = overdue.log_likelihood(self._spec, time, self.ensemble)
            newly_overdue = time in self._begins  # later only if that is news to any particle
            self._apply_likelihood(
                overdue.overdue_update_name(self._spec, time),
                "overdue",
                time,
                missing,
                positive=True,
                certain=newly_overdue,
            )
        for seen in self._observers.over(time):
            likelihood = seen.likelihood(seen.ready(self.ensemble.n), over=True)
            assert likelihood is not None
            self._apply_likelihood(seen.what.name, seen.kind, time, likelihood, seen.positive)

    def _repopulate(self, how: BulkRepopulation, contact: Contact, number: int, time: int) -> None:
        """Repopulate the particles that a contact rules out, if too few survive."""
        e, own = self.ensemble, self.ensemble.columns
        lon, lat = (own[name].to_numpy() * sphere.UNIT for name in ("lon", "lat"))
        cloud = ParticleCloud(
            lon,
            lat,
            own["speed"].to_numpy().astype(np.float64),
            e.log_weight.to_numpy().astype(np.float64),
        )
        placed = how.anew(contact, number, time, cloud, self._ruled_out, e.layout)
        if placed is None:
            return
        assert isinstance(self._meeting, LocalReduction)
        if not placed.slots.size:  # every possible position is on land
            self._meeting.account.lost()
            return
        steer.place_targets(e, placed.slots, vars(placed), time)
        before = e.log_weight.to_numpy()
        new = placed.log_weight.astype(np.float32)
        e.log_weight.from_numpy(new)
        # particles for which no water was found have no weight before or after
        with np.errstate(invalid="ignore"):
            unsearched = np.where(
                new > -np.inf, self._host_columns["unsearched"].values + new - before, -np.inf
            )
        unsearched[placed.slots] = new[placed.slots]  # new positions have not been searched
        self._host_columns["unsearched"].values = unsearched
        for name, values in (("never", 1), ("lineage", placed.slots)):  # they have no ancestor
            if name in self._host_columns:
                # an output may still refer to the old values
                self._host_columns[name].values = self._host_columns[name].values.copy()
                self._host_columns[name].values[placed.slots] = values
        self._meeting.account.filled(new, e.layout)

    def _free_shared_misses(self, key: tuple[str, float]) -> None:
        """Free the shared misses of a group that has no pending sortie, look or contact."""
        if key not in self._nodes_of_pending_groups():
            self._shared.pop(key, None)

    def _nodes_of_pending_groups(self) -> dict[tuple[str, float], int]:
        """Return the number of quadrature nodes for the unknown of each pending group."""
        keys = {flown.key: len(flown.factors) for flown in self._waiting}
        return keys | self._nodes_of_sensor_groups()

    def _nodes_of_sensor_groups(self) -> dict[tuple[str, float], int]:
        """Return the number of quadrature nodes for the unknown of each pending sensor group."""
        sensors = [look.sensor for _, look in self._looks if look.sensor]
        sensors += [contact.heard.sensor for _, _, contact in self._contacts if contact.heard]
        return {unknown.key(sensor): len(unknown.values(sensor)[1]) for sensor in sensors}

    def _apply_sortie(self, flown: Flown) -> None:
        """Update the weights for a sortie that found nothing."""
        sortie, exposed = flown.sortie, self._exposure_until(flown, flown.end, keep=True)
        before = self.ensemble.log_weight.to_numpy()
        flown.fail(
            self.ensemble,
            exposed,
            self._shared_misses(flown, self._shared),
            self.ensemble.log_weight,
        )
        searched = flown.searched()
        never = self._host_columns.setdefault(
            "never", HostColumn(np.ones(self.ensemble.n, np.float32))
        )
        never.values = (never.values * (1 - searched)).astype(np.float32)
        there = np.isin(life.read_lives(self.ensemble).at(flown.end), STRANDED)
        self._report_update(
            sortie.name,
            "sortie",
            sortie.end,
            before,
            self.ensemble.log_weight.to_numpy(),
            {"searched": searched, "there": there},
            middle=0.5 * (flown.begin + flown.end),
        )

    def _apply_contact(self, contact: Contact, number: int, time: int, place: PositionsAt) -> None:
        """Update the weights for a contact."""
        ensemble, scene, begin = self.ensemble, self._scene, None
        if contact.drifter is not None:
            seen = self._debris[contact.drifter]
            ensemble, scene, begin = seen.ensemble, seen.scene, seen.begin
        lon, lat = place(ensemble, scene, begin, time)
        status, unit = life.read_lives(ensemble).at(time), contact_laws.log_unit(contact)
        if contact.heard is not None:
            self._apply_sensor_contact(
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
        likelihood = self._with_floor(contact, likelihood, unit)
        doubted, unit = self._with_false_contacts(
            contact, number, time, likelihood, likelihood, unit
        )
        self._apply_likelihood(
            contact.name, "contact", time, doubted - unit, positive=True, unit=unit
        )

    def _apply_sensor_contact(
        self, contact: Contact, own: Heard, number: int, time: int, targets: Targets, unit: float
    ) -> None:
        """Update the weights for a contact by a sensor of the case.

        unit: log of the density in whose units the likelihood is stated.
        """
        sent = self._source_frequency(own.tone) if own.tone and own.tone.group else None
        log_likelihoods = heard.log_likelihood(contact, targets, sent)
        if contact.moves:
            log_likelihoods = log_likelihoods + contact_laws.log_motion(
                contact, targets.east, targets.north
            )
        key, chances = unknown.key(own.sensor), unknown.values(own.sensor)[1]
        many = len(chances)
        if many > 1:
            shared = self._shared.setdefault(key, runtime.empty(self.ensemble.n * many))
            before = shared.to_numpy().reshape(log_likelihoods.shape).astype(np.float64)
            likelihood = sight.average_over_unknown(log_likelihoods, before, chances)
        else:
            likelihood = log_likelihoods[0]
        log_likelihoods, unit = self._with_false_contacts(
            contact, number, time, log_likelihoods, likelihood, unit
        )
        if sent is not None and own.tone:
            self._store_source_frequency(
                own.tone, heard.update_source_frequency(contact, targets, sent)
            )
        log_likelihoods = log_likelihoods - unit
        averaged = self._with_floor(
            contact,
            sight.add_shared_report(log_likelihoods, shared, chances)
            if many > 1
            else log_likelihoods[0],
            0.0,
        )
        self._apply_likelihood(contact.name, "contact", time, averaged, positive=True, unit=unit)
        self._free_shared_misses(key)

    def _with_floor(self, contact: Contact, likelihood: Array, unit: float) -> Array:
        """Return the log likelihoods of a contact (n,), with a floor if contacts repopulate.

        unit: log of the density in whose units the floor is stated.
        """
        if self._filling is None or not filling.bounds_position(contact):
            return likelihood
        self._ruled_out = likelihood - unit <= filling.FLOOR
        return np.maximum(likelihood, unit + filling.FLOOR)

    def _with_false_contacts(
        self,
        contact: Contact,
        number: int,
        time: int,
        log_likelihoods: Array,
        likelihood: Array,
        unit: float,
    ) -> tuple[Array, float]:
        """Return the log likelihoods of a contact that may be false, and the log of their unit.

        said: log likelihoods if the contact is of the object. likelihood: the same, averaged over
        the unknown of the sensor group, (n,).
        """
        if contact.false_density > 0:
            return np.logaddexp(log_likelihoods, np.log(contact.false_density)), unit
        if contact.belief == 1:
            return log_likelihoods, unit
        # The false-contact density is the mean likelihood given all evidence so far, including
        # sorties under way.
        current, blocks = self.log_weight(time), self.ensemble.blocks
        both = (
            weights.sum_weights(current, blocks),
            weights.sum_weights(current + likelihood, blocks),
        )
        unit = self._meeting.mean(number, *both)
        if unit == -np.inf:
            return np.zeros_like(log_likelihoods), 0.0
        with np.errstate(divide="ignore"):
            return np.logaddexp(
                np.log(contact.belief) + log_likelihoods, np.log1p(-contact.belief) + unit
            ), unit

    def _targets(
        self, lon: Array, lat: Array, status: Array, contact: Contact, time: int
    ) -> Targets:
        """Return the particles in the form that a sensor of the case needs."""
        still = np.zeros(lon.shape)
        east, north = self._velocity(time) if heard.asks_velocity(contact) else (still, still)
        return Targets(lon, lat, self.ensemble.scenario.to_numpy(), east, north, status)

    def _velocity(self, time: int) -> tuple[Array, Array]:
        """Return (east, north) [m/s] of the particles at a time inside the step just made."""
        assert self._begin is not None
        assert self._step is not None
        return self._scene.velocity(self.ensemble, self._begin, self._step, time)

    def _source_frequency(self, tone: Tone) -> Sent:
        """Return the estimate of each particle's source frequency from the group's contacts."""
        first = heard.initial_source_frequency(tone, self.ensemble.n)
        columns = (
            self._host_columns.setdefault(name, HostColumn(values))
            for name, values in zip(_tone_names(tone), first, strict=True)
        )
        return Sent(*(column.values for column in columns))

    def _store_source_frequency(self, tone: Tone, sent: Sent) -> None:
        """Store the estimate of the source frequency after a contact."""
        for name, values in zip(_tone_names(tone), sent, strict=True):
            self._host_columns[name].values = values

    def _apply_look(self, look: Look, time: int, place: PositionsAt) -> None:
        """Update the weights for a look, with or without a detection."""
        lon, lat = place(self.ensemble, self._scene, None, time)
        status = life.read_lives(self.ensemble).at(time)
        if look.sensor is None:
            self._apply_likelihood(
                look.name,
                "look",
                time,
                looks.log_likelihood(look, lon, lat, on_map(status)),
                look.positive,
            )
            return
        still = np.zeros(lon.shape)
        east, north = (
            self._velocity(time) if sight.level_depends_on_speed(look.sensor) else (still, still)
        )
        source = Targets(lon, lat, self.ensemble.scenario.to_numpy(), east, north, status)
        log_likelihoods = sight.log_likelihood(look, source)
        chances = unknown.values(look.sensor)[1]
        if len(chances) == 1:
            self._apply_likelihood(look.name, "look", time, log_likelihoods[0], look.positive)
            return
        key = unknown.key(look.sensor)
        shared = self._shared.setdefault(key, runtime.empty(self.ensemble.n * len(chances)))
        self._apply_likelihood(
            look.name,
            "look",
            time,
            sight.add_shared_report(log_likelihoods, shared, chances),
            look.positive,
        )
        self._free_shared_misses(key)

    def _apply_likelihood(
        self,
        name: str,
        kind: Kind,
        time: int,
        likelihood: Array,
        positive: bool,
        unit: float = 0.0,
        certain: bool = True,
    ) -> None:
        """Update the weights by a log likelihood (n,) at a time, and report the update.

        positive: whether it is positive evidence, which also applies to "unsearched". unit: log of
        the unit of the likelihood. certain: whether the update is reported even if it changes no
        weight to zero.
        """
        if positive:
            self._host_columns["unsearched"].values = (
                self._host_columns["unsearched"].values + likelihood
            )
        before = self.ensemble.log_weight.to_numpy()
        after = before + likelihood
        self.ensemble.log_weight.from_numpy(after.astype(np.float32))
        self._report_update(
            name, kind, self._spec.period.time(time), before, after, {}, unit=unit, certain=certain
        )

    def _report_update(
        self,
        name: str,
        kind: Kind,
        time: np.datetime64,
        before: Array,
        after: Array,
        sortie_columns: Mapping[str, Array],
        *,
        unit: float = 0.0,
        middle: float = 0.0,
        certain: bool = True,
    ) -> None:
        """Report an update with the log weights (n,) before and after it."""
        kept_columns = {
            key: self._host_columns[key].values
            for key in list[str](("lineage", "never"))
            if key in self._host_columns
        }
        own = {"before": before, "after": after, "release": self.ensemble.release.to_numpy()}
        columns = Columns.held(self.ensemble.blocks, {**own, **kept_columns, **sortie_columns})
        self._meeting.take(Event(name, kind, time, columns, unit, middle, certain))
        self._updated = True

    def log_weight(self, time: int) -> Array:
        """Return the log weights at a time, float32 (n,).

        They include the effect so far of sorties and sensors under way.
        """
        under_way, observed = self._begun_sorties(time), self._observers.so_far(time)
        if not under_way:
            weight_now = np.asarray(self.ensemble.log_weight.to_numpy())
            return weight_now if observed is None else (weight_now + observed).astype(np.float32)
        weight = runtime.copy(self.ensemble.log_weight)
        groups = {flown.key for flown in under_way}
        shared = {
            key: runtime.copy(column) for key, column in self._shared.items() if key in groups
        }
        for flown in under_way:
            flown.fail(
                self.ensemble,
                self._exposure_until(flown, time, keep=False),
                self._shared_misses(flown, shared),
                weight,
            )
        failed = np.asarray(weight.to_numpy())
        return failed if observed is None else (failed + observed).astype(np.float32)

    def watch(self, until: int) -> None:
        """Apply all sorties and sensors until the end of the step just made."""
        self._observers.watch(until)
        for flown in self._begun_sorties(until):
            self._exposure_until(flown, until, keep=True)

    def after(self, until: int) -> None:
        """Resample at the end of a step if the effective sample size is below the threshold.

        Guided particles are not resampled before the last find that guides them: until then, their
        weights include the effect of noise that is still to come.
        """
        if self._scene.guided is not None and until < self._scene.guided.until:
            return
        happened, self._updated = self._updated, False
        if self._resampling.below <= 0 or not happened:
            return
        drawn = self._meeting.anew(self.ensemble.log_weight.to_numpy(), self.ensemble.layout)
        if drawn is not None:
            self.resample_all(drawn, until)
            assert isinstance(self._meeting, LocalReduction)
            self._meeting.drawn(
                drawn.log_weight, self._host_columns["lineage"].values, self.ensemble.layout
            )

    def resample_all(self, drawn: Resampled, until: int) -> None:
        """Resample all particles of a run at a time [s after start]."""
        record.inherit(self.columns.values(), drawn.ancestors)
        self.begin_anew(drawn, until)

    def begin_anew(self, drawn: Resampled, until: int) -> None:
        """Set weights, lineage and layout after columns were copied from the ancestors.

        Args:
            drawn: the resampled particles.
            until: time of the resampling [s after start].
        """
        e = self.ensemble
        every = [e, *(beside.ensemble for beside in self._debris.values())]
        with np.errstate(invalid="ignore"):  # empty slots have no weight before or after
            own = (
                self._host_columns["unsearched"].values - e.log_weight.to_numpy() + drawn.log_weight
            )
        self._host_columns["unsearched"].values = np.where(drawn.log_weight > -np.inf, own, -np.inf)
        for name in ("lineage", "ancestors"):
            self._host_columns.setdefault(name, HostColumn(drawn.ancestors.astype(np.int32)))
        e.log_weight.from_numpy(drawn.log_weight)
        e.status.from_numpy(
            np.where(drawn.spare, int(Status.LEFT), e.status.to_numpy()).astype(np.int32)
        )
        for which in every:
            which.layout = drawn.layout
            self._restart_waits(which, until)

    def _restart_waits(self, which: Ensemble, time: int) -> None:
        """Restart the waiting times of stranded particles that may refloat.

        Waiting times are drawn by slot and landing. They are exponential and so have no memory:
        copies may restart them.
        """
        if self._scene.place.beach.stay > 0:
            ashore, since = which.status.to_numpy() == Status.ASHORE, which.status_since.to_numpy()
            which.status_since.from_numpy(np.where(ashore, time, since).astype(np.int32))

    def ancestors(self) -> Array | None:
        """Return the ancestor of each particle since the last call, slots of the whole run (n,).

        Return None if nothing was resampled: each particle is then its own ancestor.
        """
        column = self._host_columns.pop("ancestors", None)
        return None if column is None else column.values

    def lineage(self) -> Array | None:
        """Return the initial particle from which each descends, int32 (n,); None: itself."""
        column = self._host_columns.get("lineage")
        return None if column is None else column.values

    def _shared_misses(self, flown: Flown, columns: dict[tuple[str, float], Device]) -> Device:
        """Return the log misses of the group that shares a sortie's unknown sweep width factor."""
        if len(flown.factors) == 1:
            return self.ensemble.log_weight  # the kernel then reads no group, so any column will do
        key = flown.key
        if key not in columns:
            columns[key] = runtime.empty(self.ensemble.n * len(flown.factors))
        return columns[key]


def _tone_names(tone: Tone) -> tuple[str, str]:
    """Return the names of the two columns of a tone's source frequency, without blanks."""
    group = tone.group.replace(" ", "_")
    return f"precision:{group}", f"turned:{group}"


def create_exposures(spec: EnsembleSpec, sorties: Sequence[Sortie], scene: Scene) -> list[Flown]:
    """Return the exposure of each sortie, set up for a scene."""
    seas = scene.seas("current")
    members = [scene.forcing.members(sea[0], "current") for sea in seas]
    return [
        Listening(sortie, spec.period.epoch)
        if sortie.sensor is not None
        else SortieExposure(sortie, spec.period.epoch, seas, members)
        for sortie in sorties
    ]


def occupied_slots(ensemble: Ensemble) -> list[int]:
    """Return the number of occupied slots of each scenario; the others are empty."""
    living = ensemble.status.to_numpy() != Status.LEFT
    counts = np.bincount(ensemble.scenario.to_numpy()[living], minlength=len(ensemble.scenarios))
    return [int(count) for count in counts]
