"""Formulas: what may stand in them, what they are worth, their derivatives and units."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.engine.dual import Dual, value
from enginediag_cli.physics.law import LONGEST, Expression, ExpressionError, parse_unit

FORMULAS = {
    "a * (x - 1) + b": lambda a, b, x: a * (x - 1) + b,
    "-a * (x ** -b - 1)": lambda a, b, x: -a * (x**-b - 1),
    "a * ln(x) / (1 + exp(-b * x))": lambda a, b, x: a * np.log(x) / (1 + np.exp(-b * x)),
    "a * tanh((x - b) / 0.1)": lambda a, b, x: a * np.tanh((x - b) / 0.1),
    "a * max(x - b, 0) + min(x, 0.9)": lambda a, b, x: a * np.maximum(x - b, 0) + np.minimum(x, 0.9),
    "sqrt(x) * x ** 3 / a": lambda a, b, x: np.sqrt(x) * x**3 / a,
}


@pytest.mark.parametrize("text", FORMULAS)
def test_a_formula_is_worth_what_python_says_and_its_derivatives_are_those_of_complex_steps(text: str) -> None:
    r = np.random.default_rng(0)
    at = dict(zip("abx", r.uniform(0.5, 1.5, (3, 20)), strict=True))
    duals = {n: Dual(v, np.eye(3)[k][:, None] * np.ones(20)) for k, (n, v) in enumerate(at.items())}
    found = Expression.parse(text).evaluate(duals)
    assert np.allclose(value(found), FORMULAS[text](**at), rtol=1e-14)
    for k, n in enumerate("abx"):
        h = 1e-6
        low, high = (FORMULAS[text](**{**at, n: at[n] + s * h}) for s in (-1, 1))
        slope = found.d[k] if k < len(found.d) else 0.0
        assert np.allclose(slope, (high - low) / (2 * h), rtol=1e-5, atol=1e-7), n


def test_a_whole_power_of_nothing_has_a_derivative() -> None:
    x = Dual(np.zeros(3), np.ones((1, 3)))
    found = Expression.parse("m ** 3 + 2 * m").evaluate({"m": x})
    assert isinstance(found, Dual) and np.array_equal(found.d[0], np.full(3, 2.0))


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os')",
        "x.real",
        "x[0]",
        "lambda: 1",
        "[x for x in y]",
        "exec('1')",
        "x if x else y",
        "x < y",
        "True * x",
        "1j * x",
        "x // y",
        "max(x)",
        "exp(x, 1)",
        "exp(x=1)",
        "a b",
        "",
        "(" * 300 + "x" + ")" * 300,
        "-" * 100 + "x",
        "x" * (LONGEST + 1),
    ],
)
def test_what_is_no_formula_is_refused_and_never_run(text: str) -> None:
    with pytest.raises(ExpressionError):
        Expression.parse(text)


UNITS = {"T": parse_unit("K"), "a": parse_unit("K"), "p": parse_unit("Pa"), "x": parse_unit("1")}


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("T / a", {}),
        ("a * x + T", {"K": 1}),
        ("a ** 2 / T", {"K": 1}),
        ("a * p", {"K": 1, "Pa": 1}),
        ("max(T, a)", {"K": 1}),
    ],
)
def test_units_go_through_a_formula(text: str, unit: dict[str, int]) -> None:
    assert Expression.parse(text).unit(UNITS) == unit


@pytest.mark.parametrize("text", ["a + p", "a + 1", "exp(a)", "x ** a", "a ** 0.5", "min(a, p)", "a - x"])
def test_units_that_do_not_go_together_are_refused(text: str) -> None:
    with pytest.raises(ExpressionError):
        Expression.parse(text).unit(UNITS)


@pytest.mark.parametrize(
    ("text", "column"),
    [
        ("x + 1 / 0", 4),
        ("x * (0 - 8) ** 0.5", 4),
        ("x ** (9 ** 9 ** 9 ** 9)", 11),
        ("x + ln(0)", 4),
        ("x - exp(1000)", 4),
        ("x + 0 / 0 * 3", 4),
        ("x + 1e200", 4),
        ("x + " + "9" * 400, 4),
    ],
)
def test_a_part_without_names_that_has_no_finite_value_is_refused_at_its_place(text: str, column: int) -> None:
    with pytest.raises(ExpressionError, match=r"no finite value|larger than 1e\+100") as refused:
        Expression.parse(text)
    assert refused.value.column == column


@pytest.mark.parametrize("text", ["1 / (x - 1)", "0 / (x - 1)", "(x - 2) ** 0.5", "(x * 1e99) ** 99", "ln(x - 1)"])
def test_where_a_formula_has_no_value_it_is_no_number_and_no_error(text: str) -> None:
    with np.errstate(all="ignore"):
        assert not np.isfinite(value(Expression.parse(text).evaluate({"x": 1.0})))
