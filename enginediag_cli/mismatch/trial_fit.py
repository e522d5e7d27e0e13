"""One hypothesis fitted and looked at: what it explains, and what it leaves to be explained."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from enginediag_cli.mismatch.drivers import Driver
from enginediag_cli.mismatch.freeform import Cell, free_form
from enginediag_cli.mismatch.identified import Hypothesis, Identified, Nuisance, identify_with
from enginediag_cli.mismatch.options import Option, OptionScore, option_scores, together
from enginediag_cli.mismatch.projection import Projection


@dataclass(frozen=True)
class Trial:
    """A fit with some options. `objective` is its χ² of readings and priors."""

    options: tuple[Option, ...]
    found: Identified
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

    @cached_property
    def at_bound(self) -> tuple[str, ...]:
        """Coefficients of the options that ended at a physical bound."""
        held = dict(zip(self.found.problem.names, self.found.fit.at_bound, strict=True))
        return tuple(n for n in self.hypothesis.names if held[n])

    @property
    def hypothesis(self) -> Hypothesis:
        return self.found.hypothesis

    @cached_property
    def coefficients(self) -> dict[str, tuple[float, float]]:
        """Value and standard error of each of the options' coefficients, in its unit. One whitened Newton step is
        added where noise is correlated in time, since the fit itself only tempers it."""
        problem, projection = self.found.problem, self.projection
        index = {n: j for j, n in enumerate(problem.names)}
        free = np.cumsum(projection.free) - 1
        error = np.sqrt(np.diag(projection.covariance()))
        result = {}
        for n in self.hypothesis.names:
            j = index[n]
            scale = problem.prior_sigma[j]
            value = self.found.theta[n]
            if projection.free[j]:
                value += float(projection.step[free[j]]) * scale
            result[n] = float(value), float(error[free[j]] * scale) if projection.free[j] else 0.0
        return result


@dataclass(frozen=True)
class Remainder:
    """What a trial leaves: scores of the other options and the free-form map, most surprising first."""

    scores: tuple[OptionScore, ...]
    cells: tuple[Cell, ...]

    @property
    def surprise(self) -> float:
        """−ln p of the most surprising thing that is left."""
        best = max((s.surprise for s in self.scores), default=0.0)
        return max(best, max((c.surprise for c in self.cells), default=0.0))

    def blocks(self) -> list[np.ndarray]:
        """Projected columns of everything that can be ranked."""
        scores = [s.columns for s in self.scores if not s.score.absorbed]
        return scores + [c.columns for c in self.cells if not c.score.absorbed]


def attempt(options: Sequence[Option], start: Identified, along: Nuisance) -> Trial:
    """Fit nuisance and options together, from another fit."""
    found = identify_with(start.evidence, together(*options), along, start)
    return Trial(tuple(options), found, Projection(found))


def remainder(trial: Trial, library: Sequence[Option], drivers: Sequence[Driver]) -> Remainder:
    """Scores of what the trial does not carry; drivers are over the records of the evidence."""
    scores = sorted(option_scores(trial.found, trial.projection, library), key=lambda s: -s.surprise)
    return Remainder(tuple(scores), tuple(free_form(trial.found, trial.projection, drivers)))
