"""What the search says of concealed effects, faults and nothing."""

import numpy as np
import pytest
from concealed import carried, evidence, flights, turbofan

from enginediag_cli.mismatch.explain.answer import FORMULA, IDENTIFIED, NO_DISCREPANCY, NOT_CONVERGED
from enginediag_cli.mismatch.explain.explain import Search, explain
from enginediag_cli.mismatch.fit.evidence import Flight
from enginediag_cli.physics.registry import candidate_effects


def _answer(*effects, seed=1, without=(), **settings):
    recorded = flights(carried(*effects), np.random.default_rng(seed))
    library = [e for e in candidate_effects(turbofan()) if e.term.NAME not in without]
    return explain(evidence(recorded, **settings), library)


@pytest.mark.slow
def test_a_concealed_reynolds_effect_is_named_with_its_coefficient():
    a = _answer(("reynolds_efficiency", "hpc", {"exponent": 0.1}))
    assert a.status == IDENTIFIED and a.explanations[0].label == "reynolds_efficiency@hpc"
    (c,) = a.explanations[0].coefficients
    assert c.low - 0.5 * c.standard_error < 0.1 < c.high + 0.5 * c.standard_error


def test_a_concealed_load_is_named_with_a_floor_for_map_errors_too():
    a = _answer(("power_offtake", "hp", {"fraction": 0.006}), map_accuracy=0.003)
    assert a.status == IDENTIFIED and a.explanations[0].label == "power_offtake@hp"
    assert a.explanations[0].flights >= 0.75


@pytest.mark.slow
def test_two_concealed_effects_are_named_together():
    a = _answer(("reynolds_efficiency", "hpc", {"exponent": 0.1}), ("power_offtake", "hp", {"fraction": 0.006}), seed=2)
    assert a.status == IDENTIFIED
    assert {o.label for o in a.explanations[0].options} == {"reynolds_efficiency@hpc", "power_offtake@hp"}


@pytest.mark.slow
def test_an_effect_that_the_library_lacks_is_a_law_at_its_place():
    a = _answer(
        ("active_clearance_control", "hpt", {"closing": 0.6}),
        seed=3,
        without=("active_clearance_control", "turbine_tip_clearance"),
    )
    assert a.status == FORMULA and {o.kind for o in a.explanations[0].options} == {"law"}
    assert {c.location.component for c in a.cells[:3]} & {"hpt"} and a.law.places[0][0].component == "hpt"


@pytest.mark.slow
def test_nothing_is_named_on_flights_of_the_model_itself():
    said = [_answer(seed=s).status for s in range(31, 37)]
    # at 5 % a search, two or more of six would happen once in 30
    assert said.count(NO_DISCREPANCY) >= 5 and NOT_CONVERGED not in said


def test_a_fault_that_begins_between_flights_is_called_a_fault():
    engine, rng = turbofan(), np.random.default_rng(4)
    recorded = list(flights([], rng, count=5))
    for k in (3, 4):
        c = dict(recorded[k].columns)
        worn = engine.predict({i: c[i] for i in engine.inputs}, {"hpc.efficiency": 0.99}).y
        healthy = engine.predict({i: c[i] for i in engine.inputs}).y
        for j, s in enumerate(engine.sensors):
            c[s] = c[s] + worn[:, j] - healthy[:, j]
        recorded[k] = Flight(recorded[k].label, "", c)
    a = explain(evidence(recorded))
    assert a.status == IDENTIFIED and a.kind == "fault"
    assert a.explanations[0].options[0].component == "hpc"
    assert "flight 4" in a.explanations[0].label


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.6, 1.7])
def test_a_wrong_noise_level_is_found_out_when_asked(factor):
    recorded = flights([], np.random.default_rng(8), noise=factor)
    search = Search(evidence(recorded, noise="estimate"))
    assert search.run().status == NO_DISCREPANCY
    stated = {c: s.noise_sigma for c, s in turbofan().sensors.items()}
    # 300 readings of a sensor: σ to 4 %; four deviations
    for c, sigma in search.evidence.noise.sigma.items():
        assert sigma == pytest.approx(factor * stated[c], rel=0.17)
