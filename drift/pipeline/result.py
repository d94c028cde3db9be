"""The result of a run, as Python and a notebook have it: arrays, tables, a map."""

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
from drift.evidence.filter.standing import Standing
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
from drift.spills.worlds.renewal import Aftermath
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
    """A forecast, the numbers about it, and its subsample's tracks."""

    case: Case
    forecast: Forecast
    trajectories: Trajectories
    summary: dict[str, Any]
    setting: Setting  # what stands on every map of it
    # what else stands on its own map: drift.products.maps.overlay.AtTime
    overlays: tuple[Callable[[Any], Any], ...]
    aftermath: Aftermath | None = None  # of a spill: its washup, finds and unknowns
    updates: Updates | None = None  # what sorties and contacts did
    # how a search stood before any of them; None: no sorties, no survival times
    begun: Standing | None = None
    # of what is not position; None: nothing steers and nothing was seen
    posteriors: Posteriors | None = None
    # winds and currents of the likeliest scenario, for arrows
    flows: Mapping[str, Flow] = field(default_factory=dict)
    members: Members | None = None  # of an ensemble of winds and currents; None: there is none
    saved: Callable[["Result", Path, bool], None] | None = (
        None  # writes it to a folder; None: of a plan or a comparison
    )

    def __repr__(self) -> str:
        """Return what it is, in a few lines."""
        rows = "\n".join(f"  {name}: {words}" for name, words in self._told())
        offers = [one for one in OFFERS if one != "save()" or self.saved]
        return f'<drift.Result "{self.case.title}"\n{rows}\n  has: {", ".join(offers)}>'

    @property
    def probability(self) -> xr.DataArray:
        """Probability that the object is in a cell (time, lat, lon)."""
        return self.forecast.probability

    @property
    def washup(self) -> xr.Dataset | None:
        """What comes ashore where and when (see drift.spills.worlds.washup); None without a spill."""
        return self.aftermath.washup if self.aftermath else None

    @property
    def particles(self) -> xr.Dataset:
        """The tracks of a subsample (trajectory, time), as in particles.nc;

        `.to_dataframe()` makes pandas' of them.
        """
        return xr.decode_cf(forecast_tracks.dataset(self.trajectories, self.forecast))

    @property
    def tables(self) -> dict[str, pandas.DataFrame]:
        """The tables of the run by name, those of its CSV files; times as in `probability`: UTC,
        datetime64[ns].

        `attrs["units"]` of each has the units of its columns by name, as pint reads them: "nmi**2",
        "degrees_east".
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
            texts["washup"] = washup_tables.stretches(self.washup, run)
            texts["totals"] = washup_tables.totals(self.washup, run)
        return {name: _frame(text) for name, text in texts.items()}

    @property
    def areas(self) -> Any:
        """The areas that hold shares of the probability as a geopandas.GeoDataFrame: time, share,
        area_nmi2, geometry.

        Longitudes run on across 180 degrees. Raises UserError without geopandas.
        """
        try:
            import geopandas
        except ImportError:
            raise UserError(
                "geopandas is not installed: pip install -e '.[notebook]' where drift lies"
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
            overwrite: whether results that it holds are replaced.

        Returns:
            The result itself, so that `drift.run(case).save("results")` can be read on.

        Raises:
            UserError: the folder cannot be written, or holds something; or the result is part of a
                plan, which `drift.plan(case, out)` writes whole.
        """
        if self.saved is None:
            raise UserError(
                "a forecast that is part of a plan is written with it: give the function that plans its out"
            )
        self.saved(self, Path(out), overwrite)
        return self

    def to_netcdf(self, path: str | os.PathLike[str] = "forecast.nc") -> None:
        """Write the forecast's maps to one netCDF file, as forecast.nc of the run; a file that is
        there is replaced.

        Args:
            path: the file. `xarray.open_dataset(path)` reads it.

        Raises:
            UserError: it cannot be written.
        """
        facts, warnings = self.setting.imprint.attributes, self.summary["warnings"]
        writer.write_netcdf(Path(path), self.forecast.data, "forecast", facts, warnings)

    def plot(self, time: Any = None) -> Any:
        """Return the map of an output time as a matplotlib.figure.Figure; time: np.datetime64 or
        text, by default that of map.png.

        A notebook shows it, whether pyplot has been imported or not. Raises UserError for a time
        that is no output's.
        """
        # here: Matplotlib takes a second to import
        from drift.forecast.products import map as forecast_map
        from drift.products.maps import page

        with page.literal():
            figure = forecast_map.figure(
                self.forecast, self.setting, time=self._output(time), overlays=self.overlays
            )
        figure._repr_png_ = partial(_png, figure)  # type: ignore[attr-defined]  # only pyplot tells a notebook how to show one
        return figure

    def _output(self, time: Any) -> int:
        """Return the number of an output time."""
        times = self.forecast.data["time"].values
        if time is None:
            return mapped.opening(self.forecast.data, self.setting.opens)
        try:
            found = np.flatnonzero(times == np.datetime64(str(time).rstrip("Z")))
        except ValueError:
            found = np.empty(0, int)
        if not found.size:
            listed = ", ".join(notation.iso(one) for one in times[[0, -1]])
            raise UserError(
                f"time {time!r} is no output of this run; they are {len(times)}, the first and last {listed}"
            )
        return int(found[0])

    def _repr_html_(self) -> str:
        """Return what a notebook shows: how the run ended, its warnings and its map."""
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
        """Return how the run ended, by name."""
        data, last = self.forecast.data, self.forecast.data.isel(time=-1)
        count = effective.effective_at(data, -1, self.case.particles)
        return [
            ("Valid", notation.group(last["time"].values[()])),
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
    """Return a figure as a notebook shows it."""
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=80)
    return picture.getvalue()


def _frame(text: str) -> pandas.DataFrame:
    """Return a CSV text as a pandas.DataFrame, its times in UTC without a zone, as xarray has them:
    they join.
    """
    frame = pandas.read_csv(io.StringIO(text))
    times = [name for name in frame.columns if _is_time(name, frame[name].dropna())]
    parsed = {
        name: pandas.to_datetime(frame[name], utc=True).dt.tz_localize(None) for name in times
    }
    whole = frame.assign(
        **{name: column.astype("datetime64[ns]") for name, column in parsed.items()}
    )
    whole.attrs["units"] = units.units_of(whole.select_dtypes("number").columns)
    return whole


def _is_time(name: str, given: Any) -> bool:
    """Whether a column is of times: by its name, or as all that is given in it is ISO 8601."""
    return (
        name == "time"
        or name.endswith("_time")
        or (len(given) > 0 and all(map(ISO.fullmatch, map(str, given))))
    )
