"""`enginediag detect --follow`: a flight judged while it is being recorded."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.commands.windows import Intake

if TYPE_CHECKING:
    from enginediag_cli.detection.follow import BlockReport, FlightMonitor
    from enginediag_cli.recordings.table import Recording
    from enginediag_cli.residuals.groups import Key

BLOCK = 20
"""Records of a block where --window does not say."""
OPEN_FLIGHTS = 16
"""Flights that may be open at once; the one that has been silent longest is closed for the next."""


def block_length(window: str | None) -> int:
    """Records per row, from --window; click's own message for a time."""
    if window is None:
        return BLOCK
    if not window.strip().isdigit():
        raise click.UsageError("with --follow, --window is a number of records")
    return max(int(window), 1)


def followed(
    intake: Intake, files: tuple[str, ...], false_alarm: float, block: int, idle_s: float
) -> Iterator[BlockReport]:
    """One report per block of each flight, as soon as its records are there."""
    from enginediag_cli.detection.follow import FlightMonitor
    from enginediag_cli.residuals.groups import group_rows

    assert intake.monitor is not None
    flights: dict[Key, FlightMonitor] = {}
    for chunk in _chunks(intake, files, block, idle_s):
        for key, rows in group_rows(chunk):
            flight = flights.pop(key, None) or FlightMonitor(intake.monitor, key, false_alarm)
            flights[key] = flight  # the latest is the last
            while len(flights) > OPEN_FLIGHTS:
                flights.pop(next(iter(flights)))
            report = flight.add(chunk.select(rows))
            intake.counts.update(outside=report.outside, incomplete=report.incomplete, failed=report.failed)
            yield report


def _chunks(intake: Intake, files: tuple[str, ...], block: int, idle_s: float) -> Iterator[Recording]:
    from enginediag_cli.recordings.growing import GrowingFile
    from enginediag_cli.recordings.read import read

    for file in files:
        source: Any = file if file == "-" or file.endswith(".gz") else GrowingFile(file, idle_s)
        if intake.origin.recorder:
            yield from _mapped(intake, source, block)
            continue
        for number, chunk in enumerate(read(source, declared=intake.declared(), chunk_records=block)):
            if number == 0:
                intake.remember(chunk)
            if len(chunk):
                yield intake.clean(chunk, search=False)


def _mapped(intake: Intake, source: Any, block: int) -> Iterator[Recording]:
    """Blocks of what the recorder keeps of a foreign file, as it comes; what was left out goes to standard error."""
    from enginediag_cli.commands.origin import chosen_engine, of_engine
    from enginediag_cli.recordings.live import LiveRecorder
    from enginediag_cli.recordings.read import read
    from enginediag_cli.recordings.recorder import load_recorder
    from enginediag_cli.recordings.table import concat

    assert intake.origin.recorder is not None
    recorder, wanted = load_recorder(intake.origin.recorder), intake.origin.engine_instance
    name = str(getattr(source, "name", source))
    live = LiveRecorder(recorder, chosen_engine(recorder.engines, wanted, name))
    held: list[Recording] = []
    chunks = chain(read(source, chunk_records=block, **recorder.reading), [None])
    last: Recording | None = None
    for chunk in chunks:
        if last is None:
            if chunk is not None:
                intake.remember(chunk)
        else:
            found = live.add(last, end=chunk is None)
            held.append(of_engine(found, wanted) if wanted and wanted != live.engine else found)
            if chunk is None or sum(map(len, held)) >= block:
                piece, held = concat(held), []
                if len(piece):
                    yield piece
        last = chunk
    for line in live.report_lines(name):
        intake.messages.note(line)


def report_row(report: BlockReport) -> dict[str, Any]:
    """A report as a row; what is said of the change is empty without an alarm."""
    change = report.change
    row: dict[str, Any] = dict(zip(("source", "flight", "engine"), report.key, strict=True))
    for name in (
        "block",
        "first_line",
        "last_line",
        "start_s",
        "end_s",
        "records",
        "outside",
        "incomplete",
        "failed",
        "judged",
        "log10_e",
        "alarm",
    ):
        row[name] = getattr(report, name)
    row.update(
        kind=change.kind if change else None,
        leading=change.leading if change else None,
        probability=change.probability if change else None,
        likely=change.parameter if change else None,
        onset_s=change.onset_s if change else None,
        onset_low_s=change.low_s if change else None,
        onset_high_s=change.high_s if change else None,
    )
    return row
