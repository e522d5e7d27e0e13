"""An engine at given power: outputs and their derivatives where the power setting follows the state of health.

With F(p, θ) what is held, thrust or power, p the power setting and y another output, p(θ) is where F(p, θ) = F*, and

    dy/dθ = ∂y/∂θ − (∂y/∂p) (∂F/∂p)⁻¹ ∂F/∂θ
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.work_scope.reference import Reference

STEPS = 15
"""Newton steps for the power setting at most."""
SETTLED = 1e-9
"""Relative error of what is held at which they end."""
LONGEST = 0.1
"""Longest step, as a share of the power setting: thrust is not straight in a spool speed."""


@dataclass(frozen=True)
class AtPower:
    """Temperature and fuel y (N, 2) of N states of an engine at equal power, their derivatives (N, 2, k) by
    parameters, and the power setting (N,)."""

    y: np.ndarray
    slopes: np.ndarray
    setting: np.ndarray


class PowerNotHeldError(ValueError):
    """The power of the healthy engine is not reached, with the reason."""


def at_equal_power(
    engine: Engine,
    reference: Reference,
    base: Mapping[str, float],
    names: Sequence[str],
    changes: np.ndarray,
) -> AtPower:
    """The states base + changes (N, k) of the parameters `names` at the power that `base` has at the reference.

    Raises PowerNotHeldError.
    """
    values = {n: v for n, v in base.items() if n in engine.parameters}
    nominal = np.array([values.get(n, engine.parameters[n].nominal) for n in names])
    healthy = engine.predict(reference.inputs, values, sensors=(reference.held,))
    if not healthy.ok[0]:
        raise PowerNotHeldError(healthy.reason(0) or "the engine cannot be computed there")
    wanted = float(healthy.y[0, 0])
    if not wanted:
        raise PowerNotHeldError(f"{reference.held} is 0 there")
    N, k = changes.shape
    theta = {**values, **{n: nominal[i] + changes[:, i] for i, n in enumerate(names)}}
    setting = np.full(N, float(reference.inputs[engine.power_setting]))
    start = None
    for _ in range(STEPS):
        inputs = {**{c: np.full(N, v) for c, v in reference.inputs.items()}, engine.power_setting: setting}
        found = engine.predict(
            inputs, theta, sensors=reference.columns, wrt=(*names, engine.power_setting), start=start
        )
        if not found.ok.all():
            raise PowerNotHeldError(found.reason(int(np.argmin(found.ok))) or "the engine cannot be computed there")
        left = found.y[:, 0] / wanted - 1.0
        J = found.jacobian
        by_setting = J[:, :, k]
        if np.all(np.abs(left) < SETTLED):
            with np.errstate(divide="ignore", invalid="ignore"):
                share = J[:, :1, :k] / by_setting[:, :1, None]
            slopes = J[:, 1:, :k] - by_setting[:, 1:, None] * np.where(np.isfinite(share), share, 0.0)
            return AtPower(found.y[:, 1:], slopes, setting)
        if not np.all(np.abs(by_setting[:, 0] * setting / wanted) > SETTLED):
            raise PowerNotHeldError(f"{reference.held} does not follow {engine.power_setting} there")
        step = -left * wanted / by_setting[:, 0]
        setting = setting + np.clip(step, -LONGEST * np.abs(setting), LONGEST * np.abs(setting))
        start = found.x
    raise PowerNotHeldError(f"{reference.held} of the healthy engine is not reached")
