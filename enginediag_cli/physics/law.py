"""A law: an effect that is stated by a formula, as an engine file may contain it.

    θ → θ (1 + f)    where θ is a factor of nominal 1 (an efficiency, a flow capacity, the scale of a reading)
    θ → θ + f        any other parameter, and a reading; f in its unit
    an effect of the library, of size absent + f, where the law acts at the size of an effect

f is a formula of variables and coefficients (`Expression`). It may contain numbers, names, + − * / and **, parentheses,
FUNCTIONS and MEMORY_FUNCTIONS, nothing else. Its text is parsed and never executed. It has exact derivatives and
checked units.

A `Variable` is a number without a unit, a formula of a few columns of the model. Except Mach number and humidity, each
is relative to its value at the engine's design point. A variable that lies further down the gas path than the parameter
is an unknown of the network, and its definition is the balance.

A law can act at the size of an effect where the engine has no parameter: air that leaves, power that is taken. It then
acts with the size absent + f. A law at a size that the engine file contains as well is a further effect of the kind.
Effects with memory and effects of several sizes cannot be used so.

Memory functions of a formula follow their first argument along time. Each is a memory of the engine:

    lagged(x, t)         τ dm/dt = x − m, τ = t seconds
    limited(x, up, down) follows x no faster than 1/up, and 1/down on the way down; seconds per unit of x, 0 no limit
    backlash(x, h)       stands still while x reverses within ± h: what switches at c of it switches at c + h on the
                         way up, and at c − h on the way down

In equilibrium, where the past of a record is not known and where a recording begins, all of them are x.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from operator import truediv
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.drivers import (
    AMBIENT_PRESSURE,
    BURNER_TEMPERATURE,
    BYPASS_RATIO,
    COMPRESSOR_PRESSURE,
    CONSTANT,
    CORRECTED_SPEED,
    HUMIDITY,
    INLET_TEMPERATURE,
    MACH,
    NOZZLE_PRESSURE_RATIO,
    POWER,
    REYNOLDS_INDEX,
    SHAFT_SPEED,
)
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.components.combustion import Burner
from enginediag_cli.engine.components.nozzles import Nozzle
from enginediag_cli.engine.components.turbomachinery import Compressor
from enginediag_cli.engine.dual import Value, chain, exp, log, maximum, minimum, power, sqrt, value
from enginediag_cli.engine.evaluation import Evaluation, reynolds_index_from_state
from enginediag_cli.engine.filters import Backlash, Filter, Lag, RateLimit
from enginediag_cli.engine.recall import MOMENT, UNKNOWN_PAST
from enginediag_cli.engine.term import Coefficient, Driver, Effect, Place, Site, Term
from enginediag_cli.physics.registry import term, term_names
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


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

    def __init__(self, message: str, column: int = 0):
        super().__init__(message)
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
        """Its memory functions."""
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
    """Raises ExpressionError for what has no place in a formula; adds the names that it has."""
    if depth > DEEPEST:
        raise ExpressionError(f"more than {DEEPEST} operations are nested", node.col_offset)
    match node:
        case ast.Constant(value=bool()) | ast.Constant(value=complex()):
            raise ExpressionError("a formula has numbers, no other constants", node.col_offset)
        case ast.Constant(value=int() | float() as number):
            if abs(number) > LARGEST:
                raise ExpressionError(f"a number is larger than {LARGEST:g}", node.col_offset)
        case ast.Name(id=name):
            names.add(name)
        case ast.UnaryOp(op=ast.USub() | ast.UAdd()):
            pass
        case ast.BinOp(op=ast.Add() | ast.Sub() | ast.Mult() | ast.Div() | ast.Pow()):
            pass
        case ast.Call(func=ast.Name(id=name), keywords=[]) if name in FUNCTIONS or name in MEMORY_FUNCTIONS:
            _check_arguments(node, name)
        case _:
            allowed = f"numbers, names, + - * / **, parentheses and {', '.join((*FUNCTIONS, *MEMORY_FUNCTIONS))}"
            raise ExpressionError(f"a formula has {allowed}, nothing else", node.col_offset)
    for part in _parts(node):
        _check(part, names, depth + 1)


def _check_arguments(call: ast.Call, name: str) -> None:
    """Raises ExpressionError where a function has the wrong number of arguments, or numbers for coefficients."""
    if name in FUNCTIONS:
        number = FUNCTIONS[name][1]
        if len(call.args) != number:
            raise ExpressionError(f"{name} takes {number}, not {len(call.args)}", call.col_offset)
        return
    number = len(MEMORY_FUNCTIONS[name].units)
    coefficients = call.args[1:]
    if len(coefficients) != number or not all(isinstance(c, ast.Name) for c in coefficients):
        plural = "s" * (number > 1)
        raise ExpressionError(
            f"{name} takes a variable and then the name{plural} of {number} coefficient{plural}", call.col_offset
        )


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
    """The parts of a formula; of a call, its arguments."""
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


Formula = Callable[..., Value]


@dataclass(frozen=True)
class Variable:
    """`name` in formulas; `words`: what it is; `driver`: of what kind. It is `of` columns of
    the model over what that is at the design point, `design`; or, `recorded`, an input as it stands."""

    name: str
    words: str
    driver: Driver
    columns: tuple[str, ...]
    formula: Formula
    design: float = 1.0
    recorded: bool = False

    @property
    def reference(self) -> float:
        """What a formula takes at the design point."""
        return self.design if self.recorded else 1.0

    def evaluate(self, e: Evaluation, network: Network) -> Value:
        """What a formula takes (N,). Raises KeyError as long as the gas path has not come so far."""
        return self._scaled(self._read(e, network))

    def values(self, columns: Mapping[str, np.ndarray]) -> np.ndarray:
        """The same of columns (N,) that are known."""
        with np.errstate(all="ignore"):
            return np.asarray(self._scaled([columns[c] for c in self.columns]))

    def _scaled(self, columns: Sequence[Value]) -> Value:
        x = self.formula(*columns)
        return x if self.recorded else x * (1.0 / self.design)

    def _read(self, e: Evaluation, network: Network) -> list[Value]:
        return [e[c] if self.recorded else _column(e, network, c) for c in self.columns]

    def add_design_value(self, network: Network) -> Variable:
        """The same with its design value. Raises KeyError where the engine has no such columns."""
        assert network.design_point is not None
        with np.errstate(all="ignore"):
            return replace(self, design=scalar(self.formula(*self._read(network.design_point, network))))


def formula_variables(network: Network) -> dict[str, Variable]:
    """By the name in formulas, those that the engine has and that are something at its design point."""
    point = network.design_point
    assert point is not None
    found: dict[str, Variable] = {}
    for v in _declared(network, tuple(point.flows)):
        try:
            known = v.add_design_value(network)
        except KeyError:
            continue
        if known.recorded or (np.isfinite(known.design) and known.design != 0.0):
            found[v.name] = known
    return found


def _declared(network: Network, stations: tuple[str, ...]) -> Iterator[Variable]:
    """As if every engine had all of them."""
    hot = next(c.values["to"] for c in network.components if isinstance(c, Burner))
    T2, T4 = f"T{network.inlet_exit}_K", f"T{hot}_K"
    yield Variable("mach", MACH.words, MACH, ("mach",), _itself, recorded=True)
    yield Variable("humidity", "water in the air, kg/kg", HUMIDITY, ("humidity_kg_kg",), _itself, recorded=True)
    yield Variable("ambient_pressure", "ambient pressure", AMBIENT_PRESSURE, ("P0_Pa",), _itself)
    yield Variable("inlet_temperature", INLET_TEMPERATURE.words, INLET_TEMPERATURE, (T2,), _itself)
    yield Variable("power", POWER.words, POWER, (T4, T2), truediv)
    yield Variable("burner_temperature", BURNER_TEMPERATURE.words, BURNER_TEMPERATURE, (T4,), _itself)
    yield _reynolds("reynolds_index", "at the inlet", network.inlet_exit)
    yield _reynolds("turbine_reynolds_index", "at the turbines", hot)
    for station in stations:
        yield _reynolds(f"reynolds_index_{station}", f"at station {station}", station)
    for column in network.speed_columns:
        label = split_column(column)[0]
        yield Variable(f"corrected_{label}", f"corrected {label}", CORRECTED_SPEED, (column, T2), _corrected)
        yield Variable(label, label, SHAFT_SPEED, (column,), _itself)
    for c in network.components:
        if isinstance(c, Nozzle):
            name = f"{c.name}_pressure_ratio"
            yield Variable(name, f"pressure ratio of {c.name}", NOZZLE_PRESSURE_RATIO, (name,), _itself)
    yield Variable("bypass_ratio", BYPASS_RATIO.words, BYPASS_RATIO, ("BPR",), _itself)
    behind = [c.values["to"] for c in network.components if isinstance(c, Compressor)]
    if behind:
        column = f"P{behind[-1]}_Pa"
        yield Variable("compressor_pressure", COMPRESSOR_PRESSURE.words, COMPRESSOR_PRESSURE, (column,), _itself)


def _reynolds(name: str, where: str, station: str) -> Variable:
    columns = (f"T{station}_K", f"P{station}_Pa")
    return Variable(name, f"Reynolds number index {where}", REYNOLDS_INDEX, columns, reynolds_index_from_state)


def _itself(x: Value) -> Value:
    return x


def _corrected(speed: Value, T_K: Value) -> Value:
    return speed / sqrt(T_K)


def _column(e: Evaluation, network: Network, column: str) -> Value:
    """A column while the gas path is gone along. Raises KeyError for one that is not known yet."""
    if column in network.speed_columns:
        e.flows[network.inlet_exit]  # the speed of a shaft follows from the air that has come in
        return e.shaft(network.speed_columns[column]).speed_rpm
    return network.read(e, column)


@dataclass(frozen=True)
class LawPlace:
    """Where a law acts: on the leaf of a parameter or, with `reading`, on what the sensor of that column reads;
    `factor`: whether it is a share of what is there, else it is added in `unit`. `through`: the effect that acts with
    the size that the law gives, where the leaf is this size."""

    leaf: str
    component: str
    unit: str
    factor: bool
    reading: bool = False
    through: Effect | None = None

    @property
    def site(self) -> Site:
        if self.through is not None:
            return Site(self.leaf, self.component, self.through.site.targets)
        return Site(self.leaf, self.component, (f"reading {self.leaf}" if self.reading else self.leaf,))


class Law(Term):
    """`expression` f of `variables` and `coefficients`, at `acts`; `changed`: what the place is with f."""

    FROM_FILE = True

    def __init__(
        self,
        name: str,
        acts: LawPlace,
        expression: Expression,
        variables: Mapping[str, Variable],
        coefficients: tuple[Coefficient, ...],
        statement: str = "",
        reference: str = "",
    ):
        self.acts, self.expression = acts, expression
        self.variables = {n: v for n, v in variables.items() if n in expression.names}
        self.NAME, self.COEFFICIENTS = name, coefficients
        self.TITLE = "Law"
        self.STATEMENT = statement or f"Law at {acts.leaf} that varies with {self.driver_words()}."
        self.changed = f"{acts.leaf} (1 + f)" if acts.factor else f"{acts.leaf} + f"
        if acts.through is not None:
            self.INPUTS = acts.through.term.INPUTS
        if expression.memory_calls:
            self.INPUTS = {**self.INPUTS, **UNKNOWN_PAST}
        self.EQUATION = f"{self.changed},  f = {expression.text}"
        self.DRIVER = next((v.driver for v in self.variables.values()), CONSTANT)
        self.REFERENCE = reference or "the engine file that states it"

    @property
    def one_sided(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(n for k in self.expression.memory_calls for n in k.coefficients))

    def driver_words(self) -> str:
        """All that its formula has."""
        return ", ".join(v.words for v in self.variables.values()) or CONSTANT.words

    def sites(self, network: Network) -> Iterable[Site]:
        yield self.acts.site

    def install(self, at: Place) -> None:
        f = self._formula(at, self._reads(at))

        def change(e: Evaluation, x: Value) -> Value:
            return x * (1.0 + f(e)) if self.acts.factor else x + f(e)

        if self.acts.through is not None:
            at.install_sized(self.acts.through, f)
        elif self.acts.reading:
            at.change_reading(self.acts.leaf, change)
        else:
            at.change_leaf(self.acts.leaf, change)

    def _reads(self, at: Place) -> dict[str, str]:
        """Leaf of the unknown by the name of each variable that is not known yet where the law acts."""
        if self.acts.reading or not self.variables:
            return {}
        reads = {n: partial(v.evaluate, network=at.network) for n, v in self.variables.items()}
        through = self.acts.through
        late = at.unknown_at_leaf(self.acts.leaf, reads) if through is None else at.unknown_at_effect(through, reads)
        return {n: at.add_unknown(n, reads[n], self.variables[n].reference) for n in late}

    def _formula(self, at: Place, unknown: Mapping[str, str]) -> Callable[[Evaluation], Value]:
        names = tuple(c.name for c in self.COEFFICIENTS if c.name in self.expression.names)
        remembered = {
            k: at.add_formula_memory(k.filter, k.coefficients, self.acts.leaf) for k in self.expression.memory_calls
        }

        def f(e: Evaluation) -> Value:
            def past(of: MemoryCall, signal: Value, values: Mapping[str, Value]) -> Value:
                return remembered[of](e, signal)

            values = {
                n: e[unknown[n]] if n in unknown else v.evaluate(e, at.network) for n, v in self.variables.items()
            }
            return self.expression.evaluate(values | {n: at.c(e, n) for n in names}, past)

        return f


def adjustable_effects(network: Network) -> dict[str, Effect]:
    """By the name of their size, all that can act on the engine, absent."""
    found = {}
    for known in map(term, term_names()):
        if MOMENT in known.INPUTS or known.TRIALS:
            continue
        for site in known.sites(network):
            effect = Effect(known, site, {})
            if len(effect.sizes) == 1:
                found[effect.sizes[0]] = effect
    return found


def effect_place(effect: Effect) -> LawPlace:
    """Where a law acts that gives the size of this effect."""
    return LawPlace(effect.sizes[0], effect.site.component, size_coefficient(effect).unit, False, through=effect)


def size_coefficient(effect: Effect) -> Coefficient:
    """The one coefficient without which the effect is absent."""
    return next(c for c in effect.term.amplitudes() if not c.free)


def changes_variable(acts: LawPlace, variable: Variable) -> bool:
    """Whether a law there would vary with the very input that it changes."""
    return variable.recorded and acts.through is not None and any(c in acts.site.targets for c in variable.columns)
