"""Gross errors: readings that neither the model nor their neighbours in time allow, judged on the model residual.

A reading is judged by z = e/σ, its residual at nominal in standard deviations of its noise:

- what the engine may be worth of is fitted robustly (Tukey's score: A. E. Beaton and J. W. Tukey, Technometrics 16
  (1974) 147-185; each record against the fit of the others: F. R. Hampel et al., Robust Statistics, 1986, ch. 6):
  changes of health within their prior, what is uncertain about nominal, and of each sensor a bias and a scale, so that
  a true fault of a sensor is no gross error; r = z − fit;
- local: a = r − running median of 31 of r, so that what lasts, a step or a misfit of the model, is no gross error;
- against noise that is correlated in time, r is predicted from the nearest good neighbours on both sides, g_l and g_r
  steps away: with α = ρ^g_l and β = ρ^g_r

      r̂ = [α(1 − β²) r_l + β(1 − α²) r_r]/(1 − α²β²),   v² = (1 − α²)(1 − β²)/(1 − α²β²),   u = (r/S − r̂/S)/v.

A reading is a gross error iff both |u| and |a|/(S_a v) exceed 4.5. It becomes a missing reading, so that s, F, V and
the degrees of freedom agree; of Gaussian readings 7 in a million are lost, which changes variances by less than 2·10⁻⁴.
A record whose residuals point along the effect of an error of one input is of no use: the input is to blame.

What lasts longer than `RUN` records, or several records and more than `RUN_S` seconds, is the engine's or a sensor's
own and stays for the tests; so does a sensor more than half of whose readings would go.

Recordings that are judged (`residuals/gross_gate.py`) and those from which an engine is identified (`passes.py`) are
searched alike.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from enginediag_cli.probability import chdtri
from enginediag_cli.recordings.repeated import label_runs

GROSS = 4.5
"""Standard deviations beyond which a reading is a gross error: 7 in a million Gaussian readings are, and the variance
of those that remain is 0.99985, so that no test needs a correction."""
AROUND = 31
"""Readings of the running median: as many as let two bursts of seven in a row, one after the other, be the minority."""
RUN, RUN_S = 7, 600.0
"""Records, and seconds, that a gross error lasts at most, a single record excepted: two such are the minority of
`AROUND`; ten minutes are longer than any disturbance of a channel that recovers by itself, and a fault may well begin
in that time."""
EVENT = 3
"""Records in a row in which several sensors depart together from which it may be an event of the engine."""
LEAST = 8
"""Readings from which a scatter is estimated, and records from which a flight is judged by itself; shorter flights of
an engine are judged together, each against those around it."""
FEWEST = 5
"""Readings of a sensor without which none is called gross: of four, two may be wrong."""
ALMOST = 0.9
"""Share of `GROSS` from which the fit is made at all."""
START = 4.0
"""Standard deviations around the running median within which a reading counts in the first fit."""
TUKEY, STEPS = 5.0, 7
"""Tuning constant of 95 % efficiency or so, and steps."""
BIAS_SIGMAS, SCALE = 30.0, 0.03
"""Prior standard deviations of a sensor's own bias, in its noise, and scale: wider than any fault that monitors expect,
narrow enough that a few readings at one operating point do not have two free numbers each."""
SETTLED = 0.01
"""Change of the fit, in standard deviations of a reading, below which a further step changes no decision."""
PASSES = 5
"""Times that rejected readings are judged anew with the neighbours that remain: a run is peeled from both ends."""
CORRELATED = 0.05
"""Correlation above which a wrong neighbour moves a prediction, so that only the worst of several goes at a time."""
INPUT_CHANCE = 1e-3
"""Chance that a record's residuals are so large for no reason, beyond which an input is suspected."""
INPUT_GROSS, INPUT_BETTER = 25.0, (1.05, 2.0)
"""χ² of one input's error that a record is dropped for (5²), and by how much it must explain more than one wrong
reading does: a factor and, for what noise adds, a constant."""
MOST = 0.5
"""Share of a sensor's readings, or of a record's, beyond which they are not single gross errors."""
IMPOSSIBLE = 0.5
"""Share of what is predicted that no fault of an engine moves a reading by: such a reading was not measured there."""
DEAD_SIGMAS = 30.0
"""And it is beyond what is fitted as a sensor's own bias."""
UNRELATED = 1e9
"""Steps between records of which nobody knows how far they are apart: no noise is correlated for so long."""
BLOCK, HALO = 2000, 200
"""Records that are judged together, and of their neighbours on either side as context: a running median and the nearest
good neighbours reach 7 and some records; short flights want a few dozen around them."""
UNKNOWN = -2
"""In the place of the input to blame where most readings of a record are wrong and no one input explains it."""


@dataclass(frozen=True)
class ResidualStretch:
    """Consecutive records of one engine: z (N, m), NaN where there is no reading; G (N, m, p), J/σ; level (N, m), what
    is predicted over σ; lags (N,) in steps since the record before, inf where unrelated; time (N,) in s, NaN where
    unknown; precision (p, p) of the prior of the parameters; rho (m,): lag-1
    correlation of the sensors' noise.

    input_effects(rows (n,)) -> (n, m, q): what an error of each input does, over σ.
    """

    z: np.ndarray
    G: np.ndarray
    level: np.ndarray
    lags: np.ndarray
    time: np.ndarray
    precision: np.ndarray
    rho: np.ndarray
    input_effects: Callable[[np.ndarray], np.ndarray]

    @cached_property
    def present(self) -> np.ndarray:
        """Which readings there are (N, m)."""
        return np.isfinite(self.z)

    @property
    def inflation(self) -> np.ndarray:
        """(1 + ρ)/(1 − ρ) (m,): readings per independent one."""
        return (1 + self.rho) / (1 - self.rho)

    @cached_property
    def clock(self) -> np.ndarray:
        """Steps (N,) since the first record; unrelated records are far apart."""
        return np.cumsum(np.where(np.isfinite(self.lags), self.lags, UNRELATED))


@dataclass(frozen=True)
class GrossErrors:
    """Of a stretch: readings (N, m) that are gross errors, records (N,) that are of no use, `blamed` (N,) the number of
    the input that is wrong, −1 where the record is used; dead (m,): sensors most of whose readings are impossible;
    spoilt (m,): sensors with so many gross readings that none was rejected; settled: the robust fit came to rest."""

    readings: np.ndarray
    records: np.ndarray
    blamed: np.ndarray
    dead: np.ndarray
    mostly_gross: np.ndarray
    converged: bool = True

    def select(self, rows: np.ndarray) -> GrossErrors:
        """Of some of the records."""
        return replace(self, readings=self.readings[rows], records=self.records[rows], blamed=self.blamed[rows])


def running_median(x: np.ndarray, width: int = AROUND) -> np.ndarray:
    """Median (n,) of the `width` values of x (n,) around each; the first and last such window at the ends."""
    n = len(x)
    if n <= width:
        return np.full(n, np.median(x)) if n else x
    windows = np.lib.stride_tricks.sliding_window_view(x, width)
    centre = np.partition(windows, width // 2, axis=1)[:, width // 2]
    return np.asarray(centre[np.clip(np.arange(n) - width // 2, 0, n - width)])


def _column_medians(x: np.ndarray) -> np.ndarray:
    """Of each column of x (n, m), NaN where it is empty."""
    return np.array([np.median(c[np.isfinite(c)]) if np.isfinite(c).any() else np.nan for c in x.T])


def deviations(r: np.ndarray) -> np.ndarray:
    """r (N, m) less the running median of each sensor's readings; NaN stays NaN."""
    a = np.full_like(r, np.nan)
    for j in range(r.shape[1]):
        rows = np.flatnonzero(np.isfinite(r[:, j]))
        a[rows, j] = r[rows, j] - running_median(r[rows, j])
    return a


def robust_scatter(r: np.ndarray) -> np.ndarray:
    """max(1, 1.4826 MAD) (m,) of r (N, m): noise is never taken for smaller than it was identified; 1 of few."""
    S = np.ones(r.shape[1])
    for j in range(r.shape[1]):
        x = r[np.isfinite(r[:, j]), j]
        if len(x) >= LEAST:
            S[j] = max(1.0, 1.4826 * float(np.median(np.abs(x - np.median(x)))))
    return S


def _chi2_limits(dof: np.ndarray) -> np.ndarray:
    """The values (N,) that χ² of dof (N,), at least 1, exceeds with the probability `INPUT_CHANCE`."""
    counts, which = np.unique(np.maximum(dof, 1), return_inverse=True)
    return np.array([chdtri(float(n), INPUT_CHANCE) for n in counts])[which]


def may_have_gross_errors(z: np.ndarray, level: np.ndarray, rho: np.ndarray) -> bool:
    """Whether any reading of z (N, m), level (N, m) as in `Stretch`, or record, might be a gross error: of most short
    stretches none is, and nothing need be fitted."""
    if _impossible_readings(z, level).any():
        return True
    a = deviations(z)
    least = (1 - rho**2) / np.sqrt(1 - rho**4)  # v of neighbours one step away, the smallest there is
    S = robust_scatter(a) if len(a) >= 2 * AROUND else 1.0  # of few, two bursts may be all the scatter
    u = np.nan_to_num(np.abs(a / S)) / least
    # a fit may move a reading from its neighbours, by little within thirty records
    if bool((u > ALMOST * GROSS).any()):
        return True
    dof = np.isfinite(z).sum(axis=1)
    return bool(np.any(np.sum(u**2, axis=1) > _chi2_limits(dof)))


def robust_residuals(stretch: ResidualStretch) -> tuple[np.ndarray, np.ndarray, bool]:
    """r (N, m) of the robust fit, scatter S (m,), and whether the fit came to rest within its steps.

    Readings weigh 1/(S²(1+ρ)/(1−ρ)), as many that are correlated are worth, against the prior of the parameters, times
    Tukey's function of how far they are from the fit of all other records, so that none draws the fit to itself. The
    first fit is of those that lie with their neighbours. A record all of whose readings together are too far from it
    has no weight: where few others were, a wrong input would bend what is uncertain about nominal.
    """
    z, p, m = stretch.z, stretch.G.shape[2], stretch.z.shape[1]
    first = deviations(z)
    S = robust_scatter(first)
    weight = np.where(np.abs(first) < START * S, 1.0, 0.0)  # NaN: 0
    X = np.zeros((*z.shape, p + 2 * m))
    X[:, :, :p] = stretch.G
    for j in range(m):
        X[:, j, p + 2 * j], X[:, j, p + 2 * j + 1] = 1.0, stretch.level[:, j]
    prior = np.zeros((p + 2 * m, p + 2 * m))
    prior[:p, :p] = stretch.precision
    prior[range(p, p + 2 * m), range(p, p + 2 * m)] = np.tile([BIAS_SIGMAS**-2, SCALE**-2], m)
    unit = 1 / np.sqrt(np.diag(prior))
    X = np.where(stretch.present[:, :, None], X * unit, 0.0)
    prior = unit[:, None] * prior * unit
    readings = np.where(stretch.present, z, 0.0)
    farthest = _chi2_limits(stretch.present.sum(axis=1))
    fit, settled = np.zeros_like(z), False
    for _ in range(STEPS):
        w = weight / (S**2 * stretch.inflation)
        C = np.linalg.inv(prior + np.tensordot(X * w[:, :, None], X, axes=([0, 1], [0, 1])))
        before, fit = fit, X @ (C @ np.tensordot(X, w * readings, axes=([0, 1], [0, 1])))
        r = z - fit
        S = robust_scatter(r)
        settled = bool(np.all(np.abs(fit - before)[stretch.present] < SETTLED))
        if settled:
            break
        x, chi2 = _leave_one_out_distance(np.where(stretch.present, r, 0.0), X @ C @ X.transpose(0, 2, 1), w, S)
        near = stretch.present & (chi2 <= farthest)[:, None]
        weight = np.where(near, np.maximum(1 - (x / TUKEY) ** 2, 0.0) ** 2, 0.0)
    return r, S, settled


def _leave_one_out_distance(
    r: np.ndarray, V: np.ndarray, w: np.ndarray, S: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How far readings are from the fit of all records but their own, |r′|/√(S² + V′) (N, m), and the χ² (N,) of each
    record, by residuals r (N, m), the fit's covariance V (N, m, m), weights w (N, m) in that fit and scatter S (m,):

        r′ = (1 − V w)⁻¹ r,   V′ = (1 − V w)⁻¹ V,   χ² = r′ᵀ (S² + V′)⁻¹ r′.
    """
    m = len(S)
    others = np.linalg.solve(np.eye(m) - V * w[:, None, :], np.concatenate([r[:, :, None], V], axis=2))
    away, covariance = others[:, :, 0], others[:, :, 1:] + np.diag(S**2)
    chi2 = np.einsum("kj,kj->k", away, np.linalg.solve(covariance, away[:, :, None])[:, :, 0])
    return np.abs(away) / np.sqrt(np.einsum("kjj->kj", covariance)), chi2


def _predict_from_neighbours(
    x: np.ndarray, good: np.ndarray, clock: np.ndarray, rho: float
) -> tuple[np.ndarray, np.ndarray]:
    """x̂ and v (n,) of each of n readings x of a sensor from its nearest good (n,) neighbours, clock (n,) in steps."""
    n = len(x)
    at = np.arange(n)
    left = np.maximum.accumulate(np.where(good, at, -1))
    left = np.concatenate([[-1], left[:-1]])
    right = np.minimum.accumulate(np.where(good, at, n)[::-1])[::-1]
    right = np.concatenate([right[1:], [n]])

    def weigh(there: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        place = np.where(known, there, 0)
        return np.where(known, rho ** np.abs(clock - clock[place]), 0.0), np.where(known, x[place], 0.0)

    (a, x_left), (b, x_right) = weigh(left, left >= 0), weigh(right, right < n)
    rest = 1 - (a * b) ** 2
    expected = (a * (1 - b**2) * x_left + b * (1 - a**2) * x_right) / rest
    return expected, np.sqrt((1 - a**2) * (1 - b**2) / rest)


def _judge_sensor(x: np.ndarray, a: np.ndarray, clock: np.ndarray, rho: float) -> tuple[np.ndarray, np.ndarray]:
    """Gross (n,) of n readings x = r/S of one sensor, a the local ones, and by how much each departs (n,): signed, the
    smaller of |u| and |a|/v."""
    gross = np.zeros(len(x), bool)
    for _ in range(PASSES):
        expected, v = _predict_from_neighbours(x, ~gross, clock, rho)
        u, local = (x - expected) / v, a / v
        depart = np.where(u * local > 0, np.sign(u) * np.minimum(np.abs(u), np.abs(local)), 0.0)
        flagged = np.abs(depart) > GROSS
        if abs(rho) > CORRELATED:  # a good reading beside a bad one departs, too, from what that predicts
            size = np.where(gross, 0.0, np.abs(u))
            highest = np.maximum(np.r_[0.0, size[:-1]], np.r_[size[1:], 0.0])
            flagged = flagged & (gross | (size >= highest))
        if np.array_equal(flagged, gross):
            break
        gross = flagged
    return gross, depart


def find_gross_errors(stretch: ResidualStretch, *, events: bool = False) -> GrossErrors:
    """The gross errors among consecutive records; `HALO` records on either side are context enough for any record.
    events: several sensors that depart together, for more than two records, are kept: what a model lacks does so."""
    N, m = stretch.z.shape
    impossible, dead = _find_impossible(stretch)
    readings, spoilt = np.zeros((N, m), bool), np.zeros(m, bool)
    r, S, settled = robust_residuals(_remove_readings(stretch, impossible))
    a = deviations(r)
    S_a, depart = robust_scatter(a), np.zeros((N, m))
    for j in range(m):
        rows = np.flatnonzero(np.isfinite(r[:, j]))
        if len(rows) < FEWEST:
            continue
        rho = float(stretch.rho[j])
        readings[rows, j], depart[rows, j] = _judge_sensor(
            r[rows, j] / S[j], a[rows, j] / S_a[j], stretch.clock[rows], rho
        )
    records, blamed = _find_wrong_inputs(stretch, depart, readings | impossible & ~dead)
    if np.isinf(stretch.lags[1:]).any():  # of several flights one may be another engine state, not a wrong record
        readings[records], records = False, np.zeros(N, bool)
    records = _keep_short_runs(records, a, stretch.time, stretch.clock, r)
    readings[records], own = False, np.where(records[:, None], np.nan, r)  # an input's doing is no sensor's run
    for j in range(m):
        rows = np.flatnonzero(np.isfinite(r[:, j]))
        found = _keep_short_runs(readings[rows, j], a[rows, j], stretch.time[rows], stretch.clock[rows], own[rows, j])
        spoilt[j] = found.sum() > MOST * len(rows) > 0
        readings[rows, j] = found & ~spoilt[j]
    if events:
        kept = _keep_long_runs(records | (readings.sum(axis=1) > 1), EVENT)
        readings[kept], records[kept] = False, False
    blamed = np.where(records, blamed, -1)
    return GrossErrors((readings | impossible) & ~records[:, None], records, blamed, dead, spoilt, settled)


def _find_impossible(stretch: ResidualStretch) -> tuple[np.ndarray, np.ndarray]:
    """Readings (N, m) that are no readings of this engine, and sensors (m,) that give mostly such. Where most sensors
    would be, it is the recording or the model that is wrong, and nothing is said of sensors."""
    far = _impossible_readings(stretch.z, stretch.level)
    dead = far.sum(axis=0) > MOST * np.maximum(stretch.present.sum(axis=0), 1)
    if dead.sum() > MOST * stretch.present.any(axis=0).sum():
        return np.zeros_like(far), np.zeros_like(dead)
    return far | (stretch.present & dead), dead  # a dead one may read right by chance, at idle for instance


def _impossible_readings(z: np.ndarray, level: np.ndarray) -> np.ndarray:
    """Readings (N, m) that are further from what is predicted than any fault moves them."""
    size = np.max(np.abs(level), axis=0, initial=0.0)
    return np.asarray(np.nan_to_num(np.abs(z)) > np.maximum(IMPOSSIBLE * size, DEAD_SIGMAS))


def _remove_readings(stretch: ResidualStretch, readings: np.ndarray) -> ResidualStretch:
    """The stretch without some readings (N, m)."""
    if not readings.any():
        return stretch
    return replace(stretch, z=np.where(readings, np.nan, stretch.z))


def _keep_short_runs(
    flagged: np.ndarray, a: np.ndarray, time: np.ndarray, clock: np.ndarray, r: np.ndarray | None = None
) -> np.ndarray:
    """The flagged (n,) of consecutive records whose run is short, as a number and as a time (n,) in s. Of the run are
    neighbours whose readings r (n, m), or a, are nearer to the run's than to what lies around that, r − a: near the end
    of a change that lasts, a (n, m) of its records is nothing. A run that reaches over unrelated records, which are far
    apart by their clock (n,), lasts too long where time is unknown."""
    a, r = (x if x.ndim == 2 else x[:, None] for x in (a, a if r is None else r))
    kept = flagged.copy()
    for first, stop in label_runs(flagged):
        if flagged[first]:
            size, level = (np.nan_to_num(_column_medians(x[first:stop])) for x in (a, r))
            away = np.nan_to_num(r - (level - size)) * size
            back = away.sum(axis=1) <= 0.5 * np.sum(np.isfinite(r) * size**2, axis=1)
            before, after = np.flatnonzero(back[:first]), np.flatnonzero(back[stop:])
            begin = before[-1] + 1 if before.size else 0
            end = stop + after[0] if after.size else len(a)
            lasts = time[end - 1] - time[begin]
            apart = clock[end - 1] - clock[begin] >= UNRELATED
            if end - begin > 1 and (end - begin > RUN or lasts > RUN_S or (apart and not np.isfinite(lasts))):
                kept[first:stop] = False
    return kept


def find_brief_departures(t: np.ndarray, time: np.ndarray, clock: np.ndarray) -> np.ndarray:
    """Where t (n, q), what each of q channels is off by in standard deviations (NaN: no reading), may be a gross error
    of that channel: in runs that last no longer than those, or not yet."""
    brief = np.zeros(t.shape, bool)
    for c in range(t.shape[1]):
        rows = np.flatnonzero(np.isfinite(t[:, c]))
        far = np.abs(t[rows, c]) > GROSS
        if far.any():
            brief[rows, c] = _keep_short_runs(far, t[rows, c], time[rows], clock[rows])
    return brief


def _keep_long_runs(flagged: np.ndarray, least: int) -> np.ndarray:
    """The flagged (n,) in runs of at least so many."""
    kept = flagged.copy()
    for first, stop in label_runs(flagged):
        kept[first:stop] &= stop - first >= least
    return kept


def _find_wrong_inputs(
    stretch: ResidualStretch, depart: np.ndarray, gross: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Records (N,) that an error of an input spoils, or most of whose readings are gross (N, m), and the number of the
    input (N,), −1 for none: T = max_i (S_iᵀu)²/S_iᵀS_i, S_i the effect of input i over σ, u what departs (N, m)."""
    dof = stretch.present.sum(axis=1)
    blamed = np.full(len(dof), -1)
    total = np.sum(depart**2, axis=1)
    most = (dof > 2) & (gross.sum(axis=1) > MOST * dof)
    rows = np.flatnonzero((dof > 1) & (total > _chi2_limits(dof)) | most)
    if not rows.size:
        return np.zeros(len(dof), bool), blamed
    S = np.where(stretch.present[rows][:, :, None], np.nan_to_num(stretch.input_effects(rows)), 0.0)
    u = depart[rows]
    power = np.sum(S**2, axis=1)
    T = np.einsum("kjq,kj->kq", S, u) ** 2 / np.where(power > 0, power, np.inf)
    best = np.argmax(T, axis=1) if T.shape[1] else np.zeros(len(rows), int)
    T_best = T[range(len(rows)), best] if T.shape[1] else np.zeros(len(rows))
    factor, constant = INPUT_BETTER
    by_input = (T_best > INPUT_GROSS) & (T_best > factor * np.max(u**2, axis=1) + constant)
    blamed[rows] = np.where(by_input, best, np.where(most[rows], UNKNOWN, -1))
    return blamed != -1, blamed
