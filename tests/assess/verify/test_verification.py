"""Forecasts of drifters against drifters simulated here in float64."""

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from scipy import stats
from verified_drifters import CASE, EAST, NORTH, RADIUS, carried, case, simulated

import drift
from drift.apps.cli import commands
from drift.assess.verify import chapter as verification_chapter
from drift.assess.verify import scores, starts, verification
from drift.assess.verify import text as verification_text
from drift.case.tracking import reading
from drift.engine.environment.environment_spec import Coast
from drift.tracking.tracks.records import Believed, Track
from geo.errors import UserError

COUNT = 80


@pytest.mark.thorough
def test_areas_hold_what_they_say_and_ranks_are_uniform(tmp_path):
    """Within three standard errors of independent forecasts; ranks by Kolmogorov and Smirnov at 1
    in 1,000.
    """
    made = drift.verify(case(tmp_path), simulated(COUNT, 5), error=600.0, particles=800)
    assert made.skill.size == COUNT
    assert made.leads.tolist() == [6, 12, 24]
    for lead in range(3):
        for share in (0.5, 0.75, 0.9, 0.95):
            held = made.held(lead, share)
            assert abs(held.mean - share) < 3 * math.sqrt(share * (1 - share) / COUNT)
            assert held.error >= 0.99 * math.sqrt(held.mean * (1 - held.mean) / COUNT)
        for ranks in (made.containment, made.along, made.across):
            assert stats.kstest(ranks[:, lead], "uniform").pvalue > 1e-3
    assert "as stated" in verification_text.headline(made)
    # means of squares of n normals of variance s2 per component: relative standard error 1 /
    # sqrt(n) of the sum of both
    ratio = (made.apart[:, -1] ** 2).mean() / (made.spread[:, -1] ** 2).mean()
    assert abs(ratio - 1) < 3 / math.sqrt(COUNT)


@pytest.mark.thorough
def test_errors_a_third_as_large_hold_what_the_closed_form_says(tmp_path):
    """A round normal law a third as wide: its area of share p holds 1 - (1 - p)^(1/9) of the true
    law.

    The area's radius is r with r^2 = -2 (s / 3)^2 log(1 - p), and 1 - exp(-r^2 / 2 s^2) lies within
    it.
    """
    third = case(tmp_path, std=0.26 / 3, diffusivity=25.0 / 9)
    made = drift.verify(third, simulated(COUNT, 5), error=200.0, particles=800)
    for lead in range(3):
        for share in (0.5, 0.9, 0.95):
            expected = 1 - (1 - share) ** (1 / 9)
            assert abs(made.held(lead, share).mean - expected) < 3 * math.sqrt(
                expected * (1 - expected) / COUNT
            )
    assert "too small" in verification_text.headline(made)
    assert verification_text.headline(made) in repr(made)
    assert len(repr(made)) < 3000  # figures, and no arrays


def apart(lon1, lat1, lon2, lat2):
    """Return great-circle distances [m] by the haversine formula."""
    a, b, c, d = (np.radians(angle) for angle in (lon1, lat1, lon2, lat2))
    h = np.sin((d - b) / 2) ** 2 + np.cos(b) * np.cos(d) * np.sin((c - a) / 2) ** 2
    return 2 * RADIUS * np.arcsin(np.sqrt(h))


def test_skill_and_separation_without_errors(tmp_path):
    """A drifter that goes another way than the current, across the antimeridian: all distances
    follow from both ways.
    """
    begin = np.datetime64("2021-03-01T05:20", "s").astype(int)
    time = begin + np.cumsum([0, *np.random.default_rng(3).integers(900, 9000, 45)])
    lon, lat = carried(179.9, 44.2, time - begin + 1e-9, east=0.22, north=-0.09)
    track = Track("7", time.astype(float), (lon + 180) % 360 - 180, lat)
    made = drift.verify(
        case(tmp_path, std=0.0, diffusivity=0.0),
        [track],
        hours=18,
        every=6 * 3600.0,
        error=0.5,
        particles=1000,
    )
    last = time[-1] - 18 * 3600
    assert made.start.tolist() == list(range(begin, last + 1, 6 * 3600))
    hours = np.arange(3.0, 18.1, 3.0)
    assert made.hours.tolist() == hours.tolist()
    for n, start in enumerate(made.start):
        x, y = carried(
            179.9, 44.2, start - begin + 3600 * np.append(0.0, hours) + 1e-9, east=0.22, north=-0.09
        )
        u, v = carried(x[0], y[0], 3600 * hours)
        separation, persistence = apart(u, v, x[1:], y[1:]), apart(x[0], y[0], x[1:], y[1:])
        way = np.cumsum(apart(x[:-1], y[:-1], x[1:], y[1:]))
        # positions are whole multiples of 9.3 mm, a step; a chord between fixes 2.5 h apart leaves
        # the rhumb line by less than (way / 2)^2 tan(lat) / (2 R) = 0.1 m; the mean of 1000 starts
        # of std 0.42 m is off by 13 mm
        assert made.apart[n] == pytest.approx(separation, abs=1.0)
        assert made.waiting[n] == pytest.approx(persistence, abs=1.0)
        assert made.way[n] == pytest.approx(way, abs=2.0)
        assert made.skill[n] == pytest.approx(
            1 - separation.sum() / way.sum(), abs=2.0 * 6 / way.sum() * 2
        )
        assert made.staying[n] == pytest.approx(
            1 - persistence.sum() / way.sum(), abs=2.0 * 6 / way.sum() * 2
        )
        assert made.energy[n] == pytest.approx(separation[[1, 3, 5]], abs=1.0)
    assert (made.containment > 0.999).all()  # far outside
    # the current goes faster, and a drifter that heads less to the south lies to the left of it
    u, v = EAST / math.hypot(EAST, NORTH), NORTH / math.hypot(EAST, NORTH)
    difference = np.array([0.22 - EAST, -0.09 - NORTH])
    ahead, right = difference @ (u, v), difference @ (v, -u)
    assert (made.along[:, -1] > 0.5).all() == (ahead > 0)
    assert (made.across[:, -1] > 0.5).all() == (right > 0)
    told = verification_text.verification_facts(made)
    assert ("left" in told["rank across the drift"]) == (right < 0)
    assert ("slower" in told["rank along the drift"]) == (ahead < 0)
    assert "lower density than if it were uniform over" in told["after 18 h, scores"]


def test_containment_is_uniform_whatever_the_law():
    """The drifter as one more draw from a bent, clustered law, with a tenth of all at one place, as
    on a beach.
    """
    rng = np.random.default_rng(14)
    found = []
    for _ in range(300):
        x = rng.normal(0, 3000, 401)
        y = x**2 / 5000 + rng.normal(0, 300, 401)
        y[rng.random(401) < 0.3] -= 9000
        found.append(scores.containment(x[1:] - x[0], y[1:] - y[0], np.full(400, 1 / 400)))
    assert stats.kstest(found, "uniform").pvalue > 1e-3


def test_of_places_as_dense_as_the_drifters_half_counts() -> None:
    """All at one place are alike: the drifter's rank among them is in the middle, as that of places
    equal in a coordinate.
    """
    still = np.zeros(50)
    assert scores.containment(still, still, np.full(50, 1 / 50)) == pytest.approx(0.5)
    values = np.array([-3.0, 0.0, 0.0, 0.0, 2.0])
    assert scores.rank(values, np.full(5, 0.2)) == pytest.approx((1 + (3 + 1) / 2) / 6)


def test_columns_along_the_track_are_a_current_by_time(tmp_path):
    """The same forecast, particle for particle, as of a case that has the columns' values as a
    table of its own.
    """
    track = simulated(1, 9, hours=30)[0]
    u = 0.2 + 0.1 * np.sin(np.arange(31) / 3.1)
    v = -0.1 + 0.2 * np.cos(np.arange(31) / 2.3)
    given = Track("9", track.time, track.lon, track.lat, {"ue": u, "vn": v})
    base = case(tmp_path)
    columns = {"current_east": "ue", "current_north": "vn"}
    made = drift.verify(base, [given], columns=columns, every=3600.0 * 100, particles=600)
    rows = [
        {"time": f"{np.datetime64(int(t), 's')}Z", "east": float(a), "north": float(b)}
        for t, a, b in zip(track.time[:25], u, v, strict=False)
    ]
    other = drift.verify(
        drift.vary(base, {"current": [{"name": "t", "table": rows}]}),
        [given],
        every=3600.0 * 100,
        particles=600,
    )
    assert np.array_equal(made.apart, other.apart)
    assert np.array_equal(made.containment, other.containment)
    with pytest.raises(UserError, match='no column "w"'):
        drift.verify(base, [given], columns={"current_east": "ue", "current_north": "w"})


@pytest.mark.parametrize("job", [drift.verify, drift.fit_errors])
def test_what_does_not_drift_is_refused(tmp_path, job):
    base = case(tmp_path)
    steaming = replace(base, scenarios=(replace(base.scenarios[0], model="steaming"),))
    with pytest.raises(UserError) as caught:
        job(steaming, simulated(2, 3))
    assert str(caught.value) == (
        f'{base.path.name}: scenario "drifter" has motion = "steaming"; '
        'drifters can only be compared with motion = "drift"'
    )


@pytest.mark.parametrize(
    ("stated", "words", "spread"),
    [
        (
            None,
            "current 0.31 m/s over 11 h and 0.08 m/s that lasts (default)",
            (0.31, 11 * 3600.0, 0.08),
        ),
        (
            {"current": {"std": 0.0, "bias": 0.3}},
            "current 0.3 m/s that lasts (case)",
            (0.0, 1.0, 0.3),
        ),
        ("none", "no error of the current (case)", (0.0, 1.0, 0.0)),
    ],
)
def test_columns_of_a_model_err_as_its_files_would(tmp_path, stated, words, spread):
    """What is told of the errors is what particles have: after t, 2 s^2 T (t - T (1 - exp(-t / T)))
    + b^2 t^2 a component.
    """
    track = simulated(1, 9, hours=30)[0]
    given = Track(
        "9", track.time, track.lon, track.lat, {"ue": np.full(31, 0.2), "vn": np.full(31, -0.1)}
    )
    base = drift.vary(case(tmp_path), {"uncertainty": stated})
    columns = {"current_east": "ue", "current_north": "vn"}
    made = drift.verify(base, [given], columns=columns, every=3600.0 * 100, particles=4000)
    assert verification_text.assumed_errors(made).startswith(words)
    std, memory, bias = spread
    t = 86_400.0
    walk = 2 * std**2 * memory * (t - memory * (1 - math.exp(-t / memory)))
    expected = 2 * (walk + bias**2 * t**2 + (100 / math.sqrt(2 * math.log(2))) ** 2)
    # a mean square of 4,000 pairs of normals: relative standard error 1 / sqrt(4,000)
    assert abs(made.spread[0, -1] ** 2 / expected - 1) < 3 / math.sqrt(4000)


def test_the_command_writes_results_that_are_whole(tmp_path, capsys):
    case(tmp_path)
    rows = ["id,time,lon,lat"]
    for track in simulated(3, 2):
        rows += [
            f"{track.name},{np.datetime64(int(t), 's')}Z,{x},{y}"
            for t, x, y in zip(track.time, track.lon, track.lat, strict=True)
        ]
    (tmp_path / "buoys.csv").write_text("\n".join(rows))
    out = tmp_path / "out"
    told = [
        "--drifters",
        str(tmp_path / "buoys.csv"),
        "--error",
        "600 m",
        "--particles",
        "500",
        "--out",
        str(out),
    ]
    assert commands.main(["verify", str(tmp_path / "case.toml"), *told]) == 0
    said = capsys.readouterr().out
    assert "the 90 % area held" in said
    assert "few" in said
    assert {path.name for path in drift.results(out)} == {
        *verification_chapter.FILES,
        *verification_chapter.PICTURES,
        "summary.json",
        "manifest.json",
    }
    listed = list(csv.DictReader((out / "verify.csv").read_text().splitlines()))
    assert len(listed) == 3 * 3
    summary = json.loads((out / "summary.json").read_text())["verification"]
    with xr.open_dataset(out / "verify.nc") as stored:
        assert stored["containment"].shape == (3, 3)
        assert stored.attrs["uncertainty"].startswith(
            "current 0.26 m/s over 7 h (case); diffusivity 25 m2/s (case); start 600 m"
        )
        share = float((stored["containment"][:, -1] <= 0.9).mean())
    assert summary["leads"][-1]["held"]["90%"]["mean"] == pytest.approx(share)
    for name in ("energy_score_m", "log_score_per_km2"):
        own = [float(row[name]) for row in listed if row["lead_h"] == "24"]
        assert summary["leads"][-1][name]["mean"] == pytest.approx(np.mean(own), rel=1e-4)
    assert "energy score" in said
    assert "SS*" in said
    assert share == pytest.approx(
        np.mean([float(row["containment"]) <= 0.9 for row in listed if row["lead_h"] == "24"])
    )
    for wrong, words in (
        (["--error", "3 kn"], "--error"),
        (["--every", "1 s"], "--every"),
        (["--hours", "1.5"], "--hours"),
        (["--columns", "current_east=u"], "without its other"),
        (["--columns", "tide=u"], "must be one of"),
        (["--particles", "20"], "--particles"),
        (["--hours", "200"], "no drifter can be followed"),
    ):
        assert (
            commands.main(["verify", str(tmp_path / "case.toml"), *told, "--overwrite", *wrong])
            == 2
        )
        assert words in capsys.readouterr().err


def test_no_forecast_begins_ends_or_passes_in_a_silence():
    """Hourly fixes from 0 to 3 h and from 9 to 40 h, and one at 50 h: only what stays within 9 to
    40 h is forecast.
    """
    hours = np.array([0, 1, 2, 3, *range(9, 41), 50.0])
    track = Track("a", 1.6e9 + 3600 * hours, 0.001 * hours, 45.0 + 0.001 * hours)
    stranded = starts.mark_stranded(
        Believed((track,), (), (np.zeros(37, bool),)), Coast("none", "strand")
    )
    for length, begins, silent, ended in (
        (24, [12], 8, 0),
        (6, [12, 18, 24, 30], 5, 0),
        (1, [0, 12, 18, 24, 30, 36], 3, 0),
    ):
        found, left, _ = starts.find_starts(stranded, 6 * 3600.0, length * 3600.0, 3 * 3600.0, 3.0)
        assert [(one.track, (one.time - 1.6e9) / 3600, one.until) for one in found] == [
            (0, x, np.inf) for x in begins
        ]
        assert (left.gap, left.ended, left.aground, left.stopped) == (silent, ended, 0, 0)


def test_forecasts_that_overlap_share_a_cluster_but_no_random_number(tmp_path):
    """Of 25 h, begun a day apart: clusters of two days. Each has a seed of its own."""
    made = drift.verify(
        case(tmp_path), simulated(1, 9, hours=96), hours=25, every=86_400.0, particles=500
    )
    assert made.start.size == 3
    assert made.block.tolist() == (made.start // (2 * 86_400)).tolist()
    assert np.unique(made.block).size == 2
    track, hours = simulated(1, 9, hours=96)[0], np.array([3.0, 25.0])
    seeds = {
        verification._case(case(tmp_path), track, begin, hours, 100.0, 500, {}, k).seed
        for k, begin in enumerate(made.start.tolist())
    }
    assert len(seeds) == 3


def test_lost_probability_is_not_judged():
    held = verification.Estimate(0.2, 0.01, 50, 5, 20)
    assert "too small" in verification_text.verdict(0.9, held, 0.01)
    assert "not to be judged" in verification_text.verdict(0.9, held, 0.3)


def test_skill_of_liu_and_weisberg():
    """1 - (sum of separations / sum of ways so far), by hand; never below 0."""
    assert scores.skill(np.array([1.0, 3.0, 2.0]), np.array([4.0, 6.0, 10.0])) == pytest.approx(0.7)
    far = np.array([10.0, 30.0, 2.0])
    assert scores.skill(far, np.array([4.0, 6.0, 10.0])) == 0
    assert scores.unclipped_skill(far, np.array([4.0, 6.0, 10.0])) == pytest.approx(-1.1)


def test_columns_stand_for_forcing_that_the_case_does_not_have(tmp_path, capsys):
    """The same forecasts as beside a constant that is not used; for the object's wind too."""
    text = CASE.format(std=0.26, time=7.0, diffusivity=25.0, east=EAST, north=NORTH)
    text = text.replace('object = "water"', 'object = { windage = "2 %" }')
    wind = "wind = [{ constant = { east = 1, north = 0 } }]\n"
    (tmp_path / "whole.toml").write_text(text.replace("[uncertainty]", f"{wind}[uncertainty]"))
    line = next(line for line in text.splitlines() if line.startswith("current = [{"))
    (tmp_path / "bare.toml").write_text(text.replace(line, ""))
    track = simulated(1, 9, hours=30)[0]
    rows = ["id,time,lon,lat,u,v,a,b"]
    rows += [
        f"9,{np.datetime64(int(t), 's')}Z,{x},{y},0.2,{0.1 * math.sin(k)},{3 * math.cos(k)},-4"
        for k, (t, x, y) in enumerate(zip(track.time, track.lon, track.lat, strict=True))
    ]
    (tmp_path / "buoy.csv").write_text("\n".join(rows))
    columns = "current_east=u,current_north=v,wind_east=a,wind_north=b"
    whole = drift.verify(
        drift.load(tmp_path / "whole.toml"),
        tmp_path / "buoy.csv",
        columns=reading.parse_columns(columns),
        particles=500,
    )
    told = [
        "verify",
        str(tmp_path / "bare.toml"),
        "--drifters",
        str(tmp_path / "buoy.csv"),
        "--particles",
        "500",
    ]
    assert (
        commands.main([*told, "--columns", columns, "--out", str(tmp_path / "out"), "--quiet"]) == 0
    )
    listed = list(csv.DictReader((tmp_path / "out" / "verify.csv").read_text().splitlines()))
    assert [float(row["containment"]) for row in listed] == whole.containment.ravel().round(
        4
    ).tolist()
    assert [float(row["spread_m"]) for row in listed] == whole.spread[:, [1, 3, 7]].ravel().round(
        1
    ).tolist()
    fit = ["fit-errors", str(tmp_path / "bare.toml"), "--drifters", str(tmp_path / "buoy.csv")]
    assert commands.main([*fit, "--columns", columns.replace("=u,", "=x,")]) == 2
    assert (
        'no column "x"; its columns are id, time, lon, lat, u, v, a, b' in capsys.readouterr().err
    )
    # nothing gives a current
    assert commands.main([*fit, "--columns", "wind_east=a,wind_north=b"]) == 2
    assert "has no current" in capsys.readouterr().err
    loaded = drift.load(tmp_path / "bare.toml", along=["current", "wind"])
    with pytest.raises(
        UserError, match="loaded with along = current, but no columns for it were given"
    ):
        drift.verify(loaded, [track])
