"""The same engines solved again and again as their inputs move."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import operating_points, turbofan

from enginediag_cli.engine import solver
from enginediag_cli.engine.following import Following

STEPS = 12


def ramp(engine, n):
    """Operating points (n,) by step, the power rising by some per cent from one to the next."""
    first = operating_points(engine, n, 4, power=(0.3, 0.5))
    return [{**first, **engine.optional_inputs, "Wf_kg_s": first["Wf_kg_s"] * 1.03**k} for k in range(STEPS)]


@pytest.mark.parametrize("n", [1, 7, solver.FEW_POINTS + 20])
def test_what_is_followed_is_what_is_predicted(n):
    engine = turbofan()
    steps = ramp(engine, n)
    nominal = {p: v.nominal for p, v in engine.parameters.items()}
    following = Following(engine.network, engine.predict(steps[0]).x)
    for points in steps[1:]:
        found = following.solve(points, nominal)
        assert found.converged.all()
        expected = engine.predict({c: v for c, v in points.items() if c in engine.inputs})
        np.testing.assert_allclose(found.x, expected.x, rtol=1e-9)
        assert np.array_equal(following.x, found.x)


def test_jacobians_that_are_kept_spare_computing_them(monkeypatch):
    engine = turbofan()
    steps = ramp(engine, 60)
    nominal = {p: v.nominal for p, v in engine.parameters.items()}
    x = engine.predict(steps[0]).x
    following = Following(engine.network, x, tolerance=1e-8)
    following.solve(steps[0], nominal)
    wanted = []
    evaluate = solver.evaluate

    def seen(network, inputs, parameters, x, wrt):
        wanted.append(len(wrt))
        return evaluate(network, inputs, parameters, x, wrt)

    monkeypatch.setattr(solver, "evaluate", seen)
    for share in (1.0002, 1.0004, 1.0006):
        points = {**steps[0], "Wf_kg_s": steps[0]["Wf_kg_s"] * share}
        assert following.solve(points, nominal).residual.max() <= 1e-8
    assert not any(wanted)


def test_a_point_that_is_lost_keeps_its_start_and_the_others_go_on():
    engine = turbofan()
    steps = ramp(engine, 60)
    nominal = {p: v.nominal for p, v in engine.parameters.items()}
    x = engine.predict(steps[0]).x
    following = Following(engine.network, x)
    lost = {**steps[1], "Wf_kg_s": steps[1]["Wf_kg_s"].copy()}
    lost["Wf_kg_s"][5] = 1e-6
    found = following.solve(lost, nominal)
    assert not found.converged[5] and found.converged.sum() == 59
    assert np.array_equal(following.x[:, 5], x[:, 5])
    assert following.solve(steps[1], nominal).converged.all()
