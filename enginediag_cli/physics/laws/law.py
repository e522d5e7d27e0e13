"""A law: an effect that is stated by a formula, as an engine file may carry it.

    θ → θ (1 + f)    where θ is a factor of nominal 1 (an efficiency, a flow capacity, the scale of a reading)
    θ → θ + f        any other parameter, and a reading; f in its unit
    an effect of the library, of size absent + f, where the law acts at the size of an effect

f is a formula of variables and coefficients. What a variable that lies further down the gas path than the parameter is,
is an unknown of the network, and that it is so is its balance. What remembers in it (`followers`) is a memory of the
engine, as of any effect.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from enginediag_cli.drivers import CONSTANT
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.moving.tape import PAST
from enginediag_cli.engine.term import Coefficient, Effect, Place, Site, Term
from enginediag_cli.physics.laws.expression import Expression
from enginediag_cli.physics.laws.followers import Followed
from enginediag_cli.physics.laws.variables import Variable

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


@dataclass(frozen=True)
class Acts:
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
            return Site(self.leaf, self.component, self.through.site.acts_on)
        return Site(self.leaf, self.component, (f"reading {self.leaf}" if self.reading else self.leaf,))


class Law(Term):
    """`expression` f of `variables` and `coefficients`, at `acts`; `changed`: what the place is with f."""

    OF_A_FILE = True

    def __init__(
        self,
        name: str,
        acts: Acts,
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
        self.STATEMENT = statement or f"Law at {acts.leaf} that varies with {self.varies_with()}."
        self.changed = f"{acts.leaf} (1 + f)" if acts.factor else f"{acts.leaf} + f"
        if acts.through is not None:
            self.INPUTS = acts.through.term.INPUTS
        if expression.followed:
            self.INPUTS = {**self.INPUTS, **PAST}
        self.EQUATION = f"{self.changed},  f = {expression.text}"
        self.DRIVER = next((v.driver for v in self.variables.values()), CONSTANT)
        self.REFERENCE = reference or "the engine file that states it"

    @property
    def one_sided(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(n for k in self.expression.followed for n in k.by))

    def varies_with(self) -> str:
        """All that its formula has."""
        return ", ".join(v.words for v in self.variables.values()) or CONSTANT.words

    def sites(self, network: Network) -> Iterable[Site]:
        yield self.acts.site

    def install(self, at: Place) -> None:
        f = self._formula(at, self._reads(at))

        def change(e: Evaluation, x: Value) -> Value:
            return x * (1.0 + f(e)) if self.acts.factor else x + f(e)

        if self.acts.through is not None:
            at.sized(self.acts.through, f)
        elif self.acts.reading:
            at.on_reading(self.acts.leaf, change)
        else:
            at.on_leaf(self.acts.leaf, change)

    def _reads(self, at: Place) -> dict[str, str]:
        """Leaf of the unknown by the name of each variable that is not known yet where the law acts."""
        if self.acts.reading or not self.variables:
            return {}
        reads = {n: partial(v.at, network=at.network) for n, v in self.variables.items()}
        through = self.acts.through
        late = at.not_yet(self.acts.leaf, reads) if through is None else at.not_yet_of(through, reads)
        return {n: at.solved_for(n, reads[n], self.variables[n].reference) for n in late}

    def _formula(self, at: Place, unknown: Mapping[str, str]) -> Callable[[Evaluation], Value]:
        names = tuple(c.name for c in self.COEFFICIENTS if c.name in self.expression.names)
        remembered = {k: at.follow(k.filter, k.by, self.acts.leaf) for k in self.expression.followed}

        def f(e: Evaluation) -> Value:
            def past(of: Followed, signal: Value, values: Mapping[str, Value]) -> Value:
                return remembered[of](e, signal)

            values = {n: e[unknown[n]] if n in unknown else v.at(e, at.network) for n, v in self.variables.items()}
            return self.expression.at(values | {n: at.c(e, n) for n in names}, past)

        return f
