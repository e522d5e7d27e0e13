"""What an identification gives up, one thing after the other, rather than end without an answer.

Shapes of maps and amounts of map error describe the same thing: how a map runs between the operating points that were
flown. At no more points than an error has curves the amounts can do whatever shapes would, and where the maps are
generic the shapes are then left as the engine file states them. Else both are sought, and where that does not converge
or drives a shape to a bound the shapes go first, then the amounts. Amounts that are not sought stay at 0 with the
uncertainty that they have, and the parameters get the uncertainty that comes of it (`considered`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from enginediag_cli.error_model.curves import FREEDOMS
from enginediag_cli.error_model.machines import machines_of
from enginediag_cli.error_model.slopes import GENERIC
from enginediag_cli.identification.bounds import at_bounds
from enginediag_cli.identification.covariance import Uncertainty, uncertainty
from enginediag_cli.identification.map_error import with_map_error
from enginediag_cli.identification.normal_equations import normal_equations, predict
from enginediag_cli.identification.passes import Passes, fit_and_noise
from enginediag_cli.identification.point_errors import with_point_errors
from enginediag_cli.identification.problem import Problem
from enginediag_cli.identification.repeated_points import cells_of
from enginediag_cli.identification.settings import IdentificationSettings


class GivenUp(Enum):
    """What was not estimated, and why."""

    SHAPES_AT_FEW_POINTS = "shapes of maps, at so few operating points"
    SHAPES = "shapes of maps, because the fit did not converge with them"
    SHAPES_AT_BOUND = "shapes of maps, because the fit drove one of them to a bound"
    SIZES = "errors of maps, because the fit did not converge with them"


@dataclass(frozen=True)
class Attempt:
    """A fit with its noise, and what was given up for it."""

    passes: Passes
    given_up: tuple[GivenUp, ...] = ()

    @property
    def bent(self) -> bool:
        """Whether the shape of a map is at a bound, where no machine is."""
        problem = self.passes.problem
        return any(b.name in shapes_of(problem) for b in at_bounds(problem, self.passes.fit))


def best_attempt(problem: Problem, settings: IdentificationSettings, accuracy: float) -> Attempt:
    """The first attempt that converges with no shape at a bound, else the first that converges, else the first of all.
    accuracy: of the maps as stated, a share. All attempts together take no more steps than the settings allow: a file
    of another engine would keep each of them busy to its end."""
    tried: list[Attempt] = []
    for attempt in _attempts(problem, settings, accuracy):
        if attempt.passes.converged and not attempt.bent:
            return attempt
        tried.append(attempt)
    return next((attempt for attempt in tried if attempt.passes.converged), tried[0])


def _attempts(problem: Problem, settings: IdentificationSettings, accuracy: float) -> Iterator[Attempt]:
    pointed = with_point_errors(problem, accuracy)
    whole = with_map_error(pointed, accuracy)
    if whole is problem:
        yield Attempt(fit_and_noise(problem, settings, accuracy))
        return
    plain = without_shapes(pointed)
    shaped = plain is not pointed
    if shaped and accuracy >= GENERIC and operating_points(problem) <= FREEDOMS:
        attempt = Attempt(
            fit_and_noise(with_map_error(plain, accuracy), settings, accuracy), (GivenUp.SHAPES_AT_FEW_POINTS,)
        )
        yield attempt
    else:
        attempt = Attempt(fit_and_noise(whole, settings, accuracy))
        yield attempt
        settings = settings.after(attempt.passes.steps)
        if shaped and settings.max_iterations > 0:
            why = GivenUp.SHAPES_AT_BOUND if attempt.passes.converged else GivenUp.SHAPES
            attempt = Attempt(fit_and_noise(with_map_error(plain, accuracy), settings, accuracy), (why,))
            yield attempt
    settings = settings.after(attempt.passes.steps)
    trusted = fit_and_noise(problem, settings, 0.0) if settings.max_iterations > 0 else None
    if trusted is not None and trusted.converged:
        yield Attempt(considered(trusted, accuracy), (GivenUp.SIZES,))


def operating_points(problem: Problem) -> int:
    """How many operating points the records are at, as far as the readings tell them apart."""
    zeros = np.zeros(len(problem.parameters)), np.zeros((len(problem.labels), len(problem.offsets)))
    predicted, status = predict(problem, *zeros)
    there = status <= 1
    return len(np.unique(cells_of(predicted[there]))) if there.any() else 0


def shapes_of(problem: Problem) -> set[str]:
    """Names of the parameters that say of which shape a map of the engine is."""
    return {name for m in machines_of(problem.model) for name in m.shapes}


def without_shapes(problem: Problem) -> Problem:
    """The problem with map shapes as the engine file states them; those with a mean of their own remain."""
    shapes = shapes_of(problem)
    own = np.array([p.nominal for p in problem.parameters]) != problem.prior_mean
    kept = np.array([p.name not in shapes for p in problem.parameters]) | own
    if kept.all() or not kept.any():
        return problem
    return replace(
        problem,
        parameters=tuple(p for p, k in zip(problem.parameters, kept, strict=True) if k),
        prior_mean=problem.prior_mean[kept],
        prior_sigma=problem.prior_sigma[kept],
        lower=problem.lower[kept],
        upper=problem.upper[kept],
    )


def considered(passes: Passes, accuracy: float) -> Passes:
    """The same fit with amounts of map error a ~ N(0, 1) beside the parameters x, none of which were sought.

    An estimator that leaves a at 0 is off by G a + e, with G = S⁻¹ H_xa the part that the parameters take over:

        cov(x̂ − x, â − a) = [[P + G Gᵀ, −G], [−Gᵀ, 1]]

    Source: S. F. Schmidt, Advances in Control Systems 3 (1966) 293–340, "considered" parameters.
    """
    problem = with_map_error(passes.problem, accuracy)
    p, k = len(passes.problem.parameters), len(problem.parameters) - len(passes.problem.parameters)
    x = np.append(passes.fit.x, np.zeros(k))
    fit = replace(
        passes.fit,
        x=x,
        equations=normal_equations(problem, x, passes.fit.z),
        at_bound=np.append(passes.fit.at_bound, np.zeros(k, bool)),
    )
    found = uncertainty(problem, fit, passes.noise.rho1, passes.noise.used)
    S = found.information[:p, :p] + np.eye(p)
    taken = np.linalg.solve(S, found.information[:p, p:])
    own = passes.found.covariance + taken @ taken.T
    covariance = np.block([[own, -taken], [-taken.T, np.eye(k)]])
    return replace(passes, problem=problem, fit=fit, found=_with_covariance(found, covariance))


def _with_covariance(found: Uncertainty, covariance: np.ndarray) -> Uncertainty:
    return replace(found, covariance=covariance, from_data=np.clip(1 - np.diag(covariance), 0, 1))
