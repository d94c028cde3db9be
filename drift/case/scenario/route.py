"""A route along lanes in a case file: its nodes in order, or its first and last node."""

import itertools
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, model_validator

from drift.case.values import fields
from drift.engine.motion.steering import lanes
from drift.engine.motion.steering.lanes import Network, Route


class RouteTable(fields.Table):
    """A route: all nodes in order, or the shortest path from a node to another, via others."""

    nodes: list[fields.Label] | None = None
    """All nodes in order."""
    from_: fields.Label | None = Field(None, alias="from")
    """First node; needs `to`. The route is the shortest path."""
    via: list[fields.Label] = Field(default_factory=list)
    """Nodes through which the shortest path must lead, in order."""
    to: fields.Label | None = None
    """Last node; needs `from`."""

    @model_validator(mode="after")
    def complete(self) -> "RouteTable":
        """Reject an incomplete route, or one given twice."""
        given = {name.rstrip("_") for name in self.model_fields_set}
        if given not in ({"nodes"}, {"from", "to"}, {"from", "via", "to"}):
            raise ValueError(
                'give a list of nodes, or { from = "A", to = "B" }, and via = ["C"] for a path through others; '
                f"found {', '.join(sorted(given)) or 'nothing'}"
            )
        return self

    def route(self, network: Network) -> Route:
        """Return the record of the route; raise ValueError if no lanes connect its nodes."""
        if self.nodes is not None:
            return lanes.route(network, self.nodes)
        stops = [self.from_ or "", *self.via, self.to or ""]
        paths = [lanes.shortest(network, a, b) for a, b in itertools.pairwise(stops)]
        return lanes.route(network, [stops[0], *(name for path in paths for name in path[1:])])


def _list_as_nodes(value: Any) -> Any:
    return {"nodes": value} if isinstance(value, list) else value


AsGiven = Annotated[RouteTable, BeforeValidator(_list_as_nodes)]  # the type of a `route` key
