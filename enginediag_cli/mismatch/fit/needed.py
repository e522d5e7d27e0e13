"""Whether a fit needs what it carries."""

from __future__ import annotations

import numpy as np

from enginediag_cli.mismatch.fit.options import FORMULA_OPTION, FREE, Option
from enginediag_cli.mismatch.fit.scores import surprise
from enginediag_cli.mismatch.fit.trial import HypothesisFit


def not_needed(trial: HypothesisFit, least: float) -> str:
    """A listed option of the trial that is not needed, −ln p > `least`; empty without one."""
    return next((o.label for o in trial.options if o.kind != FREE and not is_needed(trial, o, least)), "")


def is_needed(trial: HypothesisFit, option: Option, least: float) -> bool:
    """Whether a coefficient of the option is further than −ln p = `least` from nothing."""
    own = [trial.coefficients[n] for n in option.hypothesis.sizes]
    z2 = max(((v / s) ** 2 for v, s in own if s > 0), default=0.0)
    if option.kind == FORMULA_OPTION:
        z2 = max(z2, _beside_its_shape(trial, option))
    return not surprise(z2, 1) < least


def _beside_its_shape(trial: HypothesisFit, option: Option) -> float:
    """(v/s)² of the clearest size, shapes and further forms at its place held: what a law changes can be clear where
    neither size nor width is, since a wider one that is larger changes the same."""
    problem, free = trial.found.problem, trial.projection.free
    own = set(_acts_on(option))
    here = {n for o in trial.options if o.kind == FORMULA_OPTION and own & set(_acts_on(o)) for n in o.hypothesis.names}
    at = [j for j, n in enumerate(problem.names) if n in here and free[j]]
    rows = (np.cumsum(free) - 1)[at]
    information = np.linalg.inv(trial.projection.covariance()[np.ix_(rows, rows)])
    sizes = [(k, problem.names[j]) for k, j in enumerate(at) if problem.names[j] in option.hypothesis.sizes]
    scale = dict(zip(problem.names, problem.prior_sigma, strict=True))
    return max((float((trial.coefficients[n][0] / scale[n]) ** 2 * information[k, k]) for k, n in sizes), default=0.0)


def _acts_on(option: Option) -> list[str]:
    return [n for e in option.hypothesis.effects for n in e.site.targets]
