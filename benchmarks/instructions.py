"""Instructions of PTX that a thread issues for one particle, counted without a card.

It cuts the first loop over particles of a kernel's PTX into blocks, and takes the shortest way once
round its outer loop: through the block that takes the particle's columns, through the loop over the
stages of the scheme, which counts once a stage, and through a block that stores whole numbers, as
the end of a step does. On that way the particle is far from the shore, and no function of the
library takes its slow branch. PTX is not what a card runs: ptxas merges and splits instructions, so
the figure is rough.
"""

import heapq
import re
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

JUMP = re.compile(r"(@!?%p\d+ )?bra(\.uni)?\s+(\$\w+);")
STORES = 2  # of whole numbers, at least: where a step ends


class Way(NamedTuple):
    """What a thread issues."""

    instructions: int
    loads: int  # of memory, among them


@dataclass
class Block:
    """Instructions that run one after the other, and the names of the blocks that may follow."""

    lines: list[str] = field(default_factory=list)
    after: list[str] = field(default_factory=list)

    def count(self, begin: str) -> int:
        """Return how many instructions begin so."""
        return sum(line.startswith(begin) for line in self.lines)


def first_loop(text: str) -> str:
    """Return the first entry of a file of PTX that is a loop."""
    return next(
        entry for entry in re.split(r"(?=\.visible \.entry )", text)[1:] if "range_for(" in entry
    )


def blocks(entry: str) -> dict[str, Block]:
    """Return the blocks of an entry by name, in their order."""
    found, name = {"": Block()}, ""
    for line in map(str.strip, entry.split("{", 1)[1].splitlines()):
        label, jump = re.match(r"(\$\w+):", line), JUMP.match(line)
        if label:
            if not _leaves(found[name]):
                found[name].after.append(label[1])
            name = label[1]
            found[name] = Block()
        elif re.match(r"[@a-z]", line):
            found[name].lines.append(line)
            if jump:
                found[name].after.append(jump[3])
                if jump[1]:  # it may fall through, into a block that has no label
                    beyond = f"{name}+"
                    found[name].after.append(beyond)
                    name = beyond
                    found[name] = Block()
    return {name: _direct(found, block) for name, block in found.items()}


def _direct(found: dict[str, Block], block: Block) -> Block:
    """Return a block that is followed by where the jumps that stand alone after it lead."""
    lone = lambda name: len(found[name].lines) == 1 and found[name].lines[0].startswith("bra.uni")  # noqa: E731
    return Block(
        block.lines, [found[name].after[0] if lone(name) else name for name in block.after]
    )


def _leaves(block: Block) -> bool:
    last = block.lines[-1] if block.lines else ""
    return bool(re.match(r"bra\.uni|ret|exit", last))


def _nearest(
    graph: dict[str, Block], weights: dict[str, int], start: str
) -> tuple[dict[str, int], dict[str, str]]:
    """Return what it takes to reach each block from the end of `start` (Dijkstra 1959), and by
    which.
    """
    reached, by = {}, {}
    queue = [(weights[name], name, start) for name in graph[start].after if name != start]
    heapq.heapify(queue)
    while queue:
        cost, name, before = heapq.heappop(queue)
        if name in reached:
            continue
        reached[name], by[name] = cost, before
        for beyond in graph[name].after if name != start else ():
            heapq.heappush(queue, (cost + weights[beyond], beyond, name))
    return reached, by


def shortest(text: str, stages: int) -> Way:
    """Return what a thread issues for one particle on the shortest way on which it moves.

    Args:
        text: a file of PTX.
        stages: how often the loop over stages is gone through.

    Raises:
        LookupError: the PTX has no such loops.
    """
    graph = blocks(first_loop(text))
    order = list(graph)
    turned = [name for name in order if name in graph[name].after]
    loops = [
        name for name in turned if graph[name].count("ld.f32") or graph[name].count("ld.global.f32")
    ]
    heads = re.findall(r"(\$\w+):[^\n]*This Loop Header: Depth=1", text)
    heads = [head for head in heads if head in graph]
    if len(heads) != 1 or not loops:
        raise LookupError(f"no loop over stages in one over particles: {heads}, {loops}")
    stage = max(loops, key=lambda name: graph[name].count("ld"))
    repeats = {name: stages if name == stage else 1 for name in graph}
    weights = {name: repeats[name] * len(graph[name].lines) for name in graph}
    ends = [name for name in order if name != stage and graph[name].count("st.u32") >= STORES]
    way = _through(graph, weights, (heads[0], stage), ends)
    # The shortest way of all skips the block that takes the particle's columns: that is mostly
    # loads.
    aside = [name for name in order[order.index(heads[0]) : order.index(stage)] if name not in way]
    taken = [name for name in aside if graph[name].count("ld")]
    if taken:
        gather = max(taken, key=lambda name: graph[name].count("ld") ** 2 / len(graph[name].lines))
        way = _through(graph, weights, (heads[0], gather, stage), ends)
    return Way(
        sum(weights[name] for name in way),
        sum(repeats[name] * graph[name].count("ld") for name in way),
    )


def _through(
    graph: dict[str, Block], weights: dict[str, int], first: tuple[str, ...], ends: list[str]
) -> list[str]:
    """Return the blocks of the shortest way through some blocks and one of the ends, back to the
    first.
    """
    ways = []
    for end in ends:
        way: list[str] = []
        for begin, stop in pairwise((*dict.fromkeys(first), end, first[0])):
            reached, by = _nearest(graph, weights, begin)
            if stop not in reached:
                break
            part = [stop]
            while by[part[-1]] != begin:
                part.append(by[part[-1]])
            way += part[::-1]
        else:
            ways.append(way)
    if not ways:
        raise LookupError("no way from the loop over stages to the end of a step")
    return min(ways, key=lambda way: sum(weights[name] for name in way))
