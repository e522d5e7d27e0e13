"""Faults of a catalogue as directional hypotheses next to free sets."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from score_makers import linear_score, sensitivities

from enginediag_cli.errors import DataError
from enginediag_cli.faults.catalogue import ComponentFault, FaultSet, SensorFault
from enginediag_cli.isolation.catalogue import _fault_moments, isolate_named, named_faults

FOULING = ComponentFault("fouling", {"p0": -0.02, "p1": -0.01})
EROSION = ComponentFault("erosion", {"p2": 0.01, "p3": -0.01})
CATALOGUE = FaultSet((FOULING, EROSION))


def score_of(seed, change):
    rng = np.random.default_rng(seed)
    return linear_score(rng, sensitivities(rng), change)


def test_a_fault_of_the_catalogue_is_named_with_its_severity():
    found = isolate_named(score_of(1, [-0.018, -0.009, 0, 0, 0, 0]), CATALOGUE)
    assert found.faults == ("fouling",) and found.probability > 0.7
    (severity,) = found.severities
    assert severity.lower < 0.9 < severity.upper
    assert found.probability + sum(r.probability for r in found.alternatives) >= 0.95


def test_two_faults_together_are_both_named():
    assert set(isolate_named(score_of(2, [-0.02, -0.01, 0.01, -0.01, 0, 0]), CATALOGUE).faults) == {
        "fouling",
        "erosion",
    }


def test_a_change_opposite_to_every_fault_or_elsewhere_is_called_unlisted():
    for change in ([0.02, 0.01, 0, 0, 0, 0], [0, 0, 0, 0, -0.02, 0]):
        found = isolate_named(score_of(3, change), CATALOGUE)
        assert found.faults == () and found.unlisted > 0.9
        assert found.free == tuple(f"p{i}" for i in np.flatnonzero(change))


def test_a_healthy_engine_has_no_named_fault():
    found = isolate_named(score_of(4, np.zeros(6)), CATALOGUE)
    assert found.faults == () and found.free == () and found.probability > 0.5


def test_a_ratio_within_the_cone_keeps_the_name():
    found = isolate_named(score_of(5, [-0.02, -0.014, 0, 0, 0, 0]), CATALOGUE)
    assert found.faults == ("fouling",)


def test_the_marginal_likelihood_is_the_integral_over_positive_severities():
    score = score_of(6, [-0.0004, -0.0002, 0, 0, 0, 0])
    (fault, _), _ = named_faults(CATALOGUE, score.parameters, score.theta0, ratio_spread=1)
    beta, kappa = float(fault.own @ score.b), float(fault.own @ score.information @ fault.own)

    def density(a):
        return 2 * np.exp(beta * a - 0.5 * kappa * a**2 - 0.5 * a**2) / np.sqrt(2 * np.pi)

    exact = quad(density, 0, 5, points=[max(beta / kappa, 0.01)])[0]
    log, shares, _, _ = _fault_moments(score, [fault], (1.0,))
    assert log == pytest.approx(np.log(exact), abs=1e-3) and shares.sum() == pytest.approx(1)


def test_directions_are_relative_to_nominal_and_their_ratios_stay_within_the_spread():
    faults, _ = named_faults(CATALOGUE, ("p0", "p1", "p2", "p3"), np.array([2.0, 1, 1, 1]), ratio_spread=1.5)
    assert faults[0].own == pytest.approx([-0.04, -0.01, 0, 0])
    ratio = faults[0].generators[:, 0] / faults[0].generators[:, 1]
    assert ratio.min() == pytest.approx(4 / 1.5) and ratio.max() == pytest.approx(4 * 1.5)


def test_sensor_faults_go_either_way_and_what_cannot_be_seen_is_listed_with_the_reason():
    sensors = (
        SensorFault("T3_bias", "T3_K", {"type": "bias", "size": 6.0}),
        SensorFault("Wf_scale", "Wf_kg_s", {"type": "scale", "change": 0.01}),
        SensorFault("T45_stuck", "T45_K", {"type": "stuck", "value": None}),
    )
    faults, untestable = named_faults(FaultSet((FOULING,), sensors), ("p0", "sensor.T3.bias"), np.array([1.0, 0]))
    assert [(f.name, f.one_sided, f.own.tolist()) for f in faults] == [("T3_bias", False, [0, 6.0])]
    assert set(untestable) == {"fouling", "Wf_scale", "T45_stuck"} and "p1" in untestable["fouling"]


def test_a_catalogue_of_which_nothing_can_be_seen_is_refused():
    with pytest.raises(DataError, match="q9 not monitored"):
        isolate_named(score_of(7, np.zeros(6)), FaultSet((ComponentFault("x", {"q9": 0.1}),)))
