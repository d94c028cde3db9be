"""The particle filter: weight updates by sorties without a find, contacts and sensors.

The filter works while the ensemble moves: the forecast clock calls it at every step. The exposure
of a sortie grows while it is flown, and changes the weights when the sortie ends; an output in
between includes the exposure so far. The evidence of an update is the mean weight after it over the
mean weight before it. A sortie without effect changes no bit.

The ensemble may be one shard of a run. Per-particle updates use that particle alone. Operations
over the whole ensemble go through `Meeting` (drift.evidence.filter.meeting), a reduction across
shards; the summary of each update is built in drift.evidence.filter.account.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from drift.engine.motion import changes
from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.scene import Begin, Scene
from drift.engine.motion.simulate import PositionsAt
from drift.engine.motion.steering import steer
from drift.engine.particles import ensemble as record
from drift.engine.particles import life, weights
from drift.engine.particles.columns import Columns
from drift.engine.particles.ensemble import Ensemble
from drift.engine.particles.status import STRANDED, Status
from drift.evidence.filter import by_state, crossings, filling, overdue
from drift.evidence.filter import contacts as contact_laws
from drift.evidence.filter.account import Account, Event, UpdateCallback
from drift.evidence.filter.by_state import SortieByState
from drift.evidence.filter.crossings import Watched
from drift.evidence.filter.debris import debris
from drift.evidence.filter.detection import heard, sight
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
    Kind,
    Look,
    Resampling,
    Sensors,
    Sortie,
    Tone,
)
from drift.evidence.filter.state import History, ReportGroup
from drift.evidence.filter.updates import Updates
from drift.evidence.sensors import unknown
from drift.evidence.sensors.records import Sensor
from geo import notation, sphere
from geo.array import Array
from kernels.runtime import runtime
from kernels.step.advance import Step

Flown = SortieExposure | SortieByState | Listening


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
        elapsed = spec.period.elapsed
        self._all = create_exposures(spec, sorties, scene)
        self._waiting = list(self._all)
        # contacts come first, so that the number of a contact is that in the case
        reports: list[Contact | Look] = [*contacts, *sensors.looks]
        self._reports = [
            (elapsed(report.time), number, report) for number, report in enumerate(reports)
        ]
        self._groups = _groups_of(self._all, self._reports)
        tones = [contact.heard.tone for contact in contacts if contact.heard]
        # the first contact of each group states what is known before
        self._tones = {tone.group: tone for tone in reversed(tones) if tone and tone.group}
        self._step: Step | None = None
        self._begin: Begin | None = None  # where the particles began the present step
        self._observers = Observers(spec, sensors, ensemble, scene)
        reported = [*known, *sensors.times, *(contact.time for contact in contacts)]
        reported += [time for sortie in sorties for time in (sortie.start, sortie.end)]
        self._overdue = overdue.overdue_times(spec, [elapsed(time) for time in reported])
        seen = [(elapsed(contact.time), contact) for contact in contacts]
        self._debris = debris.of_contacts(spec, seen, scene, ensemble, resumed=resumed)
        first = self.ensemble.log_weight.to_numpy()
        self._history = History(first.astype(np.float64))
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
                self._account, ResamplingRule(spec.seed, resampling, _occupied_slots(ensemble))
            )
        self._meeting = meeting

    @property
    def updates(self) -> Updates:
        """All updates so far, with the sorties as they were flown."""
        flown = [partial(sortie.as_flown, start=self._spec.period.epoch) for sortie in self._all]
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
        return Columns.held(self.ensemble.blocks, {"unsearched": self._history.unsearched})

    @property
    def watched(self) -> list[Watched]:
        """The lines whose crossings are reported, with their observations so far."""
        return self._observers.watched()

    @property
    def markers(self) -> list[Marker]:
        """The datum markers of drifting patterns whose tracks are simulated."""
        return [marker for flown in self._all for marker in flown.markers]

    @property
    def _parts(self) -> dict[str, Any]:
        """Everything with device columns of the particles, by name.

        A column with several values per particle stores one block of n after another.
        """
        parts: dict[str, Any] = {"particle": self.ensemble}
        for name, every in (
            ("debris", [beside.ensemble for beside in self._debris.values()]),
            ("sortie", self._all),
            ("sensor", self._observers.all),
            ("group", self._groups.values()),
        ):
            parts |= {f"{name} {number}": part for number, part in enumerate(every)}
        return parts

    def state(self) -> Iterator[tuple[str, Array]]:
        """Yield the columns of the particles, each with the name that `load` accepts."""
        for part, own in self._parts.items():
            for name, column in own.columns.items():
                yield f"{part} {name}", column.to_numpy()
        for name, values in self._history.columns.items():
            yield f"history {name}", values

    def load(self, name: str, values: Array) -> None:
        """Replace a column of the particles by stored values."""
        part, own = name.rsplit(" ", 1)
        if part == "history":
            setattr(self._history, own, values)
            return
        holder = self._parts[part]
        if own not in holder.columns:
            holder.ready(self.ensemble.n)
        holder.columns[own].from_numpy(values)

    def resume(self, time: int) -> None:
        """Skip the sorties and sensors that ended by the start of a step [s after start]."""
        self._waiting = [flown for flown in self._waiting if flown.end > time]
        self._observers.drop_ended(time)

    def stops(self, after: int, until: int, step: Step | None = None) -> list[int]:
        """Return the times in (after, until] at which an update takes effect [s after start].

        step: the step between the two times.
        """
        times = [flown.end for flown in self._waiting] + [time for time, *_ in self._reports]
        return sorted(
            {time for time in (*times, *self._overdue) if after < time <= until}
            | self._observers.stops(after, until, step)
        )

    def rests(self, step: Step) -> bool:
        """Return whether a step has no active sensor and no update."""
        end = step.elapsed + step.duration
        return not (
            self._needs_start_positions(step.elapsed, end)
            or self.stops(max(step.elapsed, 0), end, step)
        )

    def before(self, step: Step) -> bool:
        """Move the datum markers over a step; return whether positions at its start are needed.

        The forcing must be set for the step.
        """
        self._step, end = step, step.elapsed + step.duration
        self._meeting.begin(step.elapsed, end)
        for flown in self._begun_sorties(end):
            flown.drift(self._scene.forcing, step.elapsed, step.duration)
        self._observers.before(step)
        return self._needs_start_positions(step.elapsed, end)

    def _needs_start_positions(self, elapsed: int, end: int) -> bool:
        """Return whether an update needs the particles' positions at the start of a step."""
        debris = any(beside.last > elapsed for beside in self._debris.values())
        moving = any(
            elapsed < when <= end and heard.asks_velocity(report)
            for when, _, report in self._reports
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
        reports = [(number, report) for when, number, report in self._reports if when == time]
        own = any(isinstance(report, Look) or report.drifter is None for _, report in reports)
        if own or self._observers.stops(time - 1, time, self._step):
            self._observers.cut(time, place)
        for flown in [f for f in self._waiting if f.end == time]:
            self._apply_sortie(flown)
            self._waiting.remove(flown)
        for number, report in reports:
            if isinstance(report, Look):
                self._apply_look(report, time, place)
            else:
                self._apply_contact(report, number, time, place)
        if time in self._overdue:
            self._apply_likelihood(
                f"overdue {notation.format_dtg(self._spec.period.time(time))}",
                "overdue",
                time,
                overdue.log_likelihood(self._spec, time, self.ensemble),
                positive=True,
                certain=self._overdue[time],
            )
        for seen in self._observers.over(time):
            likelihood = seen.likelihood(seen.ready(self.ensemble.n), over=True)
            assert likelihood is not None
            self._apply_likelihood(seen.what.name, seen.kind, time, likelihood, seen.positive)
            seen.columns = {}
        for group in self._groups.values():
            if group.last <= time:
                group.missed = None

    def _apply_sortie(self, flown: Flown) -> None:
        """Update the weights for a sortie that found nothing, and free its exposure."""
        sortie, exposed = flown.sortie, self._exposure_until(flown, flown.end, keep=True)
        before = self.ensemble.log_weight.to_numpy()
        later = self._is_shared_later(flown)
        self._fail(flown, exposed, self._groups[flown.key], self.ensemble.log_weight, later)
        searched, history = flown.searched(), self._history
        never = np.ones(self.ensemble.n, np.float32) if history.never is None else history.never
        history.never = (never * (1 - searched)).astype(np.float32)
        there = np.isin(life.read_lives(self.ensemble).at(flown.end), STRANDED)
        middle = 0.5 * (flown.begin + flown.end)
        columns = self._columns(
            before,
            self.ensemble.log_weight.to_numpy(),
            {"searched": searched, "there": there},
            middle,
        )
        self._take(Event(sortie.name, "sortie", sortie.end, columns, middle=middle))
        flown.exposed = None

    def _is_shared_later(self, flown: Flown) -> bool:
        """Return whether a later report shares the unknown of a sortie that ends."""
        others = [other.key for other in self._waiting if other is not flown]
        sensors = [_sensor(report) for when, _, report in self._reports if when >= flown.end]
        others += [unknown.key(sensor) for sensor in sensors if sensor]
        return flown.key in others

    def _fail(
        self, flown: Flown, exposed: Any, group: ReportGroup, log_weight: Any, keep: bool
    ) -> None:
        """Multiply weights by the probability that a sortie has missed each particle, in place.

        keep: whether its group takes the miss, for what shares the unknown later. A group holds a
        value of the unknown for each particle: what nothing asks for is not made.
        """
        several = len(group.chances) > 1
        shared = group.ready(self.ensemble.n) if several and keep else group.missed
        flown.fail(self.ensemble, exposed, shared, log_weight, keep, group.growth)

    def _apply_look(self, look: Look, time: int, place: PositionsAt) -> None:
        """Update the weights for a look, with or without a detection."""
        places = place(self.ensemble, self._scene, None, time)
        log_likelihoods = sight.log_likelihood(
            look, self._targets(look, self.ensemble, places, time)
        )
        averaged = self._averaged(look.sensor, log_likelihoods, keep=True)
        self._apply_likelihood(look.name, "look", time, averaged, look.positive)

    def _apply_contact(self, contact: Contact, number: int, time: int, place: PositionsAt) -> None:
        """Update the weights for a contact; repopulate particles if it leaves too few."""
        ensemble, scene, begin = self.ensemble, self._scene, None
        if contact.drifter is not None:
            seen = self._debris[contact.drifter]
            ensemble, scene, begin = seen.ensemble, seen.scene, seen.begin
        places = place(ensemble, scene, begin, time)
        targets = self._targets(contact, ensemble, places, time)
        tone = contact.heard.tone if contact.heard else None
        sent = self._source_frequency(tone) if tone and tone.group else None
        sensor = contact.heard.sensor if contact.heard else None
        log_likelihoods = heard.log_likelihood(contact, targets, sent)
        if contact.state:
            log_likelihoods = np.where(
                self._in_state(contact.state, time), log_likelihoods, -np.inf
            )
        averaged = self._averaged(sensor, log_likelihoods, keep=False)
        log_likelihoods, unit = self._with_false_contacts(
            contact, number, time, log_likelihoods, averaged
        )
        if sent is not None:
            for column, values in zip(
                sent, heard.update_source_frequency(contact, targets, sent), strict=True
            ):
                column[:] = values
        averaged = self._averaged(sensor, log_likelihoods - unit, keep=True)
        fills = self._filling is not None and filling.bounds_position(contact)
        if fills:
            self._ruled_out = averaged <= filling.FLOOR
            averaged = np.maximum(averaged, filling.FLOOR)
        self._apply_likelihood(contact.name, "contact", time, averaged, positive=True, unit=unit)
        if self._filling is not None and fills:
            self._repopulate(self._filling, contact, number, time)

    def _targets(
        self,
        report: Contact | Look,
        ensemble: Ensemble,
        places: tuple[Array, Array],
        time: int,
    ) -> Targets:
        """Return the particles of an ensemble at a time as the likelihood of a report needs them.

        places: their lon, lat [binary angle].
        """
        east = north = np.zeros(ensemble.n)
        if heard.asks_velocity(report):
            assert self._begin is not None
            assert self._step is not None
            east, north = self._scene.velocity(self.ensemble, self._begin, self._step, time)
        scenario, status = ensemble.scenario.to_numpy(), life.read_lives(ensemble).at(time)
        return Targets(*places, scenario, east, north, status)

    def _in_state(self, name: str, time: int) -> Array:
        """Return which particles are in the state of a name at a time, bool (n,)."""
        scenarios = self._spec.scenarios
        now = changes.state_at(self.ensemble, time)
        number = changes.numbered(scenarios)[self.ensemble.scenario.to_numpy(), now]
        return np.asarray(number == changes.names_of(scenarios).index(name))

    def _averaged(self, sensor: Sensor | None, log_likelihoods: Array, keep: bool) -> Array:
        """Return the log likelihood (n,) of a report, averaged over the unknown of its sensor.

        Args:
            sensor: of the case; None: the report has no unknown.
            log_likelihoods: by value of the unknown, (values, n).
            keep: whether later reports of the group are to include this one.
        """
        if len(log_likelihoods) == 1 or sensor is None:
            return np.asarray(log_likelihoods[0])
        group = self._groups[unknown.key(sensor)]
        return sight.average_over_unknown(
            log_likelihoods, group.ready(self.ensemble.n), group.chances, keep
        )

    def _with_false_contacts(
        self, contact: Contact, number: int, time: int, log_likelihoods: Array, averaged: Array
    ) -> tuple[Array, float]:
        """Return the log likelihoods of a contact that may be false, and the log of their unit.

        Args:
            contact: the contact.
            number: of the contact in the case.
            time: of the contact [s after start].
            log_likelihoods: by value of the unknown if it is of the object, (values, n).
            averaged: the same, averaged over the unknown, (n,).
        """
        unit = contact_laws.log_unit(contact)
        if contact.false_density > 0:
            return np.logaddexp(log_likelihoods, np.log(contact.false_density)), unit
        if contact.belief == 1:
            return log_likelihoods, unit
        # The false-contact density is the mean likelihood given all evidence so far, including
        # sorties under way.
        current, blocks = self.log_weight(time), self.ensemble.blocks
        unit = self._meeting.mean(
            number,
            weights.sum_weights(current, blocks),
            weights.sum_weights(current + averaged, blocks),
        )
        if unit == -np.inf:
            return np.zeros_like(log_likelihoods), 0.0
        with np.errstate(divide="ignore"):
            true, false = np.log(contact.belief), np.log1p(-contact.belief)
        return np.logaddexp(true + log_likelihoods, false + unit), unit

    def _source_frequency(self, tone: Tone) -> Sent:
        """Return the estimate of each particle's source frequency, as columns that can be set."""
        history, n = self._history, self.ensemble.n
        if history.tones is None:
            first = [heard.initial_source_frequency(own, n) for own in self._tones.values()]
            history.tones = np.array(first).ravel()
        return Sent(*history.tones.reshape(-1, 2, n)[list(self._tones).index(tone.group)])

    def _repopulate(self, how: BulkRepopulation, contact: Contact, number: int, time: int) -> None:
        """Repopulate the particles that a contact rules out, if too few survive."""
        e, own, history = self.ensemble, self.ensemble.columns, self._history
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
        new = placed.log_weight.astype(np.float32)
        self._reweight_unsearched(new)
        history.unsearched[placed.slots] = new[placed.slots]  # they have not been searched
        e.log_weight.from_numpy(new)
        for name, values in (("never", 1), ("lineage", placed.slots)):  # they have no ancestor
            if name in history.columns:
                column = history.columns[name].copy()
                column[placed.slots] = values
                setattr(history, name, column)
        self._meeting.account.filled(new, e.layout)

    def _reweight_unsearched(self, new: Array) -> None:
        """Change the weights as if unsearched by as much as new log weights (n,) change the own."""
        with np.errstate(invalid="ignore"):  # -inf before and after: empty slots, or no water found
            own = self._history.unsearched - self.ensemble.log_weight.to_numpy() + new
        self._history.unsearched = np.where(new > -np.inf, own, -np.inf)

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
            self._history.unsearched = self._history.unsearched + likelihood
        before = self.ensemble.log_weight.to_numpy()
        after = before + likelihood
        self.ensemble.log_weight.from_numpy(after.astype(np.float32))
        columns, when = self._columns(before, after, {}, time), self._spec.period.time(time)
        self._take(Event(name, kind, when, columns, unit, certain=certain))

    def _columns(
        self, before: Array, after: Array, more: Mapping[str, Array], time: float
    ) -> Columns:
        """Return the columns of an update at a time with the log weights (n,) before and after it.

        Releases are those that survival times count from.
        """
        own = {"before": before, "after": after, "release": self.ensemble.release.to_numpy()}
        if changes.any_changes(self._spec.scenarios):
            own["release"], own["law"] = changes.survival_clocks(
                self.ensemble, self._spec.scenarios, time
            )
        kept = self._history.columns
        own |= {name: kept[name] for name in ("lineage", "never") if name in kept}
        return Columns.held(self.ensemble.blocks, {**own, **more})

    def _take(self, event: Event) -> None:
        """Report an update."""
        self._meeting.take(event)
        self._updated = True

    def log_weight(self, time: int) -> Array:
        """Return the log weights at a time, float32 (n,).

        They include the effect so far of sorties and sensors under way.
        """
        under_way, observed = self._begun_sorties(time), self._observers.so_far(time)
        weight = self.ensemble.log_weight
        if under_way:
            assert self._step is not None
            # exposures until the end of the step are those that `watch` asks for next
            at_end = time == self._step.elapsed + self._step.duration
            weight = runtime.copy(weight)
            copies: dict[tuple[str, float], ReportGroup] = {}
            for number, flown in enumerate(under_way):
                keep = flown.key in [other.key for other in under_way[number + 1 :]]
                group = copies.get(flown.key, self._groups[flown.key])
                if keep and flown.key not in copies:
                    group = copies[flown.key] = group.copy()
                exposed = self._exposure_until(flown, time, keep=at_end)
                self._fail(flown, exposed, group, weight, keep)
        now = np.asarray(weight.to_numpy())
        return now if observed is None else (now + observed).astype(np.float32)

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
            assert self._history.lineage is not None
            self._meeting.drawn(drawn.log_weight, self._history.lineage, self.ensemble.layout)

    def resample_all(self, drawn: Resampled, until: int) -> None:
        """Resample all particles of a run at a time [s after start]."""
        columns = [column for part in self._parts.values() for column in part.columns.values()]
        record.inherit(columns, drawn.ancestors)
        self._history.inherit(drawn.ancestors)
        self.begin_anew(drawn, until)

    def begin_anew(self, drawn: Resampled, until: int) -> None:
        """Set weights, lineage and layout after columns were copied from the ancestors.

        Args:
            drawn: the resampled particles.
            until: time of the resampling [s after start].
        """
        e, history = self.ensemble, self._history
        self._reweight_unsearched(drawn.log_weight)
        for name in ("lineage", "ancestors"):
            if name not in history.columns:
                setattr(history, name, drawn.ancestors.astype(np.int32))
        e.log_weight.from_numpy(drawn.log_weight)
        e.status.from_numpy(
            np.where(drawn.spare, int(Status.LEFT), e.status.to_numpy()).astype(np.int32)
        )
        for which in (e, *(beside.ensemble for beside in self._debris.values())):
            which.layout = drawn.layout
            self._restart_waits(which, until)
        changes.draw_again(e, self._spec.scenarios, until)

    def _restart_waits(self, which: Ensemble, time: int) -> None:
        """Restart the waiting times of stranded particles that may refloat.

        Waiting times are drawn by slot and landing. They are exponential and so have no memory:
        copies may restart them.
        """
        if self._scene.place.beach.stay > 0:
            ashore, since = which.status.to_numpy() == Status.ASHORE, which.status_since.to_numpy()
            which.status_since.from_numpy(np.where(ashore, time, since).astype(np.int32))

    def weights(self, time: int) -> tuple[Array, Array | None, Array | None]:
        """Return the log weights at a time, and what resampling has done; each (n,) or None.

        Returns:
            Log weights, ancestors since the last call and initial particles (slots of the whole
            run). None: nothing was resampled, so that each particle is its own ancestor.
        """
        log_weight, history = self.log_weight(time), self._history
        ancestors, history.ancestors = history.ancestors, None
        return log_weight, ancestors, history.lineage


def _sensor(report: Contact | Look) -> Sensor | None:
    """Return the sensor of a look or a contact; None without one."""
    own = report if isinstance(report, Look) else report.heard
    return None if own is None else own.sensor


def _groups_of(
    sorties: Sequence[Flown], reports: Sequence[tuple[int, int, Contact | Look]]
) -> dict[tuple[str, float], ReportGroup]:
    """Return the groups of sorties, contacts and looks that share an unknown."""
    every = [(flown.key, flown.chances, flown.end, flown.growth) for flown in sorties]
    for time, _, report in reports:
        sensor = _sensor(report)
        if sensor is not None:
            every.append((unknown.key(sensor), unknown.values(sensor)[1], time, None))
    groups: dict[tuple[str, float], ReportGroup] = {}
    for key, chances, time, growth in every:
        group = groups.setdefault(key, ReportGroup(chances, time, growth))
        group.last = max(group.last, time)
        if group.growth is None or growth is None or (group.growth != growth).any():
            group.growth = None
    return groups


def create_exposures(spec: EnsembleSpec, sorties: Sequence[Sortie], scene: Scene) -> list[Flown]:
    """Return the exposure of each sortie, set up for a scene."""
    seas = scene.seas("current")
    members = [scene.forcing.members(sea[0], "current") for sea in seas]
    start, steers = spec.period.epoch, scene.steering is not None

    def exposure(sortie: Sortie) -> Flown:
        if sortie.sensor is not None:
            return Listening(sortie, start)
        if sortie.changed:
            return SortieByState(
                [
                    SortieExposure(own, start, seas, members, steers=steers)
                    for own in by_state.sorties(sortie)
                ],
                spec.scenarios,
            )
        return SortieExposure(sortie, start, seas, members, steers=steers)

    return [exposure(sortie) for sortie in sorties]


def _occupied_slots(ensemble: Ensemble) -> list[int]:
    """Return the number of occupied slots of each scenario; the others are empty."""
    living = ensemble.status.to_numpy() != Status.LEFT
    counts = np.bincount(ensemble.scenario.to_numpy()[living], minlength=len(ensemble.scenarios))
    return [int(count) for count in counts]
