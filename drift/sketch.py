"""A forcing source in plain text: how it was understood, how much is missing, and a map of letters."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from geo.forcing import Source

WIDTH, HEIGHT = 64, 20  # [characters] of the map
SHADES = " .:-=+*#%@"  # slowest to fastest
MISSING = "/"  # land, or no data


def describe(source: Source) -> str:
    """Return what a source holds, one fact a line, and a map of its first time."""
    box, times = source.grid.box, source.times
    values = source.read(0)
    speed = np.hypot(values[..., 0], values[..., 1])
    known = speed[np.isfinite(speed)]
    facts = {
        "grid": f"{source.grid.nlon} x {source.grid.nlat} nodes, {source.grid.dlon:.4g} x {source.grid.dlat:.4g} degrees",
        "area": f"{box.west:.3f} to {box.east:.3f} E, {box.south:.3f} to {box.north:.3f} N",
        "times": f"{times[0]}Z to {times[-1]}Z, {times.size}" if times.size else "steady: holds at all times",
        "missing": f"{source.missing:.1%} of the nodes at the first time",
        "speed": f"mean {known.mean():.3g}, largest {known.max():.3g} m/s at the first time"
        if known.size
        else "none known",
        "fingerprint": source.fingerprint,
    }
    lines = [f"{source.quantity}: {source.name}"]
    lines += [f"  {name:<12}{fact}" for name, fact in facts.items()]
    lines += [f"  {note}" for note in source.notes]
    return "\n".join([*lines, *(f"  |{row}|" for row in letters(speed)), f"  {legend(known)}"])


def letters(speed: NDArray[np.float32]) -> Iterable[str]:
    """Return a map of speed as rows of characters, north up; (nlat, nlon) [m/s], NaN missing."""
    nlat, nlon = speed.shape
    rows = np.linspace(nlat - 1, 0, min(nlat, HEIGHT)).round().astype(int)
    columns = np.linspace(0, nlon - 1, min(nlon, WIDTH)).round().astype(int)
    picked = speed[np.ix_(rows, columns)]
    top = float(np.nanmax(speed)) if np.isfinite(speed).any() else 0.0
    level = np.nan_to_num(picked / (top or 1.0) * (len(SHADES) - 1)).round().astype(int)
    return [
        "".join(SHADES[k] if ok else MISSING for k, ok in zip(line, valid, strict=True))
        for line, valid in zip(level.tolist(), np.isfinite(picked).tolist(), strict=True)
    ]


def legend(known: NDArray[np.float32]) -> str:
    """Return what the map's characters mean."""
    top = float(known.max()) if known.size else 0.0
    return f'north up; "{SHADES}" is 0 to {top:.3g} m/s, "{MISSING}" is missing'
