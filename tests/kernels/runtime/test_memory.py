"""The memory that may still be taken is the least of the machine's and of what control groups
grant.
"""

from pathlib import Path

import pytest

from kernels.runtime import memory

MB = 10**6


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The root of control groups on a machine with 1,000 MB left."""
    (tmp_path / "meminfo").write_text("MemTotal: 9000000 kB\nMemAvailable:     976562 kB\n")
    (tmp_path / "cgroup").write_text("0::/\n")
    (tmp_path / "groups").mkdir()
    monkeypatch.setattr(memory, "MEMINFO", tmp_path / "meminfo")
    monkeypatch.setattr(memory, "MEMBERSHIP", tmp_path / "cgroup")
    groups = tmp_path / "groups"
    monkeypatch.setattr(
        memory,
        "VERSIONS",
        tuple(
            (groups / path.relative_to(memory.CGROUPS), *names) for path, *names in memory.VERSIONS
        ),
    )
    return groups


def write(group: Path, **files: object) -> None:
    group.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (group / name.replace("__", ".")).write_text(f"{text}\n")


def test_a_machine_without_groups(machine: Path) -> None:
    assert memory.free() == 976_562 * 1024
    memory.MEMBERSHIP.unlink()
    assert memory.free() == 976_562 * 1024


def test_a_container_of_version_2(machine: Path) -> None:
    """Its limit less what it uses; what is cached of files goes when memory is wanted."""
    write(
        machine,
        memory__max=700 * MB,
        memory__current=250 * MB,
        memory__stat=f"anon 1\ninactive_file {30 * MB}\nactive_file {7 * MB}",
    )
    assert memory.free() == (700 - 250 + 30 + 7) * MB
    write(machine, memory__max="max")
    assert memory.free() == 976_562 * 1024


def test_a_batch_job_in_the_middle_of_the_tree(machine: Path) -> None:
    """A step without a limit, in a job with one, on a node that grants more."""
    memory.MEMBERSHIP.write_text("0::/slurm/job_7/step_0\n")
    write(
        machine / "slurm/job_7/step_0",
        memory__max="max",
        memory__current=5 * MB,
        memory__stat="inactive_file 0",
    )
    write(
        machine / "slurm/job_7",
        memory__max=300 * MB,
        memory__current=90 * MB,
        memory__stat="inactive_file 0",
    )
    write(
        machine / "slurm",
        memory__max=400 * MB,
        memory__current=95 * MB,
        memory__stat="inactive_file 0",
    )
    assert memory.free() == 210 * MB
    write(machine / "slurm", memory__max=200 * MB)
    assert memory.free() == 105 * MB


def test_version_1_counts_the_memory_s_tree_only(machine: Path) -> None:
    memory.MEMBERSHIP.write_text("9:name=systemd:/\n4:memory,hugetlb:/box\n1:cpu:/box\n0::/\n")
    group = {
        "memory__usage_in_bytes": 60 * MB,
        "memory__stat": f"inactive_file 3\ntotal_inactive_file {10 * MB}",
    }
    write(machine / "memory", memory__limit_in_bytes=9223372036854771712, **group)
    assert memory.free() == 976_562 * 1024
    write(machine / "memory/box", memory__limit_in_bytes=100 * MB, **group)
    write(machine / "cpu/box", memory__limit_in_bytes=MB, **group)
    assert memory.free() == 50 * MB


def test_a_process_with_a_limit(
    machine: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As jobs of `drift serve --memory` have one."""
    (tmp_path / "status").write_text("Name:\tpython\nVmSize:\t  900000 kB\nVmData:\t  200000 kB\n")
    monkeypatch.setattr(memory, "STATUS", tmp_path / "status")
    limits = dict.fromkeys(
        (memory.resource.RLIMIT_AS, memory.resource.RLIMIT_DATA), (memory.resource.RLIM_INFINITY, 0)
    )
    monkeypatch.setattr(memory.resource, "getrlimit", limits.__getitem__)
    assert memory.free() == 976_562 * 1024
    limits[memory.resource.RLIMIT_DATA] = (500_000 * 1024, 0)
    assert memory.free() == 300_000 * 1024
    limits[memory.resource.RLIMIT_AS] = (1_000_000 * 1024, 0)
    assert memory.free() == 100_000 * 1024


def test_a_group_that_is_full(machine: Path) -> None:
    write(machine, memory__max=70 * MB, memory__current=71 * MB, memory__stat="inactive_file 0")
    assert memory.free() == 0
