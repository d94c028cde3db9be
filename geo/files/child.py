"""Processes of our own for libraries that bytes from outside may crash or hang: both ends.

Such a process reads questions from its standard input and answers on what was its standard output. Each message is a
length (8 bytes), a JSON text, and as many bytes as the text says. The process ends when its input does, even in the
middle of a call that hangs, and so never outlives the one that asks.
"""

import contextlib
import json
import os
import queue
import shutil
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from typing import Any

from geo import waiting

LENGTH = 8  # [bytes] of the number before each text, big-endian
LONGEST = 2**26  # [bytes] of a text
FAREWELL = 0.5  # [s] for closing what is open

Message = tuple[dict[str, Any], memoryview]


class Child:
    """The end that asks: the process, a thread that writes its questions and one that takes in its answers."""

    def __init__(self, code: str, *arguments: str, most: int, scratch: str | None = None) -> None:
        """Start Python on `code`; raise OSError where the system refuses.

        most: bytes that an answer may have beside its text. scratch: a folder to remove once the process has ended.
        """
        apart: dict[str, Any] = (
            {"start_new_session": True}  # Ctrl-C at a terminal is for this process; it ends the other one
            if os.name == "posix"
            else {"creationflags": getattr(subprocess, "CREATE_NO_WINDOW", 0)}
        )
        self.process = subprocess.Popen(
            [sys.executable, "-c", f"import sys; sys.path[:] = {[*map(str, sys.path)]!r}; {code}", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            bufsize=0,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
            **apart,
        )
        self._owner = os.getpid()
        self._questions: queue.SimpleQueue[tuple[dict[str, Any], bytes] | None] = queue.SimpleQueue()
        self._answers: queue.SimpleQueue[Message | None] = queue.SimpleQueue()
        threading.Thread(target=_give_out, args=(self.process.stdin, self._questions), daemon=True).start()
        threading.Thread(target=_take_in, args=(self.process.stdout, self._answers, most), daemon=True).start()
        self._busy = threading.Event()
        self._busy.set()
        # At the latest when the program ends.
        self._end = weakref.finalize(self, _end, self.process, self._owner, self._questions, self._busy, scratch)

    def running(self) -> bool:
        """Whether the process can be asked: it lives, and is not that of a process from which this one was forked."""
        return self._owner == os.getpid() and self.process.poll() is None

    def ask(self, question: dict[str, Any], timeout: float, content: bytes = b"") -> Message:
        """Return the answer, and the bytes that go with it; see `answer`."""
        self._busy.set()
        self._questions.put((question, content))
        return self.answer(timeout)

    def answer(self, timeout: float) -> Message:
        """Wait for an answer, heeding who wants to leave.

        Raises TimeoutError after `timeout` [s], EOFError where the process ends without an answer. After those, and
        whatever else ends the wait, the process is of no more use.
        """
        until = time.monotonic() + timeout
        while True:
            waiting.heed()
            left = until - time.monotonic()
            try:
                answer = self._answers.get(timeout=max(min(waiting.POLL, left), 0.0))
            except queue.Empty:
                if left <= 0:
                    raise TimeoutError from None
                continue
            if answer is None:
                raise EOFError
            self._busy.clear()
            return answer

    def end(self) -> None:
        """End the process, whatever it does."""
        self._end()

    def fate(self) -> str:
        """Return how the process ended, in words."""
        try:
            status = self.process.wait(timeout=5.0)
        except subprocess.TimeoutExpired:
            return "stopped answering"
        if status >= 0:
            return f"ended with status {status}"
        try:
            return f"crashed ({signal.Signals(-status).name})"
        except ValueError:
            return f"crashed (signal {-status})"


def _give_out(pipe: Any, questions: "queue.SimpleQueue[tuple[dict[str, Any], bytes] | None]") -> None:
    """Write questions, by a thread of its own: a process that hangs takes in no more than fits into the pipe."""
    with contextlib.suppress(OSError):
        while (question := questions.get()) is not None:
            send(pipe, *question)
    with contextlib.suppress(OSError):
        pipe.close()


def _take_in(pipe: Any, answers: "queue.SimpleQueue[Message | None]", most: int) -> None:
    """Pass answers on; None when there can be no more."""
    try:
        while True:
            answers.put(receive(pipe, most))
    except Exception:  # the end, or what no answer of ours looks like
        answers.put(None)
    finally:
        pipe.close()


def _end(
    process: "subprocess.Popen[bytes]",
    owner: int,
    questions: "queue.SimpleQueue[tuple[dict[str, Any], bytes] | None]",
    busy: threading.Event,
    scratch: str | None,
) -> None:
    """End a process: by the end of its input if it waits for a question, so that it closes what it holds."""
    if owner != os.getpid():  # it serves the process from which this one was forked
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                pipe.close()
        return
    questions.put(None)
    if not busy.is_set():
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout=FAREWELL)
    if process.poll() is None:
        process.kill()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout=1.0)
    if scratch is not None:
        shutil.rmtree(scratch, ignore_errors=True)


def listen(leave: Callable[[], object] = lambda: None) -> tuple[Iterator[Message], Any]:
    """Return, in the process that answers, its questions and the pipe for its answers: what is printed goes nowhere.

    leave: called before the process is ended by force, soon after the end of its input.
    """
    questions: queue.SimpleQueue[Message | None] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(questions, leave), daemon=True).start()
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)
    return iter(questions.get, None), answers


def _listen(questions: "queue.SimpleQueue[Message | None]", leave: Callable[[], object]) -> None:
    """Pass questions on; end the process when there can be no more."""
    with contextlib.suppress(Exception), open(0, "rb", buffering=0, closefd=False) as pipe:
        while True:
            questions.put(receive(pipe, sys.maxsize))
    questions.put(None)
    time.sleep(FAREWELL)
    leave()
    os._exit(0)


def limit(**most: int) -> None:
    """Bound what libraries may take, by the names of `resource` (RLIMIT_AS), and leave no core dump of their crashes."""
    try:
        import resource
    except ImportError:  # Windows
        return
    for name, wanted in {**most, "RLIMIT_CORE": 0}.items():
        with contextlib.suppress(OSError, ValueError, AttributeError):  # a system need not know each
            which = getattr(resource, name)
            _, hard = resource.getrlimit(which)
            resource.setrlimit(which, (wanted if hard == resource.RLIM_INFINITY else min(wanted, hard), hard))


def send(pipe: Any, told: dict[str, Any], content: Any = b"") -> None:
    """Write a message to an unbuffered pipe; content: contiguous bytes that go with the text."""
    view = memoryview(content)
    text = json.dumps(told | {"bytes": view.nbytes}).encode()
    for part in (memoryview(len(text).to_bytes(LENGTH, "big") + text), view):
        left = part.cast("B") if part.nbytes else None
        while left:
            left = left[pipe.write(left) :]


def receive(pipe: Any, most: int) -> Message:
    """Read a message from an unbuffered pipe; raise EOFError at its end, ValueError where it is none of ours."""
    told = json.loads(bytes(_read(pipe, int.from_bytes(_read(pipe, LENGTH, LENGTH), "big"), LONGEST)))
    return told, _read(pipe, int(told.pop("bytes")), most)


def _read(pipe: Any, count: int, most: int) -> memoryview:
    if not 0 <= count <= most:
        raise ValueError(count)
    content = memoryview(bytearray(count))
    done = 0
    while done < count:
        part = pipe.readinto(content[done:])
        if not part:
            raise EOFError
        done += part
    return content.toreadonly()
