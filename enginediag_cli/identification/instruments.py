"""Errors of instruments in an identification: offsets from recording to recording, and sensors that lag.

**Which offsets.** Every reading is zeroed and calibrated a little differently each time, that of an output and that of
an input of the model. From LEAST recordings of one engine on the sizes are estimated with the fit (`resize_offsets`);
with fewer there is no scatter to see, and only offsets that the engine file states are allowed for.

**How large.** The standard deviations of the offsets are those under which the training records are likeliest. With H,
b information and pull of the data about the parameters x and the offsets z_r of every recording, in units of their
present prior standard deviations, and t the factors by which the standard deviations s of the offsets change,

    ln L(t) = ½ bᵀ(H + T⁻²)⁻¹b − ½ ln det(1 + T² H),     ∂ln L/∂ln t_j = Σ_r [(μ_rj² + C_rj,rj)/t_j² − 1]

μ = C b, C = (H + T⁻²)⁻¹, the recordings eliminated one by one. To it comes what is known before: instruments of one
engine are all looked after with more care or less, and each is better or worse than its kind,

    ln s_j = ln usual_j + c + e_j,     c ~ N(0, COMMON²),  e_j ~ N(0, OWN²).

A few recordings say little of each instrument, but much of all together. What an input's offset explains, those of the
outputs that it moves explain nearly as well: how far each size may lie from the likeliest is the curvature of the
posterior of all sizes at once (Laplace), never wider than before the data.

**Where their fit begins.** At what each recording differs by from the model before any fit. Started at zero, with
offsets of several times the noise, a fit of many recordings would see gross outliers everywhere, weigh them down, and
bend the engine for what is each recording's own.

**Lags.** Readings of an engine that moves may lag in a way that its model does not contain. Residuals of recordings
that move are explained by how far each reading is ahead of its own lags (`engine/wrapped.py`), together with
the parameters, which bend to what lags as long as they may. What that predicts in stretches that it was not fitted to
is no noise: it is large in every slam, in all flights alike, and lasts as long as the transient, while the noise model
knows one size and one step of memory. It is subtracted from the readings before they are fitted and noise is estimated,
and monitors count it as uncertain by its own size, along its own course (`residuals/reduced.py`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from enginediag_cli.engine.instrument_errors import suspected
from enginediag_cli.engine.recall import MOMENT, Tapes
from enginediag_cli.engine.wrapped import LAGS_S, LagModel
from enginediag_cli.identification.gauss_newton import Fit
from enginediag_cli.identification.normal_equations import NormalEquations
from enginediag_cli.identification.problem import IdentificationProblem, OffsetPrior, TrainingRecording

COMMON, OWN = 1.0, 1.0
"""Standard deviations of the logarithms: two thirds of the engines, and of the instruments of one, lie within a factor
e of what is usual."""
RANGE = (0.02, 20.0)
"""Sizes as multiples of what is usual, from and to: smaller ones do nothing, larger ones are defects."""
STEP = 0.02
"""Of ln t, for differences of slopes: slopes are exact, and bend over a unit of ln t."""
SLOPE = 1e-3
"""Slope of ln L per ln t at which the search ends, as for sizes of map errors."""


@dataclass(frozen=True)
class ArrowData:
    """What the records say of p parameters and of q offsets of each of R recordings: information blocks and pull."""

    H_xx: np.ndarray  # (p, p)
    H_xz: np.ndarray  # (R, p, q)
    H_zz: np.ndarray  # (R, q, q)
    b_x: np.ndarray  # (p,)
    b_z: np.ndarray  # (R, q)


def log_likelihood(data: ArrowData, t: np.ndarray) -> tuple[float, np.ndarray]:
    """ln L and its slopes ∂ln L/∂ln t (q,) for factors t (q,)."""
    q = len(t)
    A = np.eye(q) + t[:, None] * data.H_zz * t
    cross = data.H_xz * t  # (R, p, q)
    pull = data.b_z * t
    inverse = np.linalg.inv(A)
    gain = cross @ inverse
    flat_gain, flat_cross = (np.swapaxes(part, 0, 1).reshape(len(data.b_x), -1) for part in (gain, cross))
    S = np.eye(len(data.b_x)) + data.H_xx - flat_gain @ flat_cross.T
    left = data.b_x - np.einsum("rpq,rq->p", gain, pull)
    L = np.linalg.cholesky(S)
    W = np.linalg.solve(L, flat_gain).reshape(len(S), -1, q)
    half = np.linalg.solve(L, left)
    mean = np.einsum("rqk,rk->rq", inverse, pull) - np.einsum("prq,p->rq", W, half)
    variance = np.diagonal(inverse, axis1=1, axis2=2) + np.einsum("prq,prq->rq", W, W)
    own = np.einsum("rq,rqk,rk->", pull, inverse, pull)
    value = 0.5 * float(half @ half + own)
    value -= float(np.sum(np.log(np.diag(L)))) + 0.5 * float(np.sum(np.linalg.slogdet(A)[1]))
    return value, np.sum(mean**2 + variance - 1.0, axis=0)


def likeliest_offsets(data: ArrowData, present: np.ndarray, usual: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Factors t (q,) on the present sizes (q,), 1 where not `free` (q,); usual (q,): sizes of instruments of a kind."""
    from scipy.optimize import minimize

    if not free.any():
        return np.ones(len(present))
    centre = np.log(usual / present)[free]
    precision = _precision(free)

    def negative_log_posterior(log_t: np.ndarray) -> tuple[float, np.ndarray]:
        t = np.ones(len(present))
        t[free] = np.exp(log_t)
        value, slope = log_likelihood(data, t)
        away = log_t - centre
        held = precision @ away
        return 0.5 * float(away @ held) - value, held - slope[free]

    bounds = list(zip(centre + np.log(RANGE[0]), centre + np.log(RANGE[1]), strict=True))
    start = np.clip(np.zeros(len(centre)), *np.transpose(bounds))
    found = minimize(
        negative_log_posterior, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"ftol": 0.0, "gtol": SLOPE}
    )
    t = np.ones(len(present))
    t[free] = np.exp(found.x)
    return t


def size_uncertainties(data: ArrowData, free: np.ndarray) -> np.ndarray:
    """Standard deviations (q,) of ln s about the likeliest sizes, in whose units `data` are; 0 where not `free`."""
    q, at = len(free), np.flatnonzero(free)
    found = np.zeros(q)
    if not len(at):
        return found
    slopes = []
    for j in at:
        up, down = (log_likelihood(data, np.exp(sign * STEP * (np.arange(q) == j)))[1][at] for sign in (1.0, -1.0))
        slopes.append((down - up) / (2.0 * STEP))
    information = np.asarray(slopes)
    # prior standard deviations as units: what the data say is added to 1, and never negative
    L = np.linalg.cholesky(_precision(free))
    inner = np.linalg.inv(L)
    curved, vectors = np.linalg.eigh(inner @ (information + information.T) @ inner.T / 2.0)
    root = inner.T @ vectors / np.sqrt(1.0 + np.maximum(curved, 0.0))
    found[at] = np.sqrt(np.sum(root**2, axis=1))
    return found


def _precision(free: np.ndarray) -> np.ndarray:
    """Inverse covariance (k, k) of the logarithms of the k free sizes before the data."""
    k = int(free.sum())
    return np.asarray(np.linalg.inv(OWN**2 * np.eye(k) + COMMON**2))


LEAST = 3
"""Recordings from which scatter between them is separable from what the fit took."""
USUAL_OUTPUT = 0.3
"""What a sensor's zero, or its span, usually changes by between recordings, over its noise. Judgement, as the others:
sixty records determine an offset of a tenth, and what a check of the reading itself would find is far larger."""
USUAL_INPUT = 0.1
"""The same of an input, over what such an instrument is plausibly wrong by."""
SETTLED = 0.1
"""Largest relative change of a size that matters, from one pass to the next, that ends the passes."""
NEGLIGIBLE = 0.1
"""Information of all recordings about an offset of the present size below which its size does not matter."""


def add_offsets(problem: IdentificationProblem, recordings: Sequence[TrainingRecording]) -> IdentificationProblem:
    """The problem with offsets of all instruments whose offsets are not stated, of usual sizes; as it is where there
    are too few recordings, where they are of several engines, or for a model without an engine file."""
    several = {r.engine for r in recordings}
    used = len(np.unique(problem.recording))
    if used < LEAST or len(several) > 1 or not hasattr(problem.model, "declared"):
        return problem
    stated = {o.sensor for o in problem.offsets}
    added = [o for o in _usual_offsets(problem, used) if o.sensor not in stated]
    offsets = sorted((*problem.offsets, *added), key=lambda o: o.sensor not in problem.sensors)  # of inputs last
    return replace(problem, offsets=tuple(offsets))


def _usual_offsets(problem: IdentificationProblem, used: int) -> Iterator[OffsetPrior]:
    engine: Any = problem.model  # which has an engine file
    for s, column in enumerate(problem.sensors):
        size = float(np.nanmedian(np.abs(problem.measured[:, s])))
        usual = USUAL_OUTPUT * engine.sensors[column].noise_sigma
        yield OffsetPrior(column, "bias", usual, used)
        if size > usual:
            yield OffsetPrior(column, "scale", usual / size, used)
    for column in engine.inputs:
        error = suspected(engine, column)
        if error is not None:
            kind = "scale" if error.multiplies else "bias"
            yield OffsetPrior(column, kind, USUAL_INPUT * error.parameter.prior_sigma, used)


def resize_offsets(
    problem: IdentificationProblem,
    usual: Sequence[OffsetPrior],
    n: NormalEquations,
    x: np.ndarray,
    z: np.ndarray,
    share: float,
) -> tuple[IdentificationProblem, np.ndarray, float]:
    """The problem with the likeliest sizes of its estimated offsets, z (R, q) in their units, and the largest relative
    change of one that matters. usual: the offsets at first; share: by which share of the way to the likeliest."""
    free = np.array([o.recordings > 0 for o in problem.offsets], bool)
    if not free.any():
        return problem, z, 0.0
    data = _arrow_data(n, x, z)
    present = np.array([o.prior_sigma for o in problem.offsets])
    factors = likeliest_offsets(data, present, np.array([o.prior_sigma for o in usual]), free) ** share
    offsets = tuple(
        replace(o, prior_sigma=float(o.prior_sigma * t)) for o, t in zip(problem.offsets, factors, strict=True)
    )
    seen = np.einsum("rqq->q", n.H_zz) * np.maximum(factors, 1.0) ** 2 > NEGLIGIBLE
    change = float(np.max(np.abs(np.log(factors[seen & free])), initial=0.0))
    return replace(problem, offsets=offsets), z / factors, change


def add_size_uncertainties(
    problem: IdentificationProblem, n: NormalEquations, x: np.ndarray, z: np.ndarray
) -> IdentificationProblem:
    """The problem, at its likeliest sizes, with how far each estimated one may be from them."""
    free = np.array([o.recordings > 0 for o in problem.offsets], bool)
    if not free.any():
        return problem
    spreads = size_uncertainties(_arrow_data(n, x, z), free)
    return replace(
        problem, offsets=tuple(replace(o, spread=float(v)) for o, v in zip(problem.offsets, spreads, strict=True))
    )


def _arrow_data(n: NormalEquations, x: np.ndarray, z: np.ndarray) -> ArrowData:
    """Information and pull about parameters x and offsets z (R, q) by the equations at that point."""
    b_x = n.H_xx @ x + np.einsum("rpq,rq->p", n.H_xz, z) - n.g_x
    b_z = np.einsum("rpq,p->rq", n.H_xz, x) + np.einsum("rqk,rk->rq", n.H_zz, z) - n.g_z
    return ArrowData(n.H_xx, n.H_xz, n.H_zz, b_x, b_z)


def initial_offsets(problem: IdentificationProblem, predicted: np.ndarray) -> np.ndarray:
    """Offsets (R, q) in prior standard deviations by the medians of each recording; `predicted` (N, m) without them.

    Of a sensor with a bias and a scale the first has it all; offsets of inputs, and those whose size is yet to be
    estimated, begin at zero.
    """
    z = np.zeros((len(problem.labels), len(problem.offsets)))
    starts = np.flatnonzero(np.diff(problem.recording, prepend=-1) != 0)
    taken: set[str] = set()
    for j, o in enumerate(problem.offsets):
        if o.sensor in taken or o.recordings or o.sensor not in problem.sensors:
            continue
        taken.add(o.sensor)
        s = problem.sensors.index(o.sensor)
        off = problem.measured[:, s] - predicted[:, s]
        if o.kind == "scale":
            off = off / np.where(predicted[:, s] != 0, predicted[:, s], np.nan)
        for first, stop in zip(starts, [*starts[1:], len(off)], strict=True):
            part = off[first:stop][np.isfinite(off[first:stop])]
            if len(part):
                z[problem.recording[first], j] = np.median(part) / o.prior_sigma
    # what all recordings have in common is the model's, not theirs
    return z - z.mean(axis=0)


@dataclass(frozen=True)
class SensorLag:
    """`amounts` (T,): of each deviation of a lag of the command with a time constant of `lags_s` (T,) from the command
    itself, in the column's unit per unit of the command; `spread` (T,): standard deviation of the amounts from stretch
    to stretch. `moved`, `left`: RMS of the residuals without and with that, in the column's unit, where the engine
    moves."""

    sensor: str
    lags_s: tuple[float, ...]
    amounts: tuple[float, ...]
    spread: tuple[float, ...]
    moved: float
    left: float


LONGEST_STEP_S = 4.0
"""Between records, of a recording that shows how an engine moves: of the order of the shortest of the lags."""
COARSE = 0.01
"""Share of the steps of a recording that may be longer."""
WHOLE = 0.8
"""Share of the records between the first and the last that take part, of a recording that shows how an engine moves: a
gate has left those out of the others that would."""
STRETCH_S = 120.0
"""Of a recording that is excluded at once: two of the longest lag."""
LEAST_STRETCHES = 6
"""Of fewer it is not known whether what one shows is found in the others."""
WORTH = 3.0
"""Standard errors by which the squares of left-out stretches must fall, by the roots of their falls: by chance less
than once in seven hundred, since what is fitted to noise alone makes left-out squares rise."""
RIDGE = 1e-9
"""Of the mean diagonal, added to it: a lag that no record shows has an amount of 0."""


def find_sensor_lags(problem: IdentificationProblem, fit: Fit) -> tuple[SensorLag, ...]:
    """What the readings lag by, all of them or none; `fit` is of the readings of the problem."""
    moment, tapes = problem.inputs.get(MOMENT), getattr(problem.model, "tapes", None)
    if moment is None or tapes is None:
        return ()
    stretch = number_stretches(tapes, moment)
    if stretch.max(initial=-1) + 1 < LEAST_STRETCHES:
        return ()
    D = lag_deviations(problem, fit)
    known = stretch >= 0
    size = np.sqrt(np.mean(D[known] ** 2, axis=0)) / problem.sigma[:, None]  # (m, T), in standard deviations
    if not (size > 0.0).any():
        return ()
    found = _fit_lags(_StretchSums.from_fit(problem, fit, D / np.where(size > 0.0, size, np.inf), stretch))
    if found is None:
        return ()
    amounts, spread = (np.where(size > 0.0, x / np.where(size > 0.0, size, 1.0), 0.0) for x in found)
    readings = []
    for i, sensor in enumerate(problem.sensors):
        e = fit.equations.residual[:, i]
        moving = known & np.isfinite(e) & (np.abs(D[:, i]).max(axis=1) > size[i].max() * problem.sigma[i] / 2)
        both = (e[moving], (e - D[:, i] @ amounts[i])[moving])
        rms = [float(np.sqrt(np.mean(x**2))) if x.size else 0.0 for x in both]
        readings.append(SensorLag(sensor, LAGS_S, tuple(amounts[i].tolist()), tuple(spread[i].tolist()), *rms))
    return tuple(readings)


def lag_deviations(problem: IdentificationProblem, fit: Fit) -> np.ndarray:
    """By how much lags of each reading are behind it, (N, m, T)."""
    at = LagModel(problem.model, problem.to_physical(fit.x))
    return at.deviations(problem.inputs, problem.sensors, len(problem.measured))


def lag_error(problem: IdentificationProblem, fit: Fit, readings: tuple[SensorLag, ...]) -> np.ndarray:
    """By how much the readings of the problem (N, m) are behind."""
    return np.einsum("nmt,mt->nm", lag_deviations(problem, fit), np.array([r.amounts for r in readings]))


def sum_lags(first: tuple[SensorLag, ...], more: tuple[SensorLag, ...]) -> tuple[SensorLag, ...]:
    """What readings lag by, in all, where `more` was found of readings that were freed of the `first`."""
    if not first:
        return more
    return tuple(
        replace(b, amounts=tuple(x + y for x, y in zip(a.amounts, b.amounts, strict=True)), moved=a.moved)
        for a, b in zip(first, more, strict=True)
    )


def number_stretches(tapes: Tapes, moment: np.ndarray) -> np.ndarray:
    """Number of the stretch of each record (N,), −1 on tapes that do not show how an engine moves, too coarse
    ones or gated."""
    number, place = tapes.locate(moment)
    stretch, first = np.full(len(moment), -1), 0
    for k in np.unique(number[number >= 0]).tolist():
        tape, rows = tapes.tapes[k], number == k
        if np.count_nonzero(rows) < WHOLE * (np.ptp(place[rows]) + 1):
            continue
        steps = np.diff(tape.time)[~tape.first[1:]]
        if not len(steps) or np.mean(steps > LONGEST_STEP_S) > COARSE:
            continue
        passed = tape.time - tape.time[0]
        whole = max(round(float(passed[-1]) / STRETCH_S), 1)
        own = np.clip((passed / max(float(passed[-1]), 1e-9) * whole).astype(int), 0, whole - 1)
        stretch[rows] = first + own[place[rows]]
        first += whole
    return stretch


@dataclass(frozen=True)
class _StretchSums:
    """Whitened residuals and columns of one stretch after the other, as sums: of the p parameters and the m·T amounts,
    `products` (K, q, q), `along` (K, q), `squares` (K,)."""

    products: np.ndarray
    gradient: np.ndarray
    squares: np.ndarray
    parameters: int
    sensors: int

    @staticmethod
    def from_fit(problem: IdentificationProblem, fit: Fit, D: np.ndarray, stretch: np.ndarray) -> _StretchSums:
        p, (_, m, T) = len(problem.parameters), D.shape
        found = problem.model.predict(
            problem.inputs, problem.to_physical(fit.x), sensors=problem.sensors, wrt=problem.names
        )
        J, e = np.asarray(found.jacobian) * problem.prior_sigma, fit.equations.residual
        weight = 1.0 / (problem.sigma * np.sqrt(problem.inflation))
        there = np.isfinite(e) & np.isfinite(J.sum(axis=2)) & (stretch >= 0)[:, None]
        numbers = np.unique(stretch[stretch >= 0])
        q = p + m * T
        products, along, squares = np.zeros((len(numbers), q, q)), np.zeros((len(numbers), q)), np.zeros(len(numbers))
        for k, number in enumerate(numbers.tolist()):
            for i in range(m):
                rows = np.flatnonzero(there[:, i] & (stretch == number))
                at = np.append(np.arange(p), p + i * T + np.arange(T))
                X = np.column_stack([J[rows, i], D[rows, i]]) * weight[i]
                z = e[rows, i] * weight[i]
                products[k][np.ix_(at, at)] += X.T @ X
                along[k, at] += X.T @ z
                squares[k] += z @ z
        return _StretchSums(products, along, squares, p, m)


def _fit_lags(rows: _StretchSums) -> tuple[np.ndarray, np.ndarray] | None:
    """Amounts (m, T) and their standard deviations between stretches (m, T), fitted with the parameters; None where
    they do not predict excluded stretches better than the parameters alone."""
    K, q = rows.gradient.shape
    p = rows.parameters
    held = np.diag(np.append(np.ones(p), np.full(q - p, RIDGE * np.trace(rows.products.sum(axis=0)) / q)))
    G, b = rows.products.sum(axis=0) + held, rows.gradient.sum(axis=0)
    without = np.linalg.solve(G - rows.products, (b - rows.gradient)[:, :, None])[:, :, 0]
    plain = np.zeros((K, q))
    plain[:, :p] = np.linalg.solve((G - rows.products)[:, :p, :p], (b - rows.gradient)[:, :p, None])[:, :, 0]

    def change_of_squares(x: np.ndarray) -> np.ndarray:
        return np.asarray(np.einsum("kq,kqr,kr->k", x, rows.products, x) - 2 * np.einsum("kq,kq->k", x, rows.gradient))

    gain = change_of_squares(plain) - change_of_squares(without)
    gain = np.sign(gain) * np.sqrt(np.abs(gain))  # a slam more or less must not decide
    error = float(np.std(gain, ddof=1)) / np.sqrt(K)
    if not float(np.mean(gain)) > WORTH * error > 0.0:
        return None
    # between stretches: their number times the jackknife's variance of the mean
    spread = np.sqrt(K * (K - 1) * np.mean((without - without.mean(axis=0)) ** 2, axis=0))
    whole = np.linalg.solve(G, b)
    return whole[p:].reshape(rows.sensors, -1), spread[p:].reshape(rows.sensors, -1)
