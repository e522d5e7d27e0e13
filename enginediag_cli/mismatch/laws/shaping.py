"""The shape of one form, sought by damped Gauss–Newton steps in a linear model of what a place shows.

With h(s) the form over the records at the shape s, e what is left and c₀ what a law says that the fit carries there,

    χ²(a, s) = |e⊥ + c₀ − C(a h(s))|² + (a/τ)² + zᵀz,     z = s over its priors' standard deviations, from their means

The amplitude is exact wherever the shape stands. What is compared is Laplace's ln evidence,

    ln B = ½ (χ²₀ − χ²) − ½ ln|1 + JᵀJ|

Sources: K. Levenberg, Q. Appl. Math. 2 (1944) 164–168; R. E. Kass, A. E. Raftery, J. Am. Stat. Assoc. 90 (1995)
773–795.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.engine.dual import Dual
from enginediag_cli.mismatch.laws.scan import Formula, letters_of, past_of, prior_of_shape

SETTLED = 0.01
"""Gain of ln evidence in a step below which nothing is sought any more."""
FIRST, SOFTER, STIFFER, STIFFEST = 1e-2, 0.3, 10.0, 1e8
"""Damping of the first step, by how much it falls after a step that gained and grows after one that did not, and from
which on no step will gain."""


@dataclass
class Shaping:
    """A formula whose shape is sought. `centre`, `sigma`, `lower`, `upper` (k,): of the shape's prior, and of z; `z`
    where it stands, `step` to where it would be looked at next; `worth`: −½ χ² there against nothing, −∞ until it has
    been looked at; `evidence`: ln, priors of form and place apart; `slope`, `curvature` of −½ χ² by amplitude and z."""

    formula: Formula
    centre: np.ndarray
    sigma: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    z: np.ndarray
    step: np.ndarray
    slope: np.ndarray
    curvature: np.ndarray
    amplitude: float = 0.0
    statistic: float = 0.0
    worth: float = -np.inf
    evidence: float = -np.inf
    damping: float = FIRST
    settled: bool = False

    @staticmethod
    def of(formula: Formula) -> Shaping:
        """Begun at the formula's own shape."""
        centre, sigma, (lower, upper) = prior_of_shape(formula)
        z = (np.array([formula.shape[s.letter] for s in formula.form.shapes]) - centre) / sigma
        k = len(z)
        return Shaping(formula, centre, sigma, lower, upper, z, np.zeros(k), np.zeros(1 + k), np.eye(1 + k))

    def shape(self) -> dict[str, float]:
        """By letter, where it would be looked at next."""
        values = self.centre + self.sigma * (self.z + self.step)
        return {s.letter: float(v) for s, v in zip(self.formula.form.shapes, values, strict=True)}

    def curves(self) -> np.ndarray:
        """h and its derivatives by z (N, 1 + k) where it would be looked at next; not finite where it is nothing."""
        N, letters = len(self.formula.curve), letters_of(self.formula.of) | {"a": 1.0}
        for j, (letter, at) in enumerate(self.shape().items()):
            d = np.zeros((j + 1, N))
            d[j] = self.sigma[j]
            letters[letter] = Dual(np.full(N, at), d)
        with np.errstate(all="ignore"):
            h = self.formula.form.expression.evaluate(letters, past_of(self.formula.of))
        found = np.zeros((N, 1 + len(self.z)))
        if isinstance(h, Dual):
            found[:, 0], found[:, 1 : 1 + len(h.d)] = h.v, h.d.T
        else:
            found[:, 0] = h
        return found

    def look(self, G: np.ndarray, g: np.ndarray, tau: float) -> None:
        """By products (1 + k, 1 + k) of the curves, and pulls (1 + k,) with what is left and what is carried; τ:
        standard deviation of the amplitude's prior. Goes on from there where that gains, else back with a shorter
        step."""
        z = self.z + self.step
        alpha = a = worth = np.nan
        if np.isfinite(G).all() and G[0, 0] > 0.0 and np.isfinite(tau):
            alpha = tau * g[0] / (1.0 + tau**2 * G[0, 0])
            a = tau * alpha
            worth = a * g[0] - 0.5 * a**2 * G[0, 0] - 0.5 * alpha**2 - 0.5 * float(z @ z)
        if not worth >= self.worth:
            self.damping *= STIFFER
            self.settled = not np.isfinite(self.worth) or self.damping > STIFFEST
        else:
            self.settled = not len(z) or worth < self.worth + SETTLED
            J = np.array([tau, *[a] * len(z)])
            self.z, self.amplitude, self.worth, self.statistic = z, a, worth, float(g[0] ** 2 / G[0, 0])
            self.slope, self.curvature = J * (g - a * G[0]) - [alpha, *z], np.eye(len(J)) + J[:, None] * G * J
            self.evidence = worth - 0.5 * float(np.linalg.slogdet(self.curvature)[1])
            self.damping *= SOFTER
        damped = self.curvature + self.damping * np.diag(np.diag(self.curvature))
        step = np.linalg.solve(damped, self.slope)[1:]
        self.step = np.clip(self.z + step, self.lower, self.upper) - self.z

    def found(self) -> Formula:
        """The formula as it stands."""
        self.step = np.zeros(len(self.z))
        return replace(self.formula, shape=self.shape(), curve=self.curves()[:, 0])
