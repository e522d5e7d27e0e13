"""From recordings to statistics, one batch of recordings after the other: the work that is done in many places.

Statistics have the form of a series (`residuals/reduced.py`): windows of an engine are compared with each other,
so that what is uncertain about nominal, the same in all of them, has no part in it and need not be computed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import lru_cache, partial

from enginediag_cli.errors import EngineDiagError
from enginediag_cli.fleets.condensed_file import Condensed, CondensedWriter, Part
from enginediag_cli.fleets.models import Making
from enginediag_cli.fleets.store import Store
from enginediag_cli.intake.excluded import LeftOut
from enginediag_cli.intake.loader import Intake
from enginediag_cli.intake.selection import Source, columns_of
from enginediag_cli.recordings.provenance import sha256_of
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.gross_gate import GrossErrorGate
from enginediag_cli.residuals.monitor import Monitor, agreement_with
from enginediag_cli.residuals.pipeline import window_statistics
from enginediag_cli.residuals.reduced import for_comparison, monitored_as_read, of_series
from enginediag_cli.residuals.windows import WindowStatistics

PART = 2000
"""Windows of one engine that are written together: a tenth of a gigabyte is the most that a worker may hold of them,
each with two matrices of up to forty parameters."""


@dataclass(frozen=True)
class CondenseTask:
    """Recordings of one making that are condensed together; store: folder in which they are kept."""

    paths: tuple[str, ...]
    making: Making
    store: str


@dataclass(frozen=True)
class Outcome:
    """Of one recording: what became of it, or why nothing did. fresh: it was condensed now, not found."""

    path: str
    condensed: Condensed | None = None
    fresh: bool = False
    trouble: str = ""


def condense(task: CondenseTask) -> tuple[Outcome, ...]:
    """Condense the recordings of a task that the store does not hold; the same wherever it runs. A recording that
    cannot be read is an outcome, no error, and costs the others nothing."""
    store = Store(task.store)
    found: dict[str, Outcome] = {}
    todo: dict[str, str] = {}
    again: dict[str, str] = {}
    for path in task.paths:
        try:
            sha256 = sha256_of(path)
        except OSError as error:
            found[path] = Outcome(path, trouble=f"cannot be read: {(error.strerror or str(error)).lower()}")
            continue
        known = store.find(task.making.key(sha256))
        if known is not None:
            found[path] = Outcome(path, known)
        elif sha256 in todo:  # the same bytes under another name
            again[path] = todo[sha256]
        else:
            todo[sha256] = path
    found |= _condensed(task.making, store, {path: sha256 for sha256, path in todo.items()})
    found |= {path: replace(found[first], path=path, fresh=False) for path, first in again.items()}
    return tuple(found[path] for path in task.paths)


def _condensed(making: Making, store: Store, todo: dict[str, str]) -> dict[str, Outcome]:
    """Together, since a call of the engine costs more than a short recording; one by one where one of them is bad."""
    if not todo:
        return {}
    try:
        return _together(making, store, todo)
    except EngineDiagError as error:
        if len(todo) == 1:
            (path,) = todo
            return {path: Outcome(path, trouble=str(error))}
    return {p: o for path, sha in todo.items() for p, o in _condensed(making, store, {path: sha}).items()}


def _together(making: Making, store: Store, todo: dict[str, str]) -> dict[str, Outcome]:
    monitor = series_monitor(making.nominal, making.fingerprint)
    wanted = columns_of(monitor.engine, monitor.sensors)
    source = Source(tuple(todo), making.recorder or None, accept_mismatch=making.accept_mismatch)
    intake = Intake(source, wanted, fleet=True, agreement=agreement_with(monitor))
    found: dict[str, Outcome] = {}
    with ExitStack() as stack:
        keeping = {
            p: _Kept(p, making.key(s), s, stack.enter_context(store.writing(making.key(s)))) for p, s in todo.items()
        }
        gate = GrossErrorGate(monitor)
        windows = window_statistics(
            monitor,
            gate.clean(_chunks(intake)),
            making.plan,
            linearise=making.linearise,
            condense=partial(monitored_as_read, monitor),
        )
        for window in windows:
            mine = (left for left in intake.left_out if left.file == window.source)
            masked = [run for left in mine if left.engine in ("", window.engine) for run in left.stuck]
            keeping[window.source].take(gate.judged(window, masked))
        gate.report(intake.left_out)
        for path, kept in keeping.items():
            left_out = tuple(left for left in intake.left_out if left.file == path)
            found[path] = Outcome(path, kept.close(left_out), fresh=True)
    return found


@lru_cache(maxsize=4)
def series_monitor(nominal: str, fingerprint: str) -> Monitor:
    """What windows of a series are held against: every instrument is suspected, nominal is not. One per worker and
    nominal file; fingerprint: what that file held when the work was planned."""
    return for_comparison(whole_monitor(nominal, fingerprint))


@lru_cache(maxsize=4)
def whole_monitor(nominal: str, fingerprint: str) -> Monitor:
    """The monitor of a series with what is uncertain about nominal, as `trend` opens it."""
    from enginediag_cli.intake.selection import open_baseline
    from enginediag_cli.residuals.monitor import monitor_of

    return of_series(monitor_of(open_baseline(nominal), sensors=True))


def _chunks(intake: Intake) -> Iterator[Recording]:
    """Masked chunks of all files, each named by its whole path: two folders may hold recordings of one name."""
    for file in intake.files():
        for chunk in file.masked():
            yield replace(chunk, source=file.name)


class _Kept:
    """The windows of one recording on their way into its file, engine by engine."""

    def __init__(self, path: str, key: str, sha256: str, writer: CondensedWriter):
        self._path, self._key, self._sha256, self._writer = path, key, sha256, writer
        self._waiting: dict[str, list[WindowStatistics]] = {}
        self._parts: list[Part] = []
        self._counts: Counter[str] = Counter()

    def take(self, window: WindowStatistics) -> None:
        mine = self._waiting.setdefault(window.engine, [])
        mine.append(replace(window, solution=None, weights=None))
        self._counts.update(window.counts)
        if sum(map(len, self._waiting.values())) >= PART:
            self._flush()

    def _flush(self) -> None:
        self._parts += [self._writer.add(engine, windows) for engine, windows in self._waiting.items()]
        self._waiting = {}

    def close(self, left_out: Sequence[LeftOut]) -> Condensed:
        self._flush()
        whole = Condensed(self._key, self._sha256, tuple(self._parts), dict(self._counts), tuple(left_out))
        self._writer.close(whole)
        return whole
