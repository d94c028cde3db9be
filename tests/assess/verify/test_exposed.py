"""Errors of drifters many of which run aground, against drifters simulated here in float64 whose
law is known.
"""

import math

import numpy as np
import pytest
import trial_case
from scipy import stats

import drift
from drift.assess.verify import along, error_law, exposed, fitting, starts
from drift.assess.verify.error_law import Law
from drift.engine.environment.environment_spec import Coast
from drift.tracking.tracks import records
from drift.tracking.tracks.records import Track

RADIUS = 6_371_008.8  # [m] of the sphere
TRUE = Law(std=0.31, time=2 * 3600.0, bias=0.05, diffusivity=0.0, noise=1.0)
STEP, FIX, HOURS = 600.0, 3 * 3600.0, 96
SHORE = 10_000.0  # [m] north of where all begin, at 40 N
LAND = """{{"type": "FeatureCollection", "features": [{{"type": "Feature", "properties": {{}}, "geometry": {{"type": "Polygon",
"coordinates": [[[-50, {0}], [-30, {0}], [-30, 44], [-50, 44], [-50, {0}]]]}}}}]}}"""
COLUMNS = {"current_east": "u", "current_north": "v"}


class Bare:
    """A case without sources: all forcing comes from columns."""

    forcing = {}  # noqa: RUF012


def simulated(count, seed):
    """Return tracks of drifters in still water that stay where they reach the shore, a fix each 3 h
    for four days.
    """
    rng = np.random.default_rng(seed)
    keep = math.exp(-STEP / TRUE.time)
    error = rng.normal(0, TRUE.std, (count, 2))
    bias = rng.normal(0, TRUE.bias, (count, 2))
    place, still = np.zeros((count, 2)), np.zeros(count, bool)
    seen = [place]
    for k in range(1, round(HOURS * 3600 / STEP) + 1):
        new = keep * error + TRUE.std * math.sqrt(1 - keep**2) * rng.standard_normal((count, 2))
        moved = ((error + new) / 2 + bias) * STEP
        error = new
        # of the step, until it is ashore
        share = np.clip((SHORE - place[:, 1]) / np.maximum(moved[:, 1], 1e-9), 0, 1)
        place = place + np.where(still, 0.0, np.where(moved[:, 1] > 0, share, 1.0))[:, None] * moved
        still = place[:, 1] >= SHORE - 0.1
        if k * STEP % FIX == 0:
            seen.append(place)
    path = np.array(seen) + rng.normal(0, TRUE.noise, (len(seen), count, 2))
    time = 1.6e9 + FIX * np.arange(len(seen))
    lat = 40 + np.degrees(path[..., 1] / RADIUS)
    lon = -40 + np.degrees(path[..., 0] / RADIUS / np.cos(np.radians(lat)))
    none = np.zeros(time.size)
    return [Track(f"{k}", time, lon[:, k], lat[:, k], {"u": none, "v": none}) for k in range(count)]


def mean_error(tracks):
    """Return the mean error north [m/s] under the true law, and how many standard errors it is from
    the true one, 0.
    """
    ways = along.compare_displacements(Bare, tracks, COLUMNS, 4 * 3600.0, 3.0).ways
    found = error_law.likelihood(TRUE, along.residuals(ways, wind=False))
    return float(found.mean[1]), float(found.mean[1]) / math.sqrt(found.covariance[1, 1])


@pytest.fixture
def shore(tmp_path):
    file = tmp_path / "land.geojson"
    file.write_text(LAND.format(40 + math.degrees(SHORE / RADIUS)))
    return Coast(str(file), "strand")


@pytest.mark.thorough
def test_the_mean_error_is_recovered_from_drifters_of_which_most_run_aground(shore):
    """Without the ways near the shore it is within 3.3 standard errors, 1 in 1,000; with them it is
    not, and leans offshore.
    """
    believed = records.believed(simulated(1500, 3))
    assert 0.5 < np.mean([mask[-1] for mask in believed.aground]) < 0.9
    seen = exposed.exposed_tracks(starts.mark_stranded(believed, shore), shore, 4 * 3600.0)
    assert abs(mean_error(seen.tracks)[1]) < stats.norm.ppf(1 - 0.5e-3)
    afloat = [
        records.selected(track, ~mask)
        for track, mask in zip(believed.tracks, believed.aground, strict=True)
    ]
    assert mean_error([track for track in afloat if track.time.size > 1])[1] < -stats.norm.ppf(
        1 - 0.5e-3
    )


def test_where_a_track_ends_does_not_depend_on_what_comes_after(shore):
    """All that a drifter does from the first fix in reach of the shore on may be otherwise, and
    nothing changes.
    """
    tracks = simulated(60, 4)
    stranded = starts.mark_stranded(records.believed(tracks), shore)
    first = exposed.exposed_tracks(stranded, shore, 4 * 3600.0)
    kept = {track.name: track.time.size for track in first.tracks}
    begin = tracks[0].time[0]
    off = [40 + math.degrees(SHORE / RADIUS) - track.lat for track in tracks]  # [deg]
    speeds = np.concatenate([
        np.hypot(np.diff(track.lat), np.diff(track.lon) * np.cos(np.radians(track.lat[1:])))[: kept.get(track.name, 1) - 1]
        for track in tracks
    ])  # fmt: skip
    reach = np.quantile(speeds, 0.99)  # [deg] to the next fix, about: of the kept ways alone
    for track, distance in zip(tracks, off, strict=True):
        size = kept.get(track.name, 1)
        assert (distance[: size - 1] > 0.8 * reach).all()
        if size < track.time.size:
            assert distance[size - 1] < 1.3 * reach
            assert track.time[size - 1] <= begin + FIX * (size - 1)
    assert (
        "fixes left out because the drifter was aground: 12 h or more within 200 m, 3 h near a shore: "
        in first.notes[0]
    )
    left = sum(track.time.size for track in tracks) - sum(kept.values()) - (60 - len(kept))
    aground = sum(int(mask.sum()) for mask in stranded.ashore)
    assert first.notes[1].startswith(
        f"{left - aground:,} fixes left out: their drifter had come within "
    )


def test_the_fit_says_what_it_leaves_out_and_its_remedy_works(shore, tmp_path, monkeypatch):
    case = trial_case.load(
        tmp_path,
        start="2021-03-01T00:00Z",
        coast={"source": shore.source},
        scenario={"position": {"at": [-40, 40], "error": "1 nmi"}},
    )
    tracks = simulated(8, 5)
    monkeypatch.setattr(
        fitting,
        "fitted_errors",
        lambda ways, wind, notes, held_out: (along.residuals(ways, wind), notes),
    )
    found = {}
    for source in (shore.source, "none"):
        varied = drift.vary(case, {"coast.source": source})
        found[source], notes = fitting.fit_errors(varied, tracks, columns=COLUMNS, gap=4 * 3600.0)
        told = [note for note in notes if "of the shore, near enough to run aground" in note]
        assert len(told) == (source != "none")
        assert all('coast.source = "none" keeps these fixes' in note for note in told)
    assert found["none"].increments > found[shore.source].increments


def test_drifters_of_many_years_are_compared(tmp_path):
    """A case has at most 1,000 outputs; by the default every 6 h they would end after 250 days."""
    case = trial_case.load(
        tmp_path,
        start="2021-03-01T00:00Z",
        output={"every": "1 h"},
        current={"constant": {"east": 0.1, "north": 0}},
        scenario={"position": {"at": [-40, 40], "error": "1 nmi"}},
    )
    track = simulated(1, 6)[0]
    later = Track("z", track.time + 3.2e8, track.lon, track.lat, track.columns)
    ways = along.compare_displacements(case, [track, later], {}, 4 * 3600.0, 3.0).ways
    assert [
        way.model[1:] == pytest.approx(np.array([[0.1 * FIX, 0.0]] * (way.time.size - 1)), abs=0.01)
        for way in ways
    ]
