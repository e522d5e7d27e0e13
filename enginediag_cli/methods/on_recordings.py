"""Methods on recordings: masked chunks of recordings become windows, and every window a verdict.

A window keeps all of its records in their place: one that cannot be judged has no reading, and where time jumps empty
records stand for it, so that methods see how far apart two readings are. Methods judge many windows together.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.detection.verdict import FAULT, HEALTHY, NO_VERDICT
from enginediag_cli.errors import DataError
from enginediag_cli.methods.base import FittedMethod, Verdicts, Windows, filled
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.instruments import runs
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.pipeline import place
from enginediag_cli.residuals.windows import (
    JudgedInputs,
    Key,
    WindowPlan,
    WindowStatistics,
    cut,
    joined,
    nothing_judged,
)

TOGETHER = 5_000
"""Records, filled up ones included, that methods are given at once: one call of the engine costs less than many."""
FARTHEST = 20
"""Empty records that stand for a jump of time, at most: noise of a correlation of 0.8 is forgotten by then."""


@dataclass(frozen=True)
class RecordedWindow:
    """Where a window lies, inputs column -> (n,) and readings y (n, m) of its records, empty ones among them."""

    place: WindowStatistics
    inputs: Mapping[str, np.ndarray]
    y: np.ndarray

    @property
    def judged(self) -> int:
        """Records with a reading that is judged."""
        return int(np.isfinite(self.y).any(axis=1).sum())


@dataclass(frozen=True)
class WindowVerdict:
    """Verdict on a window: `number` is its place in `verdicts`; None for one that no method was asked about."""

    window: RecordedWindow
    verdict: str
    reason: str = ""
    verdicts: Verdicts | None = None
    number: int = 0


def recorded_windows(monitor: Monitor, recordings: Iterable[Recording], plan: WindowPlan) -> Iterator[RecordedWindow]:
    """Windows of masked recordings as soon as they are complete; chunks of one file come in order.

    Raises DataError as `cut` does.
    """
    for complete in cut(monitor, recordings, plan, _pieces):
        yield from map(_whole, complete)


def learnt_windows(monitor: Monitor, recordings: Iterable[Recording], plan: WindowPlan) -> Windows:
    """Windows for a method to learn from. Raises DataError when none of them holds a record that can be judged."""
    found = list(recorded_windows(monitor, recordings, plan))
    usable = [window for window in found if window.judged]
    if not usable:
        why = f": {nothing_judged(joined([w.place for w in found]))}" if found else ""
        raise DataError(f"the healthy recordings hold nothing to learn from{why}")
    return filled([(window.inputs, window.y) for window in usable])


def judged_windows(
    fitted: FittedMethod, windows: Iterable[RecordedWindow], false_alarm: float
) -> Iterator[WindowVerdict]:
    """Verdicts on the windows, in their order."""
    batch: list[RecordedWindow] = []
    longest = 0
    for window in windows:
        longer = max(longest, len(window.y))
        if batch and longer * (len(batch) + 1) > TOGETHER:
            yield from _judged(fitted, batch, false_alarm)
            batch, longer = [], len(window.y)
        batch.append(window)
        longest = longer
    yield from _judged(fitted, batch, false_alarm)


def _judged(fitted: FittedMethod, batch: Sequence[RecordedWindow], false_alarm: float) -> Iterator[WindowVerdict]:
    asked = [window for window in batch if window.judged]
    verdicts = fitted.diagnose(filled([(window.inputs, window.y) for window in asked]), false_alarm) if asked else None
    number = 0
    for window in batch:
        if verdicts is None or not window.judged:
            yield WindowVerdict(window, NO_VERDICT, nothing_judged(window.place))
            continue
        reason = verdicts.why_not(number)
        verdict = NO_VERDICT if reason else FAULT if verdicts.alarm[number] else HEALTHY
        yield WindowVerdict(window, verdict, reason, verdicts, number)
        number += 1


def _pieces(
    part: Recording, taken: JudgedInputs, key: Key, blocks: np.ndarray, lags: np.ndarray
) -> Iterator[tuple[int, RecordedWindow]]:
    """The records of each block of one group in one chunk."""
    y = np.where(taken.judged[:, None], taken.y, np.nan)
    apart = np.where(np.isfinite(lags), np.minimum(lags, FARTHEST), FARTHEST).astype(int)
    for i, k in runs(blocks):
        rows = slice(i, k)
        steps = np.cumsum(apart[rows]) - 1  # empty records before the first stand for a jump from the block before
        inputs = {c: _spread(v[rows], steps) for c, v in taken.inputs.items()}
        yield int(blocks[i]), RecordedWindow(place(part, taken, key, rows), inputs, _spread(y[rows], steps))


def _spread(values: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """values (n, ...) at the positions `steps` (n,) of an otherwise empty array."""
    spread = np.full((int(steps[-1]) + 1, *values.shape[1:]), np.nan)
    spread[steps] = values
    return spread


def _whole(pieces: Sequence[RecordedWindow]) -> RecordedWindow:
    """A window from its pieces, without the empty records before its first."""
    inputs = {c: np.concatenate([piece.inputs[c] for piece in pieces]) for c in pieces[0].inputs}
    y = np.concatenate([piece.y for piece in pieces])
    begun = slice(_first(inputs, y), None)
    return RecordedWindow(joined([piece.place for piece in pieces]), {c: v[begun] for c, v in inputs.items()}, y[begun])


def _first(inputs: Mapping[str, np.ndarray], y: np.ndarray) -> int:
    """The first record that holds anything."""
    held = np.isfinite(y).any(axis=1) | np.any([np.isfinite(v) for v in inputs.values()], axis=0)
    return int(np.argmax(held)) if held.any() else 0
