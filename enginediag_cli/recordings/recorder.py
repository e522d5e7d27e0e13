"""The recorder: turns a foreign recording into recordings of single engines in the program's columns.

The gate, averages and heat soak look back in time, so the last records are kept and mapped again together with the
new ones. Nothing is handed over twice, and nothing before it is final: an average when its window has ended, a record
whose neighbours count when the next one is there. Of a complete file masks are those of the whole file, and records
wait for what they are compared with; of one that is still being written only what needs no look ahead is masked.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Any

import numpy as np

from enginediag_cli.errors import DataError, NoVerdictError
from enginediag_cli.recordings.clocks import (
    JoinedFile,
    LongFormat,
    RecordTimes,
    TimeStamps,
    check_forward,
    find_joined_path,
    join_files,
    make_stamps,
    pivot_long,
    text_cells,
)
from enginediag_cli.recordings.derived import RULES, GapFill, GapFiller
from enginediag_cli.recordings.masking import (
    GateReport,
    LiveMasker,
    MaskCounts,
    MaskingRules,
    QualitySettings,
    RecordMasker,
    SteadySettings,
    average_windows,
    count_first_reasons,
    find_failures,
)
from enginediag_cli.recordings.read import read
from enginediag_cli.recordings.source import Source
from enginediag_cli.recordings.table import (
    DELIMITERS,
    THOUSANDS,
    Dialect,
    ReadingCounts,
    Recording,
    check_time,
    concat,
    find_missing_columns,
    rechunk,
)
from enginediag_cli.units import convert, to_si


class ColumnConversion:
    """For one engine ("" where the file has one) of one file, chunk by chunk: keeps where its time began and the
    readings that later gaps are filled from."""

    def __init__(self, recorder: Recorder, name: str):
        self._recorder, self._name = recorder, name
        self._engine: Mapping[str, Any] = recorder.engines[name]
        self._stamps = recorder.stamps()
        self._filler = GapFiller({c.target: c.fill for c in recorder.channels if c.fill is not None})

    def add(self, recording: Recording, *, end: bool = False) -> Recording:
        """The records that have become final. Raises DataError for columns that are not there and for bad stamps."""
        recorder, engine = self._recorder, self._engine
        sources = {channel.target: channel.source_column(engine) for channel in recorder.channels}
        texts = {**recorder.values["text"], **{column: column for column in recorder.values["keep"]}}
        self._require_readable(
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
        text = {target: list(text_cells(recording, source)) for target, source in texts.items()}
        if self._name:
            text["engine"] = [self._name] * len(recording)
        order = (*text, *columns)
        converted = Recording(columns, text, order, recording.line, recording.source, recording.provenance)
        check_time(converted)
        return self._filler.add(converted, end=end)

    def _require_readable(self, recording: Recording, numbers: set[str], others: set[str]) -> None:
        absent = sorted(numbers - set(recording.columns)) + sorted(others - set(recording.order))
        if absent:
            raise DataError(
                f"{recording.source}: the recorder {self._recorder.path} needs columns that are not there: "
                f"{', '.join(map(str, find_missing_columns(absent, recording.order)))}"
            )


@dataclass(frozen=True)
class Channel:
    """target = convert(scale · source + offset, unit → unit of the target), or full_scale · source / 100, or density
    (kg/m³) times a volume flow."""

    target: str
    source: str
    unit: str
    target_unit: str
    full_scale: float | None
    scale: float
    offset: float
    limits: tuple[float, float] | None
    density_kg_m3: float | None = None
    fill: GapFill | None = None

    def read(self, values: np.ndarray, full_scale: float | None = None) -> np.ndarray:
        """Target (N,) from the source's values (N,); full_scale replaces the channel's own."""
        reading = self.scale * values + self.offset
        full = self.full_scale if full_scale is None else full_scale
        if full is not None:
            return to_si(reading, self.unit, full)
        if self.density_kg_m3 is not None:
            return to_si(reading, self.unit) * self.density_kg_m3
        return convert(reading, self.unit, self.target_unit)

    def source_column(self, engine: Mapping[str, Any]) -> str:
        """The source column for an engine of the file."""
        return self.source.replace("{prefix}", engine["prefix"])


@dataclass(frozen=True)
class MappedRecording:
    """One engine's recording with what was masked, what the gate or the averaging kept (None without either), and what
    of the file was no record or no reading."""

    engine: str
    recording: Recording
    masks: MaskCounts
    gate: GateReport | None
    counts: ReadingCounts = field(default_factory=ReadingCounts)


@dataclass(frozen=True)
class Recorder:
    """A validated recorder file; `values` are its keys as declared in recorder_file.py."""

    path: str
    channels: tuple[Channel, ...]
    engines: Mapping[str, Mapping[str, Any]]
    steady: SteadySettings | None
    average_s: float
    values: Mapping[str, Any]

    @property
    def undecided(self) -> tuple[str, ...]:
        """What a draft leaves open, a sentence each."""
        return tuple(self.values["decide"])

    @property
    def source_columns(self) -> tuple[str, ...]:
        """Numeric columns that the file must have."""
        return tuple(dict.fromkeys(c.source_column(engine) for engine in self.engines.values() for c in self.channels))

    @property
    def dialect(self) -> Dialect:
        """How its files are written."""
        return make_dialect(self.values["file"])

    def judged(self, inputs: Collection[str] = ()) -> MaskingRules:
        """What is masked of an engine's recording; `inputs`: columns that may stand still (see masking.py)."""
        return MaskingRules(
            sensors=tuple(c.target for c in self.channels if c.target not in inputs),
            inputs=tuple(c.target for c in self.channels if c.target in inputs),
            limits={c.target: c.limits for c in self.channels if c.limits is not None},
            settings=QualitySettings(**self.values["masks"]),
        )

    def read(self, source: Source, inputs: Collection[str] = ()) -> list[MappedRecording]:
        """Read and map a whole file (`-`: stdin), one result per engine. Raises DataError, NoVerdictError."""
        counts = ReadingCounts()
        whole = concat(list(self.chunks(source, counts=counts)))
        return [replace(mapped, counts=counts) for mapped in self.map(whole, inputs=inputs)]

    def chunks(
        self,
        source: Source,
        chunk_records: int = 20_000,
        *,
        tolerant: bool = False,
        counts: ReadingCounts | None = None,
    ) -> Iterator[Recording]:
        """The records of a file (`-`: stdin) in its own columns, those that the recorder names, with the columns of the
        files that it joins; `tolerant` and `counts` as in `recordings.read.read`. Raises DataError."""
        found = self._records(source, chunk_records, tolerant, counts)
        if self.values["joins"]:
            found = rechunk(
                join_files(found, self._clock(), self._open_joined_files(source, chunk_records, counts)), chunk_records
            )
        yield from found

    def stamps(self, since: str = "") -> TimeStamps | None:
        """What reads the time of records as `chunks` gives them, for one pass; None where it is a column of numbers."""
        time, file = self.values["time"], self.values["file"]
        if time is None:
            return None
        if file["long"] is not None:
            return TimeStamps(time["from"][:1], "epoch_s", since=since or time["since"])
        return make_stamps({**time, "since": since or time["since"]}, self.dialect)

    def _records(
        self, source: Source, chunk_records: int, tolerant: bool, counts: ReadingCounts | None
    ) -> Iterator[Recording]:
        """The records of the file itself."""
        how = self.reading
        theirs = tuple(settings["name"] + "." for settings in self.values["joins"])
        ours = [column for column in how["required"] if not column.startswith(theirs)]
        long = self.values["file"]["long"]
        if long is None:
            how |= {"required": ours, "declared": [c for c in how["declared"] if c in ours]}
            yield from read(source, chunk_records=chunk_records, tolerant=tolerant, counts=counts, **how)
            return
        if tolerant:
            raise DataError(
                "an export of one reading a line has records only when it is complete, and cannot be followed"
            )
        form = LongFormat(**{**long, "good": tuple(long["good"])})
        time = self.values["time"]
        texts = [c for c in how["texts"] if c in ours and c not in time["from"]]
        read_texts = tuple(dict.fromkeys((*form.columns, *time["from"])))
        yield from pivot_long(
            read(source, by_suffix=False, dialect=self.dialect, required=read_texts, texts=read_texts, counts=counts),
            form,
            lambda: make_stamps({**time, "since": "epoch"}, self.dialect),
            self.dialect,
            [c for c in self.source_columns if c in ours],
            texts,
            chunk_records,
        )

    def _clock(self) -> RecordTimes:
        """The times of records, on the clock of all files."""
        stamps = self.stamps("epoch")
        if stamps is not None:
            return stamps.seconds
        channel = next(c for c in self.channels if c.target == "time_s")
        engine = next(iter(self.engines.values()))
        return lambda chunk: channel.read(chunk[channel.source_column(engine)])

    def _open_joined_files(self, source: Source, chunk_records: int, counts: ReadingCounts | None) -> list[JoinedFile]:
        """The files that are joined to a recording."""
        files = []
        for settings in self.values["joins"]:
            path = find_joined_path(source, settings["recording"], settings["cut"])
            dialect = self.dialect if settings["file"] is None else make_dialect(settings["file"])
            time = {**(settings["time"] or self.values["time"]), "since": "epoch"}
            start = settings["name"] + "."
            columns = [c.removeprefix(start) for c in self.source_columns if c.startswith(start)]
            stamps = [c for c in time["from"] if c not in columns]
            chunks = read(
                path,
                declared=columns,
                required=(*columns, *stamps),
                by_suffix=False,
                chunk_records=chunk_records,
                dialect=dialect,
                texts=stamps,
                stamps=stamps,
                counts=counts,
            )
            nearest = settings["how"] == "nearest"
            clock = make_stamps(time, dialect).seconds
            files.append(
                JoinedFile(settings["name"], str(path), columns, chunks, clock, nearest, settings["max_age_s"])
            )
        return files

    def stream(
        self,
        source: Source,
        chunk_records: int = 3000,
        inputs: Collection[str] = (),
        engines: Collection[str] | None = None,
        *,
        live: bool = False,
    ) -> MappedStream:
        """As `read` in bounded memory: iterate for (engine, records) as they become final; `engines`: only these."""

        return MappedStream(self, source, chunk_records, inputs, engines)

    @property
    def reading(self) -> dict[str, Any]:
        """Arguments with which `recordings.read.read` reads a file of this recorder: the columns that it names, and no
        others."""
        time = tuple(self.values["time"]["from"]) if self.values["time"] else ()
        texts = tuple(dict.fromkeys((*self.values["text"].values(), *self.values["keep"], *time)))
        numbers = self.source_columns
        return {
            "required": tuple(dict.fromkeys((*numbers, *texts))),
            "declared": numbers,
            "by_suffix": False,
            "dialect": self.dialect,
            "texts": tuple(column for column in texts if column not in numbers),
            "stamps": time,
            "units": {
                channel.source_column(engine): channel.unit
                for engine in self.engines.values()
                for channel in self.channels
                if (channel.scale, channel.offset) == (1.0, 0.0)
            },
        }

    @property
    def selects(self) -> bool:
        """Whether it keeps steady records only, or averages."""
        return self.steady is not None or self.average_s > 0.0

    def map(
        self, recording: Recording, *, steady: bool = True, inputs: Collection[str] = ()
    ) -> Iterator[MappedRecording]:
        """Map a whole file in its own columns: units, masks, derived columns, checks, gate and averages.

        Parameters
        ----------
        recording : as `chunks` gives it
        steady : whether to apply gate and averages
        inputs : columns that may stand still

        Returns
        -------
        One result per engine

        Raises
        ------
        DataError
            A column is missing, a check fails, or no value is left.
        NoVerdictError
            No record passes the gate.
        """
        used = self if steady else replace(self, steady=None, average_s=0.0)
        for name in self.engines:
            stream = EngineMapper(used, name, search=True, inputs=inputs)
            kept = stream.add(recording, end=True)
            masks = stream.counts
            if masks.total and masks.total == sum(masks.readings.values()) and not masks.frozen:
                why = "; ".join(masks.report_lines())
                raise DataError(f"{recording.source}: no usable record is left: {why}")
            stream.require_records(recording.source)
            yield MappedRecording(name, kept, stream.counts, stream.gate if used.selects else None)

    def derive(self, recording: Recording) -> Recording:
        """The recording with the derived columns. Raises DataError where time stamps go backwards."""
        if self.values["time"]:
            check_forward(recording)
        for settings in self.values["derived"]:
            values = RULES[settings["rule"]].compute(recording.columns, settings)
            recording = recording.with_columns({settings["name"]: values})
        return recording

    def check(self, recording: Recording) -> None:
        """Raises DataError when the file is not what it is taken for."""
        for check in self.values["checks"]:
            ratio = recording[check["of"]] / recording[check["over"]]
            low, high = check["between"]
            middle = float(np.nanmedian(ratio)) if np.isfinite(ratio).any() else np.nan
            if not low <= middle <= high and len(recording):
                raise DataError(
                    f"{recording.source}: {check['name']}: the median of {check['of']} / {check['over']} is "
                    f"{middle:.4g}, not within {low:g} to {high:g}: {check['otherwise']}"
                )


def make_dialect(file: Mapping[str, Any]) -> Dialect:
    """How a file is written by the keys of a section `file`."""
    return Dialect(
        DELIMITERS.get(file["delimiter"], file["delimiter"]),
        "," if file["decimal"] == "comma" else ".",
        file["encoding"],
        file["header_line"],
        file["unit_row"],
        tuple(file["names"]),
        tuple(int(width) for width in file["widths"]),
        THOUSANDS.get(file["thousands"], ""),
        tuple(file["missing"]),
        file["sheet"],
    )


SOAK_MEMORY = 12.0
"""Time constants after which a low-pass has forgotten where it began: e⁻¹² is 6e-6."""


@dataclass
class EngineMapper:
    """`recorder` for one `engine` of the file ("" where it has only one); `add` takes the records as they come.

    records, kept: records read and handed over (averages, where the recorder averages, out of so many `windows`);
    reasons: why the others went; masked: readings that were not used, by column.
    """

    recorder: Recorder
    engine: str = ""
    search: bool = False
    inputs: Collection[str] = ()
    records: int = 0
    kept: int = 0
    windows: int = 0
    reasons: Counter[str] = field(default_factory=Counter)
    _recent: Recording | None = None
    _last_line: int = 0

    def __post_init__(self) -> None:
        judged = self.recorder.judged(self.inputs)
        self._masker = RecordMasker(judged) if self.search else LiveMasker(judged)
        self._conversion = ColumnConversion(self.recorder, self.engine)

    @property
    def counts(self) -> MaskCounts:
        """What was masked, as data."""
        return self._masker.counts

    @property
    def gate(self) -> GateReport:
        """What the gate, or the averaging, kept."""
        if self.recorder.average_s > 0.0:
            return GateReport(self.kept, self.windows, dict(self.reasons), f"windows of {self.recorder.average_s:g} s")
        return GateReport(self.kept, self.records, dict(self.reasons))

    def add(self, raw: Recording, *, end: bool = False) -> Recording:
        """What has become final by these records of the file; `end`: no more will come. Raises DataError."""
        self.records += len(raw)
        pieces = self._masker.add(self._conversion.add(raw, end=end))
        if end:
            pieces += self._masker.end()
        found = [self._map(piece) for piece in pieces]
        if end or not found:
            # what waited for the next record, or an empty recording with the right columns
            rest = pieces[-1] if pieces else self._conversion.add(raw.select(slice(0, 0)))
            found.append(self._map(rest.select(slice(0, 0)), end=end))
        return concat(found)

    def _map(self, clean: Recording, *, end: bool = False) -> Recording:
        """What of masked records and of those held has become final."""
        every = concat([self._recent, clean]) if self._recent is not None else clean
        full = self.recorder.derive(every)
        if len(clean):
            self.recorder.check(full)
        final = np.ones(len(full), bool) if end else self._final(full)
        new = final & (full.line > self._last_line)
        settled = self._select_steady(full, new)
        self.kept += len(settled)
        self._last_line = int(full.line[new][-1]) if new.any() else self._last_line
        self._recent = every.select(np.arange(len(full)) >= self._first_needed(full))
        return settled

    def require_records(self, source: str) -> None:
        """Raises NoVerdictError at the end of a file of which the gate, or the averaging, kept nothing."""
        if self.recorder.selects and not self.kept:
            place = source + (f", engine {self.engine}" if self.engine else "")
            raise NoVerdictError(f"{place}: no steady record is left: {self.gate.report_line()}")

    def _final(self, full: Recording) -> np.ndarray:
        """Records (N,) about which later ones will not change anything."""
        rows = np.arange(len(full))
        steady, length = self.recorder.steady, self.recorder.average_s
        if length > 0.0 and len(full):
            number = np.floor(full["time_s"] / length)
            ended = np.flatnonzero(number != number[-1])
            return np.asarray(rows <= (ended[-1] if ended.size else -1))
        return np.asarray(rows < len(full) - 1) if steady and steady.neighbours else np.ones(len(full), bool)

    def _select_steady(self, full: Recording, new: np.ndarray) -> Recording:
        steady, length = self.recorder.steady, self.recorder.average_s
        failed = find_failures(full, steady) if steady else {}
        if length > 0.0:
            averages, report = average_windows(full, length, failed, new)
            self.reasons.update(report.reasons)
            self.windows += report.total
            return averages
        keep, reasons = count_first_reasons(failed, new)
        self.reasons.update(reasons)
        return full.select(keep)

    def _first_needed(self, full: Recording) -> int:
        """The first record that later ones look back to."""
        waiting = np.flatnonzero(full.line > self._last_line)
        first = int(waiting[0]) if waiting.size else len(full)
        reach = self._reach()
        if reach == 0.0 or "time_s" not in full or not len(full):
            return max(first - 1, 0)
        steps = np.diff(full["time_s"], prepend=full["time_s"][0])
        elapsed = np.cumsum(np.where(steps > 0, steps, 0.0))
        return int(np.searchsorted(elapsed, elapsed[min(first, len(full) - 1)] - reach))

    def _reach(self) -> float:
        """Seconds that gate, averages and heat soak look back."""
        steady, values = self.recorder.steady, self.recorder.values
        soak = [SOAK_MEMORY * s["time_constant_s"] for s in values["derived"] if s["rule"] == "soak"]
        gate = [2 * steady.window_s, 2 * steady.dwell_s] if steady else []
        return float(max([0.0, 2 * self.recorder.average_s, *gate, *soak]))


class MappedStream:
    """A foreign file mapped in bounded memory; iterate once for (engine, records), every piece with some records.

    Rows are those of `Recorder.map`, whatever the size of chunks; heat soak forgets its beginning after 12 time
    constants.

    Parameters
    ----------
    recorder, source, chunk_records : as in `Recorder.chunks`
    inputs : columns that may stand still
    engines : only these engines of the file; None for all
    live : the file is still being written: lines that are no records are skipped, and nothing is masked that needs a
        look ahead

    Attributes
    ----------
    engines : engine → its LiveRecorder, whose counts are complete at the end
    counts : what of the file was no record or no reading
    watch : takes the records as they are in the file, before they are mapped
    """

    watch: Callable[[Recording], None] | None = None

    def __init__(
        self,
        recorder: Recorder,
        source: Source,
        chunk_records: int,
        inputs: Collection[str] = (),
        engines: Collection[str] | None = None,
        live: bool = False,
    ):
        chosen = [name for name in recorder.engines if engines is None or name in engines]
        self._recorder, self._source, self._chunk, self._live = recorder, source, chunk_records, live
        self.counts = ReadingCounts()
        self.engines = {name: EngineMapper(recorder, name, search=not live, inputs=inputs) for name in chosen}

    def __iter__(self) -> Iterator[tuple[str, Recording]]:
        """Raises DataError as `Recorder.map` does, and NoVerdictError at the end of an engine without any record."""
        chunks = self._recorder.chunks(self._source, self._chunk, tolerant=self._live, counts=self.counts)
        last: Recording | None = None
        for chunk in chain(chunks, [None]):
            if last is not None:
                if self.watch is not None:
                    self.watch(last)
                for name, stream in self.engines.items():
                    found = stream.add(last, end=chunk is None)
                    if len(found):
                        yield name, found
            last = chunk
        for stream in self.engines.values():
            if not self._live:
                stream.require_records(str(self._source))
