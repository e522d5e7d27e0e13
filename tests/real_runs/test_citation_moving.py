"""Recordings of the Citation in transients, where they lie beside the checkout: one engine identified with every record
of one flight, on a flight and an engine that it was not fitted to."""

from __future__ import annotations

import pytest
from citation_moving import story
from ground_recordings import public_data

pytestmark = [pytest.mark.shared_data, pytest.mark.slow]


def test_an_engine_identified_with_idle_and_transients_holds_in_another_flight_and_for_another_engine(tmp_path):
    told = story(public_data("c550_jt15d"), tmp_path)
    found = {n: v for n, (v, _) in told["coefficients"].items()}
    assert 0.05 < found["rotor_inertia.hp.inertia"] < 0.3
    assert 0.1 < found["rotor_inertia.lp.inertia"] < 1.0
    assert 0.5 < found["probe_lag.ITT.time_constant"] < 6.0
    for where in ("left, flight_b22", "right, flight_ref", "right, flight_b22"):
        kinds = told["rms"][where]
        moving, steady, ground = kinds["moving"], kinds["steady"], kinds["moving_with_ground"]
        assert moving["after"]["without_prediction"] == 0
        assert moving["after"]["Wf_pct"] <= 4.0 and moving["after"]["ITT_K"] <= 12.0
        assert moving["after"]["Wf_pct"] < 0.4 * moving["before"]["Wf_pct"]
        # idle on the ground was among what trained
        assert ground["after"]["Wf_pct"] <= 4.0 and ground["after"]["ITT_K"] < 0.5 * ground["before"]["ITT_K"]
        # not as good as a steady model of its own where nothing moves
        assert steady["after"]["Wf_pct"] < steady["before"]["Wf_pct"] + 0.3
        assert steady["after"]["ITT_K"] < steady["before"]["ITT_K"] + 0.8
