"""Inlet: pressure recovery, and the engine's air flow as an unknown."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.atmosphere import P_ISA, T_ISA
from enginediag_cli.engine.components.base import FROM, NAME, RECOVERY_ROAMS, TO, Component, Design, Unknown
from enginediag_cli.engine.dual import Value, chain, sqrt, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.parameters import Parameter


class Inlet(Component):
    """P_out = recovery · P_in − ΔP_inlet; W = x · W_corrected,design · δ/√θ with x unknown.

    The recovery is one number, or a table against Mach number read linearly or in steps. A measured
    inlet (filter) loss may be an input column, `dP_inlet_Pa`.
    """

    TYPE = "inlet"
    SECTION = Section(
        "inlet",
        "inlet of the engine",
        (
            NAME,
            FROM,
            TO,
            Field("corrected_flow_kg_s", "number", "corrected air flow at the design point", unit="kg/s", minimum=1e-6),
            Field("pressure_recovery", "number", "total pressure recovery", 1.0, minimum=0.5, maximum=1.0),
            Field("recovery_mach", "numbers", "Mach numbers of a recovery table", ()),
            Field("recovery_table", "numbers", "total pressure recovery at these Mach numbers, a factor", ()),
            Field("recovery_rule", "choice", "how the table is read", "linear", choices=("linear", "step")),
            Field("measured_loss", "boolean", "the input column dP_inlet_Pa gives the inlet pressure loss", False),
        ),
    )

    def __init__(self, values: Mapping[str, Any]):
        super().__init__(values)
        self.mach = np.asarray(self.values["recovery_mach"], dtype=float)
        self.recovery = np.asarray(self.values["recovery_table"], dtype=float)
        if self.mach.size == 1 or self.mach.size != self.recovery.size or (np.diff(self.mach) <= 0.0).any():
            raise ValueError(
                f"{self.name}: recovery_mach must rise, with one recovery_table value for each, at least two"
            )

    def inputs(self) -> dict[str, float | None]:
        return {"dP_inlet_Pa": None} if self.values["measured_loss"] else {}

    def parameters(self) -> tuple[Parameter, ...]:
        return (
            self.design(
                "pressure_recovery",
                Design(self.values["pressure_recovery"], 0.005, 0.8, 1.02, roams=RECOVERY_ROAMS),
                "1",
                "inlet total pressure recovery",
            ),
        )

    def unknowns(self) -> tuple[Unknown, ...]:
        return (Unknown(f"{self.name}.corrected_flow", lower=0.02, upper=3.0, is_flow=True),)

    def evaluate(self, e: Evaluation) -> None:
        upstream = e.flows[self.values["from"]]
        recovery = e[f"{self.name}.pressure_recovery"]
        if self.mach.size:
            recovery = recovery * self._table(e["mach"])
        P: Value = upstream.P * recovery
        if self.values["measured_loss"]:
            P = P - e["dP_inlet_Pa"]
        flow = upstream.with_(P=P)
        e.theta2, e.delta2 = flow.T * (1.0 / T_ISA), P * (1.0 / P_ISA)
        flow.W = e[f"{self.name}.corrected_flow"] * (self.values["corrected_flow_kg_s"] * e.delta2 / sqrt(e.theta2))
        e.flows[self.values["to"]] = flow
        e.outputs["ram_drag_N"] = flow.W * e.outputs["V0_m_s"]

    def _table(self, mach: Value) -> Value:
        M = np.asarray(value(mach))
        if self.values["recovery_rule"] == "step":
            return self.recovery[np.clip(np.searchsorted(self.mach, M + 1e-9, side="right") - 1, 0, None)]
        slope = np.diff(self.recovery) / np.diff(self.mach)
        cell = np.clip(np.searchsorted(self.mach, M, side="right") - 1, 0, len(slope) - 1)
        inside = (self.mach[0] <= M) & (self.mach[-1] >= M)
        return chain(np.interp(M, self.mach, self.recovery), (np.where(inside, slope[cell], 0.0), mach))
