"""Sensors: what a recorded column shows of the model's outputs.

reading = scale · (Σ weights · model columns [/ model column]) + bias + soak · driver
"""

from __future__ import annotations

import operator
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.network import Network
from enginediag_cli.parameters import FARTHEST_READING, Parameter
from enginediag_cli.units import split_column

READING_ROAMS = 0.02
"""How far (rms) a sensor's scale may plausibly vary along a driver, where physics of the reading is missing."""


@dataclass(frozen=True)
class Sensor:
    """One measured output; numbers in the column's unit."""

    column: str
    quantity: str
    unit: str
    noise_sigma: float
    maximum: float | None
    reads: Mapping[str, float]
    over: str | None
    bias_sigma: float
    scale_sigma: float
    soak: str | None
    soak_sigma: float

    @staticmethod
    def declared(column: str, values: Mapping[str, Any]) -> Sensor:
        quantity, unit = split_column(column)
        bias = values["bias_sigma"]
        return Sensor(
            column,
            quantity,
            unit,
            values["noise_sigma"],
            values["maximum"],
            {k: float(v) for k, v in (values["reads"] or {column: 1.0}).items()},
            values["over"],
            3.0 * values["noise_sigma"] if bias is None else bias,
            values["scale_sigma"],
            values["soak"],
            values["soak_sigma"],
        )

    def parameters(self, largest: float = 0.0) -> tuple[Parameter, ...]:
        """Its errors; `largest`: largest reading that was seen, in its unit, 0 where that is not known."""
        size = largest or self.maximum or float("inf")
        q = f"sensor.{self.quantity}"
        part = f"{self.quantity} sensor"
        big = 1e3 * max(self.bias_sigma, self.noise_sigma, 1e-12)
        found = [
            Parameter(
                f"{q}.bias",
                "sensor",
                0.0,
                -big,
                big,
                self.bias_sigma,
                self.unit or "1",
                f"{self.quantity} sensor bias",
                q,
                "bias",
                f"{self.quantity} sensor bias",
                part,
                reach=FARTHEST_READING * size / self.bias_sigma if self.bias_sigma else float("inf"),
            ),
            Parameter(
                f"{q}.scale",
                "sensor",
                1.0,
                0.5,
                1.5,
                self.scale_sigma,
                "1",
                f"{self.quantity} sensor scale",
                q,
                "scale",
                f"{self.quantity} sensor scale factor",
                part,
                roams=READING_ROAMS,
                reach=FARTHEST_READING / self.scale_sigma if self.scale_sigma else float("inf"),
            ),
        ]
        if self.soak:
            found.append(
                Parameter(
                    f"{q}.soak",
                    "sensor",
                    0.0,
                    -1e3 * self.soak_sigma,
                    1e3 * self.soak_sigma,
                    self.soak_sigma,
                    f"{self.unit} per {self.soak}",
                    f"heat soak of the {self.quantity} reading",
                    q,
                    "soak",
                    f"{self.quantity} soak",
                    part,
                )
            )
        return tuple(found)

    def read(self, network: Network, e: Evaluation) -> Value:
        """The reading without noise, (N,)."""
        total: Value = 0.0
        for column, weight in self.reads.items():
            x = network.read(e, column)
            total = total + (x if weight == 1.0 else x * weight)
        if self.over:
            total = total / network.read(e, self.over)
        if e.hooks is not None:
            total = e.hooks.reading(e, self.column, total)
        q = f"sensor.{self.quantity}"
        for name, nothing, apply in ((f"{q}.scale", 1.0, operator.mul), (f"{q}.bias", 0.0, operator.add)):
            p = e[name]
            if not (isinstance(p, float) and p == nothing):
                total = apply(total, p)
        if self.soak and self.soak in e.leaves:
            total = total + e[f"{q}.soak"] * e[self.soak]
        return total
