"""One past case: a finished run, where its object was found, and the score of the forecast.

A forecast is scored as it was before the find. Outputs at and after a contact that reports the find
know of it, so they are not used. Between two outputs both maps are moved along the mean track to
the time of the find, and the logarithm of 1 - containment is interpolated: for a cloud that moves
steadily and keeps its form this is exact.
"""

import json
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from drift.case.values import units
from drift.case.values.rows import Rows
from drift.forecast import containment, likeliest_places
from drift.products.files import publication, writer
from geo import notation, sphere
from geo.array import Array
from geo.errors import UserError
from geo.files import dataset
from geo.notation import NMI

FOUND = "found"  # name of a contact that reports the find
SAME_PLACE, SAME_TIME = NMI, 3600.0  # [m, s] within which a contact counts as the find itself
NEEDED = (
    "probability",
    "probability_ashore",
    "containment",
    "cell_area",
    "mean_lon",
    "mean_lat",
)


@dataclass(frozen=True)
class Find:
    """Where and when the object of a run was found."""

    time: np.datetime64  # UTC
    lon: float  # [deg]
    lat: float


@dataclass(frozen=True)
class Run:
    """A finished run with a forecast."""

    folder: Path
    data: xr.Dataset  # forecast.nc
    summary: Mapping[str, Any]
    contacts: tuple[tuple[str, Find], ...]  # contacts with a single position, by name

    @property
    def name(self) -> str:
        """The name of the folder."""
        return self.folder.resolve().name

    @property
    def run_id(self) -> str:
        """The identifier of the run."""
        return str(self.data.attrs["run_id"])

    @property
    def find(self) -> Find | None:
        """The find that the case reports as a contact called "found"; None without one."""
        return next((f for name, f in self.contacts if name.strip().lower() == FOUND), None)


@dataclass(frozen=True)
class Incident:
    """The score of one forecast at its find."""

    run: str
    run_id: str
    title: str
    start: np.datetime64
    find: Find
    nearest: np.datetime64  # nearest output that was used
    containment: float  # share of the smallest area that holds the find
    separation: float  # [m] from the most likely place: afloat, or ashore if more is
    ashore: bool  # whether that place is ashore, at the nearest output
    from_coast: float  # [m] from the most likely stretch of coast; NaN: too little is ashore
    coast_share: float  # probability of that stretch; NaN as before
    from_mean: float  # [m] from the mean position
    sorties: int  # sorties that had ended before the find
    pos: float  # their cumulative POS; 0 without sorties

    @property
    def hours(self) -> float:
        """Hours from the start of the run to the find."""
        return float((self.find.time - self.start) / np.timedelta64(1, "s")) / 3600


def open_run(folder: Path) -> Run:
    """Return a finished run, read completely.

    Raises:
        UserError: the folder has no finished forecast of a search object.
    """
    names = {path.name for path in publication.results(folder)}
    if "forecast.nc" not in names or "washup.nc" in names:
        what = "is of a spill" if "washup.nc" in names else "has no forecast.nc"
        raise UserError(
            f"results {folder}: {what}; drift score needs folders that drift run wrote for a "
            "search object"
        )
    if "plan.json" in names:
        raise UserError(
            f"results {folder}: come from drift plan, whose forecast assumes that the plan fails; "
            "give the folder of drift run"
        )
    with closing(dataset.open_local(folder / "forecast.nc")) as opened:
        data = opened.load()
    missing = [name for name in NEEDED if name not in data]
    if missing:
        raise UserError(f"results {folder}: forecast.nc has no {missing[0]}; run the case again")
    summary = publication.summary(folder, writer.SUMMARY) or {}
    contacts = _contacts(folder) if "sorties.geojson" in names else ()
    return Run(folder, data, summary, contacts)


def _contacts(folder: Path) -> tuple[tuple[str, Find], ...]:
    """Return the names and positions of contacts in sorties.geojson that are one point."""
    document = json.loads((folder / "sorties.geojson").read_text(encoding="utf-8"))
    found = []
    for feature in document["features"]:
        properties, geometry = feature["properties"], feature["geometry"]
        if properties["kind"] == "contact" and geometry["type"] == "Point":
            lon, lat = geometry["coordinates"][:2]
            time = np.datetime64(properties["time"].removesuffix("Z"), "s")
            found.append((str(properties["name"]), Find(time, float(lon), float(lat))))
    return tuple(found)


def read_finds(path: Path) -> dict[str, Find]:
    """Return the finds of a CSV file with the columns run, time, lon and lat, by run.

    Raises:
        UserError: the file cannot be read, or a line is wrong; one line for each mistake.
    """
    columns = ("run", "time", "lon", "lat")
    table = Rows(str(path), columns, columns, words=("run",))
    finds: dict[str, Find] = {}
    wrong = []
    for number, row in table:
        place = f"{path.name}, line {number}"
        if row is None:
            wrong.append(f"{place}: {table.wanted}")
            continue
        try:
            time = units.time(row["time"])
            if isinstance(time, np.timedelta64):
                raise ValueError(f'"{row["time"]}" must be a date and time')
            find = Find(time, _angle(row["lon"], "EW", 360), _angle(row["lat"], "NS", 90))
        except ValueError as error:
            wrong.append(f"{place}: {error}")
            continue
        if row["run"] in finds:
            wrong.append(f'{place}: there is a second find of run "{row["run"]}"; give one')
        finds[row["run"]] = find
    if wrong:
        raise UserError(*wrong)
    return finds


def _angle(text: str, letters: str, limit: float) -> float:
    """Return a longitude or latitude [deg] in decimal degrees, or as a case writes it."""
    try:
        value = float(text)
    except ValueError:
        return units.angle(text, letters)
    if not abs(value) <= limit:
        raise ValueError(f"{text} must be from -{limit:g} to {limit:g} degrees")
    return value


def score_run(run: Run, find: Find, within: float) -> Incident:
    """Return the score of a run's forecast at a find.

    Args:
        run: the finished run.
        find: where and when its object was found.
        within: largest time [s] from the find to an output, if there is none on its other side.

    Raises:
        UserError: no usable output is near the time of the find.
    """
    usable = _usable_outputs(run, find)
    used = _outputs_about(run, find, usable, within)
    times = run.data["time"].values
    apart = np.array([_seconds(times[output], find.time) for output in used])
    weight = np.ones(1) if len(used) == 1 else 1 - np.abs(apart) / np.abs(apart).sum()
    shares, likely, from_mean = [], [], []
    for output in used:
        # The find moves with the map from its own time to that of the output.
        place = _carried(run, find, output, usable)
        (share,) = containment.containment_at(run.data, times[output], *place[:, None])
        shares.append(float(share))
        likely.append(_likeliest(run, output, place))
        from_mean.append(_apart(place, _mean(run, output)))
    nearest = int(np.argmin(np.abs(apart)))
    outer = np.log(np.maximum(1 - np.array(shares), containment.LEAST))
    sorties, pos = _searched(run, find.time)
    return Incident(
        run.name,
        run.run_id,
        str(run.data.attrs["title"]),
        np.datetime64(run.summary["run"]["start"], "s"),
        find,
        times[used[nearest]].astype("datetime64[s]"),
        1.0 if min(shares) >= 1 else float(1 - np.exp(weight @ outer)),
        float(weight @ np.array([one.apart for one in likely])),
        likely[nearest].ashore,
        float(weight @ np.array([one.from_coast for one in likely])),
        float(weight @ np.array([one.coast_share for one in likely])),
        float(weight @ np.array(from_mean)),
        sorties,
        pos,
    )


def _seconds(time: np.datetime64, since: np.datetime64) -> float:
    return float((time - since) / np.timedelta64(1, "s"))


def _usable_outputs(run: Run, find: Find) -> Array:
    """Return the indices of the outputs that have a map and do not know of the find."""
    times = run.data["time"].values
    reported = _reported(run, find)
    clean = np.ones(len(times), bool) if reported is None else times < reported
    return np.flatnonzero(clean & np.isfinite(run.data["mean_lat"].values))


def _outputs_about(run: Run, find: Find, usable: Array, within: float) -> tuple[int, ...]:
    """Return the indices of the outputs before and after a find, or of one that is near it."""
    times = run.data["time"].values
    apart = np.array([_seconds(times[k], find.time) for k in usable])
    before, after = usable[apart <= 0], usable[apart >= 0]
    if before.size and after.size:
        # on the find itself both are one output
        return tuple(dict.fromkeys((int(before[-1]), int(after[0]))))
    if usable.size and np.abs(apart).min() <= within:
        return (int(usable[np.argmin(np.abs(apart))]),)
    limit = f"{within / 60:.0f} min"
    when = notation.format_dtg(find.time)
    if _reported(run, find) is not None:
        raise UserError(
            f"results {run.folder}: the run used the find of {when} as a contact, and has no "
            f"output within {limit} before it; run the case again without this contact, or with "
            "more outputs (output.every)"
        )
    raise UserError(
        f"results {run.folder}: no output is within {limit} of the find at {when}; outputs go "
        f"from {notation.format_dtg(times[0])} to {notation.format_dtg(times[-1])}: check the "
        "time, or give --within"
    )


def _reported(run: Run, find: Find) -> np.datetime64 | None:
    """Return the time of the first contact that reports a find; None without one."""
    known = [
        contact.time
        for name, contact in run.contacts
        if name.strip().lower() == FOUND
        or (
            abs(_seconds(contact.time, find.time)) <= SAME_TIME
            and _apart(_position(contact), _position(find)) <= SAME_PLACE
        )
    ]
    return min(known, default=None)


def _position(find: Find) -> Array:
    return np.array([find.lon, find.lat])


def _apart(one: Array, other: Array) -> float:
    """Return the distance [m] between two positions (lon, lat) [deg]."""
    return float(sphere.distance(*np.radians(one), *np.radians(other)))


def _mean(run: Run, output: int) -> Array:
    """Return the mean position (lon, lat) [deg] at an output."""
    return np.array([float(run.data[name].values[output]) for name in ("mean_lon", "mean_lat")])


class _Likely(NamedTuple):
    """How far a place is from the most likely places of an output."""

    apart: float  # [m] from the first
    ashore: bool  # whether the first is ashore
    from_coast: float  # [m]; NaN without a stretch of coast
    coast_share: float


def _likeliest(run: Run, output: int, place: Array) -> _Likely:
    """Return how far a place (lon, lat) [deg] is from the most likely ones of an output."""
    found = likeliest_places.likeliest_places(run.data.isel(time=output))
    apart = [_apart(place, np.array([one.lon, one.lat])) for one in found]
    coast = [(far, one.share) for far, one in zip(apart, found, strict=True) if one.ashore]
    return _Likely(apart[0], found[0].ashore, *(coast[0] if coast else (np.nan, np.nan)))


def _carried(run: Run, find: Find, output: int, usable: Array) -> Array:
    """Return a find (lon, lat) [deg] moved along the mean track from its time to an output.

    Beyond the usable outputs the track goes on as between the last two of them.
    """
    if len(usable) < 2:
        return _position(find)
    times = run.data["time"].values[usable]
    seconds = np.array([_seconds(time, find.time) for time in times])
    track = np.array([_mean(run, k) for k in usable])
    track[:, 0] = np.unwrap(track[:, 0], period=360)
    first = int(np.clip(np.searchsorted(seconds, 0.0) - 1, 0, len(seconds) - 2))
    share = -seconds[first] / (seconds[first + 1] - seconds[first])
    mean = track[first] + share * (track[first + 1] - track[first])
    east, north = sphere.offset(*np.radians(mean), *np.radians(_mean(run, output)))
    lon, lat = sphere.destination(np.radians(find.lon), np.radians(find.lat), east, north)
    return np.degrees([float(lon), float(lat)])


def _searched(run: Run, time: np.datetime64) -> tuple[int, float]:
    """Return the number of sorties that had ended by a time, and their cumulative POS."""
    updates = run.summary.get("search", {}).get("updates", ())
    done = [
        update
        for update in updates
        if update["kind"] == "sortie"
        and np.datetime64(update["time"].removesuffix("Z"), "s") <= time
    ]
    if not done:
        return 0, 0.0
    return len(done), float(done[-1]["cumulative_pos"]["all"])
