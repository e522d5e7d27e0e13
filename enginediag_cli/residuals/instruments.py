"""Instruments whose single readings are wrong, judged on the model residual: stuck, or scattering more than stated.

Bias, scale and drift of an instrument are parameters, and compete with the engine's in one posterior. Two further forms
of the same fault have no size that a sum over records could show, but a law of the single readings:

**Stuck.** Identical readings over a run in which the model moves. Of an output the model moves where what is predicted
does, by more than SPAN standard deviations of noise, which no rounding hides, a few records apart. Of an input, which
is part of the model, where the other readings move as an error of this one input would make them: with the input free
in every record, found by Newton steps from what was read, EXPLAINED of the excess that moved is gone. A stuck output
has no readings, and records with a stuck input are of no use.

**Noisy.** With the differences d_k of the residuals of consecutive records, in standard deviations of theirs, and g_k
the effect of instrument i on them (a unit vector of an output, ∂Φ/∂u of an input), the readings of an instrument that
scatters by τ beyond what is stated have

    cov d_k = 1 + τ² g_k g_kᵀ     ⇒     t_k = (g_kᵀd_k)²/P_k ~ (1 + τ²P_k) χ²₁,     P_k = g_kᵀg_k

Differences do not know what lasts: faults, drifts and slow errors of the model. What is uncertain about nominal, as the
maps are, differs between operating points: the variance ΔJ C ΔJᵀ that its covariance C gives to the difference of two
records is a part of what is stated. Σt_k/n is a ratio of variances, of n/1.5 degrees of freedom (differences of
neighbours share a reading), to which `level_of_ratio` applies: as stated within KNOWN, or anything up to LARGEST.
Instruments compete by their likelihood, since the directions g overlap; the readings of one that is found are weighed
by (1 + τ²SSᵀ)^-½, S its effect on the readings, and the others are judged again. Where more than MOST_AT_ONCE would be
noisy it is the model that fails, and none is named.

`NoiseModel` is the noise of the sensors: size, correlation from record to record, and how well both are known.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.parameters import FORMS, INSTRUMENT, MOST_AT_ONCE
from enginediag_cli.recordings.repeated import StuckRun, label_runs
from enginediag_cli.units import split_column

KNOWN = 0.3
"""Standard deviation of the logarithm of the noise's variance where the model is right: the noise of another flight is
known to 15 %. On blind realistic trials the ratio lies between 0.7 and 1.6."""
LARGEST = 1e4
"""By how much the variance may be larger where something is missing: readings off by a hundred times their noise."""


@dataclass(frozen=True)
class NoiseModel:
    """Noise of m sensors: standard deviation `sigma` (m,) in the sensor's unit, lag-1 correlation `rho` (m,).

    Noise is AR(1) in time: cov(e_k, e_l) = σ² ρ^|k−l|. `covariance` (m, m), when given, replaces σ and is
    white in time (ρ = 0): sensors whose errors go together. `readings` (m,) is from how many readings, less
    those that a fit used up, σ has been estimated; inf, or not given: it is certain. `rho_error` (m,) is the
    standard error of ρ; not given, it follows from `readings`; `rho_common` (m,) is one more, that all sensors
    share. `kurtosis` (m,) is the excess kurtosis of what a reading adds to the one before it; not given, noise
    is Gaussian.
    """

    sigma: np.ndarray
    rho: np.ndarray
    covariance: np.ndarray | None = None
    readings: np.ndarray | None = None
    rho_error: np.ndarray | None = None
    rho_common: np.ndarray | None = None
    kurtosis: np.ndarray | None = None

    def __post_init__(self) -> None:
        if self.sigma.ndim != 1 or self.rho.shape != self.sigma.shape:
            raise ValueError("`sigma` and `rho` must be vectors of one length")
        if not np.all(np.isfinite(self.sigma) & (self.sigma > 0)):
            raise ValueError("`sigma` must be positive and finite")
        if not np.all((self.rho > -1) & (self.rho < 1)):
            raise ValueError("`rho` must lie in (-1, 1)")
        if self.covariance is not None and np.any(self.rho):
            raise ValueError("a full covariance between sensors is only defined for white noise (rho = 0)")

    @property
    def inflation(self) -> np.ndarray:
        """(1 + ρ)/(1 − ρ) (m,): variance of a long mean relative to that of independent records."""
        return (1 + self.rho) / (1 - self.rho)

    def _log_variance(self, rho: np.ndarray, records: int) -> np.ndarray:
        """log of the variance (m,) of a mean over so many records, σ_ε²/(1 − ρ²) · L(ρ)/records with
        L = 1 + 2 Σ_l (1 − l/records) ρ^l, as far as it depends on ρ: where σ is certain, through L alone."""
        L = (1 + rho) / (1 - rho) - 2 * rho * (1 - rho**records) / (max(records, 1) * (1 - rho) ** 2)
        certain = True if self.readings is None else ~np.isfinite(self.readings)
        return np.asarray(np.log(np.maximum(L, 1e-300)) - np.where(certain, 0.0, np.log(1 - rho**2)))

    def doubt(self, records: int) -> tuple[np.ndarray, np.ndarray] | None:
        """How wrong the estimated noise variance of a mean over so many records is: errors (q, m) of its logarithm, as
        standard deviations, one row for each independent cause; and bias (m,), what it is too large by on average, as a
        share. None where noise is certain.

        For AR(1) noise log σ_ε² and ρ are estimated independently, with variances (2 + κ)/n, κ the excess kurtosis, and
        (1 − ρ²)/n. σ_ε² has no bias, but the variance v is convex in ρ: its bias is ½ v''/v var ρ (M. G. Kenward and
        J. H. Roger, Comput. Statist. Data Anal. 53 (2009) 2583–2595, correct for it too).
        """
        if self.readings is None:
            return None
        step = 1e-4
        low, here, high = (self._log_variance(self.rho + d, records) for d in (-step, 0.0, step))
        slope, bend = (high - low) / (2 * step), (high - 2 * here + low) / step**2
        if self.rho_error is None:
            of_rho = np.where(np.isfinite(self.readings), (1 - self.rho**2) / self.readings, 0.0)
        else:
            of_rho = self.rho_error**2
        kurtosis = 0.0 if self.kurtosis is None else self.kurtosis
        errors = np.diag(np.sqrt((2 + kurtosis) / self.readings + of_rho * slope**2))
        if self.rho_common is not None and self.rho_common.any():
            errors = np.concatenate([errors, [self.rho_common * slope]])
            of_rho = of_rho + self.rho_common**2
        return errors, np.clip(0.5 * of_rho * (slope**2 + bend), 0.0, 1.0)

    @property
    def white(self) -> bool:
        return not np.any(self.rho)


@dataclass(frozen=True)
class NoiseLevel:
    """What the rest of χ² says: `factor` v ≥ 1 by which evidence is divided; log likelihoods of that rest where the
    noise is as stated and where it may be anything."""

    factor: float = 1.0
    log_stated: float = 0.0
    log_anything: float = 0.0


def level_of_ratio(ratio: float, dof: float, doubt: float = 0.0) -> NoiseLevel:
    """Of χ² per degree of freedom that is left, of so many; doubt: 2/ν of estimated noise."""
    from scipy.special import log_ndtr, ndtr

    variance = 2.0 / dof + doubt
    log, wide = float(np.log(ratio)), np.log(max(LARGEST, ratio))
    total = KNOWN**2 + variance
    s = np.sqrt(variance)
    inside = max(float(ndtr(log / s) - ndtr((log - wide) / s)), float(np.exp(log_ndtr(log / s))) / 2, 1e-300)
    return NoiseLevel(
        max(float(np.exp(log * KNOWN**2 / total)), 1.0),
        -0.5 * log**2 / total - 0.5 * float(np.log(2 * np.pi * total)),
        float(np.log(inside) - np.log(wide)),
    )


STUCK, NOISE = "stuck", "noise"
"""Forms of an instrument's fault that show in single readings."""
SPAN = 6.0
"""Standard deviations of noise, rounding included, by which what is predicted moves within a run of identical readings
of a sensor that is stuck: rounding to one step makes σ at least 0.29 of it, so that this is 1.7 steps."""
STUCK_RECORDS = 8
"""Identical readings in a row that make a run: with fewer no median is known either (`gross_errors.LEAST`)."""
MOVED = 9.0
"""Excess of χ² per record of what moves within such a run that an input must explain: three standard deviations."""
EXPLAINED = 0.9
"""Share of that excess which the free input must explain: the map errors of a far point are in the rest. Judgement."""
LEAST_READINGS = 4
"""Readings of a record from which freeing one input says something: of three, a third is explained by any direction."""
NEWTON, FARTHEST = 6, 0.35
"""Steps towards the input that the readings would have, and the largest step, as a share of the reading."""
INDEPENDENT = 1 / 1.5
"""Independent differences of neighbours, per difference: neighbouring ones are correlated by −½."""
LEAST_DIFFERENCES = 8
"""Differences from which a scatter is estimated."""
SIZES = np.exp(np.linspace(np.log(1.2), np.log(LARGEST), 40)) - 1.0
"""Extra variances along the mean direction at which the likelihood of an instrument is computed."""


@dataclass(frozen=True)
class InstrumentFault:
    """A fault of the instrument that gives `column`, of an input of the model or of an output; form: STUCK or NOISE.

    size: the value at which it is stuck, or the standard deviation that its scatter has beyond the stated noise, in the
    column's unit; times: its scatter over the stated noise, NaN of an input, of which none is stated, and where stuck.
    count: how many readings are concerned, of so many `records`; first_line, last_line: where they are in the file;
    first: number of the first of them in the window, 0 where lines do not say.
    """

    column: str
    form: str
    is_input: bool
    size: float
    probability: float = 1.0
    times: float = float("nan")
    count: int = 0
    records: int = 0
    first_line: int = 0
    last_line: int = 0
    first: int = 0

    @property
    def quantity(self) -> str:
        """What the instrument measures, "T45"."""
        return split_column(self.column)[0]

    @property
    def instrument(self) -> str:
        """The instrument as parameters call their component: "sensor.T45", "input.Wf"."""
        return f"{'input' if self.is_input else 'sensor'}.{self.quantity}"

    @property
    def name(self) -> str:
        """The fault as a parameter: "sensor.T45.stuck"."""
        return f"{self.instrument}.{self.form}"

    @property
    def throughout(self) -> bool:
        """Whether every record of the window is concerned."""
        return self.count >= self.records


def find_stuck_faults(
    runs: Iterable[StuckRun], inputs: Collection[str], lines: tuple[int, int], records: int
) -> Iterator[InstrumentFault]:
    """The runs that lie in a window, from its first to its last line, of so many records; inputs: columns of the
    model's inputs."""
    consecutive = lines[1] - lines[0] + 1 == records
    for run in runs:
        if not run.overlaps(*lines):
            continue
        first, last = max(run.first_line, lines[0]), min(run.last_line, lines[1])
        share = (last - first + 1) / (run.last_line - run.first_line + 1)
        count = max(round(share * run.records), 1)
        if count < STUCK_RECORDS <= records:  # the last reading before it stuck, and a few like it, are no fault
            continue
        yield InstrumentFault(
            run.column,
            STUCK,
            run.column in inputs,
            run.value,
            count=count,
            records=records,
            first_line=first,
            last_line=last,
            first=first - lines[0] + 1 if consecutive else 0,
        )


@dataclass(frozen=True)
class FaultInFlights:
    """A fault of an instrument in the flights of an engine: as the last of them shows it, in how many of so many
    flights, and the number, from 1, and the name of the first and of the last that show it."""

    fault: InstrumentFault
    flights: int
    flights_in_all: int
    first: int
    last: int
    first_flight: str = ""
    last_flight: str = ""


def faults_in_flights(shown: Iterable[tuple[int, str, InstrumentFault]], of: int) -> tuple[FaultInFlights, ...]:
    """The faults that flights show, (number, name, fault) in order, of so many flights: one of each form of each
    instrument, the most frequent first."""
    found: dict[str, FaultInFlights] = {}
    for number, flight, fault in shown:
        old = found.get(fault.name, FaultInFlights(fault, 0, of, number, 0, flight))
        more = old.flights + (old.last != number)
        found[fault.name] = replace(old, fault=fault, flights=more, last=number, last_flight=flight)
    return tuple(sorted(found.values(), key=lambda x: -x.flights))


def identical_runs(values: np.ndarray, least: int) -> list[tuple[int, int]]:
    """(first, stop) of runs of at least so many identical finite values (n,)."""
    return [(first, stop) for first, stop in label_runs(values) if stop - first >= least and np.isfinite(values[first])]


def find_stuck_outputs(readings: np.ndarray, level: np.ndarray) -> np.ndarray:
    """Readings (n, m) that repeat themselves while what is predicted, level (n, m) in standard deviations of noise,
    moves; readings of records that follow each other, NaN where there is none."""
    found = np.zeros(readings.shape, bool)
    for j in range(readings.shape[1]):
        rows = np.flatnonzero(np.isfinite(readings[:, j]))
        for first, stop in identical_runs(readings[rows, j], STUCK_RECORDS):
            run = rows[first:stop]
            # half of what moves evenly; a few records with a wrong input move nothing but themselves
            if np.subtract(*np.percentile(level[run, j], (75, 25))) > SPAN / 2:
                found[run, j] = True
    return found


Free = Callable[[str, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""free(column, rows (k,), values (k,)) -> residuals (k, m) over σ with the input at these values, and their derivative
(k, m) with respect to it."""


def find_stuck_inputs(z: np.ndarray, inputs: Mapping[str, np.ndarray], free: Free) -> dict[str, np.ndarray]:
    """Of inputs, column -> (n,), the records (n,) in which they stand still although the residuals z (n, m), over σ,
    move as an error of theirs would make them."""
    found: dict[str, np.ndarray] = {}
    taken = np.zeros(len(z), bool)
    candidates = []
    for column, values in inputs.items():
        for first, stop in identical_runs(values, STUCK_RECORDS):
            rows = np.arange(first, stop)[np.isfinite(z[first:stop]).sum(axis=1) >= LEAST_READINGS]
            n = len(rows)
            if n < STUCK_RECORDS:
                continue
            moved, count = _moving_chi2(z[rows])
            if moved - count > MOVED * n and _typical_moving_chi2(z[rows]) > MOVED:
                left = _chi2_with_free_input(column, rows, values[rows], free)
                explained = moved - left - n
                if explained > max(EXPLAINED * (moved - count), MOVED * n):
                    candidates.append((left / count, column, first, stop))
    for _, column, first, stop in sorted(candidates):
        if not taken[first:stop].any():
            taken[first:stop] = True
            found.setdefault(column, np.zeros(len(z), bool))[first:stop] = True
    return found


def _moving_chi2(z: np.ndarray) -> tuple[float, float]:
    """Sum of squares of z (k, m) about the mean of each sensor, and its degrees of freedom."""
    present = np.isfinite(z)
    about = np.where(present, z - np.nanmean(np.where(present.any(axis=0), z, 0.0), axis=0), 0.0)
    return float(np.sum(about**2)), float(present.sum() - present.any(axis=0).sum())


def _typical_moving_chi2(z: np.ndarray) -> float:
    """Excess of χ² of z (k, m) about the median of each sensor that a quarter of the records reach: a few records with
    another wrong input move nothing but themselves."""
    present = np.isfinite(z)
    about = np.where(present, z - np.nanmedian(np.where(present.any(axis=0), z, 0.0), axis=0), 0.0)
    return float(np.percentile(np.sum(about**2, axis=1) - present.sum(axis=1), 75))


def _chi2_with_free_input(column: str, rows: np.ndarray, read: np.ndarray, free: Free) -> float:
    """The rest of the moving residual, a sum of squares, with the input in each of the rows as the readings have
    it."""
    values, best = read.astype(float).copy(), np.inf
    for _ in range(NEWTON):
        z, slope = free(column, rows, values)
        known = np.isfinite(z) & np.isfinite(slope)
        z, slope = np.where(known, z, np.nan), np.where(known, slope, 0.0)
        # one input cannot mend what all of the run has in common: a fault of the engine is no part of the question
        best = min(best, _moving_chi2(z)[0])
        power = np.sum(slope**2, axis=1)
        step = -np.sum(slope * np.nan_to_num(z), axis=1) / np.where(power > 0, power, np.inf)
        largest = FARTHEST * np.maximum(np.abs(read), np.abs(values))
        values = values + np.clip(step, -largest, largest)
    return best


@dataclass(frozen=True)
class ScatterEstimate:
    """The instrument number `of` scatters by a standard deviation `size` beyond what is stated, in its column's unit,
    with this probability against all others and none."""

    instrument: int
    size: float
    probability: float


Effects = Callable[[], np.ndarray]


def find_scatter(
    e: np.ndarray, level: np.ndarray, noise: NoiseModel, lags: np.ndarray, effects: Effects, nominal: Effects
) -> list[ScatterEstimate]:
    """Instruments that scatter, the clearest first: e (n, m) residuals at the estimate of consecutive records and level
    (n, m) what is predicted, in the sensors' units; lags (n,) in steps. effects() -> (n, m, q): what a unit of each
    instrument does to the readings; nominal() -> (n − 1, m): variance of the differences of neighbours by what is
    uncertain about nominal, in the sensors' units squared; both are computed only where some may scatter."""
    sd = noise.sigma * np.sqrt(2 * (1 - noise.rho ** np.maximum(lags[1:, None], 1.0)))
    own = np.diff(_remove_own_line(e, level), axis=0)
    if len(own) < LEAST_DIFFERENCES or not _might_scatter(own / sd):
        return []
    sd = np.sqrt(sd**2 + nominal())
    d = own / sd
    present = np.isfinite(d)
    if not _might_scatter(d):
        return []
    S = np.where(present[:, :, None], effects()[1:], 0.0) * (np.sqrt(2) / sd)[:, :, None]
    S = np.nan_to_num(S)
    d = np.where(present, d, 0.0)
    found: list[ScatterEstimate] = []
    while len(found) <= MOST_AT_ONCE:
        one = _strongest_scatter(d, S)
        if one is None:
            return found
        found.append(one)
        inverse = _scatter_weight(S[:, :, one.instrument], one.size)
        d = np.einsum("kij,kj->ki", inverse, d)
        S = inverse @ S
    return []


def _remove_own_line(e: np.ndarray, level: np.ndarray) -> np.ndarray:
    """e (n, m) without the bias and the scale error of each sensor that fit it best: forms that are no scatter."""
    found = e.copy()
    for j in range(e.shape[1]):
        rows = np.isfinite(e[:, j])
        x = level[rows, j]
        if rows.sum() < LEAST_DIFFERENCES or not np.ptp(x) > 0:
            continue
        x = (x - x.mean()) / x.std()
        y = e[rows, j]
        found[rows, j] = y - y.mean() - x * float(x @ y) / len(y)
    return found


def _might_scatter(d: np.ndarray) -> bool:
    """Whether the ratios of variances could make any instrument's scatter likelier than none: a bound, which costs
    nothing."""
    present = np.isfinite(d)
    count = present.sum(axis=0)
    ratio = np.sum(np.where(present, d, 0.0) ** 2, axis=0) / np.maximum(count, 1)
    largest = 1.0 + float(np.sum(np.maximum(ratio[count > 0] - 1.0, 0.0)))
    total = KNOWN**2 + 2.0 / (INDEPENDENT * len(d))
    stated = -0.5 * np.log(largest) ** 2 / total - 0.5 * np.log(2 * np.pi * total)
    return bool(-np.log(np.log(LARGEST)) - stated + np.log(INSTRUMENT / FORMS) > 0.0)


def _strongest_scatter(d: np.ndarray, S: np.ndarray) -> ScatterEstimate | None:
    """The instrument whose scatter explains the differences d (n, m) best, S (n, m, q) its effect on them; None where
    none is likelier than not."""
    power = np.sum(S**2, axis=1)
    along = np.einsum("kjq,kj->kq", S, d) ** 2
    best: list[tuple[float, float, float]] = []
    for i in range(S.shape[2]):
        rows = power[:, i] > 0
        P, q = power[rows, i], along[rows, i]
        n = int(rows.sum())
        if n < LEAST_DIFFERENCES:
            best.append((-np.inf, 0.0, 0.0))
            continue
        ratio = float(np.mean(q / P))
        log, size = _likeliest_variance(P, q)
        law = level_of_ratio(max(ratio, 1e-9), INDEPENDENT * n)
        odds = np.exp(min(law.log_anything - law.log_stated, 700.0)) * INSTRUMENT / FORMS if ratio > 1.0 else 0.0
        best.append((log, size, float(odds / (1 + odds))))
    logs = np.array([log for log, _, _ in best])
    i = int(np.argmax(logs))
    share = np.exp(logs - logs[i])
    probability = best[i][2] / float(share.sum())
    return ScatterEstimate(i, best[i][1], probability) if probability > 0.5 else None


def _likeliest_variance(P: np.ndarray, q: np.ndarray) -> tuple[float, float]:
    """Largest log likelihood of an added variance τ² along directions of power P (n,), where q (n,) was seen, against
    none; and τ."""
    unit = 1.0 / float(np.mean(P))
    sizes = SIZES * unit
    for _ in range(2):
        v = 1.0 + sizes[:, None] * P
        log = 0.5 * INDEPENDENT * np.sum(-np.log(v) + sizes[:, None] * q / v, axis=1)
        k = int(np.argmax(log))
        low, high = sizes[max(k - 1, 0)], sizes[min(k + 1, len(sizes) - 1)]
        found = float(log[k]), float(np.sqrt(sizes[k]))
        sizes = np.exp(np.linspace(np.log(low), np.log(high), len(SIZES)))
    return found


def _scatter_weight(S: np.ndarray, size: float) -> np.ndarray:
    """(1 + τ²SSᵀ)^-½ (n, m, m) of S (n, m)."""
    P = np.sum(S**2, axis=1)
    share = np.where(P > 0, (1 - 1 / np.sqrt(1 + size**2 * P)) / np.where(P > 0, P, 1.0), 0.0)
    return np.asarray(np.eye(S.shape[1]) - share[:, None, None] * S[:, :, None] * S[:, None, :])


def scatter_weights(
    present: np.ndarray, noise: NoiseModel, effects: np.ndarray, found: Sequence[ScatterEstimate]
) -> np.ndarray:
    """What multiplies the readings of each record, and all that is predicted of them, so that they scatter as stated:
    (n, m, m) of n records in which readings are present (n, m); effects (n, m, q) as in `scattering`."""
    unit = noise.sigma * np.sqrt(noise.inflation)
    S = np.where(present[:, :, None], np.nan_to_num(effects), 0.0) / unit[:, None]
    whole = np.tile(np.eye(len(unit)), (len(present), 1, 1))
    for one in found:
        step = _scatter_weight(S[:, :, one.instrument], one.size)
        whole, S = step @ whole, step @ S
    return np.asarray(unit[:, None] * whole / unit)


def apply_weights(weight: np.ndarray | None, y: np.ndarray) -> np.ndarray:
    """y (n, m) or (n, m, p) multiplied by the weights (n, m, m); NaN stays NaN and touches no other reading."""
    if weight is None:
        return y
    if y.ndim == 3:
        return np.asarray(weight @ y)
    return np.where(np.isfinite(y), np.einsum("kij,kj->ki", weight, np.nan_to_num(y)), np.nan)
