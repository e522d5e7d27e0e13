"""Parameters that vary along curves: exact derivatives, and nothing changed where the coefficient is 0."""

import numpy as np
from concealed import turbofan

from enginediag_cli.mismatch.fit.extended import Discrepancy, ExtendedModel

N = 12


def _points():
    rng = np.random.default_rng(3)
    u = {"altitude_m": rng.uniform(0, 11000, N), "mach": rng.uniform(0.2, 0.8, N), "dT_isa_K": rng.uniform(-10, 10, N)}
    u["Wf_kg_s"] = turbofan().power_from_fraction(rng.uniform(0.4, 1, N), u)
    u["curve"] = rng.standard_normal(N)
    return u


def test_a_discrepancy_of_coefficient_0_changes_no_digit():
    u = _points()
    d = Discrepancy("hpc.efficiency", "curve", 0.01)
    plain = turbofan().predict({c: v for c, v in u.items() if c != "curve"})
    assert np.array_equal(ExtendedModel(turbofan(), [d]).predict(u, {d.name: 0.0}).y, plain.y)


def test_a_discrepancy_is_the_parameter_varied_record_by_record():
    u = _points()
    d = Discrepancy("hpc.efficiency", "curve", 0.01)
    varied = turbofan().predict(
        {c: v for c, v in u.items() if c != "curve"}, {"hpc.efficiency": 0.99 + 0.004 * u["curve"]}
    )
    found = ExtendedModel(turbofan(), [d]).predict(u, {"hpc.efficiency": 0.99, d.name: 0.004})
    np.testing.assert_allclose(found.y, varied.y, rtol=1e-9)


def test_its_derivative_agrees_with_fourth_order_differences():
    u = _points()
    d = Discrepancy("hpt.flow_capacity", "curve", 0.01)
    model = ExtendedModel(turbofan(), [d])
    wrt = (d.name, "hpt.flow_capacity")
    J = model.predict(u, {d.name: 0.002}, wrt=wrt).jacobian[:, :, 0]
    h = 1e-4
    y = {k: model.predict(u, {d.name: 0.002 + k * h}).y for k in (-2, -1, 1, 2)}
    numeric = (8 * (y[1] - y[-1]) - (y[2] - y[-2])) / (12 * h)
    assert np.max(np.abs(J - numeric) / np.abs(J).max(axis=0)) < 1e-6
