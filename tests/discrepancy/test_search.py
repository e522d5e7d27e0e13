"""The search on readings with known truth, through the answer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import RECORDS, problem

from enginediag_cli.discrepancy.answer import DiscrepancyAnswer, answer_from_search
from enginediag_cli.discrepancy.candidates import CURVE, PER_RECORD, STEP, SWITCH
from enginediag_cli.discrepancy.linearised import LinearProblem, pool_records
from enginediag_cli.discrepancy.search import BeamSearch

NUMBER = np.arange(RECORDS)
STATES = (((NUMBER > 10) & (NUMBER < 25)) | ((NUMBER > 45) & (NUMBER < 60))).astype(float)


def answered(p: LinearProblem) -> DiscrepancyAnswer:
    search = BeamSearch(p)
    return answer_from_search(search.run(), search.problem)


@pytest.fixture(scope="module")
def switched() -> DiscrepancyAnswer:
    return answered(problem(1, amplitude=3.0 * STATES))


def test_nothing_is_found_in_noise() -> None:
    for seed in (11, 12):
        a = answered(problem(seed))
        assert not a.found
        assert a.posterior.nothing > 0.5


def test_a_switch_is_found_at_its_place_with_its_size_and_times(switched: DiscrepancyAnswer) -> None:
    (m,) = switched.members
    assert switched.found
    assert (m.place, m.kind) == ("a", SWITCH)
    assert m.size == pytest.approx(3.0, abs=3 * m.standard_deviation + 0.1)
    found, truth = np.array(m.on_s), 20.0 * np.array([[11, 24], [46, 59]])
    assert np.abs(found - truth).max() <= 40.0


def test_a_larger_effect_is_never_less_probable(switched: DiscrepancyAnswer) -> None:
    small = answered(problem(1, amplitude=1.5 * STATES))
    assert switched.evidence > small.evidence


def test_values_at_random_are_not_recorded_and_a_curve_is_along_its_driver() -> None:
    drawn = answered(problem(2, amplitude=3.0 * np.random.default_rng(5).standard_normal(RECORDS)))
    assert (drawn.members[0].place, drawn.members[0].kind) == ("a", PER_RECORD)
    p = problem(3)
    mach = p.drivers[1].values
    curve = answered(problem(3, amplitude=2.5 * (mach - mach.mean())))
    assert (curve.members[0].place, curve.members[0].kind) == ("a", CURVE)
    assert curve.members[0].driver == "Mach number"
    assert curve.posterior.drivers["Mach number"] > 0.9


def test_a_step_along_a_driver_is_found_with_its_value() -> None:
    p = problem(6)
    mach = p.drivers[1].values
    a = answered(problem(6, amplitude=np.where(mach < -0.2, 3.0, 0.0)))
    (m,) = a.members
    assert (m.place, m.kind, m.driver) == ("a", STEP, "Mach number")
    assert m.threshold == pytest.approx(-0.2, abs=0.2)
    assert m.size == pytest.approx(3.0, abs=0.6)


def test_a_curve_of_a_map_is_a_map_error_beyond_what_is_stated() -> None:
    p = problem(7)
    mach = p.drivers[1].values
    y = p.y + p.G[:, :, 1] * (4.0 * (mach - mach.mean()))[:, None]
    a = answered(replace(p, y=y))
    assert a.members[0].place == "b"
    assert a.members[0].times_stated > 1.0
    assert "times what is stated" in a.summary()


def test_what_is_smaller_than_the_models_own_error_counts_as_nothing_missing() -> None:
    p = problem(3)
    mach = p.drivers[1].values
    curved = problem(3, amplitude=5.0 * (mach - mach.mean()))
    a = answered(replace(curved, expected=np.full(len(curved.sensors), 100.0)))
    assert not a.found and a.evidence > 5.0
    assert a.posterior.nothing > 0.99


def test_probabilities_are_of_everything_that_was_compared(switched: DiscrepancyAnswer) -> None:
    p = switched.posterior
    assert 0.0 <= p.nothing < 0.01
    assert max(p.places.values()) == pytest.approx(p.places["a"])
    assert any(row.refined for row in switched.trace)
    assert switched.to_dict()["members"][0]["place"] == "a"
    assert "two states" in switched.summary()
    assert "not compared" in switched.why_not("nozzle")
    assert "0.0 behind the likeliest" in switched.why_not("a: two states")


def test_pooled_records_are_means_of_neighbours() -> None:
    p = problem(4)
    half = pool_records(p, RECORDS // 2)
    assert len(half) == RECORDS // 2
    assert half.y[3] == pytest.approx(p.y[6:8].mean(axis=0))
    assert half.G[3] == pytest.approx(p.G[6:8].mean(axis=0))
    assert list(half.count) == [2.0] * (RECORDS // 2)
