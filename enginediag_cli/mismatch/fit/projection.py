"""Rao's score test of anything that may be missing, with everything identified as nuisance.

At a fit, rows are readings divided by σ and, where noise is correlated in time, differenced,
(e_k − ρ_k e_{k−1})/√(1 − ρ_k²) within a recording (`neighbours`); below them stand the priors' rows. With the nuisance
columns A = QR of these rows, a candidate's column c and the residual e:

    c⊥ = c − Q Qᵀc      z = c⊥ᵀe/|c⊥|      T = z² ~ χ²₁      â = z/|c⊥|      λ = (a |c⊥|)²

Source: C. R. Rao, "Large Sample Tests of Statistical Hypotheses", Proc. Camb. Phil. Soc. 44 (1948) 50–57.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.engine.term import Effect
from enginediag_cli.identification.normal_equations import blocks
from enginediag_cli.mismatch.fit.extended import ExtendedModel
from enginediag_cli.mismatch.fit.identified import Identified
from enginediag_cli.mismatch.fit.neighbours import neighbours_of
from enginediag_cli.mismatch.fit.scores import surprise

ABSORBED = 0.01
"""Share of a column's length below which what survives the projection is not to be ranked."""


NEGLIGIBLE = 1e-7  # share of a column that is rounding


class Frame:
    """The rows of a fit: which readings count, and how a (N, m, k) array becomes whitened rows (n, k)."""

    def __init__(self, found: Identified):
        p, e = found.problem, found.fit.equations.residual
        self.sigma, self.rho = p.sigma, found.rho
        self.keep = np.isfinite(e)
        self.neighbours = neighbours_of(found)
        # a reading whose predecessor is there is differenced; the first of a run keeps its own variance
        there = np.zeros_like(self.keep)
        there[1:] = self.keep[1:] & self.keep[:-1]
        self.correlation = np.where(there, self.neighbours.correlation(self.rho), 0.0)  # (N, m) with the one before
        self.record = np.broadcast_to(np.arange(len(p.recording))[:, None], self.keep.shape)[self.keep]
        self.sensor = np.broadcast_to(np.arange(len(p.sensors))[None], self.keep.shape)[self.keep]
        self.unmixed = _input_whitening(found, self.keep)

    def scaled(self, values: np.ndarray) -> np.ndarray:
        """Values (N, m, k) over σ, 0 where there is no reading, freed of what noise of the inputs has in common."""
        v = np.where(self.keep[:, :, None], values, 0.0) / self.sigma[:, None]
        return v if self.unmixed is None else self.unmixed @ v

    def rows(self, values: np.ndarray) -> np.ndarray:
        """Whitened rows (n, k) of values (N, m, k)."""
        v = self.scaled(values)
        if self.correlation.any():
            rho = self.correlation[:, :, None]
            before = np.concatenate([np.zeros_like(v[:1]), v[:-1]])
            v = (v - rho * before) / np.sqrt(1.0 - rho**2)
        return np.asarray(v[self.keep])


def _input_whitening(found: Identified, keep: np.ndarray) -> np.ndarray | None:
    """L⁻¹ (N, m, m) with L Lᵀ = 1 + G Gᵀ, G = σ⁻¹ ∂y/∂u σ_u: an error of an input moves all readings of its record.
    None where the inputs are exact. Exact for noise that is white in time."""
    noise = found.evidence.noise
    columns = [c for c in found.evidence.engine.inputs if c in noise.inputs or c in noise.input_shares]
    if not columns:
        return None
    u = np.column_stack([found.problem.inputs[c] for c in columns])
    share = np.array([noise.input_shares.get(c, 0.0) for c in columns])
    size = np.hypot([noise.inputs.get(c, 0.0) for c in columns], share * u)
    G = derivatives(found, columns) * size[:, None, :] / found.problem.sigma[:, None]
    G = np.where(keep[:, :, None], G, 0.0)
    L = np.linalg.cholesky(np.eye(G.shape[1]) + G @ np.swapaxes(G, 1, 2))
    return np.asarray(np.linalg.solve(L, np.broadcast_to(np.eye(G.shape[1]), L.shape)))


@dataclass(frozen=True)
class Score:
    """Of one block of columns: statistic (χ² with `dof`), its −ln p, one-step coefficients, length of the block's
    first column after projection, and the share of it that survived."""

    statistic: float
    dof: int
    surprise: float
    coefficients: np.ndarray
    length: float
    share: float

    @property
    def absorbed(self) -> bool:
        return self.dof == 0 or self.share < ABSORBED


class Projection:
    """Residual and nuisance of a fit, ready to score columns."""

    def __init__(self, found: Identified):
        self.found, self.frame = found, Frame(found)
        problem, fit = found.problem, found.fit
        J, offsets = nuisance_columns(found)
        A = self.frame.rows(np.concatenate([J, offsets], axis=2))
        free = np.concatenate([~fit.at_bound, np.ones(offsets.shape[2], bool)])
        prior = np.concatenate([fit.x, fit.z.ravel()])
        A, prior = A[:, free], prior[free]
        self.e = np.concatenate([self.frame.rows(fit.equations.residual[:, :, None])[:, 0], -prior])
        self.Q, R = np.linalg.qr(np.concatenate([A, np.eye(A.shape[1])]))
        self.left = self.e - self.Q @ (self.Q.T @ self.e)
        self.R, self.free = R, free
        self.step = np.linalg.solve(R, self.Q.T @ self.e)  # what is left of the way to the whitened optimum
        self.names = (*problem.names,)

    @property
    def objective(self) -> float:
        """χ² of readings and priors at the optimum."""
        return float(self.left @ self.left)

    @property
    def dof(self) -> int:
        """Readings: what the objective is expected to be when nothing is missing (each prior adds one and takes
        one)."""
        return len(self.e) - self.Q.shape[1]

    def covariance(self) -> np.ndarray:
        """Of the free nuisance and hypothesis parameters, in prior standard deviations."""
        inverse = np.linalg.solve(self.R, np.eye(len(self.R)))
        return np.asarray(inverse @ inverse.T)

    def projected(self, columns: np.ndarray) -> np.ndarray:
        """Columns (N, m, k) as whitened rows (n, k), without what the nuisance explains."""
        C = np.concatenate([self.frame.rows(columns), np.zeros((self.Q.shape[1], columns.shape[2]))])
        return np.asarray(C - self.Q @ (self.Q.T @ C))

    def score(self, projected: np.ndarray, full_length: float) -> Score:
        """Score of one block of projected columns (n, k); `full_length` is the first column's before projection."""
        length = float(np.linalg.norm(projected[:, 0]))
        if projected.shape[1] == 1:
            if length <= NEGLIGIBLE * max(full_length, 1e-300):
                return Score(0.0, 0, 0.0, np.zeros(1), length, 0.0)
            z = float(projected[:, 0] @ self.left) / length
            return Score(z * z, 1, float(surprise(z * z, 1)), np.array([z / length]), length, length / full_length)
        u, s, vt = np.linalg.svd(projected, full_matrices=False)
        keep = s > NEGLIGIBLE * max(full_length, 1e-300)
        w = u[:, keep].T @ self.left
        T, dof = float(w @ w), int(keep.sum())
        coefficients = vt[keep].T @ (w / s[keep])
        told = float(surprise(T, dof)) if dof else 0.0
        return Score(T, dof, told, coefficients, length, length / max(full_length, 1e-300))


def lengths(frame: Frame, columns: np.ndarray) -> np.ndarray:
    """Lengths (k,) of columns (N, m, k) as whitened rows, before projection."""
    return np.asarray(np.linalg.norm(frame.rows(columns), axis=0))


class Columns:
    """∂y/∂θ at a fit by name of the parameter, (N, m) each: of the fit's model, with effects that it does not carry."""

    def __init__(self, found: Identified, names: Iterable[str], effects: Iterable[Effect]):
        engine = found.evidence.engine
        carried = {e.label for e in (*engine.effects, *found.hypothesis.effects)}
        further = {e.label: e for e in effects if e.label not in carried}
        self._at = {n: j for j, n in enumerate(dict.fromkeys(names))}
        model = ExtendedModel(
            engine.with_effects((*engine.effects, *found.hypothesis.effects, *further.values())),
            found.model.discrepancies,
        )
        self._J = derivatives(found, tuple(self._at), model)

    def __getitem__(self, name: str) -> np.ndarray:
        return np.asarray(self._J[:, :, self._at[name]])


def derivatives(found: Identified, names: Sequence[str], model: object = None) -> np.ndarray:
    """∂y/∂θ (N, m, k) of parameters of the model, or of another model of the same records, at the fit; 0 where the
    fit has no prediction. Offsets of scale are not applied: they are of the order of 1 %."""
    m = found.model if model is None else model
    p = m.predict(found.problem.inputs, found.theta, sensors=found.problem.sensors, wrt=tuple(names))  # type: ignore[attr-defined]
    J = np.where(np.isfinite(p.jacobian), p.jacobian, 0.0)
    J[found.fit.failed] = 0.0
    return np.asarray(J)


def nuisance_columns(found: Identified) -> tuple[np.ndarray, np.ndarray]:
    """Jacobians of the parameters (N, m, p) and of the recordings' offsets (N, m, R·q), in prior deviations."""
    problem, fit = found.problem, found.fit
    N, m, (R, q) = len(problem.recording), len(problem.sensors), fit.z.shape
    J, offsets = np.zeros((N, m, len(problem.parameters))), np.zeros((N, m, R * q))
    column = [problem.sensors.index(o.sensor) for o in problem.offsets]
    for b in blocks(problem, fit.x, fit.z):
        J[b.rows] = np.nan_to_num(b.jacobian)
        rows = np.arange(b.rows.start, b.rows.stop)
        for j, s in enumerate(column):
            offsets[rows, s, problem.recording[b.rows] * q + j] = np.nan_to_num(b.offset_jacobian[:, j])
    return J, offsets
