"""The envelope of operating points."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.identification.nominal import MAX_POINTS, learn_envelope


def flight(n=600, seed=0):
    """Climb, cruise and descent: power goes with altitude except in descent."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 1, n)
    altitude = np.interp(t, [0, 0.3, 0.7, 1], [0, 10000, 10000, 500]) + rng.normal(0, 50, n)
    n1 = np.interp(t, [0, 0.3, 0.31, 0.7, 0.71, 1], [97, 95, 85, 85, 60, 55]) + rng.normal(0, 0.5, n)
    return {"altitude_m": altitude, "N1_pct": n1}


def test_every_training_point_is_inside():
    u = flight()
    assert not learn_envelope(u).outside(u).any()


def test_another_flight_of_the_same_kind_is_inside():
    assert learn_envelope(flight()).outside(flight(seed=1)).mean() < 0.01


def test_points_beyond_the_range_are_outside_and_the_reason_names_the_input():
    e = learn_envelope(flight())
    u = {"altitude_m": np.array([10000.0, 14500.0, 10000.0]), "N1_pct": np.array([85.0, 85.0, 20.0])}
    assert e.outside(u).tolist() == [False, True, True]
    assert e.reason(u, 0) == ""
    assert e.reason(u, 1).startswith("altitude_m 1.45e+04 is above what was seen")
    assert e.reason(u, 2).startswith("N1_pct 20 is below what was seen")


def test_a_combination_never_seen_is_outside_although_each_input_was():
    """Full power at the end of the descent, or idle at 5 km in the climb, are inside the ranges of a box."""
    e = learn_envelope({k: v[:250] for k, v in flight().items()})
    u = {"altitude_m": np.array([200.0]), "N1_pct": np.array([85.0])}
    assert e.outside(u)[0]
    assert "no record seen is near this combination" in e.reason(u, 0)


def test_a_missing_input_counts_as_outside():
    e = learn_envelope(flight())
    u = {"altitude_m": np.array([np.nan]), "N1_pct": np.array([85.0])}
    assert e.outside(u)[0]
    assert e.reason(u, 0) == "altitude_m is missing"


def test_errors_that_widen_reach_one_spread_beyond_what_training_hardly_ranged_over():
    n = 200
    flown = learn_envelope({"dT_isa_K": np.linspace(-2.0, 2.0, n), "Wf_kg_s": np.linspace(0.5, 2.0, n)})
    asked = {"dT_isa_K": np.array([11.9, 12.1, 0.0, 0.0]), "Wf_kg_s": np.array([1.0, 1.0, 2.7, 2.8])}
    assert flown.reachable(asked, flown.distance(asked)).tolist() == [True, False, True, False]


def test_the_cover_is_compact_and_any_number_of_records_can_be_asked():
    e = learn_envelope(flight(20000))
    assert len(e.points) <= MAX_POINTS
    assert e.outside(flight(5000, seed=2)).shape == (5000,)


def test_units_of_the_inputs_do_not_matter_once_they_spread():
    u = flight()
    a = learn_envelope(u)
    b = learn_envelope({"altitude_km": u["altitude_m"] / 1000, "N1_pct": u["N1_pct"]})
    assert b.threshold == pytest.approx(a.threshold)
