"""Downloads from the page: which providers, how much, the job, and the text that reads the files.

The providers are a server of this machine.
"""

import os
import sys
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import hostile
import netCDF4
import numpy as np
import pytest
from desks import Server, check_strangers, until
from ocean_servers import AXES, TABLE, ocean

from drift.apps.serve import users
from drift.apps.serve.fields import form

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the catalogue's folder is XDG's")

CASE = """title = "a raft"
start = "2024-03-01T06:00Z"
duration = "7 h"
particles = 500
coast.source = "none"
[[wind]]
name = "air"
constant = { speed = "10 kn", from = 215 }
[[scenario]]
name = "raft"
object = "PIW-1"
position = { at = "37 24N 001 18E", error = "1 nmi" }
"""
LON, LAT, _ = AXES["plain"]
OTHER = """
[secret_sea]
title = "for members"
quantity = "current"
protocol = "opendap"
address = "http://members.example.org/sea"
variables = ["u", "v"]
credentials = "a password"
"""
BODY = {"text": CASE, "name": "raft.toml", "wanted": {"current": "trial"}, "size_only": False}


def config(folder: Path, address: str) -> str:
    """Write the user's own catalogue; return the variable that names its folder."""
    own = folder / "casp-drift"
    own.mkdir(parents=True)
    text = TABLE.format(address=address, protocol="opendap") + OTHER
    (own / "providers.toml").write_text(text, encoding="utf-8")
    return str(folder)


@pytest.fixture(scope="module")
def fetching(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Server, list[str]]]:
    """A desk beside a provider, and what the provider was asked."""
    outer, seen = tmp_path_factory.mktemp("fetching"), list[str]()
    (outer / "cases").mkdir()
    people = (users.User("ANNA"), users.User("PRESS", guest=True))
    with (
        hostile.serving(hostile.speaking_dap(ocean(LON, LAT), seen)) as address,
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setenv("XDG_CONFIG_HOME", config(outer / "config", address))
        with Server((outer / "cases").resolve(), people=people) as one:
            yield one, seen


def done(served: Server, job: Any) -> Any:
    assert "number" in job, job
    return until(lambda: (now := served.job(job["number"]))["state"] not in ("waiting", "running") and now, 120)  # fmt: skip


def test_providers_are_those_of_the_catalogue(fetching: tuple[Server, list[str]]) -> None:
    told = fetching[0].json("POST", "/api/fetch/providers")["providers"]
    by_name = {one["name"]: one for one in told}
    assert by_name["trial"]["free"]
    assert not by_name["secret_sea"]["free"]
    assert by_name["noaa_gfs"]["quantity"] == "wind"
    assert not any("http" in str(one) for one in told)  # addresses stay with the server


@pytest.mark.thorough
def test_a_download_is_what_the_text_needs(fetching: tuple[Server, list[str]]) -> None:
    """First its size, then the files; then a text that reads them, which drift checks."""
    served, seen = fetching
    sized = done(served, served.json("POST", "/api/fetch", {**BODY, "size_only": True}))
    assert sized["state"] == "done", sized["lines"]
    assert any("trial" in line for line in sized["lines"])
    assert sized["out"] is None
    assert not any(".dods?u" in target for target in seen)  # no value yet
    job = done(served, served.json("POST", "/api/fetch", BODY))
    assert (job["state"], job["out"]) == ("done", "raft-forcing"), job["lines"]
    files = sorted((served.folder / "raft-forcing").glob("current-trial-*.nc"))
    sea = ocean(LON, LAT)
    for path in files:
        with netCDF4.Dataset(path) as data:
            data.set_auto_maskandscale(False)
            t = data["time"][:].astype(int)
            rows = [int(np.flatnonzero(lat == LAT)[0]) for lat in data["lat"][:]]
            columns = [int(np.flatnonzero(lon == LON)[0]) for lon in data["lon"][:]]
            expected = sea["u"].values[np.ix_(t, rows, columns)]
            assert data["u"][:].tobytes() == expected.tobytes()
            assert data["lon"][:].min() < 1.3 < data["lon"][:].max()
            assert data["lat"][:].min() < 37.4 < data["lat"][:].max()
            assert data["lon"][:].max() - data["lon"][:].min() < 10  # not the whole sea
            assert t.min() <= 6
            assert t.max() >= 13
    used = {"text": CASE, "files": "raft-forcing"}
    text = served.json("POST", "/api/fetch/use", used)["text"]
    tables = tomllib.loads(text)
    assert tables["current"] == [
        {
            "name": "trial",
            "files": "raft-forcing/current-trial-*.nc",
            "variables": {"east": "u", "north": "v"},
        }
    ]
    before = tomllib.loads(CASE)
    assert {key: value for key, value in tables.items() if key != "current"} == before
    shown = served.json("POST", "/api/form", {"text": text})["fields"]["current"]["value"]
    assert shown == {"kind": "files", "files": ["raft-forcing/current-trial-*.nc"]}
    cover = served.json("POST", "/api/forcing", {"file": shown["files"][0]})["sources"]
    assert [one["quantity"] for one in cover] == ["current"]
    checked = served.json("POST", "/api/check", {"text": text, "name": "raft.toml"})
    assert checked["messages"] == []
    saved = served.json("POST", "/api/cases/raft.toml", {"text": text, "digest": None})
    run = {"kind": "check", "case": "raft.toml", "digest": saved["digest"]}
    assert done(served, served.json("POST", "/api/jobs", run))["state"] == "done"


@pytest.mark.parametrize(
    "wanted",
    [
        {"current": "http://evil.example/sea"},  # never an address
        {"current": "secret_sea"},  # credentials are for the command line
        {"current": "noaa_gfs"},  # that has winds
        {"wind": "--catalogue=x"},
        {"coast": None},
        {"current": 3},
        {},
    ],
)
def test_only_providers_of_the_catalogue(fetching: tuple[Server, list[str]], wanted: Any) -> None:
    served, seen = fetching
    before = len(seen)
    status, _, data = served.ask("POST", "/api/fetch", {**BODY, "wanted": wanted})
    assert status == 400, data
    assert len(seen) == before


def test_who_may_not(fetching: tuple[Server, list[str]]) -> None:
    served, _ = fetching
    check_strangers(served, "fetch", BODY)
    guest = next(one for one in served.secret.users if one.guest)
    for path, body in (("fetch", BODY), ("fetch/use", {"text": CASE, "files": "raft-forcing"})):
        cookie = f"drift-{served.port}={guest.cookie}"
        assert served.ask("POST", f"/api/{path}", body, Cookie=cookie)[0] == 403


def test_a_text_with_mistakes_starts_no_job(fetching: tuple[Server, list[str]]) -> None:
    served, _ = fetching
    before = served.json("GET", "/api/jobs")["jobs"]
    told = served.json("POST", "/api/fetch", {**BODY, "text": CASE.replace("7 h", "7 bananas")})
    assert "bananas" in told["mistakes"][0]
    own = CASE + '[[current]]\nfiles = "a.nc"\n[[current]]\nfiles = "b.nc"\n'
    told = served.json("POST", "/api/fetch", {**BODY, "text": own})
    assert told["mistakes"] == ["current is set in the text; change it there"]
    assert served.json("GET", "/api/jobs")["jobs"] == before


@pytest.mark.parametrize("files", ["../cases", "nothing", "/etc", "made"])
def test_only_a_download_is_used(fetching: tuple[Server, list[str]], files: str) -> None:
    served, _ = fetching
    made = served.folder / "made"
    made.mkdir(exist_ok=True)
    if not (made / "forcing.toml").is_symlink():
        (made / "forcing.toml").symlink_to(served.folder.parent / "config")
    status, _, _ = served.ask("POST", "/api/fetch/use", {"text": CASE, "files": files})
    assert status in (400, 404)


@pytest.mark.thorough
def test_a_download_reads_and_asks_no_more(fetching: tuple[Server, list[str]]) -> None:
    """Its fence has the served folder, the catalogue and the provider's host; that of runs stays."""
    served, _ = fetching
    desk = next(one.endpoint for one in served.routes if one.path == "/api/jobs").__self__
    job = served.json("POST", "/api/fetch", {**BODY, "size_only": True})
    download = desk.jobs.get(job["number"]).download
    host = download.fence.hosts
    assert len(host) == 1
    assert next(iter(host)).startswith("127.0.0.1:")
    own = Path(os.environ["XDG_CONFIG_HOME"]) / "casp-drift" / "providers.toml"
    assert download.fence.folders == (served.folder, own.resolve())
    assert download.fence.writable == (served.folder,)
    assert desk.jobs._fence.hosts == {"thredds.example.org"}
    assert not any(
        "raft" in one or "PIW" in one for one in download.arguments
    )  # nothing of the text
    done(served, job)


@pytest.mark.thorough
def test_a_download_can_be_cancelled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From a server that never answers; the files are not there."""
    with hostile.serving(hostile.silent) as address:
        monkeypatch.setenv("XDG_CONFIG_HOME", config(tmp_path / "config", address))
        (tmp_path / "cases").mkdir()
        with Server((tmp_path / "cases").resolve()) as served:
            job = served.json("POST", "/api/fetch", BODY)
            until(lambda: served.job(job["number"])["state"] == "running", 60)
            time.sleep(0.5)
            served.json("POST", f"/api/jobs/{job['number']}/cancel")
            assert done(served, job)["state"] == "cancelled"
            assert not (served.folder / "raft-forcing").exists()


def test_keys_of_reading_go_with_their_files() -> None:
    """Another file of the form is not read by the names of those that were downloaded."""
    table = {"name": "trial", "files": "a/*.nc", "variables": {"east": "u", "north": "v"}}
    text = form.use_files(CASE, {"current": table})

    def current(files: list[str]) -> Any:
        value = {"kind": "files", "files": files}
        return tomllib.loads(form.set_fields(text, [{"field": "current", "value": value}]))[
            "current"
        ]

    assert current(["a/*.nc", "b.nc"])[0]["variables"] == {"east": "u", "north": "v"}
    assert current(["b.nc"]) == [{"name": "trial", "files": "b.nc"}]
    typed = {"kind": "constant", "speed": "1 kn", "toward": 75}
    changed = form.set_fields(text, [{"field": "current", "value": typed}])
    assert tomllib.loads(changed)["current"][0].keys() == {"name", "constant"}
    # typed winds had an error of their own; files have that of the templates
    wind = form.use_files(CASE, {"wind": {"name": "air", "files": "w/*.nc", "depth": "10 m"}})
    assert tomllib.loads(wind)["wind"] == [{"name": "air", "files": "w/*.nc", "depth": "10 m"}]
