"""In which unit a change is shown: a scale factor in per cent, all else in its own unit. As in sentences."""

from __future__ import annotations

from enginediag_cli.parameters import Parameter

PERCENT = 100.0
"""Of a scale factor."""


def scale_of(parameter: Parameter) -> tuple[float, str]:
    """(factor, unit) of a change of this parameter, as `sentences.change` tells it."""
    unit = parameter.shown_unit
    added = bool(unit) or (parameter.of_instrument and parameter.quantity == "bias")
    return (1.0, unit) if added else (PERCENT, "%")
