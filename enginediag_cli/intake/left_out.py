"""What of a recording did not come through the door, as counts: presentation tells it, nobody else."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from enginediag_cli.recordings.formats.base import ReadingCounts

if TYPE_CHECKING:
    from enginediag_cli.recordings.live import LiveRecorder
    from enginediag_cli.recordings.masking import MaskCounts
    from enginediag_cli.recordings.read import Absent
    from enginediag_cli.recordings.steady import GateReport


@dataclass
class LeftOut:
    """Of one `file`, and one `engine` of it where the recorder tells engines apart.

    records: read from it, those of other engines not counted; columns: column → reason → readings masked, `readings`
    of that column in all; frozen, repeated: whole records not used, because nothing in them moved or because they
    were there before; gate: what the recorder's stability gate kept; absent: sensors without a column; reading: what
    of the file was no record or no reading.
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

    def masked(self, counts: MaskCounts) -> None:
        """Take over what a masker has counted so far."""
        found = {c: {why: n for why, n in reasons.items() if n} for c, reasons in counts.columns.items()}
        self.columns = {c: reasons for c, reasons in found.items() if reasons}
        self.readings = {c: counts.readings[c] for c in self.columns}
        self.frozen, self.repeated = counts.frozen, counts.repeated

    def mapped(self, live: LiveRecorder) -> None:
        """Take over what a recorder has counted so far."""
        self.masked(live.counts)
        self.records = live.records
        if live.recorder.steady or live.recorder.average_s > 0.0:
            self.gate = live.gate
