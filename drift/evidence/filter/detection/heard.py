"""Likelihood of a contact by a sensor of the case: its POD, a received level and a frequency.

A passive sonar detects a target if its signal excess S plus the fluctuation e, normal with standard
deviation s, is above 0. The received level is R = SL - TL + e. It is measured as y, with an error
of standard deviation d, so that

    p(y, heard) = N(y; SL - TL, sqrt(s^2 + d^2)) Phi((S + k r) / sqrt(k) d),  r = y - (SL - TL),  k
    = s^2 / (s^2 + d^2):

given y, the fluctuation is normal with mean k r and variance k d^2, and the target was heard if S +
e > 0. An unknown of the group is added to SL - TL and so to S. A frequency arrives as f = f0 D, D =
(c + w.u) / (c + v.u), with u from sensor to target, w the velocity of the sensor and v that of the
target (Doppler shift with both in motion: Kinsler et al. 2000, Fundamentals of Acoustics, 4th ed.);
with f0 normal, f is normal too.
"""

import math
from typing import NamedTuple

import numpy as np

from drift.engine.particles.status import STRANDED, on_map
from drift.evidence.filter import contacts
from drift.evidence.filter.detection import sight
from drift.evidence.filter.detection.sight import Targets
from drift.evidence.filter.records import Contact, Heard, Tone
from drift.evidence.sensors import hearing, pod_table, unknown
from drift.evidence.sensors.hearing import Receiver
from drift.evidence.sensors.records import Sonar
from geo import sphere
from geo.array import Array


class Sent(NamedTuple):
    """Normal estimate of each target's source frequency from all contacts of a group so far."""

    precision: Array  # 1 / variance [1/Hz^2] (n,)
    turned: Array  # precision times mean deviation from the frequency of the case [1/Hz] (n,)


def asks_velocity(contact: Contact) -> bool:
    """Return whether the likelihood of a contact depends on the target's velocity."""
    own = contact.heard
    return contact.moves or (
        own is not None and (own.tone is not None or sight.level_depends_on_speed(own.sensor))
    )


def log_likelihood(contact: Contact, targets: Targets, sent: Sent | None = None) -> Array:
    """Return the log density of a contact by value of the unknown; -inf: impossible.

    Args:
        contact: with `heard`.
        targets: the particles.
        sent: source frequency estimated from the group's other contacts; None: that of the case.

    Returns:
        Log densities, float64 (factors, n).
    """
    own = contact.heard
    assert own is not None
    assert contact.sensor is not None
    at = math.radians(contact.sensor[0]), math.radians(contact.sensor[1])
    lon, lat = targets.lon * sphere.UNIT, targets.lat * sphere.UNIT
    way = sphere.offset(*at, lon, lat)
    common = contacts.log_likelihood(contact, targets.lon, targets.lat)
    if own.tone is not None:
        common = common + _frequency(own.tone, doppler(own, targets, way), sent)
    there = on_map(targets.status)
    sees = own.sensor.sees
    if not isinstance(sees, Sonar):
        with np.errstate(divide="ignore"):
            detected = np.log(pod_table.chance(sees, at, contact.time, lon, lat))[None]
    else:
        there &= ~np.isin(targets.status, STRANDED)
        tables = Receiver(sees, own.beams).tables(*at, own.heading, contact.time)
        arrives, gain = hearing.terms(tables, *way)
        arrives = arrives + hearing.level(sees, targets.scenario, targets.speed)
        detected = np.stack(
            [
                _log_detection(own, sees, arrives + offset, gain)
                for offset in unknown.values(own.sensor)[0]
            ]
        )
    return np.where(there, common + detected, -np.inf)


def _log_detection(own: Heard, sonar: Sonar, arrives: Array, gain: Array) -> Array:
    """Return the log density of a detection, and of the measured level, given arriving levels.

    Args:
        own: the measurement.
        sonar: the sonar.
        arrives: levels that arrive [dB], shape (n,).
        gain: gain - noise - threshold [dB], shape (n,).
    """
    from scipy import special  # imported here: few cases ask, and it takes a third of a second

    if own.level is None:
        return np.asarray(special.log_ndtr((arrives + gain) / sonar.fluctuation))
    found = np.full(arrives.shape, -np.inf)
    audible = arrives > -np.inf
    arrives, gain = arrives[audible], gain[audible]
    value, error = own.level
    both = math.hypot(sonar.fluctuation, error)
    share, off = (sonar.fluctuation / both) ** 2, value - arrives
    above = (arrives + gain + share * off) / (sonar.fluctuation * error / both)
    found[audible] = contacts.log_normal_density(off, both) + special.log_ndtr(above)
    return found


def doppler(own: Heard, targets: Targets, way: tuple[Array, Array]) -> Array:
    """Return the Doppler factor on each target's source frequency, (n,).

    way: offset (east, north) [m] from sensor to target.
    """
    assert own.tone is not None
    far = np.maximum(np.hypot(*way), 1e-9)
    east, north = way[0] / far, way[1] / far
    c = own.tone.sound_speed
    return np.asarray(
        (c + own.velocity[0] * east + own.velocity[1] * north)
        / (c + targets.east * east + targets.north * north)
    )


def initial_source_frequency(tone: Tone, n: int) -> Sent:
    """Return the estimated frequency of n targets before any contact of the group."""
    return Sent(np.full(n, tone.source_std**-2.0), np.zeros(n))


def _frequency(tone: Tone, shift: Array, sent: Sent | None) -> Array:
    """Return the log density of a received frequency, given Doppler factors (n,)."""
    if sent is None:
        return contacts.log_normal_density(
            tone.value - tone.source * shift, np.hypot(tone.std, tone.source_std * shift)
        )
    mean = tone.source + sent.turned / sent.precision
    return contacts.log_normal_density(
        tone.value - mean * shift, np.sqrt(tone.std**2 + shift**2 / sent.precision)
    )


def update_source_frequency(contact: Contact, targets: Targets, sent: Sent) -> Sent:
    """Return the estimated frequency after a contact (product of normal densities)."""
    own = contact.heard
    assert own is not None
    assert own.tone is not None
    assert contact.sensor is not None
    at = math.radians(contact.sensor[0]), math.radians(contact.sensor[1])
    shift = doppler(
        own, targets, sphere.offset(*at, targets.lon * sphere.UNIT, targets.lat * sphere.UNIT)
    )
    off = own.tone.value - own.tone.source * shift
    return Sent(
        sent.precision + (shift / own.tone.std) ** 2, sent.turned + shift * off / own.tone.std**2
    )
