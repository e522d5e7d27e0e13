"""How well an engine fits recordings, with a law and without: what laws are compared by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.errors import EngineDiagError
from enginediag_cli.identification.identify import identify
from enginediag_cli.identification.problem import TrainingRecording
from enginediag_cli.mismatch.fit.evidence import Flight

BLOCKS = 16
"""Runs of records, of which each says for itself which engine fits better: hours of a day say the same."""
COMPARED = 1200
"""Records, evenly chosen, to which engines are fitted to be compared."""


@dataclass(frozen=True)
class Fitted:
    """`left` (m, BLOCKS): ln root mean square of what the fit leaves of each sensor, in σ as stated, NaN where nothing
    was read; `values` and `errors` of what was identified; `converged`, else `reason`."""

    sensors: tuple[str, ...]
    left: np.ndarray
    values: dict[str, float]
    errors: dict[str, float]
    converged: bool
    reason: str

    @property
    def level(self) -> float:
        """Mean over sensors and blocks: two engines differ in it by the mean ln of the ratio of their errors."""
        return float(np.nanmean(self.left))


def fitted(engine: Engine, flights: Sequence[Flight], compared: int | None = COMPARED) -> Fitted | None:
    """The engine identified on the flights, by the file's own settings; None where it has no prediction."""
    total = sum(map(len, flights))
    step = max(1, -(-total // compared)) if compared else 1
    recordings = [
        TrainingRecording(f.label, {c: v[::step] for c, v in f.columns.items()}, engine=f.engine) for f in flights
    ]
    try:
        found = identify(engine, recordings)
    except EngineDiagError:
        return None
    p, fit = found.problem, found.fit
    sigma = np.array([engine.sensors[s].noise_sigma for s in p.sensors])
    seen = found.cross_validation.predicted
    predicted = seen if np.isfinite(seen).any() else fit.equations.predicted
    error = (p.measured - predicted) / sigma
    block = np.arange(len(error)) * BLOCKS // len(error)
    with np.errstate(all="ignore"):
        left = [[0.5 * np.log(np.nanmean(e[block == b] ** 2)) for b in range(BLOCKS)] for e in error.T]
    values = {e.name: e.value for e in found.estimates}
    errors = {e.name: e.standard_error for e in found.estimates}
    return Fitted(tuple(p.sensors), np.array(left), values, errors, found.converged, found.reason)


def gain(after: Fitted, before: Fitted) -> tuple[float, float]:
    """Mean fall of ln error, and the share of the blocks in which it falls."""
    common = [s for s in after.sensors if s in before.sensors]
    a, b = (np.array([f.left[f.sensors.index(s)] for s in common]) for f in (after, before))
    fall = np.nanmean(b - a, axis=0)
    return float(np.nanmean(fall)), float(np.mean(fall[np.isfinite(fall)] > 0.0))
