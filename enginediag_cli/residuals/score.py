"""The score b = Mᵀ Σ⁻¹ r and Fisher information I = Mᵀ Σ⁻¹ M: the form in which all tests are quadratic.

With s ~ N(F Δθ, V + F C F), C the covariance of what is uncertain about θ0 and the nuisance parameters,

    b = F_a (V + F C F)⁻¹ s        I = F_a (V + F C F)⁻¹ F_aᵀ        (F_a: rows of the parameters of interest)

so that b ~ N(I Δθ_a, I). For white noise and a certain nominal, b = s and I = F.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.parameters import Parameter, meanings
from enginediag_cli.residuals.statistics import (
    RANK_TOLERANCE,
    LocalStatistics,
    RangeSpace,
    covariance_root,
    range_space,
)


@dataclass(frozen=True)
class Score:
    """Score b (p,) and information (p, p) of `parameters`, with `glr` = bᵀ I⁺ b, eq. (11), and its `rank`.

    `doubt`: A₁, A₂ and Q of `_doubt`, how uncertain estimated noise makes the metric of the test and how far its law is
    from that of Gaussian noise; 0 for known, Gaussian noise. `meaning`: what each parameter is, by name.
    """

    parameters: tuple[str, ...]
    theta0: np.ndarray
    prior_sigma: np.ndarray
    b: np.ndarray
    information: np.ndarray
    glr: float
    rank: int
    doubt: tuple[float, float, float] = (0.0, 0.0, 0.0)
    meaning: Mapping[str, Parameter] = field(default_factory=dict)

    @property
    def described(self) -> tuple[Parameter, ...]:
        """What each parameter is (p,): `unspecified` where `meaning` does not say."""
        return tuple(meanings(self.meaning, self.parameters).values())

    def scaled(self) -> tuple[np.ndarray, np.ndarray]:
        """D b (p,) and D I D (p, p) with D = diag(prior_sigma): parameters in prior standard deviations."""
        d = self.prior_sigma
        return d * self.b, d[:, None] * self.information * d

    def indices(self, names: Sequence[str]) -> np.ndarray:
        """Positions of `names`; KeyError for a name that is not monitored."""
        missing = [name for name in names if name not in self.parameters]
        if missing:
            raise KeyError(f"not monitored: {', '.join(missing)}")
        return np.array([self.parameters.index(name) for name in names], dtype=int)


def fisher_score(
    statistics: LocalStatistics,
    *,
    monitored: Sequence[str] | None = None,
    uncertainty: np.ndarray | None = None,
    tolerance: float = RANK_TOLERANCE,
) -> Score:
    """Compute score b and Fisher information I, in the range of F, so that singular F and V do no harm.

    Parameters
    ----------
    statistics : LocalStatistics
        s (p,), F (p, p) and V (p, p) of a window.
    monitored : sequence of str, optional
        The parameters of interest; all by default. The others are certain, or covered by `uncertainty`.
    uncertainty : ndarray, optional
        C (p, p) in parameter units: covariance of θ0 as identified and of nuisance parameters (sensor offsets).
    tolerance : float
        Share of the largest eigenvalue below which a direction counts as not observed.

    Returns
    -------
    Score

    Notes
    -----
    b = F_a (V + F C F)⁻¹ s and I = F_a (V + F C F)⁻¹ F_aᵀ, so that b ~ N(I Δθ_a, I).
    """
    space = range_space(statistics.F, statistics.prior_sigma, tolerance)
    return _compute_score(space, statistics, monitored, uncertainty)


def _compute_score(
    space: RangeSpace, statistics: LocalStatistics, monitored: Sequence[str] | None, uncertainty: np.ndarray | None
) -> Score:
    """As `fisher_score`, in the range of F."""
    a, B, information = score_map(space, statistics, monitored, uncertainty)
    b, D = B @ statistics.s, statistics.prior_sigma
    reduced = range_space(information, D[a], space.tolerance)
    v = (D[a] * b) @ reduced.basis
    return Score(
        tuple(statistics.parameters[i] for i in a),
        statistics.theta0[a],
        D[a],
        b,
        information,
        float(np.sum(v**2 / reduced.eigenvalues)),
        reduced.rank,
        _doubt(statistics, B, D[a], reduced),
        statistics.meaning,
    )


def _doubt(
    statistics: LocalStatistics, B: np.ndarray, scale: np.ndarray, space: RangeSpace
) -> tuple[float, float, float]:
    """A₁ = Σ_j (tr H_j)² and A₂ = Σ_j tr H_j² of Kenward and Roger (1997), j the independent errors of the noise, and
    Q = Σ_i κ_i h_i², κ_i the excess kurtosis of the i-th independent term of s and h_i its share in the test statistic.

    H_j = R V_j Rᵀ with R = I^-½ B is what a standard deviation of error j does to the covariance of the normalised
    score R s, V_j what it does to V, and h_i = |R row_i|². The uncertainty of nominal was computed with the same noise
    and is taken to be wrong in the same proportion.
    """
    if statistics.by_sensor is None and statistics.rows is None:
        return statistics.doubt
    R = (space.basis / np.sqrt(space.eigenvalues)).T * scale @ B
    A1 = A2 = Q = 0.0
    if statistics.by_sensor is not None:
        H = R @ statistics.by_sensor @ R.T
        noise = float(np.sum((R @ statistics.V) * R)) / space.rank if space.rank else 1.0
        H = H / max(noise, 1e-12)
        A1, A2 = float(np.sum(np.einsum("jaa->j", H) ** 2)), float(np.sum(H * H.transpose(0, 2, 1)))
    if statistics.rows is not None and statistics.kurtosis is not None:
        h = np.sum((statistics.rows @ R.T) ** 2, axis=1)
        Q = float(statistics.kurtosis @ h**2)
    return A1, A2, Q


def score_map(
    space: RangeSpace, statistics: LocalStatistics, monitored: Sequence[str] | None, uncertainty: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions a (q,) of the monitored, B (q, p) with b = B s, and I (q, q), in the range of F; arguments as in
    `fisher_score`."""
    U, root, D = space.basis, np.sqrt(space.eigenvalues), statistics.prior_sigma
    half = (U / root).T * D  # Λ^-½ Uᵀ D
    W = half @ statistics.V @ half.T
    if uncertainty is not None:
        spread = (U * root).T / D  # Λ^½ Uᵀ D⁻¹
        W = W + spread @ uncertainty @ spread.T
    a = statistics.indices(monitored if monitored is not None else statistics.parameters)
    rows = (U[a] * root) / D[a, None]  # D⁻¹ U Λ^½: F_a in the basis in which z = half s lives
    L = np.linalg.cholesky(W) if space.rank else np.zeros((0, 0))
    H = np.linalg.solve(L, rows.T)
    return a, H.T @ np.linalg.solve(L, half), H.T @ H


def marginalise(statistics: LocalStatistics, keep: Sequence[str], uncertainty: np.ndarray) -> LocalStatistics:
    """Statistics of the parameters `keep` with everything in `uncertainty` (p, p) counted as noise.

    Use per recording for offsets that differ from one recording to the next, before adding recordings. The
    result has V = F. Its χ² is such that χ² − GLR stays what no parameter explains: Σz² less sᵀ(F + C⁻¹)⁻¹s
    and less the GLR statistic in the metric of F (that of V differs when noise is correlated in time).
    """
    space = range_space(statistics.F, statistics.prior_sigma)
    score = _compute_score(space, statistics, keep, uncertainty)
    in_F = replace(statistics, V=statistics.F, by_sensor=None, rows=None)
    plain = _compute_score(space, in_F, keep, uncertainty)
    a = statistics.indices(score.parameters)
    root = covariance_root(uncertainty, statistics.prior_sigma)
    inner = np.eye(root.shape[1]) + root.T @ statistics.F @ root
    absorbed = root.T @ statistics.s
    explained = float(absorbed @ np.linalg.solve(inner, absorbed))
    return replace(
        statistics,
        parameters=score.parameters,
        theta0=score.theta0,
        prior_sigma=score.prior_sigma,
        s=score.b,
        F=score.information,
        V=score.information,
        by_sensor=None,
        rows=None,
        kurtosis=None,
        doubt=score.doubt,
        slopes=None if statistics.slopes is None else statistics.slopes[np.ix_(a, a)],
        additive=False,
        common=tuple(name for name in statistics.common if name in score.parameters),
        own=tuple(name for name in statistics.own if name in score.parameters),
        chi2=statistics.chi2 - explained - plain.glr + score.glr,
    )


def marginalise_nuisance(statistics: LocalStatistics) -> LocalStatistics:
    """Statistics of the monitored parameters, everything else counted as noise: of windows that are judged together."""
    if not statistics.additive:
        return statistics
    return marginalise(
        statistics, statistics.monitored, _nuisance_covariance(statistics, (*statistics.common, *statistics.own))
    )


def drop_nuisance(statistics: LocalStatistics) -> LocalStatistics:
    """Statistics of the monitored parameters at nominal as it is, for windows that are compared with each other."""
    return statistics.drop_parameters({*statistics.common, *statistics.own})


def _nuisance_covariance(statistics: LocalStatistics, names: tuple[str, ...]) -> np.ndarray:
    """C (p, p): of these parameters, zero for the others."""
    variance = np.zeros(len(statistics.parameters))
    at = statistics.indices(names)
    variance[at] = statistics.prior_sigma[at] ** 2
    return np.diag(variance)
