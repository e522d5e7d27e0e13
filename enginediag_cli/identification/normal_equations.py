"""Model, residuals and normal equations of the identification problem at one point.

With x the parameters and z_r the offsets of recording r, both in prior standard deviations, and weights
w_ks, the normal matrix has the shape of an arrow:

    [ H_xx   H_xz1  H_xz2 … ]      H_xx = Σ_ks w_ks J_ks J_ksᵀ/(κ_s σ_s²)      (p, p)
    [ H_z1x  H_z1z1         ]      H_xz = Σ_{k in r} w_ks J_ks g_ks/(κ_s σ_s²) (R, p, q)
    [ H_z2x         H_z2z2  ]      H_zz                                       (R, q, q)

so the offsets of any number of recordings are eliminated one recording at a time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from enginediag_cli.identification.problem import Problem

CHUNK_RECORDS = 2048
"""Records per model call: bounds the memory of the sensitivities, (records, m, p), to what a processor has near by."""


@dataclass(frozen=True)
class Block:
    """Predictions of a run of consecutive records, scaled to prior standard deviations."""

    rows: slice
    predicted: np.ndarray  # (n, m) with offsets, NaN where the model gave none
    jacobian: np.ndarray  # (n, m, p) ∂y/∂x
    offset_jacobian: np.ndarray  # (n, q − i) ∂y_s/∂z for the one sensor s that each offset of an output acts on
    status: np.ndarray  # (n,) int8, as the engine gives it
    input_jacobian: np.ndarray  # (n, m, i) ∂y/∂z of the offsets of inputs, which come last

    def offset_columns(self, problem: Problem) -> np.ndarray:
        """∂y/∂z (n, m, q) of all offsets of each record's recording."""
        n, outputs = len(self.predicted), self.offset_jacobian.shape[1]
        found = np.zeros((n, len(problem.sensors), outputs))
        column = [problem.sensors.index(o.sensor) for o in problem.offsets[:outputs]]
        found[:, column, range(outputs)] = self.offset_jacobian
        return np.concatenate([found, self.input_jacobian], axis=2)


@dataclass(frozen=True)
class NormalEquations:
    """Sums over all records that have a prediction; priors are not in them."""

    predicted: np.ndarray  # (N, m)
    residual: np.ndarray  # (N, m) in the column's unit, NaN where reading or prediction is missing
    status: np.ndarray  # (N,)
    record_cost: np.ndarray  # (N,) Σ_s ρ(e/σ)/κ
    H_xx: np.ndarray
    H_xz: np.ndarray
    H_zz: np.ndarray
    g_x: np.ndarray  # (p,) gradient of the cost
    g_z: np.ndarray  # (R, q)

    @property
    def ok(self) -> np.ndarray:
        """Records with a prediction, (N,) bool."""
        return self.status <= 1


@dataclass(frozen=True)
class Arrow:
    """Normal equations with priors added and the offsets eliminated (Schur complement)."""

    S: np.ndarray  # (p, p) H_xx + 1 − Σ H_xz (H_zz + 1)⁻¹ H_zx
    g: np.ndarray  # (p,)
    gain: np.ndarray  # (R, p, q) H_xz (H_zz + 1)⁻¹


def blocks(problem: Problem, x: np.ndarray, z: np.ndarray, *, sensitivities: bool = True) -> Iterator[Block]:
    """Predictions and their derivatives, a bounded number of records at a time."""
    theta = problem.physical(x)
    wrt = problem.names if sensitivities else ()
    column = {s: i for i, s in enumerate(problem.sensors)}
    N, outputs = len(problem.recording), len(problem.offsets) - problem.input_offsets
    of_inputs = problem.offsets[outputs:]
    along = tuple(dict.fromkeys(o.sensor for o in of_inputs)) if sensitivities else ()
    for start in range(0, N, CHUNK_RECORDS):
        rows = slice(start, min(start + CHUNK_RECORDS, N))
        read = {c: v[rows] for c, v in problem.inputs.items()}
        inputs = dict(read)
        for j, o in enumerate(of_inputs, outputs):
            value = o.prior_sigma * z[problem.recording[rows], j]
            if np.any(value):
                inputs[o.sensor] = inputs[o.sensor] - value * (1.0 if o.kind == "bias" else read[o.sensor])
        p = problem.model.predict(inputs, theta, sensors=problem.sensors, wrt=(*wrt, *along))
        y = np.array(p.y, float)
        along_all = np.asarray(p.jacobian, float)
        # a point whose derivatives cannot be had cannot take part in the fit, whatever its value
        status = np.where(np.isfinite(along_all.sum(axis=(1, 2))), p.status, np.maximum(p.status, 2)).astype(np.int8)
        y[status > 1] = np.nan
        offset_J = np.empty((len(y), outputs))
        input_J = np.zeros((*y.shape, len(of_inputs)))
        for j, o in enumerate(of_inputs if sensitivities else ()):
            read_by = 1.0 if o.kind == "bias" else read[o.sensor][:, None]
            input_J[:, :, j] = -o.prior_sigma * read_by * along_all[:, :, len(wrt) + along.index(o.sensor)]
        shift, factor = np.zeros_like(y), np.ones_like(y)
        for j, o in enumerate(problem.offsets[:outputs]):
            s = column[o.sensor]
            value = o.prior_sigma * z[problem.recording[rows], j]
            if o.kind == "bias":
                shift[:, s] += value
                offset_J[:, j] = o.prior_sigma
            else:
                factor[:, s] += value
                offset_J[:, j] = o.prior_sigma * y[:, s]
        J = along_all[:, :, : len(wrt)] * (factor[:, :, None] * problem.prior_sigma[: len(wrt)])
        input_J *= factor[:, :, None]
        yield Block(rows, y * factor + shift, J, offset_J, status, input_J)


def predict(problem: Problem, x: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Predicted readings with offsets (N, m), NaN where the model gave none, and status (N,)."""
    parts = list(blocks(problem, x, z, sensitivities=False))
    return np.concatenate([b.predicted for b in parts]), np.concatenate([b.status for b in parts])


def normal_equations(problem: Problem, x: np.ndarray, z: np.ndarray) -> NormalEquations:
    """Robust cost, its gradient and its reweighted Gauss–Newton matrix at (x, z)."""
    N, p, (R, q) = len(problem.recording), len(x), z.shape
    predicted, status = np.empty((N, len(problem.sensors))), np.empty(N, np.int8)
    cost = np.zeros(N)
    H_xx, g_x = np.zeros((p, p)), np.zeros(p)
    H_xz, H_zz, g_z = np.zeros((R, p, q)), np.zeros((R, q, q)), np.zeros((R, q))
    for b in blocks(problem, x, z):
        e = problem.measured[b.rows] - b.predicted
        scaled = np.nan_to_num(e / problem.sigma)  # a missing reading has no residual and no weight
        there = np.isfinite(e)
        cost[b.rows] = (problem.loss.cost(scaled) * there / problem.inflation).sum(axis=1)
        w = problem.loss.weight(scaled) * there / (problem.sigma**2 * problem.inflation)
        pull = w * scaled * problem.sigma
        parts = accumulate(problem, b, w, pull)
        here = parts.recordings
        H_xx += parts.H_xx
        H_xz[here] += parts.H_xz
        H_zz[here] += parts.H_zz
        g_x -= parts.g_x
        g_z[here] -= parts.g_z
        predicted[b.rows], status[b.rows] = b.predicted, b.status
    return NormalEquations(predicted, problem.measured - predicted, status, cost, H_xx, H_xz, H_zz, g_x, g_z)


@dataclass(frozen=True)
class Sums:
    """Weighted sums over the records of a block, of which those of offsets are of its r recordings alone, `recordings`:
    H_xx (p, p), H_xz (r, p, q), H_zz (r, q, q), g_x (p,), g_z (r, q)."""

    recordings: np.ndarray
    H_xx: np.ndarray
    H_xz: np.ndarray
    H_zz: np.ndarray
    g_x: np.ndarray
    g_z: np.ndarray


def accumulate(problem: Problem, block: Block, w: np.ndarray, pull: np.ndarray) -> Sums:
    """Weighted sums of H and of Jᵀ pull for x and z; `w` and `pull` are (n, m), 0 where missing."""
    p, outputs, q = block.jacobian.shape[2], block.offset_jacobian.shape[1], len(problem.offsets)
    there = w > 0
    J = block.jacobian if there.all() else np.where(there[:, :, None], block.jacobian, 0.0)
    flat = J.reshape(-1, p)
    half = flat * np.sqrt(w).reshape(-1, 1)
    H_xx = half.T @ half
    g_x = flat.T @ pull.reshape(-1)
    recordings, starts = np.unique(problem.recording[block.rows], return_index=True)  # records of one stand together
    r = len(recordings)
    H_xz, H_zz, g_z = np.zeros((r, p, q)), np.zeros((r, q, q)), np.zeros((r, q))
    found = Sums(recordings, H_xx, H_xz, H_zz, g_x, g_z)
    if not q:
        return found
    column = np.array([problem.sensors.index(o.sensor) for o in problem.offsets[:outputs]], int)
    weight = w[:, column]
    G = np.where(weight > 0, block.offset_jacobian, 0.0)
    g_z[:, :outputs] = np.add.reduceat(G * pull[:, column], starts)
    if q > outputs:
        I = np.where(there[:, :, None], block.input_jacobian, 0.0)
        weighted = np.swapaxes(I * w[:, :, None], 1, 2)  # (n, i, m)
        H_xz[:, :, outputs:] = np.swapaxes(np.add.reduceat(weighted @ J, starts), 1, 2)
        H_zz[:, outputs:, outputs:] = np.add.reduceat(weighted @ I, starts)
        both = np.add.reduceat(weighted[:, :, column] * G[:, None, :], starts)
        H_zz[:, outputs:, :outputs], H_zz[:, :outputs, outputs:] = both, np.swapaxes(both, 1, 2)
        g_z[:, outputs:] = np.add.reduceat(np.einsum("nmi,nm->ni", I, pull), starts)
    for j, s in enumerate(column):
        pulled = (G[:, j] * weight[:, j])[:, None]
        H_xz[:, :, j] = np.add.reduceat(pulled * J[:, s], starts)
        same = np.flatnonzero(column == s)
        H_zz[:, j, same] = np.add.reduceat(pulled * G[:, same], starts)
    return found


def eliminate(
    H_xx: np.ndarray,
    H_xz: np.ndarray,
    H_zz: np.ndarray,
    g_x: np.ndarray,
    g_z: np.ndarray,
    x: np.ndarray,
    z: np.ndarray,
) -> Arrow:
    """Add the unit priors at (x, z) and eliminate the offsets of every recording."""
    q = z.shape[1]
    A = H_zz + np.eye(q)
    gain = np.swapaxes(np.linalg.solve(A, np.swapaxes(H_xz, 1, 2)), 1, 2)
    flat, cross = (np.swapaxes(part, 0, 1).reshape(len(x), -1) for part in (gain, H_xz))
    S = H_xx + np.eye(len(x)) - flat @ cross.T
    g = g_x + x - flat @ (g_z + z).ravel()
    return Arrow((S + S.T) / 2, g, gain)


def offset_step(n: NormalEquations, z: np.ndarray, dx: np.ndarray) -> np.ndarray:
    """Best change of the offsets (R, q) when the parameters change by dx (p,)."""
    rhs = n.g_z + z + np.swapaxes(n.H_xz, 1, 2) @ dx
    return -np.linalg.solve(n.H_zz + np.eye(z.shape[1]), rhs[:, :, None])[:, :, 0]
