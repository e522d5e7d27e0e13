"""What the effects on nozzles share: how far the pressure ratio lies below choking."""

from __future__ import annotations

from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.dual import Value, exp
from enginediag_cli.engine.evaluation import Evaluation

NPR_STATED = 1.2  # where the coefficients of the literature are given
NPR_SCALE = 0.4
"""Pressure ratio over which the effect falls to 1/e: of it a fifth is left at choking (1.85). Judgement: discharge
coefficients of the literature level off there."""


def unchoked(e: Evaluation, station: str) -> Value:
    """g = exp(−(NPR − 1.2)/0.4) with NPR = P/p₀: 1 at a pressure ratio of 1.2, 0.2 at choking, smooth throughout."""
    return exp((NPR_STATED - e.flows[station].P / e.outputs["P0_Pa"]) * (1.0 / NPR_SCALE))


def unchoked_at_design(design: Evaluation, station: str) -> float:
    return scalar(unchoked(design, station))
