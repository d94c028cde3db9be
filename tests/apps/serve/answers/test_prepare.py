"""First maps are prepared one at a time, for the newest text, and give way to any request."""

import asyncio
from collections.abc import Callable, Coroutine
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from drift.apps.serve import server, warm
from drift.apps.serve.jobs import Limits
from drift.apps.serve.routes.form_routes import FormRoutes, answered


class Pipe:
    """The standard input of a process that is not there."""

    def __init__(self) -> None:
        self.written: list[bytes] = []

    def write(self, line: bytes) -> None:
        self.written.append(line)


class Process:
    def __init__(self) -> None:
        self.stdin = Pipe()


class Recorded(warm.Warm):
    """A warm process that takes its time over a request until it is cancelled."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, server._fence(folder, [], []), Limits())
        self.done: list[str] = []
        self._process: Any = Process()

    async def _ask(self, do: str, values: dict[str, Any]) -> Any:
        self._current = do
        self.done.append(f"{do} {values['text']}")
        for _ in range(100):
            await asyncio.sleep(0.001)
            if self._process.stdin.written and do == "prepare":
                self.done.append("cancelled")
                self._process.stdin.written.clear()
                break
        self._current = None
        return {"messages": []}


@pytest.fixture
def recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Recorded:
    monkeypatch.setattr(warm, "TYPED", 0.02)
    return Recorded(tmp_path)


def test_only_the_last_of_texts_that_follow_each_other_is_prepared(recorded: Recorded) -> None:
    async def work() -> None:
        await asyncio.gather(*(recorded.prepare(text=text) for text in "abc"))

    asyncio.run(work())
    assert recorded.done == ["prepare c"]


def test_a_newer_text_interrupts_the_one_before(recorded: Recorded) -> None:
    async def work() -> None:
        first = asyncio.create_task(recorded.prepare(text="a"))
        await asyncio.sleep(0.06)
        await recorded.prepare(text="b")
        await first

    asyncio.run(work())
    assert recorded.done == ["prepare a", "cancelled", "prepare b"]


@pytest.mark.parametrize("way", ["ask", "ask_newest"])
def test_a_request_interrupts_it_and_comes_first(recorded: Recorded, way: str) -> None:
    """Of whatever user."""
    ways: dict[str, Callable[[], Coroutine[Any, Any, Any]]] = {
        "ask": lambda: recorded.ask("forcing", text="f"),
        "ask_newest": lambda: recorded.ask_newest("sketch", "anna", text="f"),
    }

    async def work() -> None:
        first = asyncio.create_task(recorded.prepare(text="a"))
        await asyncio.sleep(0.06)
        await ways[way]()
        await first
        await recorded.prepare(text="b")

    asyncio.run(work())
    name = {"ask": "forcing", "ask_newest": "sketch"}[way]
    assert recorded.done == ["prepare a", "cancelled", f"{name} f", "prepare b"]


def test_it_is_not_begun_while_others_wait(recorded: Recorded) -> None:
    async def work() -> None:
        asked = [asyncio.create_task(recorded.ask("forcing", text=text)) for text in "fgh"]
        await asyncio.sleep(0.01)
        await recorded.prepare(text="a")
        await asyncio.gather(*asked)

    asyncio.run(work())
    assert recorded.done[:3] == ["forcing f", "forcing g", "forcing h"]
    assert set(recorded.done[3:]) <= {"prepare a"}


@pytest.mark.parametrize(
    ("wrong", "guest", "expected"),
    [(False, False, ["prepare a"]), (True, False, []), (False, True, [])],
    ids=["a text without mistakes", "a text with one", "a guest"],
)
def test_a_check_prepares_the_first_map(
    recorded: Recorded, tmp_path: Path, wrong: bool, guest: bool, expected: list[str]
) -> None:
    routes = FormRoutes(tmp_path, server._fence(tmp_path, [], []), Limits())
    routes._warm_up = lambda: None  # type: ignore[method-assign]
    routes.sketching = recorded

    async def check(do: str, **values: Any) -> Any:
        return {"messages": [{"message": "no"}] if wrong else []}

    routes.typing.ask = check  # type: ignore[method-assign]

    body = {"text": "a", "name": "case.toml"}
    scope = {"body": body, "who": SimpleNamespace(name="anna", guest=guest)}

    async def work() -> None:
        answer = await answered(routes.check)(SimpleNamespace(scope=scope))
        assert answer.status_code == 200
        await asyncio.gather(*routes._preparing)
        await asyncio.sleep(0)  # what is done leaves the set in the next turn
        assert not routes._preparing

    asyncio.run(work())
    assert recorded.done == expected
