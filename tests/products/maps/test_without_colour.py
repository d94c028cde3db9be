"""Pictures read without colour: what is told apart by it alone differs enough for those who see no
red, green or blue, and in grey.

Colour blindness is simulated as Machado, Oliveira and Fernandes 2009 (doi:10.1109/TVCG.2009.113) at
full severity; colorspacious gave the same matrices. How much is enough follows from Stone, Szafir
and Setlur 2014 (An engineering model for color difference as a function of size, CIC 22): the
difference in CIELAB that a share p of the observers notices between marks of a size s [deg] is p (A
+ B / s) on each axis. They measured from 1/3 to 6 degrees: a line as wide as here lies beyond,
where the model asks for more than it would of any size that was measured. A and B were compared
with those of the package d3-jnd (0.1.3), which quotes the paper.
"""

from itertools import combinations
from types import SimpleNamespace
from typing import Any

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from drift.assess.verify import map as drifters_map
from drift.engine.environment import layers as environment_layers
from drift.evidence.filter.products import evidence_map
from drift.evidence.filter.products import layers as search_layers
from drift.evidence.posterior import map as posterior_map
from drift.evidence.suspend import map as suspend_map
from drift.forecast import likeliest
from drift.forecast.products import layers
from drift.products.maps import chart
from drift.spills.backtrack import map as backtrack_map
from drift.spills.worlds.products import map as spill_map
from drift.tracking.bridges import map as bridge_map

SEEN_AS = {
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.01182, 0.04294, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.3039],
    ],
    "grey": [[0.2126, 0.7152, 0.0722]] * 3,
    "all colours": np.eye(3),
}
# of linear sRGB, D65
XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
# A, B of L*, a*, b*: half of the observers
NOTICED = 0.5 * np.array([[10.16, 1.50], [10.68, 3.08], [10.70, 5.74]])
FAR = 500.0  # [mm] from the eye to the page
POINT = 25.4 / 72  # [mm]
# A square as wide as a line is harder to tell than the line, so that what half notice of it is
# enough; of areas, of which the least is a bar 0.15 in high, twice that is asked for, which by the
# model all notice.
SHARES = (0.5, 0.75, 0.95)  # areas of a forecast unless a case asks for others
BAND = (np.degrees(layers.BAND * POINT / FAR), 1.0)
LINE, AREA = (np.degrees(1.4 * POINT / FAR), 1.0), (np.degrees(0.15 * 25.4 / FAR), 2.0)


def lab(colour: str, seen_as: str) -> np.ndarray:
    """Return a colour in CIELAB as it is seen."""
    rgb = np.array(to_rgb(colour))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    x, y, z = XYZ @ np.clip(np.asarray(SEEN_AS[seen_as]) @ linear, 0, 1) / (XYZ @ np.ones(3))
    f = [np.cbrt(t) if t > (6 / 29) ** 3 else t / (3 * (6 / 29) ** 2) + 4 / 29 for t in (x, y, z)]
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def apart(one: str, other: str, seen_as: str, size: float) -> float:
    """Return how far two colours lie apart, in differences that half of the observers notice."""
    return float(
        np.linalg.norm((lab(one, seen_as) - lab(other, seen_as)) / (NOTICED @ [1, 1 / size]))
    )


def strokes(*styles: dict[str, Any]) -> list[tuple[str, Any]]:
    """Return (colour, what else tells it) of lines; widths tell lines that differ by half."""
    return [
        (
            s["color"],
            (str(s["linestyle"]), round(np.log(s["linewidth"]) / np.log(1.5)), s.get("marker")),
        )
        for s in styles
    ]


def over_land(strokes: Any) -> str:
    """Return the colour of strokes on top of each other over land."""
    colour = np.array(to_rgb(chart.LAND))
    for stroke in strokes:
        alpha = stroke._gc["alpha"]
        colour = (1 - alpha) * colour + alpha * np.array(to_rgb(stroke._gc["foreground"]))
    return str(matplotlib.colors.to_hex(colour))


def fills(*styles: dict[str, Any]) -> list[tuple[str, Any]]:
    return [(style["facecolor"], style.get("hatch", "")) for style in styles]


GROUPS: dict[str, tuple[list[tuple[str, Any]], tuple[float, float]]] = {
    "areas of a forecast": (
        strokes(
            layers.INNERMOST,
            *({**layers.INNERMOST, "linewidth": 1.5, "linestyle": dashes} for dashes in layers.BETWEEN),
            layers.OUTERMOST,
        ),
        LINE,
    ),
    "coast in areas": (
        [(over_land(layers.band(share, SimpleNamespace(shares=SHARES))["path_effects"]), "") for share in SHARES],
        BAND,
    ),
    "scenarios with maps of their own": (strokes(*(layers.prior_style(k) for k in range(likeliest.MOST))), LINE),
    "itineraries": (
        list(zip(environment_layers.WAY_COLOURS, map(str, environment_layers.WAY_DASHES), strict=True)),
        LINE,
    ),
    "searches and sensors": (
        strokes(
            search_layers.AREA, search_layers.LEGS, search_layers.TRANSIT, search_layers.ZONES, search_layers.CONTACT,
            *search_layers.SENSORS.values(),
        ),
        LINE,
    ),
    "scenarios in bars": (fills(*evidence_map.FILLS), AREA),
    "scenarios over time": ([(colour, (str(dashes), mark)) for colour, dashes, mark in evidence_map.STROKES], LINE),
    "lines of bridges": ([(colour, (str(dashes), mark)) for colour, dashes, mark in bridge_map.LINES], LINE),
    "areas of a verification": (list(drifters_map.MARKS), LINE),
    "before and after": ([(c, "") for c in (posterior_map.BEFORE, posterior_map.NOW)], AREA),
    "alive and found": ([(c, "") for c in (suspend_map.ALIVE, suspend_map.FOUND)], AREA),
    "first and bulk": (fills(spill_map.FIRST, spill_map.BULK), AREA),
    "origin by finds and prior": (fills(backtrack_map.BY_FINDS, backtrack_map.BY_PRIOR), AREA),
}  # fmt: skip


@pytest.mark.parametrize("seen_as", SEEN_AS)
@pytest.mark.parametrize("group", GROUPS)
def test_what_colour_alone_tells_apart_is_seen(group: str, seen_as: str) -> None:
    looks, (size, enough) = GROUPS[group]
    alike = [(one, other) for one, other in combinations(looks, 2) if one[1] == other[1]]
    close = {(a, b): apart(a, b, seen_as, size) for (a, _), (b, _) in alike}
    assert not {pair: f"{far:.2f}" for pair, far in close.items() if far < enough}


@pytest.mark.parametrize("seen_as", SEEN_AS)
def test_the_shading_grows_darker_all_along(seen_as: str) -> None:
    """Density is read by lightness, over three powers of ten on small maps: each is seen to be
    darker than the one before.
    """
    shades = [
        matplotlib.colors.to_hex(colour) for colour in layers.shading()(np.linspace(0, 1, 256))
    ]
    light = np.array([lab(shade, seen_as)[0] for shade in shades])
    assert (np.diff(light) <= 0).all()  # some of the 256 are alike
    assert (-np.diff(light[:: 255 // 3]) > 2 * NOTICED[0] @ [1, 1 / AREA[0]]).all()


def test_the_simulation() -> None:
    """White stays white, greys grey; a red and a green that are far apart come together for those
    who see no green.
    """
    for seen_as in SEEN_AS:
        np.testing.assert_allclose(lab("#ffffff", seen_as), [100, 0, 0], atol=0.05)
    red, green = "#b04020", "#6a7000"
    assert apart(red, green, "deuteranopia", AREA[0]) < 0.5 * apart(
        red, green, "all colours", AREA[0]
    )
