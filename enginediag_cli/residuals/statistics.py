"""The local statistics (s, F, V, N) of a stretch of records: everything that later tests need to know of it.

    s = Σ_k J_kᵀ R_k⁻¹ e_k     F = Σ_k J_kᵀ R_k⁻¹ J_k     V = covariance of s     r_N = s/√N   (eqs. 7, 8)

They add: the statistics of two windows, flights or machines are the sum of their statistics, as long as they are of
all parameters: what is uncertain beside those that are monitored is a parameter, too, and is marginalised in the sum
(`additive.py`). Marginalised window by window it would count once for each.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.excitation import DarkCombination, dark_combinations

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
    are: what they leave where they differ from operating point to operating point (`operating_points.py`).
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
        for name, shape in [
            ("theta0", (p,)),
            ("prior_sigma", (p,)),
            ("s", (p,)),
            ("F", (p, p)),
            ("V", (p, p)),
        ]:
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
        rows, kurtosis = _rows_of_both(self, other)
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
            doubt=_doubt_of_both(self.doubt, other.doubt),
            slopes=_slopes_of_both(self, other),
            points=None if self.points is None or other.points is None else self.points + other.points,
        )

    @property
    def monitored(self) -> tuple[str, ...]:
        """Parameters that may have changed."""
        return tuple(name for name in self.parameters if name not in {*self.common, *self.own})

    def unexcited(self, least_information: float = 1.0) -> tuple[DarkCombination, ...]:
        """Combinations of parameters that these operating points tell less about than the prior does."""
        return dark_combinations(self.parameters, self.F, self.prior_sigma, least_information)

    def without(self, names: Collection[str]) -> LocalStatistics:
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


def _rows_of_both(a: LocalStatistics, b: LocalStatistics) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Rows of both and their kurtosis; none where there are so many that the sum is Gaussian whatever its terms."""
    if a.rows is None or b.rows is None or a.kurtosis is None or b.kurtosis is None:
        return None, None
    if len(a.rows) + len(b.rows) > MAX_ROWS:
        return None, None
    return np.concatenate([a.rows, b.rows]), np.concatenate([a.kurtosis, b.kurtosis])


def _slopes_of_both(a: LocalStatistics, b: LocalStatistics) -> np.ndarray | None:
    """The maps and the change are the same in both stretches, and their errors do not average out: the larger ones."""
    if a.slopes is None or b.slopes is None:
        return b.slopes if a.slopes is None else a.slopes
    larger = np.sum(np.diag(a.slopes) / a.prior_sigma**2) >= np.sum(np.diag(b.slopes) / a.prior_sigma**2)
    return a.slopes if larger else b.slopes


def _doubt_of_both(a: tuple[float, float, float], b: tuple[float, float, float]) -> tuple[float, float, float]:
    """Doubt about the noise is common to both stretches; each contributes half of the leverages, h² a quarter."""
    common = max(a[:2], b[:2])
    return common[0], common[1], (a[2] + b[2]) / 4
