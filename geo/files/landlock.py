"""Files that this process and its children may read and write, held by the kernel: Linux' Landlock
(5.19 or later).

`geo.files.fence` looks at the names that a case gives. What a library opens by itself, such as the
external links and external storage of a netCDF-4 file, it never sees: the kernel does. Names of
files can still be listed and asked about.
"""

import contextlib
import ctypes
import os
import stat
import struct
import sys
from collections.abc import Iterable
from pathlib import Path

import platformdirs

# numbers of the calls, on every architecture below
CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446
ARCHITECTURES = {"x86_64", "aarch64", "riscv64", "ppc64le", "s390x", "loongarch64"}
VERSION = 1  # of CREATE_RULESET: asks which version the kernel has
LEAST = 2  # version: the first could rename nothing from one folder into another
# REFER, renaming into another folder, is forbidden unless a rule allows it
READ_FILE, REFER = 1 << 2, 1 << 13
WRITE_FILE, TRUNCATE = 1 << 1, 1 << 14  # TRUNCATE from version 3 on
# files and folders; devices, folders, files, sockets, pipes and links
REMOVE, MAKE = 0b11 << 4, 0b1111111 << 6
DEVICES = 1 << 6 | 1 << 11
PATH_BENEATH = 1  # kind of rule
NO_NEW_PRIVILEGES = 38  # of prctl: without it only the superuser may restrict itself

SYSTEM = (
    "/usr",
    "/lib",
    "/lib32",
    "/lib64",
    "/nix/store",
    "/gnu/store",
    "/dev/null",
    "/dev/zero",
    "/dev/random",
    "/dev/urandom",
    "/proc/cpuinfo",
    "/proc/meminfo",
    "/proc/stat",
    "/proc/sys",
    "/proc/self/maps",
    "/proc/self/cgroup",
    "/sys/devices/system",
    "/sys/fs/cgroup",
    *(
        f"/etc/{name}"
        for name in (
            "ld.so.cache",
            "localtime",
            "locale.alias",
            "fonts",
            "mime.types",
            "ssl",
            "pki",
            "ca-certificates",
        )
    ),
    *(
        f"/etc/{name}"
        for name in ("resolv.conf", "hosts", "host.conf", "nsswitch.conf", "gai.conf", "services")
    ),
)
WRITABLE = ("/dev/null", "/dev/zero", "/dev/full")
CACHES = ("casp-drift", "matplotlib", "taichi")
CACHE_VARIABLES = ("DRIFT_CACHE", "MPLCONFIGDIR", "TI_OFFLINE_CACHE_FILE_PATH")  # that name caches
VARIABLES = (  # that name files
    *CACHE_VARIABLES,
    "ECCODES_DEFINITION_PATH",
    "PROJ_DATA",
    "PROJ_LIB",
    "GDAL_DATA",
    "SSL_CERT_FILE",
    "SSL_CERT_DIR",
    "LD_LIBRARY_PATH",
)


def version() -> int:
    """Return the version of Landlock here, 0 where there is none, or one of no use."""
    if sys.platform != "linux" or os.uname().machine not in ARCHITECTURES or sys.maxsize < 2**32:
        return 0
    try:
        found = _call(CREATE_RULESET, None, 0, VERSION)
    except OSError:  # a kernel without, or a container that forbids it
        return 0
    return found if found >= LEAST else 0


def enclose(
    folders: Iterable[Path], program: Iterable[Path] = (), writable: Iterable[Path] = ()
) -> bool:
    """Let this thread, and what it starts from now on, open no other files than these.

    It reads files in folders, of a program and what Python needs; it makes, writes, renames and
    removes files in writable folders and in the caches. Call it before other threads are started.
    Files that are open already stay so. Returns whether the kernel holds it, False where it has no
    Landlock; raises OSError where it has Landlock but fails.
    """
    held = version()
    if not held:
        return False
    folders = list(folders)
    writing = WRITE_FILE | REMOVE | MAKE | (TRUNCATE if held >= 3 else 0)
    rules = _call(CREATE_RULESET, struct.pack("=Q", READ_FILE | REFER | writing), 8, 0)
    try:
        _allow(rules, Path("/"), REFER)
        for path in (*folders, *program, *_own(folders)):
            _allow(rules, path, READ_FILE)
        for path in (*writable, *_caches(), *map(Path, WRITABLE)):
            _allow(rules, path, READ_FILE | writing & ~DEVICES)
        if ctypes.CDLL(None).prctl(NO_NEW_PRIVILEGES, *map(ctypes.c_ulong, (1, 0, 0, 0))):
            raise OSError("no process may restrict itself here")
        _call(RESTRICT_SELF, rules, 0)
    finally:
        os.close(rules)
    return True


def _caches() -> Iterable[Path]:
    """Return the folders of caches, made where they can be: a folder that is not there can have no
    rule.
    """
    named = [os.environ.get(name) for name in CACHE_VARIABLES]
    for path in (*filter(None, named), *(platformdirs.user_cache_dir(name) for name in CACHES)):
        with contextlib.suppress(OSError):
            os.makedirs(path, exist_ok=True)
        yield Path(path)


def _own(folders: list[Path]) -> Iterable[Path]:
    """Return what Python, its libraries and their caches need.

    A place where modules are looked for that holds the home folder or a folder of the fence is left
    out: it is where somebody happened to start Python.
    """
    yield from map(Path, SYSTEM)
    # where it is not there and cannot be made, Matplotlib
    settings = Path(platformdirs.user_config_dir("matplotlib"))
    # puts its cache into a temporary folder, and makes it again each time
    with contextlib.suppress(OSError):
        settings.mkdir(parents=True, exist_ok=True)
    yield settings
    yield from (
        Path(part)
        for name in VARIABLES
        for part in os.environ.get(name, "").split(os.pathsep)
        if part
    )
    yield from map(Path, (sys.prefix, sys.base_prefix))
    others = [Path.home(), *folders]
    for place in filter(None, sys.path):
        real = Path(place).resolve()
        if not any(other.is_relative_to(real) for other in others):
            yield real


def _allow(rules: int, path: Path, access: int) -> None:
    """Add a rule for a file, or for all in a folder; what is not there needs none."""
    try:
        place = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        if not stat.S_ISDIR(os.fstat(place).st_mode):
            # the kernel rejects rules of a file about others
            access &= READ_FILE | WRITE_FILE | TRUNCATE
        _call(ADD_RULE, rules, PATH_BENEATH, struct.pack("=Qi", access, place), 0)
    finally:
        os.close(place)


def _call(number: int, *arguments: object) -> int:
    library = ctypes.CDLL(None, use_errno=True)
    long = [ctypes.c_long(one) if isinstance(one, int) else one for one in arguments]
    answer: int = library.syscall(ctypes.c_long(number), *long)
    if answer < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return answer
