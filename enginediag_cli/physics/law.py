"""A law: an effect that is stated by a formula, as an engine file may carry it.

    θ → θ (1 + f)    where θ is a factor of nominal 1 (an efficiency, a flow capacity, the scale of a reading)
    θ → θ + f        any other parameter, and a reading; f in its unit
    an effect of the library, of size absent + f, where the law acts at the size of an effect

f is a formula of variables and coefficients. What a variable that lies further down the gas path than the parameter is,
is an unknown of the network, and that it is so is its balance. What remembers in it (followers) is a memory of the
engine, as of any effect.

What a law may vary with: named numbers without a unit, each a formula of a few columns of the model.

All but Mach number and humidity, which have no unit, are over what they are at the engine's design point: 1 there.

Effects whose size a law may give: where the engine itself has no parameter, air that leaves, power that is taken.

The effect acts with the size absent + f; a law at a size that the engine file carries, too, is a further effect of the
kind. Effects that remember, and those of several sizes, are none of these.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
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
from enginediag_cli.engine.components.compressor import Compressor
from enginediag_cli.engine.components.nozzles import Nozzle
from enginediag_cli.engine.dual import Value, sqrt
from enginediag_cli.engine.evaluation import Evaluation, reynolds_index_from_state
from enginediag_cli.engine.tape import MOMENT, PAST
from enginediag_cli.engine.term import Coefficient, Driver, Effect, Place, Site, Term
from enginediag_cli.physics.expression import Expression, MemoryCall
from enginediag_cli.physics.registry import term, term_names
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


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
        e.flows[network.inlet_exit]  # how fast a shaft turns is told by the air that has come in
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
            self.INPUTS = {**self.INPUTS, **PAST}
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
