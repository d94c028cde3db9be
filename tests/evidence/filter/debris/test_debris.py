"""Debris beside an object that moves by another model."""

from dataclasses import replace
from pathlib import Path

import pytest
import trial_case

from drift.engine.motion.forcing import Forcing, Sources
from drift.engine.motion.models.by_name import MODELS
from drift.engine.motion.models.drift import COLUMNS, DRIFT
from drift.engine.motion.scene import Scene
from drift.engine.particles import ensemble as record
from drift.evidence.filter.debris import debris
from drift.pipeline import run_setup
from geo.forcing import sources
from kernels.step import advance as kernel


def test_debris_drifts_however_its_object_moves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(
        MODELS, "steaming", replace(DRIFT, forced=False, columns=(), draw=lambda *given: None)
    )
    seen = {
        "time": "+3 h",
        "of": "water",
        "position": {"at": "27 30N 088 00W", "error": "1 nmi"},
    }
    spec = run_setup.ensemble_spec(case := trial_case.load(tmp_path, contact=[seen]))
    spec = replace(
        spec, scenarios=tuple(replace(s, model="steaming", motion=8.0) for s in spec.scenarios)
    )
    forcing = Forcing([Sources({"current": (sources.constant_field("current", 1.0, 0.0),)})], 1)
    scene = Scene(
        forcing, (), kernel.Surroundings(kernel.Domain(-(2**31), -(2**30), 2**32 - 1, 2**31))
    )
    times = (3 * 3600, 5 * 3600, 2 * 3600)  # contacts of one class, in any order
    (only,) = debris.of_contacts(
        spec, [(time, case.contacts[0]) for time in times], scene, record.empty(1, (0, 1))
    ).values()
    forcing.close()
    assert only.last == 5 * 3600
    assert [motion.model for motion in only.scene.motions] == [DRIFT]
    assert set(only.ensemble.own) == {column.name for column in COLUMNS}
