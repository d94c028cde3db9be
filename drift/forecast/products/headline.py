"""The forecast in a few sentences: the likeliest position, its uncertainty, and the share
ashore.
"""

import numpy as np
import xarray as xr

from drift.forecast import coastal, mapped
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
    afloat = at["status_probability"].sel(status="adrift").item()
    ashore = at["status_probability"].sel(status="ashore").item()
    what = "an object" if "effective_worlds" in data else "it"  # of a spill there are many
    words = [f"At {when} {what} is most likely {_place(at, ashore > afloat)}."]
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
        words.append(f"{percent(ashore)} is ashore.")
    return " ".join(words)


def _place(at: xr.Dataset, ashore: bool) -> str:
    """Return the position of the densest cell, ashore or of all, and its bearing from the nearest
    town.
    """
    density = at["probability_ashore" if ashore else "probability"].values / at["cell_area"].values
    row, column = np.unravel_index(int(density.argmax()), density.shape)
    lon, lat = float(at["lon"].values[column]), float(at["lat"].values[row])
    named = f"{'ashore ' * ashore}near {notation.position(lon, lat)}"
    (near,) = gazetteer.nearest_towns(np.array([lon]), np.array([lat]))
    if near.away > FAR:
        return named
    if near.away < gazetteer.BESIDE:
        return f"{named} ({gazetteer.place_in_words(near)})"
    return f"{named}, {notation.distance_and_direction(near.lon, near.lat, lon, lat).replace(' to the ', ' ')} of {near.name}"
