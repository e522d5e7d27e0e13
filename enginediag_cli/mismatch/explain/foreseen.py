"""What an explanation foresees of records that nobody has flown, and how surely."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.mismatch.explain.answer import Explanation
from enginediag_cli.mismatch.fit.evidence import Dataset
from enginediag_cli.mismatch.fit.identified import Hypothesis, IdentifiedHypothesis, Nuisance, identify_with
from enginediag_cli.mismatch.fit.options import combine_options
from enginediag_cli.mismatch.fit.projection import Projection

NOISE = {"K": 0.002, "Pa": 0.004, "rpm": 0.001}
"""Assumed of a further sensor: standard deviation of a reading, relative to its mean."""
SCALE = 0.002
"""Assumed scale error of a further sensor, standard deviation."""


@dataclass(frozen=True)
class PredictedReadings:
    """Readings (k, m) over σ, and what they answer to (k, m, q) per standard deviation of what is known of it: all that
    the explanation may adapt, offsets of a new recording among it; `ok` (k,): where there is a prediction."""

    readings: np.ndarray
    columns: np.ndarray
    ok: np.ndarray

    def at(self, rows: slice) -> PredictedReadings:
        """Of some of the records."""
        return PredictedReadings(self.readings[rows], self.columns[rows], self.ok[rows])

    def read_by(self, sensors: Sequence[int]) -> PredictedReadings:
        """Of some of the readings."""
        return PredictedReadings(self.readings[:, sensors], self.columns[:, sensors], self.ok)


class Rival:
    """An explanation fitted to the evidence together with everything that identification may absorb."""

    def __init__(self, explanation: Explanation, evidence: Dataset, along: Nuisance, start: IdentifiedHypothesis):
        self.explanation = explanation
        hypothesis = _further(_begun(explanation), evidence)
        self.curves = {**along.curves, **hypothesis.curves}
        self.found = identify_with(evidence, hypothesis, along, start)
        if not self.converged:
            return
        projection = Projection(self.found)
        self._free = projection.free[: len(self.found.problem.names)]
        self._step = projection.step
        # of what is known of the parameters, C = R⁻¹R⁻ᵀ: columns by it are per standard deviation
        self._root = np.linalg.solve(projection.R, np.eye(len(projection.R)))

    @property
    def converged(self) -> bool:
        return self.found.converged

    @property
    def label(self) -> str:
        return self.explanation.label

    def foresee(
        self, inputs: Mapping[str, np.ndarray], rows: slice | np.ndarray, without: str = "", more: Sequence[str] = ()
    ) -> PredictedReadings:
        """Of records with these inputs (k,), at the places `rows` of the evidence; `without`: an effect that is
        switched off; `more`: columns of further sensors that are recorded as well."""
        p = self.found.problem
        given = {**inputs, **{c: v[rows] for c, v in self.curves.items()}}
        theta, off = dict(self.found.theta), np.zeros(len(p.names), bool)
        for e in self.found.hypothesis.effects:
            if e.label == without:
                theta |= {e.parameter_name(c.name): c.absent for c in e.term.amplitudes() if not c.free}
                off |= np.isin(p.names, e.amplitudes)
        read = [c for c in (o.sensor for o in p.offsets) if c not in p.sensors]
        sensors = (*p.sensors, *more)
        found = self.found.model.predict(given, theta, sensors=sensors, wrt=(*p.names, *dict.fromkeys(read)))
        ok = np.asarray(found.ok) & np.isfinite(found.y).all(axis=1) & np.isfinite(found.jacobian).all(axis=(1, 2))
        y, J = np.where(ok[:, None], found.y, 0.0), np.where(ok[:, None, None], found.jacobian, 0.0)
        scale = _size(y, ok)[len(p.sensors) :]
        sigma = np.concatenate([p.sigma, [NOISE[_unit(c)] * s for c, s in zip(more, scale, strict=True)]])
        X = J[:, :, : len(p.names)] * p.prior_sigma / sigma[:, None]
        X = np.where(off, 0.0, X)[:, :, self._free]
        offsets = self._offsets(given, y, J[:, :, len(p.names) :], list(dict.fromkeys(read))) / sigma[:, None]
        wrong = np.zeros((len(y), len(sensors), len(more)))
        for j, s in enumerate(scale):
            wrong[:, len(p.sensors) + j, j] = SCALE * s / sigma[len(p.sensors) + j]
        columns = np.concatenate([X @ self._root, offsets, wrong], axis=2)
        return PredictedReadings(y / sigma + X @ self._step, columns, ok)

    def _offsets(
        self, given: Mapping[str, np.ndarray], y: np.ndarray, by_input: np.ndarray, read: Sequence[str]
    ) -> np.ndarray:
        """(k, m, q): what a new recording's own offsets do to its readings, per standard deviation of them."""
        p = self.found.problem
        O = np.zeros((*y.shape, len(p.offsets)))
        for j, o in enumerate(p.offsets):
            if o.sensor in p.sensors:
                s = p.sensors.index(o.sensor)
                O[:, s, j] = o.next_sigma * (1.0 if o.kind == "bias" else y[:, s])
            else:
                by = given[o.sensor] if o.kind == "scale" else np.ones(len(y))
                O[:, :, j] = o.next_sigma * by[:, None] * by_input[:, :, read.index(o.sensor)]
        return O

    def whitening(self, inputs: Mapping[str, np.ndarray], rows: slice | np.ndarray) -> np.ndarray:
        """(k, m, m): what frees readings of what noise in time and noise of the inputs have in common."""
        p, noise = self.found.problem, self.found.evidence.noise
        rho = np.sqrt((1.0 - self.found.rho) / (1.0 + self.found.rho))
        k, m = len(next(iter(inputs.values()))), len(p.sensors)
        columns = [c for c in self.found.evidence.engine.inputs if c in noise.inputs or c in noise.input_shares]
        L = np.broadcast_to(np.eye(m), (k, m, m))
        if columns:
            given = {**inputs, **{c: v[rows] for c, v in self.curves.items()}}
            J = self.found.model.predict(given, self.found.theta, sensors=p.sensors, wrt=tuple(columns)).jacobian
            share = np.array([noise.input_shares.get(c, 0.0) for c in columns])
            size = np.hypot(
                [noise.inputs.get(c, 0.0) for c in columns], share * np.column_stack([inputs[c] for c in columns])
            )
            G = np.nan_to_num(J) * size[:, None, :] / p.sigma[:, None]
            L = np.linalg.inv(np.linalg.cholesky(np.eye(m) + G @ np.swapaxes(G, 1, 2)))
        return np.asarray(rho[:, None] * L)


def _size(y: np.ndarray, ok: np.ndarray) -> np.ndarray:
    """Mean size of each column (m,) of y (k, m)."""
    return np.maximum(np.abs(y[ok]).mean(axis=0), 1e-300) if ok.any() else np.ones(y.shape[1])


def _unit(column: str) -> str:
    return column.rpartition("_")[2]


def _begun(explanation: Explanation) -> Hypothesis:
    """The explanation's hypothesis, where effects that are tried at some size begin at the size that was found."""
    h = combine_options(*explanation.options)
    values = {c.name: c.value for c in explanation.coefficients}
    effects = []
    for e in h.effects:
        names = {c.name: e.parameter_name(c.name) for c in e.term.amplitudes()}
        found = {c: values[n] for c, n in names.items() if n in values}
        effects.append(replace(e, values={**e.values, **found}) if e.trial_names else e)
    return replace(h, effects=tuple(effects))


def _further(h: Hypothesis, evidence: Dataset) -> Hypothesis:
    """Curves over further records of the evidence: as the first engine's flights ended."""
    total, mine = evidence.records, evidence.engines[0]
    longer = {}
    for n, c in h.curves.items():
        last = np.cumsum([len(f) for f in evidence.flights]) - 1
        own = [int(k) for k, f in zip(last, evidence.flights, strict=True) if f.engine == mine and k < len(c)]
        longer[n] = np.concatenate([c, np.full(total - len(c), c[max(own)])])
    return replace(h, curves=longer)
