"""Truth engines that are not the model: their maps, cooling and gas differ a little.

Every turbomachine's flow capacity and efficiency are changed by a smooth factor of its corrected speed
n = (N/√T)/(N/√T)_design and, for compressors, of its corrected flow w = W√T/P over that of the design point:

    1 + s·[a₁ sin(2π f (n − 1) + φ) + a₂ tanh((n − n₀)/0.08) + a₃ (w − n)/0.1] − (the same at the design point)

with a ~ N(0, 1)/√(3/2), s = 0.3 % (flow) and 0.15 % (efficiency); turbines, which have no such w, have the slope
a₃ (n − 1)/0.1 in its place. Cooling and bleed fractions of the core flow change by up to ±0.8 % of the core flow in
total, and the gas constant by up to ±0.05 %, as that much water in the air makes it: R = R_air (1 + 0.608 w).

No term of this file is in the registry: an explainer cannot find it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.drivers import CORRECTED_SPEED
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.components.compressor import Compressor
from enginediag_cli.engine.components.turbine import Turbine
from enginediag_cli.engine.dual import Value, chain, sqrt, value
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Effect, Place, Site, Term

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network

FLOW, EFFICIENCY = 0.003, 0.0015
"""s of the equation above: what a map of the same type is usually known to."""
COOLING, GAS_CONSTANT = 0.008, 0.0005
"""Largest change of the cooling and bleed flows, as a share of the core flow, and of the gas constant."""
WATER = 0.608  # ∂ln R/∂w of humid air, w in kg per kg of dry air
WIDTH, SPREAD = 0.08, 0.1
"""Of the kink in n, and of the working line in w − n: scales in the equation above."""


@dataclass(frozen=True)
class MapErrors:
    """What is wrong with the model, as effects to carry, parameters to change and water in the air [kg/kg]."""

    effects: tuple[Effect, ...]
    parameters: Mapping[str, float]
    water: float


def draw_map_errors(engine: Engine, rng: np.random.Generator) -> MapErrors:
    """Map errors of every turbomachine, cooling and gas of one truth engine."""
    found = []
    for c in engine.network.components:
        if isinstance(c, Compressor | Turbine):
            for quantity, size in (("flow_capacity", FLOW), ("efficiency", EFFICIENCY)):
                found.append(_drawn(c.name, quantity, size, rng))
    fractions = [
        n for n, p in engine.parameters.items() if p.family == "design" and p.quantity == "fraction" and p.nominal > 0
    ]
    total = sum(engine.parameters[n].nominal for n in fractions)
    change = rng.uniform(-COOLING, COOLING)
    parameters = {n: engine.parameters[n].nominal * (1.0 + change / total) for n in fractions}
    return MapErrors(tuple(found), parameters, float(rng.uniform(-GAS_CONSTANT, GAS_CONSTANT)) / WATER)


def _drawn(component: str, quantity: str, size: float, rng: np.random.Generator) -> Effect:
    wave, kink, twist = size * rng.standard_normal(3) / np.sqrt(1.5)
    term = MapError(
        quantity,
        Shape(
            float(wave),
            float(rng.uniform(1.5, 4.0)),
            float(rng.uniform(0.0, 2.0 * np.pi)),
            float(kink),
            float(rng.uniform(0.75, 1.0)),
            float(twist),
        ),
    )
    return Effect(term, Site(component, component, (f"{component}.{quantity}",)), {"present": 1.0})


@dataclass(frozen=True)
class Shape:
    """a₁, f, φ, a₂, n₀, a₃ of the equation above, the a with s in them."""

    wave: float
    frequency: float
    phase: float
    kink: float
    middle: float
    twist: float

    def of(self, n: Value, position: Value) -> Value:
        """The error at a corrected speed over that of the design point; `position` is 0 there."""
        turn = 2.0 * np.pi * self.frequency
        angle, rise = turn * (value(n) - 1.0) + self.phase, np.tanh((value(n) - self.middle) / WIDTH)
        at_design = self.wave * np.sin(self.phase) + self.kink * np.tanh((1.0 - self.middle) / WIDTH)
        curve = self.wave * np.sin(angle) + self.kink * rise - at_design
        slope = self.wave * turn * np.cos(angle) + self.kink * (1.0 - rise**2) / WIDTH
        return chain(curve, (slope, n)) + position * (self.twist / SPREAD)


class MapError(Term):
    """A smooth factor on one health parameter of a turbomachine."""

    TITLE = "Map error"
    STATEMENT = "The component's map is a little different from the model's."
    EQUATION = "factor = 1 + error(n, w)"
    DRIVER = CORRECTED_SPEED
    COEFFICIENTS = (Coefficient("present", "1", "1 where the error is there", 0.0, 0.0, 1.0, 1.0, 1.0),)
    REFERENCE = "none: drawn"

    def __init__(self, quantity: str, shape: Shape):
        self.NAME = f"map_error_{quantity}"
        self.quantity, self.shape = quantity, shape

    def sites(self, network: Network) -> Iterable[Site]:
        for c in network.components:
            if isinstance(c, Compressor | Turbine):
                yield Site(c.name, c.name, (f"{c.name}.{self.quantity}",))

    def install(self, at: Place) -> None:
        c = at.component
        assert c is not None
        station, shaft = c.values["from"], c.values["shaft"]

        def speed(e: Evaluation) -> Value:
            return e.shaft(shaft).speed_rpm / sqrt(e.flows[station].T)

        def flow(e: Evaluation) -> Value:
            f = e.flows[station]
            return f.W * sqrt(f.T) / f.P

        n_design, w_design = scalar(speed(at.design)), scalar(flow(at.design))

        def factor(e: Evaluation, x: Value) -> Value:
            n = speed(e) * (1.0 / n_design)
            compressor = isinstance(c, Compressor)
            position = flow(e) * (1.0 / w_design) - n if compressor else n - 1.0
            return x * (1.0 + self.shape.of(n, position))

        at.on_leaf(f"{c.name}.{self.quantity}", factor)
