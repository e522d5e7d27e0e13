"""What restoring a module brings at equal power, and what a change of several parameters did.

With δ the change of the parameters, δ_m that of the module m, and y temperature or fuel at given power,

    gain_m = y(θ0 + δ) − y(θ0 + δ with δ_m = 0),     variance gᵀ C g,   g = ∂gain_m/∂δ,

positive where restoring lowers y; C the posterior covariance of δ. Both terms are solutions of the engine, and g their
exact derivatives.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.work_scope.equal_power import at_equal_power
from enginediag_cli.work_scope.reference import Reference


@dataclass(frozen=True)
class Moments:
    """Mean (k,) of the changes of parameters `names`, in their units, and covariance (k, k)."""

    names: tuple[str, ...]
    mean: np.ndarray
    covariance: np.ndarray

    def of(self, names: Sequence[str]) -> Moments:
        """The same of some of them, in their order."""
        at = [self.names.index(n) for n in names]
        return Moments(tuple(names), self.mean[at], self.covariance[np.ix_(at, at)])


@dataclass(frozen=True)
class Quantity:
    """A gain in the column's unit with its standard deviation; `share`: of the present value."""

    value: float
    deviation: float
    share: float
    share_deviation: float


@dataclass(frozen=True)
class Gain:
    """What restoring `module`, with the parameters `names`, lowers temperature and fuel by at equal power."""

    module: str
    names: tuple[str, ...]
    temperature: Quantity
    fuel: Quantity


def gains(
    engine: Engine,
    reference: Reference,
    base: Mapping[str, float],
    change: Moments,
    modules: Mapping[str, Sequence[str]],
) -> tuple[Gain, ...]:
    """Gain of restoring each module, name -> its parameters among those of `change`, the largest in temperature first.

    Raises PowerNotHeldError.
    """
    if not modules:
        return ()
    states = [change.mean]
    kept = []
    for names in modules.values():
        rest = np.array([n not in names for n in change.names], bool)
        kept.append(rest)
        states.append(np.where(rest, change.mean, 0.0))
    found = at_equal_power(engine, reference, base, change.names, np.array(states))
    told = []
    for k, (module, names) in enumerate(modules.items(), start=1):
        gain = found.y[0] - found.y[k]
        slopes = found.slopes[0] - found.slopes[k] * kept[k - 1]
        told.append(_gain(module, tuple(names), gain, slopes, found.y[0], change.covariance))
    return tuple(sorted(told, key=lambda g: -abs(g.temperature.value)))


def brought(
    engine: Engine, reference: Reference, base: Mapping[str, float], before: np.ndarray, difference: Moments
) -> Gain:
    """What the change `difference` from the level `before` (k,) did lower temperature and fuel by at equal power.

    Raises PowerNotHeldError.
    """
    states = np.array([before, before + difference.mean])
    found = at_equal_power(engine, reference, base, difference.names, states)
    gain = found.y[0] - found.y[1]
    return _gain("", difference.names, gain, -found.slopes[1], found.y[0], difference.covariance)


def _gain(
    module: str, names: tuple[str, ...], gain: np.ndarray, slopes: np.ndarray, now: np.ndarray, C: np.ndarray
) -> Gain:
    """gain, now (2,); slopes (2, k) of the gain; C (k, k)."""
    deviation = np.sqrt(np.maximum(np.einsum("yi,ij,yj->y", slopes, C, slopes), 0.0))
    temperature, fuel = (
        Quantity(float(v), float(s), float(v / y), float(s / y)) for v, s, y in zip(gain, deviation, now, strict=True)
    )
    return Gain(module, names, temperature, fuel)
