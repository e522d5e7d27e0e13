"""What an identification gives up before it ends without an answer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.identification import passes as attempts
from enginediag_cli.identification.normal_equations import blocks
from enginediag_cli.identification.passes import (
    Passes,
    Simplification,
    best_attempt,
    consider_map_errors,
    drop_map_shapes,
    operating_points,
)
from enginediag_cli.identification.passes import fit_and_noise as fit_anew
from enginediag_cli.identification.problem import (
    IdentificationProblem,
    IdentificationSettings,
    TrainingRecording,
    build_problem,
)
from enginediag_cli.physics.engine_file import load_engine

CONFIGS = Path(__file__).parents[2] / "configs"
SETTINGS = IdentificationSettings(parameters=("hpc.efficiency", "hpc.flow_capacity", "hpc.map.*"))


FITS: dict[tuple[object, ...], Passes] = {}


def fit_and_noise(problem: IdentificationProblem, settings: IdentificationSettings, accuracy: float) -> Passes:
    """The fit of a problem of this engine, made once: the tests differ in what is said of it."""
    numbers = (problem.measured, problem.sigma, problem.prior_mean, problem.prior_sigma, problem.lower, problem.upper)
    key = (problem.names, *(x.tobytes() for x in numbers), repr(settings), accuracy)
    if key not in FITS:
        FITS[key] = fit_anew(problem, settings, accuracy)
    return FITS[key]


@pytest.fixture(scope="module")
def engine():
    return load_engine(CONFIGS / "turbofan.yaml")


def problem_of(engine, points, n=8, seed=0):
    """n records of the engine at each of so many power settings."""
    rng = np.random.default_rng(seed)
    envelope = engine.envelope
    columns = {c: np.full(points * n, (envelope[c][0] + envelope[c][1]) / 2) for c in engine.inputs}
    low, high = envelope[engine.power_setting]
    columns[engine.power_setting] = np.repeat(np.linspace(low + 0.4 * (high - low), high, points), n)
    p = engine.predict(columns, {"hpc.efficiency": 0.99})
    sigma = np.array([s.noise_sigma for s in engine.sensors.values()])
    y = p.y + sigma * rng.standard_normal(p.y.shape)
    recording = TrainingRecording("a", {**columns, **dict(zip(engine.sensors, y.T, strict=True))})
    return build_problem(engine, [recording], SETTINGS)


def test_operating_points_are_counted_as_the_readings_tell_them_apart(engine):
    assert operating_points(problem_of(engine, 1)) == 1
    assert operating_points(problem_of(engine, 3)) == 3


def test_shapes_are_left_as_the_engine_file_states_them_but_not_those_with_a_mean_of_their_own(engine):
    problem = problem_of(engine, 3)
    assert drop_map_shapes(problem).names == ("hpc.efficiency", "hpc.flow_capacity")
    mean = problem.prior_mean.copy()
    own = problem.names.index("hpc.map.work_slope")
    mean[own] *= 1.1
    assert drop_map_shapes(replace(problem, prior_mean=mean)).names == (
        "hpc.efficiency",
        "hpc.flow_capacity",
        "hpc.map.work_slope",
    )


@pytest.mark.parametrize(
    ("accuracy", "fails", "given_up", "shapes"),
    [
        (0.003, 0, (), True),
        (0.003, 1, (Simplification.SHAPES,), False),
        (0.01, 0, (Simplification.SHAPES_AT_FEW_POINTS,), False),
        (0.003, 2, (Simplification.SIZES,), True),
        (0.01, 1, (Simplification.SIZES,), True),
    ],
)
def test_shapes_go_first_and_then_the_sizes(engine, monkeypatch, accuracy, fails, given_up, shapes):
    tried = []

    def fit(problem, settings, stated):
        tried.append(problem)
        found = fit_and_noise(problem, settings, stated)
        return replace(found, noise_converged=len(tried) > fails)

    monkeypatch.setattr(attempts, "fit_and_noise", fit)
    found = best_attempt(problem_of(engine, 3), SETTINGS, accuracy)
    assert found.passes.converged and found.simplifications == given_up and len(tried) == fails + 1
    assert ("hpc.map.work_slope" in found.passes.problem.names) == shapes
    assert any(name.startswith("map_error.") for name in found.passes.problem.names)


def with_bounds(monkeypatch, names, attempts_at_bound):
    """The first so many attempts end with parameters of these names at a bound; the problems of all of them."""
    tried = []

    def fit(problem, settings, stated):
        tried.append(problem)
        found = fit_and_noise(problem, settings, stated)
        at = np.array([n in names for n in problem.names]) & (len(tried) <= attempts_at_bound)
        return replace(found, fit=replace(found.fit, at_bound=at))

    monkeypatch.setattr(attempts, "fit_and_noise", fit)
    return tried


def test_shapes_are_given_up_where_one_runs_to_a_bound(engine, monkeypatch):
    tried = with_bounds(monkeypatch, ["hpc.map.work_slope"], 1)
    found = best_attempt(problem_of(engine, 3), SETTINGS, 0.003)
    assert found.simplifications == (Simplification.SHAPES_AT_BOUND,) and len(tried) == 2
    assert "hpc.map.work_slope" not in found.passes.problem.names


def test_a_health_parameter_at_a_bound_is_no_matter_of_shapes(engine, monkeypatch):
    tried = with_bounds(monkeypatch, ["hpc.efficiency"], 9)
    found = best_attempt(problem_of(engine, 3), SETTINGS, 0.003)
    assert not found.simplifications and len(tried) == 1
    assert found.passes.fit.at_bound.any()


def test_where_nothing_converges_the_first_attempt_is_told(engine, monkeypatch):
    monkeypatch.setattr(
        attempts, "fit_and_noise", lambda *arguments: replace(fit_and_noise(*arguments), noise_converged=False)
    )
    found = best_attempt(problem_of(engine, 3), SETTINGS, 0.003)
    assert not found.passes.converged and not found.simplifications


def test_all_attempts_share_the_steps_that_are_allowed(engine, monkeypatch):
    allowed, taken = replace(SETTINGS, max_iterations=12), []

    def fit(problem, settings, stated):
        taken.append(fit_and_noise(problem, settings, stated).steps)
        return replace(fit_and_noise(problem, settings, stated), noise_converged=False)

    monkeypatch.setattr(attempts, "fit_and_noise", fit)
    found = best_attempt(problem_of(engine, 3), allowed, 0.003)
    assert not found.passes.converged and 0 < sum(taken) <= 12


def test_passes_end_without_an_answer_when_the_steps_are_used_up(engine):
    found = fit_and_noise(problem_of(engine, 3), replace(SETTINGS, max_iterations=1), 0.0)
    assert found.steps == 1 and not found.converged


def test_amounts_that_are_not_sought_keep_their_uncertainty_and_pass_it_on(engine):
    problem = problem_of(engine, 3)
    plain = fit_and_noise(problem, SETTINGS, 0.0)
    found = consider_map_errors(plain, 0.003)
    p = len(problem.parameters)
    covariance = found.uncertainty.covariance
    np.testing.assert_array_equal(found.fit.x[p:], 0.0)
    np.testing.assert_allclose(covariance[p:, p:], np.eye(len(covariance) - p))
    assert np.all(np.diag(covariance)[:p] >= np.diag(plain.uncertainty.covariance))
    assert np.min(np.linalg.eigvalsh(covariance)) > 0
    # a reading at the points of the fit is known better than amounts and parameters by themselves would let it be
    block = next(sensitivities(found))
    joint = np.einsum("kmp,pq,kmq->km", block, covariance, block)
    apart = np.diag(np.diag(covariance))
    assert joint.sum() < np.einsum("kmp,pq,kmq->km", block, apart, block).sum()


def sensitivities(passes):
    """Sensitivities (n, m, p) of a fit in units of the noise."""
    for block in blocks(passes.problem, passes.fit.x, passes.fit.z):
        yield block.jacobian / passes.problem.sigma[:, None]
