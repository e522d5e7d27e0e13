"""Recordings as every command and library user reads them: mapped, masked, in chunks of constant memory.

One way in for files of the program's own columns and foreign ones that a recorder maps, complete or still being
written. What was not used is data; the report puts it in words. Whole flights are for identification and the search
for missing physics, which look at all records at once.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from itertools import chain, groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.engine.recall import MOMENT, NO_MOMENT
from enginediag_cli.errors import DataError, EngineDiagError, NoVerdictError
from enginediag_cli.identification.problem import TrainingRecording, select_records, training_recordings
from enginediag_cli.intake.agreement import SAMPLED, AgreementCheck, MismatchError, RecordingMismatch
from enginediag_cli.intake.selection import STDIN, RecordingSource, RequiredColumns, refuse_duplicates
from enginediag_cli.recordings.masking import LiveMasker, MaskingRules, RecordMasker
from enginediag_cli.recordings.read import open_table, read
from enginediag_cli.recordings.repeated import StuckRun
from enginediag_cli.recordings.source import GrowingFile, needs_whole_file
from enginediag_cli.recordings.table import (
    NATIVE_DIALECT,
    MissingColumn,
    ReadingCounts,
    Recording,
    TableFile,
    concat,
    rechunk,
)

if TYPE_CHECKING:
    from enginediag_cli.engine.recall import Tapes
    from enginediag_cli.recordings.masking import GateReport, MaskCounts
    from enginediag_cli.recordings.recorder import EngineMapper, Recorder


EXCURSION = 3
"""Records in a row from which gross errors are reported as a short excursion: it may have been the engine."""


LINES = 20
"""Lines of the file that are named for each column; a longer list helps nobody."""


NOTEWORTHY = 0.02
"""Share of gross readings from which they are a finding about the sensor: good channels have a tenth of that."""


@dataclass(frozen=True)
class GrossCounts:
    """What was rejected of some records as gross errors, by column.

    readings: of a sensor; wrong_inputs: records of no use because that input was wrong ("": most readings were, and no
    one input explains it); lines: the first `LINES` of either; excursions: first line, last line and number of
    `EXCURSION` readings or more in a row; dead: sensors whose readings are none of this engine; spoilt: those with so
    many gross readings that all were kept; judged: records that all of this is out of.
    """

    readings: Mapping[str, int] = field(default_factory=dict)
    wrong_inputs: Mapping[str, int] = field(default_factory=dict)
    lines: Mapping[str, Sequence[int]] = field(default_factory=dict)
    excursions: Mapping[str, Sequence[Sequence[int]]] = field(default_factory=dict)
    dead: Sequence[str] = ()
    spoilt: Sequence[str] = ()
    judged: int = 0

    @property
    def rejected(self) -> int:
        """Readings rejected, those of records with a wrong input not counted."""
        return sum(self.readings.values())

    def __bool__(self) -> bool:
        return bool(self.readings or self.wrong_inputs or self.spoilt)

    def share(self, column: str) -> float:
        """Share of the records in which a sensor's reading, or an input, was gross."""
        return (self.readings.get(column, 0) + self.wrong_inputs.get(column, 0)) / max(self.judged, 1)

    def noteworthy(self, column: str) -> bool:
        """Whether a column has more gross errors than a good channel has."""
        several = self.readings.get(column, 0) + self.wrong_inputs.get(column, 0) > 1
        return column in self.spoilt or (several and self.share(column) > NOTEWORTHY)

    def __add__(self, other: GrossCounts) -> GrossCounts:
        if not other:
            return replace(self, judged=self.judged + other.judged)

        def total(a: Mapping[str, int], b: Mapping[str, int]) -> dict[str, int]:
            return {c: a.get(c, 0) + b.get(c, 0) for c in (*a, *(c for c in b if c not in a))}

        def first(a: Mapping[str, Sequence[Any]], b: Mapping[str, Sequence[Any]]) -> dict[str, Sequence[Any]]:
            return {c: [*a.get(c, ()), *b.get(c, ())][:LINES] for c in (*a, *(c for c in b if c not in a))}

        return GrossCounts(
            total(self.readings, other.readings),
            total(self.wrong_inputs, other.wrong_inputs),
            first(self.lines, other.lines),
            first(self.excursions, other.excursions),
            sorted({*self.dead, *other.dead}),
            sorted({*self.spoilt, *other.spoilt}),
            self.judged + other.judged,
        )


@dataclass
class ExcludedData:
    """Of one `file`, and one `engine` of it where the recorder distinguishes engines.

    records: read from it, those of other engines not counted; columns: column → reason → readings masked, `readings`
    of that column in all; frozen, repeated: whole records not used, because nothing in them moved or because they
    were there before; gate: what the recorder's stability gate kept; absent: sensors without a column; reading: what
    of the file was no record or no reading; gross: what was rejected as gross errors of readings and inputs, judged by
    the model; undecided: what the recorder, a draft, leaves open; stuck: runs of readings that repeat themselves where
    they should have moved.
    Counts are complete when the recording has been read to its end.
    """

    file: str
    engine: str = ""
    records: int = 0
    columns: dict[str, dict[str, int]] = field(default_factory=dict)
    readings: dict[str, int] = field(default_factory=dict)
    frozen: int = 0
    repeated: int = 0
    gate: GateReport | None = None
    absent: tuple[MissingColumn, ...] = ()
    reading: ReadingCounts = field(default_factory=ReadingCounts)
    gross: GrossCounts = field(default_factory=GrossCounts)
    undecided: tuple[str, ...] = ()
    stuck: list[StuckRun] = field(default_factory=list)

    def take_mask_counts(self, counts: MaskCounts) -> None:
        """Take over what a masker has counted so far."""
        found = {c: {why: n for why, n in reasons.items() if n} for c, reasons in counts.columns.items()}
        self.columns = {c: reasons for c, reasons in found.items() if reasons}
        self.readings = {c: counts.readings[c] for c in self.columns}
        self.frozen, self.repeated = counts.frozen, counts.repeated
        self.stuck = list(counts.stuck)

    def add_stuck(self, runs: Sequence[StuckRun]) -> None:
        """Take over runs that the model shows to be stuck."""
        for run in runs:
            reasons = self.columns.setdefault(run.column, {})
            reasons["stuck"] = reasons.get("stuck", 0) + run.records
            self.readings.setdefault(run.column, self.records)
        self.stuck += runs

    def take_mapper_counts(self, live: EngineMapper) -> None:
        """Take over what a recorder has counted so far."""
        self.take_mask_counts(live.counts)
        self.records = live.records
        if live.recorder.selects:
            self.gate = live.gate


class InputHistory:
    """One reading of a file onto `tapes`; with None records keep no past. Where a gate or averages leave records out,
    the whole file is put on the tapes first, and what the gate keeps is found there by its line."""

    _readings = 0

    def __init__(self, tapes: Tapes | None):
        InputHistory._readings += 1
        self._tapes, self._reading = tapes, InputHistory._readings
        self._known: dict[str, tuple[np.ndarray, np.ndarray]] = {}

    def add_whole_file(self, recorder: Recorder, file: str, inputs: tuple[str, ...], engines: tuple[str, ...]) -> None:
        """Put every record of a file on the tapes that a recorder's gate would leave out. Raises DataError."""
        if self._tapes is None or not recorder.selects:
            return
        every = replace(recorder, steady=None, average_s=0.0)
        found: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
        for name, part in every.stream(file, inputs=inputs, engines=engines):
            found.setdefault(name, []).append((part.line, self._moments(name, part)))
        for name, parts in found.items():
            lines, moments = (np.concatenate(x) for x in zip(*parts, strict=True))
            self._known[name] = lines, moments

    def add_history(self, name: str, part: Recording) -> Recording:
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


CHUNK = 5000
"""Records read at once: rows appear while a long recording is being read, engine calls stay few."""


@dataclass
class RecordingLoader:
    """The recordings of a `source` for an engine that reads the columns `wanted` (None: for statistics alone).

    fleet: a recording of several engines may be read whole; otherwise one of them has to be wanted by name.
    agreement: what recordings are compared with before they are handed on; one that cannot be of that engine, or in
    these units, raises DataError, or is kept in `mismatches` where that is accepted.
    keep_going: a file that cannot be read is named in `unread`, with the reason, and the others are read all the same.
    left_out, provenance, columns: what was excluded, by file and engine, the `#` lines of the files' heads, and the
    names of all their columns, as far as they have been read.
    """

    source: RecordingSource
    required: RequiredColumns | None
    fleet: bool = False
    agreement: AgreementCheck | None = None
    keep_going: bool = False
    unread: dict[str, str] = field(default_factory=dict)
    excluded: list[ExcludedData] = field(default_factory=list)
    mismatches: list[RecordingMismatch] = field(default_factory=list)
    provenance: list[str] = field(default_factory=list)
    columns: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        refuse_duplicates(self.source.files)
        self.recorder: Recorder | None = None
        if self.source.recorder:
            from enginediag_cli.recordings.recorder_file import load_recorder

            self.recorder = load_recorder(self.source.recorder)

    def files(self) -> Iterator[LoadedFile]:
        """The files in turn; each has to be read before the next. Raises DataError."""
        for name in self.source.files:
            with ExitStack() as opened:
                try:
                    if self.keep_going and len(self.source.files) > 1:
                        refuse_silent_pipe(name)
                    table = opened.enter_context(open_table(name)) if self.recorder is None else None
                except DataError as error:
                    self.skip_file(name, error)
                    continue
                yield LoadedFile(self, name, table)

    def chunks(self) -> Iterator[Recording]:
        """Masked chunks of all files in turn. Raises DataError, NoVerdictError."""
        for file in self.files():
            try:
                yield from file.masked()
            except (DataError, NoVerdictError) as error:
                self.skip_file(file.name, error)

    def skip_file(self, name: str, error: EngineDiagError) -> None:
        """Go on without the rest of a file, which `unread` names; raises the error where there is nothing to go on
        with: no `keep_going`, or no other file that can be read."""
        if not self.keep_going:
            raise error
        self.unread[name] = str(error)
        if len(self.unread) == len(self.source.files):
            raise error

    def make_ungated(self) -> RecordingLoader | None:
        """The same with every record that was read, steady or not, and no averages; None where nothing but masks leaves
        records out, or where what has been read cannot be read again."""
        recorder = self.recorder
        if recorder is None or not recorder.selects or STDIN in self.source.files:
            return None
        every = RecordingLoader(self.source, self.required, self.fleet)
        every.recorder = replace(recorder, steady=None, average_s=0.0)
        return every

    def add_head(self, recording: Recording) -> None:
        """Keep what the head of a recording says: where it comes from, and its columns."""
        self.add_provenance(recording.provenance)
        self.columns += [column for column in recording.order if column not in self.columns]

    def add_provenance(self, provenance: Iterable[str]) -> None:
        """Keep the `#` lines of a file's head."""
        self.provenance += [line for line in provenance if line not in self.provenance]

    def compare(self, recording: Recording, engine: str = "") -> None:
        """Compare records of the engine that the recorder calls `engine` with the engine. Raises DataError."""
        if self.agreement is None:
            return
        # where nothing is to be stopped, nobody needs to know why
        search = not self.source.accept_mismatch
        found = self.agreement.find_mismatches(recording, engine, self.recorder, search)
        if found and search:
            raise MismatchError(found)
        self.mismatches += [f for f in found if str(f) not in {str(m) for m in self.mismatches}]


class LoadedFile:
    """One file of an intake. `table`: the open file; None where a recorder maps it."""

    def __init__(self, intake: RecordingLoader, name: str, table: TableFile | None):
        self._intake, self.name, self.table = intake, name, table

    def masked(self) -> Iterator[Recording]:
        """Its chunks as they are judged; what was not used goes to the intake's `left_out`."""
        if self._intake.recorder is not None:
            yield from _foreign_records(self._intake, self.name, CHUNK)
        else:
            assert self.table is not None
            yield from _own_records(self._intake, self.table, CHUNK)


def _own_records(intake: RecordingLoader, source: Any, block: int, *, live: bool = False) -> Iterator[Recording]:
    """Masked records of a file in the program's own columns. live: it is still being written."""
    wanted = intake.required
    assert wanted is not None
    left = ExcludedData(str(getattr(source, "name", source)))
    intake.excluded.append(left)
    past, masker = InputHistory(wanted.tapes), None
    chunks = read(source, declared=wanted.declared, chunk_records=block, tolerant=live, counts=left.reading)
    for chunk in chain(select_engine(chunks, intake.source.engine_instance), [None]):
        if chunk is None:
            parts = masker.end() if masker is not None else []
        else:
            if masker is None:
                intake.add_head(chunk)
                left.absent = wanted.find_missing(chunk)
                masker = (LiveMasker if live else RecordMasker)(masking_rules(wanted, chunk))
            left.records += len(chunk)
            if not live:
                intake.compare(chunk)
            parts = masker.add(chunk)
        if masker is not None:
            left.take_mask_counts(masker.counts)
        yield from (past.add_history("", part) for part in parts if len(part) or not live)


def _foreign_records(intake: RecordingLoader, source: Any, block: int, *, live: bool = False) -> Iterator[Recording]:
    """What the recorder keeps of a foreign file, in chunks that each are of one engine. live: it is still being
    written."""
    recorder, wanted, columns = intake.recorder, intake.source.engine_instance, intake.required
    assert recorder is not None and columns is not None
    name = str(getattr(source, "name", source))
    chosen = choose_engines(recorder.engines, wanted, name, fleet=intake.fleet and not live)
    stream = recorder.stream(source, block, columns.input_columns, chosen, live=live)
    stream.watch = as_read = _RawComparison(intake, recorder, chosen)
    left_out = {
        engine: ExcludedData(name, engine, undecided=recorder.undecided, reading=stream.counts)
        for engine in stream.engines
    }
    intake.excluded += left_out.values()
    past = InputHistory(None if live and recorder.selects else columns.tapes)
    if not live:
        past.add_whole_file(recorder, name, columns.input_columns, tuple(stream.engines))
    named = dict.fromkeys(stream.engines, False)
    for engine, recording in _explain_refusals(stream, as_read):
        left = left_out[engine]
        if not left.records:
            intake.add_head(recording)
            left.absent = columns.find_missing(recording)
        left.take_mapper_counts(stream.engines[engine])
        if recorder.selects:
            intake.compare(recording, engine)
        part = past.add_history(engine, recording)
        if wanted and engine != wanted:
            part = part.select(engine_rows(recording, wanted))
            named[engine] |= bool(len(part))
        yield part
    for engine, mapped in stream.engines.items():
        left_out[engine].take_mapper_counts(mapped)
        if wanted and engine != wanted and not named[engine] and not live:
            raise DataError(f"{name}: no record of engine {wanted!r}")


def _explain_refusals(
    stream: Iterable[tuple[str, Recording]], as_read: _RawComparison
) -> Iterator[tuple[str, Recording]]:
    """The stream; where nothing is left of it, because of a wrong unit perhaps, that is what is raised."""
    try:
        yield from stream
    except (DataError, NoVerdictError) as error:
        if not isinstance(error, MismatchError):
            as_read.compare()
        raise


class _RawComparison:
    """Records of a foreign file as they are in it, compared with the engine before limits and masks take readings in
    another unit for impossible ones; behind a gate for steady records, only where it keeps nothing."""

    def __init__(self, intake: RecordingLoader, recorder: Recorder, engines: Collection[str]):
        self._intake, self._recorder, self._engines = intake, recorder, engines
        self._latest: Recording | None = None

    def __call__(self, chunk: Recording) -> None:
        self._latest = chunk
        if not self._recorder.selects:
            self.compare()

    def compare(self) -> None:
        """The latest of them. Raises DataError."""
        if self._intake.agreement is None or self._latest is None:
            return
        from enginediag_cli.recordings.recorder import ColumnConversion

        chunk, self._latest = self._latest, None
        few = chunk.select(slice(0, None, max(1, len(chunk) // SAMPLED)))
        for name in self._engines:
            converted = ColumnConversion(self._recorder, name).add(few, end=True)
            self._intake.compare(self._recorder.derive(converted), name)


def refuse_silent_pipe(name: str) -> None:
    """Raises DataError for a pipe in a folder, to which nobody may ever write; those of a shell (/dev/fd/63) pass."""
    try:
        silent = stat.S_ISFIFO(os.stat(name).st_mode) and not os.path.realpath(name).startswith(("/proc/", "/dev/"))
    except OSError:
        return
    if silent:
        raise DataError(f"{name}: a pipe, not a file; among several files it would hold up the others")


def masking_rules(wanted: RequiredColumns, recording: Recording) -> MaskingRules:
    """What is searched for gross errors in a recording of these columns."""
    inputs = [c for c in (*wanted.inputs, *wanted.optional) if c in recording.columns]
    return MaskingRules([c for c in wanted.sensors if c in recording.columns], inputs)


def choose_engines(names: Collection[str], wanted: str, file: str, *, fleet: bool) -> tuple[str, ...]:
    """Which of a recorder's engines are meant; all where it distinguishes none. Raises DataError."""
    known = [name for name in names if name]
    if wanted in known:
        return (wanted,)
    if len(known) > 1 and (wanted or not fleet):
        what = f"no engine {wanted!r}" if wanted else "several engines"
        raise DataError(f"{file}: {what} in this recording; choose with --engine-instance one of {', '.join(known)}")
    return tuple(names)


def select_engine(chunks: Iterator[Recording], wanted: str) -> Iterator[Recording]:
    """The records that name this engine in their column `engine`; all records for "". Raises DataError when there is
    no such column, or no such record when the file has ended."""
    if not wanted:
        yield from chunks
        return
    met: dict[str, None] = {}
    source = ""
    for chunk in chunks:
        rows = engine_rows(chunk, wanted)
        met |= dict.fromkeys(chunk.text["engine"])
        source = chunk.source
        yield chunk.select(rows)
    if wanted not in met:
        there = ", ".join(name for name in met if name) or "none is named"
        raise DataError(f"{source}: no record of engine {wanted!r} ({there})")


def engine_rows(chunk: Recording, wanted: str) -> np.ndarray:
    """Mask (N,) of the records that name this engine. Raises DataError when there is no column `engine`."""
    if "engine" not in chunk.text:
        raise DataError(f"{chunk.source}: no column `engine`, in which records would name {wanted!r}")
    return np.array(chunk.text["engine"], dtype=str) == wanted


@dataclass(frozen=True)
class WholeFlight:
    """One flight of one engine: its records, and which file it is of. `engine` is "" where nothing names one."""

    file: str
    engine: str
    recording: TrainingRecording

    @property
    def records(self) -> int:
        return len(next(iter(self.recording.columns.values()), ()))


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
    total: int = 0
    halved: int = 0

    def thin(self, chunks: Iterable[Recording]) -> Recording:
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
        self.total += first
        return concat(held)

    def thin_flights(self, flights: Sequence[tuple[WholeFlight, int]]) -> list[WholeFlight]:
        """The flights, each with how often its records were halved, as if they had come as one recording."""
        while True:
            found, first = [], 0
            for flight, halved in flights:
                n = flight.records
                rows = np.flatnonzero(((first + np.arange(n)) // RUN) % 2 ** (self.halved - halved) == 0)
                first += n
                if len(rows) == n:
                    found.append(flight)
                elif len(rows):
                    found.append(replace(flight, recording=select_records(flight.recording, rows)))
            kept = sum(f.records for f in found)
            if not self.most or kept <= self.most:
                return found
            self.halved += 1


def load_flights(intake: RecordingLoader, thinning: Thinning | None = None) -> list[WholeFlight]:
    """Load every flight of every file, in their order, one engine after the other within a file.

    Parameters
    ----------
    intake : RecordingLoader
    thinning : Thinning, optional
        How many records are kept; all by default.

    Returns
    -------
    list of WholeFlight

    Raises
    ------
    DataError
        For a file that cannot be read.
    NoVerdictError
        If none of the files has a record.
    """
    thinning = thinning or Thinning()
    flights: list[tuple[WholeFlight, int]] = []
    for file in intake.files():
        flights += [(flight, thinning.halved) for flight in list(_read_flights(intake, file, thinning))]
        if thinning.most and sum(f.records for f, _ in flights) > 2 * thinning.most:
            flights = [(flight, thinning.halved) for flight in thinning.thin_flights(flights)]
    found = thinning.thin_flights(flights)
    if not any(flight.records for flight in found):
        raise NoVerdictError(f"{', '.join(map(intake.source.label, intake.source.files))}: there is no record")
    return found


def load_ungated_flights(intake: RecordingLoader, files: Collection[str]) -> list[WholeFlight]:
    """The flights of these files with the records that the recorder excluded because the engine was not steady,
    nothing averaged; none where there is no such recorder (`Intake.ungated`). Raises DataError."""
    every = intake.make_ungated()
    if every is None:
        return []
    return [flight for file in every.files() if file.name in files for flight in _read_flights(every, file, Thinning())]


def _read_flights(intake: RecordingLoader, file: LoadedFile, thinning: Thinning) -> Iterator[WholeFlight]:
    label = intake.source.label(file.name)
    # the chunks of a file are put together as long as they have the same columns
    for _, chunks in groupby(file.masked(), key=lambda chunk: frozenset(chunk.order)):
        recording = thinning.thin(chunks)
        column = np.asarray(recording.text.get("engine", [""] * len(recording)))
        for engine in dict.fromkeys(column.tolist()):
            for part in training_recordings(recording.select(column == engine), label):
                yield WholeFlight(file.name, engine, part._replace(engine=engine))


def follow_chunks(intake: RecordingLoader, block: int, idle_s: float) -> Iterator[Recording]:
    """Masked blocks of up to `block` records of each file in turn; a file to which nothing is added for `idle_s`
    seconds has ended. What only a longer stretch shows (spikes) is not searched for."""
    codec = NATIVE_DIALECT.codec if intake.recorder is None else intake.recorder.dialect.codec
    for file in intake.source.files:
        source: Any = file if file == STDIN or needs_whole_file(file) else GrowingFile(file, idle_s, codec=codec)
        if intake.recorder is None:
            yield from _own_records(intake, source, block, live=True)
        else:
            parts = _foreign_records(intake, source, block, live=True)
            yield from (part for part in rechunk(parts, block) if len(part))
