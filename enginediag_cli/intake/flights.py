"""Whole flights of an intake, for identification and the search for missing physics, which look at all at once."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from enginediag_cli.errors import NoVerdictError
from enginediag_cli.identification.problem import TrainingRecording, part_of, training_recordings
from enginediag_cli.intake.intake import File, Intake
from enginediag_cli.recordings.table import Recording, concat


@dataclass(frozen=True)
class WholeFlight:
    """One flight of one engine: its records, and which file it is of. `engine` is "" where nothing names one."""

    file: str
    engine: str
    recording: TrainingRecording


MOST = 30_000
"""Records that identification fits at most: it holds some 30 kB of each. Where there are more, what the model cannot do
decides what is learnt, not their number."""
RUN = 125
"""Records in a row that are kept together: long beside the memory of noise, which is estimated from neighbours."""


@dataclass
class Thinning:
    """Keeps at most `most` of the records that come (0: all), in runs of `RUN` evenly spread over them: where there are
    more, every second run goes, then every second of those that remain, and so on. came: how many there were."""

    most: int = 0
    came: int = 0
    halved: int = 0

    def whole(self, chunks: Iterable[Recording]) -> Recording:
        """The records of chunks that follow each other."""
        held: list[Recording] = []
        first = 0
        for chunk in chunks:
            n = len(chunk)
            rows = np.flatnonzero(((first + np.arange(n)) // RUN) % 2**self.halved == 0)
            held.append(chunk.select(rows) if len(rows) < n else chunk)
            first += n
            while self.most and sum(map(len, held)) > self.most:
                whole = concat(held)
                held = [whole.select(np.flatnonzero((np.arange(len(whole)) // RUN) % 2 == 0))]
                self.halved += 1
        self.came += first
        return concat(held)

    def together(self, flights: Sequence[tuple[WholeFlight, int]]) -> list[WholeFlight]:
        """The flights, each with how often its records were halved, as if they had come as one recording."""
        while True:
            found, first = [], 0
            for flight, halved in flights:
                n = len(next(iter(flight.recording.columns.values())))
                rows = np.flatnonzero(((first + np.arange(n)) // RUN) % 2 ** (self.halved - halved) == 0)
                first += n
                if len(rows) == n:
                    found.append(flight)
                elif len(rows):
                    found.append(replace(flight, recording=part_of(flight.recording, rows)))
            kept = sum(len(next(iter(f.recording.columns.values()))) for f in found)
            if not self.most or kept <= self.most:
                return found
            self.halved += 1


def whole_flights(intake: Intake, thinning: Thinning | None = None) -> list[WholeFlight]:
    """Every flight of every file, in their order, one engine after the other within a file; thinning: how many records
    are kept of them, default: all.

    Raises DataError, and NoVerdictError when there is no record in any of them.
    """
    thinning = thinning or Thinning()
    flights: list[tuple[WholeFlight, int]] = []
    for file in intake.files():
        flights += [(flight, thinning.halved) for flight in list(_of_file(intake, file, thinning))]
        if thinning.most and sum(len(next(iter(f.recording.columns.values()))) for f, _ in flights) > 2 * thinning.most:
            flights = [(flight, thinning.halved) for flight in thinning.together(flights)]
    found = thinning.together(flights)
    if not any(len(flight.recording) for flight in found):
        raise NoVerdictError(f"{', '.join(map(intake.source.label, intake.source.files))}: there is no record")
    return found


def every_record(intake: Intake, files: Collection[str]) -> list[WholeFlight]:
    """The flights of these files with the records that the recorder has left out because the engine was not steady,
    nothing averaged; none where there is no such recorder (`Intake.ungated`). Raises DataError."""
    every = intake.ungated()
    if every is None:
        return []
    return [flight for file in every.files() if file.name in files for flight in _of_file(every, file, Thinning())]


def _of_file(intake: Intake, file: File, thinning: Thinning) -> Iterator[WholeFlight]:
    label = intake.source.label(file.name)
    # the chunks of a file are put together as long as they have the same columns
    for _, chunks in groupby(file.masked(), key=lambda chunk: frozenset(chunk.order)):
        recording = thinning.whole(chunks)
        column = np.asarray(recording.text.get("engine", [""] * len(recording)))
        for engine in dict.fromkeys(column.tolist()):
            for part in training_recordings(recording.select(column == engine), label):
                yield WholeFlight(file.name, engine, part._replace(engine=engine))
