"""Stuck sensors: a reading that repeats itself to the last digit while the others move."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

COARSE = 0.01
"""Share of records that repeat the one before, from which a sensor counts as coarse (quantised)."""
END_OF_SCALE = 1e-3
"""Readings this close to their smallest or largest, as a share of the span, are saturated or off scale."""


@dataclass(frozen=True)
class StuckRun:
    """Identical readings of a column that should have moved: their value in the column's unit, the lines of the first
    and the last of them in the file, and how many they are. opens, closes: it begins with the first, ends with the last
    reading of the piece of the file in which it was found, and so may go on before or after it."""

    column: str
    value: float
    first_line: int
    last_line: int
    records: int
    opens: bool = field(default=False, compare=False)
    closes: bool = field(default=False, compare=False)

    def within(self, first_line: int, last_line: int) -> bool:
        """Whether some of it lies in these lines."""
        return self.first_line <= last_line and self.last_line >= first_line


def stuck_runs(column: str, values: np.ndarray, line: np.ndarray, mask: np.ndarray) -> Iterator[StuckRun]:
    """The masked (N,) of the readings of a column (N,), on these lines (N,), as runs of one value."""
    rows = np.flatnonzero(mask)
    if not rows.size:
        return
    others = np.cumsum(np.isfinite(values) & ~mask)  # readings that are not stuck, up to each record
    new = np.flatnonzero(np.r_[True, (np.diff(values[rows]) != 0.0) | (np.diff(others[rows]) > 0)])
    for first, stop in zip(new, np.r_[new[1:], rows.size], strict=True):
        own = rows[first:stop]
        opens, closes = bool(others[own[0]] == 0), bool(others[own[-1]] == others[-1])
        yield StuckRun(column, float(values[own[0]]), int(line[own[0]]), int(line[own[-1]]), len(own), opens, closes)


def same_runs(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """The masked (N,) and whatever stands beside them with the same value (N,), in a row."""
    run = np.cumsum(np.r_[0, values[1:] != values[:-1]])
    return np.isin(run, run[mask])


def joined_runs(known: list[StuckRun], more: Iterator[StuckRun]) -> None:
    """Add runs to those that are known, in order; one that goes on from a block to the next stays one."""
    for run in more:
        before = next((k for k in range(len(known) - 1, -1, -1) if known[k].column == run.column), None)
        if before is not None and known[before].value == run.value and known[before].closes and run.opens:
            old = known[before]
            records = old.records + run.records
            known[before] = replace(old, last_line=run.last_line, records=records, closes=run.closes)
        else:
            known.append(run)


@np.errstate(over="ignore", invalid="ignore")  # readings near the largest number: of infinite spread, they tell nothing
def stuck(
    values: np.ndarray,
    others: Mapping[str, np.ndarray],
    records: int = 20,
    seen: tuple[float, float] = (np.inf, -np.inf),
) -> np.ndarray:
    """Mask (N,) of the runs of `records` or more identical readings that are not natural.

    A sensor with a fine resolution never repeats itself while anything else changes: any long run is stuck, be it at
    the end of the scale, where a filler is found, too. One with a coarse resolution does in steady flight; its run is
    stuck only when it is three times longer than any other and the other columns, by a linear regression outside the
    run, say that it should have moved by more than 6 residual standard deviations; at the end of its scale (an
    air-speed indicator on the ground) it gives no evidence, nor does a column that never changes: neither is called
    stuck.
    seen: smallest and largest reading of the file before these records, which belong to the scale, too.
    """
    mask = np.zeros(len(values), dtype=bool)
    finite = np.flatnonzero(np.isfinite(values))
    if len(finite) < 2 * records:
        return mask
    x = values[finite]
    starts = np.flatnonzero(np.r_[True, x[1:] != x[:-1]])
    lengths = np.diff(np.r_[starts, len(x)])
    lowest, highest = min(x.min(), seen[0]), max(x.max(), seen[1])
    margin = END_OF_SCALE * (highest - lowest)
    within = (x[starts] > lowest + margin) & (x[starts] < highest - margin)
    suspects = np.flatnonzero(lengths >= records)
    if len(suspects) == 0 or len(lengths) == 1:
        return mask
    predictors = _standardised(others, finite)
    for k in suspects:
        run = slice(starts[k], starts[k] + lengths[k])
        elsewhere = np.delete(lengths, k)
        # a sensor that is stuck more than once is no coarse one, but one that rests again at one end of its scale is
        stop = (x[starts] == x[starts[k]]) & ~within[k]
        usual = np.delete(lengths, k)[np.delete((lengths < records) | stop, k)]
        repeats = 1.0 - len(usual) / usual.sum() if usual.size else 1.0
        if repeats < COARSE:
            frozen = bool(np.any(np.ptp(predictors[run], axis=0) > 0.0)) if predictors.shape[1] else False
        elif not within[k] or lengths[k] < 3 * elsewhere.max():
            frozen = False
        else:
            moved, error = _predicted_span(x, predictors, run)
            frozen = moved > 6.0 * error
        if frozen:
            mask[finite[run]] = True
    return mask


def _standardised(others: Mapping[str, np.ndarray], rows: np.ndarray) -> np.ndarray:
    """(n, q) columns of mean 0 and variance 1, gaps at the mean; those that never change are left out."""
    columns = []
    for values in others.values():
        x = values[rows]
        known = np.isfinite(x)
        spread = np.std(x[known]) if known.any() else 0.0
        if spread > 0.0:
            columns.append(np.where(known, (x - np.mean(x[known])) / spread, 0.0))
    return np.column_stack(columns) if columns else np.zeros((len(rows), 0))


def _predicted_span(x: np.ndarray, predictors: np.ndarray, run: slice) -> tuple[float, float]:
    """How far x should have moved within the run, and the residual standard deviation of the regression."""
    outside = np.ones(len(x), dtype=bool)
    outside[run] = False
    design = np.column_stack([np.ones(len(x)), predictors])
    if predictors.shape[1] == 0 or outside.sum() <= design.shape[1]:
        return 0.0, np.inf
    coefficients = np.linalg.lstsq(design[outside], x[outside], rcond=None)[0]
    predicted = design @ coefficients
    return float(np.ptp(predicted[run])), float(np.std(x[outside] - predicted[outside]))
