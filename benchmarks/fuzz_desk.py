"""What odd requests do to drift serve: an error of the server, a change by a guest, a hang.

The routes, and what a good request has, are read from the description that the server gives
(/api/openapi.json), so new routes are tried too. Each request is a good one, damaged in one of many
ways, from a user, a guest or a stranger, the same for the same seed. Wrong are: a status of 500 or
more, an answer or a header that is not as described, a connection that breaks off, and a file that
another than a user has changed.

python benchmarks/fuzz_desk.py [--requests 2000] [--seed 0]
"""

import argparse
import json
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import smallest

sys.path[:0] = [str(Path(__file__).parents[1] / "tests" / "oracles")]

DIGITS = 10**400
WORDS = (
    "", ".", "..", "../x.toml", "/etc/passwd", "case.toml", "CASE.toml", "done", "desk_log.jsonl",
    ".hidden.toml", "con.toml", "a\0.toml", "a\nb", "\u202etxt.toml", "\ud800", "x" * 5000,
    "<script>alert(1)</script>", "=1+1", "nan", "title = nan", "title = 0x" + "f" * 5000,
    "[spill]\nclass = 1", "find = 1", "[[sortie]]\nstart = inf", "[" * 2000, "-o", "%2e%2e%2f",
    "http://127.0.0.1:9/x.nc", "\u00b2", "title", "scenario.0.position.at", "find.0.at", "kml",
)  # fmt: skip
ODD: tuple[Any, ...] = (
    *WORDS, None, True, 0, -1, 5, DIGITS, -DIGITS, 1e308, 5e-324, float("nan"), float("inf"), [], {},
    [[]], [None] * 1000, list(range(3)), {"a": {"b": 1}}, {"__proto__": 1}, {"\ud800": 1},
)  # fmt: skip
STRANGERS = ("no token", "another start's", "foreign origin", "another host", "foreign page")
SLOW = 100.0  # [s]: a request on a text, with the start of its process


def good(schema: dict[str, Any], chance: np.random.Generator) -> Any:
    """Return a value that a schema allows, as far as its names tell."""
    if "enum" in schema:
        return schema["enum"][chance.integers(len(schema["enum"]))]
    if "anyOf" in schema:
        return good(schema["anyOf"][chance.integers(len(schema["anyOf"]))], chance)
    kind = schema.get("type")
    if kind == "object":
        return {key: good(one, chance) for key, one in schema.get("properties", {}).items()}
    if kind == "array":
        return [good(schema["items"], chance) for _ in range(schema.get("minItems", 1))]
    if kind == "string":
        if "maxLength" in schema:
            return "case.toml"
        return "0" * 64 if "pattern" in schema else WORDS[chance.integers(len(WORDS))]
    plain = {"number": 0.5, "integer": 1, "boolean": True, "null": None}
    return plain[kind] if kind in plain else ODD[chance.integers(len(ODD))]


def damaged(value: Any, chance: np.random.Generator) -> Any:
    """Return a value with one part exchanged, left out or added."""
    if isinstance(value, dict) and value and chance.random() < 0.9:
        key = list(value)[chance.integers(len(value))]
        how = chance.random()
        if how < 0.1:
            return {name: one for name, one in value.items() if name != key}
        if how < 0.2:
            return {**value, "more": 1}
        return {**value, key: damaged(value[key], chance)}
    if isinstance(value, list) and value and chance.random() < 0.7:
        k = int(chance.integers(len(value)))
        return [*value[:k], damaged(value[k], chance), *value[k + 1 :]]
    return ODD[chance.integers(len(ODD))]


def body_of(told: dict[str, Any], chance: np.random.Generator) -> bytes:
    """Return the body of a request."""
    if chance.random() < 0.05:
        depth = int(chance.choice([50, 900, 100_000]))
        whole = [b"", b"null", b"[]", b"\xff", b"{" * 500, b"[" * depth + b"]" * depth]
        return whole[chance.integers(len(whole))]
    schema = told["requestBody"]["content"]["application/json"]["schema"]
    value = good(schema, chance)
    return json.dumps(damaged(value, chance) if chance.random() < 0.8 else value).encode()


def state(folder: Path) -> dict[str, bytes]:
    """Return what a folder holds."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def changes_of(who: str, tokens: dict[str, str]) -> dict[str, str | None]:
    """Return the headers that a client sends in place of those of our own page."""
    none: dict[str, str | None] = {"Cookie": None}
    if who in tokens:
        return none | {"Authorization": f"Bearer {tokens[who]}"}
    foreign: dict[str, dict[str, str | None]] = {
        "no token": none,
        "another start's": none | {"Authorization": "Bearer " + "x" * 43},
        "foreign origin": {"Origin": "http://evil.example"},
        "another host": {"Host": "evil.example"},
        "foreign page": {"Sec_Fetch_Site": "cross-site"},
    }
    return foreign[who]


def attack(folder: Path, requests: range) -> tuple[Counter[str], list[str]]:
    """Return how often each client got each kind of answer, and what was wrong."""
    from desks import Server, finished

    from drift.apps.serve import gate, users

    people = (users.User("ANNA"), users.User("PRESS", guest=True))
    tokens = {"user": people[0].token, "guest": people[1].token}
    (folder / "case.toml").write_text(smallest.CASE.read_text(encoding="utf-8"), encoding="utf-8")
    finished(folder / "done")
    counts: Counter[str] = Counter()
    wrong: list[str] = []
    with Server(folder, people=people) as served:
        operations = [
            (method.upper(), path, told)
            for path, methods in served.contract.document["paths"].items()
            for method, told in methods.items()
        ]
        before = state(folder)
        for number in requests:
            chance = np.random.default_rng(number)
            method, path, told = operations[number % len(operations)]
            who = str(chance.choice(["user", "user", "guest", "guest", *STRANGERS]))
            for name in ("name", "run", "key", "number"):
                given = str(
                    chance.choice(["case.toml", "done", "0", "1", "9" * 30, "%2e%2e", "a%00b"])
                )
                path = path.replace(f"{{{name}}}", given)
            body = body_of(told, chance) if method == "POST" else b""
            label = f"request {number}: {who}, {method} {path} {body[:150]!r}"
            began = time.monotonic()
            try:
                status, headers, _ = served.ask(method, path, body, **changes_of(who, tokens))
            except Exception as error:  # of the connection, or an answer that is not as described
                wrong.append(f"{label}: {type(error).__name__} {str(error)[:200]}")
                continue
            counts[f"{who}: {status}"] += 1
            took = time.monotonic() - began
            policy = headers.get("content-security-policy")
            kept = gate.RUN_POLICY if path.startswith(gate.RUNS) else gate.POLICY
            if (
                status >= 500
                or policy != kept
                or headers.get("x-content-type-options") != "nosniff"
            ):
                wrong.append(f"{label}: {status}, {policy}")
            if took > SLOW:
                wrong.append(f"{label}: took {took:.0f} s")
            # what a foreign origin gets by GET it cannot read (no CORS)
            if who in STRANGERS and status < 400 and (who, method) != ("foreign origin", "GET"):
                wrong.append(f"{label}: a stranger got {status}")
            if who == "guest" and not told["x-guests"] and status != 403:
                wrong.append(f"{label}: a guest got {status}")
            after = state(folder)
            if who != "user" and {**after, "desk_log.jsonl": b""} != {
                **before,
                "desk_log.jsonl": b"",
            }:
                wrong.append(f"{label}: the folder has changed")
            if any(name.startswith(".") for name in after):
                wrong.append(f"{label}: left {sorted(after)}")
            before = after
    return counts, wrong


def main() -> None:
    """Run and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--requests", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0, help="of the first request")
    given = smallest.parse(parser, requests=70)
    smallest.need("jsonschema", "starlette", "uvicorn")
    with tempfile.TemporaryDirectory() as folder:
        counts, wrong = attack(
            Path(folder).resolve(), range(given.seed, given.seed + given.requests)
        )
    for client, number in sorted(counts.items()):
        print(f"{client:28s} {number:6d}")
    print(*wrong, f"wrong: {len(wrong)} of {given.requests}", sep="\n")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
