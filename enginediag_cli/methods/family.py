"""Any family of residuals: parity equations, observers, principal components, parameter estimation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.methods.answers import Answers
from enginediag_cli.methods.evidence import Evidence
from enginediag_cli.methods.families.registry import FAMILIES

SECTION = Section(
    "family",
    "a family of residuals, with its own detection and isolation",
    (Field("family", "choice", "which", choices=tuple(FAMILIES)),),
)


def answer(evidence: Evidence, options: Mapping[str, Any]) -> Answers:
    """Families that name sensors, not parameters, or nothing, are judged on detection only."""
    monitor = evidence.monitor
    result = evidence.trained(options["family"]).diagnose(evidence.windows, evidence.false_alarm)
    isolated = None
    if result.isolated is not None and result.kind == "parameters":
        position = [monitor.names.index(name) for name in result.names]
        isolated = np.zeros((evidence.windows.count, len(monitor.names)), bool)
        isolated[:, position] = result.isolated
    return Answers(result.judged, result.alarm, isolated, np.full(evidence.windows.count, np.nan))
