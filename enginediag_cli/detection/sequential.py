"""Sequential test of the records of a flight by e-values: the false-alarm probability holds for the whole flight.

A change Δθ ~ N(0, P) that begins with record j has, against no change, the likelihood ratio

    log L_j = −½ log det(I + P F) + ½ sᵀ (P⁻¹ + F)⁻¹ s

with s and F of what came since j, after elimination of everything uncertain about nominal (w ~ N(0, C), in both
hypotheses). The mean over suspects, sizes and onsets j with weights Σ w_j = 1,

    E_n = Σ_{j ≤ n} w_j L_j + (1 − Σ_{j ≤ n} w_j),

starts at 1 and has mean 1 as long as nothing changes, so that P(E_n ≥ 1/α for any n) ≤ α: J. Ville, Étude critique
de la notion de collectif, 1939; mixtures: H. Robbins, Ann. Math. Statist. 41 (1970) 1397–1409; sums over onsets:
J. Shin, A. Ramdas, A. Rinaldo, "E-detectors", NEJSDS 2023. Forgetting an onset can only lower E. The bound holds for
Gaussian noise, and with certain nominal for uniform noise too, whose moments E exp(λx) lie below the Gaussian ones.
It is not reached, because E passes a limit h by some amount:

    P(E_n ≥ h for any n) = ∫ E_δ[1/E_τ] dπ(δ) ≈ ρ/h,      ρ = ∫ ν(√(δᵀf δ)) dπ(δ)

π: the prior of changes δ, f: the information of a record, ν(x): the limit of E_δ[h/E_τ] where records have the
Kullback–Leibler distance x²/2 (T. L. Lai, D. Siegmund, Ann. Statist. 5 (1977) 946–954). An alarm comes at E = ρ/α.
Suspects, sizes and their probabilities are those of the model of change (`history`), so that an alarm
comes when that model finds a step likely enough.

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
    """Sums over `records` records from number `first` on, counted from 0, of so many blocks: s (d,) = Σ GᵀZ and
    F (d, d) = Σ GᵀG in unit-normal coordinates.

    `clock` is the mean time of its records, `begin` the time of its first record; `chance`: prior probability that a
    change begins with its first block.
    """

    first: int
    records: int
    begin: float
    clock: float
    chance: float
    s: np.ndarray
    F: np.ndarray
    blocks: int = 1

    def __add__(self, later: Segment) -> Segment:
        n = self.records + later.records
        clock = (self.records * self.clock + later.records * later.clock) / max(n, 1)
        s, F = self.s + later.s, self.F + later.F
        return Segment(self.first, n, self.begin, clock, self.chance, s, F, self.blocks + later.blocks)


def append_segment(past: list[Segment], new: Segment) -> list[Segment]:
    """`past` with `new` behind it; where there are more than RECENT pieces of as many blocks, the oldest two are
    joined."""
    kept, length = [*past, new], 1
    while True:
        same = [i for i, piece in enumerate(kept) if piece.blocks == length]
        if len(same) <= RECENT:
            return kept
        i = same[0]
        kept[i : i + 2] = [kept[i] + kept[i + 1]]
        length *= 2


@dataclass(frozen=True)
class ChangeEquations:
    """Normal equations of the changes, nuisance eliminated, for J onsets: score r (J, c), information S (J, c, c)."""

    r: np.ndarray
    S: np.ndarray


def change_equations(past: Sequence[Segment], nuisance: int) -> ChangeEquations:
    """For an onset at the beginning of each piece, with sums from there to now, the last k = `nuisance` of all records:

    r = s_δ − F_δw (I + F_ww)⁻¹ s_w,   S = F_δδ − F_δw (I + F_ww)⁻¹ F_wδ.
    """
    k = nuisance
    s = np.stack([piece.s[k:] for piece in past])[::-1].cumsum(axis=0)[::-1]
    F = np.stack([piece.F[:, k:] for piece in past])[::-1].cumsum(axis=0)[::-1]
    S = F[:, k:]
    if k == 0:
        return ChangeEquations(s, S)
    half = np.linalg.inv(np.linalg.cholesky(np.eye(k) + sum(piece.F[:k, :k] for piece in past)))
    seen = half @ F[:, :k]
    known = half @ sum(piece.s[:k] for piece in past)
    back = seen.transpose(0, 2, 1)
    return ChangeEquations(s - back @ known, S - back @ seen)


FROM_THE_START = 0.2
"""Probability of a change that was there when the flight began, given that there is one: new faults come on the way."""
HORIZON = 1000
"""Records over which later onsets are about as probable, some hours; it falls as 1/j² beyond."""


def onset_chance(first: int, records: int) -> float:
    """Probability of an onset within `records` records from number `first` on, counted from 0:

    (1 − w₀) (b/(b + H) − a/(a + H)) from a to b, and w₀ at the very beginning.
    """
    later = (1 - FROM_THE_START) * HORIZON * records / ((first + HORIZON) * (first + records + HORIZON))
    return later + (FROM_THE_START if first == 0 else 0.0)


@dataclass
class EProcess:
    """E of one flight. log_ratio: of the equations of J onsets the log (J,) of a mean of likelihood ratios over changes
    of all kinds, weighed beforehand. overshoot: ρ, 1 where it is not known. past: blocks that are decided for good;
    open: those after them. `log_e` is log E_n, `alarm_block` the first block with E ≥ ρ/α (None while there is none);
    decisive_cause: that without which E would stay below."""

    coordinates: Coordinates
    log_ratio: Callable[[ChangeEquations], np.ndarray]
    false_alarm: float
    overshoot: float = 1.0
    past: list[Segment] = field(default_factory=list)
    open: list[Segment] = field(default_factory=list)
    log_e: float = 0.0
    decisive_cause: str = ""
    alarm_block: int | None = None

    @property
    def pieces(self) -> list[Segment]:
        """The flight so far."""
        return [*self.past, *self.open]

    def segment(self, first: int, X: np.ndarray, z: np.ndarray, begin: float, clock: float) -> Segment:
        """A block's sums from innovations z (n, m) and their sensitivities X (n, m, d) to the coordinates; first:
        number of its first record."""
        columns = X.reshape(-1, X.shape[2])
        s, F = columns.T @ z.ravel(), columns.T @ columns
        return Segment(first, len(z), begin, clock, onset_chance(first, len(z)), s, F)

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
        limit = float(np.log(self.overshoot / self.false_alarm))
        self.log_e = self._log_e(self.open)
        if self.alarm_block is None and self.log_e >= limit:
            without = {cause: self._log_e(segments) for cause, segments in disturbed()}
            self.log_e = min([self.log_e, *without.values()])
            if self.log_e >= limit:
                self.alarm_block = sum(piece.blocks for piece in self.pieces) - 1
            else:
                self.decisive_cause = min(without, key=lambda cause: without[cause])

    def _log_e(self, open_blocks: Sequence[Segment]) -> float:
        """log E_n with these for the open blocks."""
        pieces = [*self.past, *open_blocks]
        if not pieces:
            return 0.0
        ratio = self.log_ratio(change_equations(pieces, self.coordinates.nuisance))
        # onsets that have been forgotten count as ratio 0, those to come as ratio 1
        to_come = (1 - FROM_THE_START) * HORIZON / (pieces[-1].first + pieces[-1].records + HORIZON)
        weights = np.log([piece.chance for piece in pieces])
        return float(np.logaddexp.reduce([*(weights + ratio), np.log(to_come)]))


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
