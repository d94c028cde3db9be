"""Kernel restriction of the files that this process and its children may open (Landlock).

It needs Linux 5.19 or later. `geo.files.fence` checks the names in a case, but cannot see files
that a library opens by itself, such as external links and external storage of netCDF-4 files; the
kernel can. Files can still be listed, and their attributes read.
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

# numbers of the system calls, on every architecture below
CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446
ARCHITECTURES = {"x86_64", "aarch64", "riscv64", "ppc64le", "s390x", "loongarch64"}
VERSION = 1  # flag of CREATE_RULESET that asks for the kernel's version of Landlock
LEAST = 2  # least useful version: the first one forbids renaming between folders
# REFER, renaming into another folder, is forbidden unless a rule allows it
READ_FILE, REFER = 1 << 2, 1 << 13
WRITE_FILE, TRUNCATE = 1 << 1, 1 << 14  # TRUNCATE from version 3 on
# removing files and folders; making devices, folders, files, sockets, pipes and links
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
CACHE_VARIABLES = ("DRIFT_CACHE", "MPLCONFIGDIR", "TI_OFFLINE_CACHE_FILE_PATH")  # folders of caches
VARIABLES = (  # variables that hold paths of files
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
    """Return the version of Landlock, 0 if there is none or it is too old."""
    if sys.platform != "linux" or os.uname().machine not in ARCHITECTURES or sys.maxsize < 2**32:
        return 0
    try:
        found = _call(CREATE_RULESET, None, 0, VERSION)
    except OSError:  # a kernel without Landlock, or a container that forbids it
        return 0
    return found if found >= LEAST else 0


def enclose(
    folders: Iterable[Path], program: Iterable[Path] = (), writable: Iterable[Path] = ()
) -> bool:
    """Restrict this thread and everything it starts from now on to certain files.

    It may read files in `folders`, of `program` and of Python; it may make, write, rename and
    remove files in `writable` folders and in caches. Call it before other threads start. Files that
    are already open stay accessible.

    Args:
        folders: with files of the case.
        program: files and folders of a program.
        writable: folders for output.

    Returns:
        True if the kernel enforces it, False if it has no Landlock.

    Raises:
        OSError: the kernel has Landlock, but the call failed.
    """
    kernel_version = version()
    if not kernel_version:
        return False
    folders = list(folders)
    writing = WRITE_FILE | REMOVE | MAKE | (TRUNCATE if kernel_version >= 3 else 0)
    rules = _call(CREATE_RULESET, struct.pack("=Q", READ_FILE | REFER | writing), 8, 0)
    try:
        _add_rule(rules, Path("/"), REFER)
        for path in (*folders, *program, *_own(folders)):
            _add_rule(rules, path, READ_FILE)
        for path in (*writable, *_cache_folders(), *map(Path, WRITABLE)):
            _add_rule(rules, path, READ_FILE | writing & ~DEVICES)
        if ctypes.CDLL(None).prctl(NO_NEW_PRIVILEGES, *map(ctypes.c_ulong, (1, 0, 0, 0))):
            raise OSError("no process may restrict itself here")
        _call(RESTRICT_SELF, rules, 0)
    finally:
        os.close(rules)
    return True


def _cache_folders() -> Iterable[Path]:
    """Yield the cache folders, made if possible: a rule needs an existing folder."""
    named = [os.environ.get(name) for name in CACHE_VARIABLES]
    for path in (*filter(None, named), *(platformdirs.user_cache_dir(name) for name in CACHES)):
        with contextlib.suppress(OSError):
            os.makedirs(path, exist_ok=True)
        yield Path(path)


def _own(folders: list[Path]) -> Iterable[Path]:
    """Yield the files and folders that Python, its libraries and their caches need.

    Module folders that contain the home folder or an allowed folder are left out: somebody merely
    started Python there.
    """
    yield from map(Path, SYSTEM)
    # If this folder does not exist and cannot be made, Matplotlib builds its cache in a temporary
    # folder each time.
    settings = Path(platformdirs.user_config_dir("matplotlib"))
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


def _add_rule(rules: int, path: Path, access: int) -> None:
    """Add a rule for a file, or for everything in a folder; absent paths need none."""
    try:
        place = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        if not stat.S_ISDIR(os.fstat(place).st_mode):
            # the kernel rejects folder rights in a rule for a file
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
