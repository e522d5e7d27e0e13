"""Sequential test of the records of a flight by e-values: the false-alarm probability holds for the whole flight.

A change Δθ ~ N(0, P) that begins at block j has, against no change, the likelihood ratio

    log L_j = −½ log det(I + P F) + ½ sᵀ (P⁻¹ + F)⁻¹ s

with s and F of what came since j, after elimination of everything uncertain about nominal (w ~ N(0, C), in both
hypotheses). The mean over shapes of change and onsets j with weights Σ w_j = 1,

    E_n = Σ_{j ≤ n} w_j L_j + (1 − Σ_{j ≤ n} w_j),

starts at 1 and has mean 1 as long as nothing changes, so that P(E_n ≥ 1/α for any n) ≤ α: J. Ville, Étude critique
de la notion de collectif, 1939; mixtures: H. Robbins, Ann. Math. Statist. 41 (1970) 1397–1409; sums over onsets:
J. Shin, A. Ramdas, A. Rinaldo, "E-detectors", NEJSDS 2023. Forgetting an onset can only lower E. The bound holds for
Gaussian noise, and with certain nominal for uniform noise too, whose moments E exp(λx) lie below the Gaussian ones.

The past of a flight takes constant memory: recent blocks are kept one by one, older ones in ever longer pieces. Sums of
a block are in coordinates in which everything unknown is N(0, 1) beforehand, see `Coordinates`.

Innovations. They are residuals with the memory of the noise taken out, independent from record to record. For AR(1)
noise the innovation of a sensor is what its past reading does not predict,

    z_k = (e_k − c_k e_l) / (σ √(1 − c_k²))        G_k = (J_k − c_k J_l) / (σ √(1 − c_k²))        c_k = ρ^(k−l)

with l the sensor's last reading before k (G. E. P. Box and G. M. Jenkins, Time Series Analysis, 1976, ch. 7). Their
likelihood is that of the readings, so that likelihood ratios are exact and not only right in the long run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.instruments import NoiseModel
from enginediag_cli.residuals.statistics import whiten

RECENT = 48
"""Pieces of one length that are kept before two of them become one of twice that length."""


@dataclass(frozen=True)
class Coordinates:
    """Columns of `basis` (p, d) turn unit normals into parameters: first k nuisance, then a health, then m sensors.

    health, sensors: the changes that are looked for, in the order of their columns; unit (a + m,): what one unit normal
    of each is, in its unit.
    """

    basis: np.ndarray
    nuisance: int
    health: tuple[Parameter, ...]
    sensors: tuple[Parameter, ...]
    unit: np.ndarray

    @property
    def described(self) -> tuple[Parameter, ...]:
        """All changes that are looked for."""
        return (*self.health, *self.sensors)


@dataclass(frozen=True)
class Segment:
    """Sums over blocks first … last − 1: s (d,) = Σ GᵀZ and F (d, d) = Σ GᵀG in unit-normal coordinates.

    `clock` is the mean time of its records, `begin` the time of its first record.
    """

    first: int
    last: int
    records: int
    begin: float
    clock: float
    s: np.ndarray
    F: np.ndarray

    def __add__(self, later: Segment) -> Segment:
        n = self.records + later.records
        clock = (self.records * self.clock + later.records * later.clock) / max(n, 1)
        return Segment(self.first, later.last, n, self.begin, clock, self.s + later.s, self.F + later.F)


def append_segment(past: list[Segment], new: Segment) -> list[Segment]:
    """`past` with `new` behind it; where there are more than RECENT pieces of a length, the oldest two are joined."""
    kept, length = [*past, new], 1
    while True:
        same = [i for i, piece in enumerate(kept) if piece.last - piece.first == length]
        if len(same) <= RECENT:
            return kept
        i = same[0]
        kept[i : i + 2] = [kept[i] + kept[i + 1]]
        length *= 2


@dataclass(frozen=True)
class OnsetSums:
    """Sums from each of J possible onsets to now, s (J, d) and F (J, d, d); the first is the beginning."""

    s: np.ndarray
    F: np.ndarray


def onset_sums(past: list[Segment]) -> OnsetSums:
    """Sums for an onset at the beginning of each piece."""
    s, F = np.stack([piece.s for piece in past]), np.stack([piece.F for piece in past])
    return OnsetSums(np.cumsum(s[::-1], axis=0)[::-1], np.cumsum(F[::-1], axis=0)[::-1])


FROM_THE_START = 0.5
"""Weight of a change that was there when the flight began; the rest is for those that begin on the way."""
HORIZON = 60
"""Blocks, or flights, over which later onsets have about the same weight; it falls as 1/j² beyond."""
SCALES = (1.0, 0.25)
"""Sizes of a change of one parameter alone, in multiples of its prior standard deviation."""


@dataclass(frozen=True)
class ChangeEquations:
    """Normal equations of the changes, nuisance eliminated, for J onsets: score r (J, c), information S (J, c, c)."""

    r: np.ndarray
    S: np.ndarray


def eliminate_nuisance(found: OnsetSums, nuisance: int) -> ChangeEquations:
    """r = s_δ − F_δw (I + F_ww)⁻¹ s_w,   S = F_δδ − F_δw (I + F_ww)⁻¹ F_wδ."""
    k = nuisance
    r, S = found.s[:, k:], found.F[:, k:, k:]
    if k == 0:
        return ChangeEquations(r, S)
    F_wd = found.F[:, :k, k:]
    inner = np.eye(k) + found.F[0, :k, :k]
    J, _, c = F_wd.shape
    right = np.concatenate([found.s[0, :k, None], F_wd.transpose(1, 0, 2).reshape(k, J * c)], axis=1)
    solved = np.linalg.solve(inner, right)
    solved_F = solved[:, 1:].reshape(k, J, c).transpose(1, 0, 2)
    back = F_wd.transpose(0, 2, 1)
    return ChangeEquations(r - back @ solved[:, 0], S - back @ solved_F)


def log_single(found: ChangeEquations, scale: float = 1.0) -> np.ndarray:
    """log likelihood ratios (J, c) of a change of one parameter alone, of `scale` prior standard deviations."""
    information = scale**2 * np.maximum(np.einsum("jcc->jc", found.S), 0.0)
    return np.asarray(-0.5 * np.log1p(information) + 0.5 * scale**2 * found.r**2 / (1 + information))


def log_full(found: ChangeEquations, count: int) -> np.ndarray:
    """log likelihood ratios (J,) of a change of the first `count` parameters together."""
    r, S = found.r[:, :count], found.S[:, :count, :count]
    L = np.linalg.cholesky(np.eye(count) + (S + S.transpose(0, 2, 1)) / 2)
    y = np.linalg.solve(L, r[:, :, None])[:, :, 0]
    return np.asarray(-np.sum(np.log(np.einsum("jcc->jc", L)), axis=1) + 0.5 * np.sum(y**2, axis=1))


def log_mean_exp(x: np.ndarray, axis: int = -1) -> np.ndarray:
    """log of the mean of exp(x) along an axis."""
    top = np.max(x, axis=axis, keepdims=True)
    return np.asarray(np.log(np.mean(np.exp(x - top), axis=axis)) + np.squeeze(top, axis=axis))


def log_ratio(found: ChangeEquations, coordinates: Coordinates) -> np.ndarray:
    """log L_j (J,): a third each for all health parameters together, one of them alone, one sensor alone."""
    a = len(coordinates.health)
    parts = [log_full(found, a)] if a else []
    singles = np.stack([log_single(found, scale) for scale in SCALES])
    for chosen in (slice(0, a), slice(a, None)):
        part = singles[:, :, chosen]
        if part.shape[2]:
            parts.append(log_mean_exp(log_mean_exp(part, axis=2), axis=0))
    return log_mean_exp(np.stack(parts), axis=0)


def onset_weight(number: np.ndarray, first: float) -> np.ndarray:
    """w_j for the numbers j = 0, 1, … of blocks or flights: w_0 = `first`, then (1 − w_0) H/((j + H − 1)(j + H)), which
    sum to 1."""
    j = np.asarray(number, float)
    return np.where(j == 0, first, (1 - first) * HORIZON / ((j + HORIZON - 1) * (j + HORIZON)))


@dataclass
class EProcess:
    """E of one flight. past: blocks that are decided for good; open: those after them. `log_e` is log E_n,
    `alarm_block` the first block with E ≥ 1/α (None while there is none); alone: the cause without which E would stay
    below."""

    coordinates: Coordinates
    false_alarm: float
    past: list[Segment] = field(default_factory=list)
    open: list[Segment] = field(default_factory=list)
    log_e: float = 0.0
    decisive_cause: str = ""
    alarm_block: int | None = None

    @property
    def pieces(self) -> list[Segment]:
        """The flight so far."""
        return [*self.past, *self.open]

    def segment(self, block: int, X: np.ndarray, z: np.ndarray, begin: float, clock: float) -> Segment:
        """A block's sums from innovations z (n, m) and their sensitivities X (n, m, d) to the coordinates."""
        columns = X.reshape(-1, X.shape[2])
        return Segment(block, block + 1, len(z), begin, clock, columns.T @ z.ravel(), columns.T @ columns)

    def add(
        self,
        closed: Iterable[Segment],
        open_blocks: Sequence[Segment],
        disturbed: Callable[[], Iterable[tuple[str, Sequence[Segment]]]] = tuple,
    ) -> None:
        """Blocks that are decided for good, and all later ones as they look now, a new one the last.

        disturbed: several causes and what the open blocks would be without what each may have done to them; no alarm
        rests on one such cause alone. The smallest of several E is no larger than any, so that the bound holds.
        """
        for segment in closed:
            self.past = append_segment(self.past, segment)
        self.open, self.decisive_cause = list(open_blocks), ""
        limit = -np.log(self.false_alarm)
        self.log_e = self._log_e(self.open)
        if self.alarm_block is None and self.log_e >= limit:
            without = {cause: self._log_e(segments) for cause, segments in disturbed()}
            self.log_e = min([self.log_e, *without.values()])
            if self.log_e >= limit:
                self.alarm_block = self.pieces[-1].last - 1
            else:
                self.decisive_cause = min(without, key=lambda cause: without[cause])

    def _log_e(self, open_blocks: Sequence[Segment]) -> float:
        """log E_n with these for the open blocks."""
        pieces = [*self.past, *open_blocks]
        if not pieces:
            return 0.0
        found = eliminate_nuisance(onset_sums(pieces), self.coordinates.nuisance)
        weights = onset_weight(np.array([piece.first for piece in pieces]), FROM_THE_START)
        # onsets that have been forgotten count as ratio 0, those to come as ratio 1
        to_come = (1 - FROM_THE_START) * HORIZON / (pieces[-1].last + HORIZON - 1)
        return float(np.logaddexp.reduce([*(np.log(weights) + log_ratio(found, self.coordinates)), np.log(to_come)]))


@dataclass
class Innovations:
    """Innovations of a stream that comes in chunks; keeps the last reading of every sensor."""

    noise: NoiseModel
    _last: dict[int, tuple[float, float, np.ndarray]] = field(default_factory=dict)  # time, e/σ, J/σ of a sensor
    _elapsed: float = 0.0

    def fork(self) -> Innovations:
        """One that goes on from here by itself."""
        return replace(self, _last=dict(self._last))

    def compute(self, e: np.ndarray, J: np.ndarray, lags: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """z (N, m) and G (N, m, p) of the next records, zero where a sensor is missing.

        e (N, m) in sensor units, NaN where missing; J (N, m, p); lags (N,) in records since the record before,
        inf for the first of a recording.
        """
        if self.noise.white:
            return whiten(e, J, self.noise)
        present = np.isfinite(e) & np.all(np.isfinite(J), axis=2)
        steps = np.where(np.isfinite(lags), lags, 1e9)
        time = self._elapsed + np.cumsum(steps)
        if len(time):
            self._elapsed = float(time[-1])
        z, G = np.zeros_like(e), np.zeros_like(J)
        for j, (sigma, rho) in enumerate(zip(self.noise.sigma, self.noise.rho, strict=True)):
            rows = np.flatnonzero(present[:, j])
            if not rows.size:
                continue
            t, x, g = time[rows], e[rows, j] / sigma, J[rows, j] / sigma
            before = self._last.get(j, (-np.inf, 0.0, np.zeros(J.shape[2])))
            c = rho ** np.diff(t, prepend=before[0])
            scale = 1 / np.sqrt(1 - c**2)
            z[rows, j] = scale * (x - c * np.concatenate([[before[1]], x[:-1]]))
            G[rows, j] = scale[:, None] * (g - c[:, None] * np.concatenate([before[2][None], g[:-1]]))
            self._last[j] = float(t[-1]), float(x[-1]), g[-1]
        return z, G
