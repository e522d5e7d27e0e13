"""What every component of the network is: declared fields, parameters, unknowns, and two evaluations."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.dual import Value, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.parameters import Parameter

NAME = Field("name", "text", "name of the component, the first part of its parameters' names")
FROM = Field("from", "text", "station at its inlet")
TO = Field("to", "text", "station at its outlet")


@dataclass(frozen=True)
class Unknown:
    """A number that the balances determine; solved for as a ratio to design of order one."""

    name: str
    start: float = 1.0
    lower: float = 1e-3
    upper: float = 1e3


class Component(ABC):
    """A part of the engine. Subclasses say what they are in TYPE and SECTION and implement `evaluate`."""

    TYPE: ClassVar[str]
    SECTION: ClassVar[Section]

    def __init__(self, values: Mapping[str, Any]):
        self.values = dict(values)
        self.name: str = self.values["name"]

    def health(self, quantity: str, description: str, prior_sigma: float = 0.02) -> Parameter:
        """A scale factor of nominal 1 on what the component should do."""
        return Parameter(f"{self.name}.{quantity}", "health", 1.0, 0.5, 1.5, prior_sigma, "1", description)

    def design(
        self, quantity: str, nominal: float, sigma: float, lower: float, upper: float, unit: str, description: str
    ) -> Parameter:
        """A number of the engine type, identified rather than monitored."""
        return Parameter(f"{self.name}.{quantity}", "design", nominal, lower, upper, sigma, unit, description)

    def inputs(self) -> dict[str, float | None]:
        """Input columns that it reads, with the default of those that may be left out."""
        return {}

    def parameters(self) -> tuple[Parameter, ...]:
        return ()

    def unknowns(self) -> tuple[Unknown, ...]:
        return ()

    @abstractmethod
    def evaluate(self, e: Evaluation) -> None:
        """Reads its inlet flows from `e`, writes its outlet flows, powers and balances."""

    def size(self, e: Evaluation) -> None:
        """Sets its design references (areas, map scales) at the design point, then evaluates itself there."""
        self.evaluate(e)


def scalar(x: Value) -> float:
    """The number of a one-point evaluation."""
    return float(np.ravel(value(x))[0])
