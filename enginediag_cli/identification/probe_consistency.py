"""Which probe the others contradict, before any parameter is bent to it.

The heat balances of `probe_balances` tie recorded temperatures, fuel and pressures together without a component map.
Their differences r (N, J) are zero within what stated accuracy and the engine leave open, covariance

    R_k = G_k S G_kᵀ + Q_k

with G the derivatives by the readings, S the stated accuracies squared and Q what each balance leaves open itself. A
probe is wrong when it alone, with an error of its own in every record, takes away most of the misfit rᵀR⁻¹r: with its
column of G eliminated the rest agrees. Where several probes would do that, they are one class, and nobody can say more.
The misfit is a mean over the records, never a sum: what makes a balance differ is the same in all of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.identification.probe_balances import FUEL, Balance, balances, needed_of_model
from enginediag_cli.identification.problem import TrainingRecording

GROSS = 4.0
"""Standard deviations (rms over the records) by which a probe must be off before it is named: probes in a hot gas and
generic allowances are off by two or three."""
MENDED = 0.5
"""Least share of the misfit of all balances that goes with the probe; what does less is not what is wrong."""
AS_GOOD = 0.8
"""Share of the misfit taken away by the best probe that another one must take away to be as good a name."""
RECORDS = 400
"""Records that are asked, evenly spread."""
FEWEST = 5
"""Records below which nothing is said."""
STEP = 1e-4
"""Relative step of the derivatives; the balances are smooth."""
PASSES = 5
"""Passes for the free constant, by weights that hold wild records down."""
FUEL_SHARE = 0.02
"""Accuracy of a fuel flow for which none is stated, as the input that sets the power."""


@dataclass(frozen=True)
class WrongProbe:
    """Columns of which one is wrong, most often one alone; numbers in that column's unit.

    `error` (low, median, high): what each record says the probe of a single column is off by, 10th to 90th percentile;
    `expected`: standard deviation of that by what is stated; `records` that were asked; `balances` that it takes part
    in; `mended`: the share of their misfit that is gone without it.
    """

    columns: tuple[str, ...]
    error: tuple[float, float, float]
    expected: float
    records: int
    balances: tuple[str, ...]
    mended: float

    @property
    def told_apart(self) -> bool:
        """Whether the balances say which probe it is."""
        return len(self.columns) == 1


def wrong_probes(engine: Any, recordings: Sequence[TrainingRecording]) -> tuple[WrongProbe, ...]:
    """Probes that the balances contradict, the one that explains most first; nothing where no balance is recorded
    whole. A class of several ends the list: what else is wrong cannot be told then."""
    if not isinstance(engine, Engine):
        return ()
    columns = frozenset.intersection(*(frozenset(r.columns) for r in recordings)) if recordings else frozenset()
    known = frozenset(c for c in (*engine.sensors, FUEL) if c in columns)
    blank = {c: np.full(1, np.nan) for c in needed_of_model(engine)}
    if not balances(engine, known, blank):
        return ()
    readings, model = _asked(engine, recordings, known)
    if len(model["P0_Pa"]) < FEWEST:
        return ()
    return _judge(balances(engine, known, model), readings, {c: _accuracy(engine, c, readings) for c in known})


def without_probes(recordings: Sequence[TrainingRecording], columns: Sequence[str]) -> list[TrainingRecording]:
    """The recordings without these columns."""
    return [r._replace(columns={c: v for c, v in r.columns.items() if c not in columns}) for r in recordings]


def _asked(
    engine: Engine, recordings: Sequence[TrainingRecording], known: frozenset[str]
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Readings, and what the model says of stations without a probe, of some records that have all of them."""
    inputs = [c for c in (*engine.inputs, *engine.optional_inputs) if all(c in r.columns for r in recordings)]
    wanted = sorted({*known, *inputs})
    stacked = {c: np.concatenate([np.asarray(r.columns[c], float) for r in recordings]) for c in wanted}
    taken = {c for b in balances(engine, known, _blank(engine)) for c in b.probes}
    whole = np.flatnonzero(np.all([np.isfinite(stacked[c]) for c in {*taken, *inputs}], axis=0))
    some = whole[np.unique(np.linspace(0, len(whole) - 1, min(RECORDS, len(whole))).round().astype(int))]
    stacked = {c: v[some] for c, v in stacked.items()}
    needed = needed_of_model(engine)
    found = engine.predict({c: stacked[c] for c in inputs}, sensors=(), also=needed)
    good = found.ok & np.isfinite(found.also).all(axis=1)
    return {c: stacked[c][good] for c in known}, {c: found.also[good, j] for j, c in enumerate(needed)}


def _blank(engine: Engine) -> dict[str, np.ndarray]:
    return {c: np.full(1, np.nan) for c in needed_of_model(engine)}


def _accuracy(engine: Engine, column: str, readings: Mapping[str, np.ndarray]) -> float:
    sensor = engine.sensors.get(column)
    return sensor.noise_sigma if sensor else FUEL_SHARE * float(np.median(readings[column]))


def _judge(
    given: Sequence[Balance], readings: Mapping[str, np.ndarray], sigma: Mapping[str, float]
) -> tuple[WrongProbe, ...]:
    """One probe after the other, each with those before it left out."""
    probes = tuple(dict.fromkeys(c for b in given for c in b.probes))
    r = np.column_stack([b.difference(readings) for b in given])
    G = np.zeros((*r.shape, len(probes)))
    for p, column in enumerate(probes):
        step = STEP * readings[column]
        moved = {**readings, column: readings[column] + step}
        for j, b in enumerate(given):
            if column in b.probes:
                G[:, j, p] = (b.difference(moved) - r[:, j]) / step
    spread = np.array([sigma[c] for c in probes])
    R = np.einsum("kjp,p,kip->kji", G, spread**2, G)
    R[:, range(len(given)), range(len(given))] += np.column_stack([b.allowed(readings) for b in given]) ** 2
    scale = np.column_stack([np.zeros(len(r)) if b.scale is None else -b.scale(readings) for b in given])
    there = np.isfinite(r).all(axis=1) & np.isfinite(R).all(axis=(1, 2))
    r, G, R, scale = r[there], G[there], R[there], scale[there]
    if len(r) < FEWEST:
        return ()
    out: list[int] = []
    found: list[WrongProbe] = []
    while True:
        before = _misfit(r, G[:, :, out], R, scale)
        left = [p for p in range(len(probes)) if p not in out]
        tried = {p: _misfit(r, G[:, :, [*out, p]], R, scale) for p in left}
        gain = {p: before - m for p, m in tried.items()}
        best = max(left, key=lambda p: gain[p], default=None)
        if best is None or not gain[best] > MENDED * before:
            return tuple(found)
        error, sd = _error(r, G[:, :, out], G[:, :, best], R, scale)
        if not float(np.sqrt(np.mean((error / sd) ** 2))) > GROSS:
            return tuple(found)
        alike = sorted((p for p in left if gain[p] >= AS_GOOD * gain[best]), key=lambda p: -gain[p])
        low, middle, high = np.quantile(error, (0.1, 0.5, 0.9))
        names = tuple(probes[p] for p in alike)
        found.append(
            WrongProbe(
                names,
                (float(low), float(middle), float(high)),
                float(np.median(sd)),
                len(r),
                tuple(b.name for b in given if set(names) & set(b.probes)),
                float(gain[best] / before),
            )
        )
        if len(alike) > 1:
            return tuple(found)
        out.append(best)


def _weights(R: np.ndarray, free: np.ndarray) -> np.ndarray:
    """R⁻¹ with the directions `free` (N, J, q) eliminated, (N, J, J)."""
    W = np.linalg.inv(R)
    if free.shape[2]:
        B = W @ free
        W = W - B @ np.linalg.pinv(np.swapaxes(free, 1, 2) @ B, hermitian=True) @ np.swapaxes(B, 1, 2)
    return W


def _constant(r: np.ndarray, W: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """r with the constant of the burner's balance at its best value, wild records held down."""
    weight = np.ones(len(r))
    e = r
    for _ in range(PASSES):
        below = float(np.einsum("k,kj,kji,ki->", weight, scale, W, scale))
        if not below > 1e-9 * len(r):  # no balance left that has it
            return r
        e = r - scale * (float(np.einsum("k,kj,kji,ki->", weight, scale, W, r)) / below)
        size = np.einsum("kj,kji,ki->k", e, W, e)
        weight = 1.0 / (1.0 + size / max(float(np.median(size)), 1e-12))
    return e


def _misfit(r: np.ndarray, free: np.ndarray, R: np.ndarray, scale: np.ndarray) -> float:
    """Mean over the records of rᵀWr."""
    W = _weights(R, free)
    e = _constant(r, W, scale)
    return float(np.mean(np.einsum("kj,kji,ki->k", e, W, e)))


def _error(
    r: np.ndarray, free: np.ndarray, g: np.ndarray, R: np.ndarray, scale: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What the other probes say that one is off by, (N,), and the standard deviation of that, its own included."""
    e = _constant(r, _weights(R, np.concatenate([free, g[:, :, None]], axis=2)), scale)
    W = _weights(R, free)
    worth = np.maximum(np.einsum("kj,kji,ki->k", g, W, g), 1e-300)
    return np.einsum("kj,kji,ki->k", g, W, e) / worth, 1.0 / np.sqrt(worth)
