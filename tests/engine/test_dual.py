"""Derivative arithmetic against central differences, for every operation and every combination of prefixes."""

from __future__ import annotations

import operator

import numpy as np
import pytest
from engine_makers import fourth_order, gradient, seeds

from enginediag_cli.engine import dual
from enginediag_cli.engine.dual import Dual, chain, exp, log, power, sqrt, value

A, B = np.array([0.7, 1.3, 2.9, 4.1]), np.array([1.9, 0.4, 2.2, 3.3])
BINARY = {
    "add": operator.add,
    "subtract": operator.sub,
    "multiply": operator.mul,
    "divide": operator.truediv,
    "power": dual.power,
}
UNARY = {"exp": dual.exp, "log": dual.log, "sqrt": dual.sqrt, "negative": operator.neg}


def numeric(f, a, b, step=1e-3):
    return np.stack([fourth_order(lambda t: f(a + t, b), step), fourth_order(lambda t: f(a, b + t), step)])


@pytest.mark.parametrize("name", BINARY)
def test_an_operation_of_two_variables_has_the_derivatives_of_differences(name):
    f = BINARY[name]
    a, b = seeds(A, B)
    r = f(a, b)
    assert np.allclose(value(r), f(A, B), rtol=1e-14)
    assert np.allclose(gradient(r, 2), numeric(f, A, B), rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("name", BINARY)
def test_an_operation_does_not_depend_on_which_operand_carries_the_longer_prefix(name):
    f = BINARY[name]
    b, a = seeds(B, A)  # now the second operand has one direction, the first two
    r = f(a, b)
    assert np.allclose(gradient(r, 2)[::-1], numeric(f, A, B), rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("name", BINARY)
@pytest.mark.parametrize("plain", [2.5, np.array([0.3, 1.0, 2.0, 2.5])], ids=["number", "array"])
def test_an_operation_with_a_plain_operand_differentiates_the_other(name, plain):
    f = BINARY[name]
    (a,) = seeds(A)
    first = gradient(f(a, plain), 1)[0]
    second = gradient(f(plain, a), 1)[0]
    assert np.allclose(first, fourth_order(lambda t: f(A + t, plain), 1e-3), rtol=1e-8, atol=1e-10)
    assert np.allclose(second, fourth_order(lambda t: f(plain, A + t), 1e-3), rtol=1e-8, atol=1e-10)
    assert np.allclose(value(f(plain, a)), f(plain, A), rtol=1e-14)


@pytest.mark.parametrize("name", UNARY)
def test_a_function_of_one_variable_has_the_derivative_of_differences(name):
    f = UNARY[name]
    (a,) = seeds(A)
    assert np.allclose(gradient(f(a), 1)[0], fourth_order(lambda t: f(A + t), 1e-3), rtol=1e-8, atol=1e-10)
    assert np.allclose(value(f(a)), f(A), rtol=1e-14)


@pytest.mark.parametrize("exponent", [1.0, 2.0, 3.0, -1.0, 0.5])
def test_a_power_with_a_fixed_exponent_has_the_textbook_derivative(exponent):
    (a,) = seeds(A)
    r = dual.power(a, exponent)
    assert np.allclose(value(r), A**exponent, rtol=1e-14)
    assert np.allclose(gradient(r, 1)[0], exponent * A ** (exponent - 1.0), rtol=1e-13)


def test_quantities_with_different_directions_combine_on_the_common_prefix():
    a, b, c = seeds(A, B, A + B)
    r = a * c + b / a - c
    assert r.d.shape == (3, 4)
    assert np.allclose(r.d, [A + B - B / A**2, 1.0 / A, A - 1.0])


def test_a_combination_leaves_its_operands_as_they_were():
    a, b = seeds(A, B)
    before = a.d.copy(), b.d.copy()
    for f in BINARY.values():
        f(a, b)
        f(b, a)
    chain(A * B, (B, a), (A, b))
    dual.select(A > 1.0, a, b)
    assert np.array_equal(a.d, before[0])
    assert np.array_equal(b.d, before[1])


def test_select_takes_value_and_derivative_of_the_chosen_side():
    a, b = seeds(A, B)
    first = A > B
    r = dual.select(first, a, b)
    assert np.array_equal(r.v, np.where(first, A, B))
    assert np.array_equal(r.d, np.stack([first, ~first]).astype(float))


def test_select_between_a_dual_and_a_number_has_no_slope_where_the_number_is_chosen():
    (a,) = seeds(A)
    r = dual.select(A > 1.0, a, 5.0)
    assert np.array_equal(r.v, np.where(A > 1.0, A, 5.0))
    assert np.array_equal(r.d[0], (A > 1.0).astype(float))


def test_maximum_follows_the_larger_operand():
    a, b = seeds(A, B)
    r = dual.maximum(a, b)
    assert np.array_equal(r.v, np.maximum(A, B))
    assert np.array_equal(r.d[0], (A >= B).astype(float))
    assert np.array_equal(dual.maximum(A, 1.0), np.maximum(A, 1.0))


def test_chain_sums_partial_derivatives_and_ignores_plain_arguments():
    a, b = seeds(A, B)
    r = chain(A * B, (B, a), (A, b), (np.ones(4), 7.0))
    assert np.allclose(r.d, [B, A])
    assert chain(A, (B, 1.0)) is A
    swapped = chain(A * B, (A, b), (B, a))
    assert np.array_equal(r.d, swapped.d)


def test_array_on_the_left_of_a_dual_makes_one_dual():
    (a,) = seeds(A)
    for r in (B + a, B - a, B * a, B / a):
        assert isinstance(r, Dual)
        assert r.v.shape == (4,)


def test_a_long_expression_has_the_derivatives_of_differences():
    def f(a, b):
        return dual.log(dual.sqrt(a * a + b) / dual.exp(-0.3 * b)) * dual.power(a, b) - 2.0 / (a + b)

    a, b = seeds(A, B)
    assert np.allclose(gradient(f(a, b), 2), numeric(f, A, B), rtol=1e-8)


def test_the_value_of_a_dual_is_that_of_plain_numbers_to_the_last_digit():
    rng = np.random.default_rng(4)
    a, b = rng.uniform(0.5, 3.0, (2, 200))
    x, y = Dual(a, np.ones((1, 200))), Dual(b, np.ones((2, 200)))
    for of in (
        lambda x, y: x / y,
        lambda x, y: 1.7 / x,
        lambda x, y: x / 1.7,
        lambda x, y: x / b,
        lambda x, y: power(x, 3.3),
        lambda x, y: power(x, 2.0),
        lambda x, y: power(x, y),
        lambda x, y: power(x, b),
        lambda x, y: power(1.3, y),
        lambda x, y: x * y - sqrt(x) + log(y) * exp(x),
    ):
        assert np.array_equal(value(of(x, y)), of(a, b))
