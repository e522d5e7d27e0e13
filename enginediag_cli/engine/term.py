"""The base class of physical effects: words, coefficients, the sites where it can act, and how it acts there.

A `Term` is installed at a `Site` of an engine (a component, a shaft, a sensor) and is then an `Effect`. Its
coefficients become parameters `<term>.<site>.<coefficient>` of the family "physics". At their `absent` values the
effect is off and the model is unchanged to the last digit: hooks of an absent effect are not called.

A `Driver` is a quantity on which an effect may depend, with its words and its values in the records of an engine. The
list of drivers is in `enginediag_cli.drivers`; a term may have one of its own.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.engine.dual import Array, Value
from enginediag_cli.engine.evaluation import Evaluation, FlowHook, Hooks, SolvedLeaf, ValueHook
from enginediag_cli.engine.filters import Filter
from enginediag_cli.engine.recall import Memory
from enginediag_cli.parameters import Parameter, spelled

if TYPE_CHECKING:
    from enginediag_cli.engine.components.base import Component
    from enginediag_cli.engine.engine import Engine
    from enginediag_cli.engine.network import Network


STILL = 1e-6
"""Relative spread below which a driver has not moved."""


@dataclass(frozen=True)
class DriverConditions:
    """N records of an engine: its inputs, and `column`, the model columns that drivers asked for, (N,) each; NaN
    where the engine has no prediction."""

    engine: Engine
    inputs: Mapping[str, np.ndarray]
    column: Mapping[str, np.ndarray]


def no_columns(engine: Engine) -> tuple[str, ...]:
    """A driver that reads no model column."""
    return ()


def no_values(at: DriverConditions) -> Iterable[DriverValues]:
    """A driver of which no engine gives values: it is recorded, or it is none."""
    return ()


@dataclass(frozen=True)
class Driver:
    """One thing that an effect may vary with.

    `word`: how terms and tables call it; `words`: what it is, as an engineer says it ("flight Mach number"); `unit` of
    its values, and `counted_in`, where they are logarithms: what the quantity itself is counted in. `columns`: model
    columns that `values` reads; `values`: its values in the records, one for each shaft or nozzle that the engine has,
    none where the engine has no such thing. `true_values`: the same where an input that it needs was not recorded, for
    those who know what truly happened.
    """

    word: str
    words: str
    unit: str = "1"
    quantity_unit: str = ""
    columns: Callable[[Engine], tuple[str, ...]] = no_columns
    values: Callable[[DriverConditions], Iterable[DriverValues]] = no_values
    true_values: Callable[[DriverConditions], Iterable[DriverValues]] = no_values


@dataclass(frozen=True)
class DriverValues:
    """A driver's values in every record (N,), in its unit; `name` distinguishes those of several shafts or nozzles,
    `short` is the name as an engineer says it, on an axis or in a sentence."""

    driver: Driver
    name: str
    values: np.ndarray
    short: str

    @property
    def unit(self) -> str:
        return self.driver.unit

    @property
    def moves(self) -> bool:
        spread = np.nanstd(self.values)
        return bool(spread > STILL * max(1e-300, float(np.nanmean(np.abs(self.values)))))


@dataclass(frozen=True)
class Coefficient:
    """One number of an effect.

    Parameters
    ----------
    name, unit, description : str
        The name completes the parameter's name; unit "1" for a number without one.
    absent : float
        Value at which the effect is not there.
    lower, upper : float
        Physical bounds; their sign is knowledge (a bleed takes air).
    sigma : float
        Prior standard deviation when the term is searched for.
    typical : float
        A plausible size, with its sign.
    shape : bool
        It matters only when another coefficient is not absent (a threshold, an exponent that is not sought): a search
        keeps its `absent` value. See `shape_coefficient`.
    free : bool
        It is sought with the others, though by itself it is no effect (a time constant).
    per_full : bool
        It is the time for a full scale, see `Site.full`.
    closed : bool
        It may well lie at one of its bounds.
    cited : bool
        The range is read in the term's reference; otherwise it is engineering judgement.
    """

    name: str
    unit: str
    description: str
    _: KW_ONLY
    absent: float = 0.0
    lower: float = 0.0
    upper: float
    sigma: float
    typical: float
    shape: bool = False
    free: bool = False
    per_full: bool = False
    closed: bool = False
    cited: bool = False


def shape_coefficient(
    name: str,
    unit: str,
    description: str,
    *,
    value: float,
    lower: float = 0.0,
    upper: float,
    sigma: float,
    cited: bool = False,
) -> Coefficient:
    """A coefficient that keeps its `value` in a search and has no effect by itself; see `Coefficient`."""
    return Coefficient(
        name,
        unit,
        description,
        absent=value,
        lower=lower,
        upper=upper,
        sigma=sigma,
        typical=value,
        shape=True,
        cited=cited,
    )


@dataclass(frozen=True)
class Site:
    """Where a term can act: `name` (hpc, hp, T45, …) completes its parameters' names; `component` is the part of
    the engine that an engineer would look at ("hpc", "hp", "sensor.T45", "ambient"); `acts_on` are the leaves
    ("hpc.efficiency"), stations ("station 3") or readings ("reading T45_K") that it changes. `everywhere`: it
    is the air around the engine, which needs no naming. `full`: size and unit of a full scale there, for coefficients
    that are times for it."""

    name: str
    component: str
    targets: tuple[str, ...]
    everywhere: bool = False
    full: tuple[float, str] | None = None

    def rate(self, coefficient: Coefficient, seconds: float) -> tuple[float, str] | None:
        """The rate and its unit that a time for the full scale stands for; None where it is no such time, or none."""
        if self.full is None or not coefficient.per_full or seconds <= 0.0:
            return None
        return self.full[0] / seconds, f"{self.full[1]}/s"


class Term(ABC):
    """One effect. Subclasses fill in the words and implement `sites` and `install`.

    `DRIVER` is what the effect varies with: one of `enginediag_cli.drivers`, or one that the term brings.
    `INPUTS` are columns that it reads beside the engine's own, with the value that stands for "not recorded".
    `TRIALS`: sizes at which a search tries the effect, where its derivative at absence is no guide: a rate limit that
    nothing meets, a delay whose length matters.
    `SWITCHES`: commanded, so it may be on or off without any column showing it. `OF_A_FILE`: an engine file states it,
    and no library holds it. `SOUGHT`: whether a search tries it, or only engine files carry it. `MEASURED`: it goes
    by a reading as that was measured, and holds its noise.
    """

    NAME: str
    TITLE: str
    STATEMENT: str
    EQUATION: str
    DRIVER: Driver
    COEFFICIENTS: tuple[Coefficient, ...]
    REFERENCE: str
    INPUTS: Mapping[str, float] = MappingProxyType({})
    TRIALS: tuple[Mapping[str, float], ...] = ()
    SWITCHES: bool = False
    FROM_FILE: bool = False
    SOUGHT: bool = True
    MEASURED: bool = False

    def __init_subclass__(cls, **given: object) -> None:
        """Raises TypeError for a term whose driver is none: words would be missing in reports."""
        super().__init_subclass__(**given)
        driver = getattr(cls, "DRIVER", None)
        if "NAME" in cls.__dict__ and not isinstance(driver, Driver):
            raise TypeError(
                f"{cls.__module__}.{cls.__name__}: DRIVER is {driver!r}, no Driver: name one of enginediag_cli.drivers "
                "(MACH, POWER, …) or bring one: Driver(word, words, unit, columns=…, values=…) of "
                "enginediag_cli.engine.term"
            )

    def amplitudes(self) -> tuple[Coefficient, ...]:
        """The coefficients that are sought."""
        return tuple(c for c in self.COEFFICIENTS if not c.shape)

    @property
    def one_sided(self) -> tuple[str, ...]:
        """Coefficients of which records may bound one end only: any larger, or any smaller, explains as well."""
        return ()

    def driver_words(self) -> str:
        """In words."""
        return self.DRIVER.words

    @abstractmethod
    def sites(self, network: Network) -> Iterable[Site]:
        """Places of this engine at which the effect can act; none where the engine has no such part."""

    @abstractmethod
    def install(self, at: Place) -> None:
        """Registers the effect's hooks at a site."""


@dataclass(frozen=True)
class Effect:
    """A term at a site with the values of its coefficients; those not given are absent. `switch`: input column that is
    1 where the effect is on and 0 where it is off (0 where it is not recorded); always on without one. `limits`:
    parameter → upper bound, where this installation allows less than the term does."""

    term: Term
    site: Site
    values: Mapping[str, float]
    switch: str = ""
    limits: Mapping[str, float] = field(default_factory=dict)

    @property
    def trial_names(self) -> tuple[str, ...]:
        """Names of the directions along which the term's trials lie."""
        return tuple(self.parameter_name(f"trial_{k}") for k in range(1, len(self.term.TRIALS) + 1))

    @property
    def label(self) -> str:
        """`reynolds_efficiency@hpc`: how commands and answers call it."""
        return f"{self.term.NAME}@{self.site.name}"

    def parameter_name(self, coefficient: str) -> str:
        return f"{self.term.NAME}.{self.site.name}.{coefficient}"

    def replace_values(self, known: Mapping[str, float]) -> Effect:
        """The effect with those of its coefficients that are among `known`, by parameter name; the others as they
        are."""
        own = {c.name: self.parameter_name(c.name) for c in self.term.COEFFICIENTS}
        return replace(self, values={**self.values, **{c: known[n] for c, n in own.items() if n in known}})

    @property
    def amplitudes(self) -> tuple[str, ...]:
        """Names of the parameters that are sought."""
        return tuple(self.parameter_name(c.name) for c in self.term.amplitudes())

    @property
    def sizes(self) -> tuple[str, ...]:
        """Names of those without which the effect is absent."""
        return tuple(self.parameter_name(c.name) for c in self.term.amplitudes() if not c.free)

    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(
            Parameter(
                self.parameter_name(c.name),
                "physics",
                self.values.get(c.name, c.absent),
                c.lower,
                min(c.upper, self.limits.get(self.parameter_name(c.name), c.upper)),
                c.sigma,
                c.unit,
                c.description,
                self.site.component,
                f"{self.term.NAME}.{c.name}",
                f"{spelled(self.term.NAME)} {spelled(self.site.name)} {spelled(c.name)}",
                spelled(self.site.name),
            )
            for c in self.term.COEFFICIENTS
        )


class Place:
    """A site of one engine while a term is installed there.

    `network` is the engine, `design` the evaluation of the sized engine at its design point, one point, for reference
    values.
    """

    def __init__(self, network: Network, effect: Effect, hooks: Hooks):
        self.network, self.effect, self._hooks = network, effect, hooks
        self.site = effect.site
        assert network.design_point is not None
        self.design: Evaluation = network.design_point
        self._states: list[str] = []
        self._absent = {effect.parameter_name(c.name): c.absent for c in effect.term.amplitudes() if not c.free}

    @property
    def component(self) -> Component:
        """The component of the site's name, where the site is neither a shaft nor a sensor."""
        return next(c for c in self.network.components if c.name == self.site.name)

    def c(self, e: Evaluation, coefficient: str) -> Value:
        """Value of a coefficient in this evaluation: absent where the effect is switched off."""
        name = self.effect.parameter_name(coefficient)
        if not self.effect.switch or name not in self._absent:
            return e[name]
        return self._absent[name] + (e[name] - self._absent[name]) * e[self.effect.switch]

    def active(self, e: Evaluation) -> bool:
        """Whether the effect is there, or sought: any amplitude not absent or a direction of differentiation."""
        if any(n in e.wrt or np.any(e.leaves[n] != a) for n, a in self._absent.items()):
            return True
        # what is remembered is known, or its signal is requested
        return any(not isinstance(e.leaves[n], float) for n in self._states)

    def filter_input(self, column: str, filter: Filter, coefficients: Sequence[str]) -> None:
        """The network reads what `filter` makes of an input column, or of what sets the power."""
        self._hooks.memories.append(
            replace(self._memory(filter, coefficients), column=column, sensor_column=self._sensor_column(column))
        )

    def _sensor_column(self, column: str) -> str:
        """The sensor that reads a model column and nothing else."""
        sensors = self.network.sensors.values()
        return next((s.column for s in sensors if dict(s.reads) == {column: 1.0} and not s.denominator), "")

    def add_memory(
        self,
        filter: Filter,
        coefficients: Sequence[str] = (),
        *,
        recorded: str = "",
        measured: Callable[[Array], Array] = np.asarray,
        sensor: str = "",
        turns: str = "",
    ) -> Callable[[Evaluation, Value], Value]:
        """remembered(e, signal): what `filter` makes of the signal's past, 0 in equilibrium; to be called by a hook in
        every evaluation. `recorded`, `measured`, `sensor`, `turns`: as of `Memory`."""
        memory = self._memory(filter, coefficients)
        return self._remembered(replace(memory, recorded=recorded, measured=measured, sensor=sensor, rotor_shaft=turns))

    def add_formula_memory(
        self, filter: Filter, coefficients: Sequence[str], leaf: str
    ) -> Callable[[Evaluation, Value], Value]:
        """The same where the effect, at a leaf or a sensor's column, multiplies by its size what is remembered."""
        shown = (s for s in self.network.sensors.values() if leaf in (s.column, *(p.name for p in s.parameters())))
        sensor = next((s.column for s in shown), "")
        return self._remembered(replace(self._memory(filter, coefficients), sensor=sensor, multiplied=True))

    def _remembered(self, memory: Memory) -> Callable[[Evaluation, Value], Value]:
        self._hooks.memories.append(memory)
        self._states.append(memory.name)

        def remembered(e: Evaluation, signal: Value) -> Value:
            e.signals[memory.name] = signal
            return e[memory.name]

        return remembered

    def _memory(self, filter: Filter, coefficients: Sequence[str]) -> Memory:
        effect = self.effect
        absent = {c.name: c.absent for c in effect.term.COEFFICIENTS}
        tried = {
            name: tuple(float({**absent, **trial}[c]) for c in coefficients)
            for name, trial in zip(effect.trial_names, effect.term.TRIALS, strict=True)
        }
        names = tuple(map(effect.parameter_name, coefficients))
        name = effect.parameter_name("memory")
        further = sum(m.name.startswith(name) for m in self._hooks.memories)
        return Memory(f"{name}_{further + 1}" if further else name, filter, names, self._absent, trial_sizes=tried)

    def unknown_at_leaf(self, leaf: str, reads: Mapping[str, Callable[[Evaluation], Value]]) -> tuple[str, ...]:
        """Names of what cannot be read yet when the gas path comes to a leaf: reads raise KeyError."""
        late: list[str] = []

        def look(e: Evaluation, x: Value) -> Value:
            late.extend(_unreadable(e, reads))
            return x

        self._passed(Hooks({leaf: [look]}))
        return tuple(late)

    def unknown_at_effect(self, effect: Effect, reads: Mapping[str, Callable[[Evaluation], Value]]) -> tuple[str, ...]:
        """The same when the gas path first comes to where another effect takes hold."""
        late: list[str] = []

        def look(e: Evaluation) -> Value:
            late.extend(n for n in _unreadable(e, reads) if n not in late)
            return 0.0

        hooks = Hooks()
        effect.term.install(_SizedPlace(self.network, effect, hooks, look, lambda e: True))
        self._passed(hooks)
        return tuple(late)

    def _passed(self, hooks: Hooks) -> None:
        passing = Evaluation(self.network.gas, self.design.size, self.design.leaves, hooks=hooks)
        with np.errstate(all="ignore"):
            self.network.open_loop(passing)

    def install_sized(self, effect: Effect, size: Callable[[Evaluation], Value]) -> None:
        """Another effect, without memory, acts with this one: what `size(e)` adds to its absent value is its size."""
        effect.term.install(_SizedPlace(self.network, effect, self._hooks, size, self.active))

    def add_unknown(self, name: str, read: Callable[[Evaluation], Value], start: float) -> str:
        """Leaf of an unknown of the network that stands for what can be read further down the gas path, above 0."""
        leaf = self.effect.parameter_name(name)
        self._hooks.solved.append(SolvedLeaf(leaf, read, start))
        return leaf

    def change_leaf(self, leaf: str, change: ValueHook) -> None:
        """`change(e, x)` gives the leaf's new value from its old one."""
        self._hooks.leaves.setdefault(leaf, []).append(self._guarded(change))

    def change_flow(self, station: str, change: FlowHook) -> None:
        """`change(e, flow)` gives the flow that the station delivers."""
        self._hooks.stations.setdefault(station, []).append(self._guarded(change))

    def change_reading(self, column: str, change: ValueHook) -> None:
        """`change(e, x)` gives what the sensor of the column reads, before its scale and bias."""
        self._hooks.readings.setdefault(column, []).append(self._guarded(change))

    def _guarded(self, change: Callable) -> Callable:
        def hook(e: Evaluation, x: object) -> object:
            return change(e, x) if self.active(e) else x

        return hook


def _unreadable(e: Evaluation, reads: Mapping[str, Callable[[Evaluation], Value]]) -> list[str]:
    late = []
    for name, read in reads.items():
        try:
            read(e)
        except KeyError:
            late.append(name)
    return late


class _SizedPlace(Place):
    """A site of an effect whose size is no parameter but what `size` gives; other coefficients are as absent."""

    def __init__(
        self,
        network: Network,
        effect: Effect,
        hooks: Hooks,
        size: Callable[[Evaluation], Value],
        active: Callable[[Evaluation], bool],
    ):
        super().__init__(network, effect, hooks)
        self._size, self._there = size, active
        self._values = {c.name: c.absent for c in effect.term.COEFFICIENTS}

    def c(self, e: Evaluation, coefficient: str) -> Value:
        known = self._values[coefficient]
        sought = self.effect.parameter_name(coefficient) in self._absent
        return known + self._size(e) if sought else known

    def active(self, e: Evaluation) -> bool:
        return self._there(e)
