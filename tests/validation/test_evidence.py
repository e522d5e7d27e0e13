"""The scores that studies share are those of the tool; cases give the changes that they name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.methods.estimation import linearise_windows, scored_windows
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.residuals.score import fisher_score
from enginediag_cli.residuals.statistics import block_statistics
from enginediag_cli.simulation.flights import KINDS, column_noise
from enginediag_cli.validation.studies import build_case, known_nominal, make_trials

ENGINE = load_engine(Path(__file__).parents[2] / "configs" / "turbofan.yaml")
NOISE = column_noise(KINDS["uniform"], ENGINE)
MONITOR = known_nominal(ENGINE, (), NOISE)
PLAN = {
    "flights": 1,
    "mission": {
        "type": "sweep",
        "altitude_m": [2000, 11000],
        "mach": [0.4, 0.8],
        "dT_isa_K": [-10, 10],
        "power": [0.5, 1.0],
        "cas_kt": [200, 380],
        "records_per_flight": 100,
        "record_interval_s": 60.0,
    },
    "constants": {},
}


def case_of(changes=None, draw=None, repetitions=4):
    blank = {"faults": None, "size": None, "sigmas": None, "sign": "both", "among": []}
    draw = None if draw is None else blank | draw
    return build_case({"name": "x", "repetitions": repetitions, "changes": changes or {}, "draw": draw}, MONITOR)


@pytest.fixture(scope="module")
def trials():
    case = case_of({"hpc.efficiency": -0.02, "fan.flow_capacity": -0.01})
    return make_trials(MONITOR, case, 4, 60, PLAN, NOISE, np.random.default_rng(1))


def window_scores(windows, linearise):
    """Scores by a re-estimate of every window that asks the engine at each step."""
    found = linearise_windows(MONITOR, windows, linearise, MONITOR.precision)
    W, n, m = windows.y.shape
    lags = np.ones(W * n)
    lags[::n] = np.inf  # windows are unrelated
    e, J = found.e.reshape(-1, m), found.J.reshape(W * n, m, -1)
    blocks = block_statistics(e, J, MONITOR.noise, np.arange(W) * n, MONITOR.frame, lags=lags)
    C = MONITOR.uncertainty
    return [fisher_score(b.statistics, monitored=MONITOR.monitored, uncertainty=C) for b in blocks], found.converged


@pytest.mark.parametrize("linearise", ["estimate", "nominal"])
def test_scores_are_those_of_the_local_approach(trials, linearise):
    evidence = scored_windows(MONITOR, trials.windows)
    found, converged = evidence.scores(linearise)
    expected, also = window_scores(trials.windows, linearise)
    assert converged.all() and also.all()
    for a, b in zip(found, expected, strict=True):
        root = np.linalg.cholesky(b.information)
        # in standard errors of the parameters
        assert np.max(np.abs(np.linalg.solve(root, a.b - b.b))) < 0.05
        assert a.glr == pytest.approx(b.glr, rel=1e-3)


def test_shared_scores_are_computed_once_and_their_cost_is_known(trials):
    evidence = scored_windows(MONITOR, trials.windows)
    first = evidence.scores("estimate")
    assert evidence.scores("estimate") is first
    assert evidence.used == {"predictions", "estimate"} == set(evidence.cost)


def test_readings_are_the_model_of_the_faulty_engine_within_the_noise(trials):
    values = {"hpc.efficiency": 0.98, "fan.flow_capacity": 0.99}
    y = ENGINE.predict(trials.windows.flat_inputs(), values, sensors=MONITOR.sensors).y
    half = np.array([0.005 * ENGINE.sensors[c].maximum for c in MONITOR.sensors])
    departure = np.abs(trials.windows.y.reshape(y.shape) - y) / half
    assert departure.max() <= 1 + 1e-9 and departure.max() > 0.95


def test_the_noise_that_methods_know_is_that_of_the_readings():
    widths = np.array([0.01 * ENGINE.sensors[c].maximum for c in MONITOR.sensors])
    np.testing.assert_allclose(MONITOR.noise.sigma, widths / np.sqrt(12))
    correlated = known_nominal(ENGINE, (), column_noise(KINDS["correlated"], ENGINE))
    assert np.all(correlated.noise.rho == 0.8)


def test_drawn_changes_respect_number_size_sign_and_candidates():
    case = case_of(draw={"faults": [1, 3], "size": [0.01, 0.02], "sign": "fall", "among": ["*.efficiency"]})
    changes = case.draw_changes(MONITOR, 400, np.random.default_rng(2))
    number = np.count_nonzero(changes, axis=1)
    assert set(number) == {1, 2, 3}
    assert set(np.array(MONITOR.names)[changes.any(axis=0)]) == {n for n in MONITOR.names if n.endswith("efficiency")}
    size = changes[changes != 0]
    assert size.max() <= -0.01 and size.min() >= -0.02


def test_changes_are_relative_where_nominal_is_not_zero_and_in_units_where_it_is():
    monitor = known_nominal(ENGINE, ["hpc.efficiency", "sensor.T3.bias"], NOISE)
    values = {"name": "x", "repetitions": 1, "changes": {"hpc.efficiency": -0.01, "sensor.T3.bias": 4.0}, "draw": None}
    np.testing.assert_allclose(build_case(values, monitor).changes, [-0.01, 4.0])
