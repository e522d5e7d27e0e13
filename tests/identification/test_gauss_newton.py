"""The solver against scipy, at bounds, with failing records, and its honesty about not converging."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from identification_toy import PARAMETERS, TRUTH, ToyEngine, fly, health

from enginediag_cli.identification.gauss_newton import CREEPING, solve
from enginediag_cli.identification.normal_equations import predict
from enginediag_cli.identification.problem import LOSSES, IdentificationSettings, TrainingRecording, build_problem


def problem_of(engine, recordings, **settings):
    return build_problem(engine, recordings, IdentificationSettings(**settings))


@pytest.mark.parametrize("loss", LOSSES)
def test_the_optimum_is_that_of_a_general_minimiser(loss):
    """scipy.optimize.minimize on the same cost, offsets and priors written out by hand."""
    from scipy.optimize import minimize

    engine, rng = ToyEngine(), np.random.default_rng(4)
    recordings = [fly(engine, rng, 30, "a", bias={"T45_K": 4.0}), fly(engine, rng, 25, "b")]
    problem = problem_of(
        engine,
        recordings,
        loss=loss,
        recording_bias_sigma={"T45_K": 3.0},
        recording_scale_sigma={"Wf_kg_s": 0.02},
    )
    fit = solve(problem, tolerance=1e-7)
    assert fit.converged, fit.reason

    def cost(v):
        x, z = v[:5], v[5:].reshape(2, 2)
        e = (problem.measured - predict(problem, x, z)[0]) / problem.sigma
        return problem.loss.cost(e).sum() + 0.5 * v @ v

    best = minimize(cost, np.zeros(9), method="BFGS", options={"gtol": 1e-6})
    ours = np.r_[fit.x, fit.z.ravel()]
    assert cost(ours) <= best.fun + 1e-8
    assert ours == pytest.approx(best.x, abs=2e-3)


def test_a_parameter_beyond_its_bound_stops_there_and_is_reported():
    engine = ToyEngine(parameter_list=(health("hpc.efficiency", lower=0.99), *PARAMETERS[1:]))
    fit = solve(problem_of(engine, [fly(engine, np.random.default_rng(0))]))
    names = [p.name for p in engine.parameter_list]
    assert fit.converged, fit.reason
    assert fit.at_bound.tolist() == [n == "hpc.efficiency" for n in names]
    p = problem_of(engine, [fly(engine, np.random.default_rng(0))])
    assert p.to_physical(fit.x)["hpc.efficiency"] == 0.99


def test_the_other_parameters_are_optimal_given_one_at_its_bound():
    rng = np.random.default_rng(0)
    bounded = ToyEngine(parameter_list=(health("hpc.efficiency", lower=0.99), *PARAMETERS[1:]))
    recording = fly(bounded, rng)
    free = solve(problem_of(bounded, [recording]), tolerance=1e-6)
    fixed = ToyEngine(parameter_list=(replace(PARAMETERS[0], nominal=0.99), *PARAMETERS[1:]))
    conditional = solve(problem_of(fixed, [recording], fixed=("hpc.efficiency",)), tolerance=1e-6)
    assert free.x[1:] == pytest.approx(conditional.x, abs=1e-5)


def test_records_that_fail_are_left_out_and_counted_in_every_iteration():
    rng = np.random.default_rng(2)
    recording = fly(ToyEngine(), rng)
    always = ToyEngine(fails=lambda u, p: u["N1_pct"] > 96)
    expected = int(np.sum(recording.columns["N1_pct"] > 96))
    fit = solve(problem_of(always, [recording]))
    assert fit.converged
    assert fit.failed.sum() == expected > 10
    assert {i.failed for i in fit.iterations} == {expected}
    columns = {c: v[recording.columns["N1_pct"] <= 96] for c, v in recording.columns.items()}
    alone = solve(problem_of(ToyEngine(), [TrainingRecording("without", columns)]))
    assert fit.x == pytest.approx(alone.x, abs=1e-9)


def test_a_step_that_loses_records_is_not_taken_for_a_better_fit():
    """Half the records fail beyond a wall in efficiency, where the misfit of the rest would look lower."""
    wall = ToyEngine(fails=lambda u, p: (u["N1_pct"] > 80) & (p["hpc.efficiency"] < 0.97))
    truth = TRUTH | {"hpc.efficiency": 0.94}
    recording = fly(ToyEngine(), np.random.default_rng(3), truth=truth)
    problem = problem_of(wall, [recording])
    fit = solve(problem)
    assert not fit.converged
    # nor does the search creep along the wall
    assert fit.iterations[-1].boldness < CREEPING and len(fit.iterations) < 30 and "in a row" in fit.reason
    assert "lost" in fit.reason
    assert not fit.failed.any()
    assert problem.to_physical(fit.x)["hpc.efficiency"] >= 0.97


def test_too_few_iterations_are_reported_as_no_convergence():
    engine = ToyEngine()
    fit = solve(problem_of(engine, [fly(engine, np.random.default_rng(1))]), max_iterations=1, tolerance=1e-9)
    assert not fit.converged
    assert "after 1 iterations" in fit.reason


def test_an_engine_without_any_converged_record_is_reported():
    broken = ToyEngine(fails=lambda u, p: np.ones(len(u["N1_pct"]), bool))
    fit = solve(problem_of(broken, [fly(ToyEngine(), np.random.default_rng(1))]))
    assert not fit.converged
    assert fit.reason == "no record converged at the starting point"


def test_the_cost_never_rises_over_accepted_steps():
    engine = ToyEngine()
    fit = solve(problem_of(engine, [fly(engine, np.random.default_rng(8))]))
    costs = [i.cost for i in fit.iterations]
    assert all(b <= a * (1 + 1e-9) for a, b in pairwise(costs))


def test_a_search_that_cannot_come_within_reach_is_given_up_and_one_that_can_is_not():
    engine = ToyEngine()
    problem = problem_of(engine, [fly(engine, np.random.default_rng(1))])
    whole = solve(problem, max_iterations=60, tolerance=1e-12)
    reached = 2.0 * whole.iterations[-1].cost
    assert len(solve(problem, max_iterations=60, tolerance=1e-12, hopeless=reached + 1.0).iterations) == len(
        whole.iterations
    )
    given_up = solve(problem, max_iterations=60, tolerance=0.0, hopeless=0.5 * reached)
    assert not given_up.converged
    assert len(given_up.iterations) < 10
