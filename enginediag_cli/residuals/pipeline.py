"""From recordings to local statistics, window by window, in constant memory.

recording → groups (file, flight, engine) → records that can be judged → blocks → windows → statistics.
A record outside the operating points that identification saw, or without its inputs, is counted, not judged.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np

from enginediag_cli.engine.instrument_errors import ELAPSED, suspected
from enginediag_cli.error_model.sizes import COMMON_SLOPE_SHARE as COMMON
from enginediag_cli.parallel import parallel_imap, process_count
from enginediag_cli.progress import each
from enginediag_cli.recordings.repeated import label_runs
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.instruments import (
    NOISE,
    InstrumentFault,
    NoiseModel,
    apply_weights,
    find_scatter,
    scatter_weights,
)
from enginediag_cli.residuals.long_windows import (
    RUN,
    JudgedRecords,
    RecordSpill,
    StoredRecords,
    WindowRecords,
    long_statistics,
)
from enginediag_cli.residuals.monitor import PRIOR_SHARE, Monitor
from enginediag_cli.residuals.reduced import ReducedMonitor
from enginediag_cli.residuals.relinearise import Stop, covariance_of_change, point_sums, relinearise
from enginediag_cli.residuals.score import marginalise
from enginediag_cli.residuals.statistics import LocalStatistics, StatisticsBlock, block_statistics
from enginediag_cli.residuals.windows import (
    JudgedInputs,
    Key,
    NominalResiduals,
    WindowPlan,
    WindowStatistics,
    cut_windows,
    describe_excluded,
    join_bookkeeping,
    nominal_residuals,
)

LINEARISE = ("estimate", "nominal")
BATCH_RECORDS = 3_000
"""Windows wait for each other until they hold this many records for each process. A window with more is a long one."""
CALL_RECORDS = 2_000
"""Records of the windows that are re-linearised together: one call of the engine costs less than many, for five hundred
records nearly as much as for two thousand, and more would hold sensitivities to a hundred parameters of each. A window
holds the square of its p parameters, too, as much as p/m records of m readings. Which windows share a call decides on
their last digits: it must not depend on how many processes there are."""
FLOWN = 12
"""Records of a window by which it is known where it was flown: a climb and a cruise have their corners among them."""
SETTLED = 0.2
"""Step of the re-estimate, in standard errors, that is not worth another call of the engine: what it neglects in
the statistics is of second order in it."""

SAMPLED = 4
"""Runs of a long window in which scatter is looked for: 500 records know a scatter to 5 %."""

TOGETHER = 500
"""Records of short windows whose statistics are summed by one pass: for each of twenty records the calls would cost
more than the arithmetic, for more memory would."""


@dataclass(frozen=True)
class _WindowPiece:
    """Consecutive records of one block: bookkeeping, and the judged ones as they are."""

    window: WindowStatistics
    judged: StoredRecords


Condense = Callable[[WindowStatistics, LocalStatistics], WindowStatistics]
"""condense(window, statistics of all parameters) -> the window with statistics, or with a reason for none."""


def condense_monitored(monitor: Monitor) -> Condense:
    """The monitored parameters, with everything uncertain about nominal and sensors counted as noise."""

    def condense(window: WindowStatistics, statistics: LocalStatistics) -> WindowStatistics:
        return replace(window, statistics=condense_statistics(monitor, statistics, monitor.uncertainty))

    return condense


def condense_statistics(monitor: Monitor, statistics: LocalStatistics, uncertainty: np.ndarray) -> LocalStatistics:
    """Statistics of the monitored parameters with `uncertainty` (p, p) counted as noise, and what wrong slopes of the
    maps may make of the change that they speak of. That is the change which the engine would have to show, no
    instrument being wrong."""
    found = marginalise(statistics, monitor.monitored, uncertainty)
    if monitor.slopes is None:
        return replace(found, points=None)
    engine = np.array([not monitor.meaning[name].belongs_to_instrument for name in monitor.monitored])
    spread = np.where(engine, PRIOR_SHARE * found.prior_sigma, 0.0)
    variance = monitor.slopes.likely_variance(found.s, found.F, spread)
    slopes = np.diag(variance)
    if statistics.points is not None:
        by_point = covariance_of_change(statistics, found, uncertainty, variance[monitor.slopes.position])
        slopes = COMMON * slopes + (1 - COMMON) * by_point
    return replace(found, slopes=slopes, points=None)


def window_statistics(
    monitor: Monitor,
    recordings: Iterable[Recording],
    plan: WindowPlan,
    *,
    linearise: str = "estimate",
    condense: Condense | None = None,
    apart: bool = True,
) -> Iterator[WindowStatistics]:
    """Compute the statistics of each window, a few windows at a time.

    Parameters
    ----------
    monitor : Monitor
    recordings : iterable of Recording
        Chunks of files; those of one file in order.
    plan : WindowPlan
    linearise : str
        ``"estimate"`` re-linearises every window at its own estimate, ``"nominal"`` stays at θ0 (local approach).
    condense : callable, optional
        From the statistics of all parameters of the monitor to those that the window has; by default everything that is
        not monitored counts as noise.
    apart : bool
        Whether nothing is learnt from one window for the next, so that several processes may share them.

    Yields
    ------
    WindowStatistics

    Raises
    ------
    DataError
        If a recording lacks an input of the engine.
    """
    if linearise not in LINEARISE:
        raise ValueError(f"`linearise` must be one of {', '.join(LINEARISE)}, not {linearise!r}")
    condense = condense or condense_monitored(monitor)
    waiting: deque[list[_WindowPiece]] = deque()
    keeping = RecordSpill()
    counted = each(recordings, "records judged", size=len)
    for complete in cut_windows(monitor, counted, plan, _pieces, lambda pieces: keeping([p.judged for p in pieces])):
        waiting.extend(complete)
        if sum(map(_size, waiting)) >= BATCH_RECORDS * (process_count() if apart else 1):
            yield from _judge_waiting(monitor, waiting, linearise, condense, apart, last=False)
    yield from _judge_waiting(monitor, waiting, linearise, condense, apart, last=True)


def _pieces(
    part: Recording, taken: JudgedInputs, key: Key, blocks: np.ndarray, lags: np.ndarray
) -> Iterator[tuple[int, _WindowPiece]]:
    """One piece per block number of the records of one group in one chunk."""
    # skipped records lengthen the lag of the next one that is judged
    elapsed = np.cumsum(np.where(np.isfinite(lags), lags, 1e9))
    kept = np.flatnonzero(taken.judged)
    lags = np.diff(elapsed[kept], prepend=elapsed[kept[0]] - lags[kept[0]]) if kept.size else lags[:0]
    for i, k in label_runs(blocks):
        mine = slice(*np.searchsorted(kept, [i, k]))
        rows = kept[mine]
        judged = JudgedRecords({c: v[rows] for c, v in taken.inputs.items()}, taken.y[rows], lags[mine])
        yield int(blocks[i]), _WindowPiece(piece_bookkeeping(part, taken, key, slice(i, k)), StoredRecords(judged))


def piece_bookkeeping(part: Recording, taken: JudgedInputs, key: Key, rows: slice) -> WindowStatistics:
    """Bookkeeping of consecutive records of one group, without statistics."""
    time = part.columns.get("time_s", np.full(len(part), np.nan))
    first, last = rows.start, rows.stop - 1
    return WindowStatistics(
        *key,
        int(part.line[first]),
        int(part.line[last]),
        float(time[first]),
        float(time[last]),
        last + 1 - first,
        int(taken.outside[rows].sum()),
        int(taken.incomplete[rows].sum()),
        0,
        None,
        extrapolation=taken.count_extrapolation(rows),
    )


def _judge_waiting(
    monitor: Monitor, waiting: deque[list[_WindowPiece]], linearise: str, condense: Condense, apart: bool, last: bool
) -> Iterator[WindowStatistics]:
    """Statistics of the waiting windows, in order; leaves the last batch in the queue unless no more follows."""
    own = len(monitor.names) / max(len(monitor.sensors), 1)
    batches = list(_batches([*waiting], CALL_RECORDS, own))
    waiting.clear()
    if not last:
        waiting.extend(batches.pop())

    def judged(k: int) -> list[WindowStatistics]:
        return list(_judge_batch(monitor, batches[k], linearise, condense))

    for found in parallel_imap(judged, len(batches)) if apart else map(judged, range(len(batches))):
        yield from found


def _batches(windows: Sequence[list[_WindowPiece]], records: float, own: float) -> Iterator[list[list[_WindowPiece]]]:
    """Windows that follow each other and hold as much as so many records together, each as much as `own` records more
    than it has; one that holds more is by itself."""
    batch: list[list[_WindowPiece]] = []
    size = 0.0
    for window in windows:
        more = _size(window) + own
        if batch and size + more > records:
            yield batch
            batch, size = [], 0.0
        batch.append(window)
        size += more
    if batch:
        yield batch


def _size(pieces: Sequence[_WindowPiece]) -> int:
    """Records of a window that are judged."""
    return sum(piece.judged.count for piece in pieces)


def _window_bookkeeping(monitor: Monitor, pieces: Sequence[_WindowPiece]) -> WindowStatistics:
    """Bookkeeping of a window, with the sensors that gave a reading in a record that was judged, and what was flown."""
    records = WindowRecords([piece.judged for piece in pieces])
    n, m = len(records), len(monitor.sensors)
    seen, sums = np.zeros(m, int), np.zeros(m)
    flown: dict[str, float] = {}
    for first in range(0, n, BATCH_RECORDS):
        part = records.read([(first, min(first + BATCH_RECORDS, n))])
        seen += np.isfinite(part.y).sum(axis=0)
        sums += np.nansum(part.y, axis=0)
        flown = {c: flown.get(c, 0.0) + float(values.sum()) for c, values in part.inputs.items() if c != ELAPSED}
    read = seen > 0
    some = np.unique(np.linspace(0, n - 1, FLOWN).astype(int)) if n else np.zeros(0, int)
    few = records.read([(k, k + 1) for k in some.tolist()])
    return replace(
        join_bookkeeping([piece.window for piece in pieces]),
        sensors=int(read.sum()),
        sensors_of=m,
        conditions={c: total / n for c, total in flown.items()},
        readings=dict(
            zip(np.array(monitor.sensors, object)[read].tolist(), (sums[read] / seen[read]).tolist(), strict=True)
        ),
        sample_inputs=few.inputs,
        sample_readings=few.y,
    )


def _attach_statistics(
    monitor: Monitor, condense: Condense, window: WindowStatistics, statistics: LocalStatistics | None, reason: str = ""
) -> WindowStatistics:
    """The window with its sufficient statistics, or with the reason why it has none."""
    if statistics is None or statistics.n == 0:
        return replace(window, reason=reason or describe_excluded(window))
    if reason:
        return replace(window, reason=reason)
    labelled = replace(
        statistics, start=f"{window.source}:{window.first_line}", end=f"{window.source}:{window.last_line}"
    )
    silent = (name for name in monitor.monitored if _is_silent(monitor, name, statistics))
    return condense(replace(window, silent=tuple(silent)), labelled)


def _is_silent(monitor: Monitor, name: str, statistics: LocalStatistics) -> bool:
    """Whether it is the error of a sensor that gave no reading: its sensitivities are zero, not merely small."""
    i = monitor.names.index(name)
    return monitor.engine.parameters[name].belongs_to_instrument and not statistics.F[i, i]


def _judge_batch(
    monitor: Monitor, batch: Sequence[Sequence[_WindowPiece]], linearise: str, condense: Condense
) -> Iterator[WindowStatistics]:
    """The windows of a batch, which are computed together, or a window that is longer than a batch may be."""
    if len(batch) == 1 and _size(batch[0]) > BATCH_RECORDS:
        whole, records = _window_bookkeeping(monitor, batch[0]), WindowRecords([piece.judged for piece in batch[0]])
        instruments = _scattering_in_long(monitor, records) if linearise == "estimate" else ()
        weighed_monitor = replace(monitor, noise=_inflate_noise(monitor, instruments)) if instruments else monitor
        long = long_statistics(weighed_monitor, records, linearise=linearise, tolerance=SETTLED)
        whole = replace(whole, failed=long.failed, instruments=instruments)
        yield _attach_statistics(monitor, condense, whole, long.statistics, _convergence_reason(long.last_step))
        return
    sizes = [_size(pieces) for pieces in batch]
    every = WindowRecords([piece.judged for pieces in batch for piece in pieces]).read_all
    nominal = nominal_residuals(monitor, every.inputs, every.y, _distinct_records(batch))
    short = _statistics_at_estimate if linearise == "estimate" else _statistics_at_nominal
    judged = iter(short(monitor, nominal, sizes, every.lags))
    first = 0
    for pieces, size in zip(batch, sizes, strict=True):
        rows = slice(first, first + size)
        first += size
        whole = _window_bookkeeping(monitor, pieces)
        if not size:
            yield _attach_statistics(monitor, condense, whole, None)
            continue
        found = next(judged)
        x = None if nominal.x is None else nominal.x[:, rows]
        whole = replace(whole, failed=size - int(found.ok.sum()), solution=x)
        whole = replace(whole, instruments=found.instruments, weights=found.weights)
        yield _attach_statistics(monitor, condense, whole, found.statistics, _convergence_reason(found.last_step))


def _scattering_in_long(monitor: Monitor, records: WindowRecords) -> tuple[InstrumentFault, ...]:
    """Instruments that scatter in runs of the records of a long window."""
    n = len(records)
    spans = [(k, k + RUN) for k in np.linspace(0, n - RUN, SAMPLED).astype(int).tolist()]
    some = records.read(spans)
    lags = np.where(np.arange(len(some)) % RUN == 0, np.inf, some.lags)
    nominal = nominal_residuals(monitor, some.inputs, some.y)
    _, e = next(iter(_linearise(monitor, nominal, [len(some)], lags)))
    found, _ = find_scattering_instruments(monitor, nominal, e, lags)
    return tuple(replace(fault, count=n, records=n) for fault in found)


def _inflate_noise(monitor: Monitor, instruments: Sequence[InstrumentFault]) -> NoiseModel:
    """The noise of a monitor with what its sensors scatter beyond it; that of an input has no place in it."""
    added = {fault.column: fault.size for fault in instruments if not fault.is_input}
    return replace(monitor.noise, sigma=np.hypot(monitor.noise.sigma, [added.get(c, 0.0) for c in monitor.sensors]))


def _distinct_records(batch: Sequence[Sequence[_WindowPiece]]) -> np.ndarray | None:
    """Number of each record of the windows among those that differ (N,); None where windows share none."""
    first: dict[int, int] = {}
    rows, n = [], 0
    for piece in (piece for pieces in batch for piece in pieces):
        if id(piece) not in first:
            first[id(piece)] = n
            n += piece.judged.count
        rows.append(first[id(piece)] + np.arange(piece.judged.count))
    return None if n == sum(map(len, rows)) else np.concatenate(rows)


def _convergence_reason(last_step: float | None) -> str:
    """Why a window whose estimate took so long a last step, in standard errors, has no verdict; None: it converged."""
    if last_step is None:
        return ""
    return f"the re-estimate did not converge (last step {last_step:.2g} standard errors)"


@dataclass(frozen=True)
class ShortWindow:
    """Of a window of n records: its statistics, which can be computed, ok (n,), the last step of an estimate that did
    not converge, the instruments that scatter, and what multiplies its readings for that, (n, m, m)."""

    statistics: LocalStatistics
    ok: np.ndarray
    last_step: float | None = None
    instruments: tuple[InstrumentFault, ...] = ()
    weights: np.ndarray | None = None


def _statistics_at_nominal(
    monitor: Monitor, nominal: NominalResiduals, sizes: Sequence[int], lags: np.ndarray
) -> Iterator[ShortWindow]:
    """Of each window that holds records; sizes (W,)."""
    bounds = np.cumsum([0, *filter(None, sizes)])
    for block, (first, stop) in zip(_blocks(monitor, nominal.e, nominal.J, sizes, lags), pairwise(bounds), strict=True):
        yield ShortWindow(block.statistics, nominal.ok[first:stop])


def _statistics_at_estimate(
    monitor: Monitor, nominal: NominalResiduals, sizes: Sequence[int], lags: np.ndarray
) -> Iterator[ShortWindow]:
    """As `_at_nominal`; all windows are re-linearised together, and those in which an instrument scatters once more
    with its readings weighed by that."""
    first = 0
    for short, e in _linearise(monitor, nominal, sizes, lags):
        rows = slice(first, first + len(e))
        first += len(e)
        here = nominal.select(rows)
        instruments, weight = find_scattering_instruments(monitor, here, e, lags[rows])
        if weight is None:
            yield short
            continue
        again, _ = next(iter(_linearise(monitor, here, [len(e)], lags[rows], weight)))
        yield replace(again, instruments=instruments, weights=weight)


def find_scattering_instruments(
    monitor: Monitor, nominal: NominalResiduals, e: np.ndarray, lags: np.ndarray
) -> tuple[tuple[InstrumentFault, ...], np.ndarray | None]:
    """Instruments that scatter in the records of one window, e (n, m) their residuals at its estimate, and the weights
    (n, m, m) of their readings."""
    engine, noise, sensors = monitor.engine, monitor.noise, monitor.sensors
    columns = [c for c in engine.inputs if suspected(engine, c) is not None and c in nominal.inputs]

    @cache
    def effects() -> np.ndarray:
        found = engine.predict(nominal.inputs, monitor.base, sensors=sensors, wrt=tuple(columns))
        unit = np.broadcast_to(np.eye(len(sensors)), (len(e), len(sensors), len(sensors)))
        return np.concatenate([unit, np.asarray(found.jacobian)], axis=2)

    def nominal_variance() -> np.ndarray:
        J, known = nominal.J, monitor
        if monitor.uncertain_monitor is not None:
            known = monitor.uncertain_monitor
            J = known.predict(nominal.inputs, known.theta0)[1]
        J = np.diff(J, axis=0)
        return np.asarray(np.sum((J @ known.uncertainty) * J, axis=2))

    found = find_scatter(e, nominal.predicted, noise, lags, effects, nominal_variance)
    if not found:
        return (), None
    names = (*sensors, *columns)
    faults = []
    for one in found:
        sigma = noise.sigma[one.instrument] if one.instrument < len(sensors) else np.nan
        of_input = one.instrument >= len(sensors)
        column = names[one.instrument]
        values = nominal.inputs[column] if of_input else nominal.y[:, one.instrument]
        times = float(np.sqrt(1 + (one.size / sigma) ** 2))
        count = int(np.isfinite(values).sum())
        fault = InstrumentFault(column, NOISE, of_input, one.size, one.probability, times, count, count)
        faults.append(fault)
    return tuple(faults), scatter_weights(np.isfinite(e), noise, effects(), found)


def _linearise(
    monitor: Monitor,
    nominal: NominalResiduals,
    sizes: Sequence[int],
    lags: np.ndarray,
    weight: np.ndarray | None = None,
) -> Iterator[tuple[ShortWindow, np.ndarray]]:
    """Windows that hold records at their own estimates, with their residuals (n, m) there; weight (N, m, m): what
    multiplies readings and predictions."""
    if not len(nominal.y):
        return
    bent = monitor.curvature if isinstance(monitor, ReducedMonitor) else None
    some = np.array(sizes)[np.array(sizes) > 0]

    def predict(theta: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        here = {c: values[rows] for c, values in nominal.inputs.items()}
        start = None if nominal.x is None else nominal.x[:, rows]
        y, J, ok, _ = monitor.predict(here, theta, nuisance=False, start=start)
        mine = None if weight is None else weight[rows]
        return apply_weights(mine, y), apply_weights(mine, J), ok

    found = relinearise(
        predict,
        apply_weights(weight, nominal.y),
        monitor.hold,
        monitor.noise,
        window=np.repeat(np.arange(len(some)), some),
        nominal=(apply_weights(weight, nominal.predicted), apply_weights(weight, nominal.J), nominal.ok),
        stop=Stop(neglected=bent.neglected_error if bent else None, tolerance=SETTLED),
    )
    first = 0
    for w, block in enumerate(_blocks(monitor, found.e, found.J, sizes, lags, found.information)):
        rows = slice(first, first + some[w])
        first += some[w]
        statistics = block.statistics
        if monitor.slopes is not None:
            points = point_sums(
                nominal.predicted[rows], found.e[rows], found.J[rows], monitor.noise, monitor.slopes.position
            )
            statistics = replace(statistics, points=points)
        settled = found.converged[w] or statistics.n == 0
        yield ShortWindow(statistics, found.ok[rows], None if settled else float(found.decrement[w])), found.e[rows]


def _blocks(
    monitor: Monitor,
    e: np.ndarray,
    J: np.ndarray,
    sizes: Sequence[int],
    lags: np.ndarray,
    information: np.ndarray | None = None,
) -> Iterator[StatisticsBlock]:
    """Statistics of the windows that hold so many records, those without excluded; of short windows together."""
    some = np.array(sizes)[np.array(sizes) > 0]
    starts = np.cumsum(some) - some
    first = 0
    while first < len(some):
        last = max(int(np.searchsorted(starts + some, starts[first] + TOGETHER, side="right")), first + 1)
        rows = slice(starts[first], starts[last - 1] + some[last - 1])
        yield from block_statistics(
            e[rows],
            J[rows],
            monitor.noise,
            starts[first:last] - starts[first],
            monitor.frame,
            lags=lags[rows],
            information=None if information is None else information[first:last],
        )
        first = last
