"""Where particles are guided toward finds of debris, in shards and with resampling too; what the
case file rejects.
"""

from dataclasses import replace

import numpy as np
import pytest
from guided_case import ERROR, begun, find_text, loaded, run_of, text_of

import drift
from drift.evidence.filter.debris import pilot


@pytest.mark.thorough
def test_guided_only_where_it_helps_and_is_asked_for(tmp_path):
    """A wide find, one with guide = false, and a case without debris leave particles as their
    streams draw them.
    """
    errors = (0.3, 0.0, 0.0, 300.0)
    bare = text_of(2000, *errors)

    def drawn(text):
        _, begin = begun(tmp_path, text)
        begin.scene.forcing.close()
        return begin

    plain = drawn(bare)
    wide = drawn(bare + find_text("oar", 9000.0, 5000.0).replace(f"{ERROR} m", "9 km"))
    asked = drawn(bare + find_text("oar", 9000.0, 5000.0, more="guide = false\n"))
    guided = drawn(bare + find_text("oar", 9000.0, 5000.0))
    assert (plain.guide, wide.guide, asked.guide) == (None, None, None)
    assert guided.guide is not None
    for one in (wide, asked):
        assert one.ensemble.columns.keys() == plain.ensemble.columns.keys()
        for name, column in plain.ensemble.columns.items():
            np.testing.assert_array_equal(one.ensemble.columns[name].to_numpy(), column.to_numpy())
    weight = np.exp(guided.ensemble.log_weight.to_numpy().astype(float))
    assert weight[:1400].sum() == pytest.approx(0.7, rel=1e-5)  # a scenario keeps its share
    assert weight.max() < 1.05 / 0.3 / 2000
    assert 1 / (weight**2).sum() > 0.25 * 2000


@pytest.mark.thorough
def test_a_scenario_that_is_under_way_is_not_guided(tmp_path):
    """Debris of what steers begins where it goes adrift: there particles stay as they are, beside
    guided ones.
    """
    text = text_of(2000, 0.3, 0.0, 0.0, 300.0).replace("weight = 0.3", "weight = 0.2") + """
[[scenario]]
name = "ferry"
weight = 0.1
object = { windage = "3 %" }
[[scenario.phase]]
[scenario.phase.voyage]
waypoints = [[0.0, 0.0], [0.3, 0.1]]
departure = ["+0 h", "+1 h"]
speed = { low = "4 kn", best = "5 kn", high = "6 kn", ratio = 4 }
[scenario.distress]
between = ["+1 h", "+3 h"]
"""  # fmt: skip
    text += find_text("oar", 9000.0, 5000.0, more="belief = 0.9\n")
    _, begin = begun(tmp_path, text)
    begin.scene.forcing.close()
    assert begin.guide is not None
    assert [fit is not None for fit in begin.guide.passes[0]] == [True, True, False]
    first, last = begin.ensemble.scenarios[2]
    np.testing.assert_array_equal(
        begin.ensemble.log_weight.to_numpy()[first:last], np.float32(np.log(0.1 / 200))
    )
    assert not begin.ensemble.own["pull_0_east"].to_numpy()[first:last].any()
    *_, updates, guide = run_of(tmp_path, text)
    assert guide is not None
    assert updates.all[0].ess_after > 100


@pytest.mark.thorough
def test_shards_and_resampling(tmp_path):
    """Shards guide particles to the same bits; resampling waits for the find, and comes then."""
    text = text_of(12_000, 0.3, 0.0, 0.0, 300.0).replace("12 h", "14 h") + find_text(
        "oar", 9000.0, 5000.0, 11
    )
    text += (
        '[[sortie]]\nname = "early"\nstart = "+1 h"\nend = "+2 h"\nlaw = "random"\npod = 0.999\n'
    )
    text += "area = { polygon = [[-0.05, -0.05], [0.04, -0.05], [0.04, 0.05], [-0.05, 0.05]] }\n"
    text += "[resampling]\nbelow = 0.9\n"
    case = loaded(tmp_path, text)
    whole, parts = (drift.run(case, shards=many) for many in (1, 3))
    early, oar = whole.updates.all
    assert not early.resampled
    assert oar.resampled
    for one, other in zip(whole.updates.all, parts.updates.all, strict=True):
        assert one.ess_after == other.ess_after
        np.testing.assert_array_equal(one.log_evidence, other.log_evidence)
    np.testing.assert_array_equal(whole.probability.values, parts.probability.values)


@pytest.mark.thorough
def test_only_positions_of_debris_have_guide(tmp_path):
    """The key is rejected where it does nothing, and a warning of few particles names the find's
    error and the key.
    """
    bare = text_of(1000, 0.3, 0.0, 0.0, 300.0)
    own = find_text("oar", 9000.0, 5000.0, more="guide = false\n")
    with pytest.raises(drift.UserError, match="guide applies only to a position of debris"):
        loaded(tmp_path, bare + own.replace('of = { windage = "4 %" }\n', ""))
    case = loaded(tmp_path, bare + own)
    warning = drift.run(case).summary["warnings"][0]
    assert (
        "Check its position, time, error (0.13 nmi, which holds half of it) and class (of) first"
        in warning
    )
    assert "remove its guide = false" in warning
    contact = replace(case.contacts[0], guide=True)
    followed = drift.run(replace(case, contacts=(contact,)))  # the remedy works
    assert followed.summary["guide"] == {"finds": ["oar"], "prior_share": 0.3}
    assert followed.updates.all[0].ess_after > 200
    assert pilot.WORTHWHILE < 0.3
