"""Recordings cut into windows of pieces: chunk by chunk, each flight and engine on its own, in constant memory."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.admission import JudgedInputs, check_inputs, judged_inputs
from enginediag_cli.residuals.groups import Key, Timeline, group_rows
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.windows import WindowAssembler, WindowPlan

Piece = TypeVar("Piece")

Pieces = Callable[[Recording, JudgedInputs, Key, np.ndarray, np.ndarray], Iterable[tuple[int, Piece]]]
"""pieces(records of one group in one chunk, what is judged of them, group, block (n,) and lag (n,) of each record) ->
number and piece of each block."""


def cut(
    monitor: Monitor,
    recordings: Iterable[Recording],
    plan: WindowPlan,
    pieces: Pieces[Piece],
    keep: Callable[[list[Piece]], None] = lambda pieces: None,
) -> Iterator[list[list[Piece]]]:
    """The windows that each chunk completes, each as its pieces; chunks of one file come in order. keep: is shown the
    pieces of each window that goes on, after every chunk.

    Raises DataError when a recording lacks an input of the engine, or a time that windows in time need.
    """
    assemblers: dict[Key, WindowAssembler[Piece]] = {}
    timelines: dict[Key, Timeline] = {}
    source = None
    for recording in recordings:
        complete: list[list[Piece]] = []
        if recording.source != source:  # a new file: what was open in the old one is complete
            complete.extend(window for assembler in assemblers.values() for window in assembler.flush())
            assemblers, timelines, source = {}, {}, recording.source
        check_inputs(monitor, recording)
        groups = group_rows(recording)
        taken = judged_inputs(monitor, recording)
        # a flight of which a whole chunk tells nothing has ended: memory holds the flights of one chunk
        for ended in [key for key in assemblers if key not in dict(groups)]:
            complete.extend(assemblers.pop(ended).flush())
            del timelines[ended]
        for key, rows in groups:
            mine = plan.of_flight(key[1])
            assembler = assemblers.setdefault(key, WindowAssembler(mine))
            part = recording.select(rows)
            position, lags = _placed(timelines.setdefault(key, Timeline()), part, mine)
            for number, piece in pieces(part, taken.of(rows), key, mine.blocks(position), lags):
                complete.extend(assembler.push(number, piece))
            keep(assembler.pieces)
        yield complete
    yield [window for assembler in assemblers.values() for window in assembler.flush()]


def _placed(timeline: Timeline, part: Recording, plan: WindowPlan) -> tuple[np.ndarray, np.ndarray]:
    """Position for the grid of the plan (n,), and lag (n,), of records."""
    time = part.columns.get("time_s")
    if plan.in_time and (time is None or not np.all(np.isfinite(time))):
        raise DataError(f"{part.source}: windows in time need a column time_s without gaps")
    position, lags = timeline.advance(len(part), time, plan.in_time)
    if plan.in_time and timeline.breaks:
        raise DataError(
            f"{part.source}: time_s runs backwards; windows in time need one stretch of "
            "time per flight (a column `flight` tells flights apart)"
        )
    return position, lags
