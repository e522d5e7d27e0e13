"""Which formula a response follows, where the answer is known in closed form or by quadrature."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.drivers import CONSTANT
from enginediag_cli.mismatch.laws.curve_fit import Response, fitted_curves
from enginediag_cli.mismatch.laws.grammar import FORMS
from enginediag_cli.mismatch.laws.scan import KnownVariable, formulas, over_records
from enginediag_cli.physics.law import Variable

N, SIGMA = 200, 0.02


def _known() -> list[KnownVariable]:
    r = np.random.default_rng(0)
    return [
        KnownVariable(Variable(n, n, CONSTANT, (n,), lambda v: v), r.uniform(0.4, 1.6, N), k)
        for k, n in enumerate(("p", "q", "s"))
    ]


def _response(values: np.ndarray, seed: int, absorbed: np.ndarray | None = None) -> Response:
    noise = np.random.default_rng(seed).normal(0.0, SIGMA, N)
    return Response(values + noise, np.full(N, SIGMA), float(np.std(values)) or 0.1, absorbed)


def test_the_evidence_of_a_form_without_shape_is_that_of_the_linear_model() -> None:
    known = _known()
    (linear,) = (f for f in formulas(known) if f.form.name == "linear" and f.of[0].variable.name == "p")
    response = _response(0.3 * linear.curve, 1)
    (found,) = fitted_curves([linear], response)
    x = linear.curve / np.std(linear.curve) * response.size
    V = np.diag(response.sigma**2)
    of_all = V + np.outer(x, x)
    r = response.values
    log = [-0.5 * np.linalg.slogdet(C)[1] - 0.5 * r @ np.linalg.solve(C, r) for C in (of_all, V)]
    assert found.evidence == pytest.approx(log[0] - log[1] + linear.prior, rel=1e-9)


def test_the_evidence_of_a_shape_is_its_integral_over_the_prior() -> None:
    known = _known()
    powers = [f for f in formulas(known) if f.form.name == "power" and f.of[0].variable.name == "p"]
    (exponent,) = powers[0].form.shapes
    response = _response(0.3 * (known[0].values ** 1.4 - 1.0), 2)
    (found,) = fitted_curves(powers, response)
    n = np.linspace(-6.0, 6.0, 4801)
    prior = np.exp(-0.5 * ((n - exponent.centre(known[0].values)) / exponent.sigma(known[0].values)) ** 2)
    logs = np.empty(len(n))
    for k, v in enumerate(n):
        c = over_records(powers[0].form, powers[0].of, {"n": v}) if v else np.log(known[0].values)
        x = c / np.std(c) * response.size / SIGMA
        g, G = x @ response.values / SIGMA, x @ x
        logs[k] = 0.5 * g * g / (1.0 + G) - 0.5 * np.log1p(G)
    top = logs.max()
    integral = top + np.log(np.trapezoid(np.exp(logs - top) * prior, n) / np.sqrt(2 * np.pi) / 2.0)
    assert found.evidence - powers[0].prior == pytest.approx(integral, abs=0.15)
    assert abs(found.formula.shape["n"] - 1.4) < 3.0 * found.standard_error["n"]


TRUTHS = {
    "power": lambda p, q: 0.2 * (p**2.5 - 1.0),
    "approach": lambda p, q: 0.3 * (1.0 - np.exp((1.0 - p) / 0.3)),
    "step": lambda p, q: 0.2 * np.tanh((p - 0.9) / 0.1),
    "bump": lambda p, q: 0.3 * np.exp(-(((p - 1.1) / 0.15) ** 2)),
    "above": lambda p, q: 0.5 * np.maximum(p - 1.0, 0.0),
    "powers": lambda p, q: 0.3 * (p**1.7 / q**0.6 - 1.0),
}


@pytest.mark.parametrize("name", TRUTHS)
def test_a_form_is_found_with_its_variables_beside_an_offset_that_is_absorbed(name: str) -> None:
    known = _known()
    values = TRUTHS[name](known[0].values, known[1].values)
    response = _response(values + 0.7, 3, np.ones((N, 1)))
    found = fitted_curves(list(formulas(known)), response)
    first = found[0]
    assert first.formula.form.name == name and first.converged
    assert {k.variable.name for k in first.formula.of} == ({"p", "q"} if name == "powers" else {"p"})
    about = values - values.mean()
    assert np.sqrt(np.mean((first.curve - first.curve.mean() - about) ** 2)) < 0.5 * SIGMA
    assert sum(f.probability for f in found) == pytest.approx(1.0)


def test_of_noise_alone_every_formula_is_unlikelier_than_nothing() -> None:
    known = _known()
    best = [
        fitted_curves(list(formulas(known)), Response(_response(np.zeros(N), s).values, np.full(N, SIGMA), 0.1))[0]
        for s in range(4)
    ]
    assert max(f.evidence for f in best) < 0.0


def test_every_form_and_its_variables_stand_once() -> None:
    known = _known()
    found = fitted_curves(list(formulas(known)), _response(0.1 * known[0].values, 4, np.ones((N, 1))))
    keys = [(f.formula.form.name, tuple(k.variable.name for k in f.formula.of)) for f in found]
    assert len(keys) == len(set(keys)) == sum(6 if f.turned else 3 for f in FORMS if not f.remembers)
