"""A spill in shards writes the same files as in one piece, whichever rounds the finds ask for;
stopped anywhere it goes on.
"""

import json
import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import same_files
from spill_shards import BLOCKS, CURRENT, FINDS, MEMBERS, REFLOAT, TRACK, case_of, same

import drift
from drift.apps.cli import commands
from drift.engine.motion import spool
from drift.pipeline import flow, run_options, run_setup
from drift.pipeline.shards import divide, spilled, work
from drift.planning.patrols import patrol
from drift.products.files import hidden
from drift.spills.worlds import finds, release
from drift.spills.worlds import worlds as drawn_worlds
from kernels.runtime import runtime


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> drift.Case:
    return case_of(tmp_path_factory.mktemp("spills"))


@pytest.fixture(scope="module")
def made(case: drift.Case) -> drift.Result:
    """Return the result in one piece, of two rounds."""
    with flow.open_result(run_options.open_job(case)) as result:
        after = result.aftermath
        assert after is not None
        assert len(after.rounds) == 2
        (fates,) = after.fates.parts()
        assert np.bincount(fates.stays.slot).max() > 1  # some have refloated
        assert set(np.unique(fates.ending)) >= {1, 4}  # some have sunk
        assert len(set(release.particles_per_class(after.spill))) == 3
        assert finds.found(fates, after.posterior.known).max() > 0
    return result


@pytest.fixture
def unwritten(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the files of results out, which take seconds; their contents are compared."""
    monkeypatch.setattr(flow, "write_results", lambda *given, **more: None)


def unfinished(out: Path) -> Path:
    return out.parent / f".{out.name}{hidden.UNFINISHED}"


def kept(out: Path) -> list[int]:
    """Return the numbers of the shards that are finished."""
    return sorted(
        int(path.stem.removeprefix("shard-")) for path in unfinished(out).glob(work.INDICES)
    )


class Stopped(Exception):
    pass


def stopped(case: drift.Case, out: Path, many: int, at: float, what: str = "drift") -> None:
    """Run a case until so much of what is being done is done."""

    def report(phase: str, share: float) -> None:
        if phase == what and share >= at:
            raise Stopped

    with pytest.raises(Stopped):
        drift.run(case, out, shards=many, report=report)
    assert not out.exists()


@pytest.fixture
def moved(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return the numbers of the shards that are moved from now on."""
    numbers: list[int] = []
    fill = spilled.Unit._fill
    monkeypatch.setattr(
        spilled.Unit, "_fill", lambda *given: (numbers.append(given[0].number), fill(*given))
    )
    return numbers


@pytest.mark.thorough
@pytest.mark.parametrize("many", [pytest.param(2, marks=pytest.mark.thorough), 5])
def test_no_number_of_shards_changes_a_bit(case: drift.Case, made: drift.Result, many: int) -> None:
    same(drift.run(case, shards=many), made)


@pytest.mark.thorough
def test_objects_lost_along_a_track_are_the_same_in_shards(tmp_path: Path) -> None:
    """Also where the finds ask for new worlds."""
    tracked = case_of(tmp_path, release=TRACK)
    whole = drift.run(tracked)
    assert whole.aftermath is not None
    assert len(whole.aftermath.rounds) == 2
    same(drift.run(tracked, shards=3), whole)


@pytest.mark.thorough
def test_no_more_than_a_part_is_read_at_once(
    case: drift.Case, made: drift.Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor does what is made of a part depend on how large it is: here one block of worlds, in one
    piece all of them.

    Products read as many and, where they cut a class, up to a block of it more: 6,000 are in a
    shard.
    """
    most, block = 32 * 70, 32 * 42
    read, noted, sizes = spool.ShardFile.read, spool.ShardFile.noted, []

    def reading(
        reel: spool.ShardFile, name: str, at: int | None, first: int, last: int
    ) -> np.ndarray:
        sizes.append(last - first)
        return read(reel, name, at, first, last)

    def noting(reel: spool.ShardFile, name: str, *given: int) -> np.ndarray:
        values = noted(reel, name, *given)
        sizes.append(values.size // 16)  # stays are rows of 4, and some particles have several
        return values

    monkeypatch.setattr(spool, "PART", most)
    monkeypatch.setattr(spool.ShardFile, "read", reading)
    monkeypatch.setattr(spool.ShardFile, "noted", noting)
    same(drift.run(case, shards=2), made)
    assert most <= max(sizes) < most + block


@pytest.mark.parametrize(
    ("behaviour", "current", "more"),
    [
        pytest.param('"strand"', CURRENT, FINDS, id="strands", marks=pytest.mark.thorough),
        pytest.param(REFLOAT, MEMBERS, FINDS, id="members", marks=pytest.mark.thorough),
        pytest.param('"strand"', MEMBERS, "", id="no finds", marks=pytest.mark.thorough),
    ],
)
def test_other_coasts_and_members(tmp_path: Path, behaviour: str, current: str, more: str) -> None:
    case = case_of(tmp_path, more, behaviour=behaviour, current=current)
    one, cut = drift.run(case), drift.run(case, shards=4)
    same(cut, one)
    assert one.aftermath is not None
    assert len(one.aftermath.rounds) == (2 if more else 1)
    if one.members is not None:
        assert cut.members is not None
        assert np.array_equal(one.members.posterior, cut.members.posterior)
        assert np.array_equal(one.members.place, cut.members.place)
    assert (one.members is not None) is (current == MEMBERS)


def test_the_step_is_chosen_on_the_same_particles(case: drift.Case) -> None:
    runtime.start()
    where = run_setup.open_for(case)
    begin, cut = run_setup.prepare(case, where), spilled.prepare(case, where, 3)
    for setup in (begin, cut.setup):
        setup.scene.forcing.close()
    assert begin.trial == cut.setup.trial
    assert begin.trial is not None
    assert max(begin.trial.errors.values()) > 0
    assert cut.spans == ((0, 64), (64, 96), (96, 150))


@pytest.mark.thorough
def test_no_file_differs(
    case: drift.Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a plan of patrols, which has all the files of a forecast and its own."""
    patrol.patrol(case, tmp_path / "whole")
    assert (
        commands.main(
            ["plan", str(case.path), "--out", str(tmp_path / "out"), "--shards", "3", "--quiet"]
        )
        == 0
    )
    assert (tmp_path / "out" / "patrols.csv").read_text().count("horse") >= 1
    assert same_files.differences(tmp_path / "whole", tmp_path / "out") == []
    assert not unfinished(tmp_path / "out").exists()


@pytest.mark.usefixtures("unwritten")
@pytest.mark.thorough
def test_a_run_that_was_stopped_goes_on(
    case: drift.Case,
    made: drift.Result,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    moved: list[int],
) -> None:
    """In its first shard, later, between the rounds, in the second one, and when all is moved."""
    out = tmp_path / "out"
    for at, done in ((0.1, 0), (0.5, 1), (0.9, 2)):
        stopped(case, out, 3, at)
        assert kept(out) == list(range(done))

    def not_yet(*given: object, **more: object) -> None:
        raise Stopped

    with monkeypatch.context() as patch:
        patch.setattr(run_setup, "renewed", not_yet)
        with pytest.raises(Stopped):
            drift.run(case, out, shards=3)
    assert kept(out) == [0, 1, 2]
    stopped(case, out, 3, 0.5)  # the first round is finished: this is the second one
    assert kept(out) == [0, 1, 2, 3]
    stopped(case, out, 3, 0.0, "map")
    assert kept(out) == [0, 1, 2, 3, 4, 5]
    assert moved == [0, 0, 1, 1, 2, 2, 3, 4, 4, 5]
    same(drift.run(case, out), made)  # as many shards as before
    assert len(moved) == 10
    assert not unfinished(out).exists()


@pytest.mark.usefixtures("unwritten")
@pytest.mark.parametrize("number", [1, 4])
@pytest.mark.thorough
def test_an_altered_file_of_a_round_is_made_again(
    case: drift.Case,
    made: drift.Result,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    moved: list[int],
    number: int,
) -> None:
    out = tmp_path / "out"
    stopped(case, out, 3, 0.0, "map")
    with (unfinished(out) / f"shard-{number:05}.bin").open("r+b") as stream:
        stream.seek(-7, os.SEEK_END)
        byte = stream.read(1)
        stream.seek(-7, os.SEEK_END)
        stream.write(bytes([byte[0] ^ 4]))
    moved.clear()
    same(drift.run(case, out), made)
    assert moved == [number]
    assert f"shard-{number:05} of the previous run has been altered" in caplog.text


def elsewhere(case: drift.Case, out: Path, many: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stop a run when all is moved, of which a proposal differs in its last bit, by another
    library's sums say.
    """
    around = drawn_worlds.proposal_around

    def nearly(*given: Any) -> drawn_worlds.Proposal:
        proposal = around(*given)
        proposal.centre[:] = np.nextafter(proposal.centre, 9.0)
        return proposal

    with monkeypatch.context() as patch:
        patch.setattr(drawn_worlds, "proposal_around", nearly)
        stopped(case, out, many, 0.0, "map")


@pytest.mark.thorough
@pytest.mark.usefixtures("unwritten")
def test_a_round_of_other_worlds_is_not_used(
    case: drift.Case,
    made: drift.Result,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
    moved: list[int],
) -> None:
    out = tmp_path / "out"
    elsewhere(case, out, 3, monkeypatch)
    moved.clear()
    same(drift.run(case, out), made)
    assert moved == [3, 4, 5]
    message = "shard-00003 of the previous run belongs to other worlds: it is simulated again"
    assert message in caplog.text


@pytest.mark.thorough
@pytest.mark.usefixtures("unwritten")
def test_two_workers_make_the_same(
    case: drift.Case,
    made: drift.Result,
    client: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    moved: list[int],
) -> None:
    """They take up what one process has begun, and one of them is killed in the second round."""
    out = tmp_path / "out"
    elsewhere(case, out, 5, monkeypatch)
    for number in (1, 4):
        (unfinished(out) / f"shard-{number:05}.json").unlink()
    moved.clear()
    told, killed = [], list[int]()

    def report(phase: str, share: float) -> None:
        if phase == "drift":
            told.append(share)
            if len(told) == 3:
                killed.append(sorted(client.run(os.getpid).values())[0])
                os.kill(killed[0], signal.SIGKILL)

    same(drift.run(case, out, client=client, report=report), made)
    assert killed
    assert moved == []  # here
    assert told == [0.8, 1.0, 0.2, 0.4, 0.6, 0.8, 1.0]


@pytest.mark.thorough
@pytest.mark.usefixtures("unwritten")
def test_one_that_loses_too_much_keeps_nothing(tmp_path: Path) -> None:
    """What finds leave cannot mend it: the same refusal as in one piece, and the next run begins
    again.
    """
    case = case_of(tmp_path, FINDS)
    lossy = drift.vary(case, {"domain.south": -0.04, "domain.north": 0.15, "max_lost": 0.05})
    out, said = tmp_path / "out", []
    for how in ({}, {"shards": 3}):
        with pytest.raises(drift.UserError) as error:
            drift.run(lossy, out, **how)
        said.append(str(error.value))
    assert said[0] == said[1]
    assert "was lost by the end" in said[0]
    assert kept(out) == []


@pytest.mark.thorough
def test_no_water_is_refused_as_in_one_piece(tmp_path: Path) -> None:
    case = case_of(tmp_path, "")
    west, south, east, north = -0.1503, 0.0297, -0.1497, 0.0303  # of a pond
    boxes = [
        (-3, -3, 3, south),
        (-3, north, 3, 3),
        (-3, south, west, north),
        (east, south, 3, north),
    ]
    rings = [[[w, s], [e, s], [e, n], [w, n], [w, s]] for w, s, e, n in boxes]
    land = {"type": "MultiPolygon", "coordinates": [[ring] for ring in rings]}
    (tmp_path / "land.geojson").write_text(
        json.dumps({"type": "Feature", "properties": {}, "geometry": land})
    )
    few = {"spill.worlds": 50, "spill.per_world": 30}
    dry = drift.vary(case, {**few, "spill.position.std": "1 m", "spill.release_std": "10 km"})
    said = []
    for how in ({}, {"shards": 2}):
        with pytest.raises(drift.UserError, match="found no water about their release") as error:
            drift.run(dry, **how)
        said.append(str(error.value))
    assert said[0] == said[1]


def test_shards_are_blocks_of_worlds(
    case: drift.Case, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    for command in ("run", "plan"):
        given = [command, str(case.path), "--out", str(tmp_path / "out"), "--shards", "6"]
        assert commands.main(given) == 2
        assert "has 5 blocks of worlds; give 1 to 5" in capsys.readouterr().err
    many = drift.vary(case, {"spill.worlds": 100_000})  # 7 million particles
    assert divide.number_of_shards(many, None, None) >= 7
    assert divide.number_of_shards(case, None, None) == 1
    assert divide.number_of_shards(case, None, None, divide.Workers(2, 3, 8 * 2**30)) == BLOCKS
    assert divide.number_of_shards(many, None, None, divide.Workers(2, 3, 8 * 2**30)) >= 8


@pytest.mark.thorough
def test_memory_that_the_finds_need_is_told(case: drift.Case) -> None:
    # 6,600 bytes each at 4 outputs, whatever their particles
    many = drift.vary(case, {"spill.worlds": 100_000})
    for particles in (35, 70):
        more = drift.vary(many, {"spill.per_world": particles})
        with pytest.raises(
            drift.UserError, match=r"weighting the spill's 100,000 worlds takes 1\.3 "
        ):
            divide.number_of_shards(more, 1.2, None)
        assert divide.number_of_shards(more, 1.4, None) >= particles // 10
