"""GSHHG in pieces: the same polygons as the package holds, to the bit, whatever the box and
whatever became of the file.
"""

import contextlib
import os
import stat

import numpy as np
import oracle
import pytest
import shapely

from geo.box import Box
from geo.coast import gshhg, shore

BOXES = (
    Box(0.2, 0.1, 0.9, 0.8),
    Box(-30, -20, 40, 35),
    Box(170, -25, 200, 30),  # across 180 degrees
    Box(-185, -25, -175, 30),
    Box(-180, -90, 180, 90),
    Box(100, 85, 101, 86),
)


def same(one, other):
    """Whether polygons are the same ones in the same order, to the bit."""
    (points, ring), (other_points, other_ring) = (
        shapely.get_coordinates(shapely.get_rings(polygons), return_index=True)
        for polygons in (one, other)
    )
    lakes = shapely.get_num_interior_rings
    return (
        np.array_equal(points, other_points)
        and np.array_equal(ring, other_ring)
        and (lakes(one) == lakes(other)).all()
    )


def some_land():
    """Return islands of all sizes all over the Earth, in millionths of a degree, some of which end
    at 180 degrees.
    """
    rng = np.random.default_rng(5)
    n = 600
    lon, lat = rng.uniform(-180, 180, n), rng.uniform(-80, 80, n)
    size = np.exp(rng.uniform(np.log(0.001), np.log(30), n))
    corners = 3 + rng.integers(0, 9, n)
    made = []
    for k in range(n):
        turn = np.sort(rng.uniform(0, 2 * np.pi, corners[k]))
        ring = np.stack([lon[k] + size[k] * np.cos(turn), lat[k] + size[k] * np.sin(turn)], axis=1)
        made.append(np.rint(np.clip(ring, (-180, -90), (180, 90)) * 1e6) / 1e6)
    return np.array([shapely.Polygon(ring) for ring in made])


@pytest.fixture
def land(tmp_path, monkeypatch):
    """Land that stands for GSHHG, with a cache of its own; how often the package was read."""
    monkeypatch.setenv("DRIFT_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(gshhg, "LARGE", 8)
    polygons, reads = some_land(), []
    monkeypatch.setattr(gshhg, "_read_package", lambda: reads.append(1) or polygons)
    return polygons, reads


def test_every_box_has_the_same_land_from_one_reading(land):
    polygons, reads = land
    fewest = polygons.size
    for box in BOXES:
        assert same(shore.clip(gshhg.near(box), box), shore.clip(polygons, box))
        fewest = min(fewest, gshhg.near(box).size)
    assert fewest < 0.05 * polygons.size  # it read what is near, not all
    assert same(gshhg.whole(), polygons)
    assert reads == [1]


@pytest.mark.parametrize("place", ["cut", "head", "piece", "length", "foreign", "empty"])
def test_a_broken_file_is_made_anew(land, place):
    polygons, reads = land
    gshhg.whole()
    (file,) = gshhg.cache_folder().iterdir()
    content = bytearray(file.read_bytes())
    # the length of the table, which asks for 2^60 bytes then
    if place in ("head", "piece", "length"):
        at = {
            "head": gshhg.BEGIN.size + 30,
            "piece": len(content) // 2,
            "length": gshhg.BEGIN.size - 1,
        }[place]
        content[at] ^= 0x10
    file.write_bytes(
        {"cut": content[:-20], "foreign": b"nothing of the kind" * 9, "empty": b""}.get(
            place, content
        )
    )
    assert same(gshhg.whole(), polygons)
    assert reads == [1, 1]
    assert same(gshhg.whole(), polygons)
    assert reads == [1, 1]  # the file is whole again
    assert [one.name for one in gshhg.cache_folder().iterdir()] == [file.name]


@pytest.mark.parametrize("kind", ["finer", "lake"])
def test_what_the_file_cannot_give_back_is_not_kept(land, monkeypatch, kind):
    other = {
        "finer": np.array([shapely.box(0.25, 0.3, 0.7000001, 0.5)]),
        "lake": np.array([shapely.difference(shapely.box(0, 0, 3, 3), shapely.box(1, 1, 2, 2))]),
    }[kind]
    monkeypatch.setattr(gshhg, "_read_package", lambda: other)
    for _ in range(2):
        assert same(gshhg.near(Box(0, 0, 1, 1)), other)
    assert not gshhg.cache_folder().exists() or not list(gshhg.cache_folder().iterdir())


def test_a_cache_that_cannot_be_written_costs_time_alone(land, tmp_path, monkeypatch):
    polygons, _ = land
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("DRIFT_CACHE", str(tmp_path / "file"))
    assert same(gshhg.whole(), polygons)


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_a_full_disk_or_an_interrupt_leaves_nothing_behind(land, monkeypatch, error):
    def fail(source, target):
        raise error

    monkeypatch.setattr(os, "replace", fail)
    with contextlib.suppress(KeyboardInterrupt):
        assert same(gshhg.whole(), land[0])
    assert not list(gshhg.cache_folder().iterdir())


def test_what_a_killed_writer_left_goes_after_a_day(land):
    gshhg.cache_folder().mkdir(parents=True)
    name = f"gshhg-{gshhg.version()}.pieces"
    for left, age in (("ab12cd", 90_000), ("ef34gh", 0)):  # the younger may be written just now
        file = gshhg.cache_folder() / f"{name}{left}"
        file.write_bytes(b"half of it")
        os.utime(file, (file.stat().st_atime, file.stat().st_mtime - age))
    gshhg.whole()
    assert sorted(one.name for one in gshhg.cache_folder().iterdir()) == [name, f"{name}ef34gh"]


def test_others_who_share_the_folder_can_read_the_file(land):
    gshhg.whole()
    (file,) = gshhg.cache_folder().iterdir()
    assert stat.S_IMODE(file.stat().st_mode) == 0o644


@pytest.mark.thorough
def test_the_installed_land_is_kept_to_the_bit():
    """Of the whole Earth, as the oracles read it: it is kept at all only where it can be."""
    kept = gshhg.whole()
    assert same(kept, oracle.earth())
    assert (gshhg.cache_folder() / f"gshhg-{gshhg.version()}.pieces").is_file()
