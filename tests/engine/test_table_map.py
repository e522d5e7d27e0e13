"""Tabulated maps: exact at the grid, exact for the polynomials of their rule, a straight line outside."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import fourth_order, gradient, seeds

from enginediag_cli.engine.maps import make_table, read_table
from enginediag_cli.errors import ConfigError

X = np.array([0.3, 0.5, 0.6, 0.85, 1.0, 1.1])
Y = np.array([1.0, 1.4, 2.0, 2.2, 3.0])


def tables(*functions):
    x, y = np.meshgrid(X, Y, indexing="ij")
    return np.stack([f(x, y) for f in functions])


def parabola(x, y):
    return 1.3 - 0.7 * x + 2.0 * y - 0.4 * x * y + 1.1 * x**2 - 0.3 * y**2 + 0.2 * x**2 * y**2


def plane(x, y):
    return 2.0 + 3.0 * x - 1.5 * y + 0.7 * x * y


def wavy(x, y):
    return np.sin(3.0 * x) * np.cos(y)


def inside(n=200, seed=1):
    rng = np.random.default_rng(seed)
    return rng.uniform(X[0], X[-1], n), rng.uniform(Y[0], Y[-1], n)


@pytest.mark.parametrize("rule", ["linear", "quadratic"])
def test_grid_values_are_reproduced(rule):
    table = make_table(X, Y, tables(wavy, parabola), rule, rule)
    x, y = (g.ravel() for g in np.meshgrid(X, Y, indexing="ij"))
    (a, b), outside = table.lookup(x, y)
    assert np.allclose(a, wavy(x, y), rtol=1e-13, atol=1e-14)
    assert np.allclose(b, parabola(x, y), rtol=1e-13)
    assert not outside.any()


def test_the_quadratic_rule_reproduces_a_parabola_everywhere_inside():
    table = make_table(X, Y, tables(parabola), "quadratic", "quadratic")
    x, y = inside()
    assert np.allclose(table.lookup(x, y)[0][0], parabola(x, y), rtol=1e-12)


def test_the_linear_rule_reproduces_a_bilinear_function_everywhere():
    table = make_table(X, Y, tables(plane), "linear", "linear")
    x, y = inside()
    assert np.allclose(
        table.lookup(2.0 * x - 0.6, 1.5 * y - 0.8)[0][0], plane(2.0 * x - 0.6, 1.5 * y - 0.8), rtol=1e-12
    )


def test_the_linear_rule_lies_between_the_corner_values():
    table = make_table(X, Y, tables(wavy), "linear", "linear")
    x, y = inside()
    i, j = np.searchsorted(X, x) - 1, np.searchsorted(Y, y) - 1
    corners = np.stack([wavy(X[i + a], Y[j + b]) for a in (0, 1) for b in (0, 1)])
    found = table.lookup(x, y)[0][0]
    assert (found >= corners.min(axis=0) - 1e-13).all()
    assert (found <= corners.max(axis=0) + 1e-13).all()


def test_the_quadratic_rule_follows_the_pair_and_the_next_value_up():
    table = make_table(X, Y[:2], np.stack([np.stack([X**3, X**3], axis=1)]), "quadratic", "linear")
    x = np.array([0.55])  # between 0.5 and 0.6; the next one up is 0.85
    expected = np.interp(0.0, [0, 1], [0, 0]) + sum(
        v**3 * np.prod([(0.55 - u) / (v - u) for u in (0.5, 0.6, 0.85) if u != v]) for v in (0.5, 0.6, 0.85)
    )
    assert table.lookup(x, np.array([1.2]))[0][0][0] == pytest.approx(expected, rel=1e-12)
    x = np.array([1.07])  # last pair: the last three values
    expected = sum(v**3 * np.prod([(1.07 - u) / (v - u) for u in (0.85, 1.0, 1.1) if u != v]) for v in (0.85, 1.0, 1.1))
    assert table.lookup(x, np.array([1.2]))[0][0][0] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("rule", ["linear", "quadratic"])
def test_beyond_the_grid_the_value_continues_linearly_and_is_marked(rule):
    table = make_table(X, Y, tables(wavy), rule, rule)
    for edge, step in ((X[0], -0.1), (X[-1], 0.1)):
        x = edge + step * np.array([0.0, 1e-9, 1.0, 2.0, 3.0])
        (v,), outside = table.lookup(x, np.full(5, 1.7))
        assert list(outside) == [False, True, True, True, True]
        assert v[1] == pytest.approx(v[0], abs=1e-8)
        assert v[3] - v[2] == pytest.approx(v[2] - v[0], rel=1e-10)
        assert v[4] - v[3] == pytest.approx(v[3] - v[2], rel=1e-10)
    for edge, step in ((Y[0], -0.2), (Y[-1], 0.2)):
        y = edge + step * np.arange(4.0)
        (v,), outside = table.lookup(np.full(4, 0.7), y)
        assert list(outside) == [False, True, True, True]
        assert np.allclose(np.diff(v), v[1] - v[0], rtol=1e-10)


def _chord(edge, before, at, values):
    """The straight line through the values at the last two grid values, at `at`."""
    return values[edge] + (values[edge] - values[before]) / (edge - before) * (at - edge)


@pytest.mark.parametrize("rule", ["linear", "quadratic"])
@pytest.mark.parametrize(("edge", "before", "at"), [(X[0], X[1], 0.1), (X[-1], X[-2], 1.4)], ids=["below", "above"])
def test_beyond_the_last_speed_line_the_line_through_the_last_two_is_followed(rule, edge, before, at):
    table = make_table(X, Y, tables(wavy), rule, rule)
    for y in (*Y, 1.7):  # on a grid value, and between
        (on_lines,), _ = table.lookup(np.array([edge, before]), np.full(2, y))
        (v,), outside = table.lookup(*seeds(np.array([at]), np.array([y])))
        assert outside.all()
        assert v.v[0] == pytest.approx(_chord(edge, before, at, {edge: on_lines[0], before: on_lines[1]}), rel=1e-12)
        assert gradient(v, 2)[0, 0] == pytest.approx((on_lines[0] - on_lines[1]) / (edge - before), rel=1e-12)


@pytest.mark.parametrize("rule", ["linear", "quadratic"])
@pytest.mark.parametrize(("edge", "before", "at"), [(Y[0], Y[1], 0.5), (Y[-1], Y[-2], 3.9)], ids=["below", "above"])
def test_beyond_the_last_r_line_the_line_through_the_last_two_is_followed(rule, edge, before, at):
    table = make_table(X, Y, tables(wavy), rule, rule)
    for x in (*X, 0.7):
        (on_lines,), _ = table.lookup(np.full(2, x), np.array([edge, before]))
        (v,), outside = table.lookup(*seeds(np.array([x]), np.array([at])))
        assert outside.all()
        assert v.v[0] == pytest.approx(_chord(edge, before, at, {edge: on_lines[0], before: on_lines[1]}), rel=1e-12)
        assert gradient(v, 2)[1, 0] == pytest.approx((on_lines[0] - on_lines[1]) / (edge - before), rel=1e-12)


@pytest.mark.parametrize("rule", ["linear", "quadratic"])
def test_beyond_a_corner_the_four_corner_values_are_continued_bilinearly(rule):
    table = make_table(X, Y, tables(wavy), rule, rule)
    x, y = 1.3, 3.5
    a, b = (x - X[-1]) / (X[-1] - X[-2]), (y - Y[-1]) / (Y[-1] - Y[-2])
    f = {(i, j): wavy(X[-i], Y[-j]) for i in (1, 2) for j in (1, 2)}
    low = f[1, 1] + a * (f[1, 1] - f[2, 1])
    high = f[1, 2] + a * (f[1, 2] - f[2, 2])
    assert table.lookup(np.array([x]), np.array([y]))[0][0][0] == pytest.approx(low + b * (low - high), rel=1e-12)


def test_inside_the_grid_a_parabola_is_untouched_by_the_continuation():
    table = make_table(X, Y, tables(parabola), "quadratic", "quadratic")
    x, y = np.array([X[0], X[-1]]), np.array([Y[0], Y[-1]])
    assert np.allclose(table.lookup(x, y)[0][0], parabola(x, y), rtol=1e-13)
    assert not table.lookup(x, y)[1].any()


@pytest.mark.parametrize("rule", ["linear", "quadratic"])
def test_the_derivatives_are_those_of_the_interpolation(rule):
    table = make_table(X, Y, tables(wavy, parabola), rule, rule)
    x, y = inside(100)
    far = np.minimum(np.abs(x[:, None] - X).min(axis=1), np.abs(y[:, None] - Y).min(axis=1)) > 0.005
    x, y = x[far], y[far]  # differences must not cross a grid line
    x, y = np.concatenate([x, [0.2, 1.3, 0.7]]), np.concatenate([y, [1.7, 1.7, 3.4]])
    xs, ys = seeds(x, y)
    for k, v in enumerate(table.lookup(xs, ys)[0]):
        assert np.allclose(
            gradient(v, 2)[0], fourth_order(lambda t, k=k: table.lookup(x + t, y)[0][k], 1e-3), atol=1e-9
        )
        assert np.allclose(
            gradient(v, 2)[1], fourth_order(lambda t, k=k: table.lookup(x, y + t)[0][k], 1e-3), atol=1e-9
        )


def test_two_speed_lines_are_read_linearly_whatever_the_rule():
    table = make_table(X[:2], Y[:2], tables(plane)[:, :2, :2], "quadratic", "quadratic")
    x, y = inside(20)
    assert np.allclose(table.lookup(x, y)[0][0], plane(x, y), rtol=1e-12)


# the file

HEADER = "Nc_map,Rline,Wc_map\n"


def write(tmp_path, text):
    path = tmp_path / "map.csv"
    path.write_text(text, encoding="utf-8")
    return path


def read(path):
    return read_table(path, "Nc_map", "Rline", ("Wc_map",))


def test_a_map_file_may_give_its_grid_in_any_order_with_comments(tmp_path):
    path = write(tmp_path, "# from somewhere\n" + HEADER + "2,20,5\n1,10,1\n2,10,4\n\n1,20,2\n")
    x, y, q = read(path)
    assert list(x) == [1.0, 2.0]
    assert list(y) == [10.0, 20.0]
    assert q.tolist() == [[[1.0, 2.0], [4.0, 5.0]]]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HEADER + "1,10,1\n1,20,x\n2,10,3\n2,20,4\n", ("map.csv:3", "not a number")),
        (HEADER + "1,10,1\n1,20\n2,10,3\n2,20,4\n", ("map.csv:3", "not a number")),
        (HEADER + "1,10,1\n1,20,nan\n2,10,3\n2,20,4\n", ("map.csv:3", "not a number")),
        (HEADER + "1,10,1\n1,20,2\n2,10,3\n", ("3 rows", "2 × 2")),
        (HEADER + "1,10,1\n1,20,2\n2,10,3\n2,10,4\n", ("twice",)),
        ("Nc_map,Rline\n1,10\n", ("missing", "Wc_map")),
        (HEADER, ("map.csv:1", "no rows")),
        ("", ("map.csv", "missing")),
        (HEADER + "1,10,1\n1,20,2\n", ("1 × 2", "at least two")),
    ],
    ids=["word", "short row", "nan", "missing point", "double point", "column", "no rows", "empty", "one speed line"],
)
def test_a_faulty_map_file_is_a_config_error_that_names_the_fault(tmp_path, text, words):
    with pytest.raises(ConfigError) as caught:
        read(write(tmp_path, text))
    for word in words:
        assert word in str(caught.value)


def test_a_map_file_that_is_not_there_is_a_config_error(tmp_path):
    with pytest.raises(ConfigError, match="cannot read the component map"):
        read(tmp_path / "none.csv")


def test_a_map_file_that_is_not_text_is_a_config_error(tmp_path):
    path = tmp_path / "map.csv"
    path.write_bytes(b"\xff\xfe\x00Nc_map")
    with pytest.raises(ConfigError):
        read(path)
