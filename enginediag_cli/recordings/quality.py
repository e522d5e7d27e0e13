"""Masks for values that no analysis should see, with a count for each column and reason.

Never silent: every mask is counted. Never fatal unless nothing is left.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.table import Recording
from enginediag_cli.units import find_unit, split_column

REASONS = ("missing", "dropped", "out of limits", "held", "stuck", "outlier")

WHOLE_RECORDS = {
    "frozen": "in which every reading stands still, not used",
    "repeated": "that were there already, left out",
}
"""Reasons that concern whole records, and what is told of them."""

_PHYSICAL = (
    (r"([a-z]+_)?(T\d*|ITT|itt|EGT|TGT|TIT|TAT|SAT|tat|sat|temperature)", "temperature", 100.0, 3500.0),
    (r"([a-z]+_)?(P\d*|Ps\d*|pressure)", "pressure", 1.0, 1e8),
    (r"([a-z]+_)?N\d*", "rotational speed", 0.0, 3e5),
    (r"([a-z]+_)?(Wf|W\d*|fuel_flow)", "mass flow", -1.0, 1e4),
    (r"altitude", "length", -1000.0, 30000.0),
)
"""Name of the quantity, dimension, lowest and highest value in SI. The margins are wide: these catch the
codes that recorders write for no value (−9999, 0 K), not bad readings."""

BEYOND_ANY = 1e100
"""No instrument reads so much in any unit; beyond it squares and products of readings cannot be computed any more."""


@dataclass(frozen=True)
class QualitySettings:
    """How much is needed before a value is masked; 0 turns off the search for stuck sensors or for outliers.
    Records are those of the file, whatever their rate."""

    dropped_records: int = 10
    """Missing values in a row that count as a dropped sensor, not as single missing values."""
    stuck_records: int = 20
    outlier_sigma: float = 8.0
    frozen_records: int = 20
    """Records in a row with every judged reading the same, to the last digit: the recorder stands still. As many as
    for one stuck sensor; several together repeat far more rarely than one, and a recorder that writes 10 to 16 times
    for each reading of its sensors stays below."""


@dataclass(frozen=True)
class MaskReport:
    """masks: column → (N,) bool, true where the value is not to be used; counts: column → reason → number.

    Each masked value is counted once, under the first of REASONS that holds. records: whole records by reason, "frozen"
    (their sensor readings are masked but in no column's counts) and "repeated" (left out of the recording).
    """

    masks: Mapping[str, np.ndarray]
    counts: Mapping[str, Mapping[str, int]]
    records: Mapping[str, int] = field(default_factory=dict)

    @property
    def total(self) -> int:
        return sum(sum(reasons.values()) for reasons in self.counts.values())

    def report_lines(self) -> list[str]:
        """One line per column that lost values, for stderr."""
        lines = []
        for column, reasons in self.counts.items():
            lost = sum(reasons.values())
            if lost:
                of = len(self.masks[column])
                why = ", ".join(f"{reason} {n}" for reason, n in reasons.items() if n)
                lines.append(f"{column}: {lost} of {of} values masked ({why})")
        return lines + whole_record_lines(self.records)


def whole_record_lines(records: Mapping[str, int]) -> list[str]:
    """What is told of whole records, by reason."""
    return [f"{n} record{'' if n == 1 else 's'} {WHOLE_RECORDS[why]} ({why})" for why, n in records.items() if n]


def mask_gross(
    recording: Recording,
    limits: Mapping[str, tuple[float, float]] | None = None,
    *,
    columns: Collection[str] | None = None,
    required: Collection[str] = (),
    settings: QualitySettings | None = None,
    search: bool = True,
) -> tuple[Recording, MaskReport]:
    """The recording with unusable values set to NaN, and the report of what was masked and why.

    limits: column → (lowest, highest) value that the sensor can truthfully give, in the column's unit (where
    none is given: `physical_limits`);
    columns: which to judge (default: all numbers but `time_s`); search: also look for stuck sensors and
    outliers, which compares records with their neighbours in file order (see masking.py, also for streams).
    Raises DataError when no record has all `required` columns left, or with none required, no value is left.
    """
    from enginediag_cli.recordings.masking import Judged, mask_recording

    names = tuple(c for c in (recording.columns if columns is None else columns) if c != "time_s")
    judged = Judged(
        sensors=names if search else (),
        inputs=() if search else names,
        limits=limits or {},
        settings=settings or QualitySettings(),
        frozen=False,
        repeated=False,
    )
    clean, report = mask_recording(recording, judged)
    insist_on_something(clean, report, names, required)
    return clean, report


def physical_limits(column: str) -> tuple[float, float]:
    """What a gas turbine's sensor can truthfully read, in the column's unit; ±BEYOND_ANY if nothing is known.

    Only for names that say what they are: temperatures, pressures, speeds and flows (not differences).
    """
    quantity, suffix = split_column(column)
    if suffix:
        unit = find_unit(suffix)
        for pattern, dimension, low, high in _PHYSICAL:
            if unit.dimension == dimension and re.fullmatch(pattern, quantity):
                return (low - unit.offset) / unit.factor, (high - unit.offset) / unit.factor
    return (-0.1, 10.0) if column == "mach" else (-BEYOND_ANY, BEYOND_ANY)


def in_runs(mask: np.ndarray, shortest: int) -> np.ndarray:
    """The part of a mask (N,) that lies in runs of at least `shortest` records."""
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False].astype(np.int8)))
    starts, ends = edges[::2], edges[1::2]
    long = ends - starts >= shortest
    change = np.zeros(len(mask) + 1, dtype=np.int64)
    change[starts[long]] += 1
    change[ends[long]] -= 1
    return np.cumsum(change[:-1]) > 0


def tally(found: Mapping[str, np.ndarray]) -> tuple[np.ndarray, dict[str, int]]:
    """Union of the masks, and how many values each adds to those before it."""
    union: np.ndarray | None = None
    counts: dict[str, int] = {}
    for reason, mask in found.items():
        new = mask if union is None else mask & ~union
        counts[reason] = int(np.count_nonzero(new))
        union = mask if union is None else union | mask
    assert union is not None
    return union, counts


def insist_on_something(
    recording: Recording, report: MaskReport, judged: Collection[str], required: Collection[str] = ()
) -> None:
    """Raises DataError when no record has all `required` columns, or with none required, no `judged` value is left."""
    if len(recording) == 0:
        return
    left = (
        np.all([np.isfinite(recording[c]) for c in required], axis=0)
        if required
        else np.any([np.isfinite(recording[c]) for c in judged], axis=0)
    )
    if judged and not np.any(left):
        raise DataError(f"{recording.source}: no usable record is left: " + "; ".join(report.report_lines()))
