"""The answer of an engine: values, derivatives and the status of every point."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.engine.dual import Array, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.gas import T_LIMIT
from enginediag_cli.engine.moving.recall import Known

OK, OUTSIDE_MAP, NOT_CONVERGED, INVALID_INPUT = range(4)
"""Status of a point, the better the smaller: up to OUTSIDE_MAP it has values."""
STATUS = ("ok", "outside the maps", "did not converge", "invalid input")


@dataclass(frozen=True)
class Prediction:
    """Φ at N points: y (N, m), jacobian (N, m, p), status (N,) as in STATUS; y is NaN where status > 1. `also` (N, k):
    further columns that were asked for, values only. `limits`: limits and stops of controls that act somewhere → where
    (N,)."""

    y: Array
    jacobian: Array
    status: Array
    columns: tuple[str, ...]
    wrt: tuple[str, ...]
    x: Array
    residual: Array
    passes: Array
    also: Array
    _reasons: Mapping[int, str]
    limits: Mapping[str, Array] = field(default_factory=dict)

    @property
    def active_limit(self) -> Array:
        """Names (N,) of the limits and stops that act, joined by `+`; empty where every control holds what it is to."""
        told = np.full(len(self.status), "", dtype=object)
        for name, mask in self.limits.items():
            told[mask] = np.array([f"{t}+{name}" if t else name for t in told[mask]], dtype=object)
        return told.astype(str)

    @property
    def ok(self) -> Array:
        """Points whose values can be used (N,)."""
        return self.status <= OUTSIDE_MAP

    def reason(self, k: int) -> str:
        """Why point k is flagged: the component or the balance; empty where all is well."""
        return self._reasons.get(k, "")


def through(found: Prediction, known: Mapping[str, Known], wrt: tuple[str, ...]) -> Prediction:
    """Derivatives along `wrt` through leaves that were known beforehand, which were directions of their own."""
    J = found.jacobian[:, :, : len(wrt)].copy()
    at = {n: j for j, n in enumerate(found.wrt)}
    for leaf, of in known.items():
        for j, n in enumerate(wrt):
            if n in of.slopes:
                J[:, :, j] += found.jacobian[:, :, at[leaf]] * of.slopes[n][:, None]
    return replace(found, jacobian=J, wrt=wrt)


def marked(e: Evaluation) -> dict[str, Array]:
    """Components met outside their maps, and temperatures outside the gas data; masks (N,)."""
    marked = {what: np.broadcast_to(mask, (e.size,)) for what, mask in e.outside.items() if np.any(mask)}
    beyond = np.zeros(e.size, dtype=bool)
    for flow in e.flows.values():
        if flow.known_temperature is not None:
            T = value(flow.known_temperature)
            if not (np.max(T) <= T_LIMIT[1] and np.min(T) >= T_LIMIT[0]):
                beyond |= (T > T_LIMIT[1]) | (T < T_LIMIT[0])
    if beyond.any():
        marked["the gas data"] = beyond
    return marked
