"""What must change no bit of the particle filter: threads, outputs, and sorties that do nothing."""

import dataclasses
import hashlib
import itertools

import numpy as np
import pytest
from filtered import FLOW, METRES, flown, hours, legs, load, run

from drift.engine.motion.models.drift import COLUMNS
from drift.engine.particles import ensemble as record
from drift.evidence.filter.detection import sensor_path
from drift.evidence.filter.records import (
    Barrier,
    Field,
    Law,
    Line,
    Look,
    Presence,
    Resampling,
    Sensors,
    Sight,
)
from geo import sphere
from kernels.evidence import sweep
from kernels.runtime import runtime
from kernels.steering import pieces


def test_a_sortie_that_does_nothing_changes_no_bit(tmp_path):
    """With a sortie far away, or of sweep width 0, every column is the same to the bit."""
    text = FLOW.replace("[[scenario]]", '[uncertainty]\ndiffusivity = "20 m2/s"\n[[scenario]]')
    far = legs([(300_000, 0), (310_000, 0)], 0.4, 20.0)
    blind = legs([(-9000, -3000), (8000, -2500)], 0.4, 20.0)
    _, bare, _ = run(load(tmp_path, text))
    for sortie in (
        flown("far", far, Law("definite_range"), 1000.0),
        flown("blind", blind, Law(), 0.0),
    ):
        _, ensemble, _ = run(load(tmp_path, text, sorties=(sortie,)))
        for name in ("lon", "lat", "log_weight", "status"):
            np.testing.assert_array_equal(
                bare.columns[name].to_numpy(), ensemble.columns[name].to_numpy()
            )


def of_every_kind(folder):
    """Return in words, to the bit, what sorties of every kind, a shared factor, sensors and
    resampling made of a case.
    """
    text = FLOW.replace("[[scenario]]", '[uncertainty]\ndiffusivity = "20 m2/s"\n[[scenario]]')
    track = legs([(-9000, -3000), (8000, -2500), (8200, 1500), (-8500, 2000)], 0.4, 20.0)
    laws = (Law(), Law("m_beta", 0.7))
    sorties = tuple(
        dataclasses.replace(flown(law.kind, track, law, 900.0), shape=5.0, group="g")
        for law in laws
    )
    field, ends = Field(180.02, 60.0, 0.0, 8000.0, 5000.0, 0.4), ((179.97, 59.9), (180.03, 60.1))
    sensors = Sensors(
        looks=(
            Look("look", hours(1.3), Field(179.98, 60.0, 4000.0), False, Sight("exponential", 2.0)),
        ),
        presences=(Presence("box", hours(0.4), hours(2.2), field, "never", 0.8),),
        barriers=(Barrier("barrier", hours(0.3), hours(2.7), ends, 0.6),),
        lines=(Line("line", ((180.04, 59.9), (180.05, 60.1))),),
    )
    drawn = Resampling("kahn", 0.99)
    case = load(folder, text, particles=5000, sorties=sorties, sensors=sensors, resampling=drawn)
    search, ensemble, _ = run(case)
    told = search.updates
    assert sorted(update.kind for update in told.all) == [
        "barrier",
        "look",
        "presence",
        "sortie",
        "sortie",
    ]
    columns = [ensemble.columns[name].to_numpy().tobytes() for name in ("lon", "lat", "log_weight")]
    digest = hashlib.sha256(b"".join([*columns, told.crossings.all[0].mass.tobytes()])).hexdigest()
    return f"{any(update.resampled for update in told.all[:-1])} {digest} {told.log_evidence.hex()}"


@pytest.mark.thorough
def test_the_same_bits_for_any_number_of_threads(one_thread, tmp_path):
    """A process of its own has one; this one has two."""
    script = """
import importlib.util, pathlib
of = importlib.util.spec_from_file_location("of_every_kind", given[0])
module = importlib.util.module_from_spec(of)
of.loader.exec_module(module)
answer = module.of_every_kind(pathlib.Path(given[1]))
"""
    one = one_thread.ask(script, __file__, str(tmp_path))
    assert one == of_every_kind(tmp_path)
    assert one.startswith("True")


def test_what_strands_or_goes_adrift_within_a_step_is_where_it_is():
    """A particle moves only from its release to its landing: the time in an area round the beach,
    in closed form.
    """
    runtime.start()
    ensemble = record.empty(1, (0, 2), COLUMNS)
    x = sphere.to_binary([-1000 / METRES, -1000 / METRES])
    before = runtime.upload(x), runtime.upload(np.zeros(2, np.int32))
    ensemble.status.from_numpy(np.array([1, 1], np.int32))
    ensemble.status_since.from_numpy(np.array([182, 2000], np.int32))
    ensemble.release.from_numpy(np.array([0, 1000], np.int32))
    still = sensor_path.path_of_fixed_sensor(0.0, 0.0, 0, 3600)
    ring = np.array([-100.0, -100.0, 100.0, -100.0, 100.0, 100.0, -100.0, 100.0])
    for cuts in ([0, 3600], [0, 100, 1950, 3600]):
        exposure = runtime.empty(2)
        afloat = runtime.empty(2)  # as a sensor has it that does not see the beach
        for begin, end in itertools.pairwise(cuts):
            track = still.between(begin, end, 0, None, (0.0, 0.0))
            after = ensemble.lon, ensemble.lat
            paths = pieces.straight(ensemble, ensemble.batch([0]), before, after, 0, 3600)
            args = (ensemble, paths, sweep.INSIDE, track, ring, np.ones(1))
            sweep.expose(*args, exposure)
            sweep.expose(*args, afloat, shore=False)
        # the last tenth of the way lies in the area, and all the time after it
        assert exposure.to_numpy() == pytest.approx(
            [3600 - 0.9 * 182, 3600 - 1000 - 0.9 * 1000], abs=0.1
        )
        assert afloat.to_numpy() == pytest.approx([0.1 * 182, 0.1 * 1000], abs=0.1)


def test_an_output_within_a_sortie_changes_no_bit(tmp_path):
    """Looking on does not cut a leg."""
    track = legs([(-9000, -3000), (8000, -2500), (8200, 1500), (-8500, 2000)], 0.4, 20.0)
    sorties = tuple(flown(law.kind, track, law, 900.0) for law in (Law(), Law("m_beta", 0.7)))
    case = load(tmp_path, FLOW, sorties=sorties)
    _, bare, _ = run(case)
    _, seen, moments = run(case, outputs=[1700, 2000, 3000, 3300, 10_800])
    np.testing.assert_array_equal(bare.log_weight.to_numpy(), seen.log_weight.to_numpy())
    totals = [np.exp(moment.log_weight.astype(np.float64)).sum() for moment in moments]
    assert all(later < earlier for earlier, later in itertools.pairwise(totals[:4]))
