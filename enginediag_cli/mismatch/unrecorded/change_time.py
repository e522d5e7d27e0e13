"""When, between two steady records, a state changed: by the unsteady records there, which take no part in any fit.

With residuals e_k (m,) without the effect and what it moves the readings by, c_k, both in standard deviations, a change
at τ leaves

    u_k(τ) = e_k − c_k s_k(τ) − (a line in time through what the steady records on either side leave)
    s_k(τ) = s_before + (s_after − s_before) (1 − exp(−(t_k − τ)/T)) behind τ     T of LAGS_S, each as likely

Where the engine moves, the quasi-steady model errs by much more than the instruments, for seconds in a row, and by more
at one time than at another. So u is an autoregression in time, of correlation φ over a second, whose covariance λS has
a scale λ of its own in every BLOCK_S, λ⁻¹ ~ Γ(ν/2, ν/2), which makes a block of n records of m readings a Student t:

    −2 ln p(u) = n ln det S + m Σ ln w_k + (ν + nm) ln(1 + D²/ν) + constant      D² = Σ v_kᵀ S⁻¹ v_k / w_k
    v_k = u_k − φ^Δt u_{k−1}      w_k = 1 − φ^{2Δt}

S, φ and ν are those of stretches of the same flights on both sides of which the state is the same, hence known
(expectation–maximisation). They are no law of nature: the posterior of a change that is put into these stretches at
known times must hold them, and the logarithm of the likelihood is taken times the largest of POWERS at which it does.
Between two steady records the state is taken to have changed once.

Sources: K. L. Lange, R. J. A. Little and J. M. G. Taylor, "Robust statistical modeling using the t distribution", JASA
84 (1989) 881–896; C. Liu, D. B. Rubin and Y. N. Wu, "Parameter expansion to accelerate EM", Biometrika 85 (1998)
755–770; P. Grünwald and T. van Ommen, "Inconsistency of Bayesian inference for misspecified linear models",
Bayesian Anal. 12 (2017) 1069–1103 (powers of a likelihood that is not the right one).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

LAGS_S = np.array([0.0, 1.0, 2.0, 4.0, 8.0])
"""Time constants with which readings may follow a valve: its own travel, and metal and probes that warm up."""

POWERS = (1.0, 0.7, 0.5, 0.35, 0.25, 0.18, 0.12, 0.08, 0.05)
"""Of the likelihood, that are tried, the largest first; where none of them is honest nothing is told."""

LEVEL = 0.95
"""Probability of the interval."""

BLOCK_S = 10.0
"""Seconds that have a scale of errors of their own: as long as a lever is on its way, mostly."""

PLACES = (0.15, 0.4, 0.65, 0.9)
"""Where changes are put into a stretch whose state is known, as shares of its length."""

LEAST_STRETCHES = 8
"""Stretches of a known state from which errors are measured: 32 changes put into them, of which 1 may be missed."""

ROUNDS, SETTLED = 100, 1e-4
"""Of expectation and maximisation at most, and the relative change of the covariance that ends them."""

MEMORY = (0.5, 0.7, 0.8, 0.87, 0.92, 0.95, 0.97, 0.985)
"""Correlations φ over a second that are tried."""

DEGREES = (0.5, 1.0, 2.0, 4.0, 8.0)
"""Of freedom, ν, that are tried."""

LEAST_SHARE = 1e-6
"""Of its trace, which is added to a covariance: a sensor that stands still leaves it singular."""


@dataclass(frozen=True)
class Stretch:
    """Unsteady records of one flight between two steady ones: `time` (n,) s, rising, residuals `e` and effect `c`
    (n, m) in standard deviations, all finite, states before and after; the first record is still of the state before
    and the last already of that after. `left` (2, m): what the steady records before `begin_s` and after `end_s` leave
    at their states; `moved`: how far the predicted readings range within, in standard deviations."""

    time: np.ndarray
    e: np.ndarray
    c: np.ndarray
    before: float
    after: float
    begin_s: float
    end_s: float
    left: np.ndarray
    moved: float = 1.0

    @property
    def moments(self) -> np.ndarray:
        """Times (T,) of a change that are told apart: between any two records, within the ends."""
        middle = 0.5 * (self.time[1:] + self.time[:-1])
        inside = middle[(middle > self.begin_s) & (middle < self.end_s)]
        return inside if inside.size else np.array([0.5 * (self.begin_s + self.end_s)])

    @property
    def misfit(self) -> np.ndarray:
        """u (n, m) were the state the one before throughout."""
        share = np.clip((self.time - self.begin_s) / (self.end_s - self.begin_s), 0.0, 1.0)[:, None]
        return np.asarray(self.e - self.c * self.before - self.left[0] * (1.0 - share) - self.left[1] * share)


@dataclass(frozen=True)
class Errors:
    """Of unsteady records: `root` (m, m), which whitens S, `log_det` of S, φ as `memory`, ν as `degrees`, and the
    `power` of the likelihood."""

    root: np.ndarray
    log_det: float
    memory: float
    degrees: float
    power: float = 1.0


def responses(time: np.ndarray, moments: np.ndarray, lag_s: float) -> np.ndarray:
    """Share of a change at each moment (T,) that has come by each time (n,), (T, n)."""
    since = time[None, :] - moments[:, None]
    if lag_s <= 0.0:
        return (since > 0.0).astype(float)
    return np.where(since > 0.0, -np.expm1(-np.maximum(since, 0.0) / lag_s), 0.0)


def log_likelihood(stretch: Stretch, errors: Errors) -> np.ndarray:
    """ln p (lags, T) of the stretch with a change at each of its moments, by LAGS_S."""
    moments, step = stretch.moments, stretch.after - stretch.before
    found = []
    for lag in LAGS_S:
        share = step * responses(stretch.time, moments, lag)
        found.append(_log_density(stretch.time, stretch.misfit - share[:, :, None] * stretch.c, errors))
    return np.array(found)


def interval(stretch: Stretch, errors: Errors, level: float = LEVEL) -> tuple[float, float]:
    """Times between which the change lies with this probability, equally likely to lie before and behind, and a record
    more on either side: a reading is as old as the last time that the instrument was asked."""
    low, high = _interval(stretch, log_likelihood(stretch, errors), errors.power, level)
    step = float(np.median(np.diff(stretch.time)))
    return max(low - step, stretch.begin_s), min(high + step, stretch.end_s)


def measured(known: Sequence[Stretch]) -> Errors | None:
    """Errors of stretches before and behind which the state is the same. None where they are too few, or where no power
    of the likelihood holds the changes that are put into them."""
    if len(known) < LEAST_STRETCHES:
        return None
    u = [s.misfit for s in known]
    best = max((_fitted(known, u, memory, DEGREES[1]) for memory in MEMORY), key=lambda f: f[0])[1]
    value, best = max((_fitted(known, u, best.memory, degrees) for degrees in DEGREES), key=lambda f: f[0])
    if not np.isfinite(value):
        return None
    put = [p for k, s in enumerate(known) for p in _put_into(s, k)]
    likelihoods = [log_likelihood(s, best) for s, _ in put]
    for power in POWERS:
        held = 0
        for (s, at), likelihood in zip(put, likelihoods, strict=True):
            low, high = _interval(s, likelihood, power, LEVEL)
            # a time between two records is told to half a step at best, as much again is left for the clock
            half = 0.5 * float(np.median(np.diff(s.time)))
            held += low - half <= at <= high + half
        if held >= LEVEL * len(put):
            return replace(best, power=power)
    return None


def _interval(stretch: Stretch, likelihood: np.ndarray, power: float, level: float) -> tuple[float, float]:
    """As `interval`, but for the record more, of ln p (lags, T); the density is even between the edges of what each
    moment stands for."""
    value = np.logaddexp.reduce(power * likelihood, axis=0)
    moments = stretch.moments
    edges = np.concatenate([[stretch.begin_s], 0.5 * (moments[1:] + moments[:-1]), [stretch.end_s]])
    total = np.concatenate([[0.0], np.cumsum(np.exp(value - value.max()))])
    low, high = np.interp([0.5 * (1.0 - level), 0.5 * (1.0 + level)], total / total[-1], edges)
    return float(low), float(high)


def _put_into(s: Stretch, number: int) -> list[tuple[Stretch, float]]:
    """The stretch with a change to the other state at known times, and these; lags in turn."""
    found, step = [], 1.0 - 2.0 * s.before
    for j, place in enumerate(PLACES):
        at = float(s.begin_s + place * (s.end_s - s.begin_s))
        share = responses(s.time, np.array([at]), float(LAGS_S[(number + j) % len(LAGS_S)]))[0]
        e = s.e + step * share[:, None] * s.c
        found.append((replace(s, e=e, after=s.before + step), at))
    return found


def _innovations(time: np.ndarray, u: np.ndarray, memory: float) -> tuple[np.ndarray, np.ndarray]:
    """v (…, n, m) over √(1 − φ^{2Δt}), and these variances (n,); the first record's is 1."""
    kept = memory ** np.diff(time)
    variance = np.concatenate([[1.0], -np.expm1(2.0 * np.log(memory) * np.diff(time))])
    v = u.copy()
    v[..., 1:, :] -= kept[:, None] * u[..., :-1, :]
    return v / np.sqrt(variance)[:, None], variance


def _log_density(time: np.ndarray, u: np.ndarray, errors: Errors) -> np.ndarray:
    """ln p (T,) of misfits u (T, n, m) but for a constant of n and m."""
    from scipy.special import gammaln

    v, variance = _innovations(time, u, errors.memory)
    first = _blocks(time)
    D2 = np.add.reduceat(((v @ errors.root.T) ** 2).sum(axis=-1), first, axis=-1)
    readings = u.shape[-1] * np.diff([*first, len(time)])
    nu = errors.degrees
    constant = gammaln(0.5 * (nu + readings)) - gammaln(0.5 * nu) - 0.5 * readings * np.log(nu)
    scale = len(time) * errors.log_det + u.shape[-1] * float(np.log(variance).sum())
    return np.asarray((constant - 0.5 * (nu + readings) * np.log1p(D2 / nu)).sum(axis=-1) - 0.5 * scale)


def _blocks(time: np.ndarray) -> np.ndarray:
    """First record of each block."""
    number = np.floor((time - time[0]) / BLOCK_S)
    return np.flatnonzero(np.concatenate([[True], np.diff(number) > 0.0]))


def _fitted(known: Sequence[Stretch], u: Sequence[np.ndarray], memory: float, degrees: float) -> tuple[float, Errors]:
    """ln p of all misfits, −∞ where S did not settle, and S, at a given memory and degrees of freedom."""
    rows = [
        part
        for s, x in zip(known, u, strict=True)
        for part in np.split(_innovations(s.time, x, memory)[0], _blocks(s.time)[1:])
    ]
    squares = np.array([v.T @ v for v in rows])
    n = np.array([len(v) for v in rows], float)
    m = squares.shape[1]
    S, moved = squares.sum(axis=0) / n.sum(), np.inf
    for _ in range(ROUNDS):
        S = S + LEAST_SHARE * max(float(np.trace(S)), np.finfo(float).tiny) * np.eye(m)
        D2 = np.einsum("ij,gji->g", np.linalg.inv(S), squares)
        weight = (degrees + n * m) / (degrees + D2)
        # their mean is 1 at the optimum: to divide by it (parameter expansion) leads there in few rounds
        new = np.einsum("g,gij->ij", weight / weight.mean(), squares) / n.sum()
        moved = float(np.abs(new - S).max() / np.abs(S).max())
        S = new
        if moved < SETTLED:
            break
    S = S + LEAST_SHARE * max(float(np.trace(S)), np.finfo(float).tiny) * np.eye(m)
    L = np.linalg.cholesky(S)
    errors = Errors(np.linalg.inv(L), 2.0 * float(np.log(np.diag(L)).sum()), memory, degrees)
    value = sum(float(_log_density(s.time, x[None], errors)[0]) for s, x in zip(known, u, strict=True))
    return value if moved < SETTLED else -np.inf, errors
