"""Runs on graphics cards: shards follow the card's memory, and nothing of another card or backend
is taken for theirs.
"""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import trial_case

import drift
from drift.pipeline import run_metadata, run_setup
from drift.pipeline.shards import divide, fingerprint, shelf, work
from geo.errors import UserError
from kernels.runtime import drivers, memory, runtime
from kernels.runtime.devices import Device, Listed

GIB = 2**30
CARD = Device("cuda", 0, "Card", "discrete", "driver 550.54, CUDA 12.4", 80 * GIB, 80 * GIB)


@pytest.fixture
def on_card(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Return what makes it look as if a card ran that has so much memory left [bytes]; the host has
    200 GiB.
    """
    monkeypatch.setattr(memory, "free", lambda: 200 * GIB)

    def running(free: int) -> None:
        now = replace(CARD, free=free)
        monkeypatch.setattr(drivers, "ask", lambda backend: Listed(backend, (now,)))
        monkeypatch.setattr(
            runtime, "_started", {"backend": "cuda", "threads": 2, "thread": -1, "device": CARD}
        )

    return running


def case_of(folder: Path, particles: int) -> drift.Case:
    return trial_case.load(folder, duration="1 h", particles=particles, output={"trajectories": 0})


def test_a_coast_takes_its_part_of_the_card(tmp_path: Path, on_card: Callable[[int], None]) -> None:
    """By hand: 2^30 bytes are 3,834,792 particles of 280 bytes; 10^8 make 26.1 shards of those."""
    case = case_of(tmp_path, 10**8)
    on_card(4 * GIB)
    assert (
        divide.number_of_shards(
            replace(case, coast=replace(case.coast, source="gshhg")), None, None
        )
        == 27
    )


def test_a_shard_fits_into_half_of_the_card(tmp_path: Path, on_card: Callable[[int], None]) -> None:
    """By hand: 4 GiB left are 2 for a shard, of which 1 is not for particles; 2^30 / 200 bytes are
    5,368,709 particles.
    """
    case = case_of(tmp_path, 10**8)
    assert run_setup.ON_CARD == 200
    assert (
        divide.number_of_shards(case, None, None) == 96
    )  # on the processor of 200 GiB: 2^20 in each
    on_card(4 * GIB)
    assert divide.number_of_shards(case, None, None) == 19  # 18.6
    on_card(80 * GIB)
    assert divide.number_of_shards(case, None, None) == 12  # 2^23 in each
    # the host has so much for the run: 1 GiB beside 0.7
    assert divide.number_of_shards(case, 1.7, None) == 19
    on_card(GIB)
    # 2^16 in each, with the least that a card must have
    assert divide.number_of_shards(case, None, None) == 1526


def test_shards_that_do_not_fit_into_the_card_are_refused_and_more_are_not(
    tmp_path: Path, on_card: Callable[[int], None]
) -> None:
    """1 GiB and 50,000,000 particles of 200 bytes are 10.3 GiB; a third of 10^8 take 7.2."""
    case = case_of(tmp_path, 10**8)
    on_card(8 * GIB)
    with pytest.raises(
        UserError,
        match=r"^shards = 2: 50,000,000 particles at once take 10\.4 GiB of the graphics card, of which 8\.0 GiB are free; give more shards$",
    ):
        divide.number_of_shards(case, None, 2)
    assert divide.number_of_shards(case, None, 3) == 3


def test_one_piece_that_the_card_does_not_hold_is_refused(
    tmp_path: Path, on_card: Callable[[int], None]
) -> None:
    case = case_of(tmp_path, 10**8)
    filled = replace(case, resampling=replace(case.resampling, method="course", bulk=0.1))
    on_card(8 * GIB)
    with pytest.raises(
        UserError,
        match=r"^particles: 100,000,000 particles at once take 19\.7 GiB of the graphics card",
    ):
        divide.number_of_shards(filled, None, None)
    on_card(20 * GIB)
    assert divide.number_of_shards(filled, None, None) == 1


def test_a_forecast_in_brief_that_the_card_does_not_hold_is_refused(
    tmp_path: Path, on_card: Callable[[int], None]
) -> None:
    on_card(2 * GIB)
    """By hand: 1 GiB and 10^7 particles of 200 bytes are 2.87 GiB, 5 * 10^6 are 1.93, with a coast,
    of 280, 2.30.
    """
    with pytest.raises(
        UserError,
        match=r"at once take 2\.9 GiB of the graphics card, of which 2\.0 GiB are free; take f",
    ):
        run_setup._check_memory(case_of(tmp_path, 10**7))
    fits = case_of(tmp_path, 5 * 10**6)
    run_setup._check_memory(fits)
    with pytest.raises(UserError, match=r"at once take 2\.4 GiB of the graphics card"):
        run_setup._check_memory(replace(fits, coast=replace(fits.coast, source="gshhg")))


def test_more_particles_than_an_array_counts_are_refused(
    tmp_path: Path, on_card: Callable[[int], None]
) -> None:
    """By hand: (2^31 - 2) / 10 are 214,748,364 near a coast on a card, and (2^31 - 2) / 6 are
    357,913,941 elsewhere.
    """
    many = case_of(tmp_path, 357_913_942)
    with pytest.raises(
        UserError, match=r"^shards = 1: 357,913,942 particles at once; at most 357,913,941 can be"
    ):
        divide.number_of_shards(many, None, 1)
    assert divide.number_of_shards(many, None, 2) == 2
    assert divide.number_of_shards(case_of(tmp_path, 357_913_941), None, 1) == 1
    on_card(200 * GIB)
    coastal = case_of(tmp_path, 214_748_365)
    assert divide.number_of_shards(coastal, None, 1) == 1
    coastal = replace(coastal, coast=replace(coastal.coast, source="gshhg"))
    with pytest.raises(
        UserError, match=r"at most 214,748,364 can be moved in one piece; give more shards$"
    ):
        divide.number_of_shards(coastal, None, 1)


def test_files_and_fingerprints_name_the_card_and_its_driver(
    tmp_path: Path, on_card: Callable[[int], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    case = case_of(tmp_path, 100)
    where = run_setup.open_for(case)
    plain, alone = (
        run_metadata.file_attributes(case, where),
        fingerprint.fingerprint_of(case, where, 1),
    )
    assert plain["backend"] == alone[work.BACKEND] == "cpu"
    assert "device" not in plain
    on_card(80 * GIB)
    monkeypatch.setattr(fingerprint, "of_machine", dict)
    told = run_metadata.file_attributes(case, where)
    assert (told["backend"], told["device"]) == ("cuda", "Card, driver 550.54, CUDA 12.4")
    assert (
        fingerprint.fingerprint_of(case, where, 1)[work.BACKEND]
        == "cuda: Card, driver 550.54, CUDA 12.4"
    )
    before = {**told, "coast": {"source": told["coast"]}, "device": "Card, driver 470.1, CUDA 11.4"}
    assert "the device" in run_metadata.changed_inputs(case, where, before)
    assert "the device" not in run_metadata.changed_inputs(
        case, where, {**before, "device": told["device"]}
    )


def test_another_backend_begins_anew_and_says_so(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A run in shards that was stopped on a card goes on there alone."""
    out, mark = (
        tmp_path / "out",
        {"the case": "x", work.BACKEND: "cuda: Card, CUDA 12.4", work.NUMBER: "2"},
    )
    with shelf.open_shelf(out, mark, 0) as kept:
        (kept.folder / "shard-0.json").write_text("{}", encoding="utf-8")
    with shelf.open_shelf(out, mark, 0):
        assert "1 shards of this run were finished before: it resumes from there" in caplog.text
    with shelf.open_shelf(out, {**mark, work.BACKEND: "cuda: Card, CUDA 12.6"}, 0) as kept:
        assert (
            "an unfinished run is there, but the backend changed since: it starts again"
            in caplog.text
        )
        assert not list(kept.folder.glob("shard-*"))


def test_auto_goes_on_where_an_unfinished_run_was(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert shelf.resumed_backend("auto", out) == "auto"
    with shelf.open_shelf(out, {work.BACKEND: "cuda: Card, CUDA 12.4"}, 0) as kept:
        assert shelf.resumed_backend("auto", out) == "cuda"
        assert shelf.resumed_backend("cpu", out) == "cpu"  # who asks for one gets it
        assert shelf.resumed_backend("auto", out, client=object()) == "auto"
        # this process runs on another
        with pytest.raises(UserError, match="start a new process for cuda"):
            drift.run(case_of(tmp_path, 200), out, backend="auto")
        (kept.folder / work.ABOUT).write_text(
            json.dumps({work.BACKEND: "abacus"}), encoding="utf-8"
        )
        assert shelf.resumed_backend("auto", out) == "auto"
        shutil.rmtree(kept.folder)


def test_auto_in_a_process_that_runs_already_keeps_what_runs(tmp_path: Path) -> None:
    summary = drift.run(case_of(tmp_path, 200), backend="auto").summary
    assert summary["run"]["backend"] == "cpu"
