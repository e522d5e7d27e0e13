"""A condensed recording as a file: an .npz whose members are parts, windows of one engine each, and an index.

A part is one matrix, a row for each window: counts and times, then the conditions flown, s, and the upper triangles of
F and V; beside it stand texts, and what its windows share. `index.json`, the last member, says what there is: without
it the file is not whole. Parts are written as they come, so that memory holds one of them, and read one by one. The
same windows give the same bytes.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, BinaryIO

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.intake.excluded import GrossCounts, LeftOut
from enginediag_cli.parameters import Parameter
from enginediag_cli.recordings.repeated import StuckRun
from enginediag_cli.recordings.steady import GateReport
from enginediag_cli.recordings.table_file import Absent, ReadingCounts
from enginediag_cli.residuals.instruments import InstrumentFault
from enginediag_cli.residuals.statistics import LocalStatistics
from enginediag_cli.residuals.windows import Elsewhere, WindowStatistics

FORMAT = 3
"""Of these files; others are made anew."""
INDEX = "index.json"
PLACES = ("first_line", "last_line", "start_s", "end_s", "records", "outside", "incomplete", "failed")
COUNTED = ("sensors", "sensors_of")
SUMMED = ("n", "chi2", "dof")
DOUBTS = 3
"""Numbers of `LocalStatistics.doubt`."""


@dataclass(frozen=True)
class Part:
    """What the index says of a part: its engine as the recording names it, windows, those with statistics, records."""

    engine: str
    windows: int
    statistics: int
    records: int


@dataclass(frozen=True)
class Condensed:
    """What the index says of a whole recording. key: of its content and making; sha256: of its bytes; parts, in the
    order of the file; counts: of records and windows by what became of them."""

    key: str
    sha256: str
    parts: tuple[Part, ...]
    counts: Mapping[str, int] = field(default_factory=dict)
    left_out: tuple[LeftOut, ...] = ()


class CondensedWriter:
    """Writes parts to an open stream; `close` writes the index."""

    def __init__(self, stream: BinaryIO):
        self._zip = zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED, allowZip64=True)
        self._parts: list[Part] = []

    def add(self, engine: str, windows: Sequence[WindowStatistics]) -> Part:
        """Write windows of one engine, all of the same parameters."""
        first = next((w for w in windows if w.statistics is not None), None)
        texts: dict[str, Any] = {"flights": [w.flight for w in windows]}
        conditions = list(first.conditions) if first else []
        if first is not None and first.statistics is not None:
            x = first.statistics
            texts |= {"parameters": x.parameters, "theta0": x.theta0.tolist(), "prior_sigma": x.prior_sigma.tolist()}
        texts["conditions"] = conditions
        for name in ("reason", "notes", "silent"):
            texts[name] = {str(k): getattr(w, name) for k, w in enumerate(windows) if getattr(w, name)}
        texts["elsewhere"] = {
            str(k): [[e.column, e.judged, n] for e, n in w.elsewhere.items()]
            for k, w in enumerate(windows)
            if w.elsewhere
        }
        texts["instruments"] = {
            str(k): [asdict(fault) for fault in w.instruments] for k, w in enumerate(windows) if w.instruments
        }
        part = Part(
            engine,
            len(windows),
            sum(w.statistics is not None for w in windows),
            sum(w.records for w in windows),
        )
        number = len(self._parts)
        self._member(f"{number}.npy", _npy(_matrix(windows, conditions, texts.get("parameters", ()))))
        self._member(f"{number}.json", _json(texts))
        self._parts.append(part)
        return part

    def close(self, whole: Condensed) -> None:
        """Write the index: what there is to say of the whole recording, and its parts."""
        told: dict[str, Any] = {"format": FORMAT, "key": whole.key, "sha256": whole.sha256, "counts": whole.counts}
        told["left_out"] = [_as_mapping(left) for left in whole.left_out]
        self._member(INDEX, _json({**told, "parts": [asdict(part) for part in self._parts]}))
        self._zip.close()

    def leave(self) -> None:
        """Write nothing more, whether or not there is an index; the file is the caller's."""
        self._zip.fp = None

    def _member(self, name: str, data: bytes) -> None:
        info = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))  # no time: the same data give the same bytes
        self._zip.writestr(info, data)


class CondensedReader:
    """Reads a file of condensed windows; DataError names one that is damaged. condensed: what its index says."""

    def __init__(self, path: str):
        self._path = path
        try:
            self._zip = zipfile.ZipFile(path)
            x = json.loads(self._zip.read(INDEX))
            parts = tuple(Part(**part) for part in x["parts"])
            left_out = tuple(map(_left_out, x["left_out"]))
            self.condensed = Condensed(x["key"], x["sha256"], parts, x["counts"], left_out)
        except (OSError, zipfile.BadZipFile, KeyError, ValueError, TypeError) as error:
            raise DataError(f"{path}: not a whole condensed recording ({error})") from None

    def __enter__(self) -> CondensedReader:
        return self

    def __exit__(self, *_: object) -> None:
        self._zip.close()

    def windows(
        self, part: int, source: str, engine: str, meaning: Mapping[str, Parameter]
    ) -> Iterator[WindowStatistics]:
        """Windows of a part, named after `source` and `engine`; meaning: what the parameters are."""
        try:
            texts = json.loads(self._zip.read(f"{part}.json"))
            rows = np.load(io.BytesIO(self._zip.read(f"{part}.npy")), allow_pickle=False)
        except (OSError, zipfile.BadZipFile, KeyError, ValueError) as error:
            raise DataError(f"{self._path}: part {part} is damaged ({error})") from None
        p = len(texts.get("parameters", ()))
        at = _columns(len(texts["conditions"]), p)
        both = _squares(rows[:, at["F"]], p), _squares(rows[:, at["V"]], p)
        for k, row in enumerate(rows):
            yield _window(texts, k, row, (both[0][k], both[1][k]), (source, engine), meaning)


def _as_mapping(left: LeftOut) -> dict[str, Any]:
    """What was left out without the name of its file, which may change."""
    return {**asdict(left), "file": ""}


def _left_out(told: Mapping[str, Any]) -> LeftOut:
    gate = None if told["gate"] is None else GateReport(**told["gate"])
    reading = ReadingCounts(**told.get("reading", {}))
    absent, gross = tuple(Absent(**a) for a in told["absent"]), GrossCounts(**told.get("gross", {}))
    stuck = [StuckRun(**run) for run in told.get("stuck", ())]
    return LeftOut(**{**told, "gate": gate, "absent": absent, "reading": reading, "gross": gross, "stuck": stuck})


def _columns(conditions: int, p: int) -> dict[str, slice]:
    triangle = p * (p + 1) // 2
    sizes = {"places": len(PLACES), "counted": len(COUNTED), "summed": len(SUMMED), "doubt": DOUBTS}
    sizes |= {"conditions": conditions, "s": p, "F": triangle, "V": triangle}
    found, at = {}, 0
    for name, size in sizes.items():
        found[name] = slice(at, at + size)
        at += size
    return found


def _matrix(windows: Sequence[WindowStatistics], conditions: Sequence[str], parameters: Sequence[str]) -> np.ndarray:
    p = len(parameters)
    at = _columns(len(conditions), p)
    upper = np.triu_indices(p)
    rows = np.full((len(windows), at["V"].stop), np.nan)
    for row, w in zip(rows, windows, strict=True):
        row[at["places"]] = [getattr(w, name) for name in PLACES]
        row[at["counted"]] = [getattr(w, name) for name in COUNTED]
        row[at["conditions"]] = [w.conditions.get(c, np.nan) for c in conditions]
        if (x := w.statistics) is None:
            continue
        row[at["summed"]] = [x.n, x.chi2, x.dof]
        row[at["doubt"]], row[at["s"]] = x.doubt, x.s
        row[at["F"]], row[at["V"]] = x.F[upper], x.V[upper]
    return rows


def _window(
    texts: Mapping[str, Any],
    k: int,
    row: np.ndarray,
    matrices: tuple[np.ndarray, np.ndarray],
    names: tuple[str, str],
    meaning: Mapping[str, Parameter],
) -> WindowStatistics:
    """Window k of a part, of matrices F and V, named by its source and engine."""
    parameters = tuple(texts.get("parameters", ()))
    at = _columns(len(texts["conditions"]), len(parameters))
    n, chi2, dof = row[at["summed"]]
    statistics = None
    if np.isfinite(n):
        statistics = LocalStatistics(
            parameters,
            np.array(texts["theta0"]),
            np.array(texts["prior_sigma"]),
            row[at["s"]].copy(),
            *matrices,
            int(n),
            float(chi2),
            float(dof),
            doubt=(float(row[at["doubt"]][0]), float(row[at["doubt"]][1]), float(row[at["doubt"]][2])),
            meaning=meaning,
        )
    places = dict(zip(PLACES, row[at["places"]].tolist(), strict=True))
    sensors, sensors_of = row[at["counted"]].tolist()
    flown = zip(texts["conditions"], row[at["conditions"]].tolist(), strict=True)
    key = str(k)
    return WindowStatistics(
        source=names[0],
        flight=texts["flights"][k],
        engine=names[1],
        first_line=int(places["first_line"]),
        last_line=int(places["last_line"]),
        start_s=places["start_s"],
        end_s=places["end_s"],
        records=int(places["records"]),
        outside=int(places["outside"]),
        incomplete=int(places["incomplete"]),
        failed=int(places["failed"]),
        statistics=statistics,
        reason=texts["reason"].get(key, ""),
        notes=tuple(texts["notes"].get(key, ())),
        sensors=int(sensors),
        sensors_of=int(sensors_of),
        silent=tuple(texts["silent"].get(key, ())),
        elsewhere=Counter({Elsewhere(c, j): m for c, j, m in texts["elsewhere"].get(key, ())}),
        conditions={c: v for c, v in flown if np.isfinite(v)},
        instruments=tuple(InstrumentFault(**fault) for fault in texts["instruments"].get(key, ())),
    )


def _squares(triangles: np.ndarray, p: int) -> np.ndarray:
    """Symmetric matrices (n, p, p) of their upper triangles (n, p(p + 1)/2)."""
    full = np.zeros((len(triangles), p, p))
    i, j = np.triu_indices(p)
    full[:, i, j] = full[:, j, i] = triangles
    return full


def _json(told: Mapping[str, Any]) -> bytes:
    return json.dumps(told, separators=(",", ":")).encode()


def _npy(rows: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, rows, allow_pickle=False)
    return stream.getvalue()
