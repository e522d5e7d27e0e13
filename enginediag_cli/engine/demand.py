"""What is asked of an engine by a set point that is recorded: a table from its column to the power setting."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.dual import Array
from enginediag_cli.parameters import Parameter, spelled
from enginediag_cli.units import split_column

DEMAND = Section(
    "power demand",
    "the power setting as a recorded set point asks for it: straight lines through the points of a table, which can be "
    "identified, and on beyond its ends",
    (
        Field("column", "text", "column of the set point, such as input_voltage_V"),
        Field("at", "numbers", "set points of the table, rising, in the column's unit"),
        Field("asks", "numbers", "power setting that each of them asks for, in the power setting's unit"),
        Field("sigma", "number", "standard deviation of the prior of each point, in the power setting's unit", None),
    ),
)
SIGMA_SHARE = 0.1
"""Of the largest power setting of the table, where no `sigma` is given. Judgement: a table read off a data sheet."""
LEAST_POINTS = 2
"""Of a straight line."""
LOWEST_SHARE, HIGHEST_SHARE = 0.001, 2.0
"""Bounds of a point of the table, as shares of the largest: an engine that runs is asked for some power."""


@dataclass(frozen=True)
class Demand:
    """setting(x) through points (xᵢ, pᵢ); the pᵢ are parameters `power_demand.point_i`, counted from 1."""

    column: str
    setting: str
    points: tuple[tuple[float, float], ...]
    sigma: float | None = None

    @classmethod
    def declared(cls, values: Mapping[str, Any], setting: str) -> Demand:
        """From the checked section. Raises ValueError for tables that are none."""
        at, asks = values["at"], values["asks"]
        if len(at) != len(asks) or len(at) < LEAST_POINTS:
            raise ValueError(
                f"`at` has {len(at)} set points and `asks` {len(asks)}: two of each at least, as many of both"
            )
        if not all(a < b for a, b in pairwise(at)):
            raise ValueError("the set points under `at` must rise")
        if min(asks) <= 0.0:
            raise ValueError(f"every {setting} under `asks` must be above 0")
        if split_column(values["column"])[1] == "":
            raise ValueError(f"the column '{values['column']}' has no unit in its name, such as input_voltage_V")
        return cls(values["column"], setting, tuple(zip(at, asks, strict=True)), values["sigma"])

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"power_demand.point_{k}" for k in range(1, len(self.points) + 1))

    def parameters(self) -> tuple[Parameter, ...]:
        unit = split_column(self.setting)[1]
        what, of = split_column(self.column)
        largest = max(abs(p) for _, p in self.points)
        sigma = SIGMA_SHARE * largest if self.sigma is None else self.sigma
        return tuple(
            Parameter(
                name,
                "design",
                p,
                LOWEST_SHARE * largest,
                HIGHEST_SHARE * largest,
                sigma,
                unit,
                f"{self.setting} asked for at {x:g} {of} of {what}",
                "power_demand",
                f"point_{k}",
                f"power demand at {x:g} {of}",
                spelled("power_demand"),
            )
            for k, (name, (x, p)) in enumerate(zip(self.names, self.points, strict=True), start=1)
        )

    def set_point(self, setting: Array) -> Array:
        """The set point that asks for a power setting (N,), by the table as it is stated; at its ends beyond them."""
        x, p = zip(*self.points, strict=True)
        order = np.argsort(p)
        return np.interp(setting, np.array(p)[order], np.array(x)[order])

    def __call__(self, x: Array, theta: Mapping[str, Any]) -> tuple[Array, dict[str, Array], Array]:
        """Power setting at set points (N,), its derivatives (N,) by each of `names`, and by the set point."""
        at = np.array([x for x, _ in self.points])
        p = np.stack(np.broadcast_arrays(*(np.asarray(theta[n], float) for n in self.names)))
        k = np.clip(np.searchsorted(at, x, side="right") - 1, 0, len(at) - 2)
        share = (x - at[k]) / (at[k + 1] - at[k])
        low, high = (p[k], p[k + 1]) if p.ndim == 1 else (p[k, np.arange(len(x))], p[k + 1, np.arange(len(x))])
        slopes = {
            name: np.where(k == i, 1.0 - share, 0.0) + np.where(k + 1 == i, share, 0.0)
            for i, name in enumerate(self.names)
        }
        return low + share * (high - low), slopes, (high - low) / (at[k + 1] - at[k])
