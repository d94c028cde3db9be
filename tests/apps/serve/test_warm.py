"""The warm processes of drift serve: what they answer, what they may not, and their end."""

import asyncio
import json
import os
import signal
import threading
import time
from importlib import resources
from typing import Any

import pytest
import small_case
from desks import Server, until

from drift.apps.serve import warm
from geo.files import landlock

GOOD = {"text": small_case.STEADY, "name": "case.toml"}
LONG = small_case.STEADY.replace('duration = "6 h"', 'duration = "2000 h"\nclock.step = "60 s"')

BAD: dict[str, tuple[str, Any, int]] = {
    "no text": ("form", {}, 400),
    "a number": ("form", {"text": 5}, 400),
    "another key": ("form", {"text": "", "path": "/etc"}, 400),
    "a zero": ("form", {"text": "\0"}, 400),
    "half a letter": ("check", {"text": "\ud800", "name": "a.toml"}, 400),
    "too long": ("form", {"text": "x" * (2**20 + 1)}, 413),
    "no list": ("form/set", {"text": "", "changes": {}}, 400),
    "many changes": ("form/set", {"text": "", "changes": [{"field": "title", "value": "x"}] * 101}, 400),
    "half a change": ("form/set", {"text": "", "changes": [{"field": "title"}]}, 400),
    "a way out": ("check", {"text": "", "name": "../case.toml"}, 400),
    "an absolute way": ("sketch", {"text": "", "name": "/etc/passwd"}, 400),
    "a file outside": ("forcing", {"file": "../secret.nc"}, 400),
    "a file that is no forcing": ("forcing", {"file": "case.toml"}, 400),
    "half a box": ("coast", {"box": [0, 0, 1], "step": 0.1}, 400),
    "a box inside out": ("coast", {"box": [1, 0, 0, 1], "step": 0.1}, 400),
    "a box of words": ("coast", {"box": ["0", 0, 1, 1], "step": 0.1}, 400),
    "a box of truths": ("coast", {"box": [False, 0, 1, 1], "step": 0.1}, 400),
    "too fine": ("coast", {"box": [-180, -80, 180, 80], "step": 0.0001}, 400),
    "not finite": ("coast", b'{"box": [0, 0, 1, NaN], "step": 0.1}', 400),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_requests(served: Server, name: str) -> None:
    """None of them starts a process."""
    path, body, expected = BAD[name]
    status, _, data = served.ask("POST", f"/api/{path}", body)
    assert status == expected, data


@pytest.mark.parametrize(
    "path", ["form", "form/set", "check", "domain", "sketch", "coast", "forcing"]
)
def test_who_may_not(served: Server, path: str) -> None:
    for changes in ({"Cookie": None}, {"Origin": "http://evil.example"}):
        assert served.ask("POST", f"/api/{path}", GOOD, **changes)[0] in (401, 403)
    assert served.ask("GET", f"/api/{path}")[0] == 405


def test_objects_in_everyday_words(served: Server) -> None:
    found = served.json("GET", "/api/objects")["objects"]
    kayak = [one["name"] for one in found if "kayak" in one["words"]]
    assert kayak == ["PERSON-POWERED-VESSEL-1"]
    table = resources.files("drift.data").joinpath("leeway.csv").read_text(encoding="utf-8")
    rows = [line.split(",")[0] for line in table.splitlines() if not line.startswith("#")]
    names = [one["name"] for one in found]
    assert set(rows[1:]) <= set(names)  # the published classes, below the header of their table
    assert names[-1] == "water"
    assert all(one["description"] for one in found)


DOMAIN = "domain = { west = -91.5, south = 25.25, east = -84.75, north = 29.5 }\n"


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("text", "box"),
    [
        (DOMAIN + small_case.STEADY, [-91.5, 25.25, -84.75, 29.5]),
        (DOMAIN + small_case.STEADY.partition("[[current]]")[0], None),  # no scenario
        (DOMAIN + "[[scenario]]" + small_case.STEADY.partition("[[scenario]]")[2], None),
        ("title = ", None),
    ],
)
def test_the_domain_of_a_text(running: Server, text: str, box: list[float] | None) -> None:
    told = running.json("POST", "/api/domain", {"text": text, "name": "case.toml"})
    assert told == {"box": box}


def test_a_domain_without_wind_is_known(running: Server) -> None:
    """The page draws it before anything is typed of the wind."""
    head, _, rest = small_case.STEADY.partition("[[current]]")
    text = f"{DOMAIN}{head}[[scenario]]{rest.partition('[[scenario]]')[2]}"
    told = running.json("POST", "/api/domain", {"text": text, "name": "case.toml"})
    assert told == {"box": [-91.5, 25.25, -84.75, 29.5]}


@pytest.fixture(scope="module")
def asked(running: Server) -> Server:
    """A server whose process for what is typed has started."""
    running.json("POST", "/api/form", {"text": ""})
    return running


def test_typing_is_answered_and_writes_nothing(asked: Server) -> None:
    before = sorted(path.name for path in asked.folder.iterdir())
    changes = [{"field": "title", "value": "Overdue"}]
    text = asked.json("POST", "/api/form/set", {"text": GOOD["text"], "changes": changes})["text"]
    assert text == small_case.STEADY.replace('"trial"', '"Overdue"')
    assert asked.json("POST", "/api/check", {**GOOD, "text": text}) == {"messages": []}
    begun = time.monotonic()
    told = asked.json("POST", "/api/check", {**GOOD, "text": text.replace("PIW-1", "PIW-99")})
    took = time.monotonic() - begun
    assert told["messages"][0]["field"] == "scenario.0.object"
    assert took < 5  # 0.01 s where nothing else runs
    told = asked.json("POST", "/api/form", {"text": "a == 1"})
    assert "line 1" in told["mistakes"][0]
    assert sorted(path.name for path in asked.folder.iterdir()) == before


def test_the_shoreline_of_a_box(asked: Server) -> None:
    """Lizard Point (49.96 N 5.20 W) is the southernmost point of Great Britain's mainland."""
    told = asked.json("POST", "/api/coast", {"box": [-5.5, 49.9, -5.0, 50.4], "step": 0.002})
    lats = [
        lat
        for one in told["features"]
        for ring in one["geometry"]["coordinates"]
        for _, lat in ring
    ]
    assert abs(min(lats) - 49.957) < 0.006  # three steps


@pytest.mark.parametrize("outside", ["/etc/passwd", "../secret.toml"])
def test_a_text_reads_nothing_outside(asked: Server, outside: str) -> None:
    text = small_case.CASE.replace("current.nc", outside)
    told = json.dumps(asked.json("POST", "/api/check", {**GOOD, "text": text}))
    assert "outside the folders" in told
    assert "root:" not in told


def test_a_text_that_takes_long_costs_only_its_process(
    asked: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is ended, in one line, and the next text is read by another process."""
    monkeypatch.setitem(warm.PATIENCE, "form", 0.02)
    text = "a = 1\n" + "".join(f"[b{k}.c.d]\ne = 1\n" for k in range(20_000))
    told = asked.json("POST", "/api/form", {"text": text})
    assert told == {"mistakes": ["this took longer than 0.02 s and was ended"]}
    monkeypatch.setitem(warm.PATIENCE, "form", 60.0)
    assert asked.json("POST", "/api/form", {"text": ""})["scenarios"] == 0


@pytest.mark.thorough
def test_a_sketch(asked: Server) -> None:
    """Constant wind and current; the areas hold their shares of the particles that it draws."""
    import shapely

    before = sorted(path.name for path in asked.folder.iterdir())
    told = asked.json("POST", "/api/sketch", GOOD)
    assert len(told["times"]) == 2
    drawn = told["particles"]
    assert len(drawn["lon"][-1]) == 2000
    points = shapely.points(drawn["lon"][-1], drawn["lat"][-1])
    for one in told["areas"]["features"]:
        if one["properties"]["time"] == told["times"][-1]:
            share = one["properties"]["level"]
            held = shapely.contains(shapely.geometry.shape(one["geometry"]), points).mean()
            # three standard errors of 2000 particles, and a smoothing that widens areas
            assert abs(held - share) < 3 * (share * (1 - share) / 2000) ** 0.5 + 0.02
    assert sorted(path.name for path in asked.folder.iterdir()) == before


@pytest.mark.thorough
def test_a_newer_sketch_takes_the_place_of_an_older(asked: Server) -> None:
    """A long one is overtaken, another is cancelled, and one whose process is killed says so."""
    told: dict[str, Any] = {}

    def ask(name: str) -> threading.Thread:
        def work() -> None:
            told[name] = asked.ask("POST", "/api/sketch", {**GOOD, "text": LONG})

        thread = threading.Thread(target=work)
        thread.start()
        time.sleep(1)
        return thread

    first = ask("first")
    assert asked.json("POST", "/api/sketch", GOOD)["times"]
    first.join(60)
    assert told["first"][0] == 409 or b"ended" in told["first"][2]  # given up, or killed
    second = ask("second")
    asked.json("POST", "/api/sketch/cancel", {})
    second.join(60)
    assert told["second"][0] == 409 or b"ended" in told["second"][2]


@pytest.mark.skipif(not landlock.version(), reason="this system has no Landlock")
def test_a_warm_process_cannot_write_into_the_folder(asked: Server) -> None:
    """The fence of a warm process has no folder for writing; what the kernel makes of it is tested
    in tests/geo/files."""
    from drift.apps.serve import jobs, server

    made = warm.Warm(asked.folder, server._fence(asked.folder, [], []), jobs.Limits())
    assert made._fence.writable == ()
    assert asked.folder in made._fence.folders


@pytest.mark.thorough
def test_a_process_that_dies_is_replaced(asked: Server) -> None:
    def children() -> set[int]:
        found = set()
        for entry in os.scandir("/proc"):
            if entry.name.isdecimal():
                try:
                    with open(f"/proc/{entry.name}/cmdline", "rb") as file:
                        words = file.read()
                    with open(f"/proc/{entry.name}/stat") as file:
                        parent = int(file.read().rpartition(")")[2].split()[1])
                except OSError:
                    continue
                if parent == os.getpid() and b"tethered.answer" in words:
                    found.add(int(entry.name))
        return found

    asked.json("POST", "/api/form", {"text": ""})
    before = children()
    assert before
    for number in before:
        os.kill(number, signal.SIGKILL)
    until(lambda: not children() & before, 20)
    # the request that meets the dead process may say so; the next has another
    until(lambda: "scenarios" in asked.json("POST", "/api/form", {"text": ""}), 20)


@pytest.mark.parametrize("users", [1, 3])
def test_each_user_may_wait_with_so_many_requests(asked: Server, users: int) -> None:
    """Several open their pages at once: none is rejected for what the pages of others ask."""
    from drift.apps.serve import jobs, server

    async def most() -> int:
        allowed = server._fence(asked.folder, [], [])
        made = warm.Warm(asked.folder, allowed, jobs.Limits(), users)
        await made._turn.acquire()  # the process works on something
        waiting = [asyncio.create_task(made.ask("form", text="")) for _ in range(90)]
        await asyncio.sleep(0)
        rejected = sum(one.done() for one in waiting)
        for one in waiting:
            one.cancel()
        await asyncio.gather(*waiting, return_exceptions=True)
        return len(waiting) - rejected

    assert asyncio.run(most()) == 20 * users
