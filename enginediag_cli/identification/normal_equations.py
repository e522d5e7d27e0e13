"""Model, residuals and normal equations of the identification problem at one point.

With x the parameters and z_r the offsets of recording r, both in prior standard deviations, and weights
w_ks, the normal matrix has the shape of an arrow:

    [ H_xx   H_xz1  H_xz2 … ]      H_xx = Σ_ks w_ks J_ks J_ksᵀ/(κ_s σ_s²)      (p, p)
    [ H_z1x  H_z1z1         ]      H_xz = Σ_{k in r} w_ks J_ks g_ks/(κ_s σ_s²) (R, p, q)
    [ H_z2x         H_z2z2  ]      H_zz                                       (R, q, q)

so the offsets of any number of recordings are eliminated one recording at a time.

**Predictions.** Derivatives cost several times what the readings do, and change slowly: near where they were taken a
fit goes on with the same ones and computes readings alone (the chord method; C. T. Kelley, Iterative Methods for Linear
and Nonlinear Equations, SIAM 1995, §5.4.1). What is kept is in the units of the parameters and without offsets of
outputs, so that other noise, other sizes of map errors and excluded records need no new ones; the derivatives by
amounts of map error follow from columns of the records.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.error_model.maps import MapErrorModel
from enginediag_cli.identification.problem import IdentificationProblem

SUMMED_RECORDS = 512
"""Records of which products are summed at once where the predictions are there: few enough that their sensitivities
stay in the processor's cache between the products, enough that each product is worth its call."""


@dataclass(frozen=True)
class ModelAnswer:
    """What the model says of n records: readings (n, m), status (n,) and derivatives (n, m, k)."""

    y: np.ndarray
    status: np.ndarray
    derivatives: np.ndarray


@dataclass(frozen=True)
class Tangent:
    """Derivatives of all readings, as products of few numbers where they are; 0 where the model had none.

    names: the k parameters for which the model gives derivatives, all that are estimated but amounts of map error, and
    inputs with offsets; own (N, m, k): derivatives by them, to seven digits, more than they are known to; of_maps (N,
    m, G) and curves (N, G, c): those by amounts are their products.
    """

    names: tuple[str, ...]
    own: np.ndarray
    of_maps: np.ndarray
    curves: np.ndarray
    valid: np.ndarray  # (N,) bool

    @property
    def amounts(self) -> int:
        """How many amounts of map error there are."""
        return self.curves.shape[1] * self.curves.shape[2]


@dataclass(frozen=True)
class Predicted:
    """Readings (N, m) at a point, without offsets of outputs, NaN where there are none; status (N,); and derivatives,
    `taken` at this very point or near by."""

    y: np.ndarray
    status: np.ndarray
    tangent: Tangent
    exact: bool

    def matches(self, problem: IdentificationProblem) -> bool:
        """Whether the derivatives are those that this problem asks for."""
        t = self.tangent
        return (
            t.names == derivative_names(problem) and t.amounts == count_map_errors(problem) and self._records(problem)
        )

    def _records(self, problem: IdentificationProblem) -> bool:
        return len(self.y) == len(problem.recording)

    def select(self, keep: np.ndarray) -> Predicted:
        """The same of the records where `keep` (N,) is true."""
        t = self.tangent
        tangent = Tangent(t.names, t.own[keep], t.of_maps[keep], t.curves[keep], t.valid[keep])
        return Predicted(self.y[keep], self.status[keep], tangent, self.exact)

    def replace_curves(self, problem: IdentificationProblem, x: np.ndarray) -> Predicted:
        """The same at x (p,) where errors of maps follow the curves of another problem, which readings follow linearly;
        itself where there are none."""
        t, model = self.tangent, problem.model
        if not t.amounts or not isinstance(model, MapErrorModel):
            return self
        curves = model.factors(problem.inputs, problem.sensors)[1]
        amounts = (problem.prior_sigma * x + problem.prior_mean)[-t.amounts :].reshape(t.curves.shape[1:])
        moved = np.einsum("ngc,gc->ng", curves - t.curves, amounts)
        y = self.y + np.matmul(t.of_maps, moved[:, :, None])[:, :, 0]
        return Predicted(y, self.status, replace(t, curves=curves), self.exact)

    def parameter_jacobian(self, problem: IdentificationProblem, rows: slice) -> np.ndarray:
        """Derivatives (n, m, p) by all parameters that are sought; a new array."""
        t = self.tangent
        own = len(problem.names) - t.amounts
        n, m = self.y[rows].shape
        J = np.empty((n, m, own + t.amounts))
        J[:, :, :own] = t.own[rows, :, :own]
        if t.amounts:
            amounts = J[:, :, own:].reshape(n, m, *t.curves.shape[1:])  # one axis as two: a view, whatever the strides
            np.multiply(t.of_maps[rows, :, :, None], t.curves[rows, None], out=amounts)
        return J

    def input_jacobian(self, problem: IdentificationProblem, rows: slice) -> np.ndarray:
        """Derivatives (n, m, a) by the inputs that have offsets."""
        return self.tangent.own[rows, :, len(problem.names) - self.tangent.amounts :].astype(float)

    def pull_gradient(self, problem: IdentificationProblem, pull: np.ndarray) -> np.ndarray:
        """Σ pull ∂y/∂θ over all records and sensors, (p,), for pull (N, m)."""
        t = self.tangent
        own = np.zeros(t.own.shape[2])
        for first in range(0, len(pull), SUMMED_RECORDS):
            rows = slice(first, first + SUMMED_RECORDS)
            own += pull[rows].reshape(-1) @ t.own[rows].reshape(pull[rows].size, -1).astype(float)
        of_maps = np.matmul(pull[:, None, :], t.of_maps)[:, 0]  # (N, G)
        amounts = np.einsum("ng,ngc->gc", of_maps, t.curves).reshape(-1)
        return np.concatenate([own[: len(problem.names) - t.amounts], amounts])


def count_map_errors(problem: IdentificationProblem) -> int:
    """How many of the parameters, the last ones, are amounts of map error whose effects the records bring along."""
    model = problem.model
    if not isinstance(model, MapErrorModel) or problem.names[-len(model.amounts) :] != model.amounts:
        return 0
    return len(model.amounts) if model.has_frozen_columns(problem.inputs, problem.sensors) else 0


def offset_inputs(problem: IdentificationProblem) -> tuple[str, ...]:
    """Inputs that have offsets."""
    outputs = len(problem.offsets) - problem.input_offsets
    return tuple(dict.fromkeys(o.sensor for o in problem.offsets[outputs:]))


def derivative_names(problem: IdentificationProblem) -> tuple[str, ...]:
    """The parameters for which the model gives derivatives."""
    return (*problem.names[: len(problem.names) - count_map_errors(problem)], *offset_inputs(problem))


def query_model(
    problem: IdentificationProblem, x: np.ndarray, z: np.ndarray, wrt: tuple[str, ...]
) -> Iterator[ModelAnswer]:
    """What the model says at (x, z), `CHUNK_RECORDS` at a time."""
    theta, N, outputs = problem.to_physical(x), len(problem.recording), len(problem.offsets) - problem.input_offsets
    for start in range(0, N, CHUNK_RECORDS):
        rows = slice(start, min(start + CHUNK_RECORDS, N))
        read = {c: v[rows] for c, v in problem.inputs.items()}
        inputs = dict(read)
        for j, o in enumerate(problem.offsets[outputs:], outputs):
            value = o.prior_sigma * z[problem.recording[rows], j]
            if np.any(value):
                inputs[o.sensor] = inputs[o.sensor] - value * (1.0 if o.kind == "bias" else read[o.sensor])
        p = problem.model.predict(inputs, theta, sensors=problem.sensors, wrt=wrt)
        y, derivatives = np.array(p.y, float), np.asarray(p.jacobian, float)
        # a point whose derivatives cannot be had cannot take part in the fit, whatever its value
        known = np.isfinite(derivatives.sum(axis=(1, 2)))
        status = np.where(known, p.status, np.maximum(p.status, 2)).astype(np.int8)
        y[status > 1] = np.nan
        yield ModelAnswer(y, status, derivatives)


def predict_records(
    problem: IdentificationProblem, x: np.ndarray, z: np.ndarray, near: Predicted | None = None
) -> Predicted:
    """Readings at (x, z), to be kept: with derivatives that are taken there, or with those of a point near by."""
    wrt = derivative_names(problem)
    N, m = problem.measured.shape
    y, status = np.empty((N, m)), np.empty(N, np.int8)
    tangent = _empty(problem, wrt) if near is None else near.tangent
    first = 0
    for part in query_model(problem, x, z, wrt if near is None else ()):
        rows = slice(first, first + len(part.y))
        first = rows.stop
        y[rows], status[rows] = part.y, part.status
        if near is None:
            tangent.valid[rows] = part.status <= 1
            tangent.own[rows] = part.derivatives
            tangent.own[rows][part.status > 1] = 0.0
    if near is None:
        tangent.of_maps[~tangent.valid] = 0.0
    else:
        unknown = ~tangent.valid
        y[unknown], status[unknown] = np.nan, np.maximum(status[unknown], 2)
    return Predicted(y, status, tangent, near is None)


def _empty(problem: IdentificationProblem, wrt: tuple[str, ...]) -> Tangent:
    """Derivatives of which only those by amounts of map error are there."""
    N, m = problem.measured.shape
    of_maps, curves = np.empty((N, m, 0)), np.empty((N, 0, 0))
    if count_map_errors(problem):
        assert isinstance(problem.model, MapErrorModel)
        of_maps, curves = problem.model.factors(problem.inputs, problem.sensors)
    return Tangent(wrt, np.empty((N, m, len(wrt)), np.float32), of_maps, curves, np.ones(N, bool))


CHUNK_RECORDS = 1024
"""Records per model call: bounds the memory of the sensitivities, (records, m, p), to what a processor has near by."""


@dataclass(frozen=True)
class PredictionBlock:
    """Predictions of a run of consecutive records, scaled to prior standard deviations."""

    rows: slice
    predicted: np.ndarray  # (n, m) with offsets, NaN where the model gave none
    jacobian: np.ndarray  # (n, m, p) ∂y/∂x, 0 where the model gave none
    offset_jacobian: np.ndarray  # (n, q − i) ∂y_s/∂z for the one sensor s that each offset of an output acts on
    status: np.ndarray  # (n,) int8, as the engine gives it
    input_jacobian: np.ndarray  # (n, m, i) ∂y/∂z of the offsets of inputs, which come last

    def offset_columns(self, problem: IdentificationProblem) -> np.ndarray:
        """∂y/∂z (n, m, q) of all offsets of each record's recording, 0 where the model gave none."""
        n, outputs = len(self.predicted), self.offset_jacobian.shape[1]
        found = np.zeros((n, len(problem.sensors), outputs + self.input_jacobian.shape[2]))
        column = [problem.sensors.index(o.sensor) for o in problem.offsets[:outputs]]
        found[:, column, range(outputs)] = np.where((self.status <= 1)[:, None], self.offset_jacobian, 0.0)
        found[:, :, outputs:] = self.input_jacobian
        return found


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
    prediction: Predicted | None = None  # what they were made of, where that was kept

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


def blocks(
    problem: IdentificationProblem,
    x: np.ndarray,
    z: np.ndarray,
    *,
    sensitivities: bool = True,
    at: Predicted | None = None,
    records: int | None = None,
    every: int = 1,
) -> Iterator[PredictionBlock]:
    """Predictions and their derivatives, a bounded number of records at a time; `at`: what is predicted at (x, z),
    where that is known, which is then dealt out `records` at a time, one block of `every` so many."""
    first, p = 0, len(problem.names) if sensitivities else 0
    if at is not None and sensitivities:
        N, size = len(problem.recording), records or CHUNK_RECORDS
        for first in range(0, N, size * every):
            rows = slice(first, min(first + size, N))
            J, along = at.parameter_jacobian(problem, rows), at.input_jacobian(problem, rows)
            yield _block(problem, z, rows, (at.y[rows], at.status[rows], J, along))
        return
    wrt = (*problem.names, *offset_inputs(problem)) if sensitivities else ()
    for part in query_model(problem, x, z, wrt):
        rows = slice(first, first + len(part.y))
        first = rows.stop
        D = np.where((part.status <= 1)[:, None, None], part.derivatives, 0.0)
        yield _block(problem, z, rows, (part.y, part.status, D[:, :, :p], D[:, :, p:]))


def _block(
    problem: IdentificationProblem,
    z: np.ndarray,
    rows: slice,
    found: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
) -> PredictionBlock:
    """Readings (n, m), status (n,) and derivatives by parameters, which may be overwritten, and by inputs, with offsets
    and in prior standard deviations."""
    y, status, J, along = found
    outputs, p = len(problem.offsets) - problem.input_offsets, J.shape[2]
    of_inputs, inputs = problem.offsets[outputs:], offset_inputs(problem)
    column = {s: i for i, s in enumerate(problem.sensors)}
    offset_J = np.empty((len(y), outputs))
    input_J = np.zeros((*y.shape, len(of_inputs)))
    for j, o in enumerate(of_inputs if along.shape[2] else ()):
        read_by = 1.0 if o.kind == "bias" else problem.inputs[o.sensor][rows][:, None]
        input_J[:, :, j] = -o.prior_sigma * read_by * along[:, :, inputs.index(o.sensor)]
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
    J *= factor[:, :, None] * problem.prior_sigma[:p]
    input_J *= factor[:, :, None]
    return PredictionBlock(rows, y * factor + shift, J, offset_J, status, input_J)


def predict(problem: IdentificationProblem, x: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Predicted readings with offsets (N, m), NaN where the model gave none, and status (N,)."""
    parts = list(blocks(problem, x, z, sensitivities=False))
    return np.concatenate([b.predicted for b in parts]), np.concatenate([b.status for b in parts])


def normal_equations(
    problem: IdentificationProblem, x: np.ndarray, z: np.ndarray, at: Predicted | None = None
) -> NormalEquations:
    """Robust cost, its gradient and its reweighted Gauss–Newton matrix at (x, z); `at`: what is predicted there."""
    N, p, (R, q) = len(problem.recording), len(x), z.shape
    predicted, status = np.empty((N, len(problem.sensors))), np.empty(N, np.int8)
    cost = np.zeros(N)
    H_xx, g_x = np.zeros((p, p)), np.zeros(p)
    H_xz, H_zz, g_z = np.zeros((R, p, q)), np.zeros((R, q, q)), np.zeros((R, q))
    for b in blocks(problem, x, z, at=at, records=SUMMED_RECORDS):
        cost[b.rows], w, pull = _robust_pull(problem, problem.measured[b.rows] - b.predicted)
        parts = accumulate(problem, b, w, pull)
        here = parts.recordings
        H_xx += parts.H_xx
        H_xz[here] += parts.H_xz
        H_zz[here] += parts.H_zz
        g_x -= parts.g_x
        g_z[here] -= parts.g_z
        predicted[b.rows], status[b.rows] = b.predicted, b.status
    return NormalEquations(predicted, problem.measured - predicted, status, cost, H_xx, H_xz, H_zz, g_x, g_z, at)


def near_equations(
    problem: IdentificationProblem, x: np.ndarray, z: np.ndarray, near: NormalEquations
) -> NormalEquations:
    """Cost at (x, z), its gradient with the derivatives of a point near by, and the matrix of that point. `near` must
    have kept what it was made of."""
    assert near.prediction is not None
    at = predict_records(problem, x, z, near.prediction)
    outputs = len(problem.offsets) - problem.input_offsets
    nothing = np.empty((*at.y.shape, 0))
    b = _block(problem, z, slice(None), (at.y, at.status, nothing, at.input_jacobian(problem, slice(None))))
    residual = problem.measured - b.predicted
    cost, _, pull = _robust_pull(problem, residual)
    factor = np.ones_like(pull)
    for j, o in enumerate(problem.offsets[:outputs]):
        if o.kind == "scale":
            factor[:, problem.sensors.index(o.sensor)] += o.prior_sigma * z[problem.recording, j]
    g_x = -at.pull_gradient(problem, pull * factor) * problem.prior_sigma
    g_z = np.zeros_like(z)
    columns = [problem.sensors.index(o.sensor) for o in problem.offsets[:outputs]]
    G = np.where((at.status <= 1)[:, None], b.offset_jacobian, 0.0) * pull[:, columns]
    of_inputs = np.matmul(pull[:, None, :], b.input_jacobian)[:, 0]
    for j, column in enumerate(np.concatenate([G, of_inputs], axis=1).T):
        g_z[:, j] = -np.bincount(problem.recording, column, len(z))
    return replace(
        near,
        predicted=b.predicted,
        residual=residual,
        status=at.status,
        record_cost=cost,
        g_x=g_x,
        g_z=g_z,
        prediction=at,
    )


def _robust_pull(problem: IdentificationProblem, e: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cost of each record (n,), weights and pull of each reading (n, m) from residuals (n, m), NaN where missing."""
    scaled = np.nan_to_num(e / problem.sigma)  # a missing reading has no residual and no weight
    there = np.isfinite(e)
    cost = (problem.loss.cost(scaled) * there / problem.inflation).sum(axis=1)
    w = problem.loss.weight(scaled) * there / (problem.sigma**2 * problem.inflation)
    return cost, w, w * scaled * problem.sigma


@dataclass(frozen=True)
class BlockSums:
    """Weighted sums over the records of a block, of which those of offsets are of its r recordings alone, `recordings`:
    H_xx (p, p), H_xz (r, p, q), H_zz (r, q, q), g_x (p,), g_z (r, q)."""

    recordings: np.ndarray
    H_xx: np.ndarray
    H_xz: np.ndarray
    H_zz: np.ndarray
    g_x: np.ndarray
    g_z: np.ndarray


def accumulate(problem: IdentificationProblem, block: PredictionBlock, w: np.ndarray, pull: np.ndarray) -> BlockSums:
    """Weighted sums of H and of Jᵀ pull for x and z; `w` and `pull` are (n, m), 0 where missing."""
    n, m, p = block.jacobian.shape
    q = len(problem.offsets)
    flat = block.jacobian.reshape(-1, p)
    half = flat * np.sqrt(w).reshape(-1, 1)
    H_xx = half.T @ half
    g_x = pull.reshape(-1) @ flat
    recordings, starts = np.unique(problem.recording[block.rows], return_index=True)  # records of one stand together
    r = len(recordings)
    found = BlockSums(recordings, H_xx, np.zeros((r, p, q)), np.zeros((r, q, q)), g_x, np.zeros((r, q)))
    if not q:
        return found
    columns = block.offset_columns(problem)  # (n, m, q)
    weighted = columns * w[:, :, None]
    pulled = columns * pull[:, :, None]
    for k, (first, stop) in enumerate(zip(starts, [*starts[1:], n], strict=True)):
        C = weighted[first:stop].reshape(-1, q)
        np.matmul(flat[first * m : stop * m].T, C, out=found.H_xz[k])
        np.matmul(columns[first:stop].reshape(-1, q).T, C, out=found.H_zz[k])
        np.sum(pulled[first:stop], axis=(0, 1), out=found.g_z[k])
    return found


def eliminate(
    H_xx: np.ndarray, H_xz: np.ndarray, H_zz: np.ndarray, g_x: np.ndarray, g_z: np.ndarray, x: np.ndarray, z: np.ndarray
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
