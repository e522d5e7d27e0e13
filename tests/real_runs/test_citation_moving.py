"""Recordings of the Citation in transients, where they lie beside the checkout: inertias and lags found on half a
flight of one engine, on flights and an engine that they were not fitted to."""

from __future__ import annotations

import numpy as np
import pytest
from citation_mismatch import B22, REF
from citation_moving import CLOCKS, INERTIA, PROBE, fit, judged, run_of
from ground_recordings import public_data

pytestmark = [pytest.mark.shared_data, pytest.mark.slow]


def test_inertias_and_lags_of_half_a_flight_hold_on_the_other_half_and_on_the_other_engine(tmp_path):
    flights = public_data("c550_jt15d")
    left = run_of(flights, REF, "left", tmp_path)
    first = left.time < np.median(left.time)
    fitted = fit(left, INERTIA + PROBE + CLOCKS, first & left.air)
    assert 0.02 < fitted.values["rotor_inertia.hp.inertia"] < 0.3
    assert 0.1 < fitted.values["rotor_inertia.lp.inertia"] < 1.0
    half = judged(left, fitted, ~first)["moving"]["after"]
    assert half["Wf_pct"] <= 4.0 and half["ITT_K"] <= 12.0
    for side, name, gain in (("right", REF, 0.6), ("left", B22, 0.55), ("right", B22, 0.6)):
        run = run_of(flights, name, side, tmp_path)
        found = judged(run, fitted, np.ones(len(run.time), bool))
        moving, steady = found["moving"], found["steady"]
        assert moving["after"]["without_prediction"] == 0
        assert moving["after"]["Wf_pct"] < gain * moving["before"]["Wf_pct"]
        assert moving["after"]["ITT_K"] < moving["before"]["ITT_K"]
        # not as good as the steady model where nothing moves: the soak terms were fitted to transients
        assert steady["after"]["Wf_pct"] < steady["before"]["Wf_pct"] + 0.4
        assert steady["after"]["ITT_K"] < steady["before"]["ITT_K"] + 0.7
