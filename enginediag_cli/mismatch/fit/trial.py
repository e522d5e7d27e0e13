"""One hypothesis fitted: what it is, how well it fits, and its coefficients with what is known of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from enginediag_cli.engine.recall import MOMENT
from enginediag_cli.engine.term import Effect
from enginediag_cli.mismatch.fit.identified import Hypothesis, IdentifiedHypothesis
from enginediag_cli.mismatch.fit.options import FORMULA_OPTION, Option
from enginediag_cli.mismatch.fit.plateau import interval_at
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.response import response_error
from enginediag_cli.mismatch.fit.spread import spread_of
from enginediag_cli.mismatch.fit.unmet import UNTOLD, largest
from enginediag_cli.probability import NORMAL_95

MEMORY_PRICE = 6.0
"""χ² that a further coefficient of an effect with memory must gain to put it before one that needs none: by chance it
gains so much one time in seventy. Judgement: effects with memory are nested in each other, others are not."""


@dataclass(frozen=True)
class HypothesisFit:
    """A fit with some options. `objective` is its χ² of readings and priors."""

    options: tuple[Option, ...]
    found: IdentifiedHypothesis
    projection: Projection

    @property
    def label(self) -> str:
        return " + ".join(o.label for o in self.options) or "nothing"

    @property
    def converged(self) -> bool:
        return self.found.converged

    @property
    def objective(self) -> float:
        return self.projection.objective

    @property
    def weighed(self) -> float:
        """The objective by which explanations are put in order: with a price for what makes one kind of memory another
        (the second of two lags), which always gains a little."""
        more = (len(e.amplitudes) - 1 for e in self.hypothesis.effects if e.trial_names)
        return self.objective + MEMORY_PRICE * sum(more)

    @cached_property
    def at_bound(self) -> tuple[str, ...]:
        """Coefficients of the options that ended at a physical bound."""
        held = dict(zip(self.found.problem.names, self.found.fit.at_bound, strict=True))
        # of two rates one may have no limit: that is no bound that holds the fit
        absent = {
            n for e in self.hypothesis.effects if e.trial_names and not all(held[s] for s in e.sizes) for n in e.sizes
        }
        closed = {e.parameter_name(c.name) for e in self.hypothesis.effects for c in e.term.COEFFICIENTS if c.closed}
        return tuple(n for n in self.hypothesis.names if held[n] and n not in absent | closed)

    @property
    def hypothesis(self) -> Hypothesis:
        return self.found.hypothesis

    @property
    def values(self) -> dict[str, float]:
        """Each of the options' coefficients, in its unit."""
        return {n: value for n, (value, _) in self.coefficients.items()}

    @cached_property
    def coefficients(self) -> dict[str, tuple[float, float]]:
        """Value and standard error of each of the options' coefficients, in its unit. One whitened Newton step is
        added where noise is correlated in time, since the fit itself only tempers it; not to laws, whose coefficients
        are known together, along a curve that no straight step keeps to. Errors of the maps are wrong responses, which
        those of effects that remember take up."""
        problem, projection = self.found.problem, self.projection
        index = {n: j for j, n in enumerate(problem.names)}
        free = np.cumsum(projection.free) - 1
        error = np.sqrt(np.diag(projection.covariance()))
        result = {}
        of_laws = {n for o in self.options if o.kind == FORMULA_OPTION for n in o.hypothesis.names}
        for n in self.hypothesis.names:
            j = index[n]
            scale = problem.prior_sigma[j]
            value = self.found.theta[n]
            if projection.free[j] and n not in of_laws:
                value += float(projection.step[free[j]]) * scale
                value = float(np.clip(value, problem.lower[j], problem.upper[j]))
            result[n] = float(value), float(error[free[j]] * scale) if projection.free[j] else 0.0
        result |= self._spread(result)
        share, of_memory = response_error(self.found), {n for e in self.hypothesis.effects for n in remembered(e)}
        return {n: (v, float(np.hypot(s, share * v)) if n in of_memory else s) for n, (v, s) in result.items()}

    @cached_property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """95 % interval of each of the options' coefficients. That of one of an effect that remembers keeps to its
        bounds; where the records tell nothing of its derivative, as of a limit that nothing met, it ends at the size
        from which on they would; where they tell one end only, the other lies where χ² has risen (`plateau`)."""
        found = {n: (v - NORMAL_95 * s, v + NORMAL_95 * s) for n, (v, s) in self.coefficients.items()}
        parameters = self.found.model.parameters
        for n in (n for e in self.hypothesis.effects if e.trial_names for n in e.amplitudes):
            p, (low, high) = parameters[n], found[n]
            found[n] = max(low, p.lower), min(high, p.upper)
            if self.coefficients[n][1] > UNTOLD * p.prior_sigma and self._absent.get(n) == p.lower:
                found[n] = p.lower, largest(self.projection, n)
        for n in (e.parameter_name(c) for e in self.hypothesis.effects for c in e.term.one_sided):
            if self.converged and n in found and self.coefficients[n][1] > 0.0:
                found[n] = interval_at(self.found, n, self.coefficients[n][1])
        return found

    @property
    def _absent(self) -> dict[str, float]:
        """Sizes of effects that remember, with the value at which each is absent."""
        return {
            e.parameter_name(c.name): c.absent
            for e in self.hypothesis.effects
            if e.trial_names
            for c in e.term.amplitudes()
            if not c.free
        }

    def _spread(self, found: Mapping[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
        """Coefficients of effects with memory whose estimates spread more over stretches of the records than
        independent readings would: what a model leaves of a transient is no noise."""
        if not self.converged:
            return {}
        problem = self.found.problem
        wider: dict[str, tuple[float, float]] = {}
        free = dict(zip(problem.names, self.projection.free[: len(problem.names)], strict=True))
        for e in self.hypothesis.effects:
            names = [n for n in e.amplitudes if free[n]] if e.trial_names else []
            if not names:
                continue
            scale = problem.prior_sigma[[problem.names.index(n) for n in names]]
            error = np.sqrt(np.diag(spread_of(self.projection, names)[1].covariance)) * scale
            wider |= {n: (found[n][0], max(found[n][1], float(s))) for n, s in zip(names, error, strict=True)}
        return wider


def remembered(effect: Effect) -> tuple[str, ...]:
    """Coefficients of an effect that remembers; none of any other."""
    return effect.amplitudes if MOMENT in effect.term.INPUTS else ()
