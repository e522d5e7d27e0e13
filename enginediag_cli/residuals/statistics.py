"""The local statistics (s, F, V, N) of a stretch of records: sufficient for all later tests.

    s = Σ_k J_kᵀ R_k⁻¹ e_k     F = Σ_k J_kᵀ R_k⁻¹ J_k     V = covariance of s     r_N = s/√N   (eqs. 7, 8)

They add: the statistics of two windows, flights or machines are the sum of their statistics, as long as they are of
all parameters: what is uncertain beside those that are monitored is a parameter, too, and is marginalised in the sum
(`files.py`). Marginalised window by window it would count once for each.

**Covariance** of a sum of primary residuals when the noise of a sensor is correlated in time (AR(1)):

    V = Σ_j σ_j² Σ_k Σ_l ρ_j^|k−l| g_kj g_ljᵀ      with g_kj = the row of whitened sensitivities

The double sum is one pass with the recursion a_k = c_k a_{k−1} + g_k, c_k = ρ^(steps since record k−1): it is

    Σ_k a_k a_kᵀ − Σ_k c_k² a_{k−1} a_{k−1}ᵀ = Σ_k h_k h_kᵀ,    h_k = √(1 − c_{k+1}²) a_k, c = 0 after the last record.

**Blocks** of records add to windows exactly, also where noise is correlated across their border. The primary residual
is eq. (7) with the weighting that mixed units need: K_k = J_kᵀ R⁻¹ e_k. R is the *long-run*
noise, σ²(1+ρ)/(1−ρ), the variance that a mean over many records really has; a sensor with slowly wandering
errors is thereby trusted less, and V ≈ F however correlated the noise.

**Excitation**: which combinations of parameters the operating points determine, and which they do not. Everything is
scaled by the prior standard deviations D = diag(prior_sigma), so that D F D has no unit: an eigenvalue of 1 means that
the data know the combination exactly as well as the prior did.

**Root of a covariance** C = L Lᵀ of parameters in mixed units, computed in units in which they are of one size. Beside
a heating value in J/kg, of variance 10¹¹, the error of a map, of variance 10⁻⁵, is less than rounding: a root computed
in parameter units would leave it out, and what is uncertain would pass for certain.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.identification.covariance import reduced_echelon
from enginediag_cli.identification.noise import linear_recursion
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.instruments import NoiseModel

LEAST_VARIANCE = 1e-14
"""Share of the largest variance, in units of the scale, up to which one is rounding."""


def covariance_root(covariance: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """L (p, r) of a positive semidefinite covariance (p, p), one column for each direction that is uncertain at all.

    scale (p,): a positive size of each parameter in its unit, such as its prior standard deviation.
    """
    scaled = covariance / scale / scale[:, None]
    own = np.diag(scaled)
    if np.count_nonzero(scaled) == np.count_nonzero(own):  # unit normals, offsets: nothing is left to decompose
        seen = own > LEAST_VARIANCE * max(float(own.max(initial=0.0)), 0.0)
        return np.asarray(np.diag(scale * np.sqrt(np.maximum(own, 0.0)))[:, seen])
    eigenvalues, vectors = np.linalg.eigh(scaled)
    seen = eigenvalues > LEAST_VARIANCE * max(float(eigenvalues[-1]), 0.0) if eigenvalues.size else eigenvalues > 0
    return np.asarray(scale[:, None] * vectors[:, seen] * np.sqrt(eigenvalues[seen]))


RANK_TOLERANCE = 1e-9
"""Eigenvalues of D F D below this share of the largest count as zero (sensitivities are good to 1e-10)."""


@dataclass(frozen=True)
class RangeSpace:
    """Eigen-decomposition of D F D restricted to its range: D F D = U diag(eigenvalues) Uᵀ.

    `scale` (p,) is the diagonal of D, `basis` U is (p, r), `eigenvalues` is (r,), descending; `tolerance`: by which
    others were taken for zero.
    """

    scale: np.ndarray
    basis: np.ndarray
    eigenvalues: np.ndarray
    tolerance: float = RANK_TOLERANCE

    @property
    def rank(self) -> int:
        return int(self.eigenvalues.size)


@dataclass(frozen=True)
class UnexcitedCombination:
    """A combination of parameters that the operating points hardly excite.

    `weights` gives the change of each parameter in multiples of its prior standard deviation; `information`
    is the squared signal-to-noise ratio of that change of one prior standard deviation.
    """

    weights: dict[str, float]
    information: float

    def __str__(self) -> str:
        terms = [f"{'-' if weight < 0 else '+'} {abs(weight):.2g} {name}" for name, weight in self.weights.items()]
        return " ".join(terms).removeprefix("+ ")


def range_space(F: np.ndarray, scale: np.ndarray, tolerance: float = RANK_TOLERANCE) -> RangeSpace:
    """Range of the information matrix F (p, p) in units of `scale` (p,), rank by relative tolerance."""
    eigenvalues, vectors = np.linalg.eigh(scale[:, None] * F * scale)
    eigenvalues, vectors = eigenvalues[::-1], vectors[:, ::-1]
    kept = eigenvalues > tolerance * max(eigenvalues[0], 0.0) if eigenvalues.size else np.zeros(0, bool)
    return RangeSpace(scale, vectors[:, kept], eigenvalues[kept], tolerance)


def unexcited_combinations(
    parameters: tuple[str, ...], F: np.ndarray, scale: np.ndarray, least_information: float = 1.0
) -> tuple[UnexcitedCombination, ...]:
    """Combinations known worse than `least_information` prior standard deviations squared, one per dimension.

    The eigenvectors of a null space of several dimensions are an arbitrary rotation, hard to read; the basis
    is therefore brought to reduced echelon form, in which each combination owns one leading parameter.
    """
    scaled = scale[:, None] * F * scale
    eigenvalues, vectors = np.linalg.eigh(scaled)
    weak = vectors[:, eigenvalues < least_information]
    if not weak.shape[1]:
        return ()
    found = []
    for row in reduced_echelon(weak).T:
        row = row / np.linalg.norm(row)
        order = np.argsort(-np.abs(row), kind="stable")
        weights = {parameters[i]: float(row[i]) for i in order if abs(row[i]) > 0.1}
        found.append(UnexcitedCombination(weights, max(float(row @ scaled @ row), 0.0)))
    return tuple(sorted(found, key=lambda c: c.information))


FORGOTTEN = 1e-14
"""Correlation below which the past no longer counts."""


@dataclass(frozen=True)
class LaggedSums:
    """`factors` (m, N, p): h_k of each sensor, inside the block of each record.

    Per block (B, ...): `tail` (m, p) = a at its last record; `head` (m, p) = Σ_k g_k times the correlation of
    record k with the record before the block; `decay` (m,) = correlation of last record and that record.
    """

    factors: np.ndarray
    tail: np.ndarray
    head: np.ndarray
    decay: np.ndarray


def lagged_sums(G: np.ndarray, rho: np.ndarray, lags: np.ndarray, starts: np.ndarray) -> LaggedSums:
    """Factors, heads and tails of blocks for G (N, m, p), rho (m,), lags (N,) in steps, starts (B,)."""
    N, m, p = G.shape
    stops = np.append(starts[1:], N)
    factors = np.ascontiguousarray(G.transpose(1, 0, 2))
    head, tail, decay = (np.zeros((len(starts), m, p)), np.zeros((len(starts), m, p)), np.zeros((len(starts), m)))
    for j in np.flatnonzero(rho):
        c = rho[j] ** lags
        inside = c.copy()
        inside[starts] = 0.0
        a = linear_recursion(factors[j][:, None], inside[:, None], FORGOTTEN)[:, 0]
        for b, (i, k) in enumerate(zip(starts, stops, strict=True)):
            reach = np.cumprod(c[i:k])
            head[b, j], tail[b, j], decay[b, j] = reach @ factors[j, i:k], a[k - 1], reach[-1]
        kept = np.sqrt(1.0 - np.append(inside[1:], 0.0) ** 2)
        np.multiply(kept[:, None], a, out=factors[j])
    return LaggedSums(factors, tail, head, decay)


def independent_rows(G: np.ndarray, rho: np.ndarray, lags: np.ndarray) -> np.ndarray:
    """h (N, m, p) with Σ_k g_k z_k = Σ_k h_k ε_k, ε_k independent of variance 1, for G (N, m, p), rho (m,), lags (N,).

    z_k = c_k z_{k−1} + √(1 − c_k²) ε_k, c_k as above and 0 for the first record, so that
    h_k = √(1 − c_k²) (g_k + c_{k+1} g_{k+1} + c_{k+1} c_{k+2} g_{k+2} + …).
    """
    h = G.copy()
    for j in np.flatnonzero(rho):
        c = np.sign(rho[j]) ** np.where(np.isfinite(lags), lags, 0) * np.abs(rho[j]) ** lags
        c[:1] = 0.0
        later = np.append(c[1:], 0.0)
        h[:, j] = np.sqrt(1 - c**2)[:, None] * linear_recursion(G[::-1, j, None], later[::-1, None], FORGOTTEN)[::-1, 0]
    return h


@dataclass(frozen=True)
class ParameterFrame:
    """`names` of p parameters; theta0 (p,): the point of linearisation, in their units; prior_sigma (p,): how large a
    change of each is plausible; meaning: what they are, by name, where it is known."""

    names: Sequence[str]
    theta0: np.ndarray
    prior_sigma: np.ndarray
    meaning: Mapping[str, Parameter] = field(default_factory=dict)


MAX_ROWS = 20_000
"""Terms of s beyond which the law of each does not matter: what it changes falls as 1/number."""


@dataclass(frozen=True)
class LocalStatistics:
    """Local statistics about the point `theta0` of p parameters.

    s (p,) in 1/parameter unit, F and V (p, p), n records. `chi2` = Σ eᵀR⁻¹e and `dof`, its mean when the
    model is right: the number of independent measurements (records × sensors, fewer when noise is correlated
    in time). `prior_sigma` (p,) says how large a change of each parameter is plausible, in its unit.
    `by_sensor` (q, p, p), where noise was estimated: by how much one standard deviation of each independent error
    of it changes V (mostly a sensor's part of V times the error of the logarithm of its variance). `rows` (k, p),
    where noise is not Gaussian: s = Σ rows_i ε_i with independent ε_i of variance 1 and excess kurtosis `kurtosis`
    (k,). `doubt`: what `fisher_score` made of these. `meaning`: what each parameter is, by name.
    `slopes` (p, p): covariance that wrong slopes of the maps add to a change of the parameters, should they have
    changed: no matter of the test whether anything has. `points` (k, p, p), as long as it is not known how large they
    are: what they leave where they differ from operating point to operating point (`relinearise.py`).
    additive: whether nothing has been marginalised; `common` and `own` are then the parameters that are not monitored,
    but uncertain by their `prior_sigma`, independent of each other: the same in all windows, and anew in each
    recording.
    """

    parameters: tuple[str, ...]
    theta0: np.ndarray
    prior_sigma: np.ndarray
    s: np.ndarray
    F: np.ndarray
    V: np.ndarray
    n: int
    chi2: float
    dof: float
    start: str = ""
    end: str = ""
    by_sensor: np.ndarray | None = None
    rows: np.ndarray | None = None
    kurtosis: np.ndarray | None = None
    doubt: tuple[float, float, float] = (0.0, 0.0, 0.0)
    meaning: Mapping[str, Parameter] = field(default_factory=dict)
    slopes: np.ndarray | None = None
    points: np.ndarray | None = None
    additive: bool = False
    common: tuple[str, ...] = ()
    own: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        p = len(self.parameters)
        for name, shape in [("theta0", (p,)), ("prior_sigma", (p,)), ("s", (p,)), ("F", (p, p)), ("V", (p, p))]:
            if getattr(self, name).shape != shape:
                raise ValueError(f"`{name}` must have shape {shape}, not {getattr(self, name).shape}")
        if not np.all(self.prior_sigma > 0):
            raise ValueError("`prior_sigma` must be positive")

    def __add__(self, other: LocalStatistics) -> LocalStatistics:
        """Statistics of both stretches together; correlation of noise across their border is not counted."""
        if self.parameters != other.parameters:
            raise ValueError("statistics of different parameters cannot be added")
        if not np.allclose(self.theta0, other.theta0, rtol=1e-9, atol=1e-12):
            raise ValueError("statistics about different nominal points cannot be added")
        rows, kurtosis = _join_rows(self, other)
        return replace(
            self,
            s=self.s + other.s,
            F=self.F + other.F,
            V=self.V + other.V,
            n=self.n + other.n,
            chi2=self.chi2 + other.chi2,
            dof=self.dof + other.dof,
            end=other.end or self.end,
            by_sensor=None if self.by_sensor is None or other.by_sensor is None else self.by_sensor + other.by_sensor,
            rows=rows,
            kurtosis=kurtosis,
            doubt=_join_doubt(self.doubt, other.doubt),
            slopes=_larger_slopes(self, other),
            points=None if self.points is None or other.points is None else self.points + other.points,
        )

    @property
    def monitored(self) -> tuple[str, ...]:
        """Parameters that may have changed."""
        nuisance = {*self.common, *self.own}
        return tuple(name for name in self.parameters if name not in nuisance)

    def unexcited(self, least_information: float = 1.0) -> tuple[UnexcitedCombination, ...]:
        """Combinations of parameters that these operating points contain less about than the prior does."""
        return unexcited_combinations(self.parameters, self.F, self.prior_sigma, least_information)

    def drop_parameters(self, names: Collection[str]) -> LocalStatistics:
        """The same of all parameters but `names`, which are taken not to have changed."""
        kept = np.array([i for i, a in enumerate(self.parameters) if a not in names], dtype=int)
        if len(kept) == len(self.parameters):
            return self
        square = np.ix_(kept, kept)
        return replace(
            self,
            parameters=tuple(self.parameters[i] for i in kept),
            theta0=self.theta0[kept],
            prior_sigma=self.prior_sigma[kept],
            common=tuple(name for name in self.common if name not in names),
            own=tuple(name for name in self.own if name not in names),
            s=self.s[kept],
            F=self.F[square],
            V=self.V[square],
            by_sensor=None if self.by_sensor is None else self.by_sensor[:, kept[:, None], kept],
            rows=None if self.rows is None else self.rows[:, kept],
            slopes=None if self.slopes is None else self.slopes[square],
            points=None if self.points is None else self.points[:, kept[:, None], kept],
        )

    def indices(self, names: Sequence[str]) -> np.ndarray:
        """Positions of `names`; KeyError names the parameter that these statistics do not monitor."""
        position = {name: i for i, name in enumerate(self.parameters)}
        missing = [name for name in names if name not in position]
        if missing:
            raise KeyError(f"not monitored: {', '.join(missing)}")
        return np.array([position[name] for name in names], dtype=int)


def _join_rows(a: LocalStatistics, b: LocalStatistics) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Rows of both and their kurtosis; none where there are so many that the sum is Gaussian whatever its terms."""
    if a.rows is None or b.rows is None or a.kurtosis is None or b.kurtosis is None:
        return None, None
    if len(a.rows) + len(b.rows) > MAX_ROWS:
        return None, None
    return np.concatenate([a.rows, b.rows]), np.concatenate([a.kurtosis, b.kurtosis])


def _larger_slopes(a: LocalStatistics, b: LocalStatistics) -> np.ndarray | None:
    """The maps and the change are the same in both stretches, and their errors do not average out: the larger ones."""
    if a.slopes is None or b.slopes is None:
        return b.slopes if a.slopes is None else a.slopes
    larger = np.sum(np.diag(a.slopes) / a.prior_sigma**2) >= np.sum(np.diag(b.slopes) / a.prior_sigma**2)
    return a.slopes if larger else b.slopes


def _join_doubt(a: tuple[float, float, float], b: tuple[float, float, float]) -> tuple[float, float, float]:
    """Doubt about the noise is common to both stretches; each contributes half of the leverages, h² a quarter."""
    common = max(a[:2], b[:2])
    return common[0], common[1], (a[2] + b[2]) / 4


@dataclass(frozen=True)
class StatisticsBlock:
    """Sums over consecutive records with what the next and the block before need to know of them.

    `sums`: their statistics, with V = F; `parts` (m, p, p): what the noise of each sensor contributes to V, None where
    noise is white and certain, and V is F. `records`: how many follow each other, those without a reading counted.
    `head`, `tail` (m, p) and `decay` (m,) as in `correlated.LaggedSums`.
    """

    sums: LocalStatistics
    noise: NoiseModel
    parts: np.ndarray | None
    records: int
    head: np.ndarray
    tail: np.ndarray
    decay: np.ndarray

    def __add__(self, later: StatisticsBlock) -> StatisticsBlock:
        """This block followed at once by `later`: V_j = V_j1 + V_j2 + cross + crossᵀ, cross = tail_j1 head_j2ᵀ."""
        parts = None
        if self.parts is not None and later.parts is not None:
            tail = self.tail / self.noise.inflation[:, None]  # in variances of one whitened residual
            cross = tail[:, :, None] * later.head[:, None, :]
            parts = self.parts + later.parts + cross + cross.transpose(0, 2, 1)
        return StatisticsBlock(
            self.sums + later.sums,
            self.noise,
            parts,
            self.records + later.records,
            self.head + self.decay[:, None] * later.head,
            later.tail + later.decay[:, None] * self.tail,
            self.decay * later.decay,
        )

    @property
    def statistics(self) -> LocalStatistics:
        """The statistics, with V and how uncertain it is for a window of so many records."""
        if self.parts is None:
            return self.sums
        errors, bias = self.noise.doubt(self.records) or (None, np.zeros(len(self.parts)))
        V = self.sums.F if self.noise.white else np.tensordot(1 / (1 + bias), self.parts, axes=1)
        return replace(self.sums, V=V, by_sensor=None if errors is None else np.tensordot(errors, self.parts, axes=1))


def whiten(e: np.ndarray, J: np.ndarray, noise: NoiseModel) -> tuple[np.ndarray, np.ndarray]:
    """Scale residuals and sensitivities by the long-run noise.

    Parameters
    ----------
    e : ndarray
        Residuals (N, m) in sensor units, NaN where a sensor is missing.
    J : ndarray
        Sensitivities (N, m, p) in sensor unit per parameter unit. A row that is not finite is dropped with its reading.
    noise : NoiseModel

    Returns
    -------
    z : ndarray
        Residuals (N, m) without unit; zero where missing.
    G : ndarray
        Sensitivities (N, m, p) per parameter unit; zero where missing.
    """
    z, G, _ = whitened(e, J, noise)
    return z, G


def whitened(e: np.ndarray, J: np.ndarray, noise: NoiseModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As `whiten`, and which measurements there are (N, m)."""
    with np.errstate(invalid="ignore"):
        present = np.isfinite(e) & np.isfinite(J.sum(axis=2))
    if not present.all():
        e = np.where(present, e, 0.0)
        J = np.where(present[:, :, None], J, 0.0)
    if noise.covariance is None:
        weight = 1 / (noise.sigma * np.sqrt(noise.inflation))
        return e * weight, J * weight[:, None], present
    z, G = np.zeros_like(e), np.zeros_like(J)
    for pattern in np.unique(present, axis=0):  # one Cholesky factor per set of working sensors
        records = np.flatnonzero(np.all(present == pattern, axis=1))
        sensors = np.flatnonzero(pattern)
        if sensors.size:
            inverse = np.linalg.inv(np.linalg.cholesky(noise.covariance[np.ix_(sensors, sensors)]))
            cell = np.ix_(records, sensors)
            z[cell] = e[cell] @ inverse.T
            G[cell] = inverse @ J[cell]
    return z, G, present


def block_statistics(
    e: np.ndarray,
    J: np.ndarray,
    noise: NoiseModel,
    starts: np.ndarray,
    frame: ParameterFrame,
    *,
    lags: np.ndarray | None = None,
    information: np.ndarray | None = None,
) -> Iterator[StatisticsBlock]:
    """Statistics of consecutive blocks of records in turn, ready to be added up to windows.

    e (N, m), J (N, m, p): residuals and sensitivities at the θ0 of the frame of p parameters; starts (B,): first record
    of each block, ascending from 0. lags (N,): steps of time since the record before (inf: unrelated, a new recording);
    1 when not given. V is exact for AR(1) noise, inside blocks and, when blocks are added, between them.
    information: F (B, p, p) of the blocks, where it is known.
    """
    N, _, p = J.shape
    z, G, present = whitened(e, J, noise)
    lags = np.ones(N) if lags is None else lags
    stops = np.append(starts[1:], N)
    share = 1 / noise.inflation  # variance of one whitened residual
    lagged = lagged_sums(G, noise.rho, lags, starts)
    by_sensor = not noise.white or noise.readings is not None
    for b, (i, k) in enumerate(zip(starts, stops, strict=True)):
        rows = G[i:k].reshape(-1, p)
        F = rows.T @ rows if information is None else information[b]
        parts = terms = kurtosis = None
        if by_sensor:
            parts = np.stack([h.T @ h for h in lagged.factors[:, i:k]]) * share[:, None, None]  # (m, p, p)
        if noise.kurtosis is not None and (k - i) * G.shape[1] <= MAX_ROWS:
            told = np.flatnonzero(noise.kurtosis)
            terms = independent_rows(G[i:k, told], noise.rho[told], lags[i:k]) * np.sqrt(share[told])[:, None]
            terms, kurtosis = terms.reshape(-1, p), np.tile(noise.kurtosis[told], k - i)
        used = present[i:k]
        sums = LocalStatistics(
            parameters=tuple(frame.names),
            theta0=np.asarray(frame.theta0, float),
            prior_sigma=np.asarray(frame.prior_sigma, float),
            s=rows.T @ z[i:k].ravel(),
            F=F,
            V=F,
            n=int(used.any(axis=1).sum()),
            chi2=float(np.sum(z[i:k] ** 2)),
            # neighbours that differ more than by chance are no further measurements
            dof=float(used.sum(axis=0) @ np.minimum(share, 1.0)),
            rows=terms,
            kurtosis=kurtosis,
            meaning=frame.meaning,
        )
        yield StatisticsBlock(sums, noise, parts, int(k - i), lagged.head[b], lagged.tail[b], lagged.decay[b])
