"""How large map errors are: the standard deviations under which the training records are likeliest.

With information H and pull b of the data about the amounts x (everything else eliminated or beside them), both in units
of the present prior standard deviations, and t the factor by which the standard deviation of each group changes,

    ln L(t) = ½ bᵀ(H + T⁻²)⁻¹ b − ½ ln det(1 + T² H),     ∂ln L/∂ln t_g = Σ_{j in g} [(μ_j² + C_jj)/t_g² − 1]

with μ = C b, C = (H + T⁻²)⁻¹. To it comes a prior. The maps of one engine come from one source, and are good or bad
together,

    ln s_g = ln stated + c + e_g,     c ~ N(0, COMMON SPREAD²),  e_g ~ N(0, (1 − COMMON) SPREAD²),

so that where some are seen to be wrong by several times what is stated, the statement about those of which training
shows little is not trusted. s_g is never below what is stated: one healthy engine may happen to lie on its map, and the
next need not.

Outside training nothing corrects a size that was estimated too small. The curves that begin there get the expected
variance over the possible sizes, E[s²], rather than the square of the likeliest,

    S = C_gg⁻¹ − I,  β = C_gg⁻¹ μ_g        ln L(t_g) = ½ βᵀ(S + t_g⁻²)⁻¹ β − ½ ln det(1 + t_g² S)

for one group, the others at their sizes, and the prior of its size given theirs.

Wrong sensitivities: with a generic map the effect of a change is wrong in proportion to the change.

A map whose slope is wrong by Δ gives, when a fault moves its machine by Δξ on it, a wrong efficiency or flow

    δq = Δ · (ξ_c(θ̂) − ξ_c(θ0)),     Δ ~ N(0, s²),  s = 0.2 (efficiency), 0.5 (flow) for generic maps,

for each coordinate ξ of machine c, ln corrected speed and ln flow or pressure ratio. It acts where the health
parameter of that map quantity does, so that it is an uncertainty of a change of that parameter: none where nothing has
changed. A map whose slope is wrong at one operating point is wrong elsewhere, too, though not by as much: half of the
variance is common to all points of a window (`COMMON`), the other half each point's own. s is stated, not estimated:
healthy records of one operating point know nothing of it, and the likelihood of several prefers values that fail on
other fleets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from enginediag_cli.error_model.maps import QUANTITIES, ErrorModel, machine_columns, turbomachines

SPREAD = 1.0
"""Standard deviation of the logarithm of a size about what is stated: two thirds lie within a factor e."""
COMMON = 0.75
"""Share of the variance of that logarithm which all maps of an engine have in common. Judgement: they are scaled from
the same generic shapes, or measured on the same rig; half of it does nearly as much, none takes a power turbine's map
at its word beside others that are wrong by 3 and 5 %."""
LARGEST = 5.0
"""Size of a map error, as a multiple of what is stated, that is not exceeded: what asks for more is no error of a map
but physics that is missing, and must stay to be seen."""

SLOPE = 1e-3
"""Slope of ln L per ln t at which the search ends: a size is then found to a thousandth. Its value would not do to end
it: ½ bᵀ C b grows with the records, and what sizes change of it does not."""


STEPS = 25
"""Sizes of one group that are weighed, in equal steps of their logarithm: seven per cent apart."""


def likeliest_factors(
    information: np.ndarray,
    pull: np.ndarray,
    group: np.ndarray,
    present: np.ndarray,
    stated: np.ndarray,
    between: tuple[np.ndarray, np.ndarray] | None = None,
    maps: int | None = None,
) -> np.ndarray:
    """Factors t (G,) on the present sizes.

    information H (p, p), pull b (p,); group (p,): number of the group of each parameter, −1 for those that keep their
    prior; present and stated (G,): sizes as they are and as the engine file has them.
    between: least and largest size as multiples of what is stated (G,), 1 and LARGEST where not given. maps: how many
    groups, from the first on, are maps of one engine; all where not given.
    """
    from scipy.optimize import minimize

    G = len(present)
    if not G:
        return np.ones(0)
    centre = np.log(stated / present)
    least, largest = (np.ones(G), np.full(G, LARGEST)) if between is None else between
    precision = _precision(G if maps is None else maps, G)
    bottom, top = centre + np.log(least), centre + np.log(largest)

    def objective(log_t: np.ndarray) -> tuple[float, np.ndarray]:
        t = np.where(group >= 0, np.exp(log_t)[group], 1.0)
        inner = np.eye(len(t)) + t[:, None] * information * t
        L = np.linalg.cholesky(inner)
        half = np.linalg.solve(L, t * pull)
        C = np.linalg.inv(inner)
        mean = C @ (t * pull)  # in units of t
        slope = mean**2 + np.diag(C) - 1.0
        gradient = np.bincount(group[group >= 0], slope[group >= 0], minlength=G)
        value = 0.5 * float(half @ half) - float(np.sum(np.log(np.diag(L))))
        away = log_t - centre
        pulled = precision @ away
        return -(value - 0.5 * float(away @ pulled)), -(gradient - pulled)

    start = np.clip(np.zeros(G), bottom, top)
    bounds = list(zip(bottom, top, strict=True))
    found = minimize(objective, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"ftol": 0.0, "gtol": SLOPE})
    return np.asarray(np.exp(found.x))


def expected_factors(
    information: np.ndarray, pull: np.ndarray, group: np.ndarray, present: np.ndarray, stated: np.ndarray
) -> np.ndarray:
    """√E[s²] of each group's size s, from what is stated to LARGEST times that, in present sizes, (G,).

    Arguments as of `likeliest_factors`, at the sizes that it found.
    """
    C = np.linalg.inv(information + np.eye(len(pull)))
    mean = C @ pull
    v = np.linspace(0.0, np.log(LARGEST), STEPS)
    precision = _precision(len(present), len(present))
    sizes = np.log(present / stated)
    usual = sizes - precision @ sizes / np.diag(precision)  # of each, given the others
    factors = np.empty(len(present))
    for g in range(len(present)):
        at = np.flatnonzero(group == g)
        inner = np.linalg.inv(C[np.ix_(at, at)])
        eigenvalues, vectors = np.linalg.eigh(inner - np.eye(len(at)))
        known = np.maximum(eigenvalues, 0.0)  # (k,), what rounding leaves below nothing
        projected = vectors.T @ (inner @ mean[at])
        t2 = (stated[g] / present[g] * np.exp(v)[:, None]) ** 2
        gain = 0.5 * np.sum(projected**2 * t2 / (1.0 + t2 * known) - np.log1p(t2 * known), axis=1)
        log_weight = gain - 0.5 * precision[g, g] * (v - usual[g]) ** 2
        weight = np.exp(log_weight - log_weight.max())
        factors[g] = np.sqrt(weight @ t2[:, 0] / weight.sum())
    return factors


def _precision(maps: int, groups: int) -> np.ndarray:
    """Inverse prior covariance (G, G) of the logarithms of the sizes, the first `maps` of them of one engine's maps."""
    covariance = SPREAD**2 * np.eye(groups)
    covariance[:maps, :maps] = SPREAD**2 * ((1 - COMMON) * np.eye(maps) + COMMON)
    return np.asarray(np.linalg.inv(covariance))


SLOPES = {"efficiency": 0.2, "flow_capacity": 0.5}
"""Standard deviation of ∂ln q/∂ξ of a generic map. 0.15 to 0.3 with 0.5 to 1 do as well on fleets with generic maps,
0.2 with 0.3 does not."""
GENERIC = 0.01
"""Stated accuracy of maps that are generic; slopes of better ones are better in proportion."""

TURNS = 30
"""Of the variance that depends on the change that depends on it: each one halves what is missing."""
SETTLED = 0.01
"""Share of the largest variance to which it is then known: a standard deviation to half a per cent."""


COMMON_SLOPE_SHARE = 0.5
"""Share of the variance of a wrong slope that all operating points of a window have in common. Judgement: points may
lie side by side or at the ends of the map. With all of it in common, what single conditions show differently is
reported as a second change; with none, the error averages out that a generic map has everywhere. Of 240 simulated
engines of fleets at six conditions on other maps 24 were named wrongly with all of it, none with half and 1 with
none."""


@dataclass(frozen=True)
class MapSlopes:
    """`position` (k,): of the uncertain map quantities among the monitored parameters; `moved` (k, 2, a): how far a
    unit of each of the a monitored parameters moves the machine on its map; `sigma` (k,): of ∂ln q/∂ξ."""

    position: np.ndarray
    displacement: np.ndarray
    sigma: np.ndarray

    def select(self, kept: Sequence[int]) -> MapSlopes | None:
        """The same for those of the monitored parameters that are kept; None where none of them is a map's."""
        place = {i: k for k, i in enumerate(kept)}
        rows = [r for r, i in enumerate(self.position) if int(i) in place]
        if not rows:
            return None
        position = np.array([place[int(self.position[r])] for r in rows])
        return MapSlopes(position, self.displacement[rows][:, :, list(kept)], self.sigma[rows])

    def variance(self, change: np.ndarray) -> np.ndarray:
        """Variance (a,) that a change (a,) of the monitored parameters adds to each of them."""
        added = np.zeros(len(change))
        distance = np.sum((self.displacement @ change) ** 2, axis=1)
        added[self.position] = self.sigma**2 * distance
        return added

    def likely_variance(self, pull: np.ndarray, information: np.ndarray, spread: np.ndarray) -> np.ndarray:
        """Variance (a,) that the change adds which statistics speak of: score (a,) and information (a, a), `spread`
        (a,) of a plausible change, 0 of what is taken not to have changed.

        The likeliest change depends on the variance in turn, since readings mean less where slopes are wrong:

            c = σ²(v) of     δ = S (1 + I (C + S))⁻¹ b,     C = diag(c),  S = diag(spread²)

        A change estimated with right slopes is too large by what they explain, and its variance by the square of that.
        """
        own = np.flatnonzero(spread > 0)
        scale = spread[own]
        b, square = scale * pull[own], scale[:, None] * information[np.ix_(own, own)] * scale
        change, variance = np.zeros(len(spread)), np.zeros(len(spread))
        for turn in range(TURNS):
            inner = np.eye(len(own)) + square * (variance[own] / scale**2 + 1.0)
            change[own] = scale * np.linalg.solve(inner, b)
            found = self.variance(change)
            if np.max(np.abs(found - variance), initial=0.0) <= SETTLED * np.max(found, initial=0.0):
                return found
            # a larger variance makes the change smaller: halfway there and back do not swing about the answer
            variance = (found + variance) / 2 if turn else found
        return np.maximum(found, variance)  # where it has not settled, the wider of the last two


def map_slopes(
    engine: Any, found: ErrorModel, monitored: Sequence[str], inputs: dict[str, np.ndarray], theta: dict[str, float]
) -> MapSlopes | None:
    """Slopes at operating points `inputs` (n,) and parameters `theta`; None where no monitored parameter is a map's."""
    share = min(found.stated / GENERIC, 1.0)
    machines = turbomachines(engine)
    wanted = machine_columns(machines)
    known = [
        (m, q, monitored.index(m.parameter(q)))
        for m in machines
        for q in QUANTITIES
        if m.parameter(q) in monitored and m.parameter(q) in found.sizes
    ]
    if not known or share == 0.0:
        return None
    p = engine.predict(inputs, theta, sensors=wanted, wrt=tuple(monitored))
    ok = p.ok & np.isfinite(p.jacobian).all(axis=(1, 2))
    if not ok.any():
        return None
    relative = p.jacobian[ok] / p.y[ok][:, :, None]  # ∂ln column/∂θ
    log = dict(zip(wanted, np.mean(relative, axis=0), strict=True))
    moved = np.array([m.differentials(log) for m, _, _ in known])
    return MapSlopes(np.array([i for _, _, i in known]), moved, share * np.array([SLOPES[q] for _, q, _ in known]))
