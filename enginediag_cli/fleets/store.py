"""The store: a folder with the statistics of recordings, each under the key of its content and settings.

A file appears under its name when it is whole, or not at all, and is never changed: runs that are killed lose what they
had in work, and runs at the same time write the same bytes under the same name. Nothing else has to be kept: which
recordings are known follows from the names of the files. What is acknowledged of engines stands beside them, in a file
of its own.

Statistics of a recording as a file: an .npz whose members are parts, windows of one engine each, and an index.

A part is one matrix, a row for each window: counts and times, then the conditions flown, s, and the upper triangles of
F and V; beside it stand texts, and what its windows share. `index.json`, the last member, says what there is: without
it the file is not whole. Parts are written as they come, so that memory holds one of them, and read one by one. The
same windows give the same bytes.

From recordings to statistics, one batch of recordings after the other: the work that is done in many places.

Statistics have the form of a series (`residuals/reduced.py`): windows of an engine are compared with each other,
so that what is uncertain about nominal, the same in all of them, has no part in it and need not be computed.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import zipfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO

import numpy as np

from enginediag_cli import __version__
from enginediag_cli.errors import DataError, EngineDiagError
from enginediag_cli.fleets.findings import AcknowledgedChange, Acknowledgement, IntervalEstimate
from enginediag_cli.intake.loader import ExcludedData, GrossCounts, RecordingLoader
from enginediag_cli.intake.selection import RecordingSource, required_columns
from enginediag_cli.parameters import Parameter
from enginediag_cli.recordings.masking import GateReport
from enginediag_cli.recordings.repeated import StuckRun
from enginediag_cli.recordings.source import file_sha256
from enginediag_cli.recordings.table import MissingColumn, ReadingCounts, Recording
from enginediag_cli.recordings.write import open_binary_output
from enginediag_cli.residuals.gross_gate import GrossErrorGate
from enginediag_cli.residuals.instruments import InstrumentFault
from enginediag_cli.residuals.monitor import Monitor, recording_agreement
from enginediag_cli.residuals.pipeline import window_statistics
from enginediag_cli.residuals.reduced import comparison_monitor, keep_monitored, monitor_for_series
from enginediag_cli.residuals.statistics import LocalStatistics
from enginediag_cli.residuals.windows import Extrapolation, WindowPlan, WindowStatistics

FORMAT = 3
"""Of these files; others are made anew."""
INDEX = "index.json"
PLACES = ("first_line", "last_line", "start_s", "end_s", "records", "outside", "incomplete", "failed")
COUNTED = ("sensors", "sensors_of")
SUMMED = ("n", "chi2", "dof")
DOUBTS = 3
"""Numbers of `LocalStatistics.doubt`."""


@dataclass(frozen=True)
class CondensedPart:
    """What the index says of a part: its engine as the recording names it, windows, those with statistics, records."""

    engine: str
    windows: int
    statistics: int
    records: int


@dataclass(frozen=True)
class ReducedRecording:
    """What the index says of a whole recording. key: of its content and making; sha256: of its bytes; parts, in the
    order of the file; counts: of records and windows by what became of them."""

    key: str
    sha256: str
    parts: tuple[CondensedPart, ...]
    counts: Mapping[str, int] = field(default_factory=dict)
    excluded: tuple[ExcludedData, ...] = ()


class CondensedWriter:
    """Writes parts to an open stream; `close` writes the index."""

    def __init__(self, stream: BinaryIO):
        self._zip = zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED, allowZip64=True)
        self._parts: list[CondensedPart] = []

    def add(self, engine: str, windows: Sequence[WindowStatistics]) -> CondensedPart:
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
            str(k): [[e.column, e.judged, n] for e, n in w.extrapolation.items()]
            for k, w in enumerate(windows)
            if w.extrapolation
        }
        texts["instruments"] = {
            str(k): [asdict(fault) for fault in w.instruments] for k, w in enumerate(windows) if w.instruments
        }
        part = CondensedPart(
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

    def close(self, whole: ReducedRecording) -> None:
        """Write the index: what there is to say of the whole recording, and its parts."""
        told: dict[str, Any] = {"format": FORMAT, "key": whole.key, "sha256": whole.sha256, "counts": whole.counts}
        told["left_out"] = [_excluded_to_mapping(left) for left in whole.excluded]
        self._member(INDEX, _json({**told, "parts": [asdict(part) for part in self._parts]}))
        self._zip.close()

    def leave(self) -> None:
        """Write nothing more, whether or not there is an index; the file is the caller's."""
        self._zip.fp = None

    def _member(self, name: str, data: bytes) -> None:
        info = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))  # no time: the same data give the same bytes
        self._zip.writestr(info, data)


class CondensedReader:
    """Reads a file of statistics of windows; DataError names one that is damaged. condensed: what its index says."""

    def __init__(self, path: str):
        self._path = path
        try:
            self._zip = zipfile.ZipFile(path)
            x = json.loads(self._zip.read(INDEX))
            parts = tuple(CondensedPart(**part) for part in x["parts"])
            left_out = tuple(map(_excluded_from_mapping, x["left_out"]))
            self.condensed = ReducedRecording(x["key"], x["sha256"], parts, x["counts"], left_out)
        except (OSError, zipfile.BadZipFile, KeyError, ValueError, TypeError) as error:
            raise DataError(f"{path}: not the complete statistics of a recording ({error})") from None

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


def _excluded_to_mapping(left: ExcludedData) -> dict[str, Any]:
    """Excluded data without the name of their file, which may change."""
    return {**asdict(left), "file": ""}


def _excluded_from_mapping(told: Mapping[str, Any]) -> ExcludedData:
    gate = None if told["gate"] is None else GateReport(**told["gate"])
    reading = ReadingCounts(**told.get("reading", {}))
    absent, gross = tuple(MissingColumn(**a) for a in told["absent"]), GrossCounts(**told.get("gross", {}))
    stuck = [StuckRun(**run) for run in told.get("stuck", ())]
    return ExcludedData(**{**told, "gate": gate, "absent": absent, "reading": reading, "gross": gross, "stuck": stuck})


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
        extrapolation=Counter({Extrapolation(c, j): m for c, j, m in texts["elsewhere"].get(key, ())}),
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


RECORDINGS, NOMINALS = "recordings", "nominals"
ACKNOWLEDGED = "acknowledged.json"
"""File of what is acknowledged; people may read and edit it."""


class FleetStore:
    """The store in `folder`, which is made when something is written."""

    def __init__(self, folder: str | Path):
        self.folder = Path(folder)

    def path(self, key: str) -> Path:
        """Where the recording of this key is, or would be."""
        return self.folder / RECORDINGS / key[:2] / f"{key}.npz"

    def find(self, key: str) -> ReducedRecording | None:
        """What is known of a recording; None where it is not, or not whole."""
        path = self.path(key)
        if not path.exists():
            return None
        try:
            with CondensedReader(str(path)) as reader:
                return reader.condensed
        except DataError:
            return None

    @contextmanager
    def writing(self, key: str) -> Iterator[CondensedWriter]:
        """A writer of this key's file, which is there once the block has ended well. Raises OSError."""
        path = self.path(key)
        path.parent.mkdir(parents=True, exist_ok=True)
        with open_binary_output(path) as stream:
            writer = CondensedWriter(stream)
            try:
                yield writer
            finally:
                writer.leave()

    def keys(self) -> Iterator[str]:
        """Of all recordings that are there, in order."""
        yield from (path.stem for path in sorted((self.folder / RECORDINGS).glob("*/*.npz")))

    def partial(self) -> Iterator[Path]:
        """Files that a run is writing, or was when it was killed."""
        yield from sorted(self.folder.glob(f"{RECORDINGS}/*/.*.part"))
        yield from sorted(self.folder.glob(f"{NOMINALS}/.*"))

    def nominal(self, key: str) -> Path:
        """Where the common model of this key is, or would be."""
        return self.folder / NOMINALS / f"{key}.yaml"

    def acknowledgements(self) -> dict[str, Acknowledgement]:
        """Serial number → what is acknowledged of the engine. Raises DataError for a damaged file."""
        path = self.folder / ACKNOWLEDGED
        if not path.exists():
            return {}
        try:
            stored = json.loads(path.read_text(encoding="utf-8"))
            return {serial: _acknowledgement(serial, x) for serial, x in stored["engines"].items()}
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise DataError(f"{path}: not the acknowledgements of a fleet ({error}); fix or remove it") from None

    def keep_acknowledgements(self, known: Mapping[str, Acknowledgement]) -> None:
        """Write them in the place of those that are there. Raises OSError."""
        self.folder.mkdir(parents=True, exist_ok=True)
        engines = {}
        for serial in sorted(known):
            engines[serial] = {k: v for k, v in asdict(known[serial]).items() if k not in ("serial", "grown")}
        with open_binary_output(self.folder / ACKNOWLEDGED) as stream:
            stream.write(json.dumps({"engines": engines}, indent=1).encode() + b"\n")


def _acknowledgement(serial: str, stored: Mapping[str, Any]) -> Acknowledgement:
    changes = [
        AcknowledgedChange(x["parameter"], IntervalEstimate(**x["change"]), x["unit"]) for x in stored["changes"]
    ]
    return Acknowledgement(serial, stored["date"], int(stored["flights"]), tuple(changes), stored["note"])


@contextmanager
def opened_store(folder: str | Path | None) -> Iterator[FleetStore]:
    """The store in a folder; with None one that is removed in the end."""
    if folder is not None:
        yield FleetStore(os.path.abspath(folder))
        return
    with TemporaryDirectory(prefix="enginediag-fleet-") as temporary:
        yield FleetStore(temporary)


@dataclass(frozen=True)
class CondensingSettings:
    """nominal: path of its file, and `fingerprint` of what is in it; recorder: path of its file, "" for none, and the
    SHA-256 of that; plan and linearise: as of `residuals.files.Judging`; accept_mismatch: as of `Source`."""

    nominal: str
    fingerprint: str
    recorder: str
    recorder_sha256: str
    plan: WindowPlan
    linearise: str
    accept_mismatch: bool = False

    def key(self, sha256: str) -> str:
        """Of a recording whose bytes have this SHA-256: equal content and settings have the same, whatever files are
        called."""
        settings = (self.plan.length, self.plan.step, self.plan.in_time, self.plan.whole_flights, self.linearise)
        accepted = ("mismatch accepted",) if self.accept_mismatch else ()
        parts = (__version__, FORMAT, sha256, self.fingerprint, self.recorder_sha256, *settings, *accepted)
        return hashlib.sha256("\n".join(map(str, parts)).encode()).hexdigest()


PART = 2000
"""Windows of one engine that are written together: a tenth of a gigabyte is the most that a worker may hold of them,
each with two matrices of up to forty parameters."""


@dataclass(frozen=True)
class CondenseTask:
    """Recordings of equal settings that are reduced together; store: folder in which they are kept."""

    paths: tuple[str, ...]
    making: CondensingSettings
    store: str


@dataclass(frozen=True)
class CondenseOutcome:
    """Of one recording: what became of it, or why nothing did. fresh: it was computed now, not found."""

    path: str
    condensed: ReducedRecording | None = None
    fresh: bool = False
    trouble: str = ""


def condense(task: CondenseTask) -> tuple[CondenseOutcome, ...]:
    """Reduce the recordings of a task that the store does not hold; the same wherever it runs. A recording that
    cannot be read is an outcome, no error, and costs the others nothing."""
    store = FleetStore(task.store)
    found: dict[str, CondenseOutcome] = {}
    todo: dict[str, str] = {}
    again: dict[str, str] = {}
    for path in task.paths:
        try:
            sha256 = file_sha256(path)
        except OSError as error:
            found[path] = CondenseOutcome(path, trouble=f"cannot be read: {(error.strerror or str(error)).lower()}")
            continue
        known = store.find(task.making.key(sha256))
        if known is not None:
            found[path] = CondenseOutcome(path, known)
        elif sha256 in todo:  # the same bytes under another name
            again[path] = todo[sha256]
        else:
            todo[sha256] = path
    found |= _condense_missing(task.making, store, {path: sha256 for sha256, path in todo.items()})
    found |= {path: replace(found[first], path=path, fresh=False) for path, first in again.items()}
    return tuple(found[path] for path in task.paths)


def _condense_missing(
    making: CondensingSettings, store: FleetStore, todo: dict[str, str]
) -> dict[str, CondenseOutcome]:
    """Together, since a call of the engine costs more than a short recording; one by one where one of them is bad."""
    if not todo:
        return {}
    try:
        return _condense_together(making, store, todo)
    except EngineDiagError as error:
        if len(todo) == 1:
            (path,) = todo
            return {path: CondenseOutcome(path, trouble=str(error))}
    return {p: o for path, sha in todo.items() for p, o in _condense_missing(making, store, {path: sha}).items()}


def _condense_together(
    making: CondensingSettings, store: FleetStore, todo: dict[str, str]
) -> dict[str, CondenseOutcome]:
    monitor = series_monitor(making.nominal, making.fingerprint)
    wanted = required_columns(monitor.engine, monitor.sensors)
    source = RecordingSource(tuple(todo), making.recorder or None, accept_mismatch=making.accept_mismatch)
    intake = RecordingLoader(source, wanted, fleet=True, agreement=recording_agreement(monitor))
    found: dict[str, CondenseOutcome] = {}
    with ExitStack() as stack:
        keeping = {
            p: _RecordingWriter(p, making.key(s), s, stack.enter_context(store.writing(making.key(s))))
            for p, s in todo.items()
        }
        gate = GrossErrorGate(monitor)
        windows = window_statistics(
            monitor,
            gate.clean(_chunks(intake)),
            making.plan,
            linearise=making.linearise,
            condense=partial(keep_monitored, monitor),
        )
        for window in windows:
            mine = (left for left in intake.excluded if left.file == window.source)
            masked = [run for left in mine if left.engine in ("", window.engine) for run in left.stuck]
            keeping[window.source].take(gate.annotate(window, masked))
        gate.report(intake.excluded)
        for path, kept in keeping.items():
            left_out = tuple(left for left in intake.excluded if left.file == path)
            found[path] = CondenseOutcome(path, kept.close(left_out), fresh=True)
    return found


@lru_cache(maxsize=4)
def series_monitor(nominal: str, fingerprint: str) -> Monitor:
    """The monitor of the windows of a series: every instrument is suspected, nominal is not. One per worker and
    nominal file; fingerprint: what that file held when the work was planned."""
    return comparison_monitor(whole_monitor(nominal, fingerprint))


@lru_cache(maxsize=4)
def whole_monitor(nominal: str, fingerprint: str) -> Monitor:
    """The monitor of a series with what is uncertain about nominal, as `trend` opens it."""
    from enginediag_cli.intake.selection import open_baseline
    from enginediag_cli.residuals.monitor import build_monitor

    return monitor_for_series(build_monitor(open_baseline(nominal), sensors=True))


def _chunks(intake: RecordingLoader) -> Iterator[Recording]:
    """Masked chunks of all files, each named by its whole path: two folders may hold recordings of one name."""
    for file in intake.files():
        for chunk in file.masked():
            yield replace(chunk, source=file.name)


class _RecordingWriter:
    """The windows of one recording on their way into its file, engine by engine."""

    def __init__(self, path: str, key: str, sha256: str, writer: CondensedWriter):
        self._path, self._key, self._sha256, self._writer = path, key, sha256, writer
        self._waiting: dict[str, list[WindowStatistics]] = {}
        self._parts: list[CondensedPart] = []
        self._counts: Counter[str] = Counter()

    def take(self, window: WindowStatistics) -> None:
        mine = self._waiting.setdefault(window.engine, [])
        mine.append(replace(window, solution=None, weights=None))
        self._counts.update(window.counts)
        if sum(map(len, self._waiting.values())) >= PART:
            self._flush()

    def _flush(self) -> None:
        self._parts += [self._writer.add(engine, windows) for engine, windows in self._waiting.items()]
        self._waiting = {}

    def close(self, left_out: Sequence[ExcludedData]) -> ReducedRecording:
        self._flush()
        whole = ReducedRecording(self._key, self._sha256, tuple(self._parts), dict(self._counts), tuple(left_out))
        self._writer.close(whole)
        return whole
