"""The recorder: turns a foreign recording into recordings of single engines in the program's columns.

One column of a recorder: where it comes from, its unit, and what it becomes.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.config.hints import near
from enginediag_cli.config.kinds import load_checked
from enginediag_cli.config.validate import Checked
from enginediag_cli.errors import ConfigError, DataError, NoVerdictError, Problem
from enginediag_cli.recordings.conversion import Conversion
from enginediag_cli.recordings.derived import RULES
from enginediag_cli.recordings.formats.table_file import NumberForm, ReadingCounts
from enginediag_cli.recordings.joining import Clock, Fill, JoinedFile, LongForm, beside, join, pivot
from enginediag_cli.recordings.masking import Judged, MaskReport, QualitySettings, insist_on_something, mask_recording
from enginediag_cli.recordings.read import read
from enginediag_cli.recordings.source import DELIMITERS, FIXED, THOUSANDS, WHITESPACE, Dialect, Source, known_encoding
from enginediag_cli.recordings.stamps import NUMBERS, Stamps, check_forward, stamps_of, zone_of
from enginediag_cli.recordings.steady import GateReport, SteadySettings, average, failures, gate
from enginediag_cli.recordings.table import Recording, concat, rechunk
from enginediag_cli.units import UnitError, convert, find_unit, split_column, split_header, to_si

if TYPE_CHECKING:
    from enginediag_cli.recordings.live import RecorderStream


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
    fill: Fill | None = None

    def read(self, values: np.ndarray, full_scale: float | None = None) -> np.ndarray:
        """Target (N,) from the source's values (N,); full_scale replaces the channel's own."""
        reading = self.scale * values + self.offset
        full = self.full_scale if full_scale is None else full_scale
        if full is not None:
            return to_si(reading, self.unit, full)
        if self.density_kg_m3 is not None:
            return to_si(reading, self.unit) * self.density_kg_m3
        return convert(reading, self.unit, self.target_unit)

    def source_of(self, engine: Mapping[str, Any]) -> str:
        """The source column for an engine of the file."""
        return self.source.replace("{prefix}", engine["prefix"])


def load_channel(checked: Checked, target: str, problems: list[Problem]) -> Channel | None:
    """The channel that a checked recorder file declares for a target; what is wrong with it goes to `problems`."""
    spec = checked.values["columns"][target]
    here = ("columns", target)
    target_unit = split_column(target)[1] or "1"
    unit = spec["unit"] or split_header(spec["from"])[1] or ("1" if target_unit == "1" else "")
    if not unit:
        problems.append(
            checked.problem(
                (*here, "from"), f"the unit of {spec['from']} is not known", "its name has no unit; add 'unit:'"
            )
        )
        return None
    try:
        known = find_unit(target_unit)
        if known.si != known.name and target_unit != "1":
            problems.append(
                checked.problem(
                    here, f"the target {target} is not in SI", f"name it {split_column(target)[0]}_{known.si}"
                )
            )
        if spec["full_scale"] is not None:
            to_si(1.0, unit, spec["full_scale"])
        elif _volume_as_mass(checked, target, unit, problems):
            to_si(1.0, unit)
        elif not _full_scale_per_engine(checked.values, target):
            convert(1.0, unit, target_unit)
    except UnitError as error:
        problems.append(checked.problem((*here, "unit" if spec["unit"] else "from"), str(error)))
        return None
    limits = spec["limits"]
    return Channel(
        target,
        spec["from"],
        unit,
        target_unit,
        spec["full_scale"],
        spec["scale"],
        spec["offset"],
        None if limits is None else (limits[0], limits[1]),
        spec["density_kg_m3"],
        _fill(checked, target, problems),
    )


def _volume_as_mass(checked: Checked, target: str, unit: str, problems: list[Problem]) -> bool:
    """Whether the column turns a volume flow into a mass flow, or says so where it cannot."""
    density = checked.values["columns"][target]["density_kg_m3"]
    volume = find_unit(unit).dimension == "volume flow"
    mass = find_unit(split_column(target)[1] or "1").dimension == "mass flow"
    if volume and mass and density is None:
        problems.append(
            checked.problem(
                ("columns", target),
                f"{unit} is a volume flow and {target} a mass flow",
                "add density_kg_m3:, of jet fuel about 800, at the temperature of the flow meter",
            )
        )
    elif density is not None and not (volume and mass):
        problems.append(
            checked.problem(
                ("columns", target, "density_kg_m3"), "a density turns a volume flow into a mass flow; this is none"
            )
        )
    return volume and mass


def _fill(checked: Checked, target: str, problems: list[Problem]) -> Fill | None:
    spec = checked.values["columns"][target]
    method, records = spec["fill"], spec["fill_records"]
    if (method == "none") != (records == 0):
        problems.append(
            checked.problem(
                ("columns", target, "fill_records" if method == "none" else "fill"),
                "'fill' and 'fill_records' belong together",
                "such as fill: hold, fill_records: 10",
            )
        )
    return Fill(method, records) if method != "none" and records else None


def _full_scale_per_engine(values: Mapping[str, Any], target: str) -> bool:
    engines = values["engines"].values()
    return bool(engines) and all(target in engine["full_scale"] for engine in engines)


Place = tuple[str | int, ...]
"""Keys and names on the way to a value of the file."""


MOST_COLUMNS = 2000
"""Columns that a recorder makes; no engine has a tenth of them."""


@dataclass(frozen=True)
class MappedRecording:
    """One engine's recording, and what happened to it on the way.

    gate is None where the recorder has no gate and does not average; standard_error (column → (M,)) is empty
    where it does not average; counts: what of the file was no record or no reading.
    """

    engine: str
    recording: Recording
    masks: MaskReport
    gate: GateReport | None
    standard_error: Mapping[str, np.ndarray] = field(default_factory=dict)
    counts: ReadingCounts = field(default_factory=ReadingCounts)

    def report_lines(self) -> list[str]:
        """What was masked and left out, for stderr."""
        start = self.recording.source + (f", engine {self.engine}" if self.engine else "")
        lines = [f"{start}: {line}" for line in (*self.counts.report_lines(), *self.masks.report_lines())]
        return lines + ([f"{start}: {self.gate.report_line()}"] if self.gate else [])


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
        return tuple(dict.fromkeys(c.source_of(engine) for engine in self.engines.values() for c in self.channels))

    @property
    def dialect(self) -> Dialect:
        """How its files are written."""
        return dialect_of(self.values["file"])

    def judged(self, inputs: Collection[str] = ()) -> Judged:
        """What is masked of an engine's recording; `inputs`: columns that may stand still (see masking.py)."""
        return Judged(
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
            found = rechunk(join(found, self._clock(), self._joined(source, chunk_records, counts)), chunk_records)
        yield from found

    def stamps(self, since: str = "") -> Stamps | None:
        """What reads the time of records as `chunks` gives them, for one pass; None where it is a column of numbers."""
        time, file = self.values["time"], self.values["file"]
        if time is None:
            return None
        if file["long"] is not None:
            return Stamps(time["from"][:1], "epoch_s", since=since or time["since"])
        return stamps_of({**time, "since": since or time["since"]}, self.dialect)

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
        form = LongForm(**{**long, "good": tuple(long["good"])})
        time = self.values["time"]
        texts = [c for c in how["texts"] if c in ours and c not in time["from"]]
        read_texts = tuple(dict.fromkeys((*form.columns, *time["from"])))
        yield from pivot(
            read(source, by_suffix=False, dialect=self.dialect, required=read_texts, texts=read_texts, counts=counts),
            form,
            lambda: stamps_of({**time, "since": "epoch"}, self.dialect),
            NumberForm.from_dialect(self.dialect),
            [c for c in self.source_columns if c in ours],
            texts,
            chunk_records,
        )

    def _clock(self) -> Clock:
        """The times of records, on the clock of all files."""
        stamps = self.stamps("epoch")
        if stamps is not None:
            return stamps.seconds
        channel = next(c for c in self.channels if c.target == "time_s")
        engine = next(iter(self.engines.values()))
        return lambda chunk: channel.read(chunk[channel.source_of(engine)])

    def _joined(self, source: Source, chunk_records: int, counts: ReadingCounts | None) -> list[JoinedFile]:
        """The files that are joined to a recording."""
        files = []
        for settings in self.values["joins"]:
            path = beside(source, settings["recording"], settings["cut"])
            dialect = self.dialect if settings["file"] is None else dialect_of(settings["file"])
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
            clock = stamps_of(time, dialect).seconds
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
    ) -> RecorderStream:
        """As `read` in bounded memory: iterate for (engine, records) as they become final; `engines`: only these."""
        from enginediag_cli.recordings.live import RecorderStream

        return RecorderStream(self, source, chunk_records, inputs, engines)

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
                channel.source_of(engine): channel.unit
                for engine in self.engines.values()
                for channel in self.channels
                if (channel.scale, channel.offset) == (1.0, 0.0)
            },
        }

    def map(
        self, recording: Recording, *, steady: bool = True, inputs: Collection[str] = ()
    ) -> Iterator[MappedRecording]:
        """One result per engine of a whole file: units, masks, derived columns, checks; with `steady` gate and
        averages. inputs: columns that may stand still.

        Raises DataError when columns are missing, a check fails or no value is left, NoVerdictError when no
        record passes the gate.
        """
        for name in self.engines:
            converted = Conversion(self, name).add(recording, end=True)
            clean, report = mask_recording(converted, self.judged(inputs))
            if not report.records["frozen"]:
                insist_on_something(clean, report, [c.target for c in self.channels if c.target != "time_s"])
            full = self.derive(clean)
            self.check(full)
            yield self._settle(name, full, report) if steady else MappedRecording(name, full, report, None)

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

    def _settle(self, name: str, recording: Recording, masks: MaskReport) -> MappedRecording:
        settings = self.steady
        errors: Mapping[str, np.ndarray] = {}
        if self.average_s > 0.0:
            failed = failures(recording, settings) if settings else {}
            averages, report = average(recording, self.average_s, failed)
            kept, errors = averages.recording, averages.standard_error
        elif settings:
            rows, report = gate(recording, settings)
            kept = recording.select(rows)
        else:
            return MappedRecording(name, recording, masks, None)
        if report.kept == 0:
            raise NoVerdictError(f"{recording.source}: no steady record is left: {report.report_line()}")
        return MappedRecording(name, kept, masks, report, errors)


def dialect_of(file: Mapping[str, Any]) -> Dialect:
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


def load_recorder(path: str | Path) -> Recorder:
    """The recorder that a YAML file describes. Raises ConfigError with every problem found."""
    checked = load_checked(path, "recorder")
    values = checked.values
    if len(values["columns"]) > MOST_COLUMNS:
        what = f"{len(values['columns'])} columns, and a recorder makes at most {MOST_COLUMNS}"
        raise ConfigError([checked.problem(("columns",), what)])
    problems: list[Problem] = []
    channels = tuple(load_channel(checked, target, problems) for target in values["columns"])
    settings = values["steady"]
    steady = None
    if settings is not None:
        gap = settings["gap_s"]
        steady = SteadySettings(**{**settings, "gap_s": np.inf if gap is None else gap})
    problems += _file_problems(checked)
    problems += _unknown_columns(checked, steady)
    if problems:
        raise ConfigError(problems)
    engines = values["engines"] or {"": {"prefix": "", "constants": {}, "full_scale": {}}}
    return Recorder(
        str(path), tuple(c for c in channels if c is not None), engines, steady, values["average_s"], values
    )


def _problems_of_file(checked: Checked, here: Place, file: Mapping[str, Any] | None) -> Iterator[Problem]:
    """Problems of a section `file` that only its values together show."""
    if file is None:
        return
    if not known_encoding(file["encoding"]):
        hint = "such as utf-8, latin-1 or cp1252"
        yield checked.problem((*here, "encoding"), f"no encoding {file['encoding']!r}", hint)
    marks = {"decimal mark": file["decimal"], "delimiter": file["delimiter"], "mark of thousands": file["thousands"]}
    for (one, a), (other, b) in combinations(marks.items(), 2):
        if a == b or {a, b} == {"space", WHITESPACE}:
            key = "thousands" if "thousands" in other else "decimal"
            yield checked.problem((*here, key), f"the {one} and the {other} are both {a}s")
    if (file["header"] == "none") != bool(file["names"]):
        hint = "such as header: none, names: [unit, cycle, T3]"
        yield checked.problem((*here, "names"), "'header: none' and 'names' belong together", hint)
    if (file["delimiter"] == FIXED) != bool(file["widths"]):
        hint = "such as delimiter: fixed, widths: [10, 8, 8]"
        yield checked.problem((*here, "widths"), "'delimiter: fixed' and 'widths' belong together", hint)
    if any(width < 1 or width % 1 for width in file["widths"] if width is not None):
        yield checked.problem((*here, "widths"), "widths are whole numbers of characters, from 1")
    if file["names"] and file["widths"] and len(file["names"]) != len(file["widths"]):
        what = f"{len(file['names'])} names for {len(file['widths'])} widths"
        yield checked.problem((*here, "names"), what, "a column that is not read has the name ''")
    long = file["long"]
    if long is not None and bool(long["quality"]) != bool(long["good"]):
        hint = "such as quality: Status, good: [Good]"
        yield checked.problem((*here, "long"), "'quality' and 'good' belong together", hint)


def _problems_of_time(checked: Checked, here: Place, time: Mapping[str, Any] | None) -> Iterator[Problem]:
    """Problems of a section `time` that only its values together show."""
    if time is None:
        return
    if not time["from"]:
        yield checked.problem((*here, "from"), "no column of the time stamp")
    form = time["format"]
    if form not in ("iso", *NUMBERS) and "%" not in form:
        hint = near(form, ["iso", *NUMBERS]) + "; or a format as in strptime, '%d.%m.%Y %H:%M:%S'"
        yield checked.problem((*here, "format"), f"no format of time stamps {form!r}", hint)
    elif form in NUMBERS and len(time["from"]) > 1:
        yield checked.problem((*here, "from"), f"a time of the form {form} is one column")
    try:
        zone_of(time["zone"])
    except ValueError as error:
        yield checked.problem((*here, "zone"), f"no time zone {time['zone']!r}", str(error))


def _file_problems(checked: Checked) -> Iterator[Problem]:
    """Problems of the sections that say how files are written, and when."""
    values = checked.values
    yield from _problems_of_file(checked, ("file",), values["file"])
    yield from _problems_of_time(checked, ("time",), values["time"])
    timed = values["time"] is not None or "time_s" in values["columns"]
    if values["time"] is not None and "time_s" in values["columns"]:
        yield checked.problem(("time",), "time_s is made twice", "leave it out of 'columns'")
    if values["file"]["long"] is not None and values["time"] is None:
        yield checked.problem(("file", "long"), "a long export needs 'time:', the column of its time stamps")
    for settings in values["joins"]:
        here = ("joins", settings["name"])
        yield from _problems_of_file(checked, (*here, "file"), settings["file"])
        yield from _problems_of_time(checked, (*here, "time"), settings["time"])
        if not timed:
            yield checked.problem(here, "files are joined on time, and this recorder makes no time_s")
        if settings["time"] is None and values["time"] is None:
            yield checked.problem(here, "a joined file needs 'time:', the column of its time stamps")
        if "{name}" not in settings["recording"] or Path(settings["recording"]).name != settings["recording"]:
            hint = "such as '{name}_slow.csv'"
            yield checked.problem((*here, "recording"), "the name of a file beside the recording, with {name}", hint)


def _unknown_columns(checked: Checked, steady: SteadySettings | None) -> list[Problem]:
    """Problems for columns that a rule, a check or the gate names and that nothing makes."""
    values = checked.values
    made = [*values["columns"], *values["constants"], *(["time_s"] if values["time"] else [])]
    for engine in values["engines"].values():
        made += engine["constants"]
    wanted: list[tuple[tuple[str | int, ...], str]] = []
    problems = []
    for settings in values["derived"]:
        rule, here = RULES[settings["rule"]], ("derived", settings["name"])
        units = {c: split_column(c)[1] or "1" for c in (settings["name"], *rule.needs(settings))}
        if len(units) < 2:
            problems.append(checked.problem(here, "it is computed from no other column"))
        elif rule.one_unit and len(set(units.values())) > 1:
            told = ", ".join(f"{column} in {unit}" for column, unit in units.items())
            problems.append(checked.problem(here, f"columns of different units: {told}"))
        for column in rule.needs(settings):
            if column not in made:
                problems.append(
                    checked.problem(
                        ("derived", settings["name"]),
                        f"the column {column} is not made before this",
                        near(column, made),
                    )
                )
        made.append(settings["name"])
    for check in values["checks"]:
        wanted += [(("checks", check["name"], key), check[key]) for key in ("of", "over")]
    if steady is not None:
        wanted += [(("steady",), column) for column in steady.columns]
    if values["average_s"] > 0.0:
        wanted.append((("average_s",), "time_s"))
    problems += [
        checked.problem(place, f"no column {column} is made by this recorder", near(column, made))
        for place, column in wanted
        if column not in made
    ]
    return problems
