"""Gross errors are removed from recordings on their way to windows, and counted for reports.

`GrossErrorGate` stands between what is read and whatever reads windows, so that statistics, the nonlinear model of
isolation and reports see the same readings. `GrossCounts` is what it found of a window.

`LiveGate` does so for a flight that is still being recorded, and for instruments that are stuck. It decides what is
judged again with each block that follows, and what is final; the rules for single readings are those of whole
recordings.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from enginediag_cli.engine.instrument_errors import ELAPSED
from enginediag_cli.engine.wrapped import MonitoredModel
from enginediag_cli.identification.gross_errors import (
    AROUND,
    BLOCK,
    FEWEST,
    HALO,
    LEAST,
    UNKNOWN,
    UNRELATED,
    GrossErrors,
    ResidualStretch,
    find_gross_errors,
    may_have_gross_errors,
)
from enginediag_cli.intake.loader import EXCURSION, ExcludedData, GrossCounts
from enginediag_cli.recordings.repeated import StuckRun, append_runs, extend_to_runs, label_runs, list_stuck_runs
from enginediag_cli.recordings.table import Recording, concat
from enginediag_cli.residuals.instruments import (
    SPAN,
    InstrumentFault,
    NoiseModel,
    apply_weights,
    find_stuck_faults,
    find_stuck_inputs,
    find_stuck_outputs,
)
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.pipeline import find_scattering_instruments
from enginediag_cli.residuals.windows import (
    Key,
    NominalResiduals,
    Timeline,
    WindowStatistics,
    group_rows,
    select_inputs,
)

NOTES = 10_000
"""Records of one window with gross errors that are remembered each by itself, some megabytes; of more in pairs."""


@dataclass(frozen=True)
class _PendingRecords:
    """Records that wait for what follows them, with residuals e (N, m) at nominal, what is predicted y (N, m), which
    are judged (N,), and the engine's unknowns x (nx, N) where it shows them."""

    recording: Recording
    inputs: Mapping[str, np.ndarray]
    e: np.ndarray
    y: np.ndarray
    judged: np.ndarray
    x: np.ndarray | None

    def __len__(self) -> int:
        return len(self.recording)

    def select(self, rows: slice) -> _PendingRecords:
        x = None if self.x is None else self.x[:, rows]
        inputs = {c: v[rows] for c, v in self.inputs.items()}
        return _PendingRecords(self.recording.select(rows), inputs, self.e[rows], self.y[rows], self.judged[rows], x)


def _join_pending(parts: Sequence[_PendingRecords]) -> _PendingRecords:
    if len(parts) == 1:
        return parts[0]
    x = [part.x for part in parts if part.x is not None]
    return _PendingRecords(
        concat([part.recording for part in parts]),
        {c: np.concatenate([part.inputs[c] for part in parts]) for c in parts[0].inputs},
        np.concatenate([part.e for part in parts]),
        np.concatenate([part.y for part in parts]),
        np.concatenate([part.judged for part in parts]),
        np.concatenate(x, axis=1) if len(x) == len(parts) else None,
    )


class GrossErrorGate:
    """Recordings on their way to windows, without their gross errors: a gross reading is missing, a record with a wrong
    input has no reading. Judged in blocks of `BLOCK` records of a file, counted from its start, so that nothing depends
    on the chunks in which they come."""

    def __init__(self, monitor: Monitor):
        self.monitor = monitor
        self._found: dict[Key, list[tuple[int, GrossCounts]]] = {}
        self._total: dict[tuple[str, str], GrossCounts] = {}
        self._stuck: dict[tuple[str, str], list[StuckRun]] = {}
        self._alone: set[Key] = set()
        self._waiting: list[_PendingRecords] = []
        self._before = self._after = 0

    def clean(self, recordings: Iterable[Recording]) -> Iterator[Recording]:
        """The recordings (chunks of files in turn) as they are judged."""
        for chunk in recordings:
            if self._waiting and not _same_layout(self._waiting[-1].recording, chunk):
                yield from self._end()
            self._waiting.append(self._predicted(chunk))
            self._after += len(chunk)
            while self._after > BLOCK + HALO:
                yield self._judge(BLOCK)
        yield from self._end()

    def annotate(self, window: WindowStatistics, masked: Iterable[StuckRun] = ()) -> WindowStatistics:
        """The window with what was rejected of its records, and the instruments that are stuck in it; masked: the runs
        of readings that were stuck by themselves. Windows of a flight are requested in turn: what lies before this one
        is forgotten."""
        key = (window.source, window.flight, window.engine)
        lines = (window.first_line, window.last_line)
        runs = [*masked, *self._stuck.get((window.source, window.engine), ())]
        stuck = tuple(find_stuck_faults(runs, self.monitor.engine.inputs, lines, window.records))
        window = replace(window, instruments=(*stuck, *window.instruments))
        wrong = {fault.instrument for fault in window.instruments}
        silent = [name for name, p in self.monitor.meaning.items() if p.belongs_to_instrument and p.component in wrong]
        window = replace(window, silent=tuple(dict.fromkeys((*window.silent, *silent))))
        blind = [fault.column for fault in stuck if fault.is_input]
        if window.statistics is None and blind:
            window = replace(window, reason=f"{', '.join(dict.fromkeys(blind))} is stuck: the model has no input")
        judged = window.records - window.outside - window.incomplete - window.failed
        window = replace(window, checked=key not in self._alone)
        found = [(line, counts) for line, counts in self._found.get(key, ()) if line >= window.first_line]
        if not found:
            return replace(window, gross=GrossCounts(judged=judged))
        self._found[key] = found
        mine = sum((c for line, c in found if line <= window.last_line), GrossCounts(judged=judged))
        return replace(window, gross=mine)

    def report(self, left_out: Iterable[ExcludedData]) -> None:
        """Add what was rejected to what was excluded of each engine; all of `left_out` are of files that came by their
        whole names, or of the one file that came."""
        left_out = list(left_out)
        alone = len({source for source, _ in self._total}) == len({left.file for left in left_out}) == 1
        for left in left_out:
            for (source, engine), counts in self._total.items():
                if (source == left.file or alone) and left.engine in ("", engine):
                    left.gross = left.gross + counts
            for (source, engine), runs in self._stuck.items():
                if source == left.file and left.engine in ("", engine):
                    left.add_stuck(runs)
        self._total, self._stuck = {}, {}

    def _end(self) -> Iterator[Recording]:
        if self._waiting:
            if self._after or not self._before:
                yield self._judge(self._after)
            self._waiting, self._before, self._after = [], 0, 0

    def _predicted(self, chunk: Recording) -> _PendingRecords:
        monitor = self.monitor
        taken = select_inputs(monitor, chunk)
        e, level = np.full(taken.y.shape, np.nan), np.zeros(taken.y.shape)
        rows, x = np.flatnonzero(taken.judged), None
        if rows.size:
            inputs = {c: v[rows] for c, v in taken.inputs.items()}
            y, _, ok, prediction = monitor.predict(inputs, monitor.theta0, nuisance=False)
            e[rows] = np.where(ok[:, None], taken.y[rows] - y, np.nan)
            level[rows] = np.where(ok[:, None], y, 0.0)
            found = getattr(prediction, "x", None)
            if found is not None:
                x = np.zeros((len(found), len(chunk)))
                x[:, rows] = found
        return _PendingRecords(chunk, taken.inputs, e, level, taken.judged & np.isfinite(e).any(axis=1), x)

    def _judge(self, size: int) -> Recording:
        """The next `size` records, judged; `_before` records stand before them in what waits."""
        held = _join_pending(self._waiting)
        context = held.select(slice(0, min(len(held), self._before + size + HALO)))
        block = slice(self._before, self._before + size)
        stretches = list(_stretches(self.monitor, context))
        for at, keys, *_ in stretches:
            for key, n in Counter(keys[k] for k in np.flatnonzero((at >= block.start) & (at < block.stop))).items():
                self._add(key, GrossCounts(judged=n))
            if len(at) < FEWEST:
                self._alone.update(keys)
        context = self._remove_stuck(context, stretches, block)
        clean = self._remove_gross(context, stretches, block)
        first = max(0, block.stop - HALO)
        self._waiting = [held.select(slice(first, None))]
        self._before, self._after = block.stop - first, self._after - size
        return clean

    def _remove_stuck(
        self,
        context: _PendingRecords,
        stretches: list[tuple[np.ndarray, list[Key], np.ndarray, np.ndarray]],
        block: slice,
    ) -> _PendingRecords:
        """The records of the context without readings that are stuck, and none of records with a stuck input."""
        monitor, own = self.monitor, context.recording
        gone = np.zeros(context.e.shape, bool)
        for at, keys, *_ in stretches:
            readings = np.column_stack([own.columns.get(c, np.full(len(own), np.nan))[at] for c in monitor.sensors])
            inputs = {c: v[at] for c, v in context.inputs.items()}
            recorded = [c for c in monitor.engine.inputs if c in own]
            gone[at], masks = find_stuck_readings(monitor, inputs, recorded, readings, context.e[at], context.y[at])
            for column, mask in masks.items():
                source, _, engine = keys[0]
                rows = np.sort(np.concatenate([rows for key, rows in group_rows(own) if key[2] == engine]))
                # records that cannot be judged, where a stuck input has led perhaps, belong to the run as well
                whole = extend_to_runs(own[column][rows], np.isin(rows, at[mask]))
                inside = (rows >= block.start) & (rows < block.stop)
                mine = rows[inside]
                runs = list_stuck_runs(column, own[column][mine], own.line[mine], whole[inside])
                append_runs(self._stuck.setdefault((source, engine), []), runs)
        if not gone.any():
            return context
        columns = {c: np.where(gone[:, j], np.nan, own[c]) for j, c in enumerate(monitor.sensors) if c in own}
        return replace(context, recording=own.with_columns(columns), e=np.where(gone, np.nan, context.e))

    def _remove_gross(
        self,
        context: _PendingRecords,
        stretches: list[tuple[np.ndarray, list[Key], np.ndarray, np.ndarray]],
        block: slice,
    ) -> Recording:
        """The records of the block without what is gross in the stretches of the context."""
        monitor, own = self.monitor, context.recording.select(block)
        recorded = tuple(c for c in context.inputs if c in context.recording and c != ELAPSED)
        sigma = monitor.noise.sigma
        suspects = [
            s
            for s in stretches
            if may_have_gross_errors(context.e[s[0]] / sigma, context.y[s[0]] / sigma, monitor.noise.rho)
        ]
        if not suspects:
            return own
        rows = np.concatenate([s[0] for s in suspects])
        start = None if context.x is None else context.x[:, rows]
        _, J, _, _ = monitor.predict({c: v[rows] for c, v in context.inputs.items()}, monitor.theta0, start=start)
        readings = np.zeros(context.e.shape, bool)
        records = np.zeros(len(context), bool)
        first = 0
        for at, keys, lags, time in suspects:
            stretch = ResidualStretch(
                context.e[at] / sigma,
                np.nan_to_num(J[first : first + len(at)] / sigma[:, None]),
                context.y[at] / sigma,
                lags,
                time,
                monitor.precision,
                monitor.noise.rho,
                lambda some, at=at: input_effects(monitor, context.inputs, at[some], recorded),  # type: ignore[misc]
            )
            first += len(at)
            found = find_gross_errors(stretch)
            readings[at], records[at] = found.readings, found.records
            mine = (at >= block.start) & (at < block.stop)
            self._remember(context.recording.line[at], keys, found, mine, recorded)
        gone = (readings | records[:, None])[block]
        columns = {}
        for j, column in enumerate(monitor.sensors):
            if column in own and gone[:, j].any():
                columns[column] = np.where(gone[:, j], np.nan, own[column])
        return own.with_columns(columns) if columns else own

    def _remember(
        self, line: np.ndarray, keys: list[Key], found: GrossErrors, mine: np.ndarray, inputs: tuple[str, ...]
    ) -> None:
        """Note what was rejected of those records of a stretch that are `mine` (n,)."""
        sensors = self.monitor.sensors
        spoilt = [c for c, bad in zip(sensors, found.mostly_gross, strict=True) if bad]
        for k, counts in count_rejected(found, line, mine, sensors, inputs):
            self._note(keys[k], int(line[k]), counts)
        last = {keys[k]: int(line[k]) for k in np.flatnonzero(mine)} if spoilt else {}
        for key, at in last.items():
            self._note(key, at, GrossCounts(spoilt=spoilt))

    def _note(self, key: Key, line: int, counts: GrossCounts) -> None:
        mine = self._found.setdefault(key, [])
        mine.append((line, counts))
        if len(mine) > NOTES:  # of a window so long nobody asks for single records
            pairs = zip(mine[::2], mine[1::2], strict=False)
            self._found[key] = [(line, a + b) for (_, a), (line, b) in pairs] + mine[len(mine) // 2 * 2 :]
        self._add(key, replace(counts, judged=0))

    def _add(self, key: Key, counts: GrossCounts) -> None:
        place = (key[0], key[2])
        self._total[place] = self._total.get(place, GrossCounts()) + counts


def find_stuck_readings(
    monitor: Monitor,
    inputs: Mapping[str, np.ndarray],
    recorded: Sequence[str],
    readings: np.ndarray,
    e: np.ndarray,
    y: np.ndarray,
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Readings (n, m) of records in a row that are of no use, since they or an input are stuck, and which records (n,)
    each such column is stuck in. inputs: column → (n,), of which some are `recorded`; e, y (n, m): residuals and what
    is predicted."""
    sigma, still = monitor.noise.sigma, _constant_inputs(monitor)
    gone = find_stuck_outputs(np.where(np.isfinite(e), readings, np.nan), y / sigma)
    masks = {c: gone[:, j].copy() for j, c in enumerate(monitor.sensors) if gone[:, j].any()}

    def free(column: str, rows: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        here = {c: v[rows] for c, v in inputs.items()} | {column: values}
        found = monitor.engine.predict(here, monitor.base, sensors=monitor.sensors, wrt=(column,))
        known = np.where(np.asarray(found.ok)[:, None], e[rows] + y[rows] - found.y, np.nan)
        return known / sigma, -np.asarray(found.jacobian)[:, :, 0] / sigma

    moving = {c: inputs[c] for c in recorded if c not in still}
    for column, mask in find_stuck_inputs(np.where(gone, np.nan, e / sigma), moving, free).items():
        masks[column] = mask
        gone[mask] = True
    return gone, masks


def input_effects(
    monitor: Monitor, inputs: Mapping[str, np.ndarray], rows: np.ndarray, columns: Sequence[str]
) -> np.ndarray:
    """What an error of each input of `columns` does to each reading of some records, over σ: (n, m, q)."""
    here = {c: v[rows] for c, v in inputs.items()}
    found = monitor.engine.predict(here, monitor.base, sensors=monitor.sensors, wrt=columns)
    return np.asarray(found.jacobian) / monitor.noise.sigma[:, None]


def _same_layout(a: Recording, b: Recording) -> bool:
    """Whether chunks belong to one file and have the same columns."""
    return a.source == b.source and set(a.columns) == set(b.columns) and set(a.text) == set(b.text)


def _constant_inputs(monitor: Monitor) -> frozenset[str]:
    """Inputs that never moved in what the engine was identified on: a setting, which goes on standing still."""
    if monitor.envelope is None:
        return frozenset()
    spread = np.ptp(np.asarray(monitor.envelope.points), axis=0)
    return frozenset(c for c, s in zip(monitor.envelope.inputs, spread, strict=True) if not s > 0)


def _stretches(
    monitor: Monitor, context: _PendingRecords
) -> Iterator[tuple[np.ndarray, list[Key], np.ndarray, np.ndarray]]:
    """Records that are judged together: their rows (n,), the flight of each, lags (n,) and times (n,) in s. A flight
    alone, or short flights of an engine one after the other."""
    short: dict[str, list[tuple[Key, np.ndarray, np.ndarray, np.ndarray]]] = {}
    for key, rows in group_rows(context.recording):
        judged = context.judged[rows]
        at = rows[judged]
        if not at.size:
            continue
        part = context.recording.columns.get("time_s")
        time = np.full(len(rows), np.nan) if part is None else part[rows]
        _, lags = Timeline().advance(len(rows), time if np.isfinite(time).all() else None, False)
        elapsed = np.cumsum(np.where(np.isfinite(lags), lags, UNRELATED))[judged]
        lags = np.diff(elapsed, prepend=-np.inf)
        lags = np.where(lags >= UNRELATED, np.inf, lags)
        if len(at) >= LEAST:
            yield at, [key] * len(at), lags, time[judged]
        else:
            short.setdefault(key[2], []).append((key, at, lags, time[judged]))
    for flights in short.values():
        yield (
            np.concatenate([at for _, at, _, _ in flights]),
            [key for key, at, _, _ in flights for _ in at],
            np.concatenate([lags for *_, lags, _ in flights]),
            np.concatenate([time for *_, time in flights]),
        )


HISTORY = 40
"""Records with which new ones are compared: enough for a running median, and a fit that a few do not bend."""


@dataclass(frozen=True)
class LiveRecords:
    """n records of a flight as they come: inputs, column → (n,); what was read (n, m); residuals e (n, m), NaN where
    there is no reading, and sensitivities J (n, m, …), the first p those of the monitor; predicted y (n, m); lags (n,);
    time (n,) in s; line (n,)."""

    inputs: Mapping[str, np.ndarray]
    read: np.ndarray
    e: np.ndarray
    J: np.ndarray
    y: np.ndarray
    lags: np.ndarray
    time: np.ndarray
    line: np.ndarray

    def __len__(self) -> int:
        return len(self.e)

    def select(self, rows: slice) -> LiveRecords:
        """Some of the records."""
        inputs = {c: v[rows] for c, v in self.inputs.items()}
        return LiveRecords(inputs, *(getattr(self, name)[rows] for name in _ARRAYS))

    @staticmethod
    def join(parts: Sequence[LiveRecords]) -> LiveRecords:
        """Records one part after the other."""
        inputs = {c: np.concatenate([part.inputs[c] for part in parts]) for c in parts[0].inputs}
        return LiveRecords(inputs, *(np.concatenate([getattr(part, name) for part in parts]) for name in _ARRAYS))


_ARRAYS = ("read", "e", "J", "y", "lags", "time", "line")


@dataclass(frozen=True)
class CleanBlocks:
    """Blocks of a flight without gross readings, in order: `closed` ones are decided for good, `open` ones will be
    judged anew with what follows them. rejected: what was rejected of each, of the closed ones first; instruments:
    those that are stuck or scatter, as far as the flight has come."""

    closed: Sequence[LiveRecords] = ()
    open: Sequence[LiveRecords] = ()
    rejected: Sequence[GrossCounts] = ()
    instruments: Sequence[InstrumentFault] = ()


class LiveGate:
    """Gross errors, and instruments that are stuck or scatter, of one flight that is still going on. A reading that
    departs may be a gross error or the start of a change, and of a flight that has just begun nobody can say which
    readings are right: so a block is judged anew with each that follows, until the running median of its last record is
    complete and `HISTORY` records are known."""

    def __init__(self, monitor: Monitor, recorded: Sequence[str]):
        self.monitor, self.recorded = monitor, tuple(recorded)
        self._before: list[LiveRecords] = []
        self._open: list[LiveRecords] = []
        self._stuck: list[StuckRun] = []
        self._noisy: dict[str, InstrumentFault] = {}
        self._first_line = self._records = 0
        self.masked: Sequence[StuckRun] = ()
        self._low, self._high = np.full(len(monitor.sensors), np.inf), np.full(len(monitor.sensors), -np.inf)

    def add(self, new: LiveRecords) -> CleanBlocks:
        """The blocks that were open, and this new one, the last."""
        blocks = [*self._open, new]
        whole = known = LiveRecords.join([*self._before, *blocks])
        self._first_line, self._records = self._first_line or int(new.line[0]), self._records + len(new)
        masked = self._masked_runs(new)
        gone = self._find_stuck(whole, masked)
        if gone.any():
            known = replace(whole, e=np.where(gone, np.nan, whole.e))
        found = self._find_gross_errors(known)
        clean, counts = known, dict[int, GrossCounts]()
        if found is not None:
            every = np.ones(len(known), bool)
            counts = dict(count_rejected(found, known.line, every, self.monitor.sensors, self.recorded))
            clean = replace(known, e=np.where(found.readings | found.records[:, None], np.nan, known.e))
        clean = self._weigh_scatter(clean)
        stops = np.cumsum([sum(map(len, self._before)), *map(len, blocks)]).tolist()
        rows = [range(*ends) for ends in pairwise(stops)]
        rejected = [
            sum((replace(counts[k], judged=0) for k in r if k in counts), GrossCounts(judged=len(r))) for r in rows
        ]
        N = len(known)
        closed = sum(N - r.stop >= AROUND // 2 for r in rows) if N >= HISTORY else 0
        self._open = blocks[closed:]
        if closed:
            self._before = [whole.select(slice(max(0, min(N - HISTORY, rows[closed].start)), rows[closed].start))]
        pieces = [clean.select(slice(r.start, r.stop)) for r in rows]
        lines = self._first_line, int(new.line[-1])
        stuck = find_stuck_faults([*masked, *self._stuck], self.monitor.engine.inputs, lines, self._records)
        return CleanBlocks(pieces[:closed], pieces[closed:], rejected, (*stuck, *self._noisy.values()))

    def _masked_runs(self, new: LiveRecords) -> list[StuckRun]:
        """The masked runs, of a sensor that has never changed only where what is predicted of it has."""
        at = np.isfinite(new.e).any(axis=1)
        self._low = np.fmin(self._low, np.min(new.y[at], axis=0, initial=np.inf))
        self._high = np.fmax(self._high, np.max(new.y[at], axis=0, initial=-np.inf))
        moved = self._high - self._low > SPAN * self.monitor.noise.sigma
        known = dict(zip(self.monitor.sensors, moved, strict=True))
        mine = [run for run in self.masked if run.column in known]
        return [run for run in mine if known[run.column] or not run.opens]

    def _find_stuck(self, known: LiveRecords, masked: Sequence[StuckRun]) -> np.ndarray:
        """Readings (n, m) of known records that are of no use, since they or an input are stuck; one that was goes on
        being so until it moves. masked: runs of which the first reading, which may have been good, is not."""
        monitor, line = self.monitor, known.line
        recorded = [c for c in monitor.engine.inputs if c in self.recorded]
        gone, masks = find_stuck_readings(monitor, known.inputs, recorded, known.read, known.e, known.y)
        column = {**known.inputs, **{c: known.read[:, j] for j, c in enumerate(monitor.sensors)}}
        for run in self._stuck:
            same = column[run.column] == run.value
            moved = line[~same & (line >= run.first_line)]
            mask = same & (line >= run.first_line) & (line < moved.min(initial=line[-1] + 1))
            masks[run.column] = masks.get(run.column, np.zeros(len(line), bool)) | mask
            if run.column in monitor.sensors:
                gone[:, monitor.sensors.index(run.column)] |= mask
            else:
                gone[mask] = True
        for run in masked:
            gone[(line >= run.first_line) & (line <= run.last_line), monitor.sensors.index(run.column)] = True
        for name, mask in masks.items():
            for run in list_stuck_runs(name, column[name], line, mask):
                self._extend_run(run, line)
        return gone

    def _extend_run(self, run: StuckRun, line: np.ndarray) -> None:
        """Note a run of known records on these lines (n,), or that one that is noted goes on."""
        for k, old in enumerate(self._stuck):
            if (old.column, old.value) == (run.column, run.value) and old.overlaps(run.first_line, run.last_line):
                more = int(np.sum((line > old.last_line) & (line <= run.last_line)))
                last = max(old.last_line, run.last_line)
                self._stuck[k] = replace(old, last_line=last, records=old.records + more)
                return
        self._stuck.append(run)

    def _weigh_scatter(self, known: LiveRecords) -> LiveRecords:
        """The known records with readings that scatter weighed by that, as those of a window are; by the residuals at
        the change that fits them best, linear at nominal, held as the estimate of a window is."""
        monitor, p = self.monitor, len(self.monitor.names)
        G, z = np.nan_to_num(known.J[:, :, :p]), np.nan_to_num(known.e)
        weight = np.isfinite(known.e) / monitor.noise.sigma**2
        A = np.einsum("kjp,kj,kjq->pq", G, weight, G, optimize=True) + monitor.precision
        change = np.linalg.solve(A, np.einsum("kjp,kj,kj->p", G, weight, z, optimize=True))
        nominal = NominalResiduals(known.inputs, known.read, known.y, G, np.ones(len(known), bool), None)
        found, weights = find_scattering_instruments(monitor, nominal, known.e - G @ change, known.lags)
        self._noisy |= {fault.name: fault for fault in found}
        return (
            known
            if weights is None
            else replace(known, e=apply_weights(weights, known.e), J=apply_weights(weights, known.J))
        )

    def _find_gross_errors(self, known: LiveRecords) -> GrossErrors | None:
        """The gross errors of known records, None where no reading is suspected."""
        monitor, p = self.monitor, len(self.monitor.names)
        sigma = monitor.noise.sigma
        z, level = known.e / sigma, known.y / sigma
        if not may_have_gross_errors(z, level, monitor.noise.rho):
            return None
        G = np.nan_to_num(known.J[:, :, :p] / sigma[:, None])

        def effects(rows: np.ndarray) -> np.ndarray:
            return input_effects(monitor, known.inputs, rows, self.recorded)

        stretch = ResidualStretch(z, G, level, known.lags, known.time, monitor.precision, monitor.noise.rho, effects)
        return find_gross_errors(stretch)


def count_rejected(
    found: GrossErrors, line: np.ndarray, mine: np.ndarray, sensors: Sequence[str], inputs: Sequence[str]
) -> Iterator[tuple[int, GrossCounts]]:
    """What was rejected of each record in lines (n,) that is `mine` (n,) and has gross errors."""
    excursions = _find_excursions(found, line)
    for k in np.flatnonzero(mine & (found.readings.any(axis=1) | found.records)).tolist():
        gone = [sensors[j] for j in np.flatnonzero(found.readings[k]).tolist()]
        wrong = [] if not found.records[k] else ["" if found.blamed[k] == UNKNOWN else inputs[found.blamed[k]]]
        yield (
            k,
            GrossCounts(
                dict.fromkeys(gone, 1),
                dict.fromkeys(wrong, 1),
                {c: [int(line[k])] for c in (*gone, *wrong)},
                {c: [excursions[k, j]] for j, c in enumerate(sensors) if (k, j) in excursions},
                [sensors[j] for j in np.flatnonzero(found.readings[k] & found.dead).tolist()],
                judged=len(wrong),
            ),
        )


def _find_excursions(found: GrossErrors, line: np.ndarray) -> dict[tuple[int, int], list[int]]:
    """Record and sensor at which readings begin to be rejected in a row → first line, last line and how many they
    are, from `EXCURSION` on; line (n,) of the records."""
    excursions = {}
    for j in np.flatnonzero(found.readings.any(axis=0) & ~found.dead).tolist():
        for first, stop in label_runs(found.readings[:, j]):
            if found.readings[first, j] and stop - first >= EXCURSION:
                excursions[first, j] = [int(line[first]), int(line[stop - 1]), stop - first]
    return excursions


@dataclass(frozen=True)
class CleanFlight:
    """Columns of a flight that lost readings, and what was rejected of it."""

    columns: Mapping[str, np.ndarray]
    counts: GrossCounts


def gross_of_flight(
    engine: MonitoredModel,
    theta: Mapping[str, float],
    columns: Mapping[str, np.ndarray],
    wrt: Sequence[str],
    precision: np.ndarray,
    noise: NoiseModel,
    sensors: Sequence[str],
) -> CleanFlight:
    """A flight in memory, columns → (n,), without gross errors of its `sensors` (m,): judged against an engine at
    `theta`, of which the parameters `wrt` (p,) are known to `precision` (p, p). Events that several sensors show are
    kept. A flight in memory does not know its lines."""
    n = len(next(iter(columns.values()), ()))
    inputs = {c: columns[c] for c in engine.inputs}
    inputs |= {c: np.nan_to_num(columns[c], nan=x) for c, x in engine.optional_inputs.items() if c in columns}
    usable = np.all([np.isfinite(v) for v in inputs.values()], axis=0)
    time = np.asarray(columns.get("time_s", np.full(n, np.nan)), float)
    y = np.column_stack([columns[s] for s in sensors])
    gone, counts = np.zeros(y.shape, bool), GrossCounts()
    for start in range(0, n, BLOCK):
        at = np.arange(max(0, start - HALO), min(n, start + BLOCK + HALO))
        at = at[usable[at]]
        if len(at) < FEWEST:
            continue
        here = {c: v[at] for c, v in inputs.items()}
        read = tuple(here)
        p = engine.predict(here, theta, sensors=tuple(sensors), wrt=(*wrt, *read))
        J = np.nan_to_num(np.asarray(p.jacobian) / noise.sigma[:, None])
        z = np.where(np.asarray(p.ok)[:, None], y[at] - p.y, np.nan) / noise.sigma
        level = np.nan_to_num(np.asarray(p.y)) / noise.sigma
        if not may_have_gross_errors(z, level, noise.rho):
            counts = counts + GrossCounts(judged=int(np.sum((at >= start) & (at < start + BLOCK))))
            continue
        _, lags = Timeline().advance(len(at), time[at] if np.isfinite(time[at]).all() else None, False)
        q = len(wrt)

        def effects(rows: np.ndarray, J: np.ndarray = J[:, :, q:]) -> np.ndarray:
            return J[rows]

        stretch = ResidualStretch(z, J[:, :, :q], level, lags, time[at], precision, noise.rho, effects)
        found = find_gross_errors(stretch, events=True)
        mine = (at >= start) & (at < start + BLOCK)
        gone[at[mine]] = (found.readings | found.records[:, None])[mine]
        for _, some in count_rejected(found, at, mine, sensors, read):
            counts = counts + replace(some, lines={}, excursions={}, judged=0)
        counts = counts + GrossCounts(judged=int(mine.sum()))
    clean = {s: np.where(gone[:, j], np.nan, y[:, j]) for j, s in enumerate(sensors) if gone[:, j].any()}
    return CleanFlight(clean, counts)
