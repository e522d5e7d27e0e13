"""Statistics of a window of any length in the memory of one stretch of it.

A stretch of records is compared with nominal, then with the point where the window is linearised; only sums of it are
kept. What nominal gives costs most. Of a window that is not too long it is kept in a file, and steps begin at nominal
as those of short windows do. Of a longer one it is computed anew in each pass, so few may be made: the point is
estimated first from some of the records, from there with `FINER` times as many, and so on, each time with a remaining
distance that shrinks by the root of that. The last pass starts a standard error or so from the estimate, and mostly
ends there.

Stretches are counted from the first record of the window: nothing depends on how the file came in chunks.

**Records that wait** for the end of their window are in memory, or in a file where a window is long. A window of any
length costs memory for `IN_MEMORY` records. The file has no name, and is gone with the run: it takes 8 bytes a value,
some 200 bytes a record, in the folder for temporary files.

`RecentRecords` keeps records for what needs more of a window than its statistics.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import IO

import numpy as np

from enginediag_cli.recordings.table import Recording, concat
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.reduced import ReducedMonitor
from enginediag_cli.residuals.relinearise import (
    MAX_LOST_SHARE,
    GaussNewton,
    LinearisedSums,
    PointSums,
    Stop,
    TrialSums,
    relinearise,
)
from enginediag_cli.residuals.statistics import LocalStatistics, StatisticsBlock, block_statistics, whitened
from enginediag_cli.residuals.windows import (
    NominalResiduals,
    WindowStatistics,
    group_rows,
    nominal_residuals,
    select_inputs,
)

IN_MEMORY = 50_000
"""Records of one window that wait in memory: some ten megabytes."""


@dataclass(frozen=True)
class JudgedRecords:
    """n records in order: inputs, column -> (n,); readings y (n, m), NaN where missing; lags (n,): steps since the
    record before, inf where they are unrelated."""

    inputs: Mapping[str, np.ndarray]
    y: np.ndarray
    lags: np.ndarray

    def __len__(self) -> int:
        return len(self.y)


class StoredRecords:
    """As `JudgedRecords`, in one matrix (n, inputs + m + 1), which may be moved to a file."""

    def __init__(self, records: JudgedRecords):
        self._columns = tuple(records.inputs)
        self._values = np.column_stack([*records.inputs.values(), records.y, records.lags])
        self.in_memory, self.count = True, len(records)

    def move(self, file: IO[bytes]) -> None:
        """To the end of a file, which is mapped into memory."""
        if not self.count:
            return
        shape, first = self._values.shape, file.seek(0, os.SEEK_END)
        file.write(np.ascontiguousarray(self._values).data)
        file.flush()
        self._values = np.memmap(file, float, "r", first, shape)
        self.in_memory = False

    def read(self, first: int, stop: int) -> np.ndarray:
        """The rows first … stop − 1."""
        return np.asarray(self._values[first:stop])

    def records(self, rows: np.ndarray) -> JudgedRecords:
        """What rows (k, inputs + m + 1) say."""
        d = len(self._columns)
        return JudgedRecords(dict(zip(self._columns, rows[:, :d].T, strict=True)), rows[:, d:-1], rows[:, -1])


class RecordSpill:
    """Moves what waits of long windows to a file."""

    def __init__(self) -> None:
        self._file: IO[bytes] | None = None

    def __call__(self, waiting: Sequence[StoredRecords]) -> None:
        held = [stored for stored in waiting if stored.in_memory]
        if sum(stored.count for stored in held) <= IN_MEMORY:
            return
        if self._file is None or not any(not stored.in_memory for stored in waiting):
            import tempfile  # few records need none, and it takes a while to import

            self._file = tempfile.TemporaryFile(prefix="enginediag-")
        for stored in held:
            stored.move(self._file)


class WindowRecords:
    """The judged records of one window, from what is stored of its pieces in order."""

    def __init__(self, stored: Sequence[StoredRecords]):
        self._stored = stored
        self._first = np.concatenate([[0], np.cumsum([part.count for part in stored])]).astype(int)

    def __len__(self) -> int:
        return int(self._first[-1])

    def read(self, spans: Sequence[tuple[int, int]]) -> JudgedRecords:
        """Those of the spans (first, one after the last) in turn."""
        rows = [self._stored[0].read(0, 0)]
        for first, stop in spans:
            k = int(np.searchsorted(self._first, first, side="right")) - 1
            while first < stop:
                base, end = int(self._first[k]), min(int(self._first[k + 1]), stop)
                if end > first:
                    rows.append(self._stored[k].read(first - base, end - base))
                first, k = max(end, first), k + 1
        return self._stored[0].records(np.concatenate(rows))

    @property
    def read_all(self) -> JudgedRecords:
        return self.read([(0, len(self))])


STRETCH = 1_500
"""Records that are computed together: sensitivities to two hundred parameters of each take some 100 MB, and one call of
the engine costs little beside so many."""
RUN = 125
"""Records in a row of which a part of a window consists: long beside the memory of noise, and twelve of them lie all
over a flight."""
FINER = 5
"""How many times more records each estimate of the point of linearisation has than the one before: with ten the last
step is so long that flights of ten hours need another pass, with two the first passes cost as much as the last."""
KEPT_BYTES = 600e6
"""Size of the file that keeps what nominal gives: some 40,000 records of nine sensors. Judgement: what a folder for
temporary files has to spare."""

MORE = 20
"""Numbers of a reading that are kept beside its sensitivities: predictions, and what is frozen at nominal."""

Span = tuple[int, int]


@dataclass(frozen=True)
class LongStatistics:
    """Of one window: its statistics, `failed`: records that the engine could not compute, and the size of the
    `last_step` in standard errors, where the estimate has not converged."""

    statistics: LocalStatistics
    failed: int
    last_step: float | None = None


def long_statistics(monitor: Monitor, records: WindowRecords, *, linearise: str, tolerance: float) -> LongStatistics:
    """Statistics of all records of a window at nominal or at its own estimate, `linearise` as in `window_statistics`;
    tolerance: last step of the estimate, in standard errors."""
    everything = [(0, len(records))]
    if linearise == "nominal":
        found = _Passes(monitor, records, everything, monitor.theta0, kept=False).run_pass(
            monitor.theta0, ((1.0, monitor.theta0),), blocks=True
        )
        assert found.block is not None
        return LongStatistics(found.block.statistics, found.failed)
    bent = monitor.curvature if isinstance(monitor, ReducedMonitor) else None
    # what a part of the records leaves out matters by how much it is of all
    left_out = (lambda steps, _: bent.neglected_error(steps, np.array([len(records)]))) if bent else None
    stop = Stop(neglected=left_out, tolerance=tolerance)
    kept = 8 * len(records) * len(monitor.sensors) * (len(monitor.names) + MORE) < KEPT_BYTES
    start, predicted = (
        (monitor.theta0, []) if kept else _start_point(monitor, records, _sample_spans(len(records)), stop)
    )
    passes = _Passes(monitor, records, everything, start, kept=kept)
    passes.final, passes.nominal_predictions = True, predicted
    loop = GaussNewton(passes, monitor.hold)
    loop.run(stop)
    statistics = _carry_to_nominal(passes.statistics(), (loop.sums.theta[0] - monitor.theta0)[: loop.q])
    settled = bool(loop.converged[0]) or statistics.n == 0
    return LongStatistics(statistics, passes.here.failed, None if settled else float(loop.decrement[0]))


def _carry_to_nominal(statistics: LocalStatistics, change: np.ndarray) -> LocalStatistics:
    """The statistics of ẽ = e + J δ, from those of e, for a change δ (q,) of the leading parameters."""
    q = len(change)
    moved = statistics.F[:, :q] @ change
    chi2 = statistics.chi2 + 2 * float(change @ statistics.s[:q]) + float(change @ moved[:q])
    return replace(statistics, s=statistics.s + moved, chi2=chi2)


def _sample_spans(records: int) -> list[Span]:
    """Runs of records, one in `FINER`, evenly spread over a window."""
    return [(first, min(first + RUN, records)) for first in range(0, records, RUN * FINER)]


def _span_records(spans: list[Span]) -> int:
    return sum(stop - first for first, stop in spans)


def _start_point(
    monitor: Monitor, records: WindowRecords, spans: list[Span], stop: Stop
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Where a window is linearised, θ (p,), by the records of these spans: few at once, more by one step from where few
    of them are; and predictions (n, m) at nominal of the few."""
    if _span_records(spans) <= STRETCH:
        return _start_point_at_once(monitor, records, spans, stop)
    start, predicted = _start_point(monitor, records, spans[::FINER], stop)
    passes = _Passes(monitor, records, spans, start, kept=False)
    return GaussNewton(passes, monitor.hold).next_points[0], predicted


def _start_point_at_once(
    monitor: Monitor, records: WindowRecords, spans: list[Span], stop: Stop
) -> tuple[np.ndarray, list[np.ndarray]]:
    """As `_start`, of few records in memory."""
    taken = records.read(spans)
    nominal = nominal_residuals(monitor, taken.inputs, taken.y)

    def predict(theta: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return _predicted(monitor, nominal.select(rows), theta)

    known = (nominal.predicted, nominal.J, nominal.ok)
    found = relinearise(predict, nominal.y, monitor.hold, monitor.noise, nominal=known, stop=stop)
    return np.asarray(found.theta[0]), [nominal.predicted]


def _predicted(
    monitor: Monitor, nominal: NominalResiduals, theta: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """y (N, m), J (N, m, q) and ok (N,) at theta (p,), or one row per record, of records known at nominal."""
    return monitor.predict(nominal.inputs, theta, nuisance=False, start=nominal.x)[:3]


class _NominalFile:
    """What nominal gives of each stretch, in a file without a name."""

    def __init__(self) -> None:
        import tempfile  # short windows need none, and it takes a while to import

        self._file = tempfile.TemporaryFile(prefix="enginediag-")
        self._places: list[tuple[int, tuple[str, ...], bool]] = []

    def __len__(self) -> int:
        return len(self._places)

    def append(self, nominal: NominalResiduals) -> None:
        self._places.append((self._file.tell(), tuple(nominal.inputs), nominal.x is not None))
        x = [] if nominal.x is None else [nominal.x]
        for values in (*nominal.inputs.values(), nominal.y, nominal.predicted, nominal.J, nominal.ok, *x):
            np.save(self._file, values)

    def read(self, number: int) -> NominalResiduals:
        place, columns, shows_x = self._places[number]
        self._file.seek(place)
        inputs = {c: np.load(self._file) for c in columns}
        y, predicted, J, ok = (np.load(self._file) for _ in range(4))
        return NominalResiduals(inputs, y, predicted, J, ok, np.load(self._file) if shows_x else None)


@dataclass
class _Pass:
    """Sums over the records of a window, with residuals and sensitivities at one point; block: all sums, where they are
    asked for; `nominal`: z·z and s of those at nominal, likewise; used: records that the model can compute; lost:
    numbers of those that it can compute at nominal, but not here."""

    zz: float
    s: np.ndarray
    F: np.ndarray
    records: int
    used: int
    lost_records: np.ndarray
    block: StatisticsBlock | None = None
    nominal: tuple[float, np.ndarray] | None = None

    @property
    def failed(self) -> int:
        return self.records - self.used

    def sums(self, theta: np.ndarray) -> LinearisedSums:
        return LinearisedSums(theta[None].copy(), np.array([self.zz]), self.s[None].copy(), self.F[None].copy())


Mean = tuple[tuple[float, np.ndarray], ...]
"""Points θ (p,) of whose sensitivities the mean with these weights is taken."""


class _Passes:
    """The records of one window, or those of some spans of it, as `relinearise.Records`: every sum is a pass. final:
    whether statistics will be asked for."""

    final = False

    def __init__(self, monitor: Monitor, records: WindowRecords, spans: list[Span], start: np.ndarray, *, kept: bool):
        self._monitor, self._records, self._spans, self.start = monitor, records, spans, start
        self._dropped = np.zeros(len(records), bool)
        self._kept = _NominalFile() if kept else None
        self._points: PointSums | None = None
        self._unmoved: _FixedInformation | None = None
        self.nominal_predictions: list[
            np.ndarray
        ] = []  # predictions at nominal of some records everywhere in the window

    @property
    def used(self) -> np.ndarray:
        return np.array([self.here.used])

    def begin(self) -> tuple[LinearisedSums, LinearisedSums]:
        theta0 = self._monitor.theta0
        self.here = self._start_pass(self.start)
        if len(self.here.lost_records) > MAX_LOST_SHARE * self.here.used:
            self.start = theta0
            self.here = self._start_pass(theta0)
        self._dropped[self.here.lost_records] = True
        sums = self.here.sums(self.start)
        if self.here.nominal is None:
            return sums, self.here.sums(theta0)
        zz, s = self.here.nominal
        return sums, LinearisedSums(theta0[None], np.array([zz]), s[None], sums.F)

    def _start_pass(self, theta: np.ndarray) -> _Pass:
        self._theta = theta
        self._mean: Mean = ((1.0, theta),)
        return self._pass(theta, self._mean, with_nominal=theta is not self._monitor.theta0)

    def trial(self, chosen: np.ndarray, target: np.ndarray, here: LinearisedSums) -> TrialSums:
        self._trial_theta = target[0].copy()
        self._trial = self._pass(self._trial_theta, ((1.0, self._trial_theta),))
        lost = self._trial.lost_records
        if not len(lost):
            return TrialSums(self._trial.sums(self._trial_theta), np.array([False]))
        if len(lost) > MAX_LOST_SHARE * self.here.used:
            return TrialSums(here, np.array([True]))
        self._dropped[lost] = True
        self.here = self._pass(self._theta, self._mean)
        again = self.here.sums(self._theta)
        return TrialSums(self._trial.sums(self._trial_theta), np.array([False]), again, np.array([True]))

    def move(self, accepted: np.ndarray) -> None:
        if accepted[0]:
            self._theta, self._mean, self.here = self._trial_theta, ((1.0, self._trial_theta),), self._trial

    def bend(self, refused: np.ndarray) -> LinearisedSums:
        self._mean = (*((w / 2, theta) for w, theta in self._mean), (0.5, self._trial_theta))
        self.here = self._pass(self._theta, self._mean)
        return self.here.sums(self._theta)

    def _pass(self, theta: np.ndarray, mean: Mean, *, with_nominal: bool = False) -> _Pass:
        """A pass for a step: where another one is cheap, statistics wait until the steps have ended."""
        return self.run_pass(theta, mean, blocks=self.final and self._kept is None, with_nominal=with_nominal)

    def statistics(self) -> LocalStatistics:
        """Of all records, where the window stands."""
        monitor = self._monitor
        if self.here.block is None:
            self.here = self.run_pass(self._theta, self._mean, blocks=True)
        assert self.here.block is not None
        found = self.here.block.statistics
        return found if self._points is None else replace(found, points=self._points.squared(len(monitor.names)))

    def run_pass(self, theta: np.ndarray, mean: Mean, *, blocks: bool, with_nominal: bool = False) -> _Pass:
        """One pass over the records: residuals at theta, sensitivities to what moves as their mean over some points.
        blocks: all sums, not those that steps need alone; with_nominal: sums at nominal, too."""
        monitor, p = self._monitor, len(self._monitor.names)
        points = self._empty_points() if blocks else None
        steps = None if blocks else _StepSums(monitor, self._unmoved)
        block: StatisticsBlock | None = None
        zz0, s0, used, lost = 0.0, np.zeros(p), 0, [np.zeros(0, int)]
        for number, lags, nominal in self._nominal_stretches():
            e, J, fine = self._evaluate_residuals(nominal, theta, mean)
            kept = nominal.ok & fine & ~self._dropped[number]
            lost.append(number[nominal.ok & ~fine & ~self._dropped[number]])
            used += int(kept.sum())
            e[~kept] = np.nan
            if with_nominal:
                z, G, _ = whitened(np.where(np.isfinite(e), nominal.e, np.nan), nominal.J, monitor.noise)
                zz0, s0 = zz0 + float(np.sum(z**2)), s0 + z.ravel() @ G.reshape(-1, p)
            if steps is None:
                (more,) = block_statistics(e, J, monitor.noise, np.array([0]), monitor.frame, lags=lags)
                block = more if block is None else block + more
            elif not steps.add(e, J, int(number[0])):
                self._unmoved = None  # other readings count than did: all sums anew
                return self.run_pass(theta, mean, blocks=blocks, with_nominal=with_nominal)
            if points is not None:
                points.add(nominal.predicted, e, J)
        if block is not None:
            zz, s, F = block.sums.chi2, block.sums.s, block.sums.F
        else:
            assert steps is not None
            zz, s, F, self._unmoved = *steps.sums, steps.unmoved
        self._points = points
        n = _span_records(self._spans)
        return _Pass(zz, s, F, n, used, np.concatenate(lost), block, (zz0, s0) if with_nominal else None)

    def _empty_points(self) -> PointSums | None:
        slopes = self._monitor.slopes
        if slopes is None or not self.nominal_predictions:
            return None
        return PointSums(self._monitor.noise, slopes.position, np.concatenate(self.nominal_predictions))

    def _nominal_stretches(self) -> Iterator[tuple[np.ndarray, np.ndarray, NominalResiduals]]:
        """The records in stretches, compared with nominal: their numbers (n,) and lags (n,)."""
        known = len(self._kept) if self._kept is not None else 0
        for i, spans in enumerate(self._stretches()):
            number = np.concatenate([np.arange(first, stop) for first, stop in spans])
            taken = self._records.read(spans)
            if self._kept is not None and i < known:
                yield number, taken.lags, self._kept.read(i)
                continue
            nominal = nominal_residuals(self._monitor, taken.inputs, taken.y)
            if self._kept is not None:
                self._kept.append(nominal)
                self.nominal_predictions.append(nominal.predicted)
            yield number, taken.lags, nominal

    def _evaluate_residuals(
        self, nominal: NominalResiduals, theta: np.ndarray, mean: Mean
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Residuals (N, m) at theta, sensitivities (N, m, p) and which records can be computed (N,)."""
        monitor = self._monitor
        q = len(monitor.monitored)
        if np.array_equal(theta, monitor.theta0) and len(mean) == 1:
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
            if batch and _span_records(batch) + span[1] - span[0] > STRETCH:
                yield batch
                batch = []
            batch.append(span)
        if batch:
            yield batch


@dataclass(frozen=True)
class _FixedInformation:
    """F (p, p) of parameters that do not move, the rest of it being nothing to go by, and which readings it counts
    (n, m), by the number of the first record of each stretch."""

    F: np.ndarray
    present: dict[int, np.ndarray]


class _StepSums:
    """z·z, s and F of a pass; known: what does not move, which need not be summed again as long as the same readings
    count."""

    def __init__(self, monitor: Monitor, known: _FixedInformation | None):
        p = len(monitor.names)
        self._noise, self._q, self._known = monitor.noise, len(monitor.monitored), known
        self._zz, self._s, self._F = 0.0, np.zeros(p), np.zeros((p, p))
        self._present: dict[int, np.ndarray] = {}

    def add(self, e: np.ndarray, J: np.ndarray, first: int) -> bool:
        """A stretch; whether the sums are those of the readings that were known."""
        z, G, present = whitened(e, J, self._noise)
        if self._known is not None and not np.array_equal(present, self._known.present[first]):
            return False
        self._present[first] = present
        columns = G.reshape(-1, G.shape[2])
        self._zz, self._s = self._zz + float(np.sum(z**2)), self._s + z.ravel() @ columns
        rows = columns if self._known is None else columns[:, : self._q]
        self._F[: rows.shape[1]] += rows.T @ columns
        return True

    @property
    def sums(self) -> tuple[float, np.ndarray, np.ndarray]:
        if self._known is None:
            return self._zz, self._s, self._F
        q, F = self._q, self._F.copy()
        F[q:, :q], F[q:, q:] = F[:q, q:].T, self._known.F[q:, q:]
        return self._zz, self._s, F

    @property
    def unmoved(self) -> _FixedInformation:
        return self._known or _FixedInformation(self._F, self._present)


MOST = 10_000
"""Records of a window beyond which they are not handed out: the full model holds 10 kB of each. With so many the
statistics at the window's own estimate distinguish changes."""
HELD = 10 * MOST
"""Records kept at most: windows wait for each other until they hold some thousands."""


class RecentRecords:
    """Chunks of recordings as they pass; `short_windows`: chunks before a window asked for are let go, so that
    memory holds little more than a window. It never holds more than HELD records."""

    def __init__(self, monitor: Monitor, short_windows: bool):
        self._monitor, self._short = monitor, short_windows
        self._chunks: deque[Recording] = deque()

    def record(self, chunks: Iterable[Recording]) -> Iterator[Recording]:
        """The chunks, each remembered before it is handed on."""
        for chunk in chunks:
            self._chunks.append(chunk)
            while sum(map(len, self._chunks)) > HELD:
                self._chunks.popleft()
            yield chunk

    def discard_before(self, window: WindowStatistics) -> None:
        """Forget what neither this window nor a later one needs."""
        while self._chunks and self._passed(self._chunks[0], window):
            self._chunks.popleft()

    def recall(self, window: WindowStatistics) -> tuple[dict[str, np.ndarray], np.ndarray] | None:
        """Inputs, column -> (N,), and readings (N, m) of the records of a window that can be judged; None when
        they are no longer held, are more than MOST, or there is none."""
        self.discard_before(window)
        if window.records > MOST:
            return None
        parts = []
        for chunk in self._chunks:
            if chunk.source != window.source or not len(chunk):
                continue
            for key, rows in group_rows(chunk):
                if key == (window.source, window.flight, window.engine):
                    line = np.asarray(chunk.line)[rows]
                    inside = (line >= window.first_line) & (line <= window.last_line)
                    if inside.any():
                        parts.append(chunk.select(np.asarray(rows)[inside]))
        if sum(map(len, parts)) != window.records or not parts:
            return None
        taken = select_inputs(self._monitor, concat(parts))
        judged = taken.judged
        return ({c: v[judged] for c, v in taken.inputs.items()}, taken.y[judged]) if judged.any() else None

    def _passed(self, chunk: Recording, window: WindowStatistics) -> bool:
        if not len(chunk):
            return True
        if chunk.source != window.source:
            # windows come file by file: what was read before this file's first chunk is done with
            return any(other.source == window.source for other in self._chunks)
        return self._short and int(chunk.line[-1]) < window.first_line
