"""The result of a run for Python and notebooks: arrays, tables and a map."""

import base64
import html
import io
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Self

import numpy as np
import pandas
import xarray as xr

from drift.case.record import Case
from drift.engine.environment.ambient import Flow
from drift.evidence.filter import crossings
from drift.evidence.filter.products import tables as search_tables
from drift.evidence.filter.standing import SearchStatus
from drift.evidence.filter.updates import Updates
from drift.evidence.posterior import ranking
from drift.evidence.posterior import tables as posterior_tables
from drift.evidence.posterior.records import Posteriors
from drift.forecast import by_member, effective, mapped
from drift.forecast import tracks as forecast_tracks
from drift.forecast.build import Forecast
from drift.forecast.by_member import Members
from drift.forecast.products import tables as forecast_tables
from drift.forecast.tracks import Trajectories
from drift.products.files import formats, units, writer
from drift.products.maps.imprint import Setting
from drift.spills.worlds.products import tables as washup_tables
from drift.spills.worlds.renewal import SpillResult
from geo import notation
from geo.errors import UserError
from geo.notation import NMI

OFFERS = (
    "probability",
    "particles",
    "tables",
    "areas",
    "plot()",
    "save()",
    "to_netcdf()",
    "washup",
    "summary",
    "forecast",
    "case",
)
ISO = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ")  # as geo.notation.iso writes times


@dataclass(frozen=True, repr=False)
class Result:
    """A forecast, its summary, and the tracks of a subsample of its particles."""

    case: Case
    forecast: Forecast
    trajectories: Trajectories
    summary: dict[str, Any]
    setting: Setting  # title, attribution, land and marks of all its maps
    # overlays of the forecast map: drift.products.maps.overlay.AtTime
    overlays: tuple[Callable[[Any], Any], ...]
    aftermath: SpillResult | None = None  # posterior of a spill: washup, finds, parameters
    updates: Updates | None = None  # effect of each sortie and contact
    # search status before the first update; None: no sorties, no survival times
    begun: SearchStatus | None = None
    # of the non-position variables; None: no itineraries and no observations
    posteriors: Posteriors | None = None
    # winds and currents of the likeliest scenario, for arrows
    flows: Mapping[str, Flow] = field(default_factory=dict)
    members: Members | None = None  # results by member of a forcing ensemble; None: no ensemble
    saved: Callable[["Result", Path, bool], None] | None = (
        None  # writes the result to a folder; None: part of a plan or a comparison
    )

    def __repr__(self) -> str:
        """Return the title, the forecast's key figures and the available attributes."""
        rows = "\n".join(f"  {name}: {words}" for name, words in self._told())
        offers = [one for one in OFFERS if one != "save()" or self.saved]
        return f'<drift.Result "{self.case.title}"\n{rows}\n  has: {", ".join(offers)}>'

    @property
    def probability(self) -> xr.DataArray:
        """Probability that the object is in a cell (time, lat, lon)."""
        return self.forecast.probability

    @property
    def washup(self) -> xr.Dataset | None:
        """Objects ashore by stretch and time (drift.spills.worlds.washup); None without a spill."""
        return self.aftermath.washup if self.aftermath else None

    @property
    def particles(self) -> xr.Dataset:
        """The tracks of a subsample (trajectory, time), as in particles.nc.

        `.to_dataframe()` converts the tracks to pandas.
        """
        tracks = xr.decode_cf(forecast_tracks.dataset(self.trajectories, self.forecast))
        for name in ("time_released", "time_ended"):
            if name in tracks:  # with a calendar, xarray cannot write times that are all missing
                tracks[name].encoding.pop("calendar", None)
        return tracks

    @property
    def tables(self) -> dict[str, pandas.DataFrame]:
        """The tables of the run by name, as in its CSV files.

        Times are UTC, datetime64[ns], as in `probability`. `attrs["units"]` of a table maps column
        names to units in pint's notation: "nmi**2", "degrees_east".
        """
        run = formats.run_id(self.setting.imprint.attributes)
        texts = {
            "track": forecast_tables.track(self.forecast, run),
            "ashore": forecast_tables.ashore(self.forecast, run),
        }
        if self.updates is not None:
            texts["sorties"] = search_tables.csv(self.updates, run)
            if self.updates.crossings is not None:
                texts["lines"] = crossings.csv(self.updates.crossings, run)
        if self.posteriors is not None:
            texts["posteriors"] = posterior_tables.csv(self.posteriors, run)
            if ranked := ranking.ranking_of(self.posteriors):
                texts["scenarios"] = ranking.csv(ranked, run)
        if self.members is not None:
            texts["members"] = by_member.csv(self.members, run)
        if self.washup is not None:
            texts["washup"] = washup_tables.washup_csv(self.washup, run)
            texts["totals"] = washup_tables.totals_csv(self.washup, run)
        return {name: _parse_csv(text) for name, text in texts.items()}

    @property
    def areas(self) -> Any:
        """The containment areas as a geopandas.GeoDataFrame: time, share, area_nmi2, geometry.

        Longitudes continue beyond 180 degrees. Raises UserError without geopandas.
        """
        try:
            import geopandas
        except ImportError:
            raise UserError(
                "geopandas is not installed: pip install -e '.[notebook]' in drift's source folder"
            ) from None
        rows = [(c.time, c.share, c.area / NMI**2, c.polygon) for c in self.forecast.contours]
        columns = ["time", "share", "area_nmi2", "geometry"]
        frame = geopandas.GeoDataFrame(rows, columns=columns, geometry="geometry", crs="EPSG:4326")
        return frame.astype({"time": "datetime64[ns]"})

    def save(self, out: str | os.PathLike[str], *, overwrite: bool = False) -> Self:
        """Write all files of the run into a folder, completely or not at all, as `drift.run(case,
        out)` does.

        Args:
            out: the folder.
            overwrite: whether existing results in it are replaced.

        Returns:
            The result itself, so that calls can be chained: `drift.run(case).save("results")`.

        Raises:
            UserError: the folder cannot be written or is not empty; or the result is part of a
            plan,
                which `drift.plan(case, out)` writes as a whole.
        """
        if self.saved is None:
            raise UserError(
                "this forecast is part of a plan and cannot be saved alone: call the planning function with `out`"
            )
        self.saved(self, Path(out), overwrite)
        return self

    def to_netcdf(self, path: str | os.PathLike[str] = "forecast.nc") -> None:
        """Write the forecast's maps to one netCDF file like forecast.nc; an existing file is
        replaced.

        Args:
            path: the file. `xarray.open_dataset(path)` reads it.

        Raises:
            UserError: the file cannot be written.
        """
        facts, warnings = self.setting.imprint.attributes, self.summary["warnings"]
        writer.write_netcdf(Path(path), self.forecast.data, "forecast", facts, warnings)

    def plot(self, time: Any = None) -> Any:
        """Return the map of an output time as a matplotlib.figure.Figure.

        A notebook shows the figure even if pyplot has not been imported.

        Args:
            time: np.datetime64 or text; None: the time of map.png.

        Raises:
            UserError: the run has no output at this time.
        """
        # imported late: Matplotlib takes a second
        from drift.forecast.products import map as forecast_map
        from drift.products.maps import page

        with page.literal_text():
            figure = forecast_map.figure(
                self.forecast, self.setting, time=self._output(time), overlays=self.overlays
            )
        figure._repr_png_ = partial(_png, figure)  # type: ignore[attr-defined]  # only pyplot tells a notebook how to show one
        return figure

    def _output(self, time: Any) -> int:
        """Return the index of an output time; None: the time of map.png."""
        times = self.forecast.data["time"].values
        if time is None:
            return mapped.opening_output(self.forecast.data, self.setting.opens)
        try:
            found = np.flatnonzero(times == np.datetime64(str(time).rstrip("Z")))
        except ValueError:
            found = np.empty(0, int)
        if not found.size:
            listed = ", ".join(notation.iso(one) for one in times[[0, -1]])
            raise UserError(
                f"time {time!r} is not an output time of this run; it has {len(times)}, the first and last are {listed}"
            )
        return int(found[0])

    def _repr_html_(self) -> str:
        """Return the HTML for notebooks: key figures of the last output, warnings and map."""
        cells = "".join(
            f"<tr><th style='text-align:left'>{name}</th><td>{html.escape(words)}</td></tr>"
            for name, words in self._told()
        )
        cautions = [self.setting.imprint.caution, *self.summary["warnings"]]
        warned = "".join(
            f"<p style='color:#c62828;font-weight:bold'>{html.escape(words)}</p>"
            for words in cautions
            if words
        )
        image = base64.b64encode(_png(self.plot(self.forecast.data["time"].values[-1]))).decode(
            "ascii"
        )
        title = html.escape(self.case.title)
        return (
            f"<h4>{title}</h4>{warned}<table>{cells}</table>"
            f"<img alt='Map: {html.escape(self.case.title, quote=True)}' style='max-width:100%' src='data:image/png;base64,{image}'>"
        )

    def _told(self) -> list[tuple[str, str]]:
        """Return the key figures of the last output: names and texts."""
        data, last = self.forecast.data, self.forecast.data.isel(time=-1)
        count = effective.effective_at(data, -1, self.case.particles)
        return [
            ("Valid", notation.format_dtg(last["time"].values[()])),
            (
                "Mean position",
                notation.position(last["mean_lon"].item(), last["mean_lat"].item()) or "none",
            ),
            (
                "Datum",
                notation.position(last["datum_lon"].item(), last["datum_lat"].item()) or "none",
            ),
            *(
                (
                    f"{notation.hundredths(share)} % area",
                    f"{area / NMI**2:,.0f} nmi²" if area == area else "none",
                )
                for share, area in zip(
                    last["share"].values, last["containment_area"].values, strict=True
                )
            ),
            ("Counts", count.words),
        ]


def _png(figure: Any) -> bytes:
    """Return a figure as PNG bytes at a notebook's resolution."""
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=80)
    return picture.getvalue()


def _parse_csv(text: str) -> pandas.DataFrame:
    """Return a CSV text as a DataFrame; times are UTC without a zone, so that they join
    xarray's."""
    frame = pandas.read_csv(io.StringIO(text))
    times = [name for name in frame.columns if _is_time(name, frame[name].dropna())]
    parsed = {
        name: pandas.to_datetime(frame[name], utc=True).dt.tz_localize(None) for name in times
    }
    table = frame.assign(
        **{name: column.astype("datetime64[ns]") for name, column in parsed.items()}
    )
    table.attrs["units"] = units.units_of(table.select_dtypes("number").columns)
    return table


def _is_time(name: str, values: Any) -> bool:
    """Return whether a column holds times: by its name, or because all its values are ISO 8601."""
    return (
        name == "time"
        or name.endswith("_time")
        or (len(values) > 0 and all(map(ISO.fullmatch, map(str, values))))
    )
