"""The command that fits errors prints an uncertainty to paste."""

import math
import tomllib

import numpy as np
import pytest
import trial_case
from simulated_drifters import COLUMNS, simulated

import drift
from drift.apps.cli import commands
from drift.assess.verify.error_law import Law
from drift.case.values import units


@pytest.mark.thorough
def test_the_command_prints_an_uncertainty_to_paste(tmp_path, capsys):
    rows = ["buoy;time;lat;lon;u;v;a;b"]
    for track in simulated(
        np.random.default_rng(40), 3, 0.9, Law(0.2, 3 * 3600.0, 0.2, 30.0, 90.0)
    ):
        columns = (track.lat, track.lon, *(track.columns[name] for name in "uvab"))
        rows += [f"{track.name};{np.datetime64(round(t * 1000), 'ms')}Z;{';'.join(map(repr, map(float, row)))}"
                 for t, row in zip(track.time, zip(*columns, strict=True), strict=True)]  # fmt: skip
    (tmp_path / "buoys.csv").write_text("\n".join(rows))
    case = trial_case.load(
        tmp_path,
        start="2021-03-01T00:00Z",
        scenario={"position": {"at": [-6, 47], "error": "1 nmi"}},
    )
    given = ["fit-errors", str(case.path), "--drifters", str(tmp_path / "buoys.csv")]
    columns = "current_east=u,current_north=v,wind_east=a,wind_north=b"
    assert commands.main([*given, "--columns", columns]) == 0
    said = capsys.readouterr().out
    made = drift.fit_errors(case, tmp_path / "buoys.csv", columns=COLUMNS)
    table = said[said.index("[uncertainty]") :]
    pasted = tomllib.loads(table)["uncertainty"]
    assert units.quantity(pasted["current"]["std"], "m/s", "", "") == pytest.approx(
        made.law.std, abs=5e-4
    )
    assert units.quantity(pasted["current"]["time"], "s", "", "") == pytest.approx(
        made.law.time, abs=180
    )
    assert units.quantity(pasted["current"]["bias"], "m/s", "", "") == pytest.approx(
        made.standing_bias, abs=5e-4
    )
    assert units.quantity(pasted["diffusivity"], "m^2/s", "", "") == pytest.approx(
        made.law.diffusivity, rel=0.05, abs=0.05
    )
    assert f'object = {{ windage = "{100 * made.windage:.2f} %" }}' in table
    # the mean's square, less its error's, joins the square of the bias: what a drifter's bias is
    # where the mean is left in
    square = made.law.bias**2 + (np.square(made.mean).sum() - np.square(made.mean_error).sum()) / 2
    assert made.standing_bias == pytest.approx(math.sqrt(max(square, made.law.bias**2)))
    drift.vary(drift.load(tmp_path / "case.toml"), {"uncertainty": pasted})
    for wrong, words in (
        (["--max-gap", "9 min"], "no two fixes at most 0.15 h apart"),
        (["--max-gap", "-1 h"], "--max-gap"),
        (["--columns", "current_east=q,current_north=v"], 'no column "q"'),
        (["--max-speed", "3 h"], "--max-speed"),
    ):
        assert commands.main([*given, *wrong]) == 2
        assert words in capsys.readouterr().err
