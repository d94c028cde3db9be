"""Warm processes of the desk: one answers what is typed, one makes sketches.

Each has the fence and the limits of a job, but no folder to write into besides its own temporary
one. A process that crashes, takes too long, or does not give up a cancelled sketch is killed, and
the next request starts another.
"""

import asyncio
import contextlib
import json
import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from drift.apps.serve import jobs
from geo.errors import UserError
from geo.files import fence

START = "from drift.apps.cli import tethered; tethered.answer"
MOST_WAITING = 20  # requests of each user, as one page sends several when it opens
LONGEST_ANSWER = 2**25  # [bytes]
PATIENCE = {  # [s]
    "form": 10.0,
    "set": 10.0,
    "check": 10.0,
    "search": 10.0,
    "spill": 20.0,
    "spill/turn": 10.0,
    "washup": 60.0,
    "washup/keep": 20.0,
    "plan": 20.0,
    "plan/keep": 20.0,
    "plan/pos": 180.0,  # the first one follows the particles
    "result": 60.0,
    "result/value": 20.0,
    "coast": 30.0,
    "forcing": 60.0,
    "note": 60.0,
    "export": 120.0,
}
FIRST = 60.0  # [s] more, for a process that starts
SKETCH = 180.0  # [s]
TYPED = 0.5  # [s] without another text, after which it is worth while to prepare a first map
GRACE = 2.0  # [s] that a process has to give up a cancelled sketch


class Overtaken(Exception):
    """A newer request took the place of this one, or it was cancelled."""


class Warm:
    """A process that stays, and answers one request after the other."""

    def __init__(
        self, folder: Path, allowed: fence.Fence, limits: jobs.Limits, users: int = 1
    ) -> None:
        self._most_waiting = MOST_WAITING * users
        self._folder, self._limits = folder, limits
        self._fence = replace(allowed, writable=())
        self._process: asyncio.subprocess.Process | None = None
        self._scratch: tempfile.TemporaryDirectory[str] | None = None
        self._turn = asyncio.Lock()
        self._waiting = self._number = 0
        self._current: str | None = None  # request that the process works on
        self._owner = ""  # of the current request
        self._newest: dict[str, int] = {}  # number of the last sketch of each user
        self._prepared = 0  # number of the last text for which a sketch is to be prepared
        self._closed = False

    async def ask(self, do: str, **values: Any) -> Any:
        """Return the answer to a request.

        Raises:
            UserError: what the user can correct, or the process ended or took too long.
            Overtaken: too many requests wait.
        """
        if self._waiting >= self._most_waiting:
            raise Overtaken("too many requests are waiting")
        self._waiting += 1
        try:
            self._stop_preparing()
            async with self._turn:
                return await self._ask(do, values)
        finally:
            self._waiting -= 1

    async def prepare(self, **values: Any) -> None:
        """Have the process read ahead what a sketch needs, while it has nothing else to do.

        One text at a time, of all users, and the newest takes the place of those before it. Any
        request interrupts it.
        """
        self._prepared += 1
        mine = self._prepared
        await asyncio.sleep(TYPED)
        if mine != self._prepared:
            return
        self._stop_preparing()
        async with self._turn:
            if mine == self._prepared and not self._waiting:
                await self._ask("prepare", values)

    def _stop_preparing(self) -> None:
        process = self._process
        if self._current == "prepare" and process is not None and process.stdin is not None:
            process.stdin.write(b'"cancel"\n')

    async def ask_newest(self, do: str, user: str, **values: Any) -> Any:
        """Return the answer to a request, which takes the place of those of its user before it."""
        if self._waiting >= self._most_waiting:
            raise Overtaken("too many requests are waiting")
        self._waiting += 1
        try:
            self._newest[user] = mine = self._newest.get(user, 0) + 1
            await self._give_up(user)
            self._stop_preparing()
            async with self._turn:
                if mine != self._newest.get(user):
                    raise Overtaken("a newer one took its place")
                self._owner = user
                answer = await self._ask(do, values)
            if mine != self._newest.get(user):
                raise Overtaken("cancelled")
            return answer
        finally:
            self._waiting -= 1

    async def cancel(self, user: str) -> None:
        """Give up the sketch of a user that is being made, and all that wait."""
        self._newest[user] = self._newest.get(user, 0) + 1
        await self._give_up(user)

    async def close(self) -> None:
        """End the process, and answer no more requests."""
        self._newest.clear()
        self._closed = True
        self._kill()
        async with self._turn:
            await self._end()

    async def _give_up(self, user: str) -> None:
        process, number = self._process, self._number
        if self._current != "sketch" or self._owner != user:
            return
        if process is None or process.stdin is None:
            return
        process.stdin.write(b'"cancel"\n')
        for _ in range(20):
            await asyncio.sleep(GRACE / 20)
            if self._current is None or self._number != number:
                return
        self._kill()

    async def _ask(self, do: str, values: dict[str, Any]) -> Any:
        if self._closed:
            raise Overtaken("the server ends")
        self._number += 1
        patience = SKETCH if do in ("sketch", "warm", "prepare") else PATIENCE[do]
        try:
            if not self._alive():
                patience += FIRST
                await self._start()
            process = self._process
            assert process is not None
            assert process.stdin is not None
            assert process.stdout is not None
            self._current = do
            request = {"id": self._number, "do": do, **values}
            process.stdin.write(json.dumps(request).encode() + b"\n")
            line = await asyncio.wait_for(process.stdout.readline(), patience)
            answer = json.loads(line)
            if answer["id"] != self._number:
                raise ValueError
        except TimeoutError:
            await self._end()
            raise UserError(f"this took longer than {patience:g} s and was ended") from None
        except (OSError, ValueError, KeyError, TypeError):
            await self._end()
            raise UserError("the process that works on this ended; try again") from None
        except asyncio.CancelledError:  # the server ends
            await self._end()
            raise
        finally:
            self._current = None
        if "cancelled" in answer:
            raise Overtaken("cancelled")
        if "error" in answer:
            raise UserError(*str(answer["error"]).split("\n"))
        return answer["answer"]

    def _alive(self) -> bool:
        process = self._process
        if process is None or process.stdout is None:
            return False
        return process.returncode is None and not process.stdout.at_eof()

    async def _start(self) -> None:
        await self._end()
        self._scratch = tempfile.TemporaryDirectory(
            prefix="drift-desk-", ignore_cleanup_errors=True
        )
        self._process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-c",
            jobs.python_code(self._folder, self._limits, START),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.DEVNULL,
            cwd=self._scratch.name,
            env=jobs.environment(self._fence, self._scratch.name),
            start_new_session=os.name == "posix",
            limit=LONGEST_ANSWER,
        )

    def _kill(self) -> None:
        """Kill the process; the request that waits for it ends it."""
        if self._process is not None and self._process.returncode is None:
            jobs.kill(self._process)

    async def _end(self) -> None:
        """Kill the process, wait for its end, and remove its folder; only by who has the turn."""
        self._kill()
        process, self._process = self._process, None
        scratch, self._scratch = self._scratch, None
        if process is not None:
            assert process.stdin is not None
            assert process.stdout is not None
            process.stdin.close()
            while await process.stdout.read(2**16):
                pass
            await process.wait()
        if scratch is not None:
            with contextlib.suppress(OSError):
                scratch.cleanup()
