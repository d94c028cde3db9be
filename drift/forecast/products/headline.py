"""The forecast in a few sentences: the most likely place afloat and on the coast, its uncertainty,
and the share ashore.
"""

import numpy as np
import xarray as xr

from drift.forecast import coastal, likeliest_places, mapped
from drift.forecast.likeliest_places import LikelyPlace
from drift.products.maps import gazetteer, labels
from geo import notation
from geo.notation import NMI, percent

FAR = 500_000.0  # [m] beyond which no town is named
MENTIONED = 0.005  # probability from which a part is mentioned


def forecast_headline(data: xr.Dataset, opens: np.datetime64 | None) -> str:
    """Return the sentences at the top of the report.

    Args:
        data: of a drift.forecast.build.Forecast.
        opens: the time that the map shows first; None: the last.
    """
    at = data.isel(time=mapped.opening_output(data, opens))
    when = notation.format_dtg(at["time"].values)
    if not at["probability"].values.sum() > 0:
        return f"At {when} nothing is on the map."
    ashore = at["status_probability"].sel(status="ashore").item()
    what = "an object" if "effective_worlds" in data else "it"  # of a spill there are many
    first, *other = likeliest_places.likeliest_places(at)
    words = [f"At {when} {what} is most likely {'ashore ' * first.ashore}{_place(first)}."]
    share = 0.5 if 0.5 in at["share"].values else float(at["share"].values[0])
    held = percent(share, 0)
    area = float(at["containment_area"].sel(share=share)) / NMI**2
    if np.isfinite(area):
        size = f"{labels.number(area)} nmi²"
        if coastal.mostly_on_coast(at, share):
            size += (
                f", with about {labels.number(coastal.coast_length(at, share) / NMI)} nmi of coast,"
            )
        words.append(f"An area of {size} holds {held} of the probability.")
    if ashore > MENTIONED:
        words.append(_ashore_in_words(ashore, first, other))
    return " ".join(words)


def _ashore_in_words(ashore: float, first: LikelyPlace, other: list[LikelyPlace]) -> str:
    """Return how much is ashore and where, and where the rest is if the coast came first."""
    reach = f"within {likeliest_places.REACH / NMI:g} nmi"
    told = f"{percent(ashore)} is ashore"
    if not first.ashore:
        if not other:
            return f"{told}."
        (coast,) = other
        return f"{told}, most likely {_place(coast)}: {percent(coast.share)} {reach}."
    told += f", {percent(first.share)} {reach} of this place."
    if other and other[0].share > MENTIONED:
        told += f" Afloat it is most likely {_place(other[0])}."
    return told


def _place(place: LikelyPlace) -> str:
    """Return a position and its bearing from the nearest town."""
    lon, lat = place.lon, place.lat
    named = f"near {notation.position(lon, lat)}"
    (near,) = gazetteer.nearest_towns(np.array([lon]), np.array([lat]))
    if near.away > FAR:
        return named
    if near.away < gazetteer.BESIDE:
        return f"{named} ({gazetteer.place_in_words(near)})"
    return f"{named}, {notation.distance_and_direction(near.lon, near.lat, lon, lat).replace(' to the ', ' ')} of {near.name}"
