"""What is missing where no listed effect fits: the free-form map's best cells, refitted, as curves along a driver.

The map is linear at the fit without them, and of a large effect its first cell may be a neighbour of the right one.
The best few are therefore refitted with everything that is identified, and told in the order of these fits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.drivers import CONSTANT, TIME, polynomials
from enginediag_cli.engine.term import DriverValues
from enginediag_cli.mismatch.fit.extended import Discrepancy
from enginediag_cli.mismatch.fit.freeform import DEGREE, Cell, Location
from enginediag_cli.mismatch.fit.identified import Hypothesis, IdentifiedHypothesis, Nuisance, identify_with
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.progress import stage

REFITTED = 5
"""Places, by score, at which a free curve is fitted; the fit may change their order, a place further down rarely comes
first."""
POINTS = 25
"""Of a drawn curve."""
WITHIN, OF_LARGEST = 4.6, 0.02
"""A cell whose −ln p is within WITHIN of the first (a factor of 100), or what linearisation may cost, is as likely."""


@dataclass(frozen=True)
class Curve:
    """A cell refitted: change (G,) of the location's parameter at values (G,) of the driver, with standard errors,
    `gain` the fall of χ² with `dof` coefficients. Constants belong to what is identified: the changes are about 0, but
    for a place that is not identified and may be wrong in every record alike (driver CONSTANT)."""

    location: Location
    driver: DriverValues
    unit: str
    gain: float
    dof: int
    values: np.ndarray
    change: np.ndarray
    standard_error: np.ndarray
    converged: bool
    reason: str


def best_places(cells: Sequence[Cell]) -> list[Cell]:
    """The best cell of each location within reach of the map's first, in the order of the map."""
    if not cells or not cells[0].surprise:
        return []
    reach = WITHIN + OF_LARGEST * max(c.score.statistic for c in cells if c.surprise)
    found: dict[str, Cell] = {}
    for c in cells:
        if c.surprise >= cells[0].surprise - reach and c.driver.driver != TIME:
            found.setdefault(c.location.name, c)
    return list(found.values())


@stage("fitting free-form curves")
def fitted_curves(base: IdentifiedHypothesis, objective: float, cells: Sequence[Cell], along: Nuisance) -> list[Curve]:
    """The cells refitted, best first, those that did not converge last; `objective` is that of the fit `base`."""
    found = [_fitted(base, objective, c, along) for c in cells[:REFITTED]]
    return sorted(found, key=lambda c: (not c.converged, -c.gain + 2 * c.dof))


def _fitted(base: IdentifiedHypothesis, objective: float, cell: Cell, along: Nuisance) -> Curve:
    place, driver = cell.location, cell.driver
    N = len(driver.values)
    columns = np.ones((N, 1)) if driver.driver == CONSTANT else polynomials(driver.values, DEGREE)
    through = (place.through,) if place.through is not None else ()
    engine = base.evidence.engine.replace_effects((*base.evidence.engine.effects, *through))
    parameter = engine.parameters[place.parameter]
    curves = {f"{driver.name} {j + 1}": c for j, c in enumerate(columns.T)}
    sought = tuple(Discrepancy(place.parameter, key, parameter.prior_sigma) for key in curves)
    fit = identify_with(base.evidence, Hypothesis(through, sought, curves), along, base)
    order = np.argsort(driver.values[fit.number])
    rows = fit.number[order[np.unique(np.linspace(0, len(order) - 1, POINTS).astype(int))]]
    phi = columns[rows]
    nothing = np.full(len(rows), np.nan)
    projection = Projection(fit) if fit.converged else None
    if projection is None or projection.objective >= objective:
        # a score counts on a straight way, which the fit did not find
        reason = "the fit gains nothing" if fit.converged else fit.reason
        return Curve(
            place, driver, parameter.unit, 0.0, len(sought), driver.values[rows], nothing, nothing, False, reason
        )
    j = [fit.problem.names.index(d.name) for d in sought]
    sigma = fit.problem.prior_sigma[j]
    k = np.cumsum(projection.free)[j] - 1
    c = np.array([fit.theta[d.name] for d in sought]) + projection.step[k] * sigma
    C = projection.covariance()[np.ix_(k, k)] * np.outer(sigma, sigma)
    error = np.sqrt(np.einsum("ij,jk,ik->i", phi, C, phi))
    return Curve(
        place,
        driver,
        parameter.unit,
        objective - projection.objective,
        len(sought),
        driver.values[rows],
        phi @ c,
        error,
        True,
        "",
    )
