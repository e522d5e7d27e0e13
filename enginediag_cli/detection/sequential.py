"""Sequential tests by e-values: over records of a flight, flights of an engine, and engines of a fleet.

Records of a flight. The false-alarm probability holds for the whole flight.

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

Flights of an engine. Level, scatter and the correlation of scatter in time are unknown.

Rows z_i (m,) of n flights, readings minus prediction, are by the null hypothesis

    z_i = Bᵀ x_i + ε_i

with x_i a level and functions of the conditions flown. A change along d (m,) is the regression of what sees it on all
that does not, whose residual is known up to its size σ and its law in time K, cov(i, j) = K_ij σ²: each flight by
itself, or wandering, of each direction by itself, since instruments do not wander alike. Level, errors that come with
the operating point (coefficients N(0, λ σ²)), offsets that change from flight to flight, how large they are, how they
go together and how long they last are nuisance of both hypotheses. With L Lᵀ = K + X λ Xᵀ the rows of V = L⁻¹ Z are
independent given σ, and L⁻¹ is causal. With h = L⁻¹ g for a course g (n,) of a change, and sums over the first n
flights

    A = Σ v vᵀ,   c = Σ h v,   γ = Σ h²,   a = dᵀA⁻¹d,   b = cᵀA⁻¹d,   γ_d = γ − cᵀA⁻¹c + b²/a

the residual has the sum of squares 1/a, and up to what all laws have in common its invariants, which know neither σ nor
the regression, have the density, and of a change δ ~ N(0, κ σ²) along g the ratio of densities,

    p_K = |L|⁻¹ (|A| a)^−½ a^(n − m)/2
    L_K = (1 + κ γ_d)^−½ [1 − κ b²/(a (1 + κ γ_d))]^−(n − m)/2

(right Haar prior of σ: J. O. Berger, L. R. Pericchi, J. A. Varshavsky, Sankhyā A 60 (1998) 307–321). L_K has mean 1
exactly under law K, for every B and Σ (M. F. Pérez-Ortiz, T. Lardy, R. de Heide, P. D. Grünwald, Ann. Statist. 52
(2024) 1410–1432). Which law it is nobody knows:

    E_d = Σ_K w_K p_K L_K / max_K p_K

The law that suits the flights best without a change stands below, not a mean over laws, so that E_d has mean 1 at most
under every one of them, whichever is true (universal inference: L. Wasserman, A. Ramdas, S. Balakrishnan, PNAS 117
(2020) 16880–16890); a mean below has it only over engines of which so many wander as its weights say. A change in any
direction, N(0, κ Σ), is the product of such ratios of each reading regressed on those before it. E is the mean over
directions, sizes, courses and onsets, all weighed beforehand.

Engines of a fleet. The e-BH procedure says which engines are flagged.

With e-values e_1 … e_n, each of mean 1 at most for an engine that is healthy, and e_(1) ≥ e_(2) ≥ …, those listed are
the k* largest, k* the largest k with

    e_(k) ≥ n/(k α)

Then the share of healthy engines among those listed is α at most, on the average over fleets, whatever the e-values
have to do with each other, and whenever one looks: R. Wang, A. Ramdas, JRSS B 84 (2022) 822–852, theorem 2.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

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


SIZES = (0.04, 0.4, 4.0, 40.0)
"""Variances κ of a change along one direction, in units of the scatter of one flight: from a fifth to six times."""
ANY = (0.04, 0.4)
"""The same of a change in any direction, which is the sum of as many as there are readings."""
RAMP = 30.0
"""Flights in which a growing change reaches its size: a unit, sizes span a hundredfold."""
SINGLE = 2 / 3
"""Weight of changes of one suspect alone; the rest is for those in any direction."""
FROM_FIRST_FLIGHT = 0.1
"""Weight of a change that was there with the first flight after the baseline."""
FINE_STEPS, FINE_RAMPS = 12, 4
"""Onsets lie one flight apart to begin with, and as far apart as a twelfth (a fourth) of the flights since later."""
ONSETS, UNLIKELY = 200, 1e-3
"""Onsets that are evaluated together for the posterior of the onset, each a column over all flights: 60 MB of 20,000;
and the probability below which one of them is excluded."""
SCATTER_LAWS = ((0.0, 1.0, 0.5), (0.2, 20.0, 0.25), (0.5, 20.0, 0.25))
"""Laws in time of what readings scatter by: share that wanders, flights over which it does, weight. An engine whose
instruments wander by more than the last of them is called changed more often than is said; the more laws there are the
more of the logarithm of E faults pay. The remaining loss: `tests/benchmarks/fleet_discoveries.py --wander 1.5`."""
LEVEL, CONDITIONS = 1e6, 1.0
"""Variance of a level, of which nothing is known, and of what a standardised condition adds, in units of the scatter:
errors of the model at an operating point are about as large as that."""
PEAKS = 25
"""Flights at which E is computed; at the others it stays as it was, which is a rule for stopping as any."""
AT_A_TIME = 512
"""Flights whose running sums are in memory at once: a few megabytes."""
ONE_FLIGHT = 1e-3
"""Chance of a flight, were it as the others, beyond which it counts for no more: one flight alone is no verdict."""


@dataclass(frozen=True)
class SuspectDirections:
    """Directions (d, m) of unit changes in the m readings, and their prior weights (d,), which sum to 1."""

    directions: np.ndarray
    weights: np.ndarray


@dataclass(frozen=True)
class FlightReadings:
    """The flights of one engine.

    Attributes
    ----------
    z : ndarray of shape (n, m)
        Readings minus prediction, in units of their noise.
    conditions : ndarray of shape (n, c)
        Functions of the conditions flown, standardised.
    weight : ndarray of shape (n,)
        Square root of the information of each flight relative to a usual one.
    """

    z: np.ndarray
    conditions: np.ndarray
    weight: np.ndarray


@dataclass(frozen=True)
class EPath:
    """E-values of one engine: log_e (n,), natural logarithm of E after each flight.

    Given a change: onset (n,), probability that it began with each flight; growing: that it grows; suspect (d,): that
    it is along each direction, the rest along none of them.
    """

    log_e: np.ndarray
    onset: np.ndarray
    growing: float
    suspect: np.ndarray


@dataclass(frozen=True)
class _Courses:
    g: np.ndarray
    onset: np.ndarray
    ramp: np.ndarray
    log_weight: np.ndarray


def _ladder(n: int, fine: int) -> np.ndarray:
    """Onsets 0 … n − 1, ever farther apart."""
    found, j = [], 0
    while j < n:
        found.append(j)
        j += 1 + j // fine
    return np.array(found, int)


def _courses(n: int, baseline: int, onsets: np.ndarray | None = None, stop: int | None = None) -> _Courses:
    """Steps and ramps that begin with these flights after the baseline, counted from 0, the last of which stands for
    those before `stop`; default: ladders of onsets up to the last flight."""
    i, later = np.arange(n) - baseline, max(n - baseline, 0)
    stop = later if stop is None else stop
    parts = []
    for fine, ramp in ((FINE_STEPS, False), (FINE_RAMPS, True)):
        at = _ladder(later, fine) if onsets is None else onsets
        after = i - at[:, None]
        g = np.clip(after + 1.0, 0.0, None) / RAMP if ramp else (after >= 0).astype(float)
        # each onset has the weight of those up to the next one
        edges = np.append(at, stop)
        total = np.concatenate([[0.0], np.cumsum(onset_weight(np.arange(stop), FROM_FIRST_FLIGHT))])
        parts.append((g, at + baseline, np.full(len(at), ramp), 0.5 * np.diff(total[edges])))
    g, onset, ramp_, weight = (np.concatenate(x) for x in zip(*parts, strict=True))
    return _Courses(g, onset, ramp_, np.log(np.maximum(weight, 1e-300)))


def e_path(rows: FlightReadings, suspects: SuspectDirections, baseline: int, looks: int = PEAKS) -> EPath:
    """Compute the e-values of one engine, of which nothing began in its first `baseline` flights.

    Parameters
    ----------
    rows : FlightReadings
        n flights of m readings.
    suspects : SuspectDirections
        Directions of change.
    baseline : int
        First flights, believed healthy.
    looks : int
        Number of flights at which E is computed, the last among them.

    Returns
    -------
    EPath
        E is 1 until there are two flights more than readings.

    Raises
    ------
    ValueError
        For readings that are not finite.
    """
    if not np.all(np.isfinite(rows.z)):
        raise ValueError("readings must be finite")
    n, m = rows.z.shape
    path, onset, suspect = np.zeros(n), np.zeros(n), np.zeros(len(suspects.weights))
    first = max(baseline, m + 1)
    if first >= n:
        return EPath(path, onset, 0.0, suspect)
    among, peaks = _courses(n, baseline), np.unique(np.linspace(n - 1, first, looks).round().astype(int))
    ratios = _Ratios.from_readings(rows, suspects, among, peaks, clipped=True)
    by_course = ratios.course_evidence(among, suspects)  # (peaks, courses)
    rest = np.log(max(-np.expm1(min(np.logaddexp.reduce(among.log_weight), 0.0)), 1e-300))
    log_e = np.logaddexp(np.logaddexp.reduce(by_course, axis=1), rest)
    at = np.searchsorted(peaks, np.arange(first, n), side="right") - 1
    path[first:] = np.where(at >= 0, log_e[at], 0.0)
    total = np.logaddexp.reduce(by_course[-1])
    last = np.exp(by_course[-1] - total)
    np.add.at(onset, among.onset, last)
    suspect = np.exp(ratios.suspect_evidence(among, suspects) - total)
    return EPath(path, onset, float(last[among.ramp].sum()), suspect)


def onset_posterior(rows: FlightReadings, suspects: SuspectDirections, baseline: int) -> np.ndarray:
    """Posterior probability (n,) of the onset at each of n flights, given a change; arguments as of `e_path`.

    `ONSETS` onsets are evaluated, evenly spread, then as many among those around the likely ones, as long as these are
    the fewer half. Flights between two that were evaluated share the probability of the first.
    """
    n, m = rows.z.shape
    found = np.zeros(n)
    if n <= max(baseline, m + 1):
        return found
    first, stop = 0, n - baseline
    while True:
        at = np.arange(first, stop, -(-(stop - first) // ONSETS))
        among = _courses(n, baseline, at, stop)
        log = _Ratios.from_readings(rows, suspects, among, np.array([n - 1]), clipped=False).course_evidence(
            among, suspects
        )[0]
        chance = np.exp(log - np.logaddexp.reduce(log)).reshape(2, -1).sum(axis=0)
        edges = np.append(at, stop)
        likely = np.flatnonzero(chance > UNLIKELY)
        low, high = int(edges[max(likely[0] - 1, 0)]), int(edges[min(likely[-1] + 2, len(at))])
        width = np.diff(edges)
        if width[0] == 1 or 2 * (high - low) > stop - first:
            found[baseline + first : baseline + stop] = np.repeat(chance / width, width)
            return found
        first, stop = low, high


@dataclass(frozen=True)
class _Ratios:
    """log E of each course after the flights `peaks`, 0 of one that has not begun: along each direction (G, k, d), and
    in any (G, k)."""

    by_direction: np.ndarray
    anywhere: np.ndarray

    @staticmethod
    def from_readings(
        rows: FlightReadings, suspects: SuspectDirections, among: _Courses, peaks: np.ndarray, clipped: bool
    ) -> _Ratios:
        g, k = np.nonzero(among.onset[:, None] <= peaks)
        along, by_reading = _BestLaw(), _BestLaw()
        for share, length, chance in SCATTER_LAWS:
            sums = _LawSums.from_whitened(_whiten(rows, among, share, length), peaks, clipped)
            told, gamma = sums.project_courses(g, k), sums.gamma[g, k]
            along.add(*sums.direction_ratios(suspects.directions, told, gamma, k), k, chance)
            by_reading.add(*sums.reading_ratios(told, gamma, k), k, chance)
        found = np.zeros((len(among.g), len(peaks), len(suspects.weights)))
        anywhere = np.zeros(found.shape[:2])
        found[g, k] = along.log(k)
        anywhere[g, k] = np.logaddexp.reduce(by_reading.log(k).sum(axis=2), axis=0) - np.log(len(ANY))
        return _Ratios(found, anywhere)

    def course_evidence(self, among: _Courses, suspects: SuspectDirections) -> np.ndarray:
        """(k, G), with the weight of each course."""
        most = self.by_direction.max(axis=2)
        one = np.log(np.exp(self.by_direction - most[:, :, None]) @ suspects.weights) + most + np.log(SINGLE)
        return np.asarray(np.logaddexp(one, self.anywhere + np.log1p(-SINGLE)).T + among.log_weight)

    def suspect_evidence(self, among: _Courses, suspects: SuspectDirections) -> np.ndarray:
        """(d,): along each direction, with its weight, at the last of the peaks."""
        with np.errstate(divide="ignore"):
            weight = np.log(SINGLE * suspects.weights)
        return np.asarray(np.logaddexp.reduce(self.by_direction[:, -1] + among.log_weight[:, None], axis=0) + weight)


class _BestLaw:
    """A ratio of densities, changed over not: a mean over laws above, the best of them below."""

    def __init__(self) -> None:
        self.changed: np.ndarray | float = -np.inf
        self.same: np.ndarray | float = -np.inf

    def add(self, same: np.ndarray, ratio: np.ndarray, k: np.ndarray, chance: float) -> None:
        """A law: log p (peaks, q) without a change, and log L (…, K, q), each at the peak k (K,)."""
        self.same = np.maximum(self.same, same)
        self.changed = np.logaddexp(self.changed, ratio + same[k] + np.log(chance))

    def log(self, k: np.ndarray) -> np.ndarray:
        return np.asarray(self.changed - np.asarray(self.same)[k])


@dataclass(frozen=True)
class _Whitened:
    """v (n, m) and h (G, n): readings and courses, of which each flight is new; log_scale (n,) = ln L_ii."""

    v: np.ndarray
    h: np.ndarray
    log_scale: np.ndarray


def _whiten(rows: FlightReadings, among: _Courses, share: float, length: float) -> _Whitened:
    """Rows of L⁻¹ W [Z, g], in two steps that are linear in n. A wander of one step's correlation φ beside flights each
    by itself is, once differenced by D (1 and −φ), correlated with its neighbour alone:

        K = D⁻¹ T D⁻ᵀ,    T tridiagonal = L_T L_Tᵀ,    u = L_T⁻¹ D [X, Z, g]

    so that level and conditions leave I + B Bᵀ with B = u_X λ^½, whose factor is that of least squares as they go on,

        S_i = I + Σ_{j<i} b_j b_jᵀ,    L_ii² = 1 + b_iᵀ S_i⁻¹ b_i,    v_i = (u_i − b_iᵀ S_i⁻¹ Σ_{j<i} b_j u_j) / L_ii
    """
    from scipy.linalg import cholesky_banded, solve_banded

    n, m = rows.z.shape
    phi = np.exp(-1.0 / length)
    alone = 1 - share
    bands = np.empty((2, n))
    bands[0] = alone * (1 + phi**2) + share * (1 - phi**2)
    bands[0, 0] = 1.0
    bands[1] = -phi * alone
    T = cholesky_banded(bands, lower=True, check_finite=False)
    spread = np.sqrt([LEVEL, *np.full(rows.conditions.shape[1], CONDITIONS)])
    columns = np.concatenate([np.ones((n, 1)), rows.conditions, rows.z, among.g.T], axis=1)
    columns[1:] -= phi * columns[:-1]
    u = solve_banded((1, 0), T, columns, overwrite_b=True, check_finite=False)
    B, u = u[:, : len(spread)] * spread, u[:, len(spread) :]
    S, known = np.eye(len(spread)), np.zeros((len(spread), u.shape[1]))
    log_scale = np.log(T[0]) + np.log(rows.weight)
    for first in range(0, n, AT_A_TIME):
        part = slice(first, first + AT_A_TIME)
        b, y = B[part], u[part]
        squares = S + np.cumsum(b[:, :, None] * b[:, None, :], axis=0)
        sums = known + np.cumsum(b[:, :, None] * y[:, None, :], axis=0)
        before = np.concatenate([S[None], squares[:-1]])
        gain = np.linalg.solve(before, b[:, :, None])[:, :, 0]
        size = np.sqrt(1 + np.sum(gain * b, axis=1))
        y -= np.einsum("nq,nqk->nk", gain, np.concatenate([known[None], sums[:-1]]))
        y /= size[:, None]
        log_scale[part] += np.log(size)
        S, known = squares[-1], sums[-1]
    return _Whitened(u[:, :m], u[:, m:].T, log_scale)


def _clip_outliers(v: np.ndarray) -> np.ndarray:
    """Flights that are off by more than others, by a chance below ONE_FLIGHT, drawn in to that."""
    from scipy.special import fdtri

    n, m = v.shape
    at = np.arange(m + 1, n)
    freedom = at - m
    inverse = np.linalg.inv(np.cumsum(v[:, :, None] * v[:, None, :], axis=0)[at - 1])
    square = np.einsum("nm,nmk,nk->n", v[at], inverse, v[at]) * freedom / m
    drawn = v.copy()
    drawn[at] *= np.minimum(1.0, np.sqrt(fdtri(m, freedom, 1 - ONE_FLIGHT) / np.maximum(square, 1e-300)))[:, None]
    return drawn


@dataclass(frozen=True)
class _LawSums:
    """Of one law, after the flights `peaks`: root (k, m, m) R⁻¹ with A = R Rᵀ, ln R_ii (k, m), c (G, k, m), γ (G, k),
    Σ ln L_ii (k,), number of flights (k,)."""

    root: np.ndarray
    log_root: np.ndarray
    c: np.ndarray
    gamma: np.ndarray
    log_scale: np.ndarray
    flights: np.ndarray

    @staticmethod
    def from_whitened(w: _Whitened, peaks: np.ndarray, clipped: bool) -> _LawSums:
        v = _clip_outliers(w.v) if clipped else w.v
        edges = [0, *(peaks + 1).tolist()]
        spans = [slice(a, b) for a, b in pairwise(edges)]
        A = np.cumsum([v[s].T @ v[s] for s in spans], axis=0)
        c = np.cumsum(np.stack([w.h[:, s] @ v[s] for s in spans], axis=1), axis=1)
        gamma = np.cumsum(np.stack([np.sum(w.h[:, s] ** 2, axis=1) for s in spans], axis=1), axis=1)
        R = np.linalg.cholesky(A)
        log_root = np.log(np.diagonal(R, axis1=1, axis2=2))
        return _LawSums(np.linalg.inv(R), log_root, c, gamma, np.cumsum(w.log_scale)[peaks], peaks + 1.0)

    def project_courses(self, g: np.ndarray, k: np.ndarray) -> np.ndarray:
        """R⁻¹ c (K, m) of the courses g at the peaks k (K,)."""
        return np.asarray(np.matmul(self.root[k], self.c[g, k][:, :, None])[:, :, 0])

    def direction_ratios(
        self, directions: np.ndarray, told: np.ndarray, gamma: np.ndarray, k: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """log p (peaks, d), and log L (K, d), its mean over sizes, of known courses (K, m) with γ (K,) at peaks k."""
        m = directions.shape[1]
        seen = self.root @ directions.T  # (peaks, m, d)
        a = np.sum(seen**2, axis=1)
        free = 0.5 * (self.flights - m)
        same = (-self.log_scale - self.log_root.sum(axis=1))[:, None] + (free - 0.5)[:, None] * np.log(a)
        explained = np.matmul(told[:, None, :], seen[k])[:, 0] ** 2 / a[k]
        left = (gamma - np.sum(told**2, axis=1))[:, None] + explained
        logs = _log_ratios(explained, left, free[k][:, None], SIZES)
        most = logs.max(axis=0)
        return same, np.log(np.exp(logs - most).mean(axis=0)) + most

    def reading_ratios(self, told: np.ndarray, gamma: np.ndarray, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same of each reading regressed on those before it: (peaks, m), and of each size (ANY, K, m)."""
        free = 0.5 * (self.flights[:, None] - np.arange(1, self.log_root.shape[1] + 1))
        before = np.cumsum(self.log_root, axis=1) - self.log_root
        same = -self.log_scale[:, None] - before - 2 * free * self.log_root
        square = told**2
        left = gamma[:, None] - np.cumsum(square, axis=1) + square
        return same, _log_ratios(square, left, free[k], ANY)


def _log_ratios(explained: np.ndarray, left: np.ndarray, free: np.ndarray, sizes: tuple[float, ...]) -> np.ndarray:
    """log L (sizes, …): −½ ln(1 + κ left) − free ln(1 − κ explained/(1 + κ left))."""
    logs = np.empty((len(sizes), *left.shape))
    for log, kappa in zip(logs, sizes, strict=True):
        wide = 1 + kappa * np.maximum(left, 1e-300)
        np.log1p(-kappa * explained / wide, out=log)
        log *= -free
        log -= 0.5 * np.log(wide)
    return logs


def flag_engines(log_e: np.ndarray, level: float) -> np.ndarray:
    """Flag engines at a false discovery rate, by the e-BH procedure.

    Parameters
    ----------
    log_e : ndarray of shape (n,)
        Natural logarithm of the e-value of each engine; one without (NaN) counts, and is not flagged.
    level : float
        False discovery rate.

    Returns
    -------
    ndarray of bool, shape (n,)

    Raises
    ------
    ValueError
        For a level that is no probability.

    References
    ----------
    R. Wang, A. Ramdas, JRSS B 84 (2022) 822–852, theorem 2.
    """
    if not 0 < level < 1:
        raise ValueError("`level` must lie between 0 and 1")
    log_e = np.nan_to_num(np.asarray(log_e, float), nan=-np.inf, posinf=np.inf, neginf=-np.inf)
    n = len(log_e)
    order = np.sort(log_e)[::-1]
    enough = np.flatnonzero(order >= np.log(n / (level * np.arange(1, n + 1))))
    if not enough.size:
        return np.zeros(n, bool)
    return np.asarray(log_e >= order[enough[-1]])
