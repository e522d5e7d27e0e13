"""Rao's score test of anything that may be missing, with everything identified as nuisance.

At a fit, rows are readings divided by σ and, where noise is correlated in time, differenced,
(e_k − ρ_k e_{k−1})/√(1 − ρ_k²) within a recording (`neighbours`); below them stand the priors' rows. With the nuisance
columns A = QR of these rows, a candidate's column c and the residual e:

    c⊥ = c − Q Qᵀc      z = c⊥ᵀe/|c⊥|      T = z² ~ χ²₁      â = z/|c⊥|      λ = (a |c⊥|)²

Source: C. R. Rao, "Large Sample Tests of Statistical Hypotheses", Proc. Camb. Phil. Soc. 44 (1948) 50–57.

**Data types.** Nothing above is held by row. Rows come by chunks of records, in order (`stream`), each once, and only
sums of them stay, which are the same however the records are cut up:

- R of A, and Qᵀe and |e⊥|² with it, by the QR of what was there with the new rows below (no square of A's condition);
  offsets of a recording touch its own rows only: eliminated where it ends, they leave R_zz, R_zx and Qᵀe of their own;
- of candidates Aᵀc, cᵀe and cᵀc (`families`), whence Qᵀc = R⁻ᵀAᵀc, c⊥ᵀc⊥ = cᵀc − |Qᵀc|², c⊥ᵀe = cᵀe − (Qᵀc)ᵀQᵀe.

Source: J. Demmel et al., "Communication-optimal Parallel and Sequential QR and LU Factorizations", SIAM J. Sci.
Comput. 34 (2012) A206–A239 (sequential QR of a tall matrix).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from enginediag_cli.identification.normal_equations import PredictionBlock, blocks
from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis
from enginediag_cli.mismatch.fit.neighbours import neighbours_of
from enginediag_cli.mismatch.fit.scores import surprise

ABSORBED = 0.01
"""Share of a column's length below which what survives the projection is not to be ranked."""

NEGLIGIBLE = 1e-6
"""Share of a column that is rounding: squares of shares come from differences of sums, which are good to 1e-13."""

KEPT_BYTES = 32_000_000
"""Of whitened rows that are kept instead of computed again, which a short recording is quicker for: 4,000 records of
nine sensors and a hundred columns."""

AT_ONCE = 4096
"""Rows of a chunk of the dense QR."""


class Frame:
    """The rows of a fit: which readings count, and how a (N, m, k) array becomes whitened rows (n, k)."""

    def __init__(self, found: IdentifiedHypothesis):
        p, e = found.problem, found.fit.equations.residual
        self.sigma, self.rho = p.sigma, found.rho
        self.keep = np.isfinite(e)
        self.neighbours = neighbours_of(found)
        # a reading whose predecessor is there is differenced; the first of a run keeps its own variance
        there = np.zeros_like(self.keep)
        there[1:] = self.keep[1:] & self.keep[:-1]
        self._before = np.where(there, self.neighbours.correlation(self.rho), 0.0)  # (N, m) with the one before
        self.correlated = bool(self._before.any())
        self.unmixed = _input_whitening(found, self.keep)

    @cached_property
    def record(self) -> np.ndarray:
        """Record of each row (n,)."""
        return np.nonzero(self.keep)[0]

    @cached_property
    def sensor(self) -> np.ndarray:
        """Sensor of each row (n,)."""
        return np.nonzero(self.keep)[1]

    def correlation(self, rows: slice = slice(None)) -> np.ndarray:
        """(n, m): correlation of each reading with the one before it, 0 where it is not differenced."""
        return self._before[rows]

    def scaled(self, values: np.ndarray, rows: slice = slice(None)) -> np.ndarray:
        """Values (n, m, k) over σ, 0 where there is no reading, freed of what noise of the inputs has in common."""
        v = np.where(self.keep[rows][:, :, None], values, 0.0) / self.sigma[:, None]
        return v if self.unmixed is None else self.unmixed[rows] @ v

    def rows(self, values: np.ndarray) -> np.ndarray:
        """Whitened rows (n, k) of values (N, m, k)."""
        return np.asarray(Whitening(self).whole(values, slice(0, len(self.keep)))[self.keep])


class Whitening:
    """Values as whitened rows, chunk by chunk in the order of the records: the last of a chunk is carried over."""

    def __init__(self, frame: Frame):
        self.frame = frame
        self._last: np.ndarray | None = None

    def parts(self, values: np.ndarray, rows: slice) -> tuple[np.ndarray, np.ndarray | None]:
        """Of values (n, m, k) of the records `rows`: v/√(1 − ρ²), and ρ v₋₁/√(1 − ρ²) of the record before, whose
        difference the whitened rows are; None where no noise is correlated. Rows without a reading are 0."""
        v = self.frame.scaled(values, rows)
        if not self.frame.correlated:
            return v, None
        first = np.zeros_like(v[:1]) if self._last is None else self._last
        before, self._last = np.concatenate([first, v[:-1]]), v[-1:]
        rho = self.frame.correlation(rows)[:, :, None]
        root = np.sqrt(1.0 - rho**2)
        # where the reading itself is missing nothing is differenced, and v is 0 already
        return v / root, before * (rho / root)

    def whole(self, values: np.ndarray, rows: slice) -> np.ndarray:
        """(n, m, k)."""
        own, before = self.parts(values, rows)
        return own if before is None else own - before


def _input_whitening(found: IdentifiedHypothesis, keep: np.ndarray) -> np.ndarray | None:
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


def score_of(gram: np.ndarray, pull: np.ndarray, full_length: float) -> Score:
    """Score of one block from C⊥ᵀC⊥ (k, k) and C⊥ᵀe (k,); `full_length` is the first column's before projection."""
    length = float(np.sqrt(max(gram[0, 0], 0.0)))
    least, full = NEGLIGIBLE * max(full_length, 1e-300), max(full_length, 1e-300)
    if len(pull) == 1:
        if length <= least:
            return Score(0.0, 0, 0.0, np.zeros(1), length, 0.0)
        z = float(pull[0]) / length
        return Score(z * z, 1, float(surprise(z * z, 1)), np.array([z / length]), length, length / full)
    values, vectors = np.linalg.eigh(gram)
    keep = values > least**2
    w, V = vectors[:, keep].T @ pull, vectors[:, keep]
    T, dof = float(np.sum(w**2 / values[keep])), int(keep.sum())
    told = float(surprise(T, dof)) if dof else 0.0
    return Score(T, dof, told, V @ (w / values[keep]), length, length / full)


@dataclass(frozen=True)
class Rows:
    """A chunk of records of one recording, whitened: nuisance parameters `A` (n, m, p), the recording's offsets `Z`
    (n, m, q) and residual `e` (n, m); 0 where there is no reading."""

    recording: int
    span: slice
    A: np.ndarray
    Z: np.ndarray
    e: np.ndarray

    @property
    def stacked(self) -> np.ndarray:
        """[Z A e] (n, m, q + p + 1)."""
        return np.concatenate([self.Z, self.A, self.e[:, :, None]], axis=2)


@dataclass(frozen=True)
class OwnOffsets:
    """What a recording's eliminated offsets leave: R_zz (q, q), R_zx (q, p), and Qᵀe of their columns (q,)."""

    R: np.ndarray
    along: np.ndarray
    pull: np.ndarray


class Projection:
    """Residual and nuisance of a fit, ready to score columns. `free` (p_all + R q,): which parameters, then offsets,
    are no nuisance at a bound; `pull` = Qᵀe (p,) of the free parameters, `step` what is left of the way to the
    whitened optimum (p,), with the offsets eliminated; `objective`: χ² of readings and priors at the optimum."""

    def __init__(self, found: IdentifiedHypothesis):
        self.found, self.frame = found, Frame(found)
        fit = found.fit
        self.names = (*found.problem.names,)
        self.free = np.concatenate([~fit.at_bound, np.ones(fit.z.size, bool)])
        self._kept: list[Rows] | None = None
        p, q = int((~fit.at_bound).sum()), fit.z.shape[1]
        triangle = np.column_stack([np.eye(p), -fit.x[~fit.at_bound]])
        self.offsets: dict[int, OwnOffsets] = {}
        rest = 0.0
        own, last = np.zeros((0, q + p + 1)), -1
        kept: list[Rows] = []
        size = 0

        def ended(r: int, own: np.ndarray) -> np.ndarray:
            if r < 0:
                return triangle
            self.offsets[r] = OwnOffsets(own[:q, :q], own[:q, q:-1], own[:q, -1])
            return _triangle(triangle, own[q:, q:])

        for rows in self._computed():
            if rows.recording != last:
                triangle = ended(last, own)
                last = rows.recording
                own = np.column_stack([np.eye(q), np.zeros((q, p)), -fit.z[last]])
            X = rows.stacked.reshape(-1, q + p + 1)
            own = _triangle(own, X[X.any(axis=1)])
            size += X.nbytes
            if size <= KEPT_BYTES:
                kept.append(rows)
        triangle = ended(last, own)
        absent = [r for r in range(len(fit.z)) if r not in self.offsets]
        rest += float(np.sum(fit.z[absent] ** 2))  # recordings without a record keep their prior's share
        triangle = np.concatenate([triangle, np.zeros((max(0, p + 1 - len(triangle)), p + 1))])
        self.R, self.pull = triangle[:p, :p], triangle[:p, p]
        self.objective = float(triangle[p, p] ** 2) + rest
        self.step = np.linalg.solve(self.R, self.pull)
        self._kept = kept if size <= KEPT_BYTES else None

    @property
    def kept(self) -> dict[str, Any]:
        """All that it is but the fit."""
        return {name: value for name, value in vars(self).items() if name != "found"}

    @classmethod
    def again(cls, found: IdentifiedHypothesis, kept: Mapping[str, Any]) -> Projection:
        """What another process has `kept`, of the same fit."""
        new = cls.__new__(cls)
        vars(new).update(kept, found=found)
        return new

    def stream(self) -> Iterator[Rows]:
        """All records by chunks, in order."""
        yield from self._computed() if self._kept is None else self._kept

    def rest(self) -> None:
        """Hold no rows: what asks for them again has them computed again."""
        self._kept = None
        self.found.model.forget_predictions()

    def _computed(self) -> Iterator[Rows]:
        problem, fit = self.found.problem, self.found.fit
        whitening, p = Whitening(self.frame), int((~fit.at_bound).sum())
        for b in blocks(problem, fit.x, fit.z):
            offsets = offset_columns(self.found, b)
            e = fit.equations.residual[b.rows][:, :, None]
            X = np.concatenate([np.nan_to_num(b.jacobian[:, :, ~fit.at_bound]), offsets, np.nan_to_num(e)], axis=2)
            X = whitening.whole(X, b.rows)
            for r, part in runs(problem.recording, b.rows):
                own = X[part.start - b.rows.start : part.stop - b.rows.start]
                yield Rows(r, part, own[:, :, :p], own[:, :, p:-1], own[:, :, -1])

    @property
    def dof(self) -> int:
        """Readings: what the objective is expected to be when nothing is missing (each prior adds one and takes
        one)."""
        return int(self.frame.keep.sum())

    def covariance(self) -> np.ndarray:
        """Of the free nuisance and hypothesis parameters, in prior standard deviations, (p, p)."""
        inverse = np.linalg.solve(self.R, np.eye(len(self.R)))
        return np.asarray(inverse @ inverse.T)

    def offset_step(self, recording: int) -> np.ndarray:
        """What is left of the way of a recording's offsets (q,) when the parameters have gone theirs."""
        own = self.offsets[recording]
        return np.asarray(np.linalg.solve(own.R, own.pull - own.along @ self.step))

    @cached_property
    def residual(self) -> np.ndarray:
        """e⊥ (N, m): whitened residual at the optimum, 0 where there is no reading."""
        left = np.empty(self.frame.keep.shape)
        for rows in self.stream():
            left[rows.span] = rows.e - rows.A @ self.step - rows.Z @ self.offset_step(rows.recording)
        return left

    @property
    def left(self) -> np.ndarray:
        """e⊥ by row (n,)."""
        return np.asarray(self.residual[self.frame.keep])


class DenseRows:
    """A = QR of all whitened rows, the priors' last, offsets of every recording as columns of their own, for searches
    that need them by record: Q of the readings `rows` (N, m, k), 0 where there is none, and of the `priors` (k, k),
    R (k, k), `e` (N, m) and `e_priors` (k,). Grows with the records: of use for a while, not to be kept."""

    def __init__(self, projection: Projection):
        found = projection.found
        (N, m), (R, q), p = projection.frame.keep.shape, found.fit.z.shape, len(projection.R)
        k = p + R * q
        self.rows, self.e = np.zeros((N, m, k)), np.zeros((N, m))
        self.e_priors = -np.concatenate([found.fit.x[~found.fit.at_bound], found.fit.z.ravel()])
        for rows in projection.stream():
            own = p + rows.recording * q
            self.rows[rows.span, :, :p], self.rows[rows.span, :, own : own + q] = rows.A, rows.Z
            self.e[rows.span] = rows.e
        # in place, by chunks: several copies of these rows would be the most that a search ever holds. Priors' rows
        # keep every singular value of A above 1, so that A R⁻¹ is orthogonal to rounding
        A = self.rows.reshape(-1, k)
        chunks = [slice(a, a + AT_ONCE) for a in range(0, len(A), AT_ONCE)]
        self.R = np.eye(k)
        for part in chunks:
            self.R = _triangle(self.R, A[part])
        self.priors = np.linalg.inv(self.R)
        for part in chunks:
            A[part] = A[part] @ self.priors

    def free(self, column: int) -> None:
        """Take a column of A out of the span, in place.

        Of the span of A = QR the direction Qu, u ∝ R⁻ᵀ1_j, is across every column but the j-th: a reflection that
        takes the first axis to u leaves an orthonormal basis of the others, (Q(1 − 2vvᵀ))₂…"""
        v = self.priors[column] / np.linalg.norm(self.priors[column])
        v[0] += np.copysign(1.0, v[0])
        v /= np.linalg.norm(v)
        A = self.rows.reshape(-1, len(v))
        for a in range(0, len(A), AT_ONCE):
            A[a : a + AT_ONCE, 1:] -= np.outer(2.0 * (A[a : a + AT_ONCE] @ v), v[1:])
        priors = self.priors[:, 1:] - np.outer(2.0 * (self.priors @ v), v[1:])
        self.rows = self.rows[:, :, 1:]
        self.priors, self.e_priors = np.delete(priors, column, axis=0), np.delete(self.e_priors, column)


def _triangle(above: np.ndarray, below: np.ndarray) -> np.ndarray:
    """R of the QR of rows on top of each other."""
    return np.asarray(np.linalg.qr(np.concatenate([above, below]), mode="r"))


def runs(recording: np.ndarray, rows: slice) -> Iterator[tuple[int, slice]]:
    """Records `rows` divided by recording."""
    own = recording[rows]
    edges = [0, *(np.flatnonzero(np.diff(own)) + 1), len(own)]
    for a, b in pairwise(edges):
        yield int(own[a]), slice(rows.start + int(a), rows.start + int(b))


def offset_columns(found: IdentifiedHypothesis, b: PredictionBlock) -> np.ndarray:
    """∂y/∂z (n, m, q) of the offsets of each record's own recording."""
    return np.nan_to_num(b.offset_columns(found.problem))


def derivatives(
    found: IdentifiedHypothesis, names: Sequence[str], model: object = None, rows: slice = slice(None)
) -> np.ndarray:
    """∂y/∂θ (n, m, k) of parameters of the model, or of another model of the same records, at the fit; 0 where the
    fit has no prediction. Offsets of scale are not applied: they are of the order of 1 %."""
    m = found.model if model is None else model
    inputs = {c: v[rows] for c, v in found.problem.inputs.items()}
    p = m.predict(inputs, found.theta, sensors=found.problem.sensors, wrt=tuple(names))  # type: ignore[attr-defined]
    J = np.where(np.isfinite(p.jacobian), p.jacobian, 0.0)
    J[found.fit.failed[rows]] = 0.0
    return np.asarray(J)


def nuisance_columns(found: IdentifiedHypothesis) -> tuple[np.ndarray, np.ndarray]:
    """Jacobians of the parameters (N, m, p) and of the recordings' offsets (N, m, R·q), in prior deviations."""
    problem, fit = found.problem, found.fit
    N, m, (R, q) = len(problem.recording), len(problem.sensors), fit.z.shape
    J, offsets = np.zeros((N, m, len(problem.parameters))), np.zeros((N, m, R * q))
    for b in blocks(problem, fit.x, fit.z):
        J[b.rows] = np.nan_to_num(b.jacobian)
        own = offset_columns(found, b)
        for r, part in runs(problem.recording, b.rows):
            offsets[part, :, r * q : (r + 1) * q] = own[part.start - b.rows.start : part.stop - b.rows.start]
    return J, offsets
