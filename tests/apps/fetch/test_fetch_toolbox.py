"""The Copernicus Marine toolbox as a program: what it is asked, and how its failures are told.

Its servers cannot be reached from a test: a program of the same name stands in for it, with the
options of version 2.5.
"""

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from drift.apps.fetch import catalogue, parts, toolbox
from drift.apps.fetch.order import Order
from geo.box import Box
from geo.errors import UserError
from geo.files.web import TemporaryError

BEGIN = np.datetime64("2026-11-20T00:00:00", "s")


@pytest.fixture
def order() -> Order:
    known = catalogue.read_providers(Path(os.devnull))["cmems_current"]
    return Order(known, Box(170, -10, 190, 5), BEGIN, BEGIN + np.timedelta64(36, "h"), 5.0, BEGIN)


def program(folder: Path, monkeypatch: pytest.MonkeyPatch, body: str) -> None:
    """Put a program named copernicusmarine before all others."""
    path = folder / "copernicusmarine"
    path.write_text(
        f"#!{sys.executable}\nimport sys\nwords = sys.argv[1:]\n{body}\n", encoding="utf-8"
    )
    path.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")


def test_what_the_toolbox_is_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, order: Order
) -> None:
    log = tmp_path / "log"
    program(
        tmp_path, monkeypatch,
        f"open({str(log)!r}, 'a').write(' '.join(words) + chr(10))\n"
        "print('{\"file_size\": \"12.50 MB\"}') if '--dry-run' in words else None",
    )  # fmt: skip
    shipment = toolbox.ship(order)
    assert shipment.size == pytest.approx(12.5e6, rel=0.01)
    assert len(shipment.parts) == 2  # 36 hours and three before and after: 42
    asked = log.read_text()
    assert asked.startswith(
        "subset --dataset-id cmems_mod_glo_phy_anfc_0.083deg_PT1H-m --variable uo --variable vo "
    )
    assert "--minimum-longitude 169.7500 --maximum-longitude 190.2500" in asked
    assert "--start-datetime 2026-11-19T21:00:00 --end-datetime 2026-11-21T14:59:59" in asked
    with pytest.raises(TemporaryError, match="wrote nothing"):
        shipment.parts[0].make(tmp_path / "part.nc")


@pytest.mark.parametrize(
    ("last", "kind", "message"),
    [
        ("Copernicus Marine username: Aborted!", UserError, "run copernicusmarine login once"),
        ("Dataset not found", UserError, "copernicusmarine: Dataset not found"),
        ("Connection reset", TemporaryError, "failed .Connection reset."),
    ],
)
def test_its_failures_are_told(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    order: Order,
    last: str,
    kind: type[Exception],
    message: str,
) -> None:
    program(tmp_path, monkeypatch, f"sys.stderr.write({last!r}); sys.exit(1)")
    with pytest.raises(kind, match=message):
        toolbox.ship(order)


def test_a_toolbox_that_hangs_is_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, order: Order
) -> None:
    program(tmp_path, monkeypatch, "import time; time.sleep(60)")
    with pytest.raises(TemporaryError, match=r"did not finish within 0\.5 s"):
        toolbox._run_toolbox(["subset"], 0.5)


def test_without_the_toolbox_it_is_said_how_to_get_it(
    monkeypatch: pytest.MonkeyPatch, order: Order
) -> None:
    monkeypatch.setattr(toolbox, "PROGRAM", "no-such-program")
    with pytest.raises(UserError, match=r"pip install -e '\.\[fetch\]'"):
        parts.retry(lambda: toolbox.ship(order), lambda line: None)
