"""Columns of a foreign recording as those of one engine, in SI: the part of a recorder that needs no neighbours but
for gaps that are filled."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.joining import Filler
from enginediag_cli.recordings.read import absent_columns
from enginediag_cli.recordings.stamps import cells_of
from enginediag_cli.recordings.table import Recording, check_clock

if TYPE_CHECKING:
    from enginediag_cli.recordings.recorder import Recorder


class Conversion:
    """For one engine ("" where the file has one) of one file, chunk by chunk: remembers where its time began and the
    readings that later gaps are filled from."""

    def __init__(self, recorder: Recorder, name: str):
        self._recorder, self._name = recorder, name
        self._engine: Mapping[str, Any] = recorder.engines[name]
        self._stamps = recorder.stamps()
        self._filler = Filler({c.target: c.fill for c in recorder.channels if c.fill is not None})

    def add(self, recording: Recording, *, end: bool = False) -> Recording:
        """The records that have become final. Raises DataError for columns that are not there and for bad stamps."""
        recorder, engine = self._recorder, self._engine
        sources = {channel.target: channel.source_of(engine) for channel in recorder.channels}
        texts = {**recorder.values["text"], **{column: column for column in recorder.values["keep"]}}
        self._insist(
            recording, set(sources.values()), {*texts.values(), *(self._stamps.sources if self._stamps else ())}
        )
        columns: dict[str, np.ndarray] = {}
        if self._stamps:
            columns["time_s"] = self._stamps.seconds(recording)
        for channel in recorder.channels:
            full = engine["full_scale"].get(channel.target)
            columns[channel.target] = channel.read(recording[sources[channel.target]], full)
        for column, value in {**recorder.values["constants"], **engine["constants"]}.items():
            columns[column] = np.full(len(recording), float(value))
        text = {target: list(cells_of(recording, source)) for target, source in texts.items()}
        if self._name:
            text["engine"] = [self._name] * len(recording)
        order = (*text, *columns)
        converted = Recording(columns, text, order, recording.line, recording.source, recording.provenance)
        check_clock(converted)
        return self._filler.add(converted, end=end)

    def _insist(self, recording: Recording, numbers: set[str], others: set[str]) -> None:
        absent = sorted(numbers - set(recording.columns)) + sorted(others - set(recording.order))
        if absent:
            near = {a.column: a.near for a in absent_columns(absent, recording.order)}
            words = [c + (f" (did you mean {near[c]!r}?)" if near.get(c) else "") for c in absent]
            raise DataError(
                f"{recording.source}: the recorder {self._recorder.path} needs columns that are not there: "
                f"{', '.join(words)}"
            )
