"""The past of every record: whatever is read goes onto the engine's tapes, and is told where it stands there."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.engine.moving.tape import MOMENT, NO_MOMENT

if TYPE_CHECKING:
    from enginediag_cli.engine.moving.tape import Tapes
    from enginediag_cli.recordings.recorder import Recorder
    from enginediag_cli.recordings.table import Recording


class Past:
    """One reading of a file onto `tapes`; with None records keep no past. Where a gate or averages leave records out,
    the whole file is put on the tapes first, and what the gate keeps is found there by its line."""

    _readings = 0

    def __init__(self, tapes: Tapes | None):
        Past._readings += 1
        self._tapes, self._reading = tapes, Past._readings
        self._known: dict[str, tuple[np.ndarray, np.ndarray]] = {}

    def whole(self, recorder: Recorder, file: str, inputs: tuple[str, ...], engines: tuple[str, ...]) -> None:
        """Put every record of a file on the tapes that a recorder's gate would leave out. Raises DataError."""
        if self._tapes is None or not (recorder.steady or recorder.average_s > 0.0):
            return
        every = replace(recorder, steady=None, average_s=0.0)
        found: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
        for name, part in every.stream(file, inputs=inputs, engines=engines):
            found.setdefault(name, []).append((part.line, self._moments(name, part)))
        for name, parts in found.items():
            lines, moments = (np.concatenate(x) for x in zip(*parts, strict=True))
            self._known[name] = lines, moments

    def told(self, name: str, part: Recording) -> Recording:
        """Records of the engine `name` with their place on its tape."""
        if self._tapes is None or not len(part):
            return part
        if name in self._known:
            lines, moments = self._known[name]
            at = np.clip(np.searchsorted(lines, part.line), 0, len(lines) - 1)
            return part.with_columns({MOMENT: np.where(lines[at] == part.line, moments[at], NO_MOMENT)})
        return part.with_columns({MOMENT: self._moments(name, part)})

    def _moments(self, name: str, part: Recording) -> np.ndarray:
        """(N,), each flight of each engine on a tape of its own."""
        assert self._tapes is not None
        keys = list(zip(*(part.text.get(c, [""] * len(part)) for c in ("engine", "flight")), strict=True))
        moment = np.full(len(part), NO_MOMENT)
        for key in dict.fromkeys(keys):
            own = np.array([k == key for k in keys], bool)
            columns = {c: v[own] for c, v in part.columns.items()}
            if "time_s" in columns:
                moment[own] = self._tapes.extend((self._reading, name, *key), columns)
        return moment
