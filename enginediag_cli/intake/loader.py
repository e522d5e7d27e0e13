"""The past of every record: whatever is read goes onto the engine's tapes, and is told where it stands there.

Recordings as every command reads them: mapped, of the engine wanted, masked, in chunks of constant memory.

Whole flights of an intake, for identification and the search for missing physics, which look at all at once.

Recordings that are still being written: blocks of records as they come.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from itertools import chain, groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.engine.tape import MOMENT, NO_MOMENT
from enginediag_cli.errors import DataError, EngineDiagError, NoVerdictError
from enginediag_cli.identification.problem import TrainingRecording, part_of, training_recordings
from enginediag_cli.intake.agreement import SAMPLED, Agreement, Disagreement, MismatchError
from enginediag_cli.intake.excluded import LeftOut
from enginediag_cli.intake.selection import STDIN, Source, Wanted, refuse_repeated
from enginediag_cli.recordings.masking import Judged, LiveMasker, Masker
from enginediag_cli.recordings.read import read, table_file
from enginediag_cli.recordings.source import GrowingFile, needs_whole_file
from enginediag_cli.recordings.table import Recording, concat
from enginediag_cli.recordings.table_file import OWN, ReadingCounts, TableFile

if TYPE_CHECKING:
    from enginediag_cli.engine.tape import Tapes
    from enginediag_cli.recordings.recorder import Recorder


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


CHUNK = 5000
"""Records read at once: rows appear while a long recording is being read, engine calls stay few."""


@dataclass
class Intake:
    """The recordings of a `source` for an engine that reads the columns `wanted` (None: for statistics alone).

    fleet: a recording of several engines may be read whole; otherwise one of them has to be wanted by name.
    agreement: what recordings are compared with before they are handed on; one that cannot be of that engine, or in
    these units, raises DataError, or is kept in `mismatches` where that is accepted.
    keep_going: a file that cannot be read is named in `unread`, with the reason, and the others are read all the same.
    left_out, provenance, columns: what was left out, by file and engine, the `#` lines of the files' heads, and the
    names of all their columns, as far as they have been read.
    """

    source: Source
    wanted: Wanted | None
    fleet: bool = False
    agreement: Agreement | None = None
    keep_going: bool = False
    unread: dict[str, str] = field(default_factory=dict)
    left_out: list[LeftOut] = field(default_factory=list)
    mismatches: list[Disagreement] = field(default_factory=list)
    provenance: list[str] = field(default_factory=list)
    columns: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        refuse_repeated(self.source.files)
        self._recorder: Recorder | None = None
        if self.source.recorder:
            from enginediag_cli.recordings.recorder_file import load_recorder

            self._recorder = load_recorder(self.source.recorder)

    def files(self) -> Iterator[File]:
        """The files in turn; each has to be read before the next is asked for. Raises DataError."""
        for name in self.source.files:
            with ExitStack() as opened:
                try:
                    if self.keep_going and len(self.source.files) > 1:
                        refuse_silent_pipe(name)
                    table = opened.enter_context(table_file(name)) if self.recorder is None else None
                except DataError as error:
                    self.excuse(name, error)
                    continue
                yield File(self, name, table)

    def chunks(self) -> Iterator[Recording]:
        """Masked chunks of all files in turn. Raises DataError, NoVerdictError."""
        for file in self.files():
            try:
                yield from file.masked()
            except (DataError, NoVerdictError) as error:
                self.excuse(file.name, error)

    def excuse(self, name: str, error: EngineDiagError) -> None:
        """Go on without the rest of a file, which `unread` names; raises the error where there is nothing to go on
        with: no `keep_going`, or no other file that can be read."""
        if not self.keep_going:
            raise error
        self.unread[name] = str(error)
        if len(self.unread) == len(self.source.files):
            raise error

    def ungated(self) -> Intake | None:
        """The same with every record that was read, steady or not, and no averages; None where nothing but masks leaves
        records out, or where what has been read cannot be read again."""
        recorder = self._recorder
        if recorder is None or not (recorder.steady or recorder.average_s > 0.0) or STDIN in self.source.files:
            return None
        every = Intake(self.source, self.wanted, self.fleet)
        every._recorder = replace(recorder, steady=None, average_s=0.0)
        return every

    def remember(self, recording: Recording) -> None:
        """Keep what the head of a recording says: where it comes from, and its columns."""
        self.inherit(recording.provenance)
        self.columns += [column for column in recording.order if column not in self.columns]

    def inherit(self, provenance: Iterable[str]) -> None:
        """Keep the `#` lines of a file's head."""
        self.provenance += [line for line in provenance if line not in self.provenance]

    def compare(self, recording: Recording, engine: str = "") -> None:
        """Compare records of the engine that the recorder calls `engine` with the engine. Raises DataError."""
        if self.agreement is None:
            return
        # where nothing is to be stopped, nobody needs to know why
        search = not self.source.accept_mismatch
        found = self.agreement.disagreements(recording, engine, self._recorder, search)
        if found and search:
            raise MismatchError(found)
        self.mismatches += [f for f in found if str(f) not in {str(m) for m in self.mismatches}]

    @property
    def recorder(self) -> Recorder | None:
        return self._recorder


class File:
    """One file of an intake. `table`: the open file; None where a recorder maps it."""

    def __init__(self, intake: Intake, name: str, table: TableFile | None):
        self._intake, self.name, self.table = intake, name, table

    def masked(self) -> Iterator[Recording]:
        """Its chunks as they are judged; what was left out goes to the intake's `left_out`."""
        intake = self._intake
        assert intake.wanted is not None
        if intake.recorder is not None:
            yield from self._mapped(intake.recorder)
            return
        assert self.table is not None
        left = LeftOut(self.name)
        intake.left_out.append(left)
        wanted = intake.wanted
        masker: Masker | None = None
        past = Past(wanted.tapes)
        counts = ReadingCounts()
        chunks = read(self.table, declared=wanted.declared, chunk_records=CHUNK, counts=counts)
        for chunk in of_engine(chunks, intake.source.engine_instance):
            if masker is None:
                intake.remember(chunk)
                left.absent = wanted.absent(chunk)
                masker = Masker(judged_columns(wanted, chunk))
            left.records += len(chunk)
            left.reading = counts
            intake.compare(chunk)
            yield from (past.told("", part) for part in self._counted(masker.add(chunk), masker, left))
        if masker is not None:
            left.reading = counts
            yield from (past.told("", part) for part in self._counted(masker.end(), masker, left))

    @staticmethod
    def _counted(chunks: list[Recording], masker: Masker, left: LeftOut) -> Iterator[Recording]:
        left.masked(masker.counts)
        yield from chunks

    def _mapped(self, recorder: Recorder) -> Iterator[Recording]:
        """What the recorder keeps of the file, in chunks that each are of one engine."""
        intake, wanted = self._intake, self._intake.source.engine_instance
        assert intake.wanted is not None
        chosen = engines_wanted(recorder.engines, wanted, self.name, fleet=intake.fleet)
        stream = recorder.stream(self.name, CHUNK, intake.wanted.given, chosen)
        as_read = _AsRead(intake, recorder, chosen)
        stream.watch = as_read.see
        left_out = {name: LeftOut(self.name, name, undecided=recorder.undecided) for name in stream.engines}
        intake.left_out += left_out.values()
        named = dict.fromkeys(stream.engines, False)
        past = Past(intake.wanted.tapes)
        past.whole(recorder, self.name, intake.wanted.given, tuple(stream.engines))
        for name, recording in _why_nothing(stream, as_read):
            if not left_out[name].records:
                intake.remember(recording)
                left_out[name].absent = intake.wanted.absent(recording)
            left_out[name].mapped(stream.engines[name])
            left_out[name].reading = stream.counts
            if as_read.gated:
                intake.compare(recording, name)
            part = past.told(name, recording)
            if wanted and name != wanted:
                part = part.select(named_rows(recording, wanted))
                named[name] |= bool(len(part))
            yield part
        for name, live in stream.engines.items():
            left_out[name].mapped(live)
            left_out[name].reading = stream.counts
            if wanted and name != wanted and not named[name]:
                raise DataError(f"{self.name}: no record of engine {wanted!r}")


def _why_nothing(stream: Iterable[tuple[str, Recording]], as_read: _AsRead) -> Iterator[tuple[str, Recording]]:
    """The stream; where nothing is left of it, because of a wrong unit perhaps, that is what is raised."""
    try:
        yield from stream
    except (DataError, NoVerdictError) as error:
        if not isinstance(error, MismatchError):
            as_read.compare()
        raise


class _AsRead:
    """Records of a foreign file as they stand in it, compared with the engine before limits and masks take readings in
    another unit for impossible ones; behind a gate for steady records, only where it keeps nothing."""

    def __init__(self, intake: Intake, recorder: Recorder, engines: Collection[str]):
        self._intake, self._recorder, self._engines = intake, recorder, engines
        self.gated = recorder.steady is not None or recorder.average_s > 0.0
        self._latest: Recording | None = None

    def see(self, chunk: Recording) -> None:
        self._latest = chunk
        if not self.gated:
            self.compare()

    def compare(self) -> None:
        """The latest of them. Raises DataError."""
        if self._intake.agreement is None or self._latest is None:
            return
        from enginediag_cli.recordings.recorder import Conversion

        chunk, self._latest = self._latest, None
        few = chunk.select(slice(0, None, max(1, len(chunk) // SAMPLED)))
        for name in self._engines:
            converted = Conversion(self._recorder, name).add(few, end=True)
            self._intake.compare(self._recorder.derive(converted), name)


def refuse_silent_pipe(name: str) -> None:
    """Raises DataError for a pipe in a folder, to which nobody may ever write; those of a shell (/dev/fd/63) pass."""
    try:
        silent = stat.S_ISFIFO(os.stat(name).st_mode) and not os.path.realpath(name).startswith(("/proc/", "/dev/"))
    except OSError:
        return
    if silent:
        raise DataError(f"{name}: a pipe, not a file; among several files it would hold up the others")


def judged_columns(wanted: Wanted, recording: Recording) -> Judged:
    """What is searched for gross errors in a recording of these columns."""
    inputs = [c for c in (*wanted.inputs, *wanted.optional) if c in recording.columns]
    return Judged([c for c in wanted.sensors if c in recording.columns], inputs)


def engines_wanted(names: Collection[str], wanted: str, file: str, *, fleet: bool) -> tuple[str, ...]:
    """Which of the engines that a recorder tells apart are meant; all where it tells none apart. Raises DataError."""
    known = [name for name in names if name]
    if wanted in known:
        return (wanted,)
    if len(known) > 1 and (wanted or not fleet):
        what = f"no engine {wanted!r}" if wanted else "several engines"
        raise DataError(f"{file}: {what} in this recording; choose with --engine-instance one of {', '.join(known)}")
    return tuple(names)


def of_engine(chunks: Iterator[Recording], wanted: str) -> Iterator[Recording]:
    """The records that name this engine in their column `engine`; all records for "". Raises DataError when there is
    no such column, or no such record when the file has ended."""
    if not wanted:
        yield from chunks
        return
    met: dict[str, None] = {}
    source = ""
    for chunk in chunks:
        rows = named_rows(chunk, wanted)
        met |= dict.fromkeys(chunk.text["engine"])
        source = chunk.source
        yield chunk.select(rows)
    if wanted not in met:
        there = ", ".join(name for name in met if name) or "none is named"
        raise DataError(f"{source}: no record of engine {wanted!r} ({there})")


def named_rows(chunk: Recording, wanted: str) -> np.ndarray:
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


def live_chunks(intake: Intake, block: int, idle_s: float) -> Iterator[Recording]:
    """Masked blocks of up to `block` records of each file in turn; a file to which nothing is added for `idle_s`
    seconds has ended. What only a longer stretch shows (spikes) is not searched for."""
    codec = OWN.codec if intake.recorder is None else intake.recorder.dialect.codec
    for file in intake.source.files:
        source: Any = file if file == STDIN or needs_whole_file(file) else GrowingFile(file, idle_s, codec=codec)
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
    from enginediag_cli.recordings.recorder import LiveRecorder

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
