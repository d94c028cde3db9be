"""Tables of itineraries, for case files."""

from pathlib import Path

from cases import __file__ as cases

HEAD = 'title = "trial"\nstart = "2026-03-05T00:00Z"\nduration = "60 h"\n'
OPEN = '[coast]\nsource = "none"\n'
STILL = '[[current]]\nconstant = { speed = "0 kn", toward = 0 }\n'
STORY = '[[scenario]]\nname = "one"\n'
AT = 'position = { at = [-30.2, 45.1], std = "3 nmi" }\n'
PHASE = "[[scenario.phase]]\n"
NETWORK = Path(cases).parent / "networks" / "mediterranean.toml"
VOYAGE = PHASE + 'voyage = {{ waypoints = [[-30.2, 45.1], [-31.4, 46.3]], speed = "5 kn", {} }}\n'


def course(course: str = "30", speed: str = '"5 kn"') -> str:
    """Return a phase by course and speed."""
    return f"{PHASE}course = {{ course = {course}, speed = {speed} }}\n"


def lanes(route: str, network: object = NETWORK) -> str:
    """Return a phase along lanes."""
    return f'{PHASE}lanes = {{ network = "{network}", route = {route}, speed = "9 kn" }}\n'


def bridge(first: str, last: str, more: str = 'k = "12 nmi/sqrt(h)"') -> str:
    """Return a phase of a bridge between two way points."""
    return f"{PHASE}[scenario.phase.bridge]\n{more}\npoints = [{{ at = [-30.2, 45.1], {first} }}, {{ at = [-31.4, 46.3], {last} }}]\n"


def loiter(polygon: str = "[[-30.1, 45.2], [-29.3, 45.3], [-29.2, 45.9]]", more: str = "") -> str:
    """Return a phase of loitering."""
    return f'{PHASE}loiter = {{ polygon = {polygon}, speed = "4 kn", leg = "9 nmi"{more} }}\n'
