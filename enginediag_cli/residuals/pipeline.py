"""From recordings to local statistics, window by window, in constant memory.

recording → groups (file, flight, engine) → records that can be judged → blocks → windows → statistics.
A record outside the operating points that identification saw, or without its inputs, is counted, not judged.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from operator import add

import numpy as np

from enginediag_cli.engine.batch import SHARE
from enginediag_cli.error_model.slopes import COMMON
from enginediag_cli.progress import each
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.admission import JudgedChunk
from enginediag_cli.residuals.blocks import Block
from enginediag_cli.residuals.cut import cut
from enginediag_cli.residuals.groups import Key, runs
from enginediag_cli.residuals.local import block_statistics
from enginediag_cli.residuals.monitor import HELD, Monitor
from enginediag_cli.residuals.operating_points import covariance_of_change, sums_by_point
from enginediag_cli.residuals.reduced import ReducedMonitor
from enginediag_cli.residuals.relinearise import Relinearised, Stop, relinearise
from enginediag_cli.residuals.score import marginalise
from enginediag_cli.residuals.statistics import LocalStatistics
from enginediag_cli.residuals.window import WindowStatistics, joined, nothing_judged
from enginediag_cli.residuals.windows import WindowPlan
from enginediag_cli.side_by_side import in_turn, jobs, processes

LINEARISE = ("estimate", "nominal")
BATCH_RECORDS = 3_000
"""Windows wait for each other until they hold this many records, and are then re-linearised together: one call of the
engine costs less than many. More would save little and hold sensitivities to a hundred parameters of each."""
FLOWN = 12
"""Records of a window by which it is known where it was flown: a climb and a cruise have their corners among them."""
SETTLED = 0.2
"""Step of the re-estimate, in standard errors, that is not worth another call of the engine: what it leaves out of
the statistics is of second order in it."""

TOGETHER = 500
"""Records of short windows whose statistics are summed by one pass: for each of twenty records the calls would cost
more than the arithmetic, for more memory would."""


@dataclass(frozen=True)
class _Piece:
    """Consecutive records of one block: bookkeeping, and the judged ones as a sum or as they are."""

    window: WindowStatistics
    block: Block | None
    inputs: Mapping[str, np.ndarray]
    y: np.ndarray
    lags: np.ndarray


Condense = Callable[[WindowStatistics, LocalStatistics], WindowStatistics]
"""condense(window, statistics of all parameters) -> the window with statistics, or with a reason for none."""


def monitored_only(monitor: Monitor) -> Condense:
    """The monitored parameters, with everything uncertain about nominal and sensors counted as noise."""

    def condense(window: WindowStatistics, statistics: LocalStatistics) -> WindowStatistics:
        return replace(window, statistics=condensed(monitor, statistics, monitor.uncertainty))

    return condense


def condensed(monitor: Monitor, statistics: LocalStatistics, uncertainty: np.ndarray) -> LocalStatistics:
    """Statistics of the monitored parameters with `uncertainty` (p, p) counted as noise, and what wrong slopes of the
    maps may make of the change that they speak of. That is the change which the engine would have to show, no
    instrument being wrong."""
    found = marginalise(statistics, monitor.monitored, uncertainty)
    if monitor.slopes is None:
        return replace(found, points=None)
    engine = np.array([not monitor.meaning[name].of_instrument for name in monitor.monitored])
    spread = np.where(engine, HELD * found.prior_sigma, 0.0)
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
    """Statistics of each window, a few windows at a time; chunks of one file come in order.

    linearise: "estimate" re-linearises every window at its own estimate, "nominal" stays at θ0 as the paper
    does. condense: from the statistics of all parameters of the monitor to those that the window hands over;
    default: everything that is not monitored counts as noise. apart: that learns nothing from one window for the next,
    so that several processes may share them. Raises DataError when a recording lacks an input of the engine.
    """
    if linearise not in LINEARISE:
        raise ValueError(f"`linearise` must be one of {', '.join(LINEARISE)}, not {linearise!r}")
    condense = condense or monitored_only(monitor)
    waiting: deque[list[_Piece]] = deque()
    counted = each(recordings, "records judged", size=len)
    for complete in cut(monitor, counted, plan, partial(_pieces, monitor), at_nominal=linearise == "nominal"):
        waiting.extend(complete)
        if sum(map(_size, waiting)) >= BATCH_RECORDS * (jobs() if apart else 1):
            yield from _finished(monitor, waiting, linearise, condense, apart)
    yield from _finished(monitor, waiting, linearise, condense, apart)


def _pieces(
    monitor: Monitor, part: Recording, chunk: JudgedChunk, key: Key, blocks: np.ndarray, lags: np.ndarray
) -> Iterator[tuple[int, _Piece]]:
    """One piece per block number of the records of one group in one chunk."""
    inputs, y, judged = chunk.taken.inputs, chunk.taken.y, chunk.taken.judged
    # skipped records lengthen the lag of the next one that is judged
    elapsed = np.cumsum(np.where(np.isfinite(lags), lags, 1e9))
    kept = np.flatnonzero(judged)
    lags = np.diff(elapsed[kept], prepend=elapsed[kept[0]] - lags[kept[0]]) if kept.size else lags[:0]
    sums: dict[int, Block] = {}
    if chunk.e is not None and chunk.J is not None and kept.size:
        starts = np.array([i for i, _ in runs(blocks[kept])])
        found = block_statistics(chunk.e[kept], chunk.J[kept], monitor.noise, starts, monitor.frame, lags=lags)
        sums = dict(zip(blocks[kept][starts].tolist(), found, strict=True))
    for i, k in runs(blocks):
        number = int(blocks[i])
        window = place(part, chunk, key, slice(i, k))
        mine = slice(*np.searchsorted(kept, [i, k]))
        rows = kept[mine]
        yield (
            number,
            _Piece(window, sums.get(number), {c: v[rows] for c, v in inputs.items()}, y[rows], lags[mine]),
        )


def place(part: Recording, chunk: JudgedChunk, key: Key, rows: slice) -> WindowStatistics:
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
        int(chunk.taken.outside[rows].sum()),
        int(chunk.taken.incomplete[rows].sum()),
        int(chunk.failed[rows].sum()),
        None,
        elsewhere=chunk.taken.elsewhere(rows),
    )


def _finished(
    monitor: Monitor, waiting: deque[list[_Piece]], linearise: str, condense: Condense, apart: bool
) -> Iterator[WindowStatistics]:
    """Statistics of the waiting windows, in order; empties the queue."""
    windows = [*waiting]
    waiting.clear()
    if linearise == "nominal":
        yield from (_at_nominal(monitor, condense, pieces) for pieces in windows)
        return
    records = sum(map(_size, windows))
    share = records / processes(records // SHARE) if apart else records
    batches = list(_batches(windows, min(BATCH_RECORDS, max(share, SHARE))))

    def judged(k: int) -> list[WindowStatistics]:
        return list(_at_estimate(monitor, batches[k], condense))

    for found in in_turn(judged, len(batches)) if apart else map(judged, range(len(batches))):
        yield from found


def _batches(windows: Sequence[list[_Piece]], records: float) -> Iterator[list[list[_Piece]]]:
    """Windows that follow each other and hold so many records together, or just more."""
    batch: list[list[_Piece]] = []
    size = 0
    for window in windows:
        batch.append(window)
        size += _size(window)
        if size >= records:
            yield batch
            batch, size = [], 0
    if batch:
        yield batch


def _size(pieces: Sequence[_Piece]) -> int:
    """Records of a window that are judged."""
    return sum(len(piece.y) for piece in pieces)


def _whole(monitor: Monitor, pieces: Sequence[_Piece]) -> WindowStatistics:
    """Bookkeeping of a window, with the sensors that gave a reading in a record that was judged, and what was flown."""
    y = np.concatenate([piece.y for piece in pieces])
    seen = np.isfinite(y)
    read = seen.any(axis=0)
    means = np.where(seen, y, 0.0).sum(axis=0)[read] / seen.sum(axis=0)[read]
    flown = {c: np.concatenate([piece.inputs[c] for piece in pieces]) for c in pieces[0].inputs}
    some = np.unique(np.linspace(0, len(y) - 1, FLOWN).astype(int)) if len(y) else np.zeros(0, int)
    return replace(
        joined([piece.window for piece in pieces]),
        sensors=int(read.sum()),
        sensors_of=len(read),
        conditions={c: float(values.mean()) for c, values in flown.items() if len(values)},
        readings=dict(zip(np.array(monitor.sensors, object)[read].tolist(), means.tolist(), strict=True)),
        flown={c: values[some] for c, values in flown.items()},
    )


def _with_statistics(
    monitor: Monitor,
    condense: Condense,
    window: WindowStatistics,
    statistics: LocalStatistics | None,
    reason: str = "",
) -> WindowStatistics:
    """The window with its condensed statistics, or with the reason why it has none."""
    if statistics is None or statistics.n == 0:
        return replace(window, reason=reason or nothing_judged(window))
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
    return monitor.engine.parameters[name].of_instrument and not statistics.F[i, i]


def _at_nominal(monitor: Monitor, condense: Condense, pieces: Sequence[_Piece]) -> WindowStatistics:
    blocks = [piece.block for piece in pieces if piece.block is not None]
    return _with_statistics(
        monitor, condense, _whole(monitor, pieces), reduce(add, blocks).statistics if blocks else None
    )


def _at_estimate(monitor: Monitor, batch: Sequence[Sequence[_Piece]], condense: Condense) -> Iterator[WindowStatistics]:
    """Re-linearise all windows of a batch together."""
    sizes = [_size(pieces) for pieces in batch]
    window = np.repeat(np.cumsum(np.array(sizes) > 0) - 1, sizes)
    every = [piece for pieces in batch for piece in pieces]
    inputs = {c: np.concatenate([piece.inputs[c] for piece in every]) for c in every[0].inputs}
    y, lags = np.concatenate([p.y for p in every]), np.concatenate([p.lags for p in every])

    bent = monitor.curvature if isinstance(monitor, ReducedMonitor) else None
    *nominal, prediction = monitor.predict(inputs, monitor.theta0)
    # a fault is hypothesised with the errors of the maps where nominal has the machines: see `error_model.modelled`
    inputs = {**inputs, **getattr(prediction, "frozen", {})}
    x = getattr(prediction, "x", None)  # unknowns of the engine, from which the next solution is near

    def predict(theta: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        here = {c: values[rows] for c, values in inputs.items()}
        start = None if x is None else x[:, rows]
        return monitor.predict(here, theta, nuisance=False, start=start)[:3]

    found = (
        relinearise(
            predict,
            y,
            monitor.hold,
            monitor.noise,
            window=window,
            nominal=(nominal[0], nominal[1], nominal[2]),
            stop=Stop(left_out=bent.left_out if bent else None, tolerance=SETTLED),
        )
        if len(y)
        else None
    )
    every_block = iter(_blocks(monitor, found, sizes, lags) if found is not None else ())
    first = 0
    for pieces, size in zip(batch, sizes, strict=True):
        rows = slice(first, first + size)
        first += size
        if found is None or size == 0:
            yield _with_statistics(monitor, condense, _whole(monitor, pieces), None)
            continue
        failed = int(np.sum(~found.ok[rows]))
        whole = replace(_whole(monitor, pieces), failed=failed, solution=None if x is None else x[:, rows])
        w = int(window[rows.start])
        statistics = next(every_block).statistics
        if monitor.slopes is not None:
            of_points = sums_by_point(
                nominal[0][rows], found.e[rows], found.J[rows], monitor.noise, monitor.slopes.position
            )
            statistics = replace(statistics, points=of_points)
        reason = (
            ""
            if found.converged[w] or statistics.n == 0
            else (f"the re-estimate did not converge (last step {found.decrement[w]:.2g} standard errors)")
        )
        yield _with_statistics(monitor, condense, whole, statistics, reason)


def _blocks(monitor: Monitor, found: Relinearised, sizes: Sequence[int], lags: np.ndarray) -> Iterator[Block]:
    """Statistics of the windows that hold so many records, those without left out; of short windows together."""
    some = np.array(sizes)[np.array(sizes) > 0]
    starts = np.cumsum(some) - some
    first = 0
    while first < len(some):
        last = max(int(np.searchsorted(starts + some, starts[first] + TOGETHER, side="right")), first + 1)
        rows = slice(starts[first], starts[last - 1] + some[last - 1])
        yield from block_statistics(
            found.e[rows],
            found.J[rows],
            monitor.noise,
            starts[first:last] - starts[first],
            monitor.frame,
            lags=lags[rows],
            information=found.information[first:last],
        )
        first = last
