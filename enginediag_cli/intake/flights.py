"""Whole flights of an intake, for identification and the search for missing physics, which look at all at once."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np

from enginediag_cli.errors import NoVerdictError
from enginediag_cli.identification.problem import TrainingRecording
from enginediag_cli.identification.training import training_recordings
from enginediag_cli.intake.intake import File, Intake
from enginediag_cli.recordings.table import Recording, concat


@dataclass(frozen=True)
class WholeFlight:
    """One flight of one engine: its records, and which file it is of. `engine` is "" where nothing names one."""

    file: str
    engine: str
    recording: TrainingRecording


def whole_flights(intake: Intake) -> list[WholeFlight]:
    """Every flight of every file, in their order, one engine after the other within a file.

    Raises DataError, and NoVerdictError when there is no record in any of them.
    """
    flights = [flight for file in intake.files() for flight in _of_file(intake, file)]
    if not any(len(flight.recording) for flight in flights):
        raise NoVerdictError(f"{', '.join(map(intake.source.label, intake.source.files))}: there is no record")
    return flights


def every_record(intake: Intake, files: Collection[str]) -> list[WholeFlight]:
    """The flights of these files with the records that the recorder has left out because the engine was not steady,
    nothing averaged; none where there is no such recorder (`Intake.ungated`). Raises DataError."""
    every = intake.ungated()
    if every is None:
        return []
    return [flight for file in every.files() if file.name in files for flight in _of_file(every, file)]


def _of_file(intake: Intake, file: File) -> Iterator[WholeFlight]:
    label = intake.source.label(file.name)
    for recording in _whole(file):
        column = np.asarray(recording.text.get("engine", [""] * len(recording)))
        for engine in dict.fromkeys(column.tolist()):
            for part in training_recordings(recording.select(column == engine), label):
                yield WholeFlight(file.name, engine, part._replace(engine=engine))


def _whole(file: File) -> Iterator[Recording]:
    """The chunks of a file put together, as long as they have the same columns."""
    held: list[Recording] = []
    for chunk in file.masked():
        if held and set(chunk.order) != set(held[0].order):
            yield concat(held)
            held = []
        held.append(chunk)
    if held:
        yield concat(held)
