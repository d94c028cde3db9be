"""Forcing ensemble members in the results: prior and posterior probability and mean position of
each.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from drift.engine.particles import snapshot
from drift.engine.particles.snapshot import Output, Snapshot
from drift.products.files import formats
from drift.products.files.chapter import Contents, OutputBundle, Stamped, bind_outputs
from drift.products.report import leaves
from geo.array import Array


@dataclass(frozen=True)
class Members:
    """The forcing ensemble members at the end of a run."""

    names: tuple[str, ...]
    prior: Array  # (members,) sum 1
    posterior: Array  # (members,) sum 1, given all evidence
    # (members, 2) mean position [deg] of each member's particles on the map; NaN without any
    place: Array


def told(names: Sequence[str], end: Output, posterior: Array | None = None) -> Members:
    """Return the members' probabilities and mean positions; all are equally likely a priori.

    Args:
        names: of the members.
        end: the particles at the end of the run.
        posterior: of each member, (members,); None: the summed weights of its particles.
    """
    many = len(names)
    place = snapshot.places(
        snapshot.total(
            end, lambda part: snapshot.vectors_by(part, _members_of_snapshot(part), many)
        )
    )
    if posterior is None:
        posterior = snapshot.total(
            end,
            lambda part: part.blocks.partial(
                part.probability, code=_members_of_snapshot(part), many=many
            ),
        ).total[:, 0]
    return Members(tuple(names), np.full(many, 1 / many), posterior / posterior.sum(), place)


def _members_of_snapshot(part: Snapshot) -> Array:
    """Return the member of each particle."""
    assert part.member is not None
    return part.member.astype(np.int64)


def csv(members: Members, run: str) -> str:
    """Return the table of members as CSV; run: the run_id for the last column."""
    columns = zip(members.names, members.prior, members.posterior, members.place, strict=True)
    rows = [
        {
            "member": k,
            "name": name,
            "prior": prior,
            "posterior": posterior,
            "lon": "" if np.isnan(lon) else f"{lon:.5f}",
            "lat": "" if np.isnan(lat) else f"{lat:.5f}",
        }
        for k, (name, prior, posterior, (lon, lat)) in enumerate(columns, 1)
    ]
    return formats.csv_rows(rows, run=run, digits=".7g")


def summary_of_members(members: Members) -> dict[str, Any]:
    """Return the members for the summary."""
    columns = zip(members.names, members.prior.tolist(), members.posterior.tolist(), strict=True)
    return {
        "number": len(members.names),
        # Number of equally likely members with this sum of squares; all without evidence.
        "effective": float(1 / (members.posterior**2).sum()),
        "weights": {
            name: {"prior": prior, "posterior": posterior} for name, prior, posterior in columns
        },
    }


FILES: dict[str, Callable[[Members, Stamped], Contents]] = {
    "members.csv": lambda members, stamped: csv(members, stamped["run_id"]),
}


def chapter(members: Members) -> OutputBundle:
    """Return the output bundle of members."""
    return OutputBundle(
        {"members": summary_of_members(members)},
        bind_outputs(FILES, members),
        leaves=(partial(_leaves, members),),
    )


def _leaves(members: Members) -> list[Any]:
    columns = [
        ("member", "Member", "words"),
        ("name", "Name", "words"),
        ("prior", "Before", "share"),
        ("posterior", "After", "share"),
        ("lon", "Mean longitude at the end", "words"),
        ("lat", "Mean latitude", "words"),
    ]
    note = "Equally likely a priori; afterwards each has the summed weight of its particles."
    return [
        leaves.table_leaf(
            "Members of the winds and currents", columns, file="members.csv", note=note
        )
    ]
