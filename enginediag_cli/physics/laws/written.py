"""A law as an entry of the `physics:` block: what `declared` reads."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from enginediag_cli.engine.term import Coefficient, Effect
from enginediag_cli.physics.laws.law import Law

DIGITS, ERROR_DIGITS = 6, 3
"""Significant digits of values, and of standard errors."""


def entry_of(effect: Effect, errors: Mapping[str, float] | None = None, source: str = "") -> dict[str, Any]:
    """The entry of an effect whose term is a law, with its values; `errors`: standard errors by parameter name.

    Raises TypeError for any other effect.
    """
    law = effect.term
    if not isinstance(law, Law):
        raise TypeError(f"{effect.label} is no law")
    block: dict[str, Any] = {"law": law.NAME, "at": law.acts.leaf, "expression": law.expression.text}
    known = errors or {}
    block["coefficients"] = {
        c.name: _coefficient(c, effect.values.get(c.name, c.absent), known.get(effect.parameter_name(c.name)))
        for c in law.COEFFICIENTS
    }
    block["statement"] = law.STATEMENT
    if effect.switch:
        block["switch"] = effect.switch
    if source:
        block["source"] = source
    return block


def _coefficient(c: Coefficient, value: float, error: float | None) -> dict[str, Any]:
    block: dict[str, Any] = {"value": _short(value)}
    if c.unit != "1":
        block["unit"] = c.unit
    if np.isfinite(c.lower):
        block["lower"] = _short(c.lower)
    if np.isfinite(c.upper):
        block["upper"] = _short(c.upper)
    if not c.free and not c.shape:
        block["absent"] = _short(c.absent)
    if not c.shape:
        block["prior_sigma"] = _short(c.sigma)
    if error is not None:
        block["standard_error"] = _short(error, ERROR_DIGITS)
    if c.description:
        block["description"] = c.description
    return block


def _short(value: float, digits: int = DIGITS) -> float:
    return float(f"{value:.{digits}g}")
