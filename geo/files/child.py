"""Child processes for libraries that data from outside may crash or hang.

This module holds both sides, the client and the server. The server reads requests from its standard
input and answers on its original standard output. Each message is a length (8 bytes), a JSON
document, and as many bytes as the document states. The server process ends when its input ends,
even during a call that hangs, and so never outlives the client.
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

LENGTH = 8  # [bytes] of the big-endian number before each JSON document
LONGEST = 2**26  # [bytes] longest JSON document
FAREWELL = 0.5  # [s] that a process has to clean up before it is killed

Message = tuple[dict[str, Any], memoryview]


class Child:
    """Client side: the process, with one thread writing requests and one reading answers."""

    def __init__(self, code: str, *arguments: str, most: int, scratch: str | None = None) -> None:
        """Start Python with `code`; raise OSError if the system cannot.

        Args:
            code: Python source to run.
            arguments: command line arguments for it.
            most: largest number of bytes of an answer besides its JSON document.
            scratch: folder to remove after the process has ended.
        """
        options: dict[str, Any] = (
            # Ctrl-C at a terminal then interrupts only this process, which ends the child
            {"start_new_session": True}
            if os.name == "posix"
            else {"creationflags": getattr(subprocess, "CREATE_NO_WINDOW", 0)}
        )
        self.process = subprocess.Popen(
            [
                sys.executable,
                "-c",
                f"import sys; sys.path[:] = {[*map(str, sys.path)]!r}; {code}",
                *arguments,
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            bufsize=0,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
            **options,
        )
        self._owner = os.getpid()
        self._questions: queue.SimpleQueue[tuple[dict[str, Any], bytes] | None] = (
            queue.SimpleQueue()
        )
        self._answers: queue.SimpleQueue[Message | None] = queue.SimpleQueue()
        threading.Thread(
            target=_write_questions, args=(self.process.stdin, self._questions), daemon=True
        ).start()
        threading.Thread(
            target=_read_answers, args=(self.process.stdout, self._answers, most), daemon=True
        ).start()
        self._busy = threading.Event()
        self._busy.set()
        # The finalizer runs at program exit at the latest.
        self._end = weakref.finalize(
            self, _end, self.process, self._owner, self._questions, self._busy, scratch
        )

    def running(self) -> bool:
        """Return True if the process can take requests.

        It must be alive and must have been started by this process, not by one it was forked from.
        """
        return self._owner == os.getpid() and self.process.poll() is None

    def ask(self, question: dict[str, Any], timeout: float, content: bytes = b"") -> Message:
        """Send a request; return its answer and the bytes that go with it, see `answer`."""
        self._busy.set()
        self._questions.put((question, content))
        return self.answer(timeout)

    def answer(self, timeout: float) -> Message:
        """Wait for an answer; the wait can be interrupted (see `geo.waiting`).

        Raises TimeoutError after `timeout` [s], EOFError if the process ends without an answer.
        After any exception from this wait, send no further request to the process.
        """
        until = time.monotonic() + timeout
        while True:
            waiting.check_wait()
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
        """End the process, even if it is busy."""
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


def _write_questions(
    pipe: Any, questions: "queue.SimpleQueue[tuple[dict[str, Any], bytes] | None]"
) -> None:
    """Write requests to the process.

    This needs a thread, because a hanging process accepts no more bytes than the pipe holds.
    """
    with contextlib.suppress(OSError):
        while (question := questions.get()) is not None:
            send(pipe, *question)
    with contextlib.suppress(OSError):
        pipe.close()


def _read_answers(pipe: Any, answers: "queue.SimpleQueue[Message | None]", most: int) -> None:
    """Put answers into the queue, and None after the last one."""
    try:
        while True:
            answers.put(_receive(pipe, most))
    except Exception:  # the end of the pipe, or bytes that are no valid message
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
    """End a process.

    An idle one ends by itself when its input ends, so that it can clean up.
    """
    if owner != os.getpid():  # the process belongs to the parent from which this one was forked
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
    """Return, on the server side, the requests and the pipe for answers.

    Other output of the process is discarded. leave: called before the process exits, soon after its
    input ends.
    """
    questions: queue.SimpleQueue[Message | None] = queue.SimpleQueue()
    threading.Thread(target=_read_questions, args=(questions, leave), daemon=True).start()
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)
    return iter(questions.get, None), answers


def _read_questions(
    questions: "queue.SimpleQueue[Message | None]", leave: Callable[[], object]
) -> None:
    """Put requests into the queue; end the process when the input ends."""
    with contextlib.suppress(Exception), open(0, "rb", buffering=0, closefd=False) as pipe:
        while True:
            questions.put(_receive(pipe, sys.maxsize))
    questions.put(None)
    time.sleep(FAREWELL)
    leave()
    os._exit(0)


def limit(**most: int) -> None:
    """Set resource limits by the names in `resource` (RLIMIT_AS), and disable core dumps."""
    try:
        import resource
    except ImportError:  # Windows
        return
    for name, wanted in {**most, "RLIMIT_CORE": 0}.items():
        # not every system knows every limit
        with contextlib.suppress(OSError, ValueError, AttributeError):
            which = getattr(resource, name)
            _, hard = resource.getrlimit(which)
            resource.setrlimit(
                which, (wanted if hard == resource.RLIM_INFINITY else min(wanted, hard), hard)
            )


def send(pipe: Any, document: dict[str, Any], content: Any = b"") -> None:
    """Write a message to an unbuffered pipe; content: contiguous bytes after the JSON document."""
    view = memoryview(content)
    text = json.dumps(document | {"bytes": view.nbytes}).encode()
    for part in (memoryview(len(text).to_bytes(LENGTH, "big") + text), view):
        left = part.cast("B") if part.nbytes else None
        while left:
            left = left[pipe.write(left) :]


def _receive(pipe: Any, most: int) -> Message:
    """Read a message from an unbuffered pipe.

    Raises EOFError at its end, ValueError for a malformed message.
    """
    document = json.loads(
        bytes(_read(pipe, int.from_bytes(_read(pipe, LENGTH, LENGTH), "big"), LONGEST))
    )
    return document, _read(pipe, int(document.pop("bytes")), most)


def _read(pipe: Any, count: int, most: int) -> memoryview:
    """Read exactly `count` bytes; raise ValueError if that is more than `most`."""
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
