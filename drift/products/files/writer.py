"""Write the outputs of a run into a folder, completely or not at all.

See drift.products.files.publication. The writer has no knowledge of topics: files, pictures and
numbers come in chapters. summary.json holds their numbers, manifest.json lists all files. Data
depend on the chapters alone; the creation date is only in attributes.
"""

import contextlib
import os
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from xarray.backends.netCDF4_ import NETCDF4_PYTHON_LOCK, NetCDF4DataStore

from drift.products.files import chapter, discovery, drawing, formats, manifest, publication
from drift.products.files.chapter import Contents, OutputBundle, Stamped
from drift.products.files.interrupt import signals_deferred
from geo.errors import UserError

SUMMARY = "summary.json"
FILES, PICTURES = (
    0.3,
    0.9,
)  # approximate share of writing that is done after files, and after pictures, for the progress bar


def check_folder(folder: Path, overwrite: bool = False, names: Iterable[str] = ()) -> None:
    """Raise UserError unless results may be written to the folder.

    Call it before the work starts: it creates nothing.

    Args:
        folder: the output folder.
        overwrite: whether results in it may be replaced.
        names: files that will be written, besides those that every run writes.
    """
    publication.check(folder, overwrite, (*names, SUMMARY, manifest.NAME))


def write(
    folder: Path,
    chapters: Iterable[OutputBundle],
    *,
    overwrite: bool = False,
    processes: int = 1,
    tell: Callable[[float], None] = lambda share: None,
    meanwhile: Callable[[], None] = lambda: None,
) -> list[Path]:
    """Write the outputs of a run's chapters into a folder, completely or not at all.

    The chapters' numbers become summary.json. Their facts (title, case, seed, versions, forcing)
    become attributes of every file, together with `run_id`, `history` and `date_created`.

    Args:
        folder: the output folder.
        chapters: the outputs by topic.
        overwrite: whether the files of an earlier run are replaced; those that this run does not
            write are removed.
        processes: number of processes that may draw pictures.
        tell: called with the share that is written, 0 to 1.
        meanwhile: called after the files, while other processes draw.

    Returns:
        The paths of the files.

    Raises:
        UserError: the folder cannot be written, or another run has filled it.
    """
    publication.check(folder, overwrite)
    outputs = chapter.join_contents(chapters)
    stamped = _stamped(outputs.facts, outputs.warnings)

    def fill(staging: Path) -> None:
        with drawing.draw_in_parallel(outputs.pictures, staging, processes) as finish:
            for k, (name, make) in enumerate(outputs.files.items(), 1):
                _write_file(staging / name, make(stamped), stamped)
                tell(FILES * k / len(outputs.files))
            _write_json({**stamped, **outputs.numbers}, staging / SUMMARY, indent=1)
            meanwhile()
            finish(lambda share: tell(FILES + (PICTURES - FILES) * share))
        for name, digest in outputs.digests.items():
            digest(staging / name)

    return write_all_or_none(folder, stamped["run_id"], fill, overwrite=overwrite)


def write_netcdf(
    path: Path, data: xr.Dataset, name: str, facts: Stamped, warnings: Sequence[str]
) -> None:
    """Write one netCDF file of a run, as in the results folder.

    Args:
        path: the file.
        data: its content.
        name: its name in the results folder, without suffix.
        facts: attributes of every file of the run.
        warnings: warnings of the run.
    """
    try:
        _write_dataset(discovery.with_metadata(data, _stamped(facts, warnings), name), path)
    except OSError as error:
        raise UserError(f"{path}: cannot be written ({error.strerror or error})") from error


def _stamped(facts: Stamped, warnings: Sequence[str]) -> Stamped:
    """Return the attributes of every file of a run, with its run_id and date."""
    warning = {"warning": "; ".join(warnings)} if warnings else {}
    now = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    return {
        **facts,
        **warning,
        "run_id": formats.run_id(facts),
        "history": f"{now} {facts.get('source', 'casp-drift')}",
        "date_created": now,
    }


def write_all_or_none(
    folder: Path, run_id: str, fill: Callable[[Path], None], *, overwrite: bool
) -> list[Path]:
    """Write files into a folder, all of them or none, and return their paths.

    Args:
        folder: the output folder.
        run_id: identifier of the run.
        fill: writes the files into the folder that it is given.
        overwrite: whether the files of an earlier run are replaced.

    Returns:
        The paths of the files.

    Raises:
        UserError: the folder cannot be written, or another run has filled it.
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


def _write_file(path: Path, contents: Contents, stamped: Stamped) -> None:
    """Write a dataset with the run's attributes, a JSON object, or a text."""
    if isinstance(contents, xr.Dataset):
        _write_dataset(discovery.with_metadata(contents, stamped, path.stem), path)
    elif isinstance(contents, str):
        path.write_text(contents, encoding="utf-8", newline="\n")
    else:
        _write_json(contents, path, indent=None)


def _write_dataset(data: xr.Dataset, path: Path) -> None:
    encoding: dict[str, dict[str, Any]] = {}
    for name, variable in data.variables.items():
        encoding[str(name)] = {"_FillValue": None}
        if variable.dtype.kind == "f":
            # neither coordinates nor bounds may have missing values (CF, 5 and 7.1)
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
        # an exception in between leaves HDF5's lock taken, and closing the file waits for ever
        with signals_deferred():
            # to_netcdf would first import dask.distributed, which takes half a second
            store = NetCDF4DataStore.open(  # type: ignore[no-untyped-call]
                str(path), mode="w", lock=NETCDF4_PYTHON_LOCK
            )
            with contextlib.closing(store):
                data.dump_to_store(store, encoding=encoding)
    except RuntimeError as error:  # netCDF4 raises this if HDF5 cannot write
        raise OSError(f"{path.name}: {error}") from error


def _write_json(value: Any, path: Path, indent: int | None) -> None:
    path.write_text(formats.json_text(value, indent=indent) + "\n", encoding="utf-8")
