"""Maps of many outputs lie on disk and not in memory, where there is room for them."""

from types import SimpleNamespace

import clouds
import numpy as np
import pytest

from drift.engine.particles.snapshot import Snapshot
from drift.forecast import build
from drift.products.files import temporary
from geo import sphere

N, OUTPUTS = 3000, 5


def outputs() -> list[Snapshot]:
    """Return a cloud that runs off to the north-east and spreads; at the second output nobody is on
    the map.
    """
    rng, found = np.random.default_rng(5), []
    for k in range(OUTPUTS):
        east, north = (
            rng.normal(0.02 * k, 0.004 * (k + 1), N),
            rng.normal(0.03 * k, 0.003 * (k + 1), N),
        )
        lon, lat = (
            np.asarray(sphere.to_binary(angle)).astype(np.int32)
            for angle in (7.3 + east, 54.1 + north)
        )
        gone = np.full(N, 3 if k == 1 else 0)
        time = np.datetime64("2026-11-21T18:00") + np.timedelta64(k, "h")
        found.append(clouds.at(time, lon, lat, np.full(N, 1 / N), gone, np.arange(N) % 2))
    return found


def test_on_disk_they_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    in_memory = build.build_forecast(outputs(), scenarios=["one", "other"])
    monkeypatch.setattr(temporary, "LARGE", 0)
    on_disk = build.build_forecast(outputs(), scenarios=["one", "other"])
    assert on_disk.data.identical(in_memory.data)
    assert np.isnan(on_disk.data["containment"].values[1]).all()
    assert np.isfinite(on_disk.data["containment"].values[[0, 2, 3, 4]]).all()
    assert isinstance(on_disk.data["containment"].values.base, np.memmap)
    assert not isinstance(in_memory.data["containment"].values.base, np.memmap)


@pytest.mark.parametrize(("worth", "most"), [(10**9, 1), (0, 3)])
def test_maps_are_laid_out_in_their_turn(
    monkeypatch: pytest.MonkeyPatch, worth: int, most: int
) -> None:
    """What particles leave in cells is asked for map by map, one for each of two copies of the
    process if there are any; each is let go of once it is put in.
    """
    asked, done, ahead = [0], [0], []
    laid, put = build.cloud.deposit_sums, build.dataset.Maps.put

    def counted(*given: object, **named: object) -> object:
        asked[0] += 1
        ahead.append(asked[0] - done[0])
        return laid(*given, **named)

    def putting(*given: object) -> None:
        put(*given)
        done[0] += 1

    monkeypatch.setattr(build, "WORTH", worth)
    monkeypatch.setattr(build.runtime, "threads", lambda: 2)
    monkeypatch.setattr(build.cloud, "deposit_sums", counted)
    monkeypatch.setattr(build.dataset.Maps, "put", putting)
    build.build_forecast(outputs() * 4, scenarios=["one", "other"])
    assert asked[0] == 4 * (OUTPUTS - 1)
    assert max(ahead) == (most if build.copies.possible() else 1)


def test_without_room_on_disk_they_stay_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(temporary, "LARGE", 0)
    monkeypatch.setattr(temporary.shutil, "disk_usage", lambda folder: SimpleNamespace(free=399))
    assert not isinstance(temporary.zeros([(10, 10)], np.float32)[0], np.memmap)
    monkeypatch.undo()

    def full(*given: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(temporary, "LARGE", 0)
    assert isinstance(temporary.zeros([(10, 10)], np.float32)[0], np.memmap)
    monkeypatch.setattr(temporary.os, "posix_fallocate", full)
    assert not isinstance(temporary.zeros([(10, 10)], np.float32)[0], np.memmap)


def test_what_is_let_go_stays() -> None:
    values, small = temporary.zeros([(700, 500, 200), (3, 4)], np.float32)
    values[17, 3] = 5
    temporary.release_pages(values)
    temporary.release_pages(small)
    assert values[17, 3].tolist() == [5] * 200
    assert values[16].max() == 0
