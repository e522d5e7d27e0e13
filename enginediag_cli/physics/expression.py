"""A formula as text → a function of named values, with exact derivatives and checked units.

What may stand in it is listed here and nothing else: numbers, names, + − * / and **, parentheses, FUNCTIONS and those
that remember (followers). The text is parsed and never run.

Functions of a formula that remember: each follows its first argument along time, as a filter makes it of its past.

    lagged(x, t)         τ dm/dt = x − m, τ = t seconds
    limited(x, up, down) follows x no faster than 1/up, and 1/down on the way down; seconds per unit of x, 0 no limit
    backlash(x, h)       stands still while x turns round within ± h: what switches at c of it switches at c + h on the
                         way up, and at c − h on the way down

In equilibrium, where the past of a record is not known and where a recording begins all of them are x.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from enginediag_cli.engine.dual import Value, chain, exp, log, maximum, minimum, power, sqrt, value
from enginediag_cli.engine.filters import Backlash, Filter, Lag, RateLimit


@dataclass(frozen=True)
class MemoryFunction:
    """`filter`: what it lies from its signal; `units` of its coefficients, "1" where that is a number without one."""

    filter: Filter
    units: tuple[str, ...]


MEMORY_FUNCTIONS: Mapping[str, MemoryFunction] = {
    "lagged": MemoryFunction(Lag(), ("s",)),
    "limited": MemoryFunction(RateLimit(), ("s", "s")),
    "backlash": MemoryFunction(Backlash(), ("1",)),
}


@dataclass(frozen=True)
class MemoryCall:
    """A follower in a formula: `name`, the names `of` what it follows, the coefficients that it goes `by`, and the
    letter `at` which it stands."""

    name: str
    variables: frozenset[str]
    coefficients: tuple[str, ...]
    column: int

    @property
    def filter(self) -> Filter:
        return MEMORY_FUNCTIONS[self.name].filter


LONGEST = 2000
"""Letters of a formula."""
LARGEST = 1e100
"""Numbers of a formula: their products and powers stay far from what a computer has no number for."""
SHOWN = 40
"""Letters of a part of a formula that are quoted."""
DEEPEST = 40
"""Parentheses and operations within each other."""
WHOLE = 9
"""Whole exponents up to this are products, which have derivatives where the base is 0 or below, too."""

Unit = Mapping[str, int]
"""Exponent by the name of a unit; nothing for a number without one."""


class ExpressionError(ValueError):
    """A formula that cannot be; `column`: letter at which it goes wrong, counted from 0."""

    def __init__(self, told: str, column: int = 0):
        super().__init__(told)
        self.column = column


def tanh(x: Value) -> Value:
    v = np.tanh(value(x))
    return chain(v, (1.0 - v**2, x))


FUNCTIONS: Mapping[str, tuple[Callable[..., Value], int]] = {
    "exp": (exp, 1),
    "ln": (log, 1),
    "sqrt": (sqrt, 1),
    "tanh": (tanh, 1),
    "min": (minimum, 2),
    "max": (maximum, 2),
}
"""Function and how many arguments it takes."""

Past = Callable[[MemoryCall, Value, Mapping[str, Value]], Value]
"""How far a follower lies from its signal, where names have these values."""
Follow = Callable[[ast.Call, Value], Value]
"""The same of a call in a formula."""


@dataclass(frozen=True)
class Expression:
    """`names`: what its values must be given for."""

    text: str
    names: frozenset[str]
    _root: ast.expr
    _calls: Mapping[ast.Call, MemoryCall] = field(compare=False)

    @property
    def memory_calls(self) -> tuple[MemoryCall, ...]:
        """What of it remembers."""
        return tuple(self._calls.values())

    @staticmethod
    def parse(text: str) -> Expression:
        """Raises ExpressionError for what is no formula."""
        if len(text) > LONGEST:
            raise ExpressionError(f"the formula has {len(text)} letters, more than {LONGEST}")
        try:
            root = ast.parse(text.strip(), mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            at = getattr(error, "offset", None) or 1
            raise ExpressionError(f"'{text}' is no formula", at - 1) from error
        names: set[str] = set()
        _check(root, names, 0)
        _check_numbers(root)
        calls = (n for n in ast.walk(root) if isinstance(n, ast.Call))
        return Expression(
            text, frozenset(names), root, {n: _memory_call(n) for n in calls if _called(n) in MEMORY_FUNCTIONS}
        )

    def evaluate(self, values: Mapping[str, Value], past: Past | None = None) -> Value:
        """Its value (N,) or scalar where its names have these; in equilibrium without a `past`."""
        follow = None if past is None else lambda call, x: past(self._calls[call], x, values)
        return _value(self._root, values, follow)

    def unit(self, units: Mapping[str, Unit]) -> Unit:
        """Its unit where its names have these. Raises ExpressionError where they do not go together."""
        return _unit(self._root, units)


def parse_unit(text: str) -> Unit:
    """Of a unit's name, "1" for none."""
    return {} if text in ("", "1") else {text: 1}


def format_unit(unit: Unit) -> str:
    """As a reader sees it."""
    return " ".join(name if n == 1 else f"{name}^{n}" for name, n in unit.items()) or "1"


def _check(node: ast.expr, names: set[str], depth: int) -> None:
    if depth > DEEPEST:
        raise ExpressionError(f"more than {DEEPEST} operations stand within each other", node.col_offset)
    match node:
        case ast.Constant(value=bool()) | ast.Constant(value=complex()):
            raise ExpressionError("a formula has numbers, no other constants", node.col_offset)
        case ast.Constant(value=int() | float() as number):
            if abs(number) > LARGEST:
                raise ExpressionError(f"a number is larger than {LARGEST:g}", node.col_offset)
        case ast.Name(id=name):
            names.add(name)
        case ast.UnaryOp(op=ast.USub() | ast.UAdd(), operand=a):
            _check(a, names, depth + 1)
        case ast.BinOp(left=a, op=ast.Add() | ast.Sub() | ast.Mult() | ast.Div() | ast.Pow(), right=b):
            _check(a, names, depth + 1)
            _check(b, names, depth + 1)
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in FUNCTIONS:
            if len(arguments) != FUNCTIONS[name][1]:
                raise ExpressionError(f"{name} takes {FUNCTIONS[name][1]}, not {len(arguments)}", node.col_offset)
            for a in arguments:
                _check(a, names, depth + 1)
        case ast.Call(func=ast.Name(id=name), args=[signal, *by], keywords=[]) if name in MEMORY_FUNCTIONS:
            wanted = len(MEMORY_FUNCTIONS[name].units)
            if len(by) != wanted or not all(isinstance(b, ast.Name) for b in by):
                told = f"{name} takes what it follows and {wanted} name{'s' * (wanted > 1)} of coefficients behind it"
                raise ExpressionError(told, node.col_offset)
            for a in (signal, *by):
                _check(a, names, depth + 1)
        case _:
            allowed = f"numbers, names, + - * / **, parentheses and {', '.join((*FUNCTIONS, *MEMORY_FUNCTIONS))}"
            raise ExpressionError(f"a formula has {allowed}, nothing else", node.col_offset)


def _check_numbers(node: ast.expr) -> bool:
    """Whether a part of a formula has no names; raises ExpressionError where what has none has no finite value."""
    if isinstance(node, ast.Name):
        return False
    parts = [_check_numbers(part) for part in _parts(node)]
    if not all(parts):
        return False
    with np.errstate(all="ignore"):
        finite = (isinstance(node, ast.Call) and _called(node) in MEMORY_FUNCTIONS) or np.isfinite(
            value(_value(node, {}, None))
        )
    if not finite:
        raise ExpressionError(f"'{_shortened(ast.unparse(node))}' has no finite value", node.col_offset)
    return True


def _parts(node: ast.expr) -> list[ast.expr]:
    """What stands in it; of a call, its arguments."""
    inner = [part for part in ast.iter_child_nodes(node) if isinstance(part, ast.expr)]
    return [part for part in inner if not (isinstance(node, ast.Call) and part is node.func)]


def _shortened(text: str) -> str:
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}…"


def _called(node: ast.Call) -> str:
    return node.func.id if isinstance(node.func, ast.Name) else ""


def _memory_call(node: ast.Call) -> MemoryCall:
    signal, *by = node.args
    of = frozenset(n.id for n in ast.walk(signal) if isinstance(n, ast.Name))
    return MemoryCall(_called(node), of, tuple(a.id for a in by if isinstance(a, ast.Name)), node.col_offset)


def _value(node: ast.expr, values: Mapping[str, Value], follow: Follow | None) -> Value:
    match node:
        case ast.Constant(value=number):
            return np.float64(number)  # type: ignore[arg-type]  # checked; as arrays do, it has no errors but inf and nan
        case ast.Name(id=name):
            x = values[name]
            return np.float64(x) if isinstance(x, float) else x
        case ast.UnaryOp(op=op, operand=a):
            return _value(a, values, follow) * (-1.0 if isinstance(op, ast.USub) else 1.0)
        case ast.BinOp(left=a, op=ast.Pow(), right=b):
            return _power(_value(a, values, follow), _value(b, values, follow))
        case ast.BinOp(left=a, op=op, right=b):
            x, y = _value(a, values, follow), _value(b, values, follow)
            match op:
                case ast.Add():
                    return x + y
                case ast.Sub():
                    return x - y
                case ast.Mult():
                    return x * y
            return x / y
        case ast.Call(func=ast.Name(id=name), args=[signal, *_]) if name in MEMORY_FUNCTIONS:
            x = _value(signal, values, follow)
            return x if follow is None else x + follow(node, x)
        case ast.Call(func=ast.Name(id=name), args=arguments):
            return FUNCTIONS[name][0](*(_value(a, values, follow) for a in arguments))
    raise AssertionError("checked when it was parsed")


def _power(x: Value, exponent: Value) -> Value:
    """x**exponent; of whole numbers as products."""
    if isinstance(exponent, float) and exponent.is_integer() and 1.0 <= abs(exponent) <= WHOLE:
        product = x
        for _ in range(int(abs(exponent)) - 1):
            product = product * x
        return product if exponent > 0.0 else 1.0 / product
    return power(x, exponent)


def _unit(node: ast.expr, units: Mapping[str, Unit]) -> Unit:
    match node:
        case ast.Name(id=name):
            return units[name]
        case ast.UnaryOp(operand=a):
            return _unit(a, units)
        case ast.BinOp(left=a, op=op, right=b):
            return _combined(node, op, _unit(a, units), _unit(b, units))
        case ast.Call(func=ast.Name(id=name), args=arguments):
            found = [_unit(a, units) for a in arguments]
            if name in MEMORY_FUNCTIONS:
                _check_units(node, name, found)
                return {}
            if FUNCTIONS[name][0] in (minimum, maximum):
                if found[0] != found[1]:
                    raise ExpressionError(_unlike(found[0], found[1]), node.col_offset)
                return found[0]
            if found[0]:
                raise ExpressionError(f"{name} takes a number, not {format_unit(found[0])}", node.col_offset)
    return {}


def _check_units(node: ast.Call, name: str, found: Sequence[Unit]) -> None:
    """Of what a follower takes: it follows a number without a unit."""
    for own, wanted in zip(found, (parse_unit("1"), *map(parse_unit, MEMORY_FUNCTIONS[name].units)), strict=True):
        if own != wanted:
            raise ExpressionError(f"{name} takes {format_unit(wanted)}, not {format_unit(own)}", node.col_offset)


def _combined(node: ast.BinOp, op: ast.operator, a: Unit, b: Unit) -> Unit:
    if isinstance(op, ast.Add | ast.Sub):
        if a != b:
            raise ExpressionError(_unlike(a, b), node.col_offset)
        return a
    if isinstance(op, ast.Pow):
        if b:
            raise ExpressionError(f"an exponent is a number, not {format_unit(b)}", node.col_offset)
        if not a:
            return a
        match node.right:
            case ast.Constant(value=int() as n):
                return {name: k * n for name, k in a.items()}
        raise ExpressionError(f"{format_unit(a)} can be raised to a whole number only", node.col_offset)
    sign = 1 if isinstance(op, ast.Mult) else -1
    found = {name: a.get(name, 0) + sign * b.get(name, 0) for name in {**a, **b}}
    return {name: n for name, n in found.items() if n}


def _unlike(a: Unit, b: Unit) -> str:
    return f"{format_unit(a)} and {format_unit(b)} do not go together"
