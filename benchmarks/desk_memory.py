"""The memory of `drift serve` under clients that ask all the time: a leak shows as a slope.

Each client is a user of its own, who opens the lists, a case, the log and the form, changes a field
and checks the text. The resident memory of the server and of its warm processes is read from /proc
as the run goes on (Linux). Printed: requests, errors, times, the memory before and after, and the
slope over the second half with its standard error.

    python benchmarks/desk_memory.py --clients 50 --minutes 10
"""

import argparse
import http.client
import json
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

CASE = """\
title = "A raft"
start = "211830ZNOV26"
duration = "6 h"
particles = 1000
[[wind.constant]]
speed = "17 kn"
from = 250
[[current.constant]]
east = 0.2
north = 0.1
[[scenario]]
name = "raft"
object = "PIW-1"
position = { at = "50 05.2N 005 31.7W", time = "211830ZNOV26", error = "1 nmi" }
"""
EVERY = 5.0  # [s] between two readings


def started(folder: Path, clients: int) -> tuple[subprocess.Popen[str], int, list[str]]:
    """Return the server, its port, and a token for each client."""
    names = [part for k in range(clients) for part in ("--user", f"USER{k}")]
    command = [sys.executable, "-m", "drift", "serve", str(folder), "--no-browser", *names]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    found: list[str] = []
    port = 0
    assert server.stdout is not None
    while len(found) < clients:
        line = server.stdout.readline()
        if not line:
            raise SystemExit("the server did not start")
        if told := re.search(r":(\d+)/\S*token=(\S+)", line):
            port = int(told[1])
            found.append(told[2])
    return server, port, found


def resident(pid: int) -> tuple[float, float]:
    """Return the resident memory [MiB] of a process, and of all below it."""
    parents = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            try:
                parents[int(entry.name)] = int(
                    (entry / "stat").read_text().rpartition(")")[2].split()[1]
                )
            except (OSError, ValueError, IndexError):
                continue
    below, todo = set[int](), [pid]
    while todo:
        own = todo.pop()
        new = {one for one, parent in parents.items() if parent == own}
        below |= new
        todo += new

    def size(of: int) -> float:
        try:
            told = Path(f"/proc/{of}/status").read_text()
        except OSError:
            return 0.0
        found = re.search(r"VmRSS:\s+(\d+) kB", told)
        return int(found[1]) / 1024 if found else 0.0

    return size(pid), sum(map(size, below))


class Client(threading.Thread):
    """One user, who asks until the end."""

    def __init__(self, port: int, token: str, number: int, until: float) -> None:
        super().__init__(daemon=True)
        self.port, self.token, self.number, self.until = port, token, number, until
        self.took: list[float] = []
        self.wrong: list[str] = []

    def run(self) -> None:
        """Ask in turn, over one connection."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        k = 0
        while time.monotonic() < self.until:
            k += 1
            text = CASE.replace("A raft", f"Raft {self.number} {k}")
            hours = [{"field": "duration", "value": f"{k % 50 + 1} h"}]
            for path, body in (
                ("/api/news/0", None),
                ("/api/folder", None),
                ("/api/cases/raft.toml", None),
                ("/api/log", None),
                ("/api/jobs", None),
                ("/api/form", {"text": text}),
                ("/api/form/set", {"text": text, "changes": hours}),
                ("/api/search", {"text": text, "name": "raft.toml"}),
                ("/api/check", {"text": text, "name": "raft.toml"}),
            ):
                self._ask(connection, path, body)
            time.sleep(0.2)

    def _ask(self, connection: http.client.HTTPConnection, path: str, body: object) -> None:
        begun = time.perf_counter()
        head = {"Authorization": f"Bearer {self.token}"}
        try:
            if body is None:
                connection.request("GET", path, headers=head)
            else:
                head["Content-Type"] = "application/json"
                connection.request("POST", path, json.dumps(body), head)
            answer = connection.getresponse()
            answer.read()
            if answer.status != 200:
                self.wrong.append(f"{path} {answer.status}")
        except (OSError, http.client.HTTPException) as error:
            self.wrong.append(f"{path} {type(error).__name__}")
            connection.close()
        self.took.append(time.perf_counter() - begun)


def slope(minutes: np.ndarray, sizes: np.ndarray) -> tuple[float, float]:
    """Return a slope [MiB/min] by least squares and its standard error."""
    (rate, _), covariance = np.polyfit(minutes, sizes, 1, cov=True)
    return float(rate), float(np.sqrt(covariance[0, 0]))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--clients", type=int, default=50)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--smallest", action="store_true", help="two clients for half a minute")
    options = parser.parse_args()
    if options.smallest:
        options.clients, options.minutes = 2, 0.5
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place).resolve()
        (folder / "raft.toml").write_text(CASE, encoding="utf-8")
        server, port, tokens = started(folder, options.clients)
        try:
            time.sleep(3)
            begun = time.monotonic()
            until = begun + 60 * options.minutes
            clients = [Client(port, token, k, until) for k, token in enumerate(tokens)]
            readings = [(0.0, *resident(server.pid))]
            for client in clients:
                client.start()
            while time.monotonic() < until:
                time.sleep(min(EVERY, max(until - time.monotonic(), 0.1)))
                readings.append(((time.monotonic() - begun) / 60, *resident(server.pid)))
            for client in clients:
                client.join(120)
        finally:
            server.terminate()
            server.wait(30)
    table = np.array(readings)
    took = sorted(one for client in clients for one in client.took)
    wrong = [one for client in clients for one in client.wrong]
    kinds = {one: wrong.count(one) for one in sorted(set(wrong))}
    print(
        f"{options.clients} clients, {options.minutes:g} min: {len(took)} requests, errors {kinds}"
    )
    print(
        f"median {1e3 * statistics.median(took):.0f} ms, 95 % {1e3 * took[int(0.95 * len(took))]:.0f} ms"
    )
    late = table[:, 0] >= table[-1, 0] / 2
    for name, column in (("server", 1), ("its processes", 2)):
        rate, error = slope(table[late, 0], table[late, column])
        first, half, last = (table[k, column] for k in (0, int(np.argmax(late)), -1))
        print(
            f"{name}: {first:.1f} MiB before, {half:.1f} at half, {last:.1f} after; "
            f"second half {rate:+.3f} +- {error:.3f} MiB/min"
        )


if __name__ == "__main__":
    main()
