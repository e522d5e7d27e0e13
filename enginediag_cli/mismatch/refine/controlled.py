"""Refinement with a control: the engine with it and without, identified on some flights and judged by others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.load import EngineDescription
from enginediag_cli.identification.nominal import SensorQuality, sensor_quality
from enginediag_cli.identification.problem import TrainingRecording
from enginediag_cli.mismatch.controlled.find import MOST_BLOCKS, ControlSearchResult
from enginediag_cli.mismatch.controlled.fitted import Errors, Fitted, fitted, gain
from enginediag_cli.mismatch.controlled.law import ControlLaw
from enginediag_cli.progress import stage

WINDOW = 12
"""Records of a stretch in which an actuator stands still while released: half a day of hours."""
LEAST_STRETCHES = 8
"""From which a standard deviation is known to a quarter."""
LEVEL = 0.01
"""Of false alarms that windows are judged by, as usual in `detect`: an actuator that is left partly closed for a day
now and then wanders by no normal law: the standard deviation is that of the one which goes as far at this level."""
HOLDS, RELEASED = "held", "released"
"""Regimes of a control, beside its stops."""


@dataclass(frozen=True)
class ControlRefinement:
    """`law` with its numbers as fitted to all flights that were, `standard_errors` by key of its entry; quality on
    unseen records by sensor, over all and by what the control does there, before and after; `fall`: mean fall of ln
    error there, in `runs` of the runs of records; `failed`: why nothing could be judged, or empty; `unconverged`:
    whether the model without the control could not be fitted, whose errors are then those where its fit ended."""

    law: ControlLaw
    standard_errors: dict[str, float]
    before: tuple[SensorQuality, ...] = ()
    after: tuple[SensorQuality, ...] = ()
    fall: float = np.nan
    runs: float = np.nan
    failed: str = ""
    unconverged: bool = False

    @property
    def accepted(self) -> bool:
        return not self.failed and self.fall > 0.0 and self.runs >= MOST_BLOCKS


@stage("fitting with and without the control")
def refine_control(
    found: ControlSearchResult,
    described: EngineDescription,
    engine: Engine,
    training: Sequence[TrainingRecording],
    unseen: Sequence[TrainingRecording],
) -> ControlRefinement:
    """The law that was found, fitted to all training flights and put to the unseen ones, beside the engine without."""
    law = found.best.law
    with_law = law.engine(described, engine.power_setting)
    after = fitted(with_law, training, compared=None)
    if after is None or not after.converged:
        reason = "no record has a prediction" if after is None else after.found.reason
        return ControlRefinement(law, found.standard_errors, failed=f"the fit with the control failed: {reason}")
    law = law.fitted(after.values)
    errors = {**found.standard_errors, **law.errors(after.standard_errors)}
    if bound := [b.name for b in after.found.bounds if b.name in law.parameters]:
        return ControlRefinement(law, errors, failed=f"{', '.join(bound)} ends at a physical bound")
    law = _with_wander(law, with_law, after)
    unseen = _decided(law, unseen)
    one, _ = found.without.unseen(engine, unseen)
    other, inputs = after.unseen(with_law, unseen)
    regimes = _regimes(with_law, law, after, inputs)
    return ControlRefinement(
        law,
        errors,
        _quality(one, regimes, engine),
        _quality(other, regimes, engine),
        *gain(other, one),
        unconverged=not found.without.converged,
    )


def _decided(law: ControlLaw, flights: Sequence[TrainingRecording]) -> list[TrainingRecording]:
    """The records of which it is told whether the control acts: of the others it says nothing."""
    if law.enabled is None:
        return list(flights)
    kept = []
    for f in flights:
        rows = law.enabled.decided(np.asarray(f.columns[law.enabled.column], dtype=float))
        kept.append(f._replace(columns={c: np.asarray(v)[rows] for c, v in f.columns.items()}))
    return kept


def _with_wander(law: ControlLaw, engine: Engine, fit: Fitted) -> ControlLaw:
    """The law with how far the actuator stands off its rest while released, from one stretch of WINDOW such records to
    the next: δ = cᵀe / cᵀc with c = ∂y/∂position and what the fit leaves, both in its noise. See LEVEL."""
    if law.enabled is None:
        return law
    problem = fit.found.problem
    released = law.enabled.released(problem.inputs[law.enabled.column])
    values = {n: v for n, v in fit.values.items() if n in engine.parameters}
    rest = law.stops["low" if law.low == law.actuator.neutral else "high"]
    inputs = {c: v[released] for c, v in problem.inputs.items()}
    found = engine.predict(inputs, values, sensors=problem.sensors, wrt=(rest,))
    sigma = fit.found.noise.sigma
    e = np.nan_to_num(fit.found.fit.equations.residual[released] / sigma)
    c = np.nan_to_num(found.jacobian[:, :, 0] / sigma) * (e != 0.0)
    count = max(len(e) // WINDOW, 1)
    stretch = np.arange(len(e)) * count // max(len(e), 1)
    above, below = (np.bincount(stretch, (c * x).sum(axis=1), minlength=count) for x in (e, c))
    off = above[below > 0.0] / below[below > 0.0]
    if off.size < LEAST_STRETCHES:
        return law
    tail = float(np.quantile(np.abs(off), 1.0 - LEVEL)) / float(stats.norm.isf(0.5 * LEVEL))
    sigma_rest = max(float(np.sqrt(np.mean(off**2))), tail)
    return replace(law, enabled=replace(law.enabled, rest_sigma=sigma_rest))


def _quality(errors: Errors, regimes: np.ndarray, engine: Engine) -> tuple[SensorQuality, ...]:
    sigma = np.array([engine.sensors[s].noise_sigma for s in errors.sensors])
    return sensor_quality(errors.sensors, errors.error, errors.predicted, sigma, regimes)


def _regimes(engine: Engine, law: ControlLaw, fit: Fitted, inputs: dict[str, np.ndarray]) -> np.ndarray:
    """What the control does in each record (N,)."""
    values = {n: v for n, v in fit.values.items() if n in engine.parameters}
    now = engine.predict(inputs, values, sensors=())
    regimes = np.full(len(now.status), HOLDS, dtype=object)
    for end, name in law.stops.items():
        if name in now.limits:
            regimes[now.limits[name]] = f"at the {end} stop"
    if law.enabled is not None:
        regimes[law.enabled.released(inputs[law.enabled.column])] = RELEASED
    return regimes.astype(str)
