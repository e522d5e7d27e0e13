"""Which formula a response follows, without an engine: plain regression by the grammar of laws and its evidence.

    r = s α f(x; c)/rms f + B b + ε,      α ~ N(0, 1),  c ~ N(c₀, C₀) within bounds,  ε_n ~ N(0, σ_n²)

f is a form of variables with its shape c, s the size that a law may have, B b what may be absorbed, of any amount. All
tries of all formulas are scored at once, as a scan of an engine's places scores them (`scan.py`). The best tries of
each form of each variables are refitted, shape and amplitude together, and compared by Laplace's method,

    ln B = ½ (χ²₀ − χ²) − ½ zᵀz − ½ ln|I + JᵀJ|

with z the coefficients over their priors' standard deviations and J what a whitened response does by them.
Source: R. E. Kass, A. E. Raftery, J. Am. Stat. Assoc. 90 (1995) 773–795.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.mismatch.laws.posterior import shares
from enginediag_cli.mismatch.laws.scan import Formula, over_records, prior_of_shape

MOST = 12
"""Forms of variables that are refitted, the best by score. How far behind a score may be cannot be told: where noise is
small, tries between which the true shape lies miss it by any number of standard deviations."""
STARTS = 2
"""Tries of one form from which it is refitted: what a place and a width say together has several maxima."""
OUTSIDE = 1e6
"""Standard deviations: residual where a formula is nothing."""
EVALUATIONS = 200
"""Of a refit: one of four coefficients needs some dozens."""

Curve = Callable[[Formula, Mapping[str, float]], np.ndarray]
"""A formula with a shape over the records (N,), amplitude 1."""


@dataclass(frozen=True)
class Response:
    """`values` (N,) with standard deviations `sigma` (N,), in any unit; `size`: how large a law's standard deviation
    over the records may be, in the same; `absorbed` (N, q): what is not sought and may be of any amount."""

    values: np.ndarray
    sigma: np.ndarray
    size: float
    absorbed: np.ndarray | None = None


@dataclass(frozen=True)
class FittedCurve:
    """A formula fitted: `formula` with its fitted shape, `amplitude` and `curve` (N,), amplitude included;
    `standard_error` by letter, a and shapes; `evidence`: ln, against nothing, with the prior of form and variables;
    `refitted`: its shape is the best there is, else the best of the tries that were scored; `probability` among all;
    `converged`: whether its refit came to an end."""

    formula: Formula
    amplitude: float
    curve: np.ndarray
    standard_error: Mapping[str, float]
    chi2: float
    evidence: float
    refitted: bool
    converged: bool = True
    probability: float = 0.0


def as_it_stands(formula: Formula, shape: Mapping[str, float]) -> np.ndarray:
    """A formula over its own records."""
    return over_records(formula.form, formula.of, shape)


def fitted_curves(
    formulas: Sequence[Formula], response: Response, curve: Curve = as_it_stands, most: int = MOST
) -> list[FittedCurve]:
    """Every form of every variables once, likeliest first; empty where no formula is anything over the records."""
    freed = _Freed(response)
    tries: dict[tuple[str, tuple[str, ...]], list[_Try]] = {}
    for t in _scored(formulas, freed, curve):
        f = t.formula
        tries.setdefault((f.form.name, tuple(k.variable.name for k in f.of)), []).append(t)
    totals = {key: float(np.logaddexp.reduce([t.evidence for t in own])) for key, own in tries.items()}
    order = sorted(tries, key=lambda key: -totals[key])
    found = []
    shaped = [key for key in order if tries[key][0].formula.form.shapes][:most]
    for key in order:
        own = sorted(tries[key], key=lambda t: -t.evidence)
        if key in shaped:
            ends = [_refitted(t, freed, curve) for t in own[:STARTS]]
            found.append(max(ends, key=lambda e: e.evidence))
        else:
            found.append(_as_scored(own[0], totals[key], freed))
    found.sort(key=lambda f: -f.evidence)
    p = shares([f.evidence for f in found])
    return [replace(f, probability=float(q)) for f, q in zip(found, p, strict=True)]


class _Freed:
    """A response in standard deviations, freed of what is absorbed."""

    def __init__(self, response: Response):
        self.sigma, self.size = response.sigma, response.size
        B = response.absorbed
        self.Q = None if B is None else np.linalg.qr(B / response.sigma[:, None])[0]
        self.values = self.of(response.values)
        self.chi2 = float(self.values @ self.values)

    def of(self, curve: np.ndarray) -> np.ndarray:
        """The same of any curve (N,)."""
        x = curve / self.sigma
        return x if self.Q is None else x - self.Q @ (self.Q.T @ x)


@dataclass(frozen=True)
class _Try:
    formula: Formula
    curve: np.ndarray
    alpha: float
    chi2: float
    evidence: float


def _scored(formulas: Sequence[Formula], freed: _Freed, curve: Curve) -> list[_Try]:
    """All tries as linear models of one amplitude."""
    found = []
    for f in formulas:
        c = curve(f, f.shape)
        rms = float(np.std(c))
        if not np.isfinite(rms) or rms == 0.0:
            continue
        x = freed.of(c * (freed.size / rms))
        g, G = float(x @ freed.values), float(x @ x)
        alpha = g / (1.0 + G)
        evidence = 0.5 * g * alpha - 0.5 * np.log1p(G) + f.prior - float(np.log(f.tried))
        chi2 = float(np.sum((freed.values - alpha * x) ** 2))
        found.append(_Try(f, c, alpha, chi2, float(evidence)))
    return found


def _as_scored(t: _Try, evidence: float, freed: _Freed) -> FittedCurve:
    factor = freed.size / float(np.std(t.curve))
    x = freed.of(t.curve * factor)
    error = factor / float(np.sqrt(1.0 + x @ x))
    amplitude = t.alpha * factor
    complete = not t.formula.form.shapes
    return FittedCurve(t.formula, amplitude, amplitude * t.curve, {"a": error}, t.chi2, evidence, complete)


def _refitted(t: _Try, freed: _Freed, curve: Curve) -> FittedCurve:
    """From a try: amplitude and shape together, within the bounds of the shape."""
    from scipy.optimize import least_squares

    form = t.formula.form
    letters = [s.letter for s in form.shapes]
    centre, sigma, bounds = prior_of_shape(t.formula)

    def shape_of(z: np.ndarray) -> dict[str, float]:
        return dict(zip(letters, (centre + sigma * z[1:]).tolist(), strict=True))

    def whitened(z: np.ndarray) -> np.ndarray:
        c = curve(t.formula, shape_of(z))
        rms = float(np.std(c))
        if not np.isfinite(rms) or rms == 0.0:
            return np.full(len(freed.values), OUTSIDE)
        return freed.of(c * (z[0] * freed.size / rms))

    def left(z: np.ndarray) -> np.ndarray:
        return np.concatenate([freed.values - whitened(z), z])

    start = np.array([t.alpha, *((t.formula.shape[n] - c) / s for n, c, s in zip(letters, centre, sigma, strict=True))])
    limits = (np.array([-np.inf, *bounds[0]]), np.array([np.inf, *bounds[1]]))
    end = least_squares(left, start, bounds=limits, x_scale="jac", max_nfev=EVALUATIONS)
    J = end.jac[: len(freed.values)]
    told = np.eye(len(start)) + J.T @ J
    chi2 = float(np.sum((freed.values - whitened(end.x)) ** 2))
    evidence = 0.5 * (freed.chi2 - chi2) - 0.5 * float(end.x @ end.x) - 0.5 * float(np.linalg.slogdet(told)[1])
    shape = shape_of(end.x)
    c = curve(t.formula, shape)
    factor = freed.size / float(np.std(c))
    errors = np.sqrt(np.diag(np.linalg.inv(told))) * np.array([factor, *sigma])
    amplitude = float(end.x[0]) * factor
    formula = Formula(form, t.formula.of, shape, c, t.formula.prior, t.formula.tried)
    errors_of = dict(zip(["a", *letters], errors.tolist(), strict=True))
    total = evidence + t.formula.prior
    return FittedCurve(formula, amplitude, amplitude * c, errors_of, chi2, total, True, bool(end.status > 0))
