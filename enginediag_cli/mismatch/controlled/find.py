"""The control that a model lacks: every reading that stands still with every actuator that nothing moves.

1. A reading stands still in many records where the model, as the engine file describes it, says that it should not.
2. Each actuator that could hold it is solved for in these records: how far it goes, and when it is released.
3. Laws that are nearer the other readings than the model without are put into the engine file and identified; what
   they do not predict, block by block, is compared with what the model leaves without.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.load import EngineDescription
from enginediag_cli.errors import ConfigError
from enginediag_cli.identification.problem import TrainingRecording
from enginediag_cli.mismatch.controlled.actuators import free_actuators
from enginediag_cli.mismatch.controlled.fitted import Fitted, fitted, gain, length
from enginediag_cli.mismatch.controlled.law import ControlLaw
from enginediag_cli.mismatch.controlled.start import Records, begin, ranked
from enginediag_cli.mismatch.controlled.still import Still, still_readings
from enginediag_cli.progress import stage

TRIED = 4
"""Laws that are identified, the nearest first."""
LEAST_GAIN, MOST_BLOCKS = 0.2, 0.75
"""Mean fall of ln error (a fifth), and the share of blocks that must gain, from which a law is found. Judgement: a law
that a recording shows halves its errors."""
SEPARATED = 0.05
"""Mean difference of ln error between two laws below which these recordings do not tell them apart."""


@dataclass(frozen=True)
class FittedControlLaw:
    """A law as fitted: `gain`: mean fall of ln error against the model without it, in `blocks` of the blocks; `engine`:
    with it; `fit` of the records that laws are compared by."""

    law: ControlLaw
    engine: Engine
    fit: Fitted
    gain: float
    blocks: float


@dataclass(frozen=True)
class ControlSearchResult:
    """`best`: the law that is found, with its numbers as fitted; `standard_errors` by key of its entry; `at_limit`:
    share of the records at each stop, `released`: of those in which it does not act; `held`: of those in which it
    holds the reading; `rivals`: not told from it; `worse`: other laws that were fitted; `still`: what stood
    still; `without`: the fit of the model without a law."""

    best: FittedControlLaw
    standard_errors: dict[str, float]
    held: float
    at_limit: dict[str, float]
    released: float
    rivals: tuple[FittedControlLaw, ...]
    worse: tuple[FittedControlLaw, ...]
    still: Still
    without: Fitted


def records_of(engine: Engine, flights: Sequence[TrainingRecording]) -> Records:
    """Of all flights; an input that is not recorded has the value that stands for that."""
    sensors = tuple(s for s in engine.sensors if any(s in f.columns for f in flights))
    defaults = {**dict.fromkeys(engine.inputs, np.nan), **engine.optional_inputs}
    inputs = {
        c: np.concatenate([np.broadcast_to(f.columns.get(c, np.full(length(f), d)), (length(f),)) for f in flights])
        for c, d in defaults.items()
    }
    read = [np.concatenate([f.columns.get(s, np.full(length(f), np.nan)) for f in flights]) for s in sensors]
    found = engine.predict(inputs, sensors=sensors)
    return Records(inputs, sensors, np.column_stack(read), np.where(found.ok[:, None], found.y, np.nan))


@stage("looking for a control")
def find_law(
    described: EngineDescription, engine: Engine, flights: Sequence[TrainingRecording]
) -> ControlSearchResult | None:
    """The control law that the flights show and the engine lacks; None where nothing stands still without a reason, or
    no law predicts the other readings better."""
    records = records_of(engine, flights)
    noise = {s: engine.sensors[s].noise_sigma for s in records.sensors}
    still = still_readings(records.sensors, noise, records.measured, records.described)
    if not still:
        return None
    begun = ranked(
        [b for s in still for a in free_actuators(engine) if (b := begin(described, engine, a, s, records)) is not None]
    )
    if not begun:
        return None
    without = fitted(engine, flights)
    if without is None:
        return None
    tried = []
    for b in begun[:TRIED]:
        if (one := _tried(b.law, described, engine, flights, without)) is not None:
            tried.append(one)
    tried.sort(key=lambda t: -t.gain)
    if not tried or tried[0].gain < LEAST_GAIN or tried[0].blocks < MOST_BLOCKS:
        return None
    near = tuple(t for t in tried[1:] if tried[0].gain - t.gain < SEPARATED)
    stood = next(s for s in still if s.sensor == tried[0].law.hold)
    worse = tuple(t for t in tried[1:] if t not in near)
    return _found(records, tried[0], near, worse, stood, without)


def _tried(
    law: ControlLaw, described: EngineDescription, engine: Engine, flights: Sequence[TrainingRecording], without: Fitted
) -> FittedControlLaw | None:
    try:
        with_law = law.engine(described, engine.power_setting)
    except ConfigError:
        return None
    fit = fitted(with_law, flights)
    if fit is None or not fit.converged:
        return None
    return FittedControlLaw(law.fitted(fit.values), with_law, fit, *gain(fit.errors, without.errors))


def _found(
    records: Records,
    best: FittedControlLaw,
    near: tuple[FittedControlLaw, ...],
    worse: tuple[FittedControlLaw, ...],
    still: Still,
    without: Fitted,
) -> ControlSearchResult:
    law, fit = best.law, best.fit
    values = {n: v for n, v in fit.values.items() if n in best.engine.parameters}
    now = best.engine.predict(records.inputs, values, sensors=records.sensors)
    ok = max(int(now.ok.sum()), 1)
    released = np.zeros(len(records.measured), dtype=bool)
    if law.enabled is not None:
        released = law.enabled.released(records.inputs[law.enabled.column])
    at_limit = {
        end: float((now.limits[name] & ~released).sum() / ok) if name in now.limits else 0.0
        for end, name in law.stops.items()
    }
    away = float((released & now.ok).sum() / ok)
    return ControlSearchResult(
        best,
        {"set_point": still.standard_error, **law.errors(fit.standard_errors)},
        1.0 - away - sum(at_limit.values()),
        at_limit,
        away,
        near,
        worse,
        still,
        without,
    )
