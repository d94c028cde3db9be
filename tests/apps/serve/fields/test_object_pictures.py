"""Pictures of what can be adrift: each class has one, and each is drawn."""

import xml.etree.ElementTree as ET
from importlib import resources

import pytest
from desks import Server

SVG = "{http://www.w3.org/2000/svg}"
# as a mariner would sort them
SORTED = {
    "PIW-4": "person",
    "LIFE-RAFT-SB-10": "raft",
    "AVIATION-1": "raft",
    "AVIATION-2": "slide",
    "OVATEK-CRAFT-3": "capsule",
    "PERSON-POWERED-VESSEL-1": "kayak",
    "PERSON-POWERED-VESSEL-3": "board",
    "SKIFF-2": "skiff",
    "SPORT-FISHER": "motorboat",
    "FISHING-VESSEL-4": "fishing",
    "SAILBOAT-6b": "sailboat",
    "CONTAINER-2": "container",
    "OIL-DRUM": "drum",
    "FV-DEBRIS": "debris",
    "RUBBER-BOAT": "dinghy",
    "water": "water",
}


def test_each_class_has_a_picture_that_is_drawn(served: Server) -> None:
    told = served.json("GET", "/api/objects")
    by_class = {one["name"]: one["picture"] for one in told["objects"]}
    assert {name: by_class[name] for name in SORTED} == SORTED
    offered = [one["name"] for one in told["pictures"]]
    assert set(by_class.values()) == set(offered)  # none is offered that lists nothing
    root = ET.fromstring(
        resources.files("drift.apps.serve").joinpath("assets/objects.svg").read_bytes()
    )
    drawn = [one.get("id") for one in root.iter(f"{SVG}symbol")]
    assert drawn == list(dict.fromkeys(drawn))
    assert set(drawn) == set(offered)
    # the page gives colour and width: only shapes, in one size
    assert {one.get("viewBox") for one in root.iter(f"{SVG}symbol")} == {"0 0 48 32"}
    inside = {one.tag.removeprefix(SVG) for symbol in root for one in symbol}
    assert inside <= {"path", "circle", "ellipse", "rect"}


@pytest.mark.parametrize(("cookie", "status"), [(True, 200), (False, 401)])
def test_the_pictures_are_served_as_a_picture(served: Server, cookie: bool, status: int) -> None:
    changes = {} if cookie else {"Cookie": None}
    got, headers, data = served.ask("GET", "/assets/objects.svg", **changes)
    assert got == status
    if cookie:
        assert headers["content-type"].startswith("image/svg+xml")
        assert b"<script" not in data
