"""A flight that is still being recorded, without its gross errors and without instruments that are stuck.

What is judged anew with each block that follows, and what is decided for good, is `LiveGate`'s to say; the rules for
single readings are those of whole recordings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from enginediag_cli.intake.left_out import GrossCounts
from enginediag_cli.recordings.repeated import StuckRun, stuck_runs
from enginediag_cli.residuals.gross_errors import AROUND, GrossErrors, Stretch, find_gross_errors, suspected
from enginediag_cli.residuals.gross_gate import input_effects, rejected_counts, stuck_readings
from enginediag_cli.residuals.instruments import SPAN, InstrumentFault, stuck_faults, weighed
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.pipeline import scattering_instruments
from enginediag_cli.residuals.windows import NominalResiduals

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
    def joined(parts: Sequence[LiveRecords]) -> LiveRecords:
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
        whole = known = LiveRecords.joined([*self._before, *blocks])
        self._first_line, self._records = self._first_line or int(new.line[0]), self._records + len(new)
        masked = self._masked_runs(new)
        gone = self._standing(whole, masked)
        if gone.any():
            known = replace(whole, e=np.where(gone, np.nan, whole.e))
        found = self._found(known)
        clean, counts = known, dict[int, GrossCounts]()
        if found is not None:
            every = np.ones(len(known), bool)
            counts = dict(rejected_counts(found, known.line, every, self.monitor.sensors, self.recorded))
            clean = replace(known, e=np.where(found.readings | found.records[:, None], np.nan, known.e))
        clean = self._weighed(clean)
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
        stuck = stuck_faults([*masked, *self._stuck], self.monitor.engine.inputs, lines, self._records)
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

    def _standing(self, known: LiveRecords, masked: Sequence[StuckRun]) -> np.ndarray:
        """Readings (n, m) of known records that are of no use, since they or an input are stuck; one that was goes on
        being so until it moves. masked: runs of which the first reading, which may have been good, is not."""
        monitor, line = self.monitor, known.line
        recorded = [c for c in monitor.engine.inputs if c in self.recorded]
        gone, masks = stuck_readings(monitor, known.inputs, recorded, known.read, known.e, known.y)
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
            for run in stuck_runs(name, column[name], line, mask):
                self._go_on(run, line)
        return gone

    def _go_on(self, run: StuckRun, line: np.ndarray) -> None:
        """Note a run of known records on these lines (n,), or that one that is noted goes on."""
        for k, old in enumerate(self._stuck):
            if (old.column, old.value) == (run.column, run.value) and old.within(run.first_line, run.last_line):
                more = int(np.sum((line > old.last_line) & (line <= run.last_line)))
                last = max(old.last_line, run.last_line)
                self._stuck[k] = replace(old, last_line=last, records=old.records + more)
                return
        self._stuck.append(run)

    def _weighed(self, known: LiveRecords) -> LiveRecords:
        """The known records with readings that scatter weighed by that, as those of a window are; by the residuals at
        the change that fits them best, linear at nominal, held as the estimate of a window is."""
        monitor, p = self.monitor, len(self.monitor.names)
        G, z = np.nan_to_num(known.J[:, :, :p]), np.nan_to_num(known.e)
        weight = np.isfinite(known.e) / monitor.noise.sigma**2
        A = np.einsum("kjp,kj,kjq->pq", G, weight, G, optimize=True) + monitor.precision
        change = np.linalg.solve(A, np.einsum("kjp,kj,kj->p", G, weight, z, optimize=True))
        nominal = NominalResiduals(known.inputs, known.read, known.y, G, np.ones(len(known), bool), None)
        found, weights = scattering_instruments(monitor, nominal, known.e - G @ change, known.lags)
        self._noisy |= {fault.name: fault for fault in found}
        return known if weights is None else replace(known, e=weighed(weights, known.e), J=weighed(weights, known.J))

    def _found(self, known: LiveRecords) -> GrossErrors | None:
        """The gross errors of known records, None where no reading is suspected."""
        monitor, p = self.monitor, len(self.monitor.names)
        sigma = monitor.noise.sigma
        z, level = known.e / sigma, known.y / sigma
        if not suspected(z, level, monitor.noise):
            return None
        G = np.nan_to_num(known.J[:, :, :p] / sigma[:, None])

        def effects(rows: np.ndarray) -> np.ndarray:
            return input_effects(monitor, known.inputs, rows, self.recorded)

        stretch = Stretch(z, G, level, known.lags, known.time, monitor.precision, monitor.noise, effects)
        return find_gross_errors(stretch)
