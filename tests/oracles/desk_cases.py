"""A kayaker overdue off Cornwall, and a swimmer perhaps: the cases of the browser's tests."""


def kayak(title: str, *, particles: int, duration: str, every: str) -> str:
    """A case of the kayaker alone, with typed winds and currents and their errors."""
    return f"""\
title = "{title}"
start = "281130ZNOV26"
duration = "{duration}"
particles = {particles}
output.every = "{every}"

[uncertainty]
current = {{ std = "0.2 m/s", time = "11 h" }}
wind = {{ std = "1.5 m/s", time = "6 h" }}

[[wind]]
name = "on scene"
constant = {{ speed = "12 kn", from = 235 }}

[[current]]
name = "on scene"
constant = {{ speed = "0.5 kn", toward = 75 }}

[[scenario]]
name = "kayak"
object = "PERSON-POWERED-VESSEL-1"
position = {{ at = "49 55.0N 005 40.0W", error = "1 nmi" }}
"""


def swimmer(at: str, error: str) -> str:
    """A second scenario, half as likely."""
    return f"""
[[scenario]]
name = "swimmer"
object = "PIW-1"
weight = 0.5
position = {{ at = "{at}", error = "{error}" }}
"""
