"""Recordings that are still being written: blocks of records as they come."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import Any

from enginediag_cli.intake.intake import Intake, engines_wanted, judged_columns, named_rows, of_engine
from enginediag_cli.intake.left_out import LeftOut
from enginediag_cli.intake.past import Past
from enginediag_cli.intake.source import STDIN
from enginediag_cli.recordings.formats.table_file import ReadingCounts
from enginediag_cli.recordings.live import GrowingFile, LiveRecorder
from enginediag_cli.recordings.masking import LiveMasker
from enginediag_cli.recordings.read import is_whole, read
from enginediag_cli.recordings.source import OWN
from enginediag_cli.recordings.table import Recording, concat


def live_chunks(intake: Intake, block: int, idle_s: float) -> Iterator[Recording]:
    """Masked blocks of up to `block` records of each file in turn; a file to which nothing is added for `idle_s`
    seconds has ended. What only a longer stretch shows (spikes) is not searched for."""
    codec = OWN.codec if intake.recorder is None else intake.recorder.dialect.codec
    for file in intake.source.files:
        source: Any = file if file == STDIN or is_whole(file) else GrowingFile(file, idle_s, codec=codec)
        yield from (_own if intake.recorder is None else _mapped)(intake, source, block)


def _own(intake: Intake, source: Any, block: int) -> Iterator[Recording]:
    wanted = intake.wanted
    assert wanted is not None
    left = LeftOut(str(getattr(source, "name", source)))
    intake.left_out.append(left)
    masker: LiveMasker | None = None
    past = Past(wanted.tapes)
    counts = ReadingCounts()
    chunks = read(source, declared=wanted.declared, chunk_records=block, tolerant=True, counts=counts)
    for chunk in of_engine(chunks, intake.source.engine_instance):
        if masker is None:
            intake.remember(chunk)
            left.absent = wanted.absent(chunk)
            masker = LiveMasker(judged_columns(wanted, chunk))
        left.records += len(chunk)
        left.reading = counts
        found = masker.add(chunk)
        left.masked(masker.counts)
        yield from (past.told("", piece) for piece in found if len(piece))


def _mapped(intake: Intake, source: Any, block: int) -> Iterator[Recording]:
    """Blocks of what the recorder keeps of a foreign file, as it comes."""
    recorder, wanted, columns = intake.recorder, intake.source.engine_instance, intake.wanted
    assert recorder is not None and columns is not None
    name = str(getattr(source, "name", source))
    engine = engines_wanted(recorder.engines, wanted, name, fleet=False)[0]
    live, left = LiveRecorder(recorder, engine, inputs=columns.given), LeftOut(name, engine)
    intake.left_out.append(left)
    held: list[Recording] = []
    past = Past(None if recorder.steady or recorder.average_s > 0.0 else columns.tapes)
    last: Recording | None = None
    counts = ReadingCounts()
    for chunk in chain(recorder.chunks(source, block, tolerant=True, counts=counts), [None]):
        if last is None:
            if chunk is not None:
                intake.remember(chunk)
        else:
            found = live.add(last, end=chunk is None)
            left.absent = columns.absent(found)
            intake.compare(found, engine)
            left.mapped(live)
            left.reading = counts
            held.append(found.select(named_rows(found, wanted)) if wanted and live.engine != wanted else found)
            if chunk is None or sum(map(len, held)) >= block:
                piece, held = concat(held), []
                if len(piece):
                    yield past.told(engine, piece)
        last = chunk
