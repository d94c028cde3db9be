"""How what a run hands out is written: one folder, complete or not there at all.

See drift.products.files.publication.

It knows no topic: files, pictures and numbers come in chapters. summary.json holds their numbers,
manifest.json lists all files. Data depend on the chapters alone; the date of creation stands in
attributes only.
"""

import json
import os
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from drift.products.files import chapter, discovery, drawing, formats, manifest, publication
from drift.products.files.chapter import Chapter, Contents, Stamped
from drift.products.files.interrupt import undisturbed
from geo.errors import UserError

SUMMARY = "summary.json"
FILES, PICTURES = (
    0.3,
    0.9,
)  # the shares of writing after which files stand, and pictures: roughly, for a bar of progress


def check_folder(folder: Path, overwrite: bool = False, names: Iterable[str] = ()) -> None:
    """Raise UserError unless results may be written to the folder.

    This is asked before the work starts, and creates nothing.

    names: of files that will be written, besides those that every run writes.
    """
    publication.check(folder, overwrite, (*names, SUMMARY, manifest.NAME))


def write(
    folder: Path,
    chapters: Iterable[Chapter],
    *,
    overwrite: bool = False,
    processes: int = 1,
    tell: Callable[[float], None] = lambda share: None,
) -> list[Path]:
    """Write all that the chapters of a run hand out into a folder; return the files' paths.

    The folder is written complete or not at all.

    Their numbers become the summary. To their facts, which every file carries (title, case, seed,
    versions, forcing), `run_id`, `history` and `date_created` are added. With `overwrite` what an
    earlier run wrote into the folder and this one does not is taken away. processes: how many may
    draw pictures. tell: takes the share that is written.
    """
    publication.check(folder, overwrite)
    joined = chapter.join_contents(chapters)
    stamped = _stamped(joined.facts, joined.warnings)

    def fill(place: Path) -> None:
        with drawing.begun(joined.pictures, place, processes) as finish:
            for k, (name, make) in enumerate(joined.files.items(), 1):
                _file(place / name, make(stamped), stamped)
                tell(FILES * k / len(joined.files))
            finish(lambda share: tell(FILES + (PICTURES - FILES) * share))
        _json({**stamped, **joined.numbers}, place / SUMMARY, indent=1)
        for name, digest in joined.digests.items():
            digest(place / name)

    return whole(folder, stamped["run_id"], fill, overwrite=overwrite)


def write_netcdf(
    path: Path, data: xr.Dataset, name: str, facts: Stamped, warnings: Sequence[str]
) -> None:
    """Write one file of a run, as it is in the folder of results; name: what it is called there,
    without its ending.
    """
    try:
        _netcdf(discovery.described(data, _stamped(facts, warnings), name), path)
    except OSError as error:
        raise UserError(f"{path}: cannot be written ({error.strerror or error})") from error


def _stamped(facts: Stamped, warnings: Sequence[str]) -> Stamped:
    """Return the attributes that every file of a run carries."""
    warning = {"warning": "; ".join(warnings)} if warnings else {}
    now = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    return {
        **facts,
        **warning,
        "run_id": formats.run_id(facts),
        "history": f"{now} {facts.get('source', 'casp-drift')}",
        "date_created": now,
    }


def whole(
    folder: Path, run_id: str, fill: Callable[[Path], None], *, overwrite: bool
) -> list[Path]:
    """Have files written into a folder, all of them or none; return their paths. fill: writes into
    the path it is given.
    """
    try:
        with publication.staged(folder) as stage:
            fill(stage.new)
            return publication.publish(stage, run_id, overwrite)
    except OSError as error:
        file = f" at {os.path.basename(error.filename)}" if isinstance(error.filename, str) else ""
        raise UserError(
            f"output folder {folder}: cannot be written ({error.strerror or error}{file}), and nothing of this run was "
            "written; free some space, or name another with --out"
        ) from error


def _file(path: Path, contents: Contents, stamped: Stamped) -> None:
    """Write a dataset with the run's attributes, a JSON object, or a text."""
    if isinstance(contents, xr.Dataset):
        _netcdf(discovery.described(contents, stamped, path.stem), path)
    elif isinstance(contents, str):
        path.write_text(contents, encoding="utf-8", newline="\n")
    else:
        _json(contents, path, indent=None)


def _netcdf(data: xr.Dataset, path: Path) -> None:
    encoding: dict[str, dict[str, Any]] = {}
    for name, variable in data.variables.items():
        encoding[str(name)] = {"_FillValue": None}
        if variable.dtype.kind == "f":
            # neither may be missing (CF, 5 and 7.1)
            if name not in data.dims and not str(name).endswith("_bnds"):
                encoding[str(name)] = {"_FillValue": variable.dtype.type(np.nan)}
            if variable.ndim > 1:
                chunks = (*([1] * (variable.ndim - 2)), *variable.shape[-2:])
                encoding[str(name)] |= {
                    "zlib": True,
                    "complevel": 1,
                    "shuffle": True,
                    "chunksizes": chunks,
                }
        elif variable.ndim > 1:
            encoding[str(name)] |= {"zlib": True, "complevel": 1, "shuffle": True}
        if variable.dtype.kind == "M":
            encoding[str(name)] = {
                "units": formats.EPOCH,
                "calendar": "standard",
                "dtype": "int64",
                "_FillValue": None,
            }
    try:
        # an exception in the middle of it leaves HDF5's lock taken: closing waits for ever
        with undisturbed():
            data.to_netcdf(path, engine="netcdf4", format="NETCDF4", encoding=encoding)
    except RuntimeError as error:  # netCDF4 raises this where HDF5 cannot write
        raise OSError(f"{path.name}: {error}") from error


def _json(value: Any, path: Path, indent: int | None) -> None:
    path.write_text(
        json.dumps(formats.plain(value), indent=indent, allow_nan=False) + "\n", encoding="utf-8"
    )
