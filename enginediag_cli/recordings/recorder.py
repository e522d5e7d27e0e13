"""The recorder: turns a foreign recording into recordings of single engines in the program's columns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from enginediag_cli.config.checked import Checked
from enginediag_cli.config.kinds import load_checked
from enginediag_cli.errors import ConfigError, DataError, NoVerdictError, Problem
from enginediag_cli.recordings.average import average
from enginediag_cli.recordings.derived import RULES
from enginediag_cli.recordings.quality import MaskReport, QualitySettings, mask_gross
from enginediag_cli.recordings.read import Source, read_all
from enginediag_cli.recordings.steady import GateReport, SteadySettings, failures, gate
from enginediag_cli.recordings.table import Recording
from enginediag_cli.units import UnitError, convert, find_unit, split_column, to_si


@dataclass(frozen=True)
class Channel:
    """target = convert(scale · source + offset, unit → unit of the target), or full_scale · source / 100."""

    target: str
    source: str
    unit: str
    target_unit: str
    full_scale: float | None
    scale: float
    offset: float
    limits: tuple[float, float] | None

    def read(self, values: np.ndarray, full_scale: float | None = None) -> np.ndarray:
        """Target (N,) from the source's values (N,); full_scale replaces the channel's own."""
        reading = self.scale * values + self.offset
        full = self.full_scale if full_scale is None else full_scale
        if full is not None:
            return to_si(reading, self.unit, full)
        return convert(reading, self.unit, self.target_unit)


@dataclass(frozen=True)
class MappedRecording:
    """One engine's recording, and what happened to it on the way.

    gate is None where the recorder has no gate and does not average; standard_error (column → (M,)) is empty
    where it does not average.
    """

    engine: str
    recording: Recording
    masks: MaskReport
    gate: GateReport | None
    standard_error: Mapping[str, np.ndarray] = field(default_factory=dict)

    def report_lines(self) -> list[str]:
        """What was masked and left out, for stderr."""
        start = self.recording.source + (f", engine {self.engine}" if self.engine else "")
        lines = [f"{start}: {line}" for line in self.masks.report_lines()]
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
    def source_columns(self) -> tuple[str, ...]:
        """Numeric columns that the file must have."""
        return tuple(
            dict.fromkeys(
                self._source(channel, engine) for engine in self.engines.values() for channel in self.channels
            )
        )

    def read(self, source: Source) -> list[MappedRecording]:
        """Read and map a whole file (`-`: stdin), one result per engine. Raises DataError, NoVerdictError."""
        return list(self.map(read_all(source, required=self.source_columns, by_suffix=False)))

    def map(self, recording: Recording, *, steady: bool = True, search: bool = True) -> Iterator[MappedRecording]:
        """One result per engine: units, masks, derived columns, checks; with `steady` gate and averages; with `search`
        stuck sensors and spikes are looked for.

        Raises DataError when columns are missing, a check fails or no value is left, NoVerdictError when no
        record passes the gate.
        """
        for name, engine in self.engines.items():
            converted = self._convert(recording, name, engine)
            limits = {c.target: c.limits for c in self.channels if c.limits is not None}
            masks = self.values["masks"]
            clean, report = mask_gross(
                converted,
                limits,
                columns=[channel.target for channel in self.channels],
                settings=QualitySettings(**masks),
                search=search,
            )
            full = self._derive(clean)
            self._check(full)
            yield self._settle(name, full, report) if steady else MappedRecording(name, full, report, None)

    def _convert(self, recording: Recording, name: str, engine: Mapping[str, Any]) -> Recording:
        sources = {channel.target: self._source(channel, engine) for channel in self.channels}
        absent = sorted(set(sources.values()) - set(recording.columns))
        texts = {**self.values["text"], **{column: column for column in self.values["keep"]}}
        absent += sorted(column for column in texts.values() if column not in recording.order)
        if absent:
            raise DataError(
                f"{recording.source}: the recorder {self.path} needs columns that are not there: {', '.join(absent)}"
            )
        columns = {
            channel.target: channel.read(recording[sources[channel.target]], engine["full_scale"].get(channel.target))
            for channel in self.channels
        }
        for column, value in {**self.values["constants"], **engine["constants"]}.items():
            columns[column] = np.full(len(recording), float(value))
        text = {target: _cells(recording, source) for target, source in texts.items()}
        if name:
            text["engine"] = [name] * len(recording)
        order = (*text, *columns)
        return Recording(columns, text, order, recording.line, recording.source, recording.provenance)

    def _derive(self, recording: Recording) -> Recording:
        for settings in self.values["derived"]:
            values = RULES[settings["rule"]].compute(recording.columns, settings)
            recording = recording.with_columns({settings["name"]: values})
        return recording

    def _check(self, recording: Recording) -> None:
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

    @staticmethod
    def _source(channel: Channel, engine: Mapping[str, Any]) -> str:
        return channel.source.replace("{prefix}", engine["prefix"])


def load_recorder(path: str | Path) -> Recorder:
    """The recorder that a YAML file describes. Raises ConfigError with every problem found."""
    checked = load_checked(path, "recorder")
    values = checked.values
    problems: list[Problem] = []
    channels = tuple(_channel(checked, target, problems) for target in values["columns"])
    settings = values["steady"]
    steady = None
    if settings is not None:
        gap = settings["gap_s"]
        steady = SteadySettings(**{**settings, "gap_s": np.inf if gap is None else gap})
    problems += _unknown_columns(checked, steady)
    if problems:
        raise ConfigError(problems)
    engines = values["engines"] or {"": {"prefix": "", "constants": {}, "full_scale": {}}}
    return Recorder(
        str(path), tuple(c for c in channels if c is not None), engines, steady, values["average_s"], values
    )


def _channel(checked: Checked, target: str, problems: list[Problem]) -> Channel | None:
    spec = checked.values["columns"][target]
    here = ("columns", target)
    target_unit = split_column(target)[1] or "1"
    unit = spec["unit"] or split_column(spec["from"])[1] or ("1" if target_unit == "1" else "")
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
    )


def _full_scale_per_engine(values: Mapping[str, Any], target: str) -> bool:
    engines = values["engines"].values()
    return bool(engines) and all(target in engine["full_scale"] for engine in engines)


def _unknown_columns(checked: Checked, steady: SteadySettings | None) -> list[Problem]:
    """Problems for columns that a rule, a check or the gate names and that nothing makes."""
    from enginediag_cli.config.hints import near

    values = checked.values
    made = [*values["columns"], *values["constants"]]
    for engine in values["engines"].values():
        made += engine["constants"]
    wanted: list[tuple[tuple[str | int, ...], str]] = []
    problems = []
    for settings in values["derived"]:
        for column in RULES[settings["rule"]].needs(settings):
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


def _cells(recording: Recording, column: str) -> list[str]:
    if column in recording.text:
        return list(recording.text[column])
    return [f"{value:.10g}" for value in recording[column]]
