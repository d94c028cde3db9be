"""Every kernel in its variants, compiled for a backend without data.

    python variants.py BACKEND [--ptx FOLDER] [--part K N]

A variant is a kernel with one set of compile-time arguments (`ti.template()`). VALUES says which
values each such argument may have. This prints a line of JSON for each variant. With --ptx it also
launches each, which makes its PTX: only on the stub of CUDA's driver, which runs nothing (see
tests/backends/cuda_stub.c, and there CUDA_STUB_OUT, which must be the same folder).
"""

import argparse
import itertools
import json
import time
from pathlib import Path
from typing import Any

import constructs
import taichi as ti
from taichi.lang import impl
from taichi.lang.argpack import ArgPackType
from taichi.lang.matrix import MatrixType
from taichi.lang.struct import StructType
from taichi.types.annotations import template

from kernels.evidence import glimpse, observe, sweep
from kernels.runtime import bundle, launch, runtime, tables, taichi_inside
from kernels.runtime.dtypes import NUMPY
from kernels.step import advance, buoys, features, velocity

# but for the parameters of a velocity of the user's own
EVERYTHING = (1 << 18) - 1 | features.SHARED | features.TAIL | features.CHANGES
ROUND_THE_POLE = features.POLAR | features.LAYERS | features.MEMBERS
USUAL = features.CURRENT | features.WIND | features.ERRORS | features.JIBE | features.RK4
USUAL |= features.DIFFUSION | features.BIAS
# on a card what is near the shore is moved late, but for changes of state
LATE = EVERYTHING & ~ROUND_THE_POLE & ~features.CHANGES
YES_OR_NO = (False, True)
FIELDS = (observe.LINE, observe.BOX, observe.IN_BOX, observe.DISC, observe.IN_DISC)
SWEEPS = (sweep.CUBE, sweep.ABEAM, sweep.ZONES, sweep.INSIDE)


@ti.func
def _downwind(current, wind, waves, parameters):
    """A velocity of a user's own."""
    return current + waves + parameters[0] * wind


# By name, and where modules differ by module and name: the values of compile-time arguments.
VALUES: dict[str, tuple[Any, ...]] = {
    "by_latitude": (False,),
    "besides": (observe.WHETHER, observe.REPORT, observe.WHEN),
    "both": YES_OR_NO,
    "bridged": YES_OR_NO,
    "coastal": YES_OR_NO,
    "cube": YES_OR_NO,
    "features": (features.CURRENT, USUAL, LATE, EVERYTHING & ~ROUND_THE_POLE, EVERYTHING),
    "function": (_downwind,),
    "listed": YES_OR_NO,
    "meaning": (sweep.HAZARD, sweep.SHARE, sweep.MISS),
    "members": YES_OR_NO,
    "polar": YES_OR_NO,
    "random": YES_OR_NO,
    "squared": YES_OR_NO,
    "tilted": YES_OR_NO,
    "velocity": (velocity.drift,),
    "watch.kind": (glimpse.HEARD, glimpse.ROUND, glimpse.PLACES),
    "observe.kind": FIELDS,
    "sweep.kind": SWEEPS,
}
CYCLED = {"listed", "besides"}  # they take turns: they matter little to what else is compiled
DERIVED = {"width", "held_of"}  # from the backend, and from `features`
ELEMENTS = 64  # of each array


def kernels(part: int = 0, parts: int = 1) -> dict[str, Any]:
    """Return every kernel, by module and name, or those of one of several parts."""
    found = {
        name: each
        for module in constructs.MODULES
        for name, each in constructs.kernels(module).items()
    }
    return dict(itertools.islice(found.items(), part, None, parts))


def variants(name: str, kernel: Any) -> list[dict[str, Any]]:
    """Return sets of compile-time arguments of a kernel: all combinations, but for CYCLED."""
    module = name.split(".")[0]
    wanted = [own.name for own in kernel._primal.arguments if isinstance(own.annotation, template)]
    values = {}
    for own in wanted:
        found = VALUES.get(f"{module}.{own}") or VALUES.get(own)
        if found is None and own not in DERIVED:
            raise LookupError(f"{name}: give the values of {own!r} in VALUES of variants.py")
        values[own] = found or (None,)
    combined = {own: each for own, each in values.items() if own not in CYCLED | DERIVED}
    cycled = {own: each for own, each in values.items() if own in CYCLED}
    every = list(itertools.product(*combined.values()))
    found = []
    for number in range(max(len(every), *map(len, cycled.values()), 1)):
        turn = {own: each[number % len(each)] for own, each in cycled.items()}
        found.append(dict(zip(combined, every[number % len(every)], strict=True)) | turn)
    return found


def arguments(kernel: Any, chosen: dict[str, Any]) -> list[Any]:
    """Return arguments with which a kernel can be compiled: zeros, but for what is chosen."""
    whole = {"width": bundle.width(), **chosen}
    if "features" in chosen:
        whole["held_of"] = bundle.held(**advance._rows(chosen["features"]))
    else:
        whole["held_of"] = buoys._registers(2, 8)
    each = [
        whole[own.name] if isinstance(own.annotation, template) else zero(own.annotation)
        for own in kernel._primal.arguments
    ]
    return taichi_inside._structured(kernel._primal, each)


def zero(kind: Any) -> Any:
    """Return an argument of a kind that holds zeros."""
    if constructs.is_array(kind):
        if kind.ndim == 2:
            return tables.empty(ELEMENTS, ELEMENTS, NUMPY[kind.dtype])
        one = isinstance(kind.dtype, MatrixType)
        return (
            runtime.empty_nodes(ELEMENTS) if one else runtime.empty(ELEMENTS, kind.dtype or ti.f32)
        )
    if isinstance(kind, ArgPackType):
        return launch.pack(kind, *map(zero, kind.members.values()))
    if isinstance(kind, StructType):
        return {name: zero(member) for name, member in kind.members.items()}
    if isinstance(kind, MatrixType):
        return kind(*[0] * kind.n)
    return 0.0 if kind in (ti.f32, ti.f64) else 0


def compile_variant(kernel: Any, chosen: dict[str, Any], runs: bool) -> None:
    """Compile a kernel for the running backend; runs: launch it too."""
    primal, program = kernel._primal, impl.get_runtime().prog
    given = arguments(kernel, chosen)
    compiled = primal.compiled_kernels[primal.ensure_compiled(*given)]
    program.compile_kernel(program.config(), program.get_device_caps(), compiled)
    if runs:
        kernel(*given)


def main() -> None:
    """Compile every variant, and print what came of each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("backend", choices=runtime.BACKENDS)
    parser.add_argument("--ptx", type=Path, metavar="FOLDER")
    parser.add_argument("--part", type=int, nargs=2, default=(0, 1), metavar=("K", "N"))
    options = parser.parse_args()
    runtime.start(options.backend)
    for name, kernel in kernels(*options.part).items():
        for number, chosen in enumerate(variants(name, kernel)):
            there = set(options.ptx.glob("*.ptx")) if options.ptx else set()
            begin, error = time.perf_counter(), ""
            try:
                compile_variant(kernel, chosen, runs=bool(options.ptx))
            except Exception as failed:  # of any kind: Taichi's compiler has many
                lines = [line for line in str(failed).splitlines() if line.strip()]
                error = f"{type(failed).__name__}: {lines[-1] if lines else ''}"
            for path in set(options.ptx.glob("*.ptx")) - there if options.ptx else ():
                path.rename(path.with_name(f"{name}.{number}.ptx"))
            words = {own: value for own, value in chosen.items() if not callable(value)}
            seconds = round(time.perf_counter() - begin, 2)
            row = {"kernel": name, "variant": words, "error": error, "seconds": seconds}
            print(json.dumps(row))


if __name__ == "__main__":
    main()
