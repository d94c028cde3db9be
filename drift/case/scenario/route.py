"""A route along lanes as a case gives it: its nodes in order, or where it begins and ends."""

import itertools
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, model_validator

from drift.case.values import fields
from drift.engine.motion.steering import lanes
from drift.engine.motion.steering.lanes import Network, Route


class RouteTable(fields.Table):
    """Nodes in order; or from, to and, where these do not say it all, via: the shortest way through
    them.
    """

    nodes: list[fields.Label] | None = None
    """Nodes in order."""
    from_: fields.Label | None = Field(None, alias="from")
    """The first node, with `to`."""
    via: list[fields.Label] = Field(default_factory=list)
    """Nodes on the way."""
    to: fields.Label | None = None
    """The last node."""

    @model_validator(mode="after")
    def complete(self) -> "RouteTable":
        """Refuse both ways of giving a route at once, or half of one."""
        given = {name.rstrip("_") for name in self.model_fields_set}
        if given not in ({"nodes"}, {"from", "to"}, {"from", "via", "to"}):
            raise ValueError(
                'give a list of nodes, or { from = "A", to = "B" }, and via = ["C"] for a way through others; '
                f"found {', '.join(sorted(given)) or 'nothing'}"
            )
        return self

    def route(self, network: Network) -> Route:
        """Return the record; raise ValueError where lanes do not lead that way."""
        if self.nodes is not None:
            return lanes.route(network, self.nodes)
        stops = [self.from_ or "", *self.via, self.to or ""]
        ways = [lanes.shortest(network, a, b) for a, b in itertools.pairwise(stops)]
        return lanes.route(network, [stops[0], *(name for way in ways for name in way[1:])])


def _listed(value: Any) -> Any:
    return {"nodes": value} if isinstance(value, list) else value


AsGiven = Annotated[RouteTable, BeforeValidator(_listed)]  # the type of a `route` key
