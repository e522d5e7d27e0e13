"""Advice: at which operating condition, or with which further sensor, two rival explanations part soonest.

If the set A changed by Δ, the best account by the set B instead falls short, over records of information I, by

    λ = Δᵀ (I_AA − I_AB I_BB⁺ I_BA) Δ,

the non-centrality of the likelihood ratio between the rivals; n further records of information G each raise the
expected log odds of A over B by ½ [λ(I + nG) − λ(I)]. The advice is for the least favourable Δ of those that the
data allow, and for the less favourable of "A is true" and "B is true". A set that contains its rival cannot lose
to it by this measure; then only the larger one being true counts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from enginediag_cli.residuals.local import whiten
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.noise import NoiseModel
from enginediag_cli.residuals.root import root_of
from enginediag_cli.residuals.score import Score

ODDS = 20.0
"""Odds to one from which explanations count as told apart: those of a 95 % test."""
ALLOWED = 0.8
"""Probability of the changes among which the least favourable is sought."""
MOST_RECORDS = 100_000
"""More records than any recording has: told as “never”."""


@dataclass(frozen=True)
class Option:
    """What could be recorded next: `label` and values in words' place, information per record (p_all, p_all) of
    the monitor's parameters, `known`: the operating condition is one that identification has seen."""

    label: str
    values: Mapping[str, float]
    information: np.ndarray
    known: bool = True


@dataclass(frozen=True)
class Advice:
    """One option judged: non-centrality between the rivals per record, for a hundred records, and records needed
    for expected odds of `odds` to one (inf: more than MOST_RECORDS)."""

    label: str
    values: Mapping[str, float]
    noncentrality: float
    records: float
    odds: float
    known: bool


def advise(
    score: Score,
    rivals: tuple[Sequence[str], Sequence[str]],
    options: Sequence[Option],
    uncertainty: np.ndarray,
    *,
    odds: float = ODDS,
    allowed: float = ALLOWED,
) -> list[Advice]:
    """Options by falling usefulness for telling the two `rivals`, sets of monitored parameters, apart.

    uncertainty (p_all, p_all): covariance of what is uncertain about nominal and sensors, drawn anew for the
    further records. ValueError when the rivals are the same set.
    """
    cases = _cases(score, rivals, allowed)
    judged = []
    for option in options:
        gain = _Gain(score, option.information, uncertainty, cases)
        needed = gain.records_for(2 * float(np.log(odds)))
        judged.append(Advice(option.label, option.values, gain(100.0) / 100, needed, odds, option.known))
    return sorted(judged, key=lambda advice: (advice.records, -advice.noncentrality))


def gains(
    score: Score,
    rivals: tuple[Sequence[str], Sequence[str]],
    informations: Sequence[np.ndarray],
    *,
    allowed: float = ALLOWED,
) -> np.ndarray:
    """Gain (k,) of the non-centrality between the rivals from each of k further pieces of information (p, p) of the
    score's parameters, all else certain."""
    cases, certain = _cases(score, rivals, allowed), np.zeros_like(score.information)
    return np.array([_Gain(score, information, certain, cases)(1.0) for information in informations])


def _cases(
    score: Score, rivals: tuple[Sequence[str], Sequence[str]], allowed: float
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """One rival, the other, and the change of the one that is hardest to tell, for each rival that may be true."""
    a, b = (score.indices(list(names)) for names in rivals)
    if set(a.tolist()) == set(b.tolist()):
        raise ValueError("the rivals are one and the same set")
    changes = [_allowed_change(score, own, other, allowed) for own, other in ((a, b), (b, a))]
    return [(own, other, c) for (own, other), c in zip(((a, b), (b, a)), changes, strict=True) if c is not None]


def part(information: np.ndarray, own: np.ndarray, other: np.ndarray) -> np.ndarray:
    """I_AA − I_AB I_BB⁺ I_BA (k, k): what the set `own` shows beyond what `other` can imitate."""
    if not len(other):
        return np.asarray(information[np.ix_(own, own)])
    eigenvalues, vectors = np.linalg.eigh(information[np.ix_(other, other)])
    kept = eigenvalues > 1e-10 * max(float(eigenvalues[-1]), 1e-300)
    half = information[np.ix_(own, other)] @ (vectors[:, kept] / np.sqrt(eigenvalues[kept]))
    return np.asarray(information[np.ix_(own, own)] - half @ half.T)


def _allowed_change(score: Score, own: np.ndarray, other: np.ndarray, allowed: float) -> np.ndarray | None:
    """Of the changes (k,), in prior_sigma, of the set `own` that the data allow, the one `other` imitates best.

    Minimum of a quadratic form over an ellipsoid about the estimate, by its Lagrange multiplier. None when
    `other` contains `own`.
    """
    if not len(own) or set(own.tolist()) <= set(other.tolist()):
        return None
    from scipy.optimize import brentq
    from scipy.special import chdtri

    b, information = score.scaled()
    I = information[np.ix_(own, own)] + 1e-9 * np.max(np.diag(information)) * np.eye(len(own))
    Q = part(information, own, other)
    estimate = np.linalg.solve(I, b[own])
    radius = float(chdtri(len(own), 1 - allowed))

    def change(multiplier: float) -> np.ndarray:
        return np.asarray(np.linalg.solve(Q + multiplier * I, multiplier * I @ estimate))

    def excess(log_multiplier: float) -> float:
        away = change(float(np.exp(log_multiplier))) - estimate
        return float(away @ I @ away) - radius

    low, high = -30.0, 15.0
    return change(float(np.exp(low if excess(low) <= 0 else brentq(excess, low, high))))


class _Gain:
    """Gain of non-centrality between the rivals from n further records of one option, as a function of n."""

    def __init__(
        self,
        score: Score,
        information: np.ndarray,
        uncertainty: np.ndarray,
        cases: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]],
    ):
        self._sigma, self._cases = score.prior_sigma, cases
        p = len(score.parameters)
        self._I = score.scaled()[1]
        spread = np.sqrt(np.diag(uncertainty))
        root = root_of(uncertainty, np.where(spread > 0, spread, 1.0))
        self._own = self._sigma[:, None] * information[:p, :p] * self._sigma
        self._cross = self._sigma[:, None] * (information[:p] @ root)
        self._inner = root.T @ information @ root
        self._before = [float(c @ part(self._I, own, other) @ c) for own, other, c in cases]

    def __call__(self, n: float) -> float:
        inner = np.eye(len(self._inner)) + n * self._inner
        further = n * self._own - n**2 * self._cross @ np.linalg.solve(inner, self._cross.T)
        gains = [
            float(c @ part(self._I + further, own, other) @ c) - before
            for (own, other, c), before in zip(self._cases, self._before, strict=True)
        ]
        return max(min(gains), 0.0)

    def records_for(self, wanted: float) -> float:
        """Least number of records that gain `wanted`, by bisection; inf beyond MOST_RECORDS."""
        if self(MOST_RECORDS) < wanted:
            return float("inf")
        low, high = 0, MOST_RECORDS
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self(middle) >= wanted else (middle, high)
        return float(high)


def condition_options(monitor: Monitor, conditions: Mapping[str, np.ndarray]) -> list[Option]:
    """One option per operating condition, inputs column -> (C,), that the engine can compute."""
    predicted, J, ok, _ = monitor.predict(dict(conditions), monitor.theta0)
    G = whiten(np.zeros_like(predicted), J, monitor.noise)[1]
    seen = np.ones(len(ok), bool)
    if monitor.envelope is not None:
        seen = ~np.asarray(monitor.envelope.outside(conditions))
    return [
        Option(
            "condition",
            {column: float(values[k]) for column, values in conditions.items()},
            G[k].T @ G[k],
            bool(seen[k]),
        )
        for k in np.flatnonzero(ok)
    ]


def sensor_options(monitor: Monitor, inputs: Mapping[str, np.ndarray], noises: Mapping[str, float]) -> list[Option]:
    """One option per further sensor (model column -> noise sigma, in the column's unit), recorded together with
    the present sensors at operating conditions like those of `inputs`, column -> (N,); before them the present
    sensors alone, for comparison. Empty when the engine can compute none of these conditions."""
    _, J, ok, _ = monitor.predict(dict(inputs), monitor.theta0)
    if not ok.any():
        return []
    q = len(monitor.names) - len(monitor.offsets)
    values: dict[str, Any] = dict(monitor.base)
    values.update(zip(monitor.names[:q], monitor.theta0[:q].tolist(), strict=True))
    columns = tuple(noises)
    extra = monitor.engine.predict(inputs, values, sensors=columns, wrt=monitor.names[:q])
    ok = ok & np.asarray(extra.ok)
    present = whiten(np.zeros_like(J[ok, :, 0]), J[ok], monitor.noise)[1].reshape(-1, len(monitor.names))
    base = present.T @ present / ok.sum()
    noise = NoiseModel(np.array([noises[c] for c in columns], float), np.zeros(len(columns)))
    full = np.zeros((int(ok.sum()), len(columns), len(monitor.names)))
    full[:, :, :q] = np.asarray(extra.jacobian)[ok]
    added = whiten(np.zeros(full.shape[:2]), full, noise)[1]
    options = [Option("present sensors", {}, base)]
    for j, column in enumerate(columns):
        options.append(Option(column, {column: noises[column]}, base + added[:, j].T @ added[:, j] / ok.sum()))
    return options
