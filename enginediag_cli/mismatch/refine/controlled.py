"""Refinement with a control: the engine with it and without, identified on some flights and judged by others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.engine.description import EngineDescription
from enginediag_cli.engine.engine import Engine
from enginediag_cli.identification.problem import TrainingRecording
from enginediag_cli.identification.quality import SensorQuality, sensor_quality
from enginediag_cli.mismatch.controlled.find import MOST_BLOCKS, Found
from enginediag_cli.mismatch.controlled.fitted import Errors, Fitted, fitted, gain
from enginediag_cli.mismatch.controlled.law import ControlLaw
from enginediag_cli.progress import stage

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
    found: Found,
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
    errors = law.errors(after.standard_errors)
    if bound := [b.name for b in after.found.bounds if b.name in law.parameters]:
        return ControlRefinement(law, errors, failed=f"{', '.join(bound)} ends at a physical bound")
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
