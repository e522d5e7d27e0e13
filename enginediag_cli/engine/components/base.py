"""The base class of components: declared fields, parameters, unknowns, and two evaluations."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.dual import Value, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.parameters import Parameter, spelled

NAME = Field("name", "text", "name of the component, the first part of its parameters' names")
FROM = Field("from", "text", "station at its inlet")
TO = Field("to", "text", "station at its outlet")

HEALTH_ROAMS = 0.02
"""How far (rms) a scale factor may plausibly vary along a driver: physics that a model lacks makes per cents."""
PART_ROAMS = 0.3
"""The same of a loss, an area or a bleed, as a part of itself."""
LEAST_BLEED = 0.01
"""A bleed that is smaller, or closed, may still vary like one of this share of the flow."""
WIDEST_OPENING = 3.0
"""Of a valve whose stated fraction is the usual one, not that of the valve fully open: no more is expected."""
RECOVERY_ROAMS = 0.01
"""The same of a pressure recovery, which is near 1 whatever happens."""


class Design(NamedTuple):
    """Nominal value of a design number, the standard deviation of its prior, and its bounds.

    `roams`: how far it may vary along a driver where physics is missing; `part`: by PART_ROAMS of itself. With neither
    no search looks there. `switches`: as in `Parameter`.
    """

    nominal: float
    sigma: float
    lower: float
    upper: float
    roams: float | None = None
    part: bool = False
    switches: bool = False


@dataclass(frozen=True)
class Unknown:
    """A number that the balances determine; solved for as a ratio to design of order one. `is_flow`: it is the air
    flow of the engine, which grows with power."""

    name: str
    start: float = 1.0
    lower: float = 1e-3
    upper: float = 1e3
    is_flow: bool = False


@dataclass(frozen=True)
class Actuator:
    """A position that a control, a schedule or a recorded column may set: leaf `name`, in `unit`; it is
    `neutral` where nothing sets it, and no mechanism moves it beyond `lower` and `upper`. `words`: as an engineer
    says it ("HPC guide vanes, closing")."""

    name: str
    unit: str
    neutral: float
    lower: float
    upper: float
    words: str


class Component(ABC):
    """A part of the engine. Subclasses say what they are in TYPE and SECTION and implement `evaluate`."""

    TYPE: ClassVar[str]
    SECTION: ClassVar[Section]

    def __init__(self, values: Mapping[str, Any]):
        self.values = dict(values)
        self.name: str = self.values["name"]

    def health(
        self, quantity: str, description: str, prior_sigma: float = 0.02, *, words: str = "", wear: int = 0
    ) -> Parameter:
        """A scale factor of nominal 1 on what the component should do; a search may move it by HEALTH_ROAMS.

        words: the quantity as an engineer says it ("isentropic efficiency"), default its name with spaces; wear:
        the sign of `Parameter`.
        """
        name, meaning = f"{self.name}.{quantity}", self._words(quantity, words)
        return Parameter(
            name,
            "health",
            1.0,
            0.5,
            1.5,
            prior_sigma,
            "1",
            description,
            self.name,
            quantity,
            meaning,
            spelled(self.name),
            wear,
            HEALTH_ROAMS,
        )

    def design(
        self,
        quantity: str,
        number: Design,
        unit: str,
        description: str,
        *,
        words: str = "",
        wear: int = 0,
        of: str = "",
    ) -> Parameter:
        """A number of the engine type, identified rather than monitored; `words` and `wear` as for `health`; `of`: the
        part of the component that it belongs to, such as a bleed port."""
        whole = f"{of}.{quantity}" if of else quantity
        nominal, sigma, lower, upper, roams, part, switches = number
        return Parameter(
            f"{self.name}.{whole}",
            "design",
            nominal,
            lower,
            upper,
            sigma,
            unit,
            description,
            self.name,
            quantity,
            self._words(whole, words),
            spelled(self.name),
            wear,
            PART_ROAMS * abs(nominal or sigma) if part else roams,
            part,
            switches,
        )

    def _words(self, quantity: str, words: str) -> str:
        return f"{spelled(self.name)} {words or spelled(quantity)}"

    def inputs(self) -> dict[str, float | None]:
        """Input columns that it reads, with the default of those that are optional."""
        return {}

    def parameters(self) -> tuple[Parameter, ...]:
        return ()

    def unknowns(self) -> tuple[Unknown, ...]:
        return ()

    def actuators(self) -> tuple[Actuator, ...]:
        """What of it may be moved in operation; `evaluate` reads the position as a leaf, which is always there."""
        return ()

    @abstractmethod
    def evaluate(self, e: Evaluation) -> None:
        """Reads its inlet flows from `e`, writes its outlet flows, powers and balances."""

    def design_inputs(self) -> dict[str, float]:
        """Its own input columns at the design point."""
        return {}

    def size(self, e: Evaluation) -> None:
        """Sets its design references (areas, map scales) at the design point, then evaluates itself there."""
        self.evaluate(e)

    def converged(self) -> bool:
        """Whether what it assumed in sizing has come out; otherwise all are sized once more."""
        return True


VALVE = Field(
    "valve",
    "choice",
    "moved by the actuator <component>.<port>.opening: `throttle` starts at 1, the stated fraction; `closed` at 0, and "
    "the fraction is that of the open valve (a handling bleed)",
    "none",
    choices=("none", "throttle", "closed"),
)


class Valves(Component):
    """A component whose `ports` may have valves."""

    def actuators(self) -> tuple[Actuator, ...]:
        return tuple(
            Actuator(
                f"{self.name}.{port['name']}.opening",
                "1",
                0.0 if port["valve"] == "closed" else 1.0,
                0.0,
                1.0 if port["valve"] == "closed" else WIDEST_OPENING,
                self._words(f"{port['name']}.opening", f"{spelled(port['name'])} valve, opening"),
            )
            for port in self.values["ports"]
            if port["valve"] != "none"
        )

    def bled(self, e: Evaluation, port: Mapping[str, Any]) -> Value:
        """Share of the flow that a port takes."""
        fraction = e[f"{self.name}.{port['name']}.fraction"]
        return fraction if port["valve"] == "none" else fraction * e[f"{self.name}.{port['name']}.opening"]


def scalar(x: Value) -> float:
    """The number of a one-point evaluation."""
    return float(np.ravel(value(x))[0])
