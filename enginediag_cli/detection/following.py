"""Flights judged while they are being recorded."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

from enginediag_cli.detection.follow import BlockReport, FlightMonitor
from enginediag_cli.intake.intake import Intake
from enginediag_cli.intake.left_out import LeftOut
from enginediag_cli.intake.live import live_chunks
from enginediag_cli.residuals.admission import Elsewhere
from enginediag_cli.residuals.groups import Key, group_rows
from enginediag_cli.residuals.monitor import Monitor

BLOCK = 20
"""Records of a block where nobody says: an alarm is at most so many records late, and a row tells something."""
OPEN_FLIGHTS = 16
"""Flights that may be open at once; the one that has been silent longest is closed for the next."""


@dataclass
class Following:
    """The recordings of an intake followed in blocks of up to `block` records; a file that does not grow for `idle_s`
    seconds has ended. false_alarm: probability of an alarm in the whole of a healthy flight. `counts`: of records
    that were not judged, by what became of them."""

    intake: Intake
    monitor: Monitor
    false_alarm: float
    block: int = BLOCK
    idle_s: float = 60.0
    counts: Counter[str] = field(default_factory=Counter)
    elsewhere: Counter[Elsewhere] = field(default_factory=Counter)

    def reports(self) -> Iterator[BlockReport]:
        """One report per block of each flight, as soon as its records are there."""
        flights: dict[Key, FlightMonitor] = {}
        for chunk in live_chunks(self.intake, self.block, self.idle_s):
            for key, rows in group_rows(chunk):
                flight = flights.pop(key, None) or FlightMonitor(self.monitor, key, self.false_alarm)
                flights[key] = flight  # the latest is the last
                while len(flights) > OPEN_FLIGHTS:
                    yield from self._finished(flights.pop(next(iter(flights))))
                report = flight.add(chunk.select(rows), self._left_out(key).stuck)
                self.counts.update(
                    outside=report.outside,
                    incomplete=report.incomplete,
                    failed=report.failed,
                    repeating=report.repeated,
                )
                self.elsewhere.update(report.elsewhere)
                yield report
        for flight in flights.values():
            yield from self._finished(flight)

    def _left_out(self, key: Key) -> LeftOut:
        """What was left out of the file of a flight."""
        of_file = [left for left in self.intake.left_out if left.file == key[0]]
        return (of_file or self.intake.left_out)[-1]

    def _finished(self, flight: FlightMonitor) -> Iterator[BlockReport]:
        """The end of a flight. What was rejected is counted where it is reported: files come in turn, each with one
        engine."""
        report = flight.finish()
        left = self._left_out(flight.key)
        left.gross = left.gross + flight.gross
        if report is not None:
            yield report
