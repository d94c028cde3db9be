"""Memory, the loss at a stop and workers choose the number of shards; what does not fit is one
line.
"""

from pathlib import Path

import pytest

import drift
from drift.apps.cli import commands
from drift.pipeline import flow, run_setup
from drift.pipeline.shards import divide
from kernels.runtime import memory

PAINTS = False  # pictures of shards are compared by the tests of spills


@pytest.fixture
def unwritten(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the files of results out, which take seconds; their contents are compared."""
    monkeypatch.setattr(flow, "write_results", lambda *given, **more: None)


@pytest.mark.usefixtures("unwritten")
def test_a_refused_run_leaves_nothing(
    case: drift.Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*given: object) -> None:
        raise drift.UserError("too much was lost by the end")

    monkeypatch.setattr(run_setup, "check_end", refuse)
    with pytest.raises(drift.UserError, match="was lost by the end"):
        drift.run(case, tmp_path / "out", shards=4)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--shards", "0"], "give 1 to 9"),
        (["--shards", "10"], "give 1 to 9"),
        (["--memory", "0.2 GB"], "a run takes 0.7 GiB at least"),
        (["--memory", "plenty"], "--memory"),
        (["--memory", "1e400 GB"], "--memory"),
    ],
)
def test_bad_input_is_one_line(
    case: drift.Case, tmp_path: Path, capsys: pytest.CaptureFixture[str], more: list[str], said: str
) -> None:
    assert commands.main(["run", str(case.path), "--out", str(tmp_path / "out"), *more]) == 2
    told = capsys.readouterr().err.strip().splitlines()
    assert said in told[-1]
    assert list(tmp_path.iterdir()) == []


def test_memory_and_the_loss_at_a_stop_choose_the_shards(case: drift.Case) -> None:
    many = drift.vary(case, {"particles": 100_000_000})
    room = 0.8 * 2**30 - divide.BASE
    assert divide.number_of_shards(many, 0.8, None) == -(-100_000_000 // int(room / divide.HELD))
    assert divide.number_of_shards(many, 1e6, None) == 96  # of 2^20
    assert divide.number_of_shards(case, None, None) == 1


def test_the_memory_of_workers_chooses_the_shards(case: drift.Case) -> None:
    """Each has its own: a thousand of them on other machines do not share that of one."""
    many, gib = drift.vary(case, {"particles": 100_000_000}), 2**30
    two = divide.Workers(2, 3, 8 * gib)
    assert divide.number_of_shards(case, None, None, two) == 8
    assert (
        divide.number_of_shards(case, None, None, divide.Workers(64, 1, 8 * gib)) == 9
    )  # its blocks
    assert divide.number_of_shards(many, None, None, divide.Workers(8, 1, 8 * gib)) == 96  # of 2^20
    assert (
        divide.number_of_shards(many, None, None, divide.Workers(64, 1, 8 * gib)) == 256
    )  # 4 each
    tight = 1.6 * gib
    assert divide.number_of_shards(many, None, None, divide.Workers(8, 1, tight)) == -(
        -100_000_000 // int((tight / 2 - divide.BASE) / divide.HELD)
    )
    room = 2.4 * gib / 3 - divide.BASE  # they share with the process that was started
    assert divide.number_of_shards(many, 2.4, None, two) == -(
        -100_000_000 // int(room / divide.HELD)
    )
    with pytest.raises(
        drift.UserError,
        match=r"memory = 2 \(GiB\): 3 processes on one machine take 2\.1 GiB at least; .* fewer workers",
    ):
        divide.number_of_shards(many, 2.0, None, two)
    limited = divide.Workers(2, 3, 8 * gib, 0.8 * gib)  # dask lets each take no more
    room = 0.8 * gib - divide.BASE
    assert divide.number_of_shards(many, 1e6, None, limited) == -(
        -100_000_000 // int(room / divide.HELD)
    )
    with pytest.raises(
        drift.UserError,
        match=r"shards = 4: shards of this size take 5\.4 GiB, and memory is 1 \(GiB\)",
    ):
        divide.number_of_shards(many, 1, 4)
    assert divide.number_of_shards(many, 1, 400) == 400
    with pytest.raises(drift.UserError, match=r"memory = '4 GB': give a number of GiB"):
        divide.number_of_shards(many, "4 GB", None)  # type: ignore[arg-type]


def test_one_piece_that_does_not_fit_is_one_line(
    case: drift.Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(memory, "free", lambda: 30_000 * 250 - 1)
    with pytest.raises(
        drift.UserError,
        match=r"30,000 particles in one piece .* of memory are free; .* in shards that fit",
    ):
        drift.run(case, shards=1)
    monkeypatch.setattr(memory, "free", lambda: 30_000 * 250)
    drift.run(case, shards=1)
