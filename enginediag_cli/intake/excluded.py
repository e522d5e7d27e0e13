"""What was not used of a recording, as counts. The report puts it in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from enginediag_cli.recordings.repeated import StuckRun
from enginediag_cli.recordings.table_file import Absent, ReadingCounts

if TYPE_CHECKING:
    from enginediag_cli.recordings.masking import MaskCounts
    from enginediag_cli.recordings.recorder import LiveRecorder
    from enginediag_cli.recordings.steady import GateReport

EXCURSION = 3
"""Records in a row from which gross errors are reported as a short excursion: it may have been the engine."""


LINES = 20
"""Lines of the file that are named for each column; a longer list helps nobody."""


NOTEWORTHY = 0.02
"""Share of gross readings from which they are a finding about the sensor: good channels have a tenth of that."""


@dataclass(frozen=True)
class GrossCounts:
    """What was rejected of some records as gross errors, by column.

    readings: of a sensor; wrong_inputs: records of no use because that input was wrong ("": most readings were, and no
    one input explains it); lines: the first `LINES` of either; excursions: first line, last line and number of
    `EXCURSION` readings or more in a row; dead: sensors whose readings are none of this engine; spoilt: those with so
    many gross readings that all were kept; judged: records that all of this is out of.
    """

    readings: Mapping[str, int] = field(default_factory=dict)
    wrong_inputs: Mapping[str, int] = field(default_factory=dict)
    lines: Mapping[str, Sequence[int]] = field(default_factory=dict)
    excursions: Mapping[str, Sequence[Sequence[int]]] = field(default_factory=dict)
    dead: Sequence[str] = ()
    spoilt: Sequence[str] = ()
    judged: int = 0

    @property
    def rejected(self) -> int:
        """Readings rejected, those of records with a wrong input not counted."""
        return sum(self.readings.values())

    def __bool__(self) -> bool:
        return bool(self.readings or self.wrong_inputs or self.spoilt)

    def share(self, column: str) -> float:
        """Share of the records in which a sensor's reading, or an input, was gross."""
        return (self.readings.get(column, 0) + self.wrong_inputs.get(column, 0)) / max(self.judged, 1)

    def noteworthy(self, column: str) -> bool:
        """Whether a column has more gross errors than a good channel has."""
        several = self.readings.get(column, 0) + self.wrong_inputs.get(column, 0) > 1
        return column in self.spoilt or (several and self.share(column) > NOTEWORTHY)

    def __add__(self, other: GrossCounts) -> GrossCounts:
        if not other:
            return replace(self, judged=self.judged + other.judged)

        def total(a: Mapping[str, int], b: Mapping[str, int]) -> dict[str, int]:
            return {c: a.get(c, 0) + b.get(c, 0) for c in (*a, *(c for c in b if c not in a))}

        def first(a: Mapping[str, Sequence[Any]], b: Mapping[str, Sequence[Any]]) -> dict[str, Sequence[Any]]:
            return {c: [*a.get(c, ()), *b.get(c, ())][:LINES] for c in (*a, *(c for c in b if c not in a))}

        return GrossCounts(
            total(self.readings, other.readings),
            total(self.wrong_inputs, other.wrong_inputs),
            first(self.lines, other.lines),
            first(self.excursions, other.excursions),
            sorted({*self.dead, *other.dead}),
            sorted({*self.spoilt, *other.spoilt}),
            self.judged + other.judged,
        )


@dataclass
class LeftOut:
    """Of one `file`, and one `engine` of it where the recorder tells engines apart.

    records: read from it, those of other engines not counted; columns: column → reason → readings masked, `readings`
    of that column in all; frozen, repeated: whole records not used, because nothing in them moved or because they
    were there before; gate: what the recorder's stability gate kept; absent: sensors without a column; reading: what
    of the file was no record or no reading; gross: what was rejected as gross errors of readings and inputs, judged by
    the model; undecided: what the recorder, a draft, leaves open; stuck: runs of readings that repeat themselves where
    they should have moved.
    Counts are complete when the recording has been read to its end.
    """

    file: str
    engine: str = ""
    records: int = 0
    columns: dict[str, dict[str, int]] = field(default_factory=dict)
    readings: dict[str, int] = field(default_factory=dict)
    frozen: int = 0
    repeated: int = 0
    gate: GateReport | None = None
    absent: tuple[Absent, ...] = ()
    reading: ReadingCounts = field(default_factory=ReadingCounts)
    gross: GrossCounts = field(default_factory=GrossCounts)
    undecided: tuple[str, ...] = ()
    stuck: list[StuckRun] = field(default_factory=list)

    def masked(self, counts: MaskCounts) -> None:
        """Take over what a masker has counted so far."""
        found = {c: {why: n for why, n in reasons.items() if n} for c, reasons in counts.columns.items()}
        self.columns = {c: reasons for c, reasons in found.items() if reasons}
        self.readings = {c: counts.readings[c] for c in self.columns}
        self.frozen, self.repeated = counts.frozen, counts.repeated
        self.stuck = list(counts.stuck)

    def add_stuck(self, runs: Sequence[StuckRun]) -> None:
        """Take over runs that the model shows to be stuck."""
        for run in runs:
            reasons = self.columns.setdefault(run.column, {})
            reasons["stuck"] = reasons.get("stuck", 0) + run.records
            self.readings.setdefault(run.column, self.records)
        self.stuck += runs

    def mapped(self, live: LiveRecorder) -> None:
        """Take over what a recorder has counted so far."""
        self.masked(live.counts)
        self.records = live.records
        if live.recorder.steady or live.recorder.average_s > 0.0:
            self.gate = live.gate
