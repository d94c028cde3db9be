"""What a hundred servers that answer wrongly do to us: a line, a traceback, a crash or a hang.

Each answer is a good one, damaged in one of many ways (`tests/oracles/hostile.py`), the same for
the same seed. All slices are read, as `drift info` does. With --direct the netCDF library works in
the process that reads, as it would without `geo.files.address`.

python benchmarks/fuzz_server.py [--answers 100] [--seed 0] [--direct]
"""

import argparse
import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1] / "tests" / "oracles")]

import hostile
import smallest
import watched

TIMEOUT = 2.0  # [s] of a source


def read_all(numbers: list[int], direct: bool) -> None:
    """Read answers of hostile servers, one a number."""
    from geo.files import address
    from geo.forcing import sources

    if direct:
        import xarray as xr

        plain = {"decode_times": False, "decode_coords": False, "cache": False}
        address.open_dataset = lambda url, timeout: xr.open_dataset(
            url, decode_timedelta=False, **plain
        )
    sea = hostile.sea()
    for number in numbers:
        name, answer = hostile.mutated(sea, number)
        with hostile.serving(answer) as url:

            def make(url: str = url) -> str:
                source = sources.open_source("current", url, timeout=TIMEOUT)
                for i in range(len(source.times)):
                    source.read(i)
                return "read as if nothing were wrong"

            watched.trial(number, name, make)


def main() -> None:
    """Run and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--answers", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0, help="of the first answer")
    parser.add_argument(
        "--direct", action="store_true", help="let the library work in the process that reads"
    )
    parser.add_argument("--trials", help=argparse.SUPPRESS)
    given = smallest.parse(parser, answers=4)
    if given.trials is not None:
        read_all([int(number) for number in given.trials.split(",")], given.direct)
        return
    more = ["--direct"] if given.direct else []
    sys.exit(
        watched.table(
            watched.run(__file__, range(given.seed, given.seed + given.answers), more, told=True)
        )
    )


if __name__ == "__main__":
    main()
