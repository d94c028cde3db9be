"""`[expect]` of a case: `drift run` says whether the forecast is so, in a line and in its exit
status.

Right by construction: without a coast and without an end of the forcing all of it is adrift,
whatever the numbers drawn.
"""

import json

import pytest
import trial_case

from drift.apps.cli import commands


def run(tmp_path, expected: str, *options: str) -> int:
    path = trial_case.write(
        tmp_path,
        f"[expect]\n{expected}",
        duration="2 h",
        scenario={"position": {"at": "60 00N 000 00E", "std": "1 nmi"}},
    )
    return commands.main(["run", str(path), "--out", str(tmp_path / "out"), *options])


def test_a_forecast_as_expected_ends_with_0(tmp_path, capsys):
    assert (
        run(
            tmp_path,
            'adrift = [1, 1]\nmean_position_within = { of = "60 00N 000 02E", distance = "0.3 nmi" }',
        )
        == 0
    )
    assert "as [expect] says" in capsys.readouterr().out


def test_a_miss_is_a_line_and_exit_status_1_and_the_results_stand(tmp_path, capsys):
    assert run(tmp_path, "adrift = [0.25, 0.355]") == 1
    assert "adrift: 100 %, expected 25 to 35.5 %" in capsys.readouterr().out
    assert (tmp_path / "out" / "summary.json").exists()
    # nothing to do, and still not so
    assert run(tmp_path, "adrift = [0.25, 0.355]", "--resume", "--json") == 1
    answer = json.loads(capsys.readouterr().out)
    assert answer["unchanged"]
    assert answer["expect"] == {"met": False, "misses": ["adrift: 100 %, expected 25 to 35.5 %"]}
    assert run(tmp_path, "adrift = [0.25, 0.355]", "--overwrite", "--quiet") == 1
    assert "missed [expect]: adrift: 100 %" in capsys.readouterr().err


@pytest.mark.thorough
@pytest.mark.parametrize("expected", ["", "adrift = [0, 0]"])
def test_a_case_that_expects_nothing_says_nothing(tmp_path, capsys, expected):
    assert run(tmp_path, expected, "--set", "expect={}") == 0
    assert "[expect]" not in capsys.readouterr().out
