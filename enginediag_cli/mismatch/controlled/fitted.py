"""How well an engine fits recordings, with a law and without: what laws are compared by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.errors import EngineDiagError
from enginediag_cli.identification.identify import Identification, identify
from enginediag_cli.identification.nominal import predict_held_out
from enginediag_cli.identification.problem import TrainingRecording, settings_from_mapping

BLOCKS = 16
"""Runs of records, of which each says for itself which engine fits better: hours of a day say the same."""
COMPARED = 1200
"""Records, evenly chosen, to which engines are fitted to be compared."""


@dataclass(frozen=True)
class Errors:
    """What an engine does not predict of readings (N, m): `error`, `predicted` in the sensors' units."""

    sensors: tuple[str, ...]
    error: np.ndarray
    predicted: np.ndarray

    def left(self) -> np.ndarray:
        """ln root mean square (m, BLOCKS) of each sensor in each run of records, NaN where nothing was read."""
        block = np.arange(len(self.error)) * BLOCKS // max(len(self.error), 1)
        with np.errstate(all="ignore"):
            left = [[0.5 * np.log(np.nanmean(e[block == b] ** 2)) for b in range(BLOCKS)] for e in self.error.T]
        return np.array(left)


def gain(after: Errors, before: Errors) -> tuple[float, float]:
    """Mean fall of ln error over sensors and runs, and the share of the runs in which it falls."""
    common = [s for s in after.sensors if s in before.sensors]
    a, b = (f.left()[[f.sensors.index(s) for s in common]] for f in (after, before))
    fall = np.nanmean(b - a, axis=0)
    return float(np.nanmean(fall)), float(np.mean(fall[np.isfinite(fall)] > 0.0))


@dataclass(frozen=True)
class Fitted:
    """An engine identified; `errors` on blocks that its fit had not seen, where it converged."""

    found: Identification
    errors: Errors

    @property
    def converged(self) -> bool:
        return self.found.converged

    @property
    def values(self) -> dict[str, float]:
        """Of what was identified."""
        return {e.name: e.value for e in self.found.estimates}

    @property
    def standard_errors(self) -> dict[str, float]:
        return {e.name: e.standard_error for e in self.found.estimates}

    def unseen(self, engine: Engine, flights: Sequence[TrainingRecording]) -> tuple[Errors, dict[str, np.ndarray]]:
        """On flights that were not fitted, and the inputs (N,) of their records."""
        settings = settings_from_mapping(engine.declared.get("identification"))
        problem = self.found.problem
        other, predicted = predict_held_out(
            problem, self.found.fit, flights, replace(settings, sensors=problem.sensors)
        )
        error = Errors(tuple(other.sensors), other.measured - predicted, predicted)
        return error, {c: v for c, v in other.inputs.items() if c in engine.inputs}


def length(flight: TrainingRecording) -> int:
    """Records of a flight."""
    return len(next(iter(flight.columns.values())))


def thinned(flights: Sequence[TrainingRecording], step: int) -> list[TrainingRecording]:
    """Every `step`-th record of each flight."""
    return [TrainingRecording(f.label, {c: v[::step] for c, v in f.columns.items()}, engine=f.engine) for f in flights]


def fitted(engine: Engine, flights: Sequence[TrainingRecording], compared: int | None = COMPARED) -> Fitted | None:
    """The engine identified on the flights, by the file's own settings; None where it has no prediction. `compared`:
    of so many records at most."""
    step = max(1, -(-sum(map(length, flights)) // compared)) if compared else 1
    try:
        found = identify(engine, thinned(flights, step))
    except EngineDiagError:
        return None
    p = found.problem
    seen = found.cross_validation.predicted
    predicted = seen if np.isfinite(seen).any() else found.fit.equations.predicted
    return Fitted(found, Errors(tuple(p.sensors), p.measured - predicted, predicted))
