"""What readings of a moving engine lag by that its model does not know.

Residuals of recordings that move are explained by how far each reading is ahead of its own lags (`engine/moving/
lagging.py`), together with the parameters, which bend to what lags as long as they may. What that foretells in
stretches that it was not fitted to is no noise: it is large in every slam, in all flights alike, and lasts as long as
the engine remembers, while the noise model knows one size and one step of memory. So readings are freed of it before
they are fitted and noise is estimated, and monitors count it as uncertain by its own size, along its own course
(`residuals/reduced.py`).

A reading that lags behind the model where the engine moves, as identification found it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.engine.moving.tape import LAGS_S, MOMENT, Lagging, Tapes
from enginediag_cli.identification.gauss_newton import Fit
from enginediag_cli.identification.problem import Problem


@dataclass(frozen=True)
class LaggingReading:
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
"""Of a recording that is left out at once: two of the longest lag."""
LEAST_STRETCHES = 6
"""Of fewer it is not known whether what one shows is found in the others."""
WORTH = 3.0
"""Standard errors by which the squares of left-out stretches must fall, by the roots of their falls: by chance less
than once in seven hundred, since what is fitted to noise alone makes left-out squares rise."""
RIDGE = 1e-9
"""Of the mean diagonal, added to it: a lag that no record shows has an amount of 0."""


def lagging_readings(problem: Problem, fit: Fit) -> tuple[LaggingReading, ...]:
    """What the readings lag by, all of them or none; `fit` is of readings as they stand in the problem."""
    moment, tapes = problem.inputs.get(MOMENT), getattr(problem.model, "tapes", None)
    if moment is None or tapes is None:
        return ()
    stretch = stretches(tapes, moment)
    if stretch.max(initial=-1) + 1 < LEAST_STRETCHES:
        return ()
    D = deviations(problem, fit)
    known = stretch >= 0
    size = np.sqrt(np.mean(D[known] ** 2, axis=0)) / problem.sigma[:, None]  # (m, T), in standard deviations
    if not (size > 0.0).any():
        return ()
    found = _together(_Rows.of(problem, fit, D / np.where(size > 0.0, size, np.inf), stretch))
    if found is None:
        return ()
    amounts, spread = (np.where(size > 0.0, x / np.where(size > 0.0, size, 1.0), 0.0) for x in found)
    readings = []
    for i, sensor in enumerate(problem.sensors):
        e = fit.equations.residual[:, i]
        moving = known & np.isfinite(e) & (np.abs(D[:, i]).max(axis=1) > size[i].max() * problem.sigma[i] / 2)
        both = (e[moving], (e - D[:, i] @ amounts[i])[moving])
        rms = [float(np.sqrt(np.mean(x**2))) if x.size else 0.0 for x in both]
        readings.append(LaggingReading(sensor, LAGS_S, tuple(amounts[i].tolist()), tuple(spread[i].tolist()), *rms))
    return tuple(readings)


def deviations(problem: Problem, fit: Fit) -> np.ndarray:
    """By how much lags of each reading are behind it, (N, m, T)."""
    at = Lagging(problem.model, problem.physical(fit.x))
    return at.deviations(problem.inputs, problem.sensors, len(problem.measured))


def lagged(problem: Problem, fit: Fit, readings: tuple[LaggingReading, ...]) -> np.ndarray:
    """By how much the readings of the problem (N, m) are behind."""
    return np.einsum("nmt,mt->nm", deviations(problem, fit), np.array([r.amounts for r in readings]))


def together(first: tuple[LaggingReading, ...], more: tuple[LaggingReading, ...]) -> tuple[LaggingReading, ...]:
    """What readings lag by, in all, where `more` was found of readings that were freed of the `first`."""
    if not first:
        return more
    return tuple(
        replace(b, amounts=tuple(x + y for x, y in zip(a.amounts, b.amounts, strict=True)), moved=a.moved)
        for a, b in zip(first, more, strict=True)
    )


def stretches(tapes: Tapes, moment: np.ndarray) -> np.ndarray:
    """Number of the stretch of each record (N,), −1 on tapes that do not show how an engine moves, too coarse
    ones or gated."""
    number, place = tapes.found(moment)
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
class _Rows:
    """Whitened residuals and columns of one stretch after the other, as sums: of the p parameters and the m·T amounts,
    `products` (K, q, q), `along` (K, q), `squares` (K,)."""

    products: np.ndarray
    along: np.ndarray
    squares: np.ndarray
    parameters: int
    sensors: int

    @staticmethod
    def of(problem: Problem, fit: Fit, D: np.ndarray, stretch: np.ndarray) -> _Rows:
        p, (_, m, T) = len(problem.parameters), D.shape
        found = problem.model.predict(
            problem.inputs, problem.physical(fit.x), sensors=problem.sensors, wrt=problem.names
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
        return _Rows(products, along, squares, p, m)


def _together(rows: _Rows) -> tuple[np.ndarray, np.ndarray] | None:
    """Amounts (m, T) and their standard deviations between stretches (m, T), fitted with the parameters; None where
    they do not foretell stretches that are left out better than the parameters alone."""
    K, q = rows.along.shape
    p = rows.parameters
    held = np.diag(np.append(np.ones(p), np.full(q - p, RIDGE * np.trace(rows.products.sum(axis=0)) / q)))
    G, b = rows.products.sum(axis=0) + held, rows.along.sum(axis=0)
    without = np.linalg.solve(G - rows.products, (b - rows.along)[:, :, None])[:, :, 0]
    plain = np.zeros((K, q))
    plain[:, :p] = np.linalg.solve((G - rows.products)[:, :p, :p], (b - rows.along)[:, :p, None])[:, :, 0]

    def left(x: np.ndarray) -> np.ndarray:
        return np.asarray(np.einsum("kq,kqr,kr->k", x, rows.products, x) - 2 * np.einsum("kq,kq->k", x, rows.along))

    gain = left(plain) - left(without)
    gain = np.sign(gain) * np.sqrt(np.abs(gain))  # a slam more or less must not decide
    error = float(np.std(gain, ddof=1)) / np.sqrt(K)
    if not float(np.mean(gain)) > WORTH * error > 0.0:
        return None
    # between stretches: their number times the jackknife's variance of the mean
    spread = np.sqrt(K * (K - 1) * np.mean((without - without.mean(axis=0)) ** 2, axis=0))
    whole = np.linalg.solve(G, b)
    return whole[p:].reshape(rows.sensors, -1), spread[p:].reshape(rows.sensors, -1)
