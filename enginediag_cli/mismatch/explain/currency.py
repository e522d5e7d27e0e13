"""One currency for sets of different size and kind: ln of the marginal likelihood of what was recorded.

Coefficients, and everything that identification may absorb, have Gaussian priors. With F = RᵀR the information of
readings and priors together, in prior standard deviations (QR of the whitened rows, the priors' last), at a fit of
lowest χ² (of readings and priors), the Laplace approximation of a set S of options is

    ln p(y, S) = −½ χ²(S) − Σ_j ln|R_jj| − Σ_(o in S) price(o) + a constant,        price(o) = ln(N_k / w_k)

Σ ln|R_jj| = ½ ln|F| is what narrowing the coefficients costs (the factor of Occam: a large prior range that the
readings narrow to a small one); the recordings' offsets have their own R. N_k is the number of options of the same kind
that were looked for and w_k the share of probability that their kind has, as in the gates (`SHARES`): a member is one
of so many that it might have been. What one more member promises at a fit without it, by g = C⊥ᵀe and G = C⊥ᵀC⊥ of its
columns, whose coefficients are N(0, T²), T = diag(τ):

    Δ = ½ gᵀ(G + T⁻²)⁻¹g − ½ ln|1 + T G T| − price

Source: D. J. C. MacKay, "Bayesian Interpolation", Neural Computation 4 (1992) 415–447.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.drivers import TIME
from enginediag_cli.mismatch.fit.families import Scored
from enginediag_cli.mismatch.fit.options import EFFECT, FORMULA_OPTION, Option
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.remainder import SHARES
from enginediag_cli.mismatch.fit.trial import MEMORY_PRICE, HypothesisFit
from enginediag_cli.mismatch.laws.posterior import HELD, held

EFFECTS, CHANGES, FREE_FORM = SHARES


def narrowed(projection: Projection) -> float:
    """Σ ln|R_jj|: what narrowing everything that is free costs."""
    told = float(np.sum(np.log(np.abs(np.diag(projection.R)))))
    return told + sum(float(np.sum(np.log(np.abs(np.diag(own.R))))) for own in projection.offsets.values())


@dataclass(frozen=True)
class Offer:
    """An option that may join a set, its `price` in ln probability and the `gain` Δ that it promises."""

    option: Option
    price: float
    gain: float


class Prices:
    """What a member of a set costs before it is fitted. `own`: prices by label, of options that bring theirs;
    `of_laws`: what the laws of a set cost together, where not as much as each by itself; `within`: what physics says
    of laws that a trial has fitted, ln, 0 or less."""

    def __init__(self, library: Sequence[Option]):
        self.own: dict[str, float] = {}
        self.of_laws: Callable[[Sequence[Option]], float] = lambda laws: sum(self.own[o.label] for o in laws)
        self.within: Callable[[HypothesisFit], float] = lambda trial: 0.0
        effects = {o.label for o in library if o.driver != TIME}
        self._effect = float(np.log(max(len(effects), 1) / EFFECTS))
        self._change = float(np.log(max(sum(o.driver == TIME for o in library), 1) / CHANGES))

    @property
    def least(self) -> float:
        """Of a member of the library."""
        return min(self._effect, self._change)

    def of(self, option: Option) -> float:
        """In ln probability. Of effects that remember a further coefficient has its price as in `Trial.weighed`."""
        if option.label in self.own:
            return self.own[option.label]
        if option.kind not in (EFFECT, FORMULA_OPTION):
            return self._change
        more = sum(len(e.amplitudes) - 1 for e in option.hypothesis.effects if e.trial_names)
        return self._effect + 0.5 * MEMORY_PRICE * more

    def evidence(self, trial: HypothesisFit) -> float:
        """ln p(y, S) of a trial, but for a constant that all of the same readings share."""
        paid = sum(self.of(o) for o in trial.options if o.kind != FORMULA_OPTION)
        laws = [o for o in trial.options if o.kind == FORMULA_OPTION]
        paid += self.of_laws(laws) + HELD * held(trial, [n for o in laws for n in o.hypothesis.names])
        return self.within(trial) - 0.5 * trial.objective - narrowed(trial.projection) - paid

    def promise(self, block: Scored, scales: np.ndarray, price: float) -> float:
        """Δ of a block whose coefficients are N(0, scales²) (k,)."""
        G, g = block.sums.gram(block.candidates), block.sums.pulls(block.candidates)
        held = np.eye(len(g)) + scales[:, None] * G * scales
        pull = scales * g
        gain = 0.5 * float(pull @ np.linalg.solve(held, pull))
        return gain - 0.5 * float(np.linalg.slogdet(held)[1]) - price


def scales_of(option: Option) -> np.ndarray:
    """Prior standard deviations (k,) of what an option is scored along."""
    if option.tried:
        return np.ones(1)
    sigma = {p.name: p.prior_sigma for e in option.hypothesis.effects for p in e.parameters()}
    return np.array([*(sigma[a] for a in option.directions), *(d.sigma for d in option.hypothesis.discrepancies)])
