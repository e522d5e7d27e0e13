"""Fits that keep their derivatives: as near the optimum as those that take them at each point, and asked far less."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from identification_toy import TRUTH, ToyEngine, fly

from enginediag_cli.identification import gauss_newton as steps
from enginediag_cli.identification.covariance import uncertainty
from enginediag_cli.identification.gauss_newton import Derivatives, derivative_modes, resume_equations, solve
from enginediag_cli.identification.problem import IdentificationSettings, build_problem


@dataclass(frozen=True)
class Counted(ToyEngine):
    """Counts how often derivatives are asked for."""

    taken: list[int] = field(default_factory=list)

    def predict(self, inputs, parameters=None, *, sensors=None, wrt=(), **options):
        if wrt:
            self.taken.append(len(next(iter(inputs.values()))))
        return super().predict(inputs, parameters, sensors=sensors, wrt=wrt, **options)


def problem_of(engine, n, **settings):
    recordings = [fly(ToyEngine(), np.random.default_rng(k), n, f"{k}", bias={"T45_K": 3.0 * k}) for k in range(2)]
    return build_problem(engine, recordings, IdentificationSettings(recording_bias_sigma={"T45_K": 3.0}, **settings))


@pytest.mark.parametrize("loss", ["soft_l1", "none"])
def test_a_fit_that_keeps_its_derivatives_ends_at_the_same_optimum_and_takes_fewer(loss):
    found = {}
    for way in (Derivatives.EACH, Derivatives.KEPT):
        engine = Counted()
        fit = solve(problem_of(engine, 400, loss=loss), tolerance=1e-3, derivatives=way)
        assert fit.converged, fit.reason
        found[way] = fit, len(engine.taken)
    (each, often), (kept, seldom) = found[Derivatives.EACH], found[Derivatives.KEPT]
    assert seldom < often
    error = np.sqrt(np.diag(uncertainty(problem_of(ToyEngine(), 400, loss=loss), each, np.zeros(4)).covariance))
    assert np.max(np.abs(kept.x - each.x) / error) < 5e-3


def test_a_fit_that_converged_ends_with_derivatives_of_its_own_place():
    fit = solve(problem_of(ToyEngine(), 400), derivatives=Derivatives.KEPT)
    assert fit.converged
    assert fit.equations.prediction.exact


def test_a_curved_valley_is_followed_by_corrected_steps(monkeypatch):
    """Fuel flow sees two efficiencies by their product alone: the more records, the steeper the sides of the valley in
    which the priors lead down."""
    names = ("hpc.efficiency", "hpt.efficiency")
    settings = IdentificationSettings(sensors=("Wf_kg_s",), parameters=names, prior_sigma=dict.fromkeys(names, 0.1))
    problem = build_problem(ToyEngine(), [fly(ToyEngine(), np.random.default_rng(0), 2000)], settings)
    product = TRUTH[names[0]] * TRUTH[names[1]]
    start = np.array([2.5, (product / 1.25 - 1) / 0.1]), np.zeros((1, 0))
    followed = solve(problem, start, derivatives=Derivatives.KEPT)
    monkeypatch.setattr(steps, "CORRECTIONS", 0)
    crept = solve(problem, start, derivatives=Derivatives.KEPT)
    assert followed.converged
    assert all(i.accepted for i in followed.iterations)
    assert 2 * len(followed.iterations) < len(crept.iterations)
    assert followed.x == pytest.approx(crept.x, abs=1e-3)


def test_records_that_fail_are_left_out_alike():
    engine = ToyEngine(fails=lambda u, p: u["N1_pct"] > 96)
    each, kept = (solve(problem_of(engine, 400), derivatives=d) for d in (Derivatives.EACH, Derivatives.KEPT))
    np.testing.assert_array_equal(each.failed, kept.failed)
    assert kept.x == pytest.approx(each.x, abs=1e-3)


def test_a_fit_goes_on_with_other_noise_where_another_one_ended():
    problem = problem_of(ToyEngine(), 400)
    fit = solve(problem, derivatives=Derivatives.KEPT)
    other = problem.replace_noise(1.3 * problem.sigma, problem.inflation)
    begin = resume_equations(other, (fit.x, fit.z), fit)
    again = solve(other, (fit.x, fit.z), derivatives=Derivatives.KEPT, equations=begin)
    alone = solve(other, derivatives=Derivatives.KEPT)
    assert again.converged
    assert again.x == pytest.approx(alone.x, abs=1e-3)
    assert resume_equations(other, (fit.x, fit.z), None) is None


def test_few_records_take_derivatives_at_each_point_and_very_many_too(monkeypatch):
    assert derivative_modes(problem_of(ToyEngine(), 50)) == (Derivatives.EACH, Derivatives.EACH)
    many = problem_of(ToyEngine(), 2000)
    assert derivative_modes(many) == (Derivatives.LENT, Derivatives.KEPT)
    monkeypatch.setattr(steps, "KEPT_NUMBERS", 1000)
    assert derivative_modes(many) == (Derivatives.EACH, Derivatives.EACH)


def test_a_sample_of_the_records_tells_what_the_fit_takes_out_of_the_noise():
    problem = problem_of(ToyEngine(), 6000)
    fit = solve(problem, derivatives=Derivatives.KEPT)
    whole, some = (uncertainty(problem, fit, np.full(4, 0.3), sampled=s) for s in (False, True))
    assert not np.array_equal(some.absorbed, whole.absorbed)
    np.testing.assert_allclose(
        some.absorbed / len(problem.recording), whole.absorbed / len(problem.recording), atol=1e-4
    )
    np.testing.assert_allclose(some.covariance, whole.covariance, rtol=0.2, atol=1e-3)
