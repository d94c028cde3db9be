"""Routes of a search plan as RTZ 1.0 (IEC 61174:2015, annex S) for ECDIS, one per unit's task.

Each route has a schedule, and its legs are great circles (Orthodrome). The 1.0 schema spells
"sheduleElement" that way, and longitudes stay below 180 degrees east.
"""

import re
from xml.etree import ElementTree as ET

from drift.apps.export import checked
from drift.apps.export.finished import Finished
from drift.products.files import gpx, markup
from geo.errors import UserError

SPACE = "http://www.cirm.org/RTZ/1/0"
IN = f"{{{gpx.SPACE}}}"


def files(run: Finished) -> dict[str, bytes]:
    """Return the files plan-A-1.rtz and so on, from the routes of plan.gpx."""
    if "plan.gpx" not in run.names:
        raise UserError(
            f"results {run.folder}: contain no plan, and rtz holds the routes of a plan; see: "
            "drift plan --help"
        )
    path = run.folder / "plan.gpx"
    routes = list(checked.xml(path).iter(f"{IN}rte"))
    for route in routes:
        points = list(route.iter(f"{IN}rtept"))
        if not points:
            raise checked.damaged_file_error(path, "a route has no points")
        for point in points:
            lon, lat, time = point.get("lon"), point.get("lat"), point.findtext(f"{IN}time")
            if not (checked.is_position(lon, lat) and checked.is_time(time)):
                raise checked.damaged_file_error(
                    path, f"a point at lon {lon}, lat {lat} and time {time}"
                )
    return {_name(route): _document(route, run).encode() for route in routes}


def _name(route: ET.Element) -> str:
    area = re.match(r"[A-Z]+-\d+", route.findtext(f"{IN}name", ""))
    return f"plan-{area[0] if area else route.findtext(f'{IN}number')}.rtz"


def _document(route: ET.Element, run: Finished) -> str:
    root = ET.Element("route", {"xmlns": SPACE, "version": "1.0"})
    points = list(route.iter(f"{IN}rtept"))
    times = [point.findtext(f"{IN}time", "") for point in points]
    info = {
        "routeName": route.findtext(f"{IN}name", ""),
        "routeAuthor": f"casp-drift, run {run.run}",
        "routeStatus": run.forecast.attrs.get("caution", "planned"),
        "validityPeriodStart": times[0],
        "validityPeriodStop": times[-1],
    }
    ET.SubElement(root, "routeInfo", {key: markup.plain(value) for key, value in info.items()})
    waypoints = ET.SubElement(root, "waypoints")
    schedule = ET.SubElement(
        ET.SubElement(root, "schedules"), "schedule", {"id": "0", "name": "plan"}
    )
    calculated = ET.SubElement(schedule, "calculated")
    for number, (point, time) in enumerate(zip(points, times, strict=True), 1):
        name = markup.plain(point.findtext(f"{IN}name", ""))
        element = ET.SubElement(
            waypoints, "waypoint", {"id": str(number), "revision": "0", "name": name}
        )
        at = markup.position(float(point.attrib["lon"]), float(point.attrib["lat"]))
        ET.SubElement(element, "position", at)
        ET.SubElement(element, "leg", {"geometryType": "Orthodrome"})
        when = "etd" if number == 1 else "eta"
        ET.SubElement(calculated, "sheduleElement", {"waypointId": str(number), when: time})
    return markup.document_text(root)
