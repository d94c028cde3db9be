"""What damaged forcing files do to us: one line, the true values, other values, or something else,
which must not be.

netCDF-3 and -4 files of regular, packed, projected, staggered and triangular grids, some with
checksums (Fletcher-32), GRIB files of both editions, and Zarr stores of both formats are damaged:
bytes changed, cut off, blanked, doubled. Each is opened as `drift info` does and all its slices are
read. "other values" is what damage does that nothing in the file can show: its digest in
summary.json tells. "other values, checksums": 0. The error for a Zarr store names the damaged file
in it, or the array: "no place": 0.

python benchmarks/fuzz_files.py [--netcdf 500] [--grib 200] [--zarr 250] [--seed 0]
"""

import argparse
import random
import shutil
import sys
import tempfile
from functools import partial
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path[:0] = [
    str(ROOT / "tests" / "oracles"),
    str(ROOT / "tests" / "oracles" / "files"),
    str(ROOT / "tests" / "geo" / "files"),
    str(ROOT),
]

import model_writers
import numpy as np
import smallest
import test_grib
import watched
import writers
import xarray as xr

from geo.errors import UserError

GRIB = 1_000_000  # numbers of the trials of GRIB files begin here
ZARR = 2_000_000  # and those of Zarr stores here
SUMMED, PLACELESS = "other values, checksums", "no place"
watched.NEVER = (*watched.NEVER, SUMMED, PLACELESS)


def checked(path: Path) -> Path:
    """Write a netCDF-4 file all of whose variables carry checksums."""
    with xr.open_dataset(writers.regular(path.with_suffix(".plain")), decode_times=False) as data:
        data.to_netcdf(
            path, encoding={str(n): {"fletcher32": True} for n in data.variables if data[n].ndim}
        )
    return path


def classic(path: Path) -> Path:
    """Write a netCDF-3 file."""
    with xr.open_dataset(writers.regular(path.with_suffix(".plain")), decode_times=False) as data:
        data.to_netcdf(path, format="NETCDF3_64BIT")
    return path


def deflated(path: Path) -> Path:
    """Write a compressed netCDF-4 file."""
    with xr.open_dataset(writers.regular(path.with_suffix(".plain")), decode_times=False) as data:
        data.to_netcdf(
            path, encoding={str(n): {"zlib": True} for n in data.variables if data[n].ndim > 1}
        )
    return path


NETCDF = {
    "regular": writers.regular, "packed": writers.packed, "projected": writers.projected, "roms": model_writers.roms,
    "fvcom": model_writers.fvcom, "classic": classic, "deflated": deflated, "checksums": checked,
}  # fmt: skip


def grib(path: Path, edition: int) -> Path:
    """Write 10 m winds along a Lambert grid's axes and on a regular grid, of two times."""
    parts = test_grib.pair(
        test_grib.LAMBERT if edition == 2 else test_grib.REGULAR, edition=edition
    )
    return test_grib.written(
        path,
        parts
        + test_grib.pair(
            test_grib.LAMBERT if edition == 2 else test_grib.REGULAR, edition=edition, hour=3.0
        ),
    )


def zarr_store(path: Path, edition: int) -> Path:
    """Write the regular grid as a Zarr store, each slice a chunk, with metadata of arrays apart and
    together.
    """
    with xr.open_dataset(writers.regular(path.with_suffix(".plain")), decode_times=False) as data:
        data.chunk(time=1).to_zarr(path, zarr_format=edition, consolidated=edition == 2)
    return path


def truth(path: Path) -> list[np.ndarray]:
    """Return all slices of all that a file holds, as `drift info` would read them."""
    from geo.forcing import describe

    found = []
    for source in describe.open_quantities([path]):
        describe.describe(source)
        found += [source.read(i) for i in range(max(len(source.times), 1))]
    return found


def damaged(content: bytes, rng: random.Random) -> tuple[str, bytes]:
    """Return what was done to bytes, and what came of them."""
    data, at = bytearray(content), rng.randrange(len(content))
    kind = rng.choice(("bytes", "bytes", "head", "cut", "blank", "double", "bits"))
    if kind == "bytes":
        for _ in range(rng.choice((1, 3, 30))):
            data[rng.randrange(len(data))] = rng.randrange(256)
    elif kind == "head":
        for _ in range(rng.choice((1, 3))):
            data[rng.randrange(min(len(data), 4096))] = rng.randrange(256)
    elif kind == "cut":
        del data[at:]
    elif kind == "blank":
        data[at : at + 512] = bytes(len(data[at : at + 512]))
    elif kind == "double":
        data[at:at] = data[at : at + rng.choice((1, 64, 1000))]
    else:
        data[at] ^= 1 << rng.randrange(8)
    return kind, bytes(data)


def zarr_trials(numbers: list[int]) -> None:
    """Damage and read Zarr stores, one a number: of each, one file in it."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        wholes: dict[int, tuple[Path, list[np.ndarray]]] = {}
        for number in numbers:
            rng = random.Random(number)
            edition = rng.choice((2, 3))
            if edition not in wholes:
                whole = zarr_store(folder / f"whole{edition}.zarr", edition)
                wholes[edition] = whole, truth(whole)
            whole, values = wholes[edition]
            path = folder / f"{number}.zarr"
            shutil.copytree(whole, path)
            victim, kind = damaged_store(path, rng)
            watched.trial(
                number, f"zarr{edition} {kind} {victim}", partial(read_store, path, values)
            )
            shutil.rmtree(path)


def damaged_store(path: Path, rng: random.Random) -> tuple[str, str]:
    """Damage a file of a Zarr store; return which, and what was done to it."""
    victim = rng.choice(sorted(file for file in path.rglob("*") if file.is_file()))
    if rng.random() < 0.1:
        victim.unlink()
        return str(victim.relative_to(path)), "gone"
    kind, bad = damaged(victim.read_bytes(), rng)
    victim.write_bytes(bad)
    return str(victim.relative_to(path)), kind


def read_store(path: Path, values: list[np.ndarray]) -> str:
    """Read a Zarr store; return what came of it, and raise what an error with a place raises."""
    try:
        seen = truth(path)
    except UserError as error:
        places = (path.name, "variable", '"lon"', '"lat"', '"time"', "uo", "vo")
        if not any(place in str(error) for place in places) or "is a directory" in str(error):
            return PLACELESS
        raise
    same = len(seen) == len(values)
    same = same and all(
        np.array_equal(a, b, equal_nan=True) for a, b in zip(seen, values, strict=True)
    )
    return "true values" if same else "other values"


def trials(numbers: list[int]) -> None:
    """Damage and read files, one a number."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        wholes: dict[str, tuple[bytes, list[np.ndarray]]] = {}
        for number in numbers:
            rng = random.Random(number)
            made = rng.choice(list(NETCDF)) if number < GRIB else rng.choice(("grib1", "grib2"))
            suffix = ".nc" if number < GRIB else ".grib"
            if made not in wholes:
                path = folder / f"{made}{suffix}"
                path = NETCDF[made](path) if number < GRIB else grib(path, int(made[-1]))
                wholes[made] = path.read_bytes(), truth(path)
            content, values = wholes[made]
            kind, bad = damaged(content, rng)
            path = folder / f"{number}{suffix}"
            path.write_bytes(bad)

            def make(path: Path = path, values: list[np.ndarray] = values, made: str = made) -> str:
                seen = truth(path)
                same = len(seen) == len(values) and all(
                    np.array_equal(a, b, equal_nan=True) for a, b in zip(seen, values, strict=True)
                )
                return "true values" if same else SUMMED if made == "checksums" else "other values"

            watched.trial(number, f"{made} {kind}", make)
            path.unlink()


def main() -> None:
    """Run and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--netcdf", type=int, default=500)
    parser.add_argument("--grib", type=int, default=200)
    parser.add_argument("--zarr", type=int, default=250)
    parser.add_argument("--seed", type=int, default=0, help="of the first file")
    parser.add_argument("--trials", help=argparse.SUPPRESS)
    given = smallest.parse(parser, netcdf=5, grib=5, zarr=3)
    if given.trials is not None:
        numbers = [int(number) for number in given.trials.split(",")]
        trials([number for number in numbers if number < ZARR])
        zarr_trials([number for number in numbers if number >= ZARR])
        return
    kinds = (
        ("netCDF", given.seed, given.netcdf),
        ("GRIB", GRIB + given.seed, given.grib),
        ("Zarr", ZARR + given.seed, given.zarr),
    )
    bad = False
    for title, first, count in kinds:
        print(f"\n{title}")
        bad |= watched.table(watched.run(__file__, range(first, first + count)))
    sys.exit(bad)


if __name__ == "__main__":
    main()
