"""Statistics of a window of any length in the memory of one stretch of it.

A stretch of records is held against nominal, then against the point where the window is linearised; what is kept of it
are sums. One such pass over all records costs what nominal costs, so few of them may be made: the point is estimated
first from a thousand records of the window, from there with ten times as many, and so on, each time with what is left
to move shrinking by √10. The last pass starts a few standard errors from the estimate, and mostly ends there.

Stretches are counted from the first record of the window: nothing depends on how the file came in chunks.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from enginediag_cli.residuals.admission import NominalResiduals, nominal_residuals
from enginediag_cli.residuals.blocks import Block
from enginediag_cli.residuals.judged_records import RecordsOfWindow
from enginediag_cli.residuals.local import block_statistics, whiten
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.operating_points import PointSums
from enginediag_cli.residuals.reduced import ReducedMonitor
from enginediag_cli.residuals.relinearise import MAX_LOST, GaussNewton, Stop, Sums, Trial, relinearise
from enginediag_cli.residuals.statistics import LocalStatistics

STRETCH = 1_500
"""Records that are computed together: sensitivities to two hundred parameters of each take some 100 MB, and one call of
the engine costs little beside so many."""
RUN = 125
"""Records in a row of which a part of a window consists: long beside the memory of noise, and twelve of them lie all
over a flight."""
FINER = 10
"""How many times more records each estimate of the point of linearisation has than the one before."""

Span = tuple[int, int]


@dataclass(frozen=True)
class LongStatistics:
    """Of one window: its statistics, `failed`: records that the engine could not compute, and the size of the
    `last_step` in standard errors, where the estimate has not converged."""

    statistics: LocalStatistics
    failed: int
    last_step: float | None = None


def long_statistics(monitor: Monitor, records: RecordsOfWindow, *, linearise: str, tolerance: float) -> LongStatistics:
    """Statistics of all records of a window at nominal or at its own estimate, `linearise` as in `window_statistics`;
    tolerance: last step of the estimate, in standard errors."""
    whole = _Passes(monitor, records, [(0, len(records))], monitor.theta0)
    if linearise == "nominal":
        found = whole.over(monitor.theta0, ((1.0, monitor.theta0),))
        return LongStatistics(found.block.statistics, found.failed)
    estimate = _Estimate(monitor, records, tolerance)
    whole.start = estimate.start(_parts(len(records), FINER))
    if monitor.slopes is not None and estimate.predicted is not None:
        whole.points = PointSums(monitor.noise, monitor.slopes.position, estimate.predicted)
    loop = estimate.run(whole)
    statistics = _carried_back(whole.here.block.statistics, (loop.sums.theta[0] - monitor.theta0)[: loop.q])
    if whole.here.points is not None:
        statistics = replace(statistics, points=whole.here.points.squared(len(monitor.names)))
    settled = bool(loop.converged[0]) or statistics.n == 0
    return LongStatistics(statistics, whole.here.failed, None if settled else float(loop.decrement[0]))


def _carried_back(statistics: LocalStatistics, change: np.ndarray) -> LocalStatistics:
    """The statistics of ẽ = e + J δ, from those of e, for a change δ (q,) of the leading parameters."""
    q = len(change)
    moved = statistics.F[:, :q] @ change
    chi2 = statistics.chi2 + 2 * float(change @ statistics.s[:q]) + float(change @ moved[:q])
    return replace(statistics, s=statistics.s + moved, chi2=chi2)


def _parts(records: int, share: int) -> list[Span]:
    """Runs of records, one in so many, evenly spread over a window."""
    edges = range(0, records, RUN * share)
    return [(first, min(first + RUN, records)) for first in edges]


def _count(spans: list[Span]) -> int:
    return sum(stop - first for first, stop in spans)


class _Estimate:
    """Where a window is linearised, from some of its records; `predicted` (n, m): at nominal, of the fewest."""

    def __init__(self, monitor: Monitor, records: RecordsOfWindow, tolerance: float):
        self._monitor, self._records = monitor, records
        bent = monitor.curvature if isinstance(monitor, ReducedMonitor) else None
        # what a part of the records leaves out matters by how much it is of all
        left_out = (lambda steps, _: bent.left_out(steps, np.array([len(records)]))) if bent else None
        self._stop = Stop(left_out=left_out, tolerance=tolerance)
        self.predicted: np.ndarray | None = None

    def start(self, spans: list[Span]) -> np.ndarray:
        """θ (p,) from the records of these spans."""
        if _count(spans) <= STRETCH:
            return self._together(spans)
        passes = _Passes(self._monitor, self._records, spans, self.start(spans[::FINER]))
        return self.run(passes).sums.theta[0]

    def run(self, passes: _Passes) -> GaussNewton:
        loop = GaussNewton(passes, self._monitor.hold)
        loop.run(self._stop)
        return loop

    def _together(self, spans: list[Span]) -> np.ndarray:
        """As `start`, of few records in memory."""
        monitor = self._monitor
        taken = self._records.read(spans)
        nominal = nominal_residuals(monitor, taken.inputs, taken.y)
        self.predicted = nominal.predicted

        def predict(theta: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            return _predicted(monitor, nominal.rows(rows), theta)

        found = relinearise(
            predict,
            nominal.y,
            monitor.hold,
            monitor.noise,
            nominal=(nominal.predicted, nominal.J, nominal.ok),
            stop=self._stop,
        )
        return np.asarray(found.theta[0])


def _predicted(
    monitor: Monitor, nominal: NominalResiduals, theta: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """y (N, m), J (N, m, q) and ok (N,) at theta (p,), or one row per record, of records known at nominal."""
    return monitor.predict(nominal.inputs, theta, nuisance=False, start=nominal.x)[:3]


@dataclass
class _Pass:
    """Sums over the records of a window, with residuals and sensitivities at one point; `nominal`: z·z and s of those
    at nominal, None where these are not asked for; used: records that the model can compute; lost: numbers of those
    that it can compute at nominal, but not here."""

    block: Block
    nominal: tuple[float, np.ndarray] | None
    records: int
    used: int
    lost: np.ndarray
    points: PointSums | None

    @property
    def failed(self) -> int:
        return self.records - self.used

    def sums(self, theta: np.ndarray) -> Sums:
        x = self.block.sums
        return Sums(theta[None].copy(), np.array([x.chi2]), x.s[None].copy(), x.F[None].copy())


Mean = tuple[tuple[float, np.ndarray], ...]
"""Points θ (p,) of whose sensitivities the mean with these weights is taken."""


class _Passes:
    """The records of one window, or those of some spans of it, as `relinearise.Records`: every sum is a pass."""

    def __init__(self, monitor: Monitor, records: RecordsOfWindow, spans: list[Span], start: np.ndarray):
        self._monitor, self._records, self._spans, self.start = monitor, records, spans, start
        self._dropped = np.zeros(len(records), bool)
        self.points: PointSums | None = None

    @property
    def used(self) -> np.ndarray:
        return np.array([self.here.used])

    def begin(self) -> tuple[Sums, Sums]:
        theta0 = self._monitor.theta0
        self.here = self._at(self.start, self.start is not theta0)
        if len(self.here.lost) > MAX_LOST * self.here.used:
            self.start = theta0
            self.here = self._at(theta0, False)
        self._dropped[self.here.lost] = True
        sums = self.here.sums(self.start)
        if self.here.nominal is None:
            return sums, self.here.sums(theta0)
        zz, s = self.here.nominal
        return sums, Sums(theta0[None], np.array([zz]), s[None], sums.F)

    def _at(self, theta: np.ndarray, with_nominal: bool) -> _Pass:
        self._theta = theta
        self._mean: Mean = ((1.0, theta),)
        return self.over(self._theta, self._mean, with_nominal=with_nominal)

    def trial(self, chosen: np.ndarray, target: np.ndarray, here: Sums) -> Trial:
        self._trial_theta = target[0].copy()
        self._trial = self.over(self._trial_theta, ((1.0, self._trial_theta),))
        lost = self._trial.lost
        again = None
        if len(lost):
            too_many = len(lost) > MAX_LOST * self.here.used
            if too_many:
                return Trial(here, np.array([True]))
            self._dropped[lost] = True
            self.here = self.over(self._theta, self._mean)
            again = self.here.sums(self._theta)
        return Trial(self._trial.sums(self._trial_theta), np.array([False]), again, np.array([again is not None]))

    def move(self, accepted: np.ndarray) -> None:
        if accepted[0]:
            self._theta, self._mean, self.here = self._trial_theta, ((1.0, self._trial_theta),), self._trial

    def bend(self, refused: np.ndarray) -> Sums:
        self._mean = (*((w / 2, theta) for w, theta in self._mean), (0.5, self._trial_theta))
        self.here = self.over(self._theta, self._mean)
        return self.here.sums(self._theta)

    def over(self, theta: np.ndarray, mean: Mean, *, with_nominal: bool = False) -> _Pass:
        """One pass over the records: residuals at theta, sensitivities to what moves as their mean over some points.
        with_nominal: sums at nominal, too."""
        monitor = self._monitor
        points = self.points and self.points.empty()
        total: Block | None = None
        zz, s, used, lost = 0.0, np.zeros(len(monitor.names)), 0, [np.zeros(0, int)]
        for spans in self._stretches():
            taken = self._records.read(spans)
            number = np.concatenate([np.arange(first, stop) for first, stop in spans])
            nominal = nominal_residuals(monitor, taken.inputs, taken.y)
            e, J, fine = self._there(nominal, theta, mean)
            kept = nominal.ok & fine & ~self._dropped[number]
            lost.append(number[nominal.ok & ~fine & ~self._dropped[number]])
            used += int(kept.sum())
            e[~kept] = np.nan
            if with_nominal:
                z0, G0 = whiten(np.where(np.isfinite(e), nominal.e, np.nan), nominal.J, monitor.noise)
                zz, s = zz + float(np.sum(z0**2)), s + z0.ravel() @ G0.reshape(z0.size, -1)
            (block,) = block_statistics(e, J, monitor.noise, np.array([0]), monitor.frame, lags=taken.lags)
            total = block if total is None else total + block
            if points is not None:
                points.add(nominal.predicted, e, J)
        assert total is not None
        return _Pass(total, (zz, s) if with_nominal else None, _count(self._spans), used, np.concatenate(lost), points)

    def _there(
        self, nominal: NominalResiduals, theta: np.ndarray, mean: Mean
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Residuals (N, m) at theta, sensitivities (N, m, p) and which records can be computed (N,)."""
        monitor = self._monitor
        q, theta0 = len(monitor.monitored), monitor.theta0
        if np.array_equal(theta, theta0) and len(mean) == 1:
            return nominal.e, nominal.J, nominal.ok.copy()
        e, fine = nominal.e, nominal.ok.copy()
        moved = np.zeros((*nominal.y.shape, q))
        for weight, at in mean:
            y, J, ok = _predicted(monitor, nominal, at)
            moved += weight * J[:, :, :q]
            fine &= ok
            if np.array_equal(at, theta):
                e = nominal.y - y
        return e, np.concatenate([moved, nominal.J[:, :, q:]], axis=2), fine

    def _stretches(self) -> Iterator[list[Span]]:
        """The spans in turn, cut and put together to stretches."""
        cut = [s for first, stop in self._spans for s in pairwise([*range(first, stop, STRETCH), stop])]
        batch: list[Span] = []
        for span in cut:
            if batch and _count(batch) + span[1] - span[0] > STRETCH:
                yield batch
                batch = []
            batch.append(span)
        if batch:
            yield batch
