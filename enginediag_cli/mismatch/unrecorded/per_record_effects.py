"""What else is missing beside an amplitude that varies from record to record: listed effects, scored with it free.

Rows are whitened readings with each record's amplitude direction taken out, (1 − c cᵀ/|c|²), and the identified
parameters with their priors projected off, as in `mismatch.projection`. Hours of one machine are not independent:
beside the score as of white noise stands one whose variance comes from leaving out blocks b of consecutive records,

    â = Σ s_b/Σ I_b      s_b = Σ_{rows of b} c⊥ e⊥,  I_b = Σ c⊥²      z = â/√((B−1)/B Σ (â_(b) − mean)²)

Source: B. Efron & C. Stein, Ann. Statist. 9 (1981) 586–596 (jackknife variance).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.engine.term import Effect
from enginediag_cli.mismatch.fit.evidence import Dataset
from enginediag_cli.mismatch.fit.options import effect_option
from enginediag_cli.mismatch.fit.projection import ABSORBED
from enginediag_cli.mismatch.unrecorded.per_record import PerRecord
from enginediag_cli.mismatch.unrecorded.refit import with_lever

BLOCK = 240
"""Records of a block: ten days of hourly means."""


@dataclass(frozen=True)
class Beside:
    """Score of one effect's first amplitude: fall of χ² that one step would bring, the same as z, z by blocks, the
    one-step coefficient, the share of its column that amplitude and parameters leave, and whether the coefficient is
    within its bounds."""

    effect: Effect
    fall: float
    z_blocks: float
    coefficient: float
    share: float
    feasible: bool

    @property
    def rankable(self) -> bool:
        return self.feasible and self.share >= ABSORBED


class Rows:
    """Rows of a fit without what amplitude and identified parameters explain."""

    def __init__(self, fit: PerRecord):
        self.there = np.isfinite(fit.residual)
        length = np.sqrt((fit.direction**2).sum(axis=1))[:, None]
        self.own = np.divide(fit.direction, length, out=np.zeros_like(fit.direction), where=length > 0)
        self.record = np.broadcast_to(np.arange(len(self.own))[:, None], self.there.shape)[self.there]
        low = np.isin([n for n in fit.theta if n != _parameter(fit)], fit.at_bound)
        A = self.of(fit.rows)[:, ~low]
        prior = fit.x[~low]
        self.Q = np.linalg.qr(np.concatenate([A, np.eye(A.shape[1])]))[0]
        e = np.concatenate([self.of(np.nan_to_num(fit.residual)[:, :, None])[:, 0], -prior])
        self.left = e - self.Q @ (self.Q.T @ e)

    def of(self, values: np.ndarray) -> np.ndarray:
        """Rows (n, k) of whitened values (N, m, k), the amplitude's direction taken out."""
        along = np.einsum("nm,nmk->nk", self.own, values)
        return np.asarray((values - self.own[:, :, None] * along[:, None, :])[self.there])

    def projected(self, values: np.ndarray) -> np.ndarray:
        c = np.concatenate([self.of(values), np.zeros((self.Q.shape[1], values.shape[2]))])
        return np.asarray(c - self.Q @ (self.Q.T @ c))


def effects_beside(evidence: Dataset, fit: PerRecord, effects: Sequence[Effect], block: int = BLOCK) -> list[Beside]:
    """Scores of effects that the fit does not carry, those that can be ranked first, by z of blocks."""
    carried = {e.label for e in (*evidence.engine.effects, *fit.hypothesis.effects)}
    effects = [e for e in effects if e.label not in carried and e.amplitudes]
    options = [effect_option(e) for e in effects]
    rows = Rows(fit)
    columns = effect_columns(evidence, fit, effects)
    C = rows.projected(columns)
    full = np.sqrt((columns**2).sum(axis=(0, 1)))
    found = []
    blocks = fit.number[rows.record] // block
    for j, (e, option) in enumerate(zip(effects, options, strict=True)):
        c = C[:, j]
        length = float(np.linalg.norm(c))
        if length <= 1e-9 * max(full[j], 1e-300) or full[j] == 0.0:
            found.append(Beside(e, 0.0, 0.0, 0.0, 0.0, False))
            continue
        push = float(c @ rows.left)
        n = len(blocks)
        z = _jackknife(np.bincount(blocks, (c * rows.left)[:n]), np.bincount(blocks, c[:n] ** 2))
        amplitude = option.hypothesis.effects[0].parameters()[0]
        step = push / length**2
        at = amplitude.nominal
        feasible = amplitude.lower <= at + step * 1e-6 <= amplitude.upper
        found.append(Beside(e, (push / length) ** 2, z, step, length / float(full[j]), feasible))
    return sorted(found, key=lambda b: (not b.rankable, -abs(b.z_blocks)))


@dataclass(frozen=True)
class SimilarEffect:
    """An effect that acts where the amplitude does, and the share of the amplitude's variance that a multiple of it,
    of a sign that physics allows, follows (R²)."""

    effect: Effect
    share: float


def similar_effects(evidence: Dataset, fit: PerRecord, effects: Sequence[Effect]) -> list[SimilarEffect]:
    """Effects that act on the amplitude's own parameter, the one that follows it best first. An effect's column along
    the amplitude's direction, cᵀJ/|c|², is what it would do to the amplitude."""
    own = [e for e in effects if _parameter(fit) in e.site.targets and e.amplitudes]
    if not own:
        return []
    c, good = fit.direction, np.isfinite(fit.amplitude)
    shape = np.einsum("nm,nmk->nk", c, effect_columns(evidence, fit, own))[good] / (c[good] ** 2).sum(axis=1)[:, None]
    a = fit.amplitude[good] - fit.amplitude[good].mean()
    found = []
    for e, s in zip(own, shape.T, strict=True):
        s = s - s.mean()
        r = float(s @ a / np.sqrt((s @ s) * (a @ a))) if (s @ s) > 0 else 0.0
        p = e.parameters()[0]
        allowed = p.upper > p.nominal if r > 0 else p.lower < p.nominal
        found.append(SimilarEffect(e, r * r if allowed else 0.0))
    return sorted(found, key=lambda x: -x.share)


def inflation(fit: PerRecord) -> float:
    """What χ² differences of the fit are to be divided by: χ² per degree of freedom, times readings per independent
    reading, (1 + ρ)/(1 − ρ), of the residuals' mean lag-1 correlation (fast and slow model error count as noise)."""
    e = fit.residual
    next_to = (fit.recording[1:] == fit.recording[:-1])[:, None] & np.isfinite(e[1:]) & np.isfinite(e[:-1])
    rho = [
        float((a[k] * b[k]).sum() / np.nansum(c**2) * len(c) / k.sum())
        for a, b, c, k in zip(e[1:].T, e[:-1].T, e.T, next_to.T, strict=True)
        if k.any()
    ]
    mean = min(max(float(np.mean(rho)), 0.0), 0.95) if rho else 0.0
    free = np.isfinite(e).sum() - np.isfinite(fit.amplitude).sum()
    return max(1.0, float(np.nansum(e**2)) / max(1, int(free))) * (1.0 + mean) / (1.0 - mean)


def effect_columns(evidence: Dataset, fit: PerRecord, effects: Sequence[Effect]) -> np.ndarray:
    """Whitened ∂y/∂(first amplitude) (N, m, k) of effects at the fit."""
    if fit.location is not None:
        evidence = with_lever(evidence, fit.location)
    engine = evidence.engine.replace_effects((*evidence.engine.effects, *fit.hypothesis.effects, *effects))
    theta: dict = {n: v for n, v in fit.theta.items() if n in engine.parameters}
    if fit.location is not None:
        parameter = fit.location.parameter
        theta[parameter] = fit.theta[parameter] + np.nan_to_num(fit.amplitude)
    names = [e.amplitudes[0] for e in effects]
    inputs = {c: fit.inputs[c] for c in (*engine.inputs, *engine.optional_inputs) if c in fit.inputs}
    p = engine.predict(inputs, theta, sensors=fit.sensors, wrt=names)
    J = np.where(np.isfinite(p.jacobian), p.jacobian, 0.0) / fit.sigma[:, None]
    return np.where(np.isfinite(fit.residual)[:, :, None], J, 0.0)


def _jackknife(push: np.ndarray, information: np.ndarray) -> float:
    """â over its standard error, from the blocks' shares of both; 0 with fewer than three blocks."""
    push, information = push[information > 0], information[information > 0]
    B = len(push)
    if B < 3:
        return 0.0
    without = (push.sum() - push) / (information.sum() - information)
    error = np.sqrt((B - 1) / B * ((without - without.mean()) ** 2).sum())
    return float(push.sum() / information.sum() / error) if error > 0 else 0.0


def _parameter(fit: PerRecord) -> str:
    return "" if fit.location is None else fit.location.parameter
