"""A made-up search, consistent in itself: particles that move, sorties that fail, a contact, a
plan; all by hand in NumPy.
"""

import functools
import itertools
import math

import clouds
import numpy as np

from drift.engine.particles.status import Status
from drift.evidence.filter.records import Contact, Fix, Law, PlanSpec, Sortie, Unit, Watch
from drift.evidence.filter.updates import Update, Updates
from drift.forecast import build as forecast_build
from drift.planning.search.records import Alternative, Plan, Tasking
from geo import sphere
from geo.polyline import Area, Legs

NMI, KNOT = 1852.0, 1852.0 / 3600
BEGIN = np.datetime64("2026-11-22T06:30:00")
NAMES = ("position report", "swamped while fishing", "on passage")
PRIOR = np.array([0.5, 0.3, 0.2])
N = 12_000


def hours(count):
    return BEGIN + np.timedelta64(round(count * 3600), "s")


def seconds(time):
    return float(time.astype("datetime64[s]").astype(np.int64))


def away(lon, lat, east, north):
    """Return positions [deg] moved by [nmi]; longitudes near the first."""
    x, y = sphere.destination(
        np.radians(lon), np.radians(lat), np.multiply(east, NMI), np.multiply(north, NMI)
    )
    return lon + (np.degrees(x) - lon + 180) % 360 - 180, np.degrees(y)


def corners(centre, length, width, orientation):
    """Return the corners of a rectangle [nmi, rad], clockwise from the one ahead and to the left."""
    a, b = length / 2, width / 2
    found = []
    for along, across in ((a, -b), (a, b), (-a, b), (-a, -b)):
        east = along * math.sin(orientation) + across * math.cos(orientation)
        north = along * math.cos(orientation) - across * math.sin(orientation)
        found.append(tuple(float(v) for v in away(*centre, east, north)))
    return found


def parallel(name, centre, length, width, orientation, spacing, start, speed, *, base=None, **more):
    """Return a parallel sweep [nmi, kn]: legs along the length, from the corner behind and to the
    left.
    """
    count = max(round(width / spacing), 1)
    points = []
    for k in range(count):
        across = (k - (count - 1) / 2) * spacing
        ends = [-length / 2 + spacing / 2, length / 2 - spacing / 2]
        for along in ends if k % 2 == 0 else ends[::-1]:
            east = along * math.sin(orientation) + across * math.cos(orientation)
            north = along * math.cos(orientation) - across * math.sin(orientation)
            points.append(tuple(float(v) for v in away(*centre, east, north)))
    track = [0.0]
    for a, b in itertools.pairwise(points):
        track.append(track[-1] + float(sphere.distance(*np.radians(a), *np.radians(b))))
    first = seconds(start)
    times = [first + d / (speed * KNOT) for d in track]
    searching = [True] * (len(points) - 1)
    ring = corners(centre, length, width, orientation)
    return Sortie(
        name,
        more.pop("kind", "Aircraft"),
        start,
        start + np.timedelta64(round(times[-1] - first), "s"),
        more.pop("law", Law()),
        more.pop("sweep_width", (0.8 * NMI, 0.8 * NMI, 1.3 * NMI)),
        area=Area(*(tuple(p[i] for p in ring) for i in (0, 1))),
        legs=Legs(
            tuple(times), *(tuple(p[i] for p in points) for i in (0, 1)), tuple(searching)
        ),
        speed=speed * KNOT,
        altitude=500 * 0.3048,
        spacing=spacing * NMI,
        **more,
    )  # fmt: skip


def sorties(lon, lat):
    """Return four sorties near a place: two sweeps, an area, a watch; the last with its marker's
    track.
    """

    def at(east, north):
        return tuple(float(v) for v in away(lon, lat, east, north))

    ring = corners(at(-22, 8), 18, 14, 0.2)
    square = parallel(
        "Cutter square", at(6, -14), 6, 6, 0.0, 1.0, hours(14.5), 14,
        kind="Boat", frame="datum", datum=at(6, -14),
        marker=Legs((seconds(hours(14)), seconds(hours(22))), *zip(at(6, -14), at(11, -18), strict=True), (True,)),
    )  # fmt: skip
    return (
        parallel("C-130 first light", at(2, 2), 24, 16, 0.5, 2.0, hours(6), 180),
        Sortie(
            "Helicopter, fishing ground", "Helicopter", hours(8), hours(10), Law("random"), (0.6 * NMI,) * 3,
            area=Area(*(tuple(p[i] for p in ring) for i in (0, 1))), coverage=(0.8,) * 3, speed=90 * KNOT,
        ),
        parallel("C-130 second", at(10, -10), 20, 20, 2.2, 2.5, hours(10.5), 180),
        square,
    )  # fmt: skip


def watch(lon, lat):
    """Return a passive sonar's watch with a convergence zone."""
    times = tuple(seconds(hours(h)) for h in (3, 9))
    x, y = away(lon, lat, [-30, -20], [-25, -25])
    return Sortie(
        "Towed array", "", hours(3), hours(9), Law(), (0.0,) * 3,
        legs=Legs(times, tuple(x), tuple(y), (True,)),
        watch=Watch((0.0, 28 * NMI), (5 * NMI, 32 * NMI), (0.8, 0.6)),
    )  # fmt: skip


def contacts(lon, lat):
    """Return one contact of each kind."""
    spot = tuple(float(v) for v in away(lon, lat, 10, -16))
    box = corners((lon, lat), 10, 6, 0.4)
    return (
        Contact("Beacon A/B", hours(12), "position", 0.7, fixes=(Fix(*spot, 0.7), Fix(lon - 0.6, lat + 0.1, 0.3)),
                major=3 * NMI, minor=1.5 * NMI, orientation=0.6),
        Contact("Red flare", hours(13), "bearing", 0.8, sensor=tuple(float(v) for v in away(lon, lat, -4, -4)),
                bearing=math.radians(130), bearing_std=math.radians(5), near=NMI, far=22 * NMI),
        Contact("Radar range", hours(15), "range", sensor=(lon, lat), range=12 * NMI, range_std=0.5 * NMI),
        Contact("Debris seen", hours(16), "area", area=Area(*(tuple(p[i] for p in box) for i in (0, 1)))),
    )  # fmt: skip


class Cloud:
    """Particles of three scenarios that drift to the south-east and spread."""

    def __init__(self, lon, lat, seed=5):
        rng = np.random.default_rng(seed)
        self.lon, self.lat = lon, lat
        self.scenario = rng.choice(3, N, p=PRIOR).astype(np.int32)
        middle = np.array([[0.0, 0.0], [-16.0, 10.0], [4.0, 4.0]])[self.scenario]
        spread = np.array([[6.0, 5.0], [9.0, 6.0], [5.0, 14.0]])[self.scenario]
        self.first = middle + spread * rng.normal(size=(N, 2))
        self.speed = np.array([0.55, -0.7]) + 0.2 * rng.normal(size=(N, 2))  # [kn]
        self.weight = np.full(N, 1 / N)

    def place(self, time):
        """Return positions [nmi] east and north of the origin."""
        return self.first + self.speed * (time - BEGIN).astype(float) / 3600

    def snapshot(self, time):
        east, north = self.place(time).T
        x, y = away(self.lon, self.lat, east, north)
        status = np.full(N, Status.ADRIFT, np.int32)
        return clouds.at(
            time,
            sphere.to_binary(x),
            sphere.to_binary(y),
            self.weight.copy(),
            status,
            self.scenario,
        )

    def inside(self, sortie):
        """Return whether each particle is in a sortie's area at its middle."""
        import shapely

        x, y = away(
            self.lon, self.lat, *self.place(sortie.start + (sortie.end - sortie.start) // 2).T
        )
        return shapely.contains_xy(shapely.Polygon(sortie.area.ring), x, y)


@functools.cache
def search(lon=-88.2, lat=27.8):
    """Return (forecast, sorties, contacts, updates) of a search that found nothing, with a beacon
    fix in between.
    """
    cloud, done, seen = Cloud(lon, lat), sorties(lon, lat), contacts(lon, lat)[:2]
    events = sorted([*done, *seen], key=lambda e: e.end if isinstance(e, Sortie) else e.time)
    times = sorted(
        {
            hours(0),
            *(t for s in done for t in (s.start, s.start + (s.end - s.start) // 2, s.end)),
            hours(24),
        }
        | {c.time for c in seen}
    )
    taken, updates, failed, k = [], [], np.ones(4), 0
    for time in times:
        while (
            k < len(events)
            and (events[k].end if isinstance(events[k], Sortie) else events[k].time) <= time
        ):
            updates.append(_update(cloud, events[k], failed))
            k += 1
        taken.append(cloud.snapshot(time))
    drawn = np.bincount(cloud.scenario) / N
    return (
        forecast_build.build_forecast(taken, scenarios=NAMES),
        done,
        seen,
        Updates(NAMES, drawn, tuple(updates)),
    )


def _update(cloud, event, failed):
    before = np.bincount(cloud.scenario, cloud.weight, 3)
    if isinstance(event, Sortie):
        inside = cloud.inside(event)
        likelihood = np.where(inside, 0.3 - 0.1 * (cloud.scenario == 2), 1.0)
    else:
        spot = event.fixes[0] if event.fixes else Fix(*away(cloud.lon, cloud.lat, 6, -12))
        east, north = away_back(cloud, spot.lon, spot.lat)
        d2 = np.sum((cloud.place(event.time) - [east, north]) ** 2, axis=1)
        likelihood = np.exp(-0.5 * d2 / 36.0) + 0.15
    seen = np.bincount(cloud.scenario, cloud.weight * likelihood, 3)
    log_evidence = np.log(np.append(seen / before, seen.sum()))
    ess = 1 / np.sum(cloud.weight**2)
    if isinstance(event, Sortie):
        within = np.bincount(cloud.scenario, cloud.weight * inside, 3)
        failed *= np.exp(log_evidence)
    cloud.weight *= likelihood / seen.sum()
    return Update(
        event.name,
        "sortie" if isinstance(event, Sortie) else "contact",
        event.end if isinstance(event, Sortie) else event.time,
        log_evidence,
        seen / seen.sum(),
        ess,
        1 / np.sum(cloud.weight**2),
        **(
            {
                "poc": np.append(within / before, within.sum()),
                "pos": 1 - np.exp(log_evidence),
                "cumulative": 1 - failed,
            }
            if isinstance(event, Sortie)
            else {}
        ),
    )


def away_back(cloud, lon, lat):
    east, north = sphere.offset(*np.radians([cloud.lon, cloud.lat]), *np.radians([lon, lat]))
    return float(east) / NMI, float(north) / NMI


def plan(lon=-88.2, lat=27.8, objective="pos", rounds=1):
    """Return a plan of three units, the third a boat in the frame of nothing else; two rounds of
    the first, if asked.
    """
    base = tuple(float(v) for v in away(lon, lat, -35, 38))
    shapes = (
        ("CG 1503", "Aircraft", (14, -10), 24.0, 15.0, 2.4, 3.0, 180.0, Law(), math.inf),
        (
            "Rescue 6021, a helicopter",
            "Helicopter",
            (-14, -3),
            14.0,
            9.0,
            0.6,
            1.5,
            90.0,
            Law("m_beta", 0.8),
            11.0,
        ),
        ("Cutter Venturous", "Boat", (2, -24), 9.0, 4.0, 1.9, 1.0, 14.0, Law(), math.inf),
    )
    taskings = []
    for number in range(1, rounds + 1):
        for k, (name, kind, spot, length, width, turned, spacing, speed, law, shape) in enumerate(
            shapes
        ):
            if number > 1 and k:
                continue
            centre = tuple(
                float(v)
                for v in away(lon, lat, spot[0] + 6 * (number - 1), spot[1] - 7 * (number - 1))
            )
            start = hours(17 + 0.5 * k + 5 * (number - 1))
            sortie = parallel(
                name, centre, length, width, turned, spacing, start, speed,
                kind=kind, law=law, shape=shape, group=f"{kind} eyes",
            )  # fmt: skip
            unit = Unit(
                name, kind, base, base, hours(16), speed * KNOT, 1.2 * speed * KNOT, 6 * 3600.0, law,
                sortie.sweep_width, shape, f"{kind} eyes", 500 * 0.3048,
            )  # fmt: skip
            transit = float(
                sphere.distance(
                    *np.radians(base), *np.radians([sortie.legs.lon[0], sortie.legs.lat[0]])
                )
            )
            leave = start - np.timedelta64(round(transit / unit.transit_speed), "s")
            back = float(
                sphere.distance(
                    *np.radians(base), *np.radians([sortie.legs.lon[-1], sortie.legs.lat[-1]])
                )
            )
            taskings.append(
                Tasking(
                    unit, number, sortie, leave, start, sortie.end,
                    sortie.end + np.timedelta64(round(back / unit.transit_speed), "s"),
                    centre, length * NMI, width * NMI, turned, turned + math.pi / 2, spacing * NMI,
                    len(sortie.legs.lon) // 2, 0.29 / (k + 1) / number,
                )
            )  # fmt: skip
    alive = objective == "alive"
    return Plan(
        PlanSpec(hours(16), hours(26), objective, rounds=rounds),
        tuple(taskings),
        0.31 if alive else 0.463,
        0.463,
        np.array([0.52, 0.33, 0.49]),
        0.33 if alive else 0.471,
        0.37 if alive else 0.528,
        0.004,
        (
            Alternative("squares of the same effort round the mean position", 0.350, 0.121, 0.003),
            Alternative("each unit on its own best, ignoring the others", 0.429, 0.042, 0.002),
        ),
        NAMES,
    )  # fmt: skip
